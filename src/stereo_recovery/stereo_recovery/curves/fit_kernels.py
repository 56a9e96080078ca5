"""Compiled least-squares equations of one curve on the edgels of two images, for :mod:`.fit`.

shape is a :class:`.curve.CurveShape`, seen are :class:`.observations.ImagePoints`. There are n points and p parameters:
6 of a circle, 8 of an ellipse, see :func:`moved`.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import MAD_TO_SIGMA
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.settings import CAUCHY, CORRELATION_LENGTH, SMALLEST
from .curve import CurveShape
from .observations import ImagePoints
from .settings import (
    COMMON_SHARE,
    COMMON_SIGMA,
    CORRELATED_EDGELS,
    CURVATURE_VARIANCE_SHARE,
    DAMPING_ATTEMPTS,
    DAMPING_FACTOR,
    DAMPING_START,
    DIAGONAL_FACET_SHARE,
    DIFFERENCE_STEP,
    FACET_VARIANCE,
    LARGEST_STEP,
    LEAST_DAMPING,
    LEAST_GAIN,
    MOST_CURVATURE_BIAS,
    MOST_SQUARED_RESIDUAL,
    OVERALL_SHARE,
    OVERALL_SIGMA,
    SECTORS,
)


@njit
def _second(normal: FloatArray, first: FloatArray) -> FloatArray:
    """(3,) float64: the direction of the minor radius, normal x first."""
    return np.array(
        [
            normal[1] * first[2] - normal[2] * first[1],
            normal[2] * first[0] - normal[0] * first[2],
            normal[0] * first[1] - normal[1] * first[0],
        ]
    )


@njit
def _conic(centre: FloatArray, major: FloatArray, minor: FloatArray, camera: FloatArray, camera_x: float) -> FloatArray:
    """(6,) float64: the image conic as a00, a01, a11, a02, a12, a22 of its symmetric matrix, negative inside.

    major, minor : (3,) float64, metres: the radii with their directions; camera : (4,): fx, fy, cx, cy; camera_x :
    metres, the camera's centre is (camera_x, 0, 0).
    """
    m = np.empty((3, 3))
    for c in range(3):
        x = major[0] if c == 0 else (minor[0] if c == 1 else centre[0] - camera_x)
        y = major[1] if c == 0 else (minor[1] if c == 1 else centre[1])
        z = major[2] if c == 0 else (minor[2] if c == 1 else centre[2])
        m[0, c] = camera[0] * x + camera[2] * z
        m[1, c] = camera[1] * y + camera[3] * z
        m[2, c] = z
    # The adjugate is the inverse up to the determinant, a factor that the conic does not need.
    a = np.empty((3, 3))
    a[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    a[0, 1] = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]
    a[0, 2] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    a[1, 0] = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    a[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]
    a[1, 2] = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    a[2, 0] = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    a[2, 1] = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]
    a[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    q = np.empty(6)
    for j in range(3):
        for i in range(j + 1):
            q[i + j * (j + 1) // 2] = a[0, i] * a[0, j] + a[1, i] * a[1, j] - a[2, i] * a[2, j]
    norm = abs(q[5]) + SMALLEST
    if q[0] + q[2] < 0.0:
        norm = -norm
    conic: FloatArray = q / norm
    return conic


@njit
def residuals(shape: CurveShape, seen: ImagePoints, distance: FloatArray, bias: FloatArray) -> None:
    """Signed distances of pixels from the image conics of a curve, without the bias of smoothing.

    Parameters
    ----------
    shape : CurveShape
    seen : ImagePoints
        n pixels.
    distance : (n,) float64, pixels
        Overwritten: distances, positive outside.
    bias : (n,) float64, pixels
        Overwritten: by how much smoothing and the sub-pixel fit of edgels moved each towards the centre of curvature;
        ``distance`` has that taken off. 0 where ``seen.blur`` is 0.
    """
    major, minor = shape.radii[0] * shape.first, shape.radii[1] * _second(shape.normal, shape.first)
    for side in range(2):
        camera = seen.camera_left if side == 0 else seen.camera_right
        q = _conic(shape.centre, major, minor, camera, 0.0 if side == 0 else seen.baseline)
        for i in range(0 if side == 0 else seen.left_count, seen.left_count if side == 0 else len(seen.points)):
            u, v = seen.points[i, 0], seen.points[i, 1]
            gu = q[0] * u + q[1] * v + q[3]
            gv = q[1] * u + q[2] * v + q[4]
            value = gu * u + gv * v + q[3] * u + q[4] * v + q[5]
            g2 = gu * gu + gv * gv + SMALLEST
            g = np.sqrt(g2)
            curvature = (q[0] * gv * gv - 2.0 * q[1] * gu * gv + q[2] * gu * gu) / (g2 * g)
            twice = 2.0 * gu * gv / g2
            variance = 0.0
            if seen.blur > 0.0:
                variance = seen.blur + FACET_VARIANCE * (1.0 - DIAGONAL_FACET_SHARE * twice * twice)
            bias[i] = min(0.5 * variance * abs(curvature), MOST_CURVATURE_BIAS)
            distance[i] = 0.5 * value / g + bias[i]


@njit
def moved(shape: CurveShape, step: FloatArray, circle: bool) -> CurveShape:
    """A curve changed by a step.

    Parameters
    ----------
    shape : CurveShape
    step : (8,) float64
        Displacement of the centre (3), metres; tilts about first and about normal x first (2), radians; changes of the
        log
        radii (2; of a circle the first counts for both); turn of an ellipse in its plane, radians.
    circle : bool

    Returns
    -------
    CurveShape
    """
    n = shape.normal + step[3] * _second(shape.normal, shape.first) - step[4] * shape.first
    n = n / np.sqrt((n * n).sum())
    f = shape.first.copy()
    if not circle:
        f = f + step[7] * _second(shape.normal, shape.first)
    f = f - n * (f * n).sum()
    f = f / np.sqrt((f * f).sum())
    r = shape.radii.copy()
    r[0] *= np.exp(step[5])
    r[1] *= np.exp(step[5] if circle else step[6])
    return CurveShape(shape.centre + step[:3], n, f, r)


@njit
def jacobian(shape: CurveShape, circle: bool, seen: ImagePoints, distance: FloatArray, bias: FloatArray) -> FloatArray:
    """Derivatives of the residuals by the parameters of a curve, by differences.

    Parameters
    ----------
    shape : CurveShape
    circle : bool
    seen : ImagePoints
    distance, bias : (n,) float64, pixels
        Overwritten, see :func:`residuals`.

    Returns
    -------
    (n, p) float64
        By the parameters of :func:`moved`, p = 6 for a circle, else 8.
    """
    size = 6 if circle else 8
    n = len(seen.points)
    residuals(shape, seen, distance, bias)
    result = np.empty((n, size))
    shifted, unused = np.empty(n), np.empty(n)
    for k in range(size):
        step = np.zeros(8)
        h = DIFFERENCE_STEP * shape.radii[0] if k < 3 else DIFFERENCE_STEP
        step[k] = h
        residuals(moved(shape, step, circle), seen, shifted, unused)
        for i in range(n):
            result[i, k] = (shifted[i] - distance[i]) / h
    return result


@njit
def equations(
    shape: CurveShape, circle: bool, seen: ImagePoints, sigma: FloatArray, distance: FloatArray, bias: FloatArray
) -> tuple[FloatArray, FloatArray, float, FloatArray, FloatArray]:
    """Normal equations at a curve, with Cauchy weights scaled by the median of |distance| / sigma.

    Parameters
    ----------
    shape : CurveShape
    circle : bool
    seen : ImagePoints
    sigma : (n,) float64, pixels
        Of the edgels.
    distance, bias : (n,) float64, pixels
        Overwritten, see :func:`residuals`.

    Returns
    -------
    matrix : (p, p) float64
    gradient : (p,) float64
    cost : float
    weights : (n,) float64, px^-2
    rows : (n, p) float64
        The jacobian.
    """
    rows = jacobian(shape, circle, seen, distance, bias)
    n, size = rows.shape
    weights = np.empty(n)
    ratio = np.abs(distance) / sigma
    spread = max(MAD_TO_SIGMA * np.median(ratio), 1.0)
    cost = 0.0
    for i in range(n):
        variance = sigma[i] * sigma[i] + CURVATURE_VARIANCE_SHARE * bias[i] * bias[i]
        weights[i] = 1.0 / (variance * (1.0 + (ratio[i] / (CAUCHY * spread)) ** 2))
        cost += weights[i] * distance[i] * distance[i]
    matrix = np.zeros((size, size))
    gradient = np.zeros(size)
    for i in range(n):
        for a in range(size):
            wa = weights[i] * rows[i, a]
            gradient[a] += wa * distance[i]
            for b in range(a + 1):
                matrix[a, b] += wa * rows[i, b]
    for a in range(size):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, gradient, cost, weights, rows


@njit
def solve(matrix: FloatArray, right: FloatArray) -> bool:
    """Solves matrix (p, p) x = right (p,) in place by Gaussian elimination with pivots; False when it is singular."""
    n = len(right)
    for c in range(n):
        pivot = c
        for r in range(c + 1, n):
            if abs(matrix[r, c]) > abs(matrix[pivot, c]):
                pivot = r
        if not abs(matrix[pivot, c]) > 0.0:
            return False
        if pivot != c:
            for k in range(c, n):
                matrix[c, k], matrix[pivot, k] = matrix[pivot, k], matrix[c, k]
            right[c], right[pivot] = right[pivot], right[c]
        for r in range(c + 1, n):
            f = matrix[r, c] / matrix[c, c]
            for k in range(c, n):
                matrix[r, k] -= f * matrix[c, k]
            right[r] -= f * right[c]
    for c in range(n - 1, -1, -1):
        for k in range(c + 1, n):
            right[c] -= matrix[c, k] * right[k]
        right[c] /= matrix[c, c]
    return True


@njit
def axis_residual(axis: FloatArray, centre: FloatArray, normal: FloatArray, off: FloatArray) -> float:
    """How a curve lies to an axis.

    Parameters
    ----------
    axis : (4, 3) float64
        Rows: a point of the axis, metres, its direction, two directions across it.
    centre, normal : (3,) float64
        Of the curve.
    off : (4,) float64
        Overwritten: two tilts of the normal, radians, and two offsets of the centre, metres.

    Returns
    -------
    float
        Sign of the normal along the axis.
    """
    sign = 1.0 if (axis[1] * normal).sum() >= 0.0 else -1.0
    for k in range(2):
        off[k] = sign * (axis[2 + k] * normal).sum()
        off[2 + k] = (axis[2 + k] * (centre - axis[0])).sum()
    return sign


@njit
def _add_axis(
    axis: FloatArray, information: FloatArray, shape: CurveShape, matrix: FloatArray, gradient: FloatArray
) -> float:
    """Adds an axis constraint with its information matrix (4, 4) to the normal equations; returns its cost."""
    off = np.empty(4)
    sign = axis_residual(axis, shape.centre, shape.normal, off)
    slope = np.zeros((4, 5))
    second = _second(shape.normal, shape.first)
    for k in range(2):
        slope[k, 3] = sign * (axis[2 + k] * second).sum()
        slope[k, 4] = -sign * (axis[2 + k] * shape.first).sum()
        slope[2 + k, :3] = axis[2 + k]
    cost = 0.0
    for i in range(4):
        for j in range(4):
            cost += information[i, j] * off[i] * off[j]
            for a in range(5):
                gradient[a] += slope[i, a] * information[i, j] * off[j]
                for b in range(5):
                    matrix[a, b] += slope[i, a] * information[i, j] * slope[j, b]
    return cost


@njit
def minimise(
    shape: CurveShape,
    circle: bool,
    seen: ImagePoints,
    sigma: FloatArray,
    rounds: int,
    axis: FloatArray,
    information: FloatArray,
) -> tuple[bool, CurveShape]:
    """Move a curve until its image conics lie on the edgels (Levenberg-Marquardt, Cauchy weights).

    Parameters
    ----------
    shape : CurveShape
        Where to start.
    circle : bool
        Fit six parameters of a circle; else eight of an ellipse.
    seen : ImagePoints
    sigma : (n,) float64, pixels
        Of the edgels.
    rounds : int
        Most rounds.
    axis : (4, 3) float64
        See :func:`axis_residual`.
    information : (4, 4) float64
        Of the axis constraint; (0, 0) for a fit without one.

    Returns
    -------
    good : bool
        Whether all equations could be solved.
    shape : CurveShape
    """
    size = 6 if circle else 8
    distance, bias = np.empty(len(seen.points)), np.empty(len(seen.points))
    constrained = len(information) > 0
    off = np.empty(4)
    damping = DAMPING_START
    for _ in range(rounds):
        matrix, gradient, cost, weights, _rows = equations(shape, circle, seen, sigma, distance, bias)
        if constrained:
            cost += _add_axis(axis, information, shape, matrix, gradient)
        if not (np.isfinite(cost) and np.isfinite(matrix).all()):
            return False, shape
        gained = 0.0
        for _attempt in range(DAMPING_ATTEMPTS):
            damped, right = matrix.copy(), -gradient
            for a in range(size):
                damped[a, a] += damping * matrix[a, a]
            if not solve(damped, right):
                return False, shape
            step = np.zeros(8)
            for a in range(size):
                widest = shape.radii[0] if a < 3 else LARGEST_STEP
                step[a] = min(max(right[a], -widest), widest)
            other = moved(shape, step, circle)
            residuals(other, seen, distance, bias)
            new_cost = (weights * distance * distance).sum()
            if constrained:
                axis_residual(axis, other.centre, other.normal, off)
                for i in range(4):
                    for j in range(4):
                        new_cost += information[i, j] * off[i] * off[j]
            if np.isfinite(new_cost) and new_cost <= cost:
                shape = other
                gained = cost - new_cost
                damping = max(damping / DAMPING_FACTOR, LEAST_DAMPING)
                break
            damping *= DAMPING_FACTOR
        if gained < LEAST_GAIN * cost:
            break
    return True, shape


@njit
def truncated_rms(shape: CurveShape, seen: ImagePoints) -> float:
    """Root mean square of distances, pixels, of which none counts more than MOST_SQUARED_RESIDUAL."""
    distance, bias = np.empty(len(seen.points)), np.empty(len(seen.points))
    residuals(shape, seen, distance, bias)
    return float(np.sqrt(np.mean(np.minimum(distance * distance, MOST_SQUARED_RESIDUAL))))


@njit
def fitted(
    shape: CurveShape, circle: bool, seen: ImagePoints, sigma: FloatArray, shared: FloatArray, prior: FloatArray
) -> tuple[FloatArray, float, float]:
    """How well a fit knows its curve. Raises LinAlgError when the equations cannot be solved.

    Parameters
    ----------
    shape : CurveShape
    circle : bool
    seen : ImagePoints
    sigma, shared : (n,) float64, pixels
        Of the edgels; the localisation bias, which neighbours have in common.
    prior : (5, 5) float64
        Information of an axis constraint; (0, 0) for a fit without one.

    Returns
    -------
    covariance : (p, p) float64
        Of the parameters of :func:`moved`, M^-1 S M^-1 (the sandwich estimator).
    rms : float
        Pixels, see :func:`truncated_rms`; not finite where the curve is none.
    off : float
        Median of |distance| / sigma.
    """
    distance, bias = np.empty(len(sigma)), np.empty(len(sigma))
    matrix, _, cost, weights, rows = equations(shape, circle, seen, sigma, distance, bias)
    size = len(matrix)
    if not np.isfinite(cost):
        return np.zeros((size, size)), np.inf, np.inf
    if len(prior):
        matrix[:5, :5] += prior * CORRELATED_EDGELS
    variance_factor = max(1.0, (weights * distance * distance).sum() / max(len(sigma) - size, 1))
    # Displacements that edgels have in common do not average out: those of a sector, and those of all.
    of_sector = np.hypot(shared, COMMON_SIGMA + COMMON_SHARE * sigma)
    common = common_displacement(rows, weights, of_sector, sectors(shape, seen), 2 * SECTORS)
    of_all = OVERALL_SIGMA + OVERALL_SHARE * sigma
    common += common_displacement(rows, weights, of_all, np.zeros(len(sigma), np.int64), 1)
    correlated = CORRELATION_LENGTH * variance_factor
    spread = matrix * correlated + common
    if len(prior):
        # The constraint is part of M with the factor CORRELATED_EDGELS; its own variance has that factor squared.
        spread[:5, :5] -= prior * CORRELATED_EDGELS * correlated - prior * CORRELATED_EDGELS**2
    inverse = np.linalg.inv(matrix)
    rms = np.sqrt(np.mean(np.minimum(distance * distance, MOST_SQUARED_RESIDUAL)))
    return inverse @ spread @ inverse, float(rms), float(np.median(np.abs(distance) / sigma))


@njit
def sectors(shape: CurveShape, seen: ImagePoints) -> IntArray:
    """(n,) int64: which of SECTORS of the curve pixels are in; those of the right image count on."""
    second = _second(shape.normal, shape.first)
    sector = np.empty(len(seen.points), np.int64)
    for k in range(len(sector)):
        camera = seen.camera_left if k < seen.left_count else seen.camera_right
        origin = 0.0 if k < seen.left_count else seen.baseline
        x, y = (seen.points[k, 0] - camera[2]) / camera[0], (seen.points[k, 1] - camera[3]) / camera[1]
        n, c = shape.normal, shape.centre
        depth = ((c[0] - origin) * n[0] + c[1] * n[1] + c[2] * n[2]) / (x * n[0] + y * n[1] + n[2])
        dx, dy, dz = origin + x * depth - c[0], y * depth - c[1], depth - c[2]
        along = (dx * shape.first[0] + dy * shape.first[1] + dz * shape.first[2]) / shape.radii[0]
        across = (dx * second[0] + dy * second[1] + dz * second[2]) / shape.radii[1]
        turn = np.arctan2(across, along) / (2.0 * np.pi)
        sector[k] = int(np.floor(turn * SECTORS)) % SECTORS + (0 if k < seen.left_count else SECTORS)
    return sector


@njit
def common_displacement(
    rows: FloatArray, weights: FloatArray, sigma: FloatArray, group: IntArray, groups: int
) -> FloatArray:
    """Variance of the normal equations' right side by displacements that the edgels of a group have in common.

    Parameters
    ----------
    rows : (n, p) float64
        Jacobian.
    weights : (n,) float64, px^-2
    sigma : (n,) float64, pixels
        Of the common displacement.
    group : (n,) int64
        Which group an edgel is of.
    groups : int
        How many there are.

    Returns
    -------
    (p, p) float64
    """
    n, size = rows.shape
    sums = np.zeros((groups, size))
    for i in range(n):
        for a in range(size):
            sums[group[i], a] += weights[i] * sigma[i] * rows[i, a]
    return sums.T @ sums
