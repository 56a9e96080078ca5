"""Thresholds of boundary evaluation.

Lengths are fractions of the model's size: all geometry is computed in a frame in which the diagonal of the solid's
bounding box is 1. Points are then computed to about 1e-15, and a root of a quadratic where two surfaces touch to about
1e-8 (half of the digits). Values for which nothing else is said were chosen between these two numbers and the size of
details of models; test/test_random_solids.py compares the results with a grid of points.
"""

from __future__ import annotations

import numpy as np

# -- when two things are one -----------------------------------------------------------------------------------------

# Largest distance between the coefficients of two surfaces that are the same surface.
SAME_SURFACE = 1e-9
# Largest distance from a surface of a computed point that lies on it.
ON_SURFACE = 1e-8
# Largest distance between ends of boundary curves that are one vertex. Ends are intersections of curves.
SAME_VERTEX = 1e-7
# Largest change of an angle, radians, or a height over the unit frame for one end of a face.
SAME_HEIGHT = 1e-6
# Shortest axis of a cylinder or cone, and the largest gap or overlap of rulings that touch, unit frame.
SHORTEST_AXIS = 1e-7
# Largest distance from a plane or quadric at which a cut is kept. A needless cut only makes two pieces that are joined
# again, a missing one would join what is apart.
CUT_MARGIN = 1e-6
# Shortest piece of a conic, radians: nearer cuts are one (a tangent surface gives two roots about 1e-8 apart).
SHORTEST_ARC = 1e-6
# A curve is closed when its range of angles is larger than this, radians.
WHOLE_TURN = 2.0 * np.pi - 1e-6

# -- directions ------------------------------------------------------------------------------------------------------

# Sine of the angle below which two planes, or a line and a plane, are parallel.
PARALLEL = 1e-9
# Angle, radians, between branches of the boundary that have one direction, or are opposite: a smooth join.
SAME_ANGLE = 1e-6
# Largest angle, radians, between the ways in which two curves leave a vertex that have one direction.
SAME_TURN = 1e-9
# 1 - |cosine| of the angle between a face's normal and the normal of a curve's plane that are one.
SAME_NORMAL = 1e-6
# Difference between curvatures (1 over the model's size) that are equal.
SAME_CURVATURE = 1e-4
# A gradient, which has length 1 or is set to 0 where a surface has none, is the latter below this length.
NO_GRADIENT = 0.5
# A direction to which no sensible model is perpendicular. It gives unsigned planes and lines one sign, without the ties
# that the rule "first non-zero component" has.
GENERIC_DIRECTION = np.array([0.5373, 0.6891, 0.4863])
# Where the samples round an axis start, radians: not where a model has its planes of symmetry.
GENERIC_PHASE = 0.1234
# The same for the samples along a space curve: at 0 and pi its two roots meet.
GENERIC_START = 0.01234
# Where in a piece of a curve its neighbourhood is classified, fraction of the piece: not in the middle, where symmetric
# solids touch a curve without cutting it.
INSIDE = 0.4639
# Angles, radians, of two planes through the poles of a sphere's chart; each meridian crosses one of them at least.
POLAR_PLANES = (0.777, 1.999)
# Turn, radians, of the weights of a pencil of quadrics, which makes both of its matrices regular in general.
PENCIL_TURN = 0.6435

# -- roots -----------------------------------------------------------------------------------------------------------

# Distance in the unit frame at which a plane is taken to touch a cylinder or sphere, or to pass through an apex.
TOUCHING = 1e-10
# Coefficient of a polynomial, relative to its largest term, that is zero.
VANISHING = 1e-10
# Coefficient of the square in the equation of a line and a quadric (unit norm) that is zero: the line is a ruling's.
RULED = 1e-12
# Discriminant of that equation that is zero by rounding alone.
DISCRIMINANT_ROUNDING = 1e-15
# A cosine may be larger than 1 by this much through rounding.
COSINE_MARGIN = 1e-9
# Largest distance from the unit circle of an eigenvalue that stands for a real angle. A double root has half the digits
# of a double number, and an eigenvalue of a companion matrix fewer; Newton's steps and the residual decide afterwards.
UNIT_CIRCLE = 1e-4
# Newton's steps after the eigenvalues: how many, their largest length (radians) and the least slope for one.
NEWTON_STEPS = 2
LONGEST_STEP = 0.01
LEAST_SLOPE = 1e-6
# Largest value of a trigonometric form, relative to its size, at an angle that is its root.
ROOT_RESIDUAL = 1e-8
# Homogeneous coordinate, relative to the point's others, of a point at infinity, and of the other nappe of a cone.
AT_INFINITY = 1e-12
REAL_NAPPE = 1e-9
# Coordinates beyond this are at infinity, in model sizes.
FARTHEST = 1e3
# Entry in the last row of a conic's matrix that is zero: the conic is an ellipse.
ELLIPSE_ROW = 1e-14

# -- pencils of quadrics (matrices of unit norm) ----------------------------------------------------------------------

# Singular value of a direction or apex that two quadrics share.
SHARED_DIRECTION = 1e-9
# Largest eigenvalue of a member of the pencil that vanishes altogether.
NO_MEMBER = 1e-12
# A member is a pair of planes when its third eigenvalue is below this part of the first; the two planes are one when
# the second is.
RANK_TWO = 1e-8
# Length of a plane's normal, relative to the plane's vector, of the plane at infinity.
PLANE_AT_INFINITY = 1e-9
# A multiple zero of the determinant is scattered by rounding: zeros within these distances are averaged, each in turn.
SCATTER = (1e-2, 1e-4, 0.0)
# Imaginary part of a scattered zero that may be real, and of a simple one.
SCATTERED_IMAGINARY = 1e-2
SIMPLE_IMAGINARY = 1e-9

# -- space curves ----------------------------------------------------------------------------------------------------

# Samples of a whole space curve. Crossings with other quadrics are looked for between neighbours.
CURVE_SAMPLES = 256
# Steps of false position (Illinois), which place a crossing to all digits.
FALSE_POSITION_STEPS = 12
# Step of the numerical derivative along a space curve, radians: the third root of the machine's precision.
DERIVATIVE_STEP = 1e-5
# Branch points of a space curve nearer than this, radians, are one.
SAME_BRANCH_POINT = 1e-7
# Length of the vector product of two gradients at a point where the quadrics touch.
TANGENT_QUADRICS = 1e-12

# -- slopes ----------------------------------------------------------------------------------------------------------

# Least slope by which a quadric's value is divided to give a distance; at an apex or centre only the sign is needed.
LEAST_QUADRIC_SLOPE = 1e-6
# Slope of a quadric at a point where it has no gradient: the apex of a cone.
APEX_SLOPE = 1e-9
# Slope of a quadric across a curve below which a curvature is not divided by it.
GRAZING_SLOPE = 1e-12
# Square of the distance from the axis, unit frame, below which a point has no angle.
ON_AXIS = 1e-20

# -- faces -----------------------------------------------------------------------------------------------------------

# Nodes of Gauss-Legendre quadrature, and the longest range for which they are exact to rounding, radians.
QUADRATURE_NODES = 16
QUADRATURE_RANGE = 0.8
# What the differentials of a curve may miss of the way between its ends, in sizes of the solid, and the shortest range
# that is halved for it: beyond, a curve comes from infinity.
QUADRATURE_ERROR = 1e-8
SHORTEST_RANGE = 1e-6
# Distance from a vertex at which curves that touch there are told apart, as a part of the nearest node's.
CORNER_REACH = 0.1
# How far beside its border a curved face is looked for, unit frame.
BESIDE_BORDER = 1e-4
# Lines of constant angle that link the parts of a curved face, besides those at its borders; the same for the parts of
# a surface about an axis.
MERIDIANS = 24
RULINGS = 16
# Orientations tried for a sphere's poles, which must lie on no border.
POLE_TRIALS = 24
# Distance of a latitude from a pole, radians, at which a face includes the pole.
AT_POLE = 1e-9
# Area of a face without a border below which it is a sliver beside a vertex.
SLIVER_AREA = 1e-9

# -- measures --------------------------------------------------------------------------------------------------------

# Relative difference of the half-axes of a circle.
CIRCULAR = 1e-9
# Points along a curve for its bounding box.
BOX_POINTS = 65
# Margin of the end of a range of angles, radians.
ANGLE_ROUNDING = 1e-12
# Points of the bounding box that check the volume, and the standard errors and rounding by which the two may differ.
VOLUME_SAMPLES = 50_000
VOLUME_SIGMAS = 6.0
VOLUME_ROUNDING = 1e-9
# Directions, and their length, in which an unbounded solid is looked for far away.
FAR_DIRECTIONS = 500
FAR_DISTANCE = 1e4
# Points round an apex, and their distance, that say whether it is left on the solid.
APEX_POINTS = 200
APEX_DISTANCE = 1e-5

# -- divisors --------------------------------------------------------------------------------------------------------

# Least divisors in place of a zero length: of an arc that ends where it begins, and of a vector without direction. Far
# below any length, so that only what is zero changes.
NO_LENGTH = 1e-300
NO_DIRECTION = 1e-30
# Weights of the first three diagonal elements of a dual conic whose sum decides its sign: unequal, so that they do not
# cancel for circles and axis-parallel ellipses.
SIGN_WEIGHTS = (0.3, 0.7, 0.5)

# -- memory ----------------------------------------------------------------------------------------------------------

# Largest number of array elements computed at once: values of lines at leaves, and signs of sectors.
LINE_CHUNK = 20_000_000
SECTOR_CHUNK = 4_000_000
