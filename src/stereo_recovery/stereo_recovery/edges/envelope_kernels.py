"""Compiled Cholesky factorisation of a sparse matrix within its envelope, and its inverse there.

A matrix that ties each unknown to a few others is nearly a band when the unknowns are numbered well (reverse
Cuthill-McKee). Row i is kept from its first entry to the diagonal: entry (i, j) stands at start[i] + j - first[i]. The
inverse is computed within the same envelope, which is all that marginal covariances need.

References
----------
A. George and J. Liu, "Computer Solution of Large Sparse Positive Definite Systems", 1981; K. Takahashi, J. Fagan and
M. Chen, "Formation of a sparse bus impedance matrix", 1973.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray


class Graph(NamedTuple):
    """Links of n nodes: those of node i are other[begin[i] : begin[i + 1]], degree[i] of them."""

    begin: IntArray
    other: IntArray
    degree: IntArray


@njit
def numbering(count: int, e: IntArray, f: IntArray) -> IntArray:
    """(count,) place of each node in the reverse Cuthill-McKee order of a graph with links e - f, (k,) each."""
    degree = np.zeros(count + 1, np.int64)
    for k in range(len(e)):
        degree[e[k]] += 1
        degree[f[k]] += 1
    begin = np.zeros(count + 1, np.int64)
    for i in range(count):
        begin[i + 1] = begin[i] + degree[i]
    fill, other = begin[:-1].copy(), np.empty(begin[-1], np.int64)
    for k in range(len(e)):
        other[fill[e[k]]], other[fill[f[k]]] = f[k], e[k]
        fill[e[k]] += 1
        fill[f[k]] += 1
    graph = Graph(begin, other, degree)
    order, seen = np.empty(count, np.int64), np.zeros(count, np.bool_)
    done = 0
    for root in np.argsort(degree[:count]):
        if seen[root]:
            continue
        # From the far end of a component, so that its levels are narrow.
        end = _reach(root, graph, seen, order, done)
        for k in range(done, end):
            seen[order[k]] = False
        done = _reach(order[end - 1], graph, seen, order, done)
    place = np.empty(count, np.int64)
    for k in range(count):
        place[order[k]] = count - 1 - k
    return place


@njit
def _reach(root: int, graph: Graph, seen: BoolArray, order: IntArray, done: int) -> int:
    """Append a component to ``order``, by distance from its root; returns how many stand there then."""
    order[done] = root
    seen[root] = True
    at, end = done, done + 1
    while at < end:
        node = order[at]
        at += 1
        near = graph.other[graph.begin[node] : graph.begin[node + 1]]
        for k in near[np.argsort(graph.degree[near])]:
            if not seen[k]:
                seen[k] = True
                order[end] = k
                end += 1
    return end


@njit
def solve_envelope(
    first: IntArray, start: IntArray, value: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solution x (m,) of A x = right, and the inverse of A within A's envelope.

    first : (m,) first column of each row; start : (m + 1,) where rows begin in ``value``, which holds A.
    """
    m = len(first)
    factor = value.copy()
    for i in range(m):
        row = start[i] - first[i]
        for j in range(first[i], i + 1):
            low = max(first[i], first[j])
            other = start[j] - first[j]
            total = factor[row + j]
            for k in range(low, j):
                total -= factor[row + k] * factor[other + k]
            factor[row + j] = np.sqrt(max(total, 1e-300)) if j == i else total / factor[other + j]
    x = right.copy()
    for i in range(m):
        row = start[i] - first[i]
        for k in range(first[i], i):
            x[i] -= factor[row + k] * x[k]
        x[i] /= factor[row + i]
    for i in range(m - 1, -1, -1):
        row = start[i] - first[i]
        x[i] /= factor[row + i]
        for k in range(first[i], i):
            x[k] -= factor[row + k] * x[i]
    last = np.arange(m)
    for i in range(m):
        for j in range(first[i], i):
            last[j] = i
    inverse = np.zeros_like(factor)
    rows = np.empty(m, np.int64)
    column = np.empty(m)
    for j in range(m - 1, -1, -1):
        pivot = 1.0 / factor[start[j] - first[j] + j]
        count = 0
        for i in range(j + 1, last[j] + 1):
            if first[i] <= j:
                rows[count] = i
                column[count] = factor[start[i] - first[i] + j]
                count += 1
        diagonal = pivot
        for a in range(count):
            i = rows[a]
            row = start[i] - first[i]
            total = 0.0
            for b in range(a + 1):
                total += inverse[row + rows[b]] * column[b]
            for b in range(a + 1, count):
                k = rows[b]
                total += inverse[start[k] - first[k] + i] * column[b]
            inverse[row + j] = -total * pivot
            diagonal += total * pivot * column[a]
        inverse[start[j] - first[j] + j] = diagonal * pivot
    return x, inverse
