"""Every threshold of this room: symbol, unit, meaning and source.

sigma is one standard deviation; a share and a cosine have no unit. Where no source is named, the value was set by trial
on the rendered scenes of test/benchmarks/bench_curves.py, and no command that sweeps it was kept.
"""

from __future__ import annotations

import numpy as np

# ---- Several modules -------------------------------------------------------------------------------------------------
# Sigma of a stated bound, and of what the uncertainty of a curve adds to a distance that is allowed from it: three
# sigma.
BOUND_SIGMA = 3.0
# ---- Least squares of one curve (fit, fit_kernels) -------------------------------------------------------------------
# px^2: fitting a quadratic to 3 x 3 pixels moves a ridge of curvature c by c/2 times the mean square of the offsets
# beside its normal. That is 2/3 where the normal runs along the pixels, and less by the second share where diagonally.
FACET_VARIANCE = 2.0 / 3.0
DIAGONAL_FACET_SHARE = 0.75
# Pixels: most that smoothing and the quadratic may be taken to move an edgel towards the centre of curvature; and the
# variance of that correction over its square (a sigma of a fifth).
MOST_CURVATURE_BIAS = 1.0
CURVATURE_VARIANCE_SHARE = 0.04
# Levenberg-Marquardt: first damping, factor from one to the next, attempts a round; most that a parameter other than
# the centre may change in a step (radians, log radii); relative gain of the cost below which it stops; most rounds.
DAMPING_START = 1e-3
DAMPING_FACTOR = 10.0
DAMPING_ATTEMPTS = 6
LARGEST_STEP = 0.5
LEAST_GAIN = 1e-3
ROUNDS = 12
# Edgels of either image that a recovered curve keeps at least.
LEAST_CURVE_EDGELS = 8
# px^2: squared residuals count at most so much in the rms of a fit.
MOST_SQUARED_RESIDUAL = 4.0

# Edgels do not err independently. Illumination displaces all those in one of SECTORS sectors of a curve alike, by
# COMMON_SIGMA pixels and COMMON_SHARE of an edgel's own sigma; what is alike all round (a wrong guess of the blur, the
# stairs of images without anti-aliasing) has OVERALL_SIGMA pixels and OVERALL_SHARE.
SECTORS = 12
COMMON_SIGMA = 0.02
COMMON_SHARE = 0.5
OVERALL_SIGMA = 0.01
OVERALL_SHARE = 0.2
# Factor on the sigma of the radius: an edge or a second rim a few pixels beside a rim changes it as a whole, which its
# residuals do not show.
RADIUS_SIGMA_FACTOR = 1.25
# Sigma of the log ratio of its radii by which an ellipse has to differ from a circle.
LEAST_ELLIPSE_SIGMA = 4.0

# ---- Inliers: edgels that belong to a curve --------------------------------------------------------------------------
# Pixels from the image conic, and cosine between an edgel's gradient and the conic's normal (20 degrees).
INLIER_DISTANCE = 0.7
ACROSS_COSINE = 0.94
# Edgels that measure the curve are within so many sigma of it, where a limit below LEAST_INLIER_DISTANCE pixels is
# raised to that.
INLIER_SIGMA = 3.5
LEAST_INLIER_DISTANCE = 0.12
# A run of edgels ends where the next is farther away than this, pixels. A corner has displaced the last few of a run;
# a closed run, of more than so many edgels, has no ends.
RUN_GAP = 3.0
CORNER_EDGELS = 2
CLOSED_EDGELS = 8
# The visible arc is found in so many bins of angle; a gap of at most so many bins (20 degrees) does not interrupt it.
ARC_BINS = 72
LONGEST_GAP_BINS = 4

# ---- Where fits start (initialisation) -------------------------------------------------------------------------------
# Plane-induced disparity from matched segments: Cauchy scale of the residuals, pixels, rounds of reweighting, and ridge
# of the two slopes, per sample (px^2).
DISPARITY_SCALE = 0.5
PLANE_ROUNDS = 5
SLOPE_RIDGE = 1e-1

# ---- One curve (fit_kernels, recovery) -------------------------------------------------------------------------------
# Times that a curve is refitted to its inliers, at most.
REFITS = 3
# A circle becomes an ellipse when that lowers the sum of squares by this factor.
ELLIPSE_GAIN = 1.3
# Residuals over their stated sigma from which a circle is tried as an ellipse, and below which a curve is clear.
CIRCLE_MISFIT = 1.3
# Pixels rms: a fit below is good enough; above the second the edgels show no curve.
GOOD_RMS = 0.1
WORST_RMS = 0.25
# Cosine between normals from which two planes are one (5.7 degrees).
SAME_PLANE_COSINE = 0.995
# Share of its arcs' edgels that a clear curve has.
MOST_OF_ARC = 0.6
# Two curves, or an arc and a curve, are the same when they share more than this of their edgels; so does a segment with
# a curve whose edge it shows.
SHARED_EDGELS = 0.5

# Share of an arc's length that is matched, at least, where the other image shows no arc.
MATCHED_SHARE = 0.2

# A curve is determined by its edgels when its coverage is at least this, its normal's sigma below this, radians, and
# the radius' relative sigma below this.
LEAST_COVERAGE = 0.08
DETERMINED_TILT = np.radians(3.0)
DETERMINED_RADIUS_SIGMA = 0.09
# It is reported as a feature when its normal's sigma is below this, radians, and its residuals are at most so many
# times what its edgels state. With a coverage below MOSTLY_SEEN its tilt has to be below ARC_TILT: a crease between two
# tubes may look like a short arc.
REPORTED_TILT = np.radians(2.0)
ARC_TILT = np.radians(1.0)
REPORTED_MISFIT = 2.0
MOSTLY_SEEN = 0.7

# ---- Fits with an axis constraint (axis_constraint) ------------------------------------------------------------------
# A curve whose normal's sigma is below this, radians, gives others its axis.
AXIS_TILT = np.radians(1.0)
# Sigma by which axes of one turned part differ: radians, and radii.
COAXIALITY_SIGMA = 5e-4
# Chi squared (four degrees of freedom) above which a curve does not lie on an axis, and misfit above which it does not
# fit.
AXIS_CHI2 = 20.0
CONSTRAINED_MISFIT = 3.0
# Sigma, radians, by which parallel normals differ, and chi squared (two degrees of freedom) above which two are not.
PARALLELISM_SIGMA = np.radians(0.2)
PARALLELISM_CHI2 = 9.0

# ---- Occluding contours ----------------------------------------------------------------------------------------------
# A point through which the tangents of a conic have a discriminant b^2 - a c below this share of b^2 lies on the conic
# or inside it, up to rounding.
LEAST_TANGENT_SHARE = 1e-12
# A segment shows a contour when its ends are this near to the contour's line, pixels, beside what is uncertain about
# both, and the point where the line touches the rim is this near to the segment's end, in rim radii.
CONTOUR_DISTANCE = 1.0
CONTOUR_GAP = 8.0
# The same gap where segments of both images agree, so that nothing is concluded from one alone.
CONTOUR_GAP_BOTH = 12.0
# A segment this near, pixels and radii, is one beyond doubt in its image; the other image's, which may be matched
# wrongly, then has to be only so near, pixels.
SURE_CONTOUR_DISTANCE = 0.5
SURE_CONTOUR_GAP = 0.5
LOOSE_CONTOUR_DISTANCE = 4.0
# Pixels: most that the uncertain line of a segment, and the uncertain axis of a rim (three sigma), add to the distance.
MOST_LINE_SIGMA = 1.0
MOST_TURN = 1.5
# A contour touches the rim at its end: the touching point lies at most this share of the segment's length inside it.
MOST_INSIDE_SHARE = 0.25
# Pixels by which a contour may pass the apex of its cone.
PAST_APEX = 3.0
# Pixels, sigma: what illumination and shading move a contour by.
CONTOUR_SIGMA = 0.3

# ---- Axes of cylinders and cones -------------------------------------------------------------------------------------
# Two curves are coaxial when their normals agree within this, radians, and the centre of one is off the other's axis by
# less than this, in radii.
COAXIAL_TILT = np.radians(2.0)
OFF_AXIS = 0.06
# Coaxial curves nearer than this, in radii, bound one end of a solid.
SAME_END = 0.08
# Two rims whose radii differ by less than this share bound a cylinder.
CYLINDER_TAPER = 0.03
# Radians^2: least variance of a rim's tilts, and cosine between a contour's plane and the rim's below which the contour
# says nothing of the axis; both keep a division defined.
LEAST_TILT_VARIANCE = 1e-12
LEAST_CONTOUR_COSINE = 1e-3
# Radii: how far along the normal the second point lies whose image gives the direction of the axis.
AXIS_STEP = 0.01
# Factor of the variances of an axis' ends: sigma and a fifth more, for what moves a rim as a whole.
AXIS_VARIANCE_FACTOR = 1.44
# Length of the axis of a cylinder or cone, in radii: least, and of a cone most.
LEAST_AXIS = 0.2
LONGEST_CONE = 20.0
# Three sigma of a cylinder's far end, as a share of the axis' length: beside the rim's, and where just one side's
# contour shows the end.
AXIS_LENGTH_ERROR = 0.03
ONE_SIDED_ERROR = 0.5
# Contours of a cone: distance from touching the rim's image, pixels, and most with its uncertainty; distance of the
# contour's end from the rim, in its image radii; least length, pixels.
TANGENT_DISTANCE = 1.2
MOST_TANGENT_DISTANCE = 2.5
TANGENT_GAP = 3.0
LEAST_TANGENT_LENGTH = 5.0
# They meet within this share of the base's radius, on its axis within this one.
APEX_MISS = 0.05
APEX_OFF_AXIS = 0.1
# Sigma, in radii, of an apex off its rim's axis, beside the axis' own uncertainty.
APEX_AXIS_SIGMA = 0.01
# Contours of a cone's two sides are enough where they end this near to the apex, as a share of their lengths.
APEX_GAP = 0.1

# ---- Curves that were found twice ------------------------------------------------------------------------------------
# Two curves whose centres and radii differ by less than this, in radii, in one plane are one.
SAME_RIM = 0.04

# ---- Spheres ---------------------------------------------------------------------------------------------------------
# The contour of a sphere looks like a circle that faces the cameras: cosine between normal and line of sight, for a
# curve seen in part and for one that is mostly seen; the first is its least ratio of radii as well.
FACING_COSINE = 0.75
WHOLE_FACING_COSINE = 0.98
# A sphere replaces a curve whose sum of squares, truncated at so many sigma, is not this much smaller.
SPHERE_COST_FACTOR = 1.5
SPHERE_TRUNCATION = 4.0
# Fit of a sphere: scale of the loss, sigma; step of the difference quotients, in radii; least distance, in its radii.
SPHERE_LOSS_SCALE = 2.0
DIFFERENCE_STEP = 1e-5
LEAST_SPHERE_DISTANCE = 1.5
# Metres: least depth of a sphere's centre while its fit goes on.
LEAST_SPHERE_DEPTH = 1e-6
# A curve is part of a sphere's contours when more than this share of its edgels lies on them.
SPHERE_SHARE = 0.6

# ---- Normal orientation ----------------------------------------------------------------------------------------------
# A curve is seen in part when its arc is shorter than this, radians.
PARTIAL_ARC = 1.25 * np.pi
# An edge lies behind a rim when its line passes the centre at more than BEHIND_OFFSET radii, on the side away from the
# camera (cosine above BEHIND_COSINE); another rim does when its far side is beyond BEHIND_RING radii.
BEHIND_OFFSET = 0.5
BEHIND_COSINE = 0.2
BEHIND_RING = 1.05
# Radii: distance from the plane of the rim that an edge in it may have beside three sigma, and most with them.
COPLANAR = 0.02
MOST_COPLANAR = 0.25
