"""Compiled loops over the ends of segments and the known corners, for :mod:`.junction_edges`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray
from msgs_py.settings import BOUND_SIGMA

from ..detection.buckets import bucketed, near
from ..estimation.settings import END_SHARE, SAME_PLACE
from .settings import BEFORE, BEYOND


@njit
def meetings(
    table: FloatArray, point: FloatArray, disparity: FloatArray, sigma: FloatArray, own: IntArray
) -> tuple[BoolArray, FloatArray]:
    """The corners in space that segments of one image run into, by what other edges know of them.

    table : (n, 8) float64 rows of segments: centre u, v; direction; first and last place; sigma of offset and slope
    point (m, 2), disparity, sigma (m,) : the corners; own : (m,) the segment of the edge that knows it
    Returns found (n, 2) bool, for both ends of each segment, and place, disparity, sigma in value (n, 2, 3).
    """
    n, m = len(table), len(point)
    found = np.zeros((n, 2), np.bool_)
    value = np.zeros((n, 2, 3))
    if m == 0:
        return found, value
    buckets = bucketed(point, max(BEYOND + SAME_PLACE, 2.0 * SAME_PLACE))
    for k in range(n):
        cu, cv, tu, tv = table[k, 0], table[k, 1], table[k, 2], table[k, 3]
        length = table[k, 5] - table[k, 4]
        far, before = min(BEYOND, END_SHARE * length), min(BEFORE, END_SHARE * length)
        for end in range(2):
            outward = 1.0 if end == 1 else -1.0
            s = table[k, 4 + end]
            u, v = cu + s * tu, cv + s * tv
            first, least = -1, 1e30
            for q in near(buckets, u, v):
                du, dv = point[q, 0] - u, point[q, 1] - v
                if abs(du) > far + SAME_PLACE or abs(dv) > far + SAME_PLACE or own[q] == k:
                    continue
                beyond = (du * tu + dv * tv) * outward
                if beyond < far and beyond > -before and abs(dv * tu - du * tv) < SAME_PLACE and abs(beyond) < least:
                    first, least = q, abs(beyond)
            if first < 0:
                continue
            weight, place, mean = 0.0, 0.0, 0.0
            close = near(buckets, point[first, 0], point[first, 1])
            for q in close:
                if _told(point, own, first, q, k):
                    w = 1.0 / sigma[q] ** 2
                    weight += w
                    mean += w * disparity[q]
                    place += w * ((point[q, 0] - cu) * tu + (point[q, 1] - cv) * tv)
            mean /= weight
            agreed = True
            for q in close:
                if _told(point, own, first, q, k) and abs(disparity[q] - mean) > SAME_PLACE + BOUND_SIGMA * sigma[q]:
                    agreed = False
            found[k, end] = agreed
            value[k, end, 0], value[k, end, 1], value[k, end, 2] = place / weight, mean, weight**-0.5
    return found, value


@njit
def _told(point: FloatArray, own: IntArray, first: int, q: int, k: int) -> bool:
    """Whether corner q is corner first, and not known from segment k."""
    du, dv = point[q, 0] - point[first, 0], point[q, 1] - point[first, 1]
    same: bool = abs(du) < 2.0 * SAME_PLACE and abs(dv) < 2.0 * SAME_PLACE and own[q] != k
    return same
