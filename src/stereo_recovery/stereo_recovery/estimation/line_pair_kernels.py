"""Compiled search for pairs of lines that belong together in both images: rounded corners, and broken lines."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.buckets import Buckets, bucketed, near
from .settings import COLLINEAR_GAP, COLLINEAR_SINE, END_SHARE, LOOSE_END_SIGMA, ROUNDED_GAP, ROUNDED_SINE, SAME_PLACE

# px: cells in which ends are looked for that continue a segment.
CELL = 16.0


@njit
def _gap(first: float, last: float, at: float, end: int) -> float:
    """How far, pixels, a place is beyond an end (0 or 1) of what reaches from first to last; inf if too far."""
    beyond = first - at if end == 0 else at - last
    most = min(ROUNDED_GAP, END_SHARE * (last - first))
    return beyond if -LOOSE_END_SIGMA < beyond < most else np.inf


@njit
def _left_ends(table: FloatArray, index: IntArray) -> FloatArray:
    """(2 n, 2) pixels: first and last end of each edge's segment in one image."""
    ends = np.empty((2 * len(index), 2))
    for e in range(len(index)):
        row = table[index[e]]
        for end in range(2):
            ends[2 * e + end, 0] = row[0] + row[4 + end] * row[2]
            ends[2 * e + end, 1] = row[1] + row[4 + end] * row[3]
    return ends


@njit
def rounded_corners(
    tables: tuple[FloatArray, FloatArray], index: tuple[IntArray, IntArray], flip: BoolArray, loose: BoolArray
) -> tuple[IntArray, FloatArray]:
    """The nearest rounded corner at each loose end of n edges; one that is the nearest of both its ends is one corner.

    tables : (m, 8) float64 of both images, see :func:`.segments.line_table`; index : (n,) the edges' segments; flip :
    (n,) whether the right segment runs the other way; loose : (n, 2) ends of left segments that meet nothing

    Returns (k, 2) the two edges and (k, 2) where they cross, pixels of the left image.
    """
    n = len(flip)
    pair, point = np.empty((2 * n, 2), np.int64), np.empty((2 * n, 2))
    # The other edge at each loose end's corner.
    met = np.full((n, 2), -1)
    count = 0
    if n == 0:
        return pair, point
    ends = _left_ends(tables[0], index[0])
    # Neither end is farther from the crossing than the gap.
    buckets = bucketed(ends, 2.0 * max(ROUNDED_GAP, LOOSE_END_SIGMA))
    for e in range(n):
        for end in range(2):
            if not loose[e, end]:
                continue
            least, found = np.inf, -1
            for one in near(buckets, ends[2 * e + end, 0], ends[2 * e + end, 1]):
                f, its = one // 2, one % 2
                total, u, v = 0.0, 0.0, 0.0
                for image in range(2):
                    a, b = tables[image][index[image][e]], tables[image][index[image][f]]
                    sine = a[2] * b[3] - a[3] * b[2]
                    if abs(sine) < ROUNDED_SINE:
                        total = np.inf
                        break
                    du, dv = b[0] - a[0], b[1] - a[1]
                    s, r = (du * b[3] - dv * b[2]) / sine, (du * a[3] - dv * a[2]) / sine
                    turned = image == 1
                    total += _gap(a[4], a[5], s, 1 - end if turned and flip[e] else end)
                    total += _gap(b[4], b[5], r, 1 - its if turned and flip[f] else its)
                    if not total < least:
                        break
                    if image == 0:
                        u, v = a[0] + s * a[2], a[1] + s * a[3]
                if total < least:
                    least, found = total, f
                    point[count, 0], point[count, 1] = u, v
            met[e, end] = found
            if found >= 0 and not (found < e and (met[found] == e).any()) and not (end == 1 and met[e, 0] == found):
                pair[count, 0], pair[count, 1] = e, found
                count += 1
    return pair[:count].copy(), point[:count].copy()


@njit
def _offset(a: FloatArray, u: float, v: float) -> float:
    """Distance, pixels, of a point from a line."""
    return float(abs((u - a[0]) * a[3] - (v - a[1]) * a[2]))


@njit
def _facing(a: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Abscissas of the ends of two segments of nearly one direction that are nearest to each other."""
    way = 1.0 if (b[0] - a[0]) * a[2] + (b[1] - a[1]) * a[3] > 0.0 else -1.0
    its = way if a[2] * b[2] + a[3] * b[3] > 0.0 else -way
    return a[5] if way > 0.0 else a[4], b[4] if its > 0.0 else b[5]


@njit
def _continuing(row: FloatArray, buckets: Buckets) -> IntArray:
    """Edges, each once and in rising order, one of whose ends may face an end of this segment across a gap.

    row : (8,) of the left image, see :func:`.segments.line_table`; buckets : of all ends, see :func:`_left_ends`
    """
    reach = COLLINEAR_GAP * (row[5] - row[4]) + SAME_PLACE
    steps = int(reach / buckets.size) + 1
    found = np.empty(0, np.int64)
    for outward in (-1.0, 1.0):
        for step in range(steps + 1):
            s = (row[5] if outward > 0.0 else row[4]) + outward * (step * reach / steps)
            found = np.concatenate((found, near(buckets, row[0] + s * row[2], row[1] + s * row[3]) // 2))
    return np.unique(found)


@njit
def collinear_pairs(
    tables: tuple[FloatArray, FloatArray], index: tuple[IntArray, IntArray], eligible: BoolArray
) -> tuple[IntArray, FloatArray]:
    """Edges that continue each other in the left image, and lie on one line in the right one.

    tables, index : as in :func:`rounded_corners`; eligible : (n,) edges that may be parts of another

    Returns (k, 2) the two edges and (k, 2, 2) their middles, pixels of the left image.
    """
    n = len(eligible)
    size = 64
    pair, point = np.empty((size, 2), np.int64), np.empty((size, 2, 2))
    count = 0
    if n == 0:
        return pair[:0], point[:0]
    buckets = bucketed(_left_ends(tables[0], index[0]), CELL)
    for e in range(n):
        if not eligible[e]:
            continue
        for f in _continuing(tables[0][index[0][e]], buckets):
            if f <= e or not eligible[f] or index[0][e] == index[0][f]:
                continue
            good = True
            for image in range(2):
                a, b = tables[image][index[image][e]], tables[image][index[image][f]]
                if abs(a[2] * b[3] - a[3] * b[2]) > COLLINEAR_SINE:
                    good = False
                    break
                s, r = _facing(a, b)
                u, v = a[0] + s * a[2], a[1] + s * a[3]
                p, q = b[0] + r * b[2], b[1] + r * b[3]
                most = SAME_PLACE
                along = (p - u) * a[2] + (q - v) * a[3]
                gap = along if s == a[5] else -along
                if image == 0:
                    if gap < -SAME_PLACE or gap > COLLINEAR_GAP * min(a[5] - a[4], b[5] - b[4]):
                        good = False
                        break
                    if count == size:
                        size *= 2
                        pair = np.concatenate((pair, np.empty_like(pair)))
                        point = np.concatenate((point, np.empty_like(point)))
                    for c in range(2):
                        point[count, 0, c] = a[c] + 0.5 * (a[4] + a[5]) * a[2 + c]
                        point[count, 1, c] = b[c] + 0.5 * (b[4] + b[5]) * b[2 + c]
                else:
                    # What is matched there need not be the next part.
                    most += COLLINEAR_SINE * max(gap, 0.0)
                if max(_offset(a, p, q), _offset(b, u, v)) > most:
                    good = False
                    break
            if good:
                pair[count, 0], pair[count, 1] = e, f
                count += 1
    return pair[:count].copy(), point[:count].copy()
