"""Named numbers of the plain types: how much rounding a value from outside may carry, and what a stated error is."""

from __future__ import annotations

from .numeric.settings import BOUND_SIGMA as BOUND_SIGMA

# Relative difference of two intrinsics that a rectified pair must share: calibration files carry about so many digits.
RECTIFIED_TOLERANCE = 1e-6
# Largest element of R R^T - I of a rotation matrix that is accepted; a larger one is no rounding error.
ORTHONORMAL_TOLERANCE = 1e-6
# Models of distortion and how many coefficients each has (sensor_msgs/distortion_models, OpenCV's order).
LENS_COEFFICIENTS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}
# Radius of the image plane beyond which no ray is followed, tan 89 degrees: one at 90 has no place in it.
WIDEST_RAY = 57.29
# Radii in the table from which Newton's method starts to invert a lens, and its steps: three reach rounding, the rest
# is for places next to a fold.
LENS_TABLE, LENS_STEPS = 2048, 6
# What is left of the inverse's error when it has arrived: rounding, far below a millionth of a pixel.
LENS_ROUNDING = 1e-9
# Shortest norm of a quaternion that still has a direction; shorter ones are message fields that were never set.
SHORTEST_QUATERNION = 1e-12

# -- files of others --------------------------------------------------------------------------------------------------

# Bytes of the largest file that is read, packed or not: models and features have thousands, a mesh of a million
# triangles 50 million. Anybody whose file is opened could fill the memory otherwise.
LARGEST_FILE = 2**28
# The same of texts: calibrations, scenes, programs, saved cases. The largest of ours has 60,000.
LARGEST_TEXT = 2**24
# Pixels of the largest picture that is unpacked: more than the largest machine-vision sensors have (65 million).
LARGEST_IMAGE = 2**26
