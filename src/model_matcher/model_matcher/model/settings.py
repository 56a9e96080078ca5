"""Numbers of what is known of a model before any search: its tables, its regularity, its symmetry, its hull."""

from __future__ import annotations

import math

# -- data that can be used -------------------------------------------------------------------------------------------

# Metres: what is said to be farther is a mistake, and its squares and cubes would be without number.
FARTHEST = 1e6
# Three sigma by which an edge is off across, as a share of its length, from which its direction is open: beyond the cap
# of the thesis' cone (5.4) at both ends.
MOST_ACROSS = 0.25

# -- voxel tables ----------------------------------------------------------------------------------------------------

# Cells of a table along the model's longest side.
VOXELS_ACROSS = 24
# Tables exist for these reaches (fractions of the model's size); the smallest sufficient one is used.
VOXEL_REACHES = (0.02, 0.03, 0.04, 0.06, 0.085, 0.12, 0.17, 0.25)
# Tolerances that data has to be within while poses are searched, in tolerances: a pose from two short edges is off by
# more than the data's own error.
SEARCH_WIDTH = 1.6

# -- regularity ------------------------------------------------------------------------------------------------------

# Cosines: nearer directions count as one (7 degrees), and so do right angles.
PARALLEL_COSINE = 0.9925
PERPENDICULAR_COSINE = math.sin(math.acos(PARALLEL_COSINE))
# The most frequent directions, which span the planes, and the orientations of planes with most features in them.
MAX_DIRECTIONS = 10
MAX_NORMALS = 24

# -- symmetry --------------------------------------------------------------------------------------------------------

# In model sizes: what data of the usual accuracy cannot tell apart; what is as near to a face of the hull lies on it.
SYMMETRY_TOLERANCE = 0.004
# Cosines, components of unit normals, and shifts and offsets as parts of the model's size: what differs by less than
# this is the same; poses are, when they move no end of the model by more.
SAME = 0.01
# Poses that searches tell apart move an end of the model, half its size from the middle, by more than this part of its
# size: nearer ones are drawn to one place.
SAME_POSE = 0.06
# As a part of the model's size: shorter distances are rounding.
EXACT = 1e-6

# -- convex hull -----------------------------------------------------------------------------------------------------

# Points that stand for a curve.
CURVE_POINTS = 16

# Features of the largest model: its table of pairs grows with their square, and takes a second and 200 MB for so many.
# The largest of the thesis, the plug, has 54.
LARGEST_MODEL = 2000
