"""Thresholds of hidden-line removal.

Parameters of curves are fractions of a segment's length, and radians on a conic. Rays are traced in the normalised
frame of a SurfaceTable, in which the diagonal of the solid's bounding box is 1.
"""

from __future__ import annotations

# Shortest piece of a curve, as a fraction of a segment or in radians; parameters closer than this are one.
SHORTEST_PIECE = 1e-9
# Crossings this far past an end still count, as a fraction of a segment or in radians; a needless cut does no harm. A
# contour ends on the rim that it touches, and a point of contact is known to half of the digits only.
PAST_END = 1e-6
# Determinant of a conic's first three rows, relative to the cube of their norm, of a conic that is seen edge-on.
EDGE_ON = 1e-12
# Material thinner than this along the ray, in model sizes, does not hide: the ray to a point of a contour is tangent
# there, and rounding makes that a sliver of about the square root of the machine's precision.
THIN = 1e-6
# The same for points that are only near a space curve: its samples are joined by parabolas.
THIN_AT_SPACE_CURVE = 1e-4
# A ray to a point ends this part of its length early, so that a terrain at the point itself does not hide it.
BEFORE_TERRAIN = 1e-6
# Points of a piece of a curve at which it is looked whether a terrain hides it: what a terrain hides, or shows, between
# two of them is not noticed. Halvings that then find the end of what is hidden: all digits of a double.
TERRAIN_SAMPLES = 33
TERRAIN_HALVINGS = 45
# Slope of a plane along a ray, relative to the ray's length, of a ray parallel to the plane.
PARALLEL_RAY = 1e-12
# Coefficients of the equation of a ray and a quadric (unit norm) that are zero.
LEVEL_RAY = 1e-14
# Distance, in model sizes, between the end of an axis and the centre or the plane of a rim about it.
RIM_DISTANCE = 1e-6
# Added to the norm of the form of two conics, so that it is no zero divisor; far below any norm.
NO_NORM = 1e-300
# Points along a crease that is no matching feature, where a polyline stands for it.
CREASE_POINTS = 65
# Distance, in model sizes, by which the box of a leaf is taken larger before a ray is said to pass beside it: far more
# than rounding, so that the leaf's own surfaces decide.
BESIDE_BOX = 1e-9
# Component of a ray, in model sizes, that is divided by as if it were this: its inverse is a number still.
NO_DIRECTION = 1e-300
# Knots along a crease or contour between which points are spread evenly in the image: perspective and the curvature of
# an ellipse make spacings between two knots differ by about the square of this in parts.
OUTLINE_KNOTS = 33
# Distance from a curved surface, in model sizes, at which it is looked whether material stands on one side of it only.
OFF_SURFACE = 1e-4
