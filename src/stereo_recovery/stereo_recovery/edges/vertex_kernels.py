"""Compiled loops over the ends of segments and the known corners, for :mod:`.vertices`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

# A segment runs into a corner that is this near to its line, and this far beyond or before its end, pixels and as a
# share of its length.
BESIDE, BEYOND, BEFORE, SHARE = 1.5, 10.0, 5.0, 0.5
# A pair whose line misses the corner by more than this, pixels, and so many sigma, is none; nor do edges meet that
# differ so much.
MISS = 1.2
GATE = 3.5
# What corners of straight segments miss each other by in an image, pixels.
ROUNDED = 0.25
# A line that misses a corner must come this near to it, pixels along it.
ABSENT = 7.0


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
    for k in range(n):
        cu, cv, tu, tv = table[k, 0], table[k, 1], table[k, 2], table[k, 3]
        length = table[k, 5] - table[k, 4]
        far, near = min(BEYOND, SHARE * length), min(BEFORE, SHARE * length)
        for end in range(2):
            outward = 1.0 if end == 1 else -1.0
            s = table[k, 4 + end]
            u, v = cu + s * tu, cv + s * tv
            first, least = -1, 1e30
            for q in range(m):
                du, dv = point[q, 0] - u, point[q, 1] - v
                if abs(du) > far + BESIDE or abs(dv) > far + BESIDE or own[q] == k:
                    continue
                beyond = (du * tu + dv * tv) * outward
                if beyond < far and beyond > -near and abs(dv * tu - du * tv) < BESIDE and abs(beyond) < least:
                    first, least = q, abs(beyond)
            if first < 0:
                continue
            weight, place, mean = 0.0, 0.0, 0.0
            for q in range(m):
                if _told(point, own, first, q, k):
                    w = 1.0 / sigma[q] ** 2
                    weight += w
                    mean += w * disparity[q]
                    place += w * ((point[q, 0] - cu) * tu + (point[q, 1] - cv) * tv)
            mean /= weight
            agreed = True
            for q in range(m):
                if _told(point, own, first, q, k) and abs(disparity[q] - mean) > MISS + GATE * sigma[q]:
                    agreed = False
            found[k, end] = agreed
            value[k, end, 0], value[k, end, 1], value[k, end, 2] = place / weight, mean, weight**-0.5
    return found, value


@njit
def _told(point: FloatArray, own: IntArray, first: int, q: int, k: int) -> bool:
    """Whether corner q is corner first, and not known from segment k."""
    du, dv = point[q, 0] - point[first, 0], point[q, 1] - point[first, 1]
    same: bool = abs(du) < 2.0 * BESIDE and abs(dv) < 2.0 * BESIDE and own[q] != k
    return same


@njit
def missed(
    own: IntArray,
    other: IntArray,
    found: BoolArray,
    value: FloatArray,
    table: FloatArray,
    far: FloatArray,
    edge: IntArray,
    point: FloatArray,
    sign: float,
) -> BoolArray:
    """(n,) bool: pairs that end at a corner in one image and miss it in the other.

    own, other : (n,) segments of the pairs in the one and the other image; table, far : their rows as for
    :func:`meetings`; found, value : from it, in the one image; edge (m,) ascending, point (m, 2) : the pairs that
    know a corner, and where in the one image; sign : of the disparity that leads to the other image.
    """
    wrong = np.zeros(len(own), np.bool_)
    for e in range(len(own)):
        k, j = own[e], other[e]
        low, high = np.searchsorted(edge, e), np.searchsorted(edge, e + 1)
        for end in range(2):
            if not found[k, end]:
                continue
            u = table[k, 0] + value[k, end, 0] * table[k, 2]
            v = table[k, 1] + value[k, end, 0] * table[k, 3]
            known = False
            for q in range(low, high):
                known |= np.hypot(point[q, 0] - u, point[q, 1] - v) < 2.0 * BESIDE
            if known:
                continue
            du, dv = u + sign * value[k, end, 1] - far[j, 0], v - far[j, 1]
            s = du * far[j, 2] + dv * far[j, 3]
            # A segment that stops before the corner need not lie on the line to it.
            if s < far[j, 4] - ABSENT or s > far[j, 5] + ABSENT:
                continue
            variance = (value[k, end, 2] * far[j, 3]) ** 2 + far[j, 6] ** 2 + (far[j, 7] * s) ** 2 + ROUNDED**2
            if abs(dv * far[j, 2] - du * far[j, 3]) > max(MISS, GATE * np.sqrt(variance)):
                wrong[e] = True
    return wrong
