"""Numbers of calibration files and messages: meaning and source."""

from __future__ import annotations

# Models of distortion, as sensor_msgs/CameraInfo names them, and how many coefficients each usually has.
DISTORTION_MODELS = {'': 5, 'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}
# Numbers of coefficients that OpenCV takes (calib3d: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]]).
COEFFICIENTS = (0, 4, 5, 8, 12, 14)
# Least |det R| of a matrix that is taken for a rotation, for which it is 1; rounding in a file changes it by far less.
LEAST_DETERMINANT = 0.5
# Numbers in a projection matrix, 3 x 4.
PROJECTION_NUMBERS = 12
