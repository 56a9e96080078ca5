"""Compiled alignment of the strips of texture beside straight edges: what disparity their surfaces have."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import ByteArray, Float32Array, FloatArray

from ..detection.sampling import bilinear
from ..detection.settings import QUANTISATION_NOISE
from .settings import (
    CAUCHY,
    MATCH_SIGMA,
    STRIP_ASKED,
    STRIP_CONVERGED,
    STRIP_CORRELATION,
    STRIP_FAR,
    STRIP_FITS,
    STRIP_GAIN_SIGMA,
    STRIP_LEAST_KNOWN,
    STRIP_LEAST_SHARE,
    STRIP_NEAR,
    STRIP_ROUNDS,
    STRIP_ROW_PRIOR,
    STRIP_SAMPLES,
    STRIP_SHARP,
    STRIP_SHIFT_SIGMA,
    STRIP_SLOPE_SIGMA,
    STRIP_STARTS,
)

# Unknowns of a strip: disparity where it begins, its gradients along and across the edge, gain and shift of grey
# levels, and the row in the right image over that in the left.
UNKNOWNS = 6


# Who tells the disparity of a strip.
UNKNOWN, DENSE, ALIGNED = 0, 1, 2

# Rows of what is known of places of a strip: abscissa, distance from the edge, column, row, grey level, all of the left
# image; and of what the right image says of them: the residual's derivatives by the unknowns, the residual, its weight.
PLACES, SEEN = 5, UNKNOWNS + 2


@njit
def _places(left: Float32Array, strip: FloatArray, f: float, out: Float32Array) -> int:
    """Fill ``out`` (PLACES, m) with the places of a strip that the left image shows. Returns their number.

    strip : (7,) centre, direction, first and last abscissa, side, pixels; f : pixels of the level a pixel
    """
    height, width = left.shape
    # Pixel centres have whole coordinates.
    u, v = (strip[0] + 0.5) * f - 0.5, (strip[1] + 0.5) * f - 0.5
    first, last = strip[4] * f, strip[5] * f
    step = max(1.0, (last - first) / STRIP_SAMPLES)
    m = 0
    for k in range(int((last - first) / step) + 1):
        s = first + k * step
        for w in range(STRIP_NEAR, STRIP_FAR + 1):
            o = strip[6] * w
            x, y = u + s * strip[2] - o * strip[3], v + s * strip[3] + o * strip[2]
            if y < 0.0 or y >= height - 1 or x < 0.0 or x >= width - 1:
                continue
            out[0, m], out[1, m], out[2, m], out[3, m], out[4, m] = s, o, x, y, bilinear(left, x, y)
            m += 1
    return m


@njit
def _compare(right: Float32Array, places: Float32Array, count: int, p: FloatArray, out: Float32Array) -> int:
    """Fill ``out`` (SEEN, m) with what the right image says of ``count`` places by p (6,); the weights are left open.

    Returns how many of them it shows.
    """
    height, width = right.shape
    # Unsigned indices into the rows one after another: no look whether they are counted from the end.
    flat = right.ravel()
    first, along, across = np.float32(p[0]), np.float32(p[1]), np.float32(p[2])
    gain, shift, rows = np.float32(p[3]), np.float32(p[4]), np.float32(p[5])
    one, half = np.float32(1.0), np.float32(0.5) * gain
    last, lowest = np.float32(width - 2), np.float32(height - 2)
    m = 0
    for k in range(count):
        s, o = places[0, k], places[1, k]
        there, below = places[2, k] - (first + along * s + across * o), places[3, k] + rows
        if not (there >= one and there < last and below >= one and below < lowest):
            continue
        x, y = np.int64(there), np.int64(below)
        b, d = there - np.float32(x), below - np.float32(y)
        a, c = one - b, one - d
        at = y * width + x
        above, under, lowermost = at - width, at + width, at + 2 * width
        # Four rows of pixels, each between two columns, and the slopes of the middle ones.
        left_up, right_up = flat[np.uintp(at)], flat[np.uintp(at + 1)]
        left_low, right_low = flat[np.uintp(under)], flat[np.uintp(under + 1)]
        top = a * flat[np.uintp(above)] + b * flat[np.uintp(above + 1)]
        upper, lower = a * left_up + b * right_up, a * left_low + b * right_low
        bottom = a * flat[np.uintp(lowermost)] + b * flat[np.uintp(lowermost + 1)]
        upper_slope = a * (right_up - flat[np.uintp(at - 1)]) + b * (flat[np.uintp(at + 2)] - left_up)
        lower_slope = a * (right_low - flat[np.uintp(under - 1)]) + b * (flat[np.uintp(under + 2)] - left_low)
        grey = c * upper + d * lower
        # The residual is left - model, whose derivative by disparity is minus the slope's.
        slope = -half * (c * upper_slope + d * lower_slope)
        out[0, m], out[1, m], out[2, m], out[3, m], out[4, m] = slope, slope * s, slope * o, grey, one
        out[5, m] = half * (c * (lower - top) + d * (bottom - upper))
        out[6, m] = places[4, k] - gain * grey - shift
        m += 1
    return m


@njit(fastmath=True)
def _median_size(values: Float32Array) -> float:
    """Median of the sizes of values (m,), by halving the interval that holds it: it can be counted eight at a time."""
    total = 0.0
    for k in range(len(values)):
        total += abs(values[k])
    # No more than half of them can be twice as large as their mean.
    low, high = np.float32(0.0), np.float32(2.0 * total / len(values))
    for _ in range(14):
        middle, below = np.float32(0.5) * (low + high), np.int32(0)
        for k in range(len(values)):
            below += np.int32(abs(values[k]) < middle)
        if 2 * below < len(values):
            low = middle
        else:
            high = middle
    lower, upper, below = np.float32(0.0), np.float32(np.inf), np.int32(0)
    for k in range(len(values)):
        size = abs(values[k])
        if size < high:
            lower = max(lower, size)
            below += np.int32(1)
        else:
            upper = min(upper, size)
    return float(lower) if 2 * below != len(values) else 0.5 * float(lower + upper)


@njit(fastmath=True)
def _normal_equations(seen: Float32Array, m: int, scale: float, sums: FloatArray) -> float:
    """Weighted sums (7, 7) of products of the rows of ``seen``, the last the residual.

    Returns the sum of truncated squares of residuals.
    """
    width, most = np.float32((CAUCHY * scale) ** -2.0), np.float32(9.0 * scale**2)
    left_over = np.float32(0.0)
    # The fifth row is one.
    s0, s1, s2, s3, s5, off, weight = seen[0], seen[1], seen[2], seen[3], seen[5], seen[6], seen[7]
    for k in range(m):
        square = off[k] * off[k]
        weight[k] = np.float32(1.0) / (np.float32(1.0) + square * width)
        left_over += min(square, most)
    for i in range(UNKNOWNS + 1):
        t0 = t1 = t2 = t3 = t4 = t5 = t6 = 0.0
        row = seen[i]
        for k in range(m):
            part = weight[k] * row[k]
            t0 += part * s0[k]
            t1 += part * s1[k]
            t2 += part * s2[k]
            t3 += part * s3[k]
            t4 += part
            t5 += part * s5[k]
            t6 += part * off[k]
        sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3] = t0, t1, t2, t3
        sums[i, 4], sums[i, 5], sums[i, 6] = t4, t5, t6
    return float(left_over)


@njit
def _invert(matrix: FloatArray) -> bool:
    """Invert a symmetric positive definite matrix in place; False where rounding has made it none."""
    n = len(matrix)
    for k in range(n):
        pivot = matrix[k, k]
        if not pivot > 0.0:
            return False
        matrix[k, k] = 1.0
        for j in range(n):
            matrix[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = matrix[i, k]
                matrix[i, k] = 0.0
                for j in range(n):
                    matrix[i, j] -= factor * matrix[k, j]
    return True


@njit
def _align(
    right: Float32Array,
    places: Float32Array,
    count: int,
    p: FloatArray,
    prior: FloatArray,
    lever: float,
    seen: Float32Array,
) -> tuple[bool, FloatArray, float]:
    """Gauss-Newton from p (6,), changed in place.

    places, count : of :func:`_places`; prior : (6,) inverse variances of p; lever : pixels, of the slope; seen :
    scratch space (SEEN, count)

    Returns whether it converged, the covariance (6, 6), and the share of the strip's variance that is explained.
    """
    sums = np.zeros((UNKNOWNS + 1, UNKNOWNS + 1))
    covariance = np.empty((UNKNOWNS, UNKNOWNS))
    for _ in range(STRIP_ROUNDS):
        m = _compare(right, places, count, p, seen)
        if m < 4 * UNKNOWNS:
            break
        scale = _median_size(seen[6, :m]) / NORMAL_QUARTILE + QUANTISATION_NOISE
        left_over = _normal_equations(seen, m, scale, sums)
        covariance[:] = sums[:UNKNOWNS, :UNKNOWNS] / scale**2
        told = sums[UNKNOWNS, :UNKNOWNS] / scale**2
        for i in range(UNKNOWNS):
            covariance[i, i] += prior[i]
            # Slopes and rows are none, and the gain is one; the disparity and the shift are where they began.
            if i > 0 and i != 4:
                told[i] += prior[i] * ((1.0 if i == 3 else 0.0) - p[i])
        if not _invert(covariance):
            break  # rounding has the last word: hardly any texture
        step = covariance @ told
        # A small share of what is known is near enough.
        limit = STRIP_CONVERGED * max(STRIP_SHARP, np.sqrt(STRIP_CORRELATION * covariance[0, 0]))
        if abs(step[0]) + lever * abs(step[1]) < limit:
            variance = np.var(seen[6, :m] + np.float32(p[3]) * seen[3, :m])
            p += step
            return True, covariance, 1.0 - left_over / m / max(variance, 1e-6)
        p += step
    return False, covariance, 0.0


@njit
def _start(strip: FloatArray, dense: Float32Array, f: float, p: FloatArray, covariance: FloatArray) -> bool:
    """Whether dense disparity is known beside an edge; it fills disparity and slope into p, by a robust line.

    dense : (h, w) reduced pixels, NaN where it is not known; f : reduced pixels a pixel; covariance : (3, 3), filled
    with that of disparity, slope and row
    """
    height, width = dense.shape
    place, value = np.empty(STRIP_STARTS * len(STRIP_ASKED)), np.empty(STRIP_STARTS * len(STRIP_ASKED))
    m = 0
    for k in range(STRIP_STARTS):
        s = strip[4] + (k + 0.5) / STRIP_STARTS * (strip[5] - strip[4])
        for asked in STRIP_ASKED:
            o = strip[6] * asked / f
            x, y = strip[0] + s * strip[2] - o * strip[3], strip[1] + s * strip[3] + o * strip[2]
            column, row = min(max(int(np.rint(x * f)), 0), width - 1), min(max(int(np.rint(y * f)), 0), height - 1)
            if np.isfinite(dense[row, column]):
                place[m], value[m] = s, dense[row, column] / f
                m += 1
    if m <= STRIP_LEAST_KNOWN * len(value):
        return False
    a, b = np.median(value[:m]), 0.0
    for _ in range(STRIP_FITS):
        n, ns, nss, v, vs = 0.0, 0.0, (STRIP_SLOPE_SIGMA * f) ** -2.0, 0.0, 0.0
        for k in range(m):
            s = place[k]
            weight = 1.0 / (1.0 + ((value[k] - a - b * s) * f) ** 2)
            n, ns, nss = n + weight, ns + weight * s, nss + weight * s * s
            v, vs = v + weight * value[k], vs + weight * value[k] * s
        determinant = n * nss - ns * ns
        a, b = (nss * v - ns * vs) / determinant, (n * vs - ns * v) / determinant
    p[0], p[1] = a, b
    # Cauchy's weights have a width of one reduced pixel.
    covariance[:] = 0.0
    covariance[0, 0], covariance[1, 1] = nss / determinant / f**2, n / determinant / f**2
    covariance[0, 1] = covariance[1, 0] = -ns / determinant / f**2
    covariance[2, 2] = STRIP_ROW_PRIOR**2 / STRIP_CORRELATION
    return True


@njit(nogil=True)
def align_strips(
    levels: tuple[tuple[Float32Array, Float32Array], ...],
    scale: FloatArray,
    dense: Float32Array,
    dense_scale: float,
    strips: FloatArray,
) -> tuple[ByteArray, FloatArray, FloatArray]:
    """Disparity of the surfaces beside edges, from strips of texture, the coarsest level first.

    levels : images of both sides, the coarsest first, the pair itself last; scale : (levels,) their pixels a pixel;
    dense, dense_scale : see :func:`_start`; strips : (n, 7) centre, direction, first and last abscissa, side

    Returns (n,) UNKNOWN, DENSE where dense disparity alone tells, ALIGNED where the images do; (n, 3) disparity at
    abscissa 0 and its slope, on the edge, and by how much the right image's rows are lower, STRIP_ROW_PRIOR about none;
    and (n, 3, 3) their covariance.
    """
    n = len(strips)
    told_by = np.full(n, UNKNOWN, np.uint8)
    value, covariance = np.zeros((n, 3)), np.zeros((n, 3, 3))
    told = np.array([0, 1, 5])
    prior = np.array(
        [
            MATCH_SIGMA**-2.0,
            STRIP_SLOPE_SIGMA**-2.0,
            STRIP_SLOPE_SIGMA**-2.0,
            STRIP_GAIN_SIGMA**-2.0,
            STRIP_SHIFT_SIGMA**-2.0,
            STRIP_ROW_PRIOR**-2.0,
        ]
    )
    room = (STRIP_SAMPLES + 2) * (STRIP_FAR - STRIP_NEAR + 1)
    places, seen = np.empty((PLACES, room), np.float32), np.empty((SEEN, room), np.float32)
    p = np.empty(UNKNOWNS)
    for e in range(n):
        p[2], p[3], p[4], p[5] = 0.0, 1.0, 0.0, 0.0
        if not _start(strips[e], dense, dense_scale, p, covariance[e]):
            continue
        # What dense disparity says by itself, which stands where no strip can be aligned.
        told_by[e], value[e, 0], value[e, 1] = DENSE, p[0], p[1]
        for level in range(len(scale)):
            f = scale[level]
            p[0] *= f
            p[5] *= f
            prior[5] = (f * STRIP_ROW_PRIOR) ** -2.0
            count = _places(levels[level][0], strips[e], f, places)
            if level == 0:
                # Grey levels first, so that a difference of exposure is no slope.
                m = _compare(levels[level][1], places, count, p, seen)
                if m > 0:
                    p[4] = np.median(seen[6, :m])
            lever = max(f * abs(strips[e, 4]), f * abs(strips[e, 5]), 1.0)
            fine, inverse, share = _align(levels[level][1], places, count, p, prior, lever, seen)
            p[0] /= f
            p[5] /= f
            if not fine or share < STRIP_LEAST_SHARE:
                break
            # The last level is that of the images themselves.
            if level == len(scale) - 1:
                told_by[e] = ALIGNED
                for i in range(3):
                    value[e, i] = p[told[i]]
                    for j in range(3):
                        covariance[e, i, j] = inverse[told[i], told[j]]
    return told_by, value, covariance
