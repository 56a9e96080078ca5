"""Compiled belief propagation over candidate pairs of segments.

Candidates stand in ``node`` (k, 2) and ``value`` (k, 9), as :func:`.candidate_kernels.candidates` returns them, ordered
by left segment. Lists of candidates are a start (n + 1,) and the items from one start to the next.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from ..detection.buckets import Buckets, in_cell, swept
from .candidate_kernels import SegmentTable
from .settings import (
    BESIDE,
    CORNER_SPREAD,
    DISPARITY_GRADIENT,
    DISPARITY_SPREAD,
    INDEPENDENT_NEIGHBOURS,
    LEAST_BESIDE,
    LEVEL,
    LONG_NEIGHBOUR,
    NEAR_NEIGHBOUR,
    NEARER_LOG_ODDS,
    NEIGHBOURS,
    ONE_LINE,
    SAME_PART,
    SUPPORT_REACH,
)

# px: least side of the cells in which neighbours are looked for.
LEAST_CELL = 32.0


class Neighbours(NamedTuple):
    """The neighbours of n segments of one image, (n, NEIGHBOURS) each.

    other : int32, segment, or -1; gap : pixels between the nearest of start, middle and end of the two; share : (n,
    NEIGHBOURS, 2), where along either these are, 0..1, or their corner; meets : whether they have one; worth : of how
    many independent neighbours, 0..1
    """

    other: Int32Array
    gap: FloatArray
    share: FloatArray
    meets: BoolArray
    worth: FloatArray


class CandidateLists(NamedTuple):
    """Where each left segment's candidates are, and each right segment's.

    first : (n + 1,); right_of : (k,) candidates by right segment; right_first : (m + 1,) places in it
    """

    first: IntArray
    right_of: IntArray
    right_first: IntArray


class Support(NamedTuple):
    """What candidates of neighbours say of each candidate: a neighbour's ones are a group.

    start : (k + 1,) groups of each candidate; column : (g,) of ``Neighbours.other``; first : (g + 1,) supporters of
    each group; who, ratio : candidates, and how much likelier their disparity is beside this one than at random
    """

    start: IntArray
    column: IntArray
    first: IntArray
    who: Int32Array
    ratio: FloatArray


# Of each candidate the rivals: start, candidate, odds.
Rivals: TypeAlias = tuple[IntArray, Int32Array, FloatArray]


@njit
def _meet(met: Int32Array, i: int, k: int) -> bool:
    """Whether an end of segment i or of k is a corner of the two."""
    return bool(met[i, 0] == k or met[i, 1] == k or met[k, 0] == i or met[k, 1] == i)


@njit
def _crossing(table: SegmentTable, i: int, k: int, share: FloatArray) -> None:
    """Put where the lines of two segments cross, 0..1 from start to end of each, into share (2,)."""
    pu, pv = table.end[i, 0] - table.start[i, 0], table.end[i, 1] - table.start[i, 1]
    qu, qv = table.end[k, 0] - table.start[k, 0], table.end[k, 1] - table.start[k, 1]
    away_u, away_v = table.start[k, 0] - table.start[i, 0], table.start[k, 1] - table.start[i, 1]
    sine = pu * qv - pv * qu
    if sine != 0.0:
        share[0], share[1] = (away_u * qv - away_v * qu) / sine, (away_u * pv - away_v * pu) / sine


@njit
def _disparity(value: FloatArray, a: int, share: float) -> float:
    """Disparity, pixels, of candidate a at this place between start and end."""
    return float(value[a, 0] + share * (value[a, 2] - value[a, 0]))


@njit
def _near_any(cells: Buckets, points: FloatArray, out: IntArray) -> int:
    """Put what the cells of three points (3, 2) have into ``out``, each once, in rising order; how many there are."""
    a = in_cell(cells, points[0, 0], points[0, 1])
    b = in_cell(cells, points[1, 0], points[1, 1])
    c = in_cell(cells, points[2, 0], points[2, 1])
    p, q, r, count = 0, 0, 0, 0
    while p < len(a) or q < len(b) or r < len(c):
        least = a[p] if p < len(a) else len(out)
        least = min(least, b[q]) if q < len(b) else least
        least = min(least, c[r]) if r < len(c) else least
        p += p < len(a) and a[p] == least
        q += q < len(b) and b[q] == least
        r += r < len(c) and c[r] == least
        out[count] = least
        count += 1
    return count


@njit(nogil=True)
def neighbours(table: SegmentTable, met: Int32Array, radius: float) -> Neighbours:
    """The NEIGHBOURS of each segment within ``radius`` pixels that weigh most: long ones that are near.

    met : (n, 2) segments that the ends meet, or -1. They share a point, and count as independent each.
    """
    n = len(table.start)
    found = Neighbours(
        np.full((n, NEIGHBOURS), -1, np.int32),
        np.zeros((n, NEIGHBOURS)),
        np.zeros((n, NEIGHBOURS, 2)),
        np.zeros((n, NEIGHBOURS), np.bool_),
        np.zeros((n, NEIGHBOURS)),
    )
    points, length = np.empty((n, 3, 2)), np.empty(n)
    for i in range(n):
        points[i, 0], points[i, 2] = table.start[i], table.end[i]
        points[i, 1] = 0.5 * (table.start[i] + table.end[i])
        length[i] = np.hypot(table.end[i, 0] - table.start[i, 0], table.end[i, 1] - table.start[i, 1])
    order = np.argsort(points[:, 1, 1])
    cells = swept(points[order, 0], points[order, 2], radius, max(radius, LEAST_CELL))
    close = np.empty(n, np.int64)
    for i in range(n):
        for rank in close[: _near_any(cells, points[i], close)]:
            k = order[rank]
            between = radius + 0.5 * (length[i] + length[k])
            if (
                k == i
                or abs(points[k, 1, 0] - points[i, 1, 0]) > between
                or abs(points[k, 1, 1] - points[i, 1, 1]) > between
            ):
                continue
            best, own, its = 1e30, 0, 0
            for a in range(3):
                for b in range(3):
                    apart = (points[i, a, 0] - points[k, b, 0]) ** 2 + (points[i, a, 1] - points[k, b, 1]) ** 2
                    if apart < best:
                        best, own, its = apart, a, b
            best = np.sqrt(best)
            if best > radius:
                continue
            weight = min(length[k], LONG_NEIGHBOUR) / (best + NEAR_NEIGHBOUR)
            slot = np.argmin(found.worth[i])
            if weight > found.worth[i, slot]:
                found.other[i, slot], found.gap[i, slot], found.worth[i, slot] = k, best, weight
                found.share[i, slot, 0], found.share[i, slot, 1] = 0.5 * own, 0.5 * its
        total = max(np.sum(found.worth[i]), NOT_ZERO)
        for m in range(NEIGHBOURS):
            found.worth[i, m] = min(1.0, INDEPENDENT_NEIGHBOURS * found.worth[i, m] / total)
            other = found.other[i, m]
            # The ends of a level segment have no disparity but by the corners that they are.
            if other >= 0 and abs(table.direction[other, 1]) > LEVEL and _meet(met, i, other):
                found.worth[i, m], found.meets[i, m] = 1.0, True
                _crossing(table, i, other, found.share[i, m])
    return found


@njit
def rivals(value: FloatArray, a: int, b: int) -> bool:
    """Whether two candidates of one segment cannot both be true: they claim one part of it, or differ in depth."""
    common = min(value[a, 4], value[b, 4]) - max(value[a, 3], value[b, 3])
    shorter = min(value[a, 4] - value[a, 3], value[b, 4] - value[b, 3])
    if common > SAME_PART * shorter or shorter < NOT_ZERO:
        return True
    # One below the other: parts of one line, or edges that meet there and that one eye sees in line.
    between = 0.5 * (max(value[a, 3], value[b, 3]) + min(value[a, 4], value[b, 4]))
    apart = abs(_in_row(value, a, between) - _in_row(value, b, between))
    return bool(apart * min(value[a, 8], value[b, 8]) > ONE_LINE)


@njit
def _in_row(value: FloatArray, a: int, row: float) -> float:
    """Disparity, pixels, of candidate a in a row, which its line may reach beyond its ends."""
    share = (row - value[a, 3]) / max(value[a, 4] - value[a, 3], NOT_ZERO)
    return float(value[a, 6] + share * (value[a, 7] - value[a, 6]))


@njit
def _odds(nearer: float) -> float:
    """Odds of a rival that is nearer by this disparity, pixels."""
    told = NEARER_LOG_ODDS * np.exp(-abs(nearer) / BESIDE) if abs(nearer) > LEAST_BESIDE else 0.0
    return float(np.exp(told if nearer > 0.0 else -told))


@njit(nogil=True)
def supporters(
    node: Int32Array, value: FloatArray, first: IntArray, near: Neighbours, met: Int32Array, spread: float
) -> Support:
    """For each candidate those of its neighbours that may support it.

    met : (m, 2) segments that the ends of right segments meet, or -1; spread : pixels, of disparity at random
    """
    most = np.max(first[1:] - first[:-1])
    there = np.empty((NEIGHBOURS, most))
    start, groups, count = np.zeros(len(node) + 1, np.int64), 0, 0
    column, begin = np.empty(NEIGHBOURS * len(node), np.int16), np.zeros(NEIGHBOURS * len(node) + 1, np.int64)
    who, ratio = np.empty(16 * len(node) + most, np.int32), np.empty(16 * len(node) + most)
    for i in range(len(first) - 1):
        if first[i] == first[i + 1]:
            continue
        # Where the neighbours' candidates are is the same for all of this one's.
        for m in range(NEIGHBOURS):
            o = near.other[i, m]
            if o >= 0:
                for b in range(first[o], first[o + 1]):
                    there[m, b - first[o]] = _disparity(value, b, near.share[i, m, 1])
        for a in range(first[i], first[i + 1]):
            j = node[a, 1]
            for m in range(NEIGHBOURS):
                o = near.other[i, m]
                if o < 0:
                    continue
                if count + most > len(who):
                    who = np.concatenate((who, np.empty_like(who)))
                    ratio = np.concatenate((ratio, np.empty_like(ratio)))
                disparity, meets = _disparity(value, a, near.share[i, m, 0]), near.meets[i, m]
                usual = DISPARITY_SPREAD + DISPARITY_GRADIENT * near.gap[i, m]
                for b in range(first[o], first[o + 1]):
                    off = disparity - there[m, b - first[o]]
                    if abs(off) > SUPPORT_REACH * usual:
                        continue
                    scale = CORNER_SPREAD if meets and _meet(met, j, node[b, 1]) else usual
                    off /= scale
                    if abs(off) > SUPPORT_REACH:
                        continue
                    # Two edges beside each other are not one segment of the other image.
                    if node[b, 1] == j and value[a, 4] - value[b, 3] > 1.0 and value[b, 4] - value[a, 3] > 1.0:
                        continue
                    who[count], ratio[count] = b, spread / (np.pi * scale * (1.0 + off * off))
                    count += 1
                if count > begin[groups]:
                    column[groups] = m
                    groups += 1
                    begin[groups] = count
            start[a + 1] = groups
    return Support(start, column[:groups], begin[: groups + 1], who[:count], ratio[:count])


@njit(nogil=True)
def rival_lists(node: Int32Array, value: FloatArray, lists: CandidateLists) -> Rivals:
    """For each candidate those that cannot be true with it: start (k + 1,), who, and the odds of each."""
    start = np.zeros(len(node) + 1, np.int64)
    who, odds = np.empty(16 * len(node) + 64, np.int32), np.empty(16 * len(node) + 64)
    first, right_of, right_first = lists.first, lists.right_of, lists.right_first
    count = 0
    for a in range(len(node)):
        i, j = node[a]
        if count + first[i + 1] - first[i] + right_first[j + 1] - right_first[j] > len(who):
            who = np.concatenate((who, np.empty_like(who)))
            odds = np.concatenate((odds, np.empty_like(odds)))
        for b in range(first[i], first[i + 1]):
            if b != a and rivals(value, a, b):
                who[count], odds[count] = b, _odds(value[b, 1] - value[a, 1])
                count += 1
        for place in range(right_first[j], right_first[j + 1]):
            b = right_of[place]
            if node[b, 0] != i and rivals(value, a, b):
                who[count], odds[count] = b, _odds(value[b, 1] - value[a, 1])
                count += 1
        start[a + 1] = count
    return start, who[:count], odds[:count]


@njit(nogil=True)
def beliefs(part: tuple[int, int], likelihood: FloatArray, against: Rivals, belief: FloatArray) -> None:
    """Probabilities of candidates among their rivals.

    part : first and end of the candidates of which ``belief`` (k,) is filled; likelihood : (k,) odds of each by itself
    """
    start, rival, odds = against
    for a in range(part[0], part[1]):
        total = 1.0 + likelihood[a]
        for q in range(start[a], start[a + 1]):
            total += odds[q] * likelihood[rival[q]]
        belief[a] = likelihood[a] / total


@njit(nogil=True)
def told_by_neighbours(
    part: tuple[int, int],
    segment: Int32Array,
    near: Neighbours,
    same: FloatArray,
    support: Support,
    belief: FloatArray,
    matched: FloatArray,
    told: FloatArray,
) -> None:
    """What the neighbours' candidates say of candidates, nats.

    part : first and end of the candidates of which ``told`` (k,) is filled; segment : (k,) left segment; same : (n,
    NEIGHBOURS), the chance that a neighbour lies on one surface; matched : (n,), that a segment has any partner
    """
    start, column, first, who, ratio = support
    alone, last, silent = np.empty(NEIGHBOURS), -1, 0.0
    for a in range(part[0], part[1]):
        i = segment[a]
        if i != last:
            # A neighbour that has a disparity speaks against all others; one that has none says nothing.
            silent, last = 0.0, i
            for m in range(NEIGHBOURS):
                o = near.other[i, m]
                alone[m] = 1.0 - same[i, m] * min(matched[o], 1.0) if o >= 0 else 1.0
                silent += near.worth[i, m] * np.log(alone[m])
        told[a] = silent
        for g in range(start[a], start[a + 1]):
            m, total = column[g], 0.0
            for q in range(first[g], first[g + 1]):
                total += ratio[q] * belief[who[q]]
            told[a] += near.worth[i, m] * np.log(1.0 + same[i, m] * total / alone[m])


@njit
def strongest(own: FloatArray, lists: CandidateLists, most: int) -> BoolArray:
    """(k,) bool: candidates that are among the ``most`` strongest of their left or of their right segment."""
    kept = np.zeros(len(own), np.bool_)
    every = np.arange(len(own))
    for side in range(2):
        start = lists.first if side == 0 else lists.right_first
        item = every if side == 0 else lists.right_of
        for i in range(len(start) - 1):
            group = item[start[i] : start[i + 1]]
            if len(group) > most:
                group = group[np.argsort(own[group])[-most:]]
            for a in group:
                kept[a] = True
    return kept


@njit
def unique(node: Int32Array, value: FloatArray, order: IntArray) -> IntArray:
    """Candidates in the given order, without those that an earlier one excludes: (m,) int64."""
    chosen = np.empty(len(order), np.int64)
    count = 0
    # Chains of the chosen, by left and by right segment.
    last = np.full((2, np.max(node) + 1), -1, np.int64)
    before = np.full((2, len(order)), -1, np.int64)
    for a in order:
        free = True
        for side in range(2):
            k = last[side, node[a, side]]
            while k >= 0 and free:
                free = not rivals(value, a, chosen[k])
                k = before[side, k]
        if free:
            chosen[count] = a
            for side in range(2):
                before[side, count] = last[side, node[a, side]]
                last[side, node[a, side]] = count
            count += 1
    return chosen[:count].copy()
