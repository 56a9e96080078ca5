"""Whether a part will be found in a working volume by a rig of cameras, and how exactly, before there is a camera."""
