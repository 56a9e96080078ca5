"""Compiled loops over pairs of edges that may be parts of one, for :mod:`.joining`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, IntArray
from msgs_py.settings import BOUND_SIGMA

from ..matching.settings import AT_GAP, PARTS_MISS
from .settings import GAP_OFFSET, GAP_SHARE


@njit
def contrast_across(grey: Float32Array, start: FloatArray, end: FloatArray) -> float:
    """Mean difference of grey levels (h, w) across the line between two places (2,), pixels."""
    u, v = end[0] - start[0], end[1] - start[1]
    length = max(np.hypot(u, v), 1.0)
    height, width = grey.shape
    count, total = int(length) + 1, 0.0
    for side in range(2):
        away = (GAP_OFFSET if side == 0 else -GAP_OFFSET) / length
        for k in range(count):
            share = (k + 0.5) / count
            x, y = start[0] + share * u - away * v, start[1] + share * v + away * u
            column, row = min(max(int(np.rint(x)), 0), width - 1), min(max(int(np.rint(y)), 0), height - 1)
            total += grey[row, column] if side == 0 else -grey[row, column]
    return float(total / count)


@njit
def same_contrast(own: float, other: float) -> bool:
    """Whether a place has the contrast, grey levels, that an edge has: its sign, and a share of it."""
    return bool(own * other > 0.0 and abs(other) > GAP_SHARE * abs(own))


@njit
def go_on(grey: Float32Array, pixel: FloatArray, pairs: IntArray) -> BoolArray:
    """(k,) bool: whether the picture between the edges of pairs (k, 2) has the contrast that they have.

    pixel : (n, 2, 2) ends of the edges
    """
    own = np.empty(len(pixel))
    for e in range(len(pixel)):
        own[e] = contrast_across(grey, pixel[e, 0], pixel[e, 1])
    result = np.zeros(len(pairs), np.bool_)
    for k in range(len(pairs)):
        e, f = pairs[k]
        (u, v), (x, y) = pixel[f, 0] - pixel[e, 1], pixel[e, 1] - pixel[e, 0]
        if np.hypot(u, v) < AT_GAP or u * x + v * y < 0.0:
            result[k] = True
            continue
        weaker = own[e] if abs(own[e]) < abs(own[f]) else own[f]
        result[k] = same_contrast(weaker, contrast_across(grey, pixel[e, 1], pixel[f, 0]))
    return result


@njit
def groups(pixel: FloatArray, disparity: FloatArray, sigma: FloatArray, pairs: IntArray) -> IntArray:
    """(n,) int64: the first of the edges that each is one with; pairs (k, 2) are made one in their order.

    pixel : (n, 2, 2) ends of the edges; disparity, sigma : (n, 2) there
    """
    count = len(pixel)
    group, following = np.arange(count), np.full(count, -1)
    for k in range(len(pairs)):
        first, second = min(group[pairs[k, 0]], group[pairs[k, 1]]), max(group[pairs[k, 0]], group[pairs[k, 1]])
        if first == second:
            continue
        members = np.empty(count, np.int64)
        total, last = 0, first
        for head in (first, second):
            m = head
            while m >= 0:
                members[total] = m
                total += 1
                if head == first:
                    last = m
                m = following[m]
        if _one_line(pixel, disparity, sigma, members[:total]):
            following[last] = second
            group[members[:total]] = first
    return group


@njit
def _one_line(pixel: FloatArray, disparity: FloatArray, sigma: FloatArray, members: IntArray) -> bool:
    """Whether edges lie on one line in both images, and their disparities on one along it; as for :func:`groups`."""
    along = np.zeros((len(members), 2))
    for left in (False, True):
        # Sums by the edges' lengths: of places, and of their products about the mean.
        weight, mu, mv = 0.0, 0.0, 0.0
        for m in members:
            w = np.hypot(pixel[m, 1, 0] - pixel[m, 0, 0], pixel[m, 1, 1] - pixel[m, 0, 1])
            for e in range(2):
                weight += w
                mu += w * (pixel[m, e, 0] if left else pixel[m, e, 0] - disparity[m, e])
                mv += w * pixel[m, e, 1]
        mu, mv = mu / weight, mv / weight
        uu, uv, vv = 0.0, 0.0, 0.0
        for m in members:
            w = np.hypot(pixel[m, 1, 0] - pixel[m, 0, 0], pixel[m, 1, 1] - pixel[m, 0, 1])
            for e in range(2):
                u, v = (pixel[m, e, 0] if left else pixel[m, e, 0] - disparity[m, e]) - mu, pixel[m, e, 1] - mv
                uu, uv, vv = uu + w * u * u, uv + w * u * v, vv + w * v * v
        turn = 0.5 * np.arctan2(2.0 * uv, uu - vv)
        tu, tv = np.cos(turn), np.sin(turn)
        for k in range(len(members)):
            m = members[k]
            for e in range(2):
                u, v = (pixel[m, e, 0] if left else pixel[m, e, 0] - disparity[m, e]) - mu, pixel[m, e, 1] - mv
                if abs(v * tu - u * tv) > PARTS_MISS:
                    return False
                along[k, e] = u * tu + v * tv
    n, ns, nss, d, ds = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(members)):
        for e in range(2):
            w, s = sigma[members[k], e] ** -2.0, along[k, e]
            n, ns, nss = n + w, ns + w * s, nss + w * s * s
            d, ds = d + w * disparity[members[k], e], ds + w * s * disparity[members[k], e]
    determinant = n * nss - ns * ns
    a, b = (nss * d - ns * ds) / determinant, (n * ds - ns * d) / determinant
    for k in range(len(members)):
        for e in range(2):
            if abs(disparity[members[k], e] - a - b * along[k, e]) > BOUND_SIGMA * sigma[members[k], e]:
                return False
    return True
