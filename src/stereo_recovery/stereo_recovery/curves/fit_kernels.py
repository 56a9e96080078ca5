"""Compiled: one curve in space moved until its images lie on edgels of both eyes, and the edgels that belong to it.

A pixel x of an image is y = (p, q, w) = M^-1 x in the curve's plane, where M = K [major, minor, centre]; on the curve
p^2 + q^2 = w^2. So the image conic is M^-T diag(1, 1, -1) M^-1, and a change dM moves its value at x by
-2 (p, q, -w) M^-1 dM y, which gives all derivatives at once. There are p parameters, 6 of a circle, 8 of an ellipse,
see :func:`moved`. index : (k,) int64, which of the edgels of :class:`.observations.Seen` count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import MAD_TO_SIGMA
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.settings import CAUCHY, CORRELATION_LENGTH, SMALLEST
from .curve import CurveShape
from .inlier_kernels import on_conic, without_ends
from .observations import Seen
from .settings import (
    ACROSS_COSINE,
    ARC_SAMPLES,
    DAMPING_FACTOR,
    DAMPING_START,
    DIAGONAL_FACET_SHARE,
    FACET_VARIANCE,
    INLIER_DISTANCE,
    LEAST_CURVE_EDGELS,
    LEAST_GAIN,
    LONGEST_GAP,
    MOST_MISFIT,
    OVERALL_SHARE,
    REFITS,
    ROUNDS,
    SECTORS,
)


class Fit(NamedTuple):
    """A fitted curve.

    Attributes
    ----------
    good : bool
        Whether there is one.
    shape : CurveShape
    covariance : (6, 6) float64
        See :class:`.curve.Curve`.
    rms : float
        Pixels. Root mean square of the distances.
    misfit : float
        Residuals over what the edgels' sigma predicts.
    """

    good: bool
    shape: CurveShape
    covariance: FloatArray
    rms: float
    misfit: float


class Recovered(NamedTuple):
    """A curve with all that belongs to it.

    Attributes
    ----------
    fit : Fit
    belongs : (k,) int64
        The edgels of the curve.
    arc : (float, float, float)
        Start and extent of what is seen of it, radians, and its share.
    evidence : float
        Nats by which the edgels near it speak for the curve rather than for texture.
    """

    fit: Fit
    belongs: IntArray
    arc: tuple[float, float, float]
    evidence: float


@njit
def nothing(shape: CurveShape, index: IntArray) -> Recovered:
    """What there is of a curve that edgels (k,) int64 do not show."""
    return Recovered(Fit(False, shape, np.zeros((6, 6)), np.inf, np.inf), index, (0.0, 0.0, 0.0), 0.0)


@njit
def second_of(shape: CurveShape) -> FloatArray:
    """(3,) float64: the direction of the minor radius, normal x first."""
    n, f = shape.normal, shape.first
    return np.array([n[1] * f[2] - n[2] * f[1], n[2] * f[0] - n[0] * f[2], n[0] * f[1] - n[1] * f[0]])


@njit
def _to_plane(shape: CurveShape, seen: Seen, side: int) -> tuple[FloatArray, float, float]:
    """How pixels of an image go to a curve's plane.

    Returns
    -------
    a : (3, 3) float64
        The adjugate of M: y up to its determinant.
    determinant : float
    sign : float
        That makes the conic negative inside.
    """
    camera, second = seen.cameras[side], second_of(shape)
    m, a = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        m[i, 0], m[i, 1] = shape.radii[0] * shape.first[i], shape.radii[1] * second[i]
        m[i, 2] = shape.centre[i] - (side * seen.baseline if i == 0 else 0.0)
    for j in range(3):
        m[0, j] = camera[0] * m[0, j] + camera[2] * m[2, j]
        m[1, j] = camera[1] * m[1, j] + camera[3] * m[2, j]
    for i in range(3):
        for j in range(3):
            r, s, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            a[i, j] = m[r, c] * m[s, d] - m[r, d] * m[s, c]
    determinant = m[0, 0] * a[0, 0] + m[0, 1] * a[1, 0] + m[0, 2] * a[2, 0]
    trace = a[0, 0] ** 2 + a[0, 1] ** 2 + a[1, 0] ** 2 + a[1, 1] ** 2 - a[2, 0] ** 2 - a[2, 1] ** 2
    return a, determinant, (1.0 if trace >= 0.0 else -1.0)


@njit
def _moves(shape: CurveShape, seen: Seen, side: int, a: FloatArray, determinant: float) -> FloatArray:
    """(3, 6): M^-1 K times x, y, z, the curve's normal, first and second, of what :func:`_to_plane` returns."""
    camera, second = seen.cameras[side], second_of(shape)
    b = np.empty((3, 6))
    scale = 1.0 / (determinant + SMALLEST)
    for i in range(3):
        x, y = scale * a[i, 0] * camera[0], scale * a[i, 1] * camera[1]
        z = scale * (a[i, 0] * camera[2] + a[i, 1] * camera[3] + a[i, 2])
        b[i, 0], b[i, 1], b[i, 2] = x, y, z
        b[i, 3] = x * shape.normal[0] + y * shape.normal[1] + z * shape.normal[2]
        b[i, 4] = x * shape.first[0] + y * shape.first[1] + z * shape.first[2]
        b[i, 5] = x * second[0] + y * second[1] + z * second[2]
    return b


@njit
def image_conic(shape: CurveShape, seen: Seen, side: int) -> FloatArray:
    """(3, 3) float64: the image conic of a curve, negative inside; side : 0 left, 1 right."""
    a, _determinant, sign = _to_plane(shape, seen, side)
    conic = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            conic[i, j] = sign * (a[0, i] * a[0, j] + a[1, i] * a[1, j] - a[2, i] * a[2, j])
    conic /= np.abs(conic).max()
    return conic


@njit
def residuals(
    shape: CurveShape, seen: Seen, index: IntArray, distance: FloatArray, bias: FloatArray, rows: FloatArray
) -> None:
    """Signed distances of edgels from the image conics of a curve, without the bias of smoothing; overwrites.

    distance : (k,) pixels, positive outside; bias : (k,) pixels, how far smoothing and the sub-pixel fit moved an edgel
    towards the centre of curvature; rows : (k, p) derivatives by the parameters of :func:`moved`, or (0, 0)
    """
    split = np.searchsorted(index, seen.left_count)
    for side in range(2):
        some = slice(0, split) if side == 0 else slice(split, len(index))
        _residuals(shape, seen, side, index[some], distance[some], bias[some], rows[some])


@njit
def _residuals(
    shape: CurveShape, seen: Seen, side: int, index: IntArray, distance: FloatArray, bias: FloatArray, rows: FloatArray
) -> None:
    """:func:`residuals` in one image."""
    a, determinant, sign = _to_plane(shape, seen, side)
    b = _moves(shape, seen, side, a, determinant)
    major, minor = shape.radii[0], shape.radii[1]
    for k in range(len(index)):
        u, v = seen.points[index[k], 0], seen.points[index[k], 1]
        p = a[0, 0] * u + a[0, 1] * v + a[0, 2]
        q = a[1, 0] * u + a[1, 1] * v + a[1, 2]
        w = a[2, 0] * u + a[2, 1] * v + a[2, 2]
        # Half the conic's gradient; its value over twice that is the distance, to first order.
        gu = sign * (p * a[0, 0] + q * a[1, 0] - w * a[2, 0])
        gv = sign * (p * a[0, 1] + q * a[1, 1] - w * a[2, 1])
        g2 = gu * gu + gv * gv + SMALLEST
        g = np.sqrt(g2)
        # Second derivative along the conic: of each of p, q, w it is the square of the first.
        tp, tq, tw = (a[0, 1] * gu - a[0, 0] * gv), (a[1, 1] * gu - a[1, 0] * gv), (a[2, 1] * gu - a[2, 0] * gv)
        curvature = (tp * tp + tq * tq - tw * tw) / (g2 * g)
        twice = 2.0 * gu * gv / g2
        variance = 0.0
        if seen.blur > 0.0:
            variance = seen.blur + FACET_VARIANCE * (1.0 - DIAGONAL_FACET_SHARE * twice * twice)
        bias[k] = 0.5 * variance * abs(curvature)
        distance[k] = 0.5 * sign * (p * p + q * q - w * w) / g + bias[k]
        if len(rows) == 0:
            continue
        scale = -sign / g
        for c in range(3):
            rows[k, c] = scale * w * (p * b[0, c] + q * b[1, c] - w * b[2, c])
        normal = scale * (p * b[0, 3] + q * b[1, 3] - w * b[2, 3])
        first = scale * (p * b[0, 4] + q * b[1, 4] - w * b[2, 4])
        second = scale * (p * b[0, 5] + q * b[1, 5] - w * b[2, 5])
        rows[k, 3], rows[k, 4] = -q * minor * normal, p * major * normal
        rows[k, 5] = p * major * first
        if rows.shape[1] == 6:
            rows[k, 5] += q * minor * second
        else:
            rows[k, 6], rows[k, 7] = q * minor * second, p * major * second + q * minor * first


@njit
def moved(shape: CurveShape, step: FloatArray, circle: bool) -> CurveShape:
    """A curve changed by a step.

    step : (8,): displacement of the centre (3), metres; tilts about first and about normal x first (2), radians;
    changes of the log radii (2; of a circle the first counts for both); shear of an ellipse along both its axes, which
    a circle can be changed by as well as an ellipse
    """
    second = second_of(shape)
    n = shape.normal + step[3] * second - step[4] * shape.first
    n = n / np.sqrt((n * n).sum())
    r = shape.radii * np.exp(step[5])
    f = shape.first
    if not circle:
        # The ellipse is the image of the unit circle by a matrix, the first singular vector of which is its major axis.
        a, b, c, d = r[0], step[7] * shape.radii[1], step[7] * shape.radii[0], shape.radii[1] * np.exp(step[6])
        size, stretch, cross = a * a + b * b + c * c + d * d, a * a + b * b - c * c - d * d, 2.0 * (a * c + b * d)
        turn, most = 0.5 * np.arctan2(cross, stretch), np.hypot(stretch, cross)
        r = np.sqrt(np.array([0.5 * (size + most), max(0.5 * (size - most), 0.0)]))
        f = np.cos(turn) * f + np.sin(turn) * second
    f = f - n * (f * n).sum()
    f = f / np.sqrt((f * f).sum())
    return CurveShape(shape.centre + step[:3], n, f, r)


@njit
def solve(matrix: FloatArray, right: FloatArray) -> bool:
    """Solves matrix (p, p) x = right (p, c) in place by Gaussian elimination with pivots; False when it is singular."""
    n = len(right)
    for c in range(n):
        pivot = c
        for r in range(c + 1, n):
            if abs(matrix[r, c]) > abs(matrix[pivot, c]):
                pivot = r
        if not abs(matrix[pivot, c]) > 0.0:
            return False
        if pivot != c:
            for k in range(n):
                matrix[c, k], matrix[pivot, k] = matrix[pivot, k], matrix[c, k]
            for k in range(right.shape[1]):
                right[c, k], right[pivot, k] = right[pivot, k], right[c, k]
        for r in range(n):
            if r != c:
                f = matrix[r, c] / matrix[c, c]
                for k in range(c, n):
                    matrix[r, k] -= f * matrix[c, k]
                for k in range(right.shape[1]):
                    right[r, k] -= f * right[c, k]
    for c in range(n):
        for k in range(right.shape[1]):
            right[c, k] /= matrix[c, c]
    return bool(np.isfinite(right).all())


@njit
def _sigma(seen: Seen, index: IntArray) -> FloatArray:
    """(k,) pixels: sigma of edgels, by noise and by localisation."""
    return np.hypot(seen.sigma[index], seen.bias[index])


@njit
def _equations(
    shape: CurveShape, seen: Seen, index: IntArray, sigma: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Normal equations (p, p), (p, 1), distances and Cauchy weights (k,); their scale is the median of the ratios."""
    n, size = rows.shape
    distance, bias, weights = np.empty(n), np.empty(n), np.empty(n)
    residuals(shape, seen, index, distance, bias, rows)
    ratio = np.abs(distance) / sigma
    spread = max(MAD_TO_SIGMA * np.median(ratio), 1.0)
    weighted = np.empty((n, size))
    for i in range(n):
        weights[i] = 1.0 / (sigma[i] * sigma[i] * (1.0 + (ratio[i] / (CAUCHY * spread)) ** 2))
        for a in range(size):
            weighted[i, a] = weights[i] * rows[i, a]
    matrix, gradient = weighted.T @ rows, weighted.T @ distance.reshape(n, 1)
    return matrix, gradient, distance, weights


@njit
def minimise(shape: CurveShape, circle: bool, seen: Seen, index: IntArray) -> tuple[bool, CurveShape]:
    """Move a curve until its image conics lie on edgels (Levenberg-Marquardt, Cauchy weights; thesis 3.10.1).

    Returns
    -------
    good : bool
        Whether all equations could be solved.
    shape : CurveShape
    """
    size = 6 if circle else 8
    sigma = _sigma(seen, index)
    rows, none, bias = np.empty((len(index), size)), np.empty((0, 0)), np.empty(len(index))
    damping = DAMPING_START
    matrix, gradient, distance, weights = _equations(shape, seen, index, sigma, rows)
    cost = (weights * distance * distance).sum()
    for _ in range(ROUNDS):
        damped, right = matrix.copy(), -gradient
        for a in range(size):
            damped[a, a] *= 1.0 + damping
        if not solve(damped, right):
            return False, shape
        step = np.zeros(8)
        step[:size] = right[:, 0]
        other = moved(shape, step, circle)
        residuals(other, seen, index, distance, bias, none)
        new_cost = (weights * distance * distance).sum()
        # An ellipse that has become a line has no way back.
        better = new_cost <= cost and other.radii.min() > 0.0
        # What a step does not gain counts by what its equations promised: at the minimum rounding decides.
        gained = cost - new_cost if better else -(gradient * right).sum()
        if better:
            shape = other
        if gained < LEAST_GAIN * cost:
            break
        if not better:
            damping *= DAMPING_FACTOR
            continue
        damping /= DAMPING_FACTOR
        matrix, gradient, distance, weights = _equations(shape, seen, index, sigma, rows)
        cost = (weights * distance * distance).sum()
    return True, shape


@njit(nogil=True)
def fit(shape: CurveShape, circle: bool, seen: Seen, index: IntArray, rough: bool = False) -> Fit:
    """A curve fitted to edgels, with how well it is known.

    Parameters
    ----------
    shape : CurveShape
        Where to start.
    circle : bool
        Six parameters of a circle; else eight of an ellipse.
    seen, index
        The edgels.
    rough : bool
        Without covariance: this fit only compares starts.

    Returns
    -------
    Fit
        Not good when the equations cannot be solved, and when an ellipse cannot be told from a circle. The covariance
        is M^-1 S M^-1 (the sandwich estimator).
    """
    size = 6 if circle else 8
    nothing = np.zeros((6, 6))
    radii = np.full(2, np.sqrt(shape.radii[0] * shape.radii[1])) if circle else shape.radii.copy()
    shape = CurveShape(shape.centre.copy(), shape.normal.copy(), shape.first.copy(), radii)
    failed = Fit(False, shape, nothing, np.inf, np.inf)
    if len(index) <= size:
        return failed
    good, shape = minimise(shape, circle, seen, index)
    if not good:
        return failed
    sigma = _sigma(seen, index)
    rows = np.empty((len(index), size))
    matrix, gradient, distance, weights = _equations(shape, seen, index, sigma, rows)
    rms = np.sqrt(np.mean(distance * distance))
    if rough or not np.isfinite(rms):
        return Fit(bool(np.isfinite(rms)), shape, nothing, rms, np.inf)
    free = max(len(index) - size, 1)
    # Displacements that edgels have in common do not average out: those of a sector, and those of all.
    spread = matrix * CORRELATION_LENGTH
    sector = sectors(shape, seen, index)
    spread += _common(rows, weights, sigma, sector)
    spread += _common(rows, weights, OVERALL_SHARE * sigma, 0 * sector)
    # All of them are as much larger than stated as what is left over shows.
    spread *= max(1.0, (weights * distance * distance).sum() / free)
    inverse = np.eye(size)
    if not solve(matrix, inverse):
        return failed
    covariance = inverse @ spread @ inverse
    if not circle:
        variance = max(covariance[5, 5] + covariance[6, 6] - 2.0 * covariance[5, 6], 0.0)
        if abs(np.log(shape.radii[0] / shape.radii[1])) < BOUND_SIGMA * np.sqrt(variance):
            return failed
    covariance = covariance[:6, :6].copy()
    covariance[5, :] *= shape.radii[0]
    covariance[:, 5] *= shape.radii[0]
    if not np.isfinite(covariance).all() or np.diag(covariance).min() < 0.0:
        return failed
    return Fit(True, shape, covariance, rms, MAD_TO_SIGMA * np.median(np.abs(distance) / sigma))


@njit
def sectors(shape: CurveShape, seen: Seen, index: IntArray) -> IntArray:
    """(k,) int64: which of SECTORS of the curve edgels are in; those of the right image count on."""
    angle = angles(shape, seen, index)
    result = np.empty(len(index), np.int64)
    for k in range(len(index)):
        result[k] = int(np.floor(angle[k] * SECTORS)) % SECTORS + (0 if index[k] < seen.left_count else SECTORS)
    return result


@njit
def angles(shape: CurveShape, seen: Seen, index: IntArray) -> FloatArray:
    """(k,) float64, turns: where on a curve edgels are, see :func:`.curve.angles`."""
    a0, a1 = _to_plane(shape, seen, 0)[0], _to_plane(shape, seen, 1)[0]
    result = np.empty(len(index))
    for k in range(len(index)):
        a = a0 if index[k] < seen.left_count else a1
        u, v = seen.points[index[k], 0], seen.points[index[k], 1]
        w = a[2, 0] * u + a[2, 1] * v + a[2, 2]
        p, q = a[0, 0] * u + a[0, 1] * v + a[0, 2], a[1, 0] * u + a[1, 1] * v + a[1, 2]
        result[k] = np.arctan2(q / w, p / w) / (2.0 * np.pi)
    return result


@njit
def _common(rows: FloatArray, weights: FloatArray, sigma: FloatArray, group: IntArray) -> FloatArray:
    """(p, p): variance of the equations' right side by displacements (k,), pixels, that the edgels of a group share."""
    n, size = rows.shape
    sums = np.zeros((2 * SECTORS, size))
    for i in range(n):
        for a in range(size):
            sums[group[i], a] += weights[i] * sigma[i] * rows[i, a]
    return sums.T @ sums


@njit
def near_curve(shape: CurveShape, seen: Seen, side: int, limit: FloatArray) -> IntArray:
    """Edgels of one image near a curve's conic there, with gradients across it.

    side : 0 left, 1 right; limit : (n,) pixels, that each of all edgels may be off. Returns their numbers in ``seen``.
    """
    first, last = (0, seen.left_count) if side == 0 else (seen.left_count, len(seen.points))
    conic, around = image_conic(shape, seen, side), seen.boxes[side]
    position, direction = seen.points[first:last], seen.direction[first:last]
    near: IntArray = first + on_conic(conic, position, direction, around, limit[first:last], ACROSS_COSINE)
    return near


@njit
def _scattered_about(found: Fit, seen: Seen, belongs: IntArray) -> float:
    """Nats for half of the edgels near a curve scattering about it as they state, and not all evenly, as texture does.

    What texture has there is within the limits; a curve's own might be beyond them, which speaks for texture where what
    edgels state is hardly less than their limits.
    """
    distance, bias = np.empty(len(belongs)), np.empty(len(belongs))
    residuals(found.shape, seen, belongs, distance, bias, np.empty((0, 0)))
    sigma = max(1.0, found.misfit) * _sigma(seen, belongs)
    log_ratio = 0.0
    for k in range(len(belongs)):
        likely = np.exp(-0.5 * (distance[k] / sigma[k]) ** 2) / (np.sqrt(2.0 * np.pi) * sigma[k])
        log_ratio += np.log(0.5 + seen.limit[belongs[k]] * likely)
    return float(log_ratio)


@njit(nogil=True)
def inliers(found: Fit, seen: Seen, side: int) -> tuple[IntArray, IntArray]:
    """Edgels of one image that belong to a curve, and those of them that measure it.

    Parameters
    ----------
    found : Fit
    seen : Seen
    side : int
        0 for the left image, 1 for the right one.

    Returns
    -------
    belongs : (k,) int64
        Within their limits of the image conic, with a gradient across it.
    measures : (m,) int64
        Within three sigma of it, where sigma adds the edgel's own, the fit's and the curve's; not at the end of a run.
        An occluding contour that starts on a rim is still near it where it is a contour already.
    """
    belongs = near_curve(found.shape, seen, side, seen.limit)
    index = without_ends(belongs, seen.points)
    if len(index) == 0:
        return belongs, index
    distance, bias, rows = np.empty(len(index)), np.empty(len(index)), np.empty((len(index), 6))
    residuals(found.shape, seen, index, distance, bias, rows)
    sigma, of_fit = _sigma(seen, index), (MAD_TO_SIGMA * np.median(np.abs(distance))) ** 2
    measures = np.empty(len(index), np.int64)
    count = 0
    for k in range(len(index)):
        rows[k, 5] /= found.shape.radii[0]
        variance = of_fit + sigma[k] ** 2
        for a in range(6):
            for b in range(6):
                variance += rows[k, a] * found.covariance[a, b] * rows[k, b]
        if abs(distance[k]) < min(BOUND_SIGMA * np.sqrt(variance), seen.limit[index[k]]):
            measures[count] = index[k]
            count += 1
    return belongs, measures[:count]


@njit
def visible_arc(shape: CurveShape, seen: Seen, index: IntArray) -> tuple[float, float, float]:
    """The part of a curve that edgels of either image show.

    Returns
    -------
    start, extent : float, radians
        All but the widest gap between edgels. A gap of up to LONGEST_GAP is none.
    coverage : float
        Share of the curve outside such gaps.
    """
    angle = np.sort(2.0 * np.pi * angles(shape, seen, index))
    gap = np.empty(len(angle))
    gap[:-1], gap[-1] = np.diff(angle), angle[0] + 2.0 * np.pi - angle[-1]
    coverage = 1.0 - gap[gap > LONGEST_GAP].sum() / (2.0 * np.pi)
    widest = np.argmax(gap)
    if gap[widest] <= LONGEST_GAP:
        return 0.0, 2.0 * np.pi, coverage
    return angle[(widest + 1) % len(angle)], 2.0 * np.pi - gap[widest], coverage


@njit
def is_line(shape: CurveShape, arc: tuple[float, float, float], seen: Seen, side: int) -> bool:
    """Whether a camera sees the visible arc so flat that all edgels of a straight line would belong to it.

    arc : start and extent, radians, as of :func:`visible_arc`
    """
    camera, second = seen.cameras[side], second_of(shape)
    points = np.empty((ARC_SAMPLES, 2))
    for k in range(ARC_SAMPLES):
        angle = arc[0] + arc[1] * k / (ARC_SAMPLES - 1)
        at = shape.centre + shape.radii[0] * np.cos(angle) * shape.first + shape.radii[1] * np.sin(angle) * second
        ahead = max(at[2], SMALLEST)
        points[k, 0] = camera[0] * (at[0] - side * seen.baseline) / ahead + camera[2]
        points[k, 1] = camera[1] * at[1] / ahead + camera[3]
    u, v = points[:, 0] - points[:, 0].mean(), points[:, 1] - points[:, 1].mean()
    turn = 0.5 * np.arctan2(2.0 * (u * v).sum(), (u * u).sum() - (v * v).sum())
    return bool(np.abs(v * np.cos(turn) - u * np.sin(turn)).max() < INLIER_DISTANCE)


@njit(nogil=True)
def recovered(start: CurveShape, seen: Seen, chosen: IntArray) -> Recovered:
    """Fit a curve to chosen edgels, then to all its inliers: an ellipse, where a circle does not fit as stated.

    Parameters
    ----------
    start : CurveShape
        Rough.
    seen : Seen
        All edgels of both images.
    chosen : (c,) int64
        Those that certainly belong to it.

    Returns
    -------
    Recovered
    """
    circle = True
    none: Recovered = nothing(start, chosen)
    found = fit(start, True, seen, chosen)
    if not found.misfit < MOST_MISFIT:
        other = fit(start, False, seen, chosen)
        if other.good:
            found, circle = other, False
    belongs = chosen
    for _ in range(REFITS):
        if not found.good or found.shape.centre[2] <= 0.0:
            break
        left, right = inliers(found, seen, 0), inliers(found, seen, 1)
        if min(len(left[1]), len(right[1])) < LEAST_CURVE_EDGELS:
            return none
        belongs, measuring = np.concatenate((left[0], right[0])), np.concatenate((left[1], right[1]))
        settled = len(measuring) == len(chosen) and (measuring == chosen).all()
        chosen = measuring
        if settled:
            break
        found = fit(found.shape, circle, seen, chosen)
        if circle and found.good and found.misfit > MOST_MISFIT:
            other = fit(found.shape, False, seen, chosen)
            if other.good:
                found, circle = other, False
    arc = visible_arc(found.shape, seen, chosen)
    line = is_line(found.shape, arc, seen, 0) or is_line(found.shape, arc, seen, 1)
    fits = found.misfit < MOST_MISFIT and found.shape.centre[2] > 0.0 and not line
    evidence = _scattered_about(found, seen, belongs) if fits else 0.0
    return Recovered(found, belongs, arc, evidence) if evidence > 0.0 else none
