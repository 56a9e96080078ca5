"""Thresholds of the features of meshes, of ideal data, and of drawings.

Those of meshes were chosen with facetted primitives of 8 to 200 facets a turn and files of CAD programs; no command is
kept. They are relative to the mesh's size (diagonal of its bounding box) where no unit is given.
"""

from __future__ import annotations

import numpy as np

# -- creases of a mesh -----------------------------------------------------------------------------------------------

# Decimals of the unit normals of two planes that are one.
NORMAL_DECIMALS = 4

# -- curves of a mesh ------------------------------------------------------------------------------------------------

# A straight side that goes on smoothly into arcs is longer than so many of their median segments.
LONG_SEGMENT = 3.0
# Largest distance of a point from the curve fitted to it, as a part of the curve's major radius; and of a flat curve's
# points from its plane, as a part of its second spread, with rounding as a part of the first.
FIT = 2e-3
FLAT_ROUNDING = 1e-6
# Fewest points of a facetted curve, and of an ellipse, which has five unknowns.
FEWEST_POINTS = 4
FEWEST_ELLIPSE_POINTS = 6
# Shortest arc, and the longest with its rounding, radians.
SHORTEST_SWEEP = np.radians(20.0)
LONGEST_SWEEP = 2.0 * np.pi + 1e-6
# Singular value, relative to the largest, at which more than one conic fits the points.
AMBIGUOUS_CONIC = 1e-9
# Cosine of the angle between a face's normals, or its normal and a curve's, that are one: the face is planar.
FLAT_FACE = 0.99

# -- axes of a mesh --------------------------------------------------------------------------------------------------

# Largest spread of a patch's normals about a cylinder's or of its planes about a cone's apex, and of the direction of
# two rims about one axis.
PATCH = 0.02
# Largest distance between the centres of rims on one axis, and between an apex and a vertex.
SAME_AXIS = 1e-3

# -- drawings --------------------------------------------------------------------------------------------------------

# A ray to a crease of a mesh ends this part of its length early, so that the crease's own triangles do not hide it.
BEFORE_CREASE = 1e-4
# Distance of the viewpoint from the model's middle, and how much nearer the model's nearest point is, in model sizes.
VIEW_DISTANCE = 6.0
VIEW_NEARER = 0.5
# Part of the picture that the model fills.
VIEW_FILL = 0.9
# Cosine of the angle between the line of sight and z beyond which y points upwards in the picture.
VIEW_UPRIGHT = 0.99

# -- ideal data ------------------------------------------------------------------------------------------------------

# Length below which a vector is not made a unit vector, metres or 1.
LEAST_LENGTH = 1e-12

# -- meshes of others -------------------------------------------------------------------------------------------------

# Creases of the largest mesh: a part with fifty bores of sixty facets a rim has some 6,000. Of 8,000 that run across
# each other the chains take three seconds, and of more the square of that.
MOST_CREASES = 8000

# Cosine of two axes, and difference of two radii as a part of the largest size, below which a primitive is neither
# sheared nor squeezed: the rounding of transforms.
SAME_SHAPE = 1e-9

# -- outlines of meshes ------------------------------------------------------------------------------------------------

# Steps of regula falsi to where a surface turns away from the eye along an edge of a facet; each gives half as many
# digits again.
CROSSING_TURNS = 6
# Distance from a mesh, in its size, from which a point of it is seen: more than its vertices are welded over.
CLEARANCE = 1e-5
# How far above a facet a contour on it is looked at, in bulges of the surface: a facet of length h that turns by an
# angle a bulges by h a / 8, and its end is h a / 2 above a ray that meets its middle at half that angle.
CLEAR_OF_FACET = 4.0
# How much of a ray, from its end, is not asked what hides a point there, in clearances: where parts only touch, a face
# is in the corner between them.
BEFORE_POINT = 10.0
# Pieces at least in which the image of a curve is measured, so that points are spread evenly in perspective.
WIRE_PIECES = 16
# Sine of the angle between a contour and the line of sight below which the contour is seen end on.
END_ON = 1e-3
