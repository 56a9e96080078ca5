"""Every threshold of the room scene, with its unit, its meaning and where it comes from."""

from __future__ import annotations

# Determinant of a placement, as a fraction of the cube of its largest column, at which it has flattened the primitive
# to nothing. Some ten thousand roundings of double precision (1.1e-16).
SINGULAR = 1e-12
# Largest difference of a matrix' last row from 0 0 0 1. Products of many transforms, and files written with ten digits,
# stay within it; no projective matrix does.
AFFINE = 1e-9
# A ray meets the surface of a terrain's cell also this far outside the cell (a fraction of the grid and of the ray's
# length in the cell), so that no ray passes between two cells. Some ten thousand roundings.
CELL_SLACK = 1e-12
# The largest value of a 16-bit PNG, which stands for the highest height.
PNG_FULL_SCALE = 65535.0
# Heights of the largest grid that is read from a file (160 MB as numbers): a grid from anybody should not fill the
# memory. An SRTM tile of one second of arc has 13 million.
MAX_HEIGHTS = 20_000_000
# Bytes of an ASCII grid for each height at most, and lines of its header.
MAX_ASC_BYTES_PER_HEIGHT = 32
ASC_HEADER_LINES = 6
# A PLANE is endless; its mesh is a cube this many times as large as everything bounded.
ENDLESS = 10.0
# Facets around a circle of a mesh: the edge of a facet deviates from a unit circle by 1.2e-3.
SEGMENTS = 64
# Light that comes from everywhere, and the colour where there is nothing, when nobody names them: red, green, blue in
# 0..1.
DEFAULT_AMBIENT = (0.2, 0.2, 0.2)
DEFAULT_BACKGROUND = (0.0, 0.0, 0.0)
# Pixels of the largest picture that is laid on a surface or around a scene (8192 x 2048; 270 MB with all it is reduced
# to): one from anybody should not fill the memory.
MAX_TEXELS = 2**24
