"""Compiled search for the edgels of a curve among all of an image."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import CORNER_EDGELS, LEAST_CURVE_EDGELS, RUN_GAP


@njit
def boxes(position: FloatArray) -> FloatArray:
    """(b, 6) float64: least and largest column and row, pixels, of edgels in a row, and which, [first, last).

    position : (n, 2) pixels, in the order of chains, so that those in a row are near each other
    """
    count = (len(position) + 63) // 64
    out = np.empty((count, 6))
    for k in range(count):
        first, last = 64 * k, min(64 * (k + 1), len(position))
        u, v = position[first:last, 0], position[first:last, 1]
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = u.min(), v.min(), u.max(), v.max()
        out[k, 4], out[k, 5] = first, last
    return out


@njit
def on_conic(
    conic: FloatArray,
    position: FloatArray,
    direction: FloatArray,
    around: FloatArray,
    most: FloatArray,
    least_cosine: float,
) -> IntArray:
    """(k,) int64: edgels near a conic, whose gradients are square to it up to an angle of this cosine.

    conic : (3, 3), symmetric; position : (n, 2) pixels; direction : (n,) radians, of the gradients; around : of
    :func:`boxes`; most : (n,) pixels, that each may be off
    """
    belongs = np.empty(len(position), np.int64)
    count = 0
    left, top, right, bottom = _box(conic, most.max() if len(most) else 0.0)
    for b in range(len(around)):
        if around[b, 2] < left or around[b, 0] > right or around[b, 3] < top or around[b, 1] > bottom:
            continue
        for k in range(int(around[b, 4]), int(around[b, 5])):
            x, y = position[k, 0], position[k, 1]
            if x < left or x > right or y < top or y > bottom:
                continue
            # Half the conic's gradient, and its value, to first order their ratio times two is the distance.
            gx = conic[0, 0] * x + conic[1, 0] * y + conic[2, 0]
            gy = conic[0, 1] * x + conic[1, 1] * y + conic[2, 1]
            value = gx * x + gy * y + conic[0, 2] * x + conic[1, 2] * y + conic[2, 2]
            square = gx * gx + gy * gy
            if value * value >= (2.0 * most[k]) ** 2 * max(square, NOT_ZERO**2):
                continue
            cosine = abs(gx * np.cos(direction[k]) + gy * np.sin(direction[k]))
            if cosine > least_cosine * np.sqrt(square):
                belongs[count] = k
                count += 1
    return belongs[:count].copy()


@njit
def _box(conic: FloatArray, most: float) -> tuple[float, float, float, float]:
    """Least and largest column and row, pixels, of what is nearer than this to an ellipse; all, of another conic."""
    a, b, c = conic[0, 0], conic[0, 1], conic[1, 1]
    d, e, f = conic[0, 2], conic[1, 2], conic[2, 2]
    block = a * c - b * b
    if not block > 0.0:
        return -np.inf, -np.inf, np.inf, np.inf
    u, v = (b * e - c * d) / block, (b * d - a * e) / block
    level = max(-(d * u + e * v + f), 0.0) / block
    # Twice the distance, which is one to first order.
    wide, high = np.sqrt(level * c) + 2.0 * most, np.sqrt(level * a) + 2.0 * most
    return u - wide, v - high, u + wide, v + high


@njit
def without_ends(index: IntArray, position: FloatArray) -> IntArray:
    """(k,) int64: edgels (m,), ascending, whose runs of neighbours in chain order have lost CORNER_EDGELS at both ends.

    Short runs go altogether. position : (n, 2) pixels
    """
    kept = np.empty(len(index), np.int64)
    count, first = 0, 0
    if len(index) < 2:
        return kept[:0]
    for k in range(1, len(index) + 1):
        if k < len(index) and index[k] == index[k - 1] + 1 and _step(position, index[k - 1], index[k]) <= RUN_GAP:
            continue
        closed = k - first > LEAST_CURVE_EDGELS and _step(position, index[first], index[k - 1]) < RUN_GAP
        cut = 0 if closed else CORNER_EDGELS
        for m in range(first + cut, k - cut):
            kept[count] = index[m]
            count += 1
        first = k
    return kept[:count]


@njit
def _step(position: FloatArray, a: int, b: int) -> float:
    """Distance of two edgels, pixels."""
    return float(np.hypot(position[a, 0] - position[b, 0], position[a, 1] - position[b, 1]))
