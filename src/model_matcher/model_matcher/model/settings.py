"""Numbers of what is known of a model before any search: its tables, its regularity, its symmetry, its hull."""

from __future__ import annotations

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
PERPENDICULAR_COSINE = 0.12
# The most frequent directions, which span the planes, and the orientations of planes with most features in them.
MAX_DIRECTIONS = 10
MAX_NORMALS = 24

# -- symmetry --------------------------------------------------------------------------------------------------------

# In model sizes: what data of the usual accuracy cannot tell apart.
SYMMETRY_TOLERANCE = 0.004
# Features by which most motions that are no symmetry are ruled out.
SYMMETRY_LOOKS = 6
# Cosines, components of unit normals, and shifts and offsets as parts of the model's size: what differs by less than
# this is the same.
SAME = 0.01
# Degrees: poses are the same when they turn a model by less than this, and shift its middle by less than SAME.
SAME_POSE_DEG = 1.0
# As a part of the model's size: shorter distances are rounding.
EXACT = 1e-6

# Poses whose turns from the camera's frame have traces that differ by less than this are turned equally far.
SAME_TRACE = 1e-9

# -- convex hull -----------------------------------------------------------------------------------------------------

# Corners and edges lie on a face of the hull when they are this near to it, as a part of the model's size.
ON_FACE = 0.005
# Points that stand for a curve.
CURVE_POINTS = 16

# Features of the largest model: its table of pairs grows with their square, and takes a second and 200 MB for so many.
# The largest of the thesis, the plug, has 54.
LARGEST_MODEL = 2000
