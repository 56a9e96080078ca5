"""Every number of this room: symbol, unit, meaning and source.

sigma is one standard deviation; a share and a cosine have no unit. [D] is derived as stated, [R] was chosen on rendered
scenes with test/benchmarks/bench_curves.py. What is decided :mod:`.agreement` decides by chi squared at three sigma of
stated covariances; what is here states sigmas, scales and limits of searches.
"""

from __future__ import annotations

import numpy as np

# ---- Least squares of one curve (fit, fit_kernels) -------------------------------------------------------------------
# px^2 [D]: fitting a quadratic to 3 x 3 pixels moves a ridge of curvature c by c/2 times the mean square of the offsets
# beside its normal. That is 2/3 where the normal runs along the pixels, and less by the second share where diagonally.
FACET_VARIANCE = 2.0 / 3.0
DIAGONAL_FACET_SHARE = 0.75
# Levenberg-Marquardt: first damping, factor from one to the next; relative gain of the cost below which it stops; most
# rounds.
DAMPING_START = 1e-3
DAMPING_FACTOR = 10.0
LEAST_GAIN = 1e-3
ROUNDS = 12
# Edgels do not err independently: illumination displaces all those in one of SECTORS sectors of a curve alike, as much
# as each errs by itself; what is alike all round (a wrong guess of the blur, the stairs of images without
# anti-aliasing) is so much of that [R].
SECTORS = 12
OVERALL_SHARE = 0.5

# ---- Inliers: edgels that belong to a curve --------------------------------------------------------------------------
# Edgels of either image that a curve has at least [D]: as many as an ellipse in space has parameters.
LEAST_CURVE_EDGELS = 8
# Pixels from the image conic, and cosine between an edgel's gradient and the conic's normal (20 degrees).
INLIER_DISTANCE = 0.7
ACROSS_COSINE = 0.94
# The distance in sigmas of an edgel, where that is more: in noise. [P] With three, texture beside a curve counts as its
# own.
INLIER_SIGMAS = 2.0
# A run of edgels ends where the next is farther away than this, pixels. A corner has displaced the last few of a run.
RUN_GAP = 3.0
CORNER_EDGELS = 2
# Points of a visible arc that tell whether an image shows it as a line.
ARC_SAMPLES = 17
# Radians: a gap between edgels as wide does not interrupt the visible arc.
LONGEST_GAP = np.radians(20.0)

# ---- Where fits start (initialisation, start_kernels) ----------------------------------------------------------------
# Plane-induced disparity from matched segments: Cauchy scale of the residuals, pixels, and ridge of the two slopes, per
# sample (px^2).
DISPARITY_SCALE = 0.5
SLOPE_RIDGE = 1e-1
# Cosine between normals from which two planes are one (5.7 degrees).
SAME_PLANE_COSINE = 0.995
# Circles on the axis of a known one: they are looked for within so many of its radii, and so many places are tried.
COAXIAL_REACH = 4.0
MOST_STARTS = 8

# ---- One curve (fit_kernels, recovery) -------------------------------------------------------------------------------
# Times that a curve is refitted to its inliers, at most.
REFITS = 3
# Residuals over their stated sigma above which edgels show no curve.
MOST_MISFIT = 2.0
# Two curves, or an arc and a curve, are the same when they share more than this of their edgels; so are a segment and a
# curve whose edge it shows, and a curve and the contours of a sphere. Of its visible arc a curve has so much as well.
SHARED_EDGELS = 0.6
# Share of an arc's length that is matched, at least, where the other image shows no arc.
MATCHED_SHARE = 0.2
# Sigma of the normal, radians, and of the radius, over it: a curve with less than the first is a feature and explains
# its edgels, one with less than the second gives its surface an axis and contours.
DETERMINED_SIGMA = 0.04
SURFACE_SIGMA = 0.025
# Curves that were found twice: those whose centres and radii differ by less than this, in radii, and their normals,
# radians.
SAME_RIM = 0.04

# ---- Faces -----------------------------------------------------------------------------------------------------------
# Share of curves that lie in a plane with another one, or with two edges, that are found. Edges that are looked at, the
# nearest ones; bounds the time.
PLANE_PRIOR = 0.5
MOST_FACE_EDGES = 16

# ---- Axes and occluding contours -------------------------------------------------------------------------------------
# Sigma by which parts of one thing are turned or set up: radians between their axes, and radii off them [R].
TURNED_SIGMA = 5e-4
# A point through which the tangents of a conic have a discriminant b^2 - a c below this share of b^2 lies on the conic
# or inside it, up to rounding.
LEAST_TANGENT_SHARE = 1e-12
# Pixels, sigma: what illumination and shading move a contour by.
CONTOUR_SIGMA = 0.2
# A contour begins where it touches the rim: so far away at most, in the rim's image radii, and the touching point lies
# at most this share of the segment's length inside it.
CONTOUR_GAP = 8.0
MOST_INSIDE_SHARE = 0.25
# Coaxial curves nearer than this, in radii, bound one end of a solid.
SAME_END = 0.08
# Length of the axis of a cylinder or cone at least, in radii.
LEAST_AXIS = 0.2

# ---- Spheres ---------------------------------------------------------------------------------------------------------
# The contour of a sphere looks like a circle that faces the cameras: cosine between normal and line of sight. Short
# arcs of any circle fit the contours of some sphere.
FACING_COSINE = 0.75

# ---- Normal orientation ----------------------------------------------------------------------------------------------
# A curve is seen in part when its arc is shorter than this, radians.
PARTIAL_ARC = 1.25 * np.pi
# An edge lies behind a rim when its line passes the centre at more than so many radii, away from the camera.
BEHIND = 0.5
