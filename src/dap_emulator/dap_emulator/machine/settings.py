"""Named numbers of the machine room. What operations cost stands in costs.py, with the source of every constant."""

from __future__ import annotations

# Operations that a machine's trace keeps; the oldest go first. An entry takes about 200 bytes, so 2 MB in all.
TRACE_LENGTH = 10_000

# Layouts kept for reuse: one for each shape, size of machine and mapping that a program works with.
LAYOUTS_CACHED = 4096

# Pictures of planes: lines between single PEs are drawn up to this many elements a side; beyond it they would cover the
# picture.
FINE_GRID = 80
# Frames of an animated GIF, 1/s.
FRAMES_PER_SECOND = 5
# Most frames side by side in one PNG.
FRAMES_IN_A_STRIP = 6
# Resolution of a PNG, dots per inch.
DOTS_PER_INCH = 110
# Side of a notebook's picture, pixels, approximately: elements are drawn as whole squares.
NOTEBOOK_PIXELS = 192
