"""Compiled sums over factors: the normal equations that they make, and what the solution makes of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray


class Ties(NamedTuple):
    """k factors, see :class:`.factors.Factors`; slot : (k,) where the pattern has the block of both edges, or -1."""

    edge: IntArray
    other: IntArray
    row: FloatArray
    other_row: FloatArray
    value: FloatArray
    slot: IntArray


@njit
def assembled(
    information: FloatArray, vector: FloatArray, ties: Ties, weight: FloatArray, place: IntArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The normal equations' blocks on the diagonal (n, 2, 2) and below it (count, 2, 2), and right side (n, 2).

    information, vector : (n, 2, 2), (n, 2) of the edges by themselves; weight : (k,) of factors; place : (n,) of edges
    """
    diagonal, right, below = np.empty_like(information), np.empty_like(vector), np.zeros((count, 2, 2))
    for i in range(len(place)):
        diagonal[place[i]], right[place[i]] = information[i], vector[i]
    for k in range(len(weight)):
        if weight[k] == 0.0:
            continue
        i, q = place[ties.edge[k]], ties.slot[k]
        h, w = ties.row[k], weight[k]
        _add_statement(diagonal[i], right[i], h, w, w * ties.value[k])
        if q < 0:
            continue
        j, g = place[ties.other[k]], ties.other_row[k]
        _add_statement(diagonal[j], right[j], g, w, -w * ties.value[k])
        # Rows of the block are those of the later edge.
        upper, lower = (g, h) if i > j else (h, g)
        for r in range(2):
            for c in range(2):
                below[q, r, c] -= w * lower[r] * upper[c]
    return diagonal, below, right


@njit
def _add_statement(block: FloatArray, right: FloatArray, h: FloatArray, weight: float, value: float) -> None:
    """Add what one row h says with a weight, and a weighted value, to an edge's block (2, 2) and right side (2,)."""
    for r in range(2):
        right[r] += value * h[r]
        for c in range(2):
            block[r, c] += weight * h[r] * h[c]


@njit
def products(
    ties: Ties, place: IntArray, x: FloatArray, covariance: FloatArray, below: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What the solution makes of each factor: residual, variance (k,), with_first, with_second (k, 2).

    x, covariance : (n, 2), (n, 2, 2); below : (m, 2, 2) of the inverse; see :class:`.normal_equations.Solution`
    """
    count = len(ties.edge)
    residual, variance = ties.value.copy(), np.zeros(count)
    first, second = np.zeros((count, 2)), np.zeros((count, 2))
    for k in range(count):
        e, f, q = ties.edge[k], ties.other[k], ties.slot[k]
        h, g = ties.row[k], ties.other_row[k]
        for r in range(2):
            residual[k] -= h[r] * x[e, r]
            for c in range(2):
                first[k, r] += covariance[e, r, c] * h[c]
        if q >= 0:
            turned = place[e] < place[f]
            for r in range(2):
                residual[k] += g[r] * x[f, r]
                for c in range(2):
                    first[k, r] -= (below[q, c, r] if turned else below[q, r, c]) * g[c]
                    second[k, r] += (below[q, r, c] if turned else below[q, c, r]) * h[c] - covariance[f, r, c] * g[c]
            variance[k] -= g[0] * second[k, 0] + g[1] * second[k, 1]
        variance[k] += h[0] * first[k, 0] + h[1] * first[k, 1]
    return residual, variance, first, second


@njit
def first_of_edges(edge: IntArray, other: IntArray, chosen: BoolArray, value: FloatArray, count: int) -> BoolArray:
    """(k,) bool: chosen factors than which none has a smaller value at either of their edges, of equals the first.

    edge, other : (k,) the edges of each, other -1 where it is about one; value : (k,); count : of edges
    """
    best = np.full(count, -1)
    for k in np.flatnonzero(chosen):
        for e in (edge[k], other[k]):
            if e >= 0 and (best[e] < 0 or value[k] < value[best[e]]):
                best[e] = k
    first = np.zeros(len(edge), np.bool_)
    for k in np.flatnonzero(chosen):
        first[k] = best[edge[k]] == k and (other[k] < 0 or best[other[k]] == k)
    return first
