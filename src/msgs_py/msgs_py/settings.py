"""Named numbers of the plain types: how much rounding a value from outside may carry, and what a stated error is."""

from __future__ import annotations

# Relative difference of two intrinsics that a rectified pair must share: calibration files carry about so many digits.
RECTIFIED_TOLERANCE = 1e-6
# Largest element of R R^T - I of a rotation matrix that is accepted; a larger one is no rounding error.
ORTHONORMAL_TOLERANCE = 1e-6
# Shortest norm of a quaternion that still has a direction; shorter ones are message fields that were never set.
SHORTEST_QUATERNION = 1e-12
# How many sigma err_par and err_per of a feature are.
BOUND_SIGMA = 3.0
