"""Numbers of calibration files and messages: meaning and source."""

from __future__ import annotations

# Models of distortion, as sensor_msgs/CameraInfo names them, and how many coefficients each usually has.
DISTORTION_MODELS = {'': 5, 'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}
# Numbers of coefficients that OpenCV takes (calib3d: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]]).
COEFFICIENTS = (0, 4, 5, 8, 12, 14)
# Least |det R| of a matrix that is taken for a rotation, for which it is 1; rounding in a file changes it by far less.
LEAST_DETERMINANT = 0.5
# Skew of a raw camera as a share of its focal length, above which it is more than rounding: OpenCV has none.
LEAST_SKEW = 1e-6
# By how much the stretches of a rotation in a file may differ from 1: three digits and more are a rotation, rounded.
ROUNDED_ROTATION = 2e-3
# Numbers in a projection matrix, 3 x 4.
PROJECTION_NUMBERS = 12

# -- pairs of a rig's cameras ------------------------------------------------------------------------------------------

# Sine between the baseline and where a pair looks, below which one camera is in the other's picture.
LEAST_SIDEWAYS = 0.35
# Tangent of the angle from straight ahead up to which a turned picture is kept; and the least depth, as a share of the
# ray, at which a pixel counts as before the camera, as its inverse.
MOST_OBLIQUE, WIDEST_PICTURE = 1.8, 100.0
# Points of each side of a picture's border that are looked at for where it lies when turned; and rigs whose pairs are
# kept for the next set of images.
BORDER_SAMPLES, KEPT_RIGS = 33, 4
# Rows that a pair has to have in common, pixels.
FEWEST_ROWS = 32
# The nearest things of interest, in baselines of the widest pair (the thesis' rig: 5), for which overlap is counted, in
# so many depths, on a grid of so many columns and rows.
BASELINES_AWAY, OVERLAP_DEPTHS, OVERLAP_GRID = 5.0, 4, 12

# -- photon transfer ---------------------------------------------------------------------------------------------------

# Bins of grey levels of the photon transfer curve, and the fewest pixels that say what the noise of one is: its
# standard deviation to 1 in 20.
LEVEL_BINS, FEWEST_PAIRS = 64, 200
# px: smoothing before the level and the slope of a place are read off.
CALM_SIGMA = 2.0
# Differences beyond this many sigmas are no noise: one in two million is, of normal ones. Rounds of leaving them out,
# and of weighing bins; bins beyond TRANSFER_HUBER standard errors count less.
OUTLIER_SIGMAS, REWEIGHTED, TRANSFER_HUBER = 5.0, 4, 2.5
# A level this many sigmas from black or white is not clipped.
CLIPPED_SIGMAS = 4.0
