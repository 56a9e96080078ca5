"""Named numbers of the watch room: how much of a run is recorded."""

from __future__ import annotations

# Statements recorded; those after them count in the profile, but cannot be looked at. A browser's slider has about a
# thousand places.
MAX_STEPS = 5_000
# Size of all recorded values before they are compressed, bytes; a browser takes a page of this size in a second.
MAX_BYTES = 64_000_000
# Largest array, elements, that is recorded: 1024 x 1024, which a screen can show.
MAX_ELEMENTS = 1 << 20
# Planes of a serial array that are recorded, those that change first.
MAX_PLACES = 64
# Numbers of this magnitude and more have no part in the range of a picture's colours, and are red: programs write 1E30
# where there is nothing.
LARGEST_SHOWN = 1e20
# Deepest call in the profile; deeper ones are added to it.
MAX_PROFILE_DEPTH = 24
