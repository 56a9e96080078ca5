"""Compiled loops over edgels for :mod:`.chains`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from .settings import LEAST_ADVANCE, LINK_RADIUS, SIDESTEP, SIDESTEP_COST, SIDESTEP_SHARE, TURN_COSINE


@njit
def keep_cheapest(successor: Int32Array, cost: FloatArray) -> None:
    """Of all that have the same successor, the one with the least cost keeps it; the others get -1, in place.

    Parameters
    ----------
    successor : (n,) int32
        Or -1.
    cost : (n,) float64
    """
    taken = np.full(len(successor), -1, np.int32)
    for i in range(len(successor)):
        j = successor[i]
        if j >= 0 and (taken[j] < 0 or cost[i] < cost[taken[j]]):
            taken[j] = i
    for i in range(len(successor)):
        if successor[i] >= 0 and taken[successor[i]] != i:
            successor[i] = -1


@njit
def successors(
    u: FloatArray, v: FloatArray, tu: FloatArray, tv: FloatArray, magnitude: FloatArray, height: int, width: int
) -> Int32Array:
    """For every edgel the one that follows it along its tangent; no two have the same successor.

    The cost of a step is its length plus a multiple of its distance from both tangents.

    Parameters
    ----------
    u, v : (n,) float64, pixels
        Position.
    tu, tv : (n,) float64
        Unit tangent.
    magnitude : (n,) float64, grey levels per pixel
    height, width : int
        Pixels. Of the image.

    Returns
    -------
    (n,) int32
        Or -1.
    """
    n = len(u)
    grid = np.full((height, width), -1, np.int32)
    chained = np.full(n, -1, np.int32)  # the next edgel in the same pixel
    for i in range(n):
        x, y = int(u[i] + 0.5), int(v[i] + 0.5)
        chained[i] = grid[y, x]
        grid[y, x] = i
    best = np.full(n, -1, np.int32)
    cost = np.full(n, np.inf)
    for i in range(n):
        x, y = int(u[i] + 0.5), int(v[i] + 0.5)
        for dy in range(-LINK_RADIUS, LINK_RADIUS + 1):
            for dx in range(-LINK_RADIUS, LINK_RADIUS + 1):
                yy, xx = y + dy, x + dx
                if yy < 0 or xx < 0 or yy >= height or xx >= width:
                    continue
                j = grid[yy, xx]
                while j >= 0:
                    if j != i:
                        du, dv = u[j] - u[i], v[j] - v[i]
                        ahead = du * tu[i] + dv * tv[i]
                        onward = du * tu[j] + dv * tv[j]
                        turn = tu[i] * tu[j] + tv[i] * tv[j]
                        if ahead > LEAST_ADVANCE and onward > 0.0 and turn > TURN_COSINE:
                            side = abs(du * tv[i] - dv * tu[i]) + abs(du * tv[j] - dv * tu[j])
                            c = np.sqrt(du * du + dv * dv) + SIDESTEP_COST * side
                            if side < SIDESTEP + SIDESTEP_SHARE * ahead and c < cost[i]:
                                cost[i] = c
                                best[i] = j
                    j = chained[j]
    keep_cheapest(best, cost)
    return best


@njit
def trace(
    following: Int32Array, magnitude: FloatArray, high: float, minimum: int
) -> tuple[Int32Array, IntArray, BoolArray]:
    """Chains of edgels along their successors, open ones first.

    Parameters
    ----------
    following : (n,) int32
        Successor, or -1.
    magnitude : (n,) float64, grey levels per pixel
    high : float
        Grey levels per pixel. Least mean of three consecutive magnitudes somewhere in a chain.
    minimum : int
        Least number of edgels in a chain.

    Returns
    -------
    order : (k,) int32
        The edgels of the kept chains, chain after chain.
    offsets : (m + 1,) int64
    closed : (m,) bool
        As in :class:`.chains.EdgeChains`.
    """
    n = len(following)
    preceded = np.zeros(n, np.bool_)
    for i in range(n):
        if following[i] >= 0:
            preceded[following[i]] = True
    done = np.zeros(n, np.bool_)
    order = np.empty(n, np.int32)
    offsets = np.zeros(n + 1, np.int64)
    closed = np.zeros(n, np.bool_)
    used, chains = 0, 0
    for loops in range(2):
        for first in range(n):
            if done[first] or (loops == 0 and preceded[first]):
                continue
            i, start = first, used
            while i >= 0 and not done[i]:
                done[i] = True
                order[used] = i
                used += 1
                i = following[i]
            strong = False
            for k in range(start + 1, used - 1):
                if magnitude[order[k - 1]] + magnitude[order[k]] + magnitude[order[k + 1]] > 3.0 * high:
                    strong = True
                    break
            if used - start < minimum or not strong:
                used = start
                continue
            closed[chains] = loops == 1
            chains += 1
            offsets[chains] = used
    return order[:used], offsets[: chains + 1], closed[:chains]
