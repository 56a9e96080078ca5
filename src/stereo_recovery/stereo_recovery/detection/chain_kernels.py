"""Compiled loops over edgels for :mod:`.chains`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, Int32Array, IntArray

from .settings import (
    CANDIDATE_EXCESS,
    LEAST_ADVANCE,
    LINK_RADIUS,
    NOISE_MAXIMUM,
    SIDESTEP,
    SIDESTEP_COST,
    SIDESTEP_SHARE,
    TURN_COSINE,
)


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


@njit(nogil=True)
def successors(
    position: FloatArray, gradient: FloatArray, magnitude: FloatArray, usable: BoolArray, height: int, width: int
) -> Int32Array:
    """For every edgel the one that follows it along its tangent; no two have the same successor.

    The cost of a step is its length plus a multiple of its distance from both tangents.

    Parameters
    ----------
    position : (n, 2) float64, pixels
    gradient : (n, 2) float64, grey levels per pixel
        From dark to bright; the bright side is on the right hand of who walks along the chain (v down).
    magnitude : (n,) float64, grey levels per pixel
        Of the gradient.
    usable : (n,) bool
        Edgels that may be linked.
    height, width : int
        Pixels. Of the image.

    Returns
    -------
    (n,) int32
        Or -1.
    """
    n = len(position)
    grid = np.full((height, width), -1, np.int32)
    chained = np.full(n, -1, np.int32)  # the next edgel in the same pixel
    for i in range(n):
        if usable[i]:
            x, y = int(position[i, 0] + 0.5), int(position[i, 1] + 0.5)
            chained[i] = grid[y, x]
            grid[y, x] = i
    best = np.full(n, -1, np.int32)
    cost = np.full(n, np.inf)
    tangent = np.empty((n, 2))
    for i in range(n):
        tangent[i, 0], tangent[i, 1] = gradient[i, 1] / magnitude[i], -gradient[i, 0] / magnitude[i]
    for i in range(n):
        if not usable[i]:
            continue
        u, v = position[i, 0], position[i, 1]
        tu, tv = tangent[i, 0], tangent[i, 1]
        x, y = int(u + 0.5), int(v + 0.5)
        # An edgel stands within half a pixel of its own pixel's centre, as this one does.
        behind = LEAST_ADVANCE - abs(tu) - abs(tv)
        for yy in range(max(y - LINK_RADIUS, 0), min(y + LINK_RADIUS + 1, height)):
            for xx in range(max(x - LINK_RADIUS, 0), min(x + LINK_RADIUS + 1, width)):
                if (xx - x) * tu + (yy - y) * tv < behind:
                    continue
                j = grid[yy, xx]
                while j >= 0:
                    du, dv = position[j, 0] - u, position[j, 1] - v
                    ahead = du * tu + dv * tv
                    if j != i and ahead > LEAST_ADVANCE:
                        su, sv = tangent[j, 0], tangent[j, 1]
                        onward = du * su + dv * sv
                        if onward > 0.0 and tu * su + tv * sv > TURN_COSINE:
                            side = abs(du * tv - dv * tu) + abs(du * sv - dv * su)
                            c = np.sqrt(du * du + dv * dv) + SIDESTEP_COST * side
                            if side < SIDESTEP + SIDESTEP_SHARE * ahead and c < cost[i]:
                                cost[i] = c
                                best[i] = j
                    j = chained[j]
    keep_cheapest(best, cost)
    return best


@njit(nogil=True)
def trace(
    following: Int32Array, magnitude: FloatArray, prominence: FloatArray, high: float, minimum: int
) -> tuple[Int32Array, IntArray, BoolArray]:
    """Chains of edgels along their successors, open ones first, that are strong somewhere.

    Parameters
    ----------
    following : (n,) int32
        Successor, or -1.
    magnitude : (n,) float64, grey levels per pixel
    prominence : (n,) float64
        By how much each magnitude exceeds that beside the edge, in sigma of its noise.
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
            if used - start < minimum or not _is_candidate(order[start:used], magnitude, prominence, high):
                used = start
                continue
            closed[chains] = loops == 1
            chains += 1
            offsets[chains] = used
    return order[:used], offsets[: chains + 1], closed[:chains]


@njit
def _is_candidate(members: AnyArray, magnitude: FloatArray, prominence: FloatArray, high: float) -> bool:
    """Whether a run of edgels is strong somewhere, and more than noise usually is."""
    strong = False
    excess = most = 0.0
    for k in range(len(members)):
        if 1 <= k < len(members) - 1 and not strong:
            strong = magnitude[members[k - 1]] + magnitude[members[k]] + magnitude[members[k + 1]] > 3.0 * high
        excess = max(0.0, excess + prominence[members[k]] - NOISE_MAXIMUM)
        most = max(most, excess)
    return strong and most > CANDIDATE_EXCESS


@njit(nogil=True)
def evidence(prominence: FloatArray, bounds: IntArray) -> FloatArray:
    """By how much runs of edgels stand out of what noise makes: the largest sum over consecutive ones.

    Parameters
    ----------
    prominence : (n,) float64
        Of edgels, in sigma of their noise.
    bounds : (k, 2) int64
        Runs [first, last).

    Returns
    -------
    (k,) float64
    """
    out = np.zeros(len(bounds))
    for k in range(len(bounds)):
        excess = 0.0
        for i in range(bounds[k, 0], bounds[k, 1]):
            excess = max(0.0, excess + prominence[i] - NOISE_MAXIMUM)
            out[k] = max(out[k], excess)
    return out


@njit(nogil=True)
def free_runs(
    covered: BoolArray, offsets: IntArray, magnitude: FloatArray, prominence: FloatArray, high: float, minimum: int
) -> tuple[IntArray, IntArray]:
    """Runs of consecutive edgels of chains that are not covered, and are edges by themselves.

    Parameters
    ----------
    covered : (n,) bool
    offsets : (m + 1,) int64
        Of the chains.
    magnitude, prominence : (n,) float64
    high : float
    minimum : int
        As in :func:`trace`.

    Returns
    -------
    order : (k,) int64
        The edgels of the runs, run after run.
    starts : (r + 1,) int64
        Run i is ``order[starts[i]:starts[i + 1]]``.
    """
    order = np.empty(len(covered), np.int64)
    starts = np.zeros(len(covered) + 1, np.int64)
    used, runs = 0, 0
    for c in range(len(offsets) - 1):
        start = used
        for k in range(offsets[c], offsets[c + 1] + 1):
            if k < offsets[c + 1] and not covered[k]:
                order[used] = k
                used += 1
            elif used > start:
                if used - start < minimum or not _is_candidate(order[start:used], magnitude, prominence, high):
                    used = start
                else:
                    runs += 1
                    starts[runs] = used
                    start = used
    return order[:used], starts[: runs + 1]
