"""Compiled search for rounded corners: lines of two edges that cross beyond their chains, in both images."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .settings import ROUNDED_GAP, ROUNDED_OVERRUN, ROUNDED_SHARE, ROUNDED_SINE


@njit
def _gap(first: float, last: float, at: float, end: int) -> float:
    """How far, pixels, a place is beyond an end (0 or 1) of what reaches from first to last; inf if too far."""
    beyond = first - at if end == 0 else at - last
    most = min(ROUNDED_GAP, ROUNDED_SHARE * (last - first))
    return beyond if -ROUNDED_OVERRUN < beyond < most else np.inf


@njit
def rounded_corners(
    tables: tuple[FloatArray, FloatArray], index: tuple[IntArray, IntArray], flip: BoolArray, loose: BoolArray
) -> tuple[IntArray, FloatArray]:
    """The nearest rounded corner at each loose end of n edges.

    tables : (m, 8) float64 of both images, see :func:`.segments.line_table`; index : (n,) the edges' segments; flip :
    (n,) whether the right segment runs the other way; loose : (n, 2) ends of left segments that meet nothing

    Returns (k, 2) the two edges and (k, 2) where they cross, pixels of the left image.
    """
    n = len(flip)
    pair, point = np.empty((2 * n, 2), np.int64), np.empty((2 * n, 2))
    count = 0
    for e in range(n):
        for end in range(2):
            if not loose[e, end]:
                continue
            least, found = np.inf, -1
            for f in range(n):
                for its in range(2):
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
            if found >= 0:
                pair[count, 0], pair[count, 1] = e, found
                count += 1
    return pair[:count].copy(), point[:count].copy()
