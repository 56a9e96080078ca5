"""Numbers of calibration files and messages: meaning and source."""

from __future__ import annotations

from msgs_py.settings import LENS_COEFFICIENTS

# Models of distortion, as sensor_msgs/CameraInfo names them, and how many coefficients each usually has.
DISTORTION_MODELS = {'': LENS_COEFFICIENTS['plumb_bob'], **LENS_COEFFICIENTS}
# Numbers of coefficients that OpenCV takes (calib3d: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]]).
COEFFICIENTS = (0, 4, 5, 8, 12, 14)
# By how much the stretches of a rotation in a file may differ from 1: three digits and more are a rotation, rounded.
ROUNDED_ROTATION = 2e-3

# -- pairs of a rig's cameras ------------------------------------------------------------------------------------------

# Sine between the baseline and where a pair looks, below which one camera is in the other's picture.
LEAST_SIDEWAYS = 0.35
# Tangent of the angle from straight ahead up to which a turned picture is kept.
MOST_OBLIQUE = 1.8
# The nearest things of interest, in baselines of the widest pair (the thesis' rig: 5), for which overlap is counted.
BASELINES_AWAY = 5.0
# In so many depths, and on a grid of so many columns and rows.
OVERLAP_DEPTHS, OVERLAP_GRID = 4, 12
# Points of each side of a picture's border that are looked at for where it lies when turned.
BORDER_SAMPLES = 33

# -- photon transfer ---------------------------------------------------------------------------------------------------

# Bins of grey levels of the photon transfer curve, and the fewest pixels that say what the noise of one is: its
# standard deviation to 1 in 20.
LEVEL_BINS, FEWEST_PAIRS = 64, 200
# px: smoothing before the level and the slope of a place are read off.
CALM_SIGMA = 2.0
# Differences beyond this many sigmas are no noise: one in two million is, of normal ones. Rounds of leaving them out,
# and of weighing bins; bins beyond TRANSFER_HUBER standard errors count less. A level that many sigmas from black or
# white is not clipped.
OUTLIER_SIGMAS, REWEIGHTED, TRANSFER_HUBER = 5.0, 4, 2.5
