"""Triangle meshes: their files, and the hierarchy of boxes that rays go down."""
