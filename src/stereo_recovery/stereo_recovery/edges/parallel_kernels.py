"""Compiled loop over pairs of edges for :mod:`.parallels`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray


@njit
def parallel(
    edges: IntArray,
    able: BoolArray,
    lenders: IntArray,
    centre: FloatArray,
    direction: FloatArray,
    own: FloatArray,
    covariance: FloatArray,
    slope_sigma: FloatArray,
    gate: float,
    wander: float,
    slope_wander: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Which lenders an edge is parallel to in the image, and what they say of its depth.

    edges : (m,), lenders : (k,) numbers of edges; able : (m, k) bool, pairs to be looked at; centre, direction (n, 2)
    in the image; own (n, 2), covariance : (n, 2, 2) coefficients of disparity, from that of infinitely far points;
    slope_sigma : (n,) sigma of the direction; gate : sigma; wander, slope_wander : see :mod:`.parallels`

    Returns start (m + 1,), where each edge's lenders begin, and of each: ratio, noise. own @ (ratio, 1) is
    nil for parallel edges, with the variance noise.
    """
    start = np.zeros(len(edges) + 1, np.int64)
    size = 1024
    ratios, noises = np.empty(size), np.empty(size)
    count = 0
    for m in range(len(edges)):
        f = edges[m]
        tx, ty = direction[f, 0], direction[f, 1]
        here = own[f, 0]
        for k in range(len(lenders)):
            if not able[m, k]:
                continue
            q = lenders[k]
            # Towards the lender's vanishing point, homogeneous; and how that moves with the lender's coefficients.
            ax, ay = centre[q, 0] - centre[f, 0], centre[q, 1] - centre[f, 1]
            ux, uy = direction[q, 0], direction[q, 1]
            a, b = own[q, 0], own[q, 1]
            vx, vy = b * ax - a * ux, b * ay - a * uy
            norm = max(np.hypot(vx, vy), 1e-9)
            along = vx * tx + vy * ty
            if not abs(along) > 0.5 * norm:
                continue
            miss = (vy * tx - vx * ty) / norm
            c00, c01, c11 = covariance[q, 0, 0], 0.5 * (covariance[q, 0, 1] + covariance[q, 1, 0]), covariance[q, 1, 1]
            bend0, bend1 = (ux * ty - uy * tx) / norm, (ay * tx - ax * ty) / norm
            variance = (
                c00 * bend0 * bend0
                + 2.0 * c01 * bend0 * bend1
                + c11 * bend1 * bend1
                + slope_sigma[q] ** 2
                + slope_sigma[f] ** 2
                + wander * wander
            )
            if not miss * miss < gate * gate * variance:
                continue
            # Disparity is nil at the vanishing point.
            ratio = b / along
            turn0 = here * ratio * (ux * tx + uy * ty) / along
            turn1 = here * (1.0 - ratio * (ax * tx + ay * ty)) / along
            if count == size:
                ratios, noises = np.append(ratios, np.empty_like(ratios)), np.append(noises, np.empty_like(noises))
                size *= 2
            ratios[count] = ratio
            noises[count] = (
                c00 * turn0 * turn0 + 2.0 * c01 * turn0 * turn1 + c11 * turn1 * turn1 + (slope_wander * here) ** 2
            )
            count += 1
        start[m + 1] = count
    return start, ratios[:count], noises[:count]
