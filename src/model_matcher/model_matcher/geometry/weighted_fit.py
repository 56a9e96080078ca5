"""Compiled weighted fit of a pose: every data end weighs by its covariance, and slides freely along its model line.

Rows of features and motions as in features.py. The covariance of a data feature is that of its ends, start before end;
of a curve, that of its centre and unit normal (see msgs_py.FeatureSet).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import OUTLYING
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from .features import CURVE, FeatureRows
from .least_squares import cholesky, damp, solve_positive
from .rigid_motion import compose_small, perpendiculars, transform_line
from .settings import CONVERGED, MOST_STEPS, NOT_ZERO


class Fit(NamedTuple):
    """What a weighted fit leaves.

    Attributes
    ----------
    normal : (6, 6) float64
        Normal matrix of the fit about ``centre``, rotation before translation: the inverse of its covariance.
    centre : (3,) float64
        Metres, camera frame: the middle of the matched data.
    scale : float
        What the covariances are to be multiplied by, as their residuals show, outliers left out.
    rms : float
        Metres, root mean square of the distances of end points from their model features.
    """

    normal: FloatArray
    centre: FloatArray
    scale: float
    rms: float


@njit
def _rows_of(
    end: tuple[float, float, float],
    line: tuple[float, float, float, float, float, float],
    axes: FloatArray,
    centre: FloatArray,
    block: FloatArray,
    first: int,
) -> float:
    """Fill rows of a block (m, 7), from ``first`` on: how an end misses its model line along each of the axes (a, 3).

    Six columns are the derivatives by rotation and translation, the last is the residual. Returns the squared distance.
    """
    x, y, z = end
    ux, uy, uz, mx, my, mz = line
    along = 0.0 if len(axes) == 3 else (x - mx) * ux + (y - my) * uy + (z - mz) * uz
    qx, qy, qz = mx + along * ux, my + along * uy, mz + along * uz
    rx, ry, rz = x - qx, y - qy, z - qz
    gx, gy, gz = qx - centre[0], qy - centre[1], qz - centre[2]
    for i in range(len(axes)):
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        row = block[first + i]
        row[0], row[1], row[2] = gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax
        row[3], row[4], row[5] = ax, ay, az
        row[6] = ax * rx + ay * ry + az * rz
    return rx * rx + ry * ry + rz * rz


@njit
def _projected(covariance: FloatArray, axes: FloatArray, sizes: tuple[int, int], sign: float, out: FloatArray) -> None:
    """The covariance (6, 6) of two points in coordinates along axes (3, 3): the first ``sizes`` of each, into ``out``.

    sign : what the second point's coordinates are multiplied by
    """
    for i in range(sizes[0] + sizes[1]):
        p, a = (0, i) if i < sizes[0] else (3, i - sizes[0])
        for j in range(i + 1):
            q, b = (0, j) if j < sizes[0] else (3, j - sizes[0])
            total = 0.0
            for k in range(3):
                for m in range(3):
                    total += axes[a, k] * covariance[p + k, q + m] * axes[b, m]
            out[i, j] = total if p == q else sign * total


@njit
def _whiten(covariance: FloatArray, block: FloatArray, count: int) -> bool:
    """Divide the first rows of a block (m, 7) by the Cholesky factor of their covariance, both in place."""
    if not cholesky(covariance, count, covariance):
        return False
    for i in range(count):
        for c in range(7):
            total = block[i, c]
            for k in range(i):
                total -= covariance[i, k] * block[k, c]
            block[i, c] = total / covariance[i, i]
    return True


@njit
def _feature_block(
    line: tuple[float, float, float, float, float, float],
    d: FloatArray,
    is_curve: bool,
    sign: float,
    covariance: FloatArray,
    centre: FloatArray,
    block: FloatArray,
    spread: FloatArray,
) -> tuple[int, float, int]:
    """The residuals of one data feature (9,) in sigmas and their derivatives, into a block (5, 7).

    Returns how many, the sum of squared distances in square metres and of how many points; none, when its covariance
    is none.
    """
    axes = np.empty((3, 3))
    axes[2, 0], axes[2, 1], axes[2, 2] = line[0], line[1], line[2]
    across = perpendiculars(line[0], line[1], line[2])
    for i in range(6):
        axes[i // 3, i % 3] = across[i]
    if is_curve:
        squares = _rows_of((d[0], d[1], d[2]), line, axes, centre, block, 0)
        for i in range(2):
            ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
            row = block[3 + i]
            row[0] = line[1] * az - line[2] * ay
            row[1] = line[2] * ax - line[0] * az
            row[2] = line[0] * ay - line[1] * ax
            row[3] = row[4] = row[5] = 0.0
            row[6] = sign * (ax * d[3] + ay * d[4] + az * d[5])
        _projected(covariance, axes, (3, 2), sign, spread)
        count, points = 5, 1
    else:
        squares = 0.0
        for end in range(2):
            step = d[6] if end == 1 else -d[6]
            at = (d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5])
            squares += _rows_of(at, line, axes[:2], centre, block, 2 * end)
        _projected(covariance, axes, (2, 2), 1.0, spread)
        count, points = 4, 2
    return (count, squares, points) if _whiten(spread, block, count) else (0, 0.0, 0)


@njit
def weighted_fit(
    motion: FloatArray,
    model: FloatArray,
    data: FeatureRows,
    covariances: FloatArray,
    assignment: Int32Array,
    sign: Int8Array,
    worth: float,
) -> Fit:
    """Fit a pose to the data assigned to it, each feature by its covariance, in place.

    Both ends of an edge or axis lie on the model's line, anywhere along it; a curve's centre and normal on the model's.
    A feature farther off than three sigma (as rare as that in its degrees of freedom) counts less, the more the
    farther: by Huber's weights until a step gains less than one sigma, then by its square, so that a wrong one adds a
    constant. How far three sigma are, the others say: covariances are known up to a common factor, the same for all,
    whose most likely value is found with the pose.

    Parameters
    ----------
    motion : (12,) float64
        The pose to start from; changed in place.
    model : (e, 9) float64
        The model's features.
    data : FeatureRows
        n data features, camera frame.
    covariances : (n, 6, 6) float64
        Positive definite.
    assignment : (n,) int32
        The model feature of each data feature, negative for none.
    sign : (n,) int8
        1 or -1, whether the normals of curves agree.
    worth : float
        Residuals that the covariances' own word about that factor, which is one, is worth; 0 for none.

    Returns
    -------
    Fit

    References
    ----------
    Huber, "Robust estimation of a location parameter", 1964; a residual across a line, with its covariance across it,
    is what remains when the place along the line is a free unknown of each end.
    """
    normal, right, step, centre = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros(3)
    damped = np.empty((6, 6))
    block, spread = np.empty((5, 7)), np.empty((5, 5))
    matched = 0
    for k in range(len(assignment)):
        if assignment[k] >= 0:
            matched += 1
            for i in range(3):
                centre[i] += data.rows[k, i]
    centre /= max(matched, 1)
    scale, rms, near = 1.0, 0.0, False
    for _ in range(MOST_STEPS):
        normal[:], right[:] = 0.0, 0.0
        total, residuals, points, distances = 0.0, 0, 0, 0.0
        for k in range(len(assignment)):
            if assignment[k] < 0:
                continue
            line = transform_line(motion, model[assignment[k]])
            is_curve = data.kind[k] == CURVE
            way = 1.0 if sign[k] >= 0 else -1.0
            count, squares, of_points = _feature_block(
                line, data.rows[k], is_curve, way, covariances[k], centre, block, spread
            )
            d2 = 0.0
            for i in range(count):
                d2 += block[i, 6] * block[i, 6]
            limit = OUTLYING[count] * scale
            weight = 1.0 if d2 <= limit else limit / d2 if near else np.sqrt(limit / d2)
            for i in range(count):
                for p in range(6):
                    right[p] += weight * block[i, p] * block[i, 6]
                    for q in range(p + 1):
                        normal[p, q] += weight * block[i, p] * block[i, q]
            if d2 <= limit:
                total += d2
                residuals += count
            points += of_points
            distances += squares
        rms = np.sqrt(distances / max(points, 1))
        # A copy, so that a free motion is still seen to be free in what is returned.
        damped[:] = normal
        damp(damped)
        if not solve_positive(damped, right, step):
            break
        compose_small(motion, centre, step)
        gain = (step * right).sum()
        if near:
            before, scale = scale, max((worth + total) / max(worth + residuals - 6, 1.0), NOT_ZERO)
            if max(gain * before, (scale - before) ** 2) < CONVERGED * before**2:
                break
        near = near or gain < 1.0
    for p in range(6):
        for q in range(p):
            normal[q, p] = normal[p, q]
    return Fit(normal, centre, scale, rms)
