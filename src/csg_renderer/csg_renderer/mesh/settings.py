"""Thresholds of meshes: their files, their units, how their triangles meet, and rays among them.

Those of creases and facets were chosen with facetted primitives of 8 to 200 facets a turn and files of CAD programs; no
command is kept. They are relative to the mesh's size (diagonal of its bounding box) where no unit is given.
"""

from __future__ import annotations

import numpy as np

# -- rays -------------------------------------------------------------------------------------------------------------

# Triangles that one box of the hierarchy holds at most: below that a test of a box costs what it saves.
LEAF = 4
# Places along each axis at which a node of the hierarchy may be cut.
BINS = 16
# Barycentric coordinate down to which a ray still meets a triangle: rounding leaves no gap between two of them.
RIM = 1e-9
# Component of a ray, metres, that is divided by as if it were this: its inverse is a number still.
NO_DIRECTION = 1e-300

# -- files ------------------------------------------------------------------------------------------------------------

# Bytes of the largest mesh file that is read, half a million triangles of binary STL: text takes trimesh a second for
# every ten million bytes.
LARGEST_MESH = 2**25

# -- facets -----------------------------------------------------------------------------------------------------------

# Triangles that turn by more than this, radians, meet in a crease: larger than the angle between facets of a surface
# with 12 facets a turn or more, smaller than the angle of any sensible edge.
CREASE_ANGLE = np.radians(30.0)
# Distance between vertices that are one: ten times the rounding of a 32-bit STL file.
WELD = 2e-6
# Turn between neighbouring segments, or triangles, that are straight or in one plane, radians.
COLLINEAR = np.radians(0.2)
# Largest ratio of the lengths of neighbouring segments on one facetted curve.
EVEN = 1.8

# -- units of meshes ---------------------------------------------------------------------------------------------------

# Metres, at which an object is looked at where nobody knows: a robot's arm's length. Features tell it better.
WORKING_DISTANCE = 0.6
# Diagonal of an object as a share of its distance. Less than the first is 14 pixels at a focal length of 700 pixels, of
# which no edges are recovered; more than the second does not fit into a picture of 90 degrees.
LEAST_SHARE, LARGEST_SHARE = 0.02, 2.0
