"""A rigid motion, a row of twelve numbers (see features.py), applied to points and directions.

Points and directions are three numbers each and come back as a tuple, so that compiled loops allocate nothing. Where a
loop applies one motion many times, :func:`unpacked` reads it once.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray

# A row of twelve, or its numbers.
Motion: TypeAlias = FloatArray | tuple[float, ...]


@njit
def unpacked(motion: FloatArray) -> tuple[float, ...]:
    """The twelve numbers of a motion as a tuple; it can stand for the motion in the functions below.

    Parameters
    ----------
    motion : (12,) float64

    Returns
    -------
    tuple of 12 float

    """
    return (
        motion[0],
        motion[1],
        motion[2],
        motion[3],
        motion[4],
        motion[5],
        motion[6],
        motion[7],
        motion[8],
        motion[9],
        motion[10],
        motion[11],
    )


@njit
def rotate(motion: Motion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction of the model frame in the camera frame.

    Parameters
    ----------
    motion : (12,) float64 or tuple
    x, y, z : float
        The direction, model frame.

    Returns
    -------
    tuple of 3 float
        The direction, camera frame.

    Examples
    --------
    >>> quarter_turn = np.array([0.0, -1, 0, 1, 0, 0, 0, 0, 1, 5, 6, 7])
    >>> rotate(quarter_turn, 1.0, 0.0, 0.0)
    (0.0, 1.0, 0.0)

    """
    return (
        motion[0] * x + motion[1] * y + motion[2] * z,
        motion[3] * x + motion[4] * y + motion[5] * z,
        motion[6] * x + motion[7] * y + motion[8] * z,
    )


@njit
def transform(motion: Motion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of the model frame in the camera frame.

    Parameters
    ----------
    motion : (12,) float64 or tuple
    x, y, z : float
        The point, model frame, metres.

    Returns
    -------
    tuple of 3 float
        The point, camera frame, metres.

    """
    return (
        motion[0] * x + motion[1] * y + motion[2] * z + motion[9],
        motion[3] * x + motion[4] * y + motion[5] * z + motion[10],
        motion[6] * x + motion[7] * y + motion[8] * z + motion[11],
    )


@njit
def inverse_rotate(motion: Motion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction of the camera frame in the model frame.

    Parameters
    ----------
    motion : (12,) float64 or tuple
    x, y, z : float
        The direction, camera frame.

    Returns
    -------
    tuple of 3 float
        The direction, model frame.

    """
    return (
        motion[0] * x + motion[3] * y + motion[6] * z,
        motion[1] * x + motion[4] * y + motion[7] * z,
        motion[2] * x + motion[5] * y + motion[8] * z,
    )


@njit
def inverse_transform(motion: Motion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of the camera frame in the model frame.

    Parameters
    ----------
    motion : (12,) float64 or tuple
    x, y, z : float
        The point, camera frame, metres.

    Returns
    -------
    tuple of 3 float
        The point, model frame, metres.

    """
    point: tuple[float, float, float] = inverse_rotate(motion, x - motion[9], y - motion[10], z - motion[11])
    return point


@njit
def transform_line(motion: Motion, row: FloatArray) -> tuple[float, float, float, float, float, float]:
    """A line of the model frame in the camera frame.

    Parameters
    ----------
    motion : (12,) float64 or tuple
    row : (9,) float64
        A model feature, see features.py.

    Returns
    -------
    tuple of 6 float
        Direction, then mid point (metres), camera frame.

    """
    ux, uy, uz = rotate(motion, row[3], row[4], row[5])
    mx, my, mz = transform(motion, row[0], row[1], row[2])
    return ux, uy, uz, mx, my, mz


@njit
def compose_small(motion: FloatArray, centre: FloatArray, step: FloatArray) -> None:
    """Follow a motion, in place, by a turn about a centre and a shift.

    The turn is Rodrigues' formula; the rotation is then made orthonormal again.

    Parameters
    ----------
    motion : (12,) float64
        Changed in place.
    centre : (3,) float64
        Camera frame, metres.
    step : (6,) float64
        Rotation vector (radians) and shift (metres), camera frame.

    """
    wx, wy, wz = step[0], step[1], step[2]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    # Below these angles the next term of the series is beyond double precision, and the quotient loses digits.
    s = 1.0 - angle * angle / 6.0 if angle < 1e-6 else np.sin(angle) / angle
    c = 0.5 - angle * angle / 24.0 if angle < 1e-3 else (1.0 - np.cos(angle)) / (angle * angle)
    q = np.empty(9)
    q[0] = 1.0 - c * (wy * wy + wz * wz)
    q[1] = c * wx * wy - s * wz
    q[2] = c * wx * wz + s * wy
    q[3] = c * wx * wy + s * wz
    q[4] = 1.0 - c * (wx * wx + wz * wz)
    q[5] = c * wy * wz - s * wx
    q[6] = c * wx * wz - s * wy
    q[7] = c * wy * wz + s * wx
    q[8] = 1.0 - c * (wx * wx + wy * wy)
    old = motion.copy()
    for i in range(3):
        for j in range(3):
            motion[3 * i + j] = q[3 * i] * old[j] + q[3 * i + 1] * old[3 + j] + q[3 * i + 2] * old[6 + j]
    tx, ty, tz = old[9] - centre[0], old[10] - centre[1], old[11] - centre[2]
    for i in range(3):
        motion[9 + i] = q[3 * i] * tx + q[3 * i + 1] * ty + q[3 * i + 2] * tz + centre[i] + step[3 + i]
    orthonormalise(motion)


@njit
def orthonormalise(motion: FloatArray) -> None:
    """Gram-Schmidt on the rows of a motion's rotation, in place.

    Parameters
    ----------
    motion : (12,) float64
        Changed in place.

    """
    n = np.sqrt(motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2)
    for i in range(3):
        motion[i] /= n
    dot = motion[0] * motion[3] + motion[1] * motion[4] + motion[2] * motion[5]
    for i in range(3):
        motion[3 + i] -= dot * motion[i]
    n = np.sqrt(motion[3] ** 2 + motion[4] ** 2 + motion[5] ** 2)
    for i in range(3):
        motion[3 + i] /= n
    motion[6] = motion[1] * motion[5] - motion[2] * motion[4]
    motion[7] = motion[2] * motion[3] - motion[0] * motion[5]
    motion[8] = motion[0] * motion[4] - motion[1] * motion[3]


@njit
def perpendiculars(ux: float, uy: float, uz: float) -> tuple[float, float, float, float, float, float]:
    """Two unit vectors perpendicular to a direction and to each other.

    Parameters
    ----------
    ux, uy, uz : float
        A unit vector.

    Returns
    -------
    tuple of 6 float
        The two vectors; with the direction first they are a right-handed frame.

    """
    # The axis that is farther from the direction gives the better conditioned product.
    if abs(ux) < 0.6:
        ex, ey, ez = 0.0, uz, -uy
    else:
        ex, ey, ez = -uz, 0.0, ux
    length = np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / length, ey / length, ez / length
    return ex, ey, ez, uy * ez - uz * ey, uz * ex - ux * ez, ux * ey - uy * ex
