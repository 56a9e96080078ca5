"""Compiled loops for :mod:`.splitting`: where chains are split, and which segments are collinear."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import BOUND_SIGMA, NOT_ZERO
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from .buckets import bucketed, near
from .chain_kernels import keep_cheapest
from .line_kernels import Lines, cosine_of, length_of, offset_of, point_at, regression, sine_of, variance_at
from .settings import (
    BREAK_MARGIN,
    BREAK_RANGE,
    LARGEST_BEND,
    LEAST_EDGELS,
    OFFSET_COST,
    SHORTEST_JOINED,
    SHORTEST_MOVED,
    TURN_COSINE,
    WIDEST_GAP,
    WIDEST_GAP_SHARE,
    WIDEST_OVERLAP,
)


@njit
def _fits(x: FloatArray, y: FloatArray, w: FloatArray, limit: FloatArray, a: int, b: int) -> bool:
    """Whether points a..b-1 lie within their limits of their own line."""
    cx, cy, tx, ty = regression(x, y, w, a, b)
    fits = True
    for i in range(a, b):
        if abs((x[i] - cx) * ty - (y[i] - cy) * tx) > limit[i]:
            fits = False
            break
    return fits


@njit
def _farthest(x: FloatArray, y: FloatArray, a: int, b: int) -> int:
    """The point farthest from the chord of a..b-1, at least two points from its ends."""
    dx, dy = x[b - 1] - x[a], y[b - 1] - y[a]
    norm = np.sqrt(dx * dx + dy * dy)
    best, where = -1.0, (a + b) // 2
    for i in range(a + 2, b - 2):
        if norm > NOT_ZERO:
            d = abs((x[i] - x[a]) * dy - (y[i] - y[a]) * dx) / norm
        else:
            d = np.sqrt((x[i] - x[a]) ** 2 + (y[i] - y[a]) ** 2)
        if d > best:
            best, where = d, i
    return where


@njit(nogil=True)
def split(
    x: FloatArray, y: FloatArray, limit: FloatArray, offsets: IntArray, minimum: int
) -> tuple[IntArray, IntArray]:
    """Recursive fit and segment: straight segments that cover every chain.

    Neighbouring segments that one line fits are joined again, and the break between two segments goes where their lines
    meet.

    Parameters
    ----------
    x, y : (n,) float64, pixels
        Edgels in chain order.
    limit : (n,) float64, pixels
        How far each may stand off its line.
    offsets : (m + 1,) int64
        Of the chains.
    minimum : int
        Least number of edgels in a segment.

    Returns
    -------
    bounds : (k, 2) int64
        Edgels [first, last) of each segment.
    chain : (k,) int64
        The chain of each.

    References
    ----------
    Thesis 3.10.1.
    """
    n = len(x)
    w = 1.0 / (limit * limit)
    bounds = np.empty((n // 2 + len(offsets), 2), np.int64)
    chain = np.empty(len(bounds), np.int64)
    stack = np.empty((n + 2, 2), np.int64)
    count = 0
    for k in range(len(offsets) - 1):
        first = count
        stack[0, 0], stack[0, 1] = offsets[k], offsets[k + 1]
        top = 1
        while top > 0:
            top -= 1
            a, b = stack[top, 0], stack[top, 1]
            if b - a < 2 * minimum or _fits(x, y, w, limit, a, b):
                bounds[count, 0], bounds[count, 1] = a, b
                chain[count] = k
                count += 1
            else:
                m = _farthest(x, y, a, b)
                stack[top, 0], stack[top, 1] = m, b
                stack[top + 1, 0], stack[top + 1, 1] = a, m
                top += 2
        # Join neighbours that one line fits.
        kept = first
        for i in range(first + 1, count):
            if _fits(x, y, w, limit, bounds[kept, 0], bounds[i, 1]):
                bounds[kept, 1] = bounds[i, 1]
            else:
                kept += 1
                bounds[kept, 0], bounds[kept, 1] = bounds[i, 0], bounds[i, 1]
        count = kept + 1 if count > first else count
        # Move each break to where the two lines, fitted without the doubtful points beside it, cross.
        for i in range(first, count - 1):
            a, m, b = bounds[i, 0], bounds[i, 1], bounds[i + 1, 1]
            if m - a < SHORTEST_MOVED or b - m < SHORTEST_MOVED:
                continue
            c1x, c1y, t1x, t1y = regression(x, y, w, a, max(a + LEAST_EDGELS, m - BREAK_MARGIN))
            c2x, c2y, t2x, t2y = regression(x, y, w, min(m + BREAK_MARGIN, b - LEAST_EDGELS), b)
            best, where = np.inf, m
            total = 0.0
            low, high = max(a + LEAST_EDGELS, m - BREAK_RANGE), min(b - LEAST_EDGELS, m + BREAK_RANGE)
            for j in range(low, high):
                d = (x[j] - c2x) * t2y - (y[j] - c2y) * t2x
                total += d * d
            for j in range(low, high):
                if total < best:
                    best, where = total, j
                d1 = (x[j] - c1x) * t1y - (y[j] - c1y) * t1x
                d2 = (x[j] - c2x) * t2y - (y[j] - c2y) * t2x
                total += d1 * d1 - d2 * d2
            bounds[i, 1] = where
            bounds[i + 1, 0] = where
    return bounds[:count], chain[:count]


@njit(nogil=True)
def continuations(lines: Lines, straightness: float, widest: float) -> Int32Array:
    """Which segment continues each one on the same straight line; no two are continued by the same.

    Parameters
    ----------
    lines : Lines
        Of n segments.
    straightness : float
        Pixels. Offset of real edges from a line.
    widest : float
        Pixels. Between two lines that pass for one.

    Returns
    -------
    (n,) int32
        Or -1.
    """
    n = len(lines.centre)
    successor = np.full(n, -1, np.int32)
    price = np.full(n, np.inf)
    if n == 0:
        return successor
    starts = np.empty((n, 2))
    for i in range(n):
        starts[i, 0], starts[i, 1] = point_at(lines, i, lines.extent[i, 0])
    buckets = bucketed(starts, WIDEST_GAP)
    for i in range(n):
        length = length_of(lines, i)
        if length < SHORTEST_JOINED:
            continue
        x, y = point_at(lines, i, lines.extent[i, 1])
        for k in near(buckets, x, y):
            if k == i:
                continue
            sx, sy = starts[k, 0], starts[k, 1]
            if abs(sx - x) > WIDEST_GAP or abs(sy - y) > WIDEST_GAP:
                continue
            other = length_of(lines, k)
            if other < SHORTEST_JOINED or cosine_of(lines, i, k) < TURN_COSINE:
                continue
            turn = sine_of(lines, i, k)
            slope = lines.sigma[i, 1] ** 2 + lines.sigma[k, 1] ** 2 + (straightness / min(length, other)) ** 2
            if turn * turn > min(BOUND_SIGMA * BOUND_SIGMA * slope, LARGEST_BEND * LARGEST_BEND):
                continue
            gap = (sx - x) * lines.direction[i, 0] + (sy - y) * lines.direction[i, 1]
            if gap < -WIDEST_OVERLAP or gap > min(WIDEST_GAP, WIDEST_GAP_SHARE * (length + other)):
                continue
            # The offset of the two lines in the middle of the gap.
            si, sk = lines.extent[i, 1] + 0.5 * gap, lines.extent[k, 0] - 0.5 * gap
            mx, my = point_at(lines, i, si)
            off = offset_of(lines, k, mx, my)
            variance = variance_at(lines, i, si) + variance_at(lines, k, sk) + straightness * straightness
            if off * off > min(BOUND_SIGMA * BOUND_SIGMA * variance, widest * widest):
                continue
            cost = abs(gap) + OFFSET_COST * abs(off)
            if cost < price[i]:
                price[i] = cost
                successor[i] = k
    keep_cheapest(successor, price)
    return successor


@njit(nogil=True)
def runs_of(successor: IntArray) -> tuple[IntArray, IntArray]:
    """Segments that continue each other: the first of each one's run (n,), and its place in it (n,).

    successor : (n,), or -1; what goes round without a first is no run
    """
    head, place = np.arange(len(successor)), np.zeros(len(successor), np.int64)
    preceded = np.zeros(len(successor), np.bool_)
    for k in successor:
        if k >= 0:
            preceded[k] = True
    for first in range(len(successor)):
        if preceded[first] or successor[first] < 0:
            continue
        k, count = first, 0
        while k >= 0:
            head[k], place[k] = first, count
            k, count = successor[k], count + 1
    return head, place
