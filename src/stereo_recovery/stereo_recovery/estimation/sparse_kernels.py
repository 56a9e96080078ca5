"""Compiled Cholesky factorisation of a sparse matrix of 2 x 2 blocks, and its inverse where the factor has blocks.

A matrix that ties each unknown to a few others stays sparse when it is factorised in an order of least degree. The
inverse is computed only where the factor has blocks, which is all that marginal covariances need.

References
----------
A. George and J. Liu, "Computer Solution of Large Sparse Positive Definite Systems", 1981; K. Takahashi, J. Fagan and
M. Chen, "Formation of a sparse bus impedance matrix", 1973.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray


class Pattern(NamedTuple):
    """Where the factor of a matrix of n x n blocks has m blocks below its diagonal.

    begin : (n + 1,) where the columns begin in ``row``, (m,), the rows of each in rising order
    """

    begin: IntArray
    row: IntArray


@njit
def pattern(count: int, low: IntArray, high: IntArray) -> Pattern:
    """Of a matrix with ``count`` block columns and blocks (high, low), (k,) each, high > low."""
    # The blocks of each column as a chain, and the columns whose first block is in each row.
    first, following = np.full(count, -1, np.int64), np.empty(len(low), np.int64)
    for k in range(len(low)):
        following[k] = first[low[k]]
        first[low[k]] = k
    child, sibling = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    begin, row = np.zeros(count + 1, np.int64), np.empty(4 * len(low) + 16, np.int64)
    mark = np.full(count, -1, np.int64)
    for j in range(count):
        while begin[j] + count > len(row):
            row = np.concatenate((row, np.empty_like(row)))
        end = begin[j]
        k = first[j]
        while k >= 0:
            if mark[high[k]] != j:
                mark[high[k]] = j
                row[end] = high[k]
                end += 1
            k = following[k]
        # What a column has below its first block comes into that block's column.
        c = child[j]
        while c >= 0:
            for q in range(begin[c] + 1, begin[c + 1]):
                if mark[row[q]] != j:
                    mark[row[q]] = j
                    row[end] = row[q]
                    end += 1
            c = sibling[c]
        row[begin[j] : end] = np.sort(row[begin[j] : end])
        begin[j + 1] = end
        if end > begin[j]:
            parent = row[begin[j]]
            sibling[j] = child[parent]
            child[parent] = j
    return Pattern(begin, row[: begin[count]].copy())


@njit
def slots(p: Pattern, low: IntArray, high: IntArray) -> IntArray:
    """(k,) where the pattern has blocks (high, low)."""
    found = np.empty(len(low), np.int64)
    for k in range(len(low)):
        begin, end = p.begin[low[k]], p.begin[low[k] + 1]
        found[k] = begin + np.searchsorted(p.row[begin:end], high[k])
    return found


@njit
def _inverse(a: FloatArray) -> FloatArray:
    """(2, 2): of a symmetric positive definite block."""
    det = max(a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0], 1e-300)
    return np.array([[a[1, 1] / det, -a[0, 1] / det], [-a[1, 0] / det, a[0, 0] / det]])


class Workspace(NamedTuple):
    """Room for solving: pivot (n, 2, 2), factor (m, 2, 2), and what the factorisation notes of n columns.

    waiting is -1 before and after.
    """

    pivot: FloatArray
    factor: FloatArray
    waiting: IntArray
    following: IntArray
    at: IntArray
    slot: IntArray


@njit
def workspace(p: Pattern) -> Workspace:
    """Room for systems of a pattern."""
    n, m = len(p.begin) - 1, len(p.row)
    chain = np.full(n, -1, np.int64)
    return Workspace(np.empty((n, 2, 2)), np.empty((m, 2, 2)), chain, chain.copy(), chain.copy(), chain.copy())


@njit
def solve_sparse(
    p: Pattern, columns: IntArray, diagonal: FloatArray, below: FloatArray, x: FloatArray, room: Workspace
) -> None:
    """Solves A x = right in place, and puts the inverse of A where A was, all in A's pattern.

    columns : (c,) rising, that no other is tied to; diagonal, below : (n, 2, 2), (m, 2, 2) blocks of A; x : (n, 2) the
    right side
    """
    _factorise(p, columns, diagonal, below, room)
    pivot, factor = room.pivot, room.factor
    for j in columns:
        for q in range(p.begin[j], p.begin[j + 1]):
            for r in range(2):
                x[p.row[q], r] -= factor[q, r, 0] * x[j, 0] + factor[q, r, 1] * x[j, 1]
    for j in columns[::-1]:
        a, b = x[j]
        for r in range(2):
            x[j, r] = pivot[j, r, 0] * a + pivot[j, r, 1] * b
        for q in range(p.begin[j], p.begin[j + 1]):
            i = p.row[q]
            for r in range(2):
                x[j, r] -= factor[q, 0, r] * x[i, 0] + factor[q, 1, r] * x[i, 1]
    _invert(p, columns, pivot, factor, below)
    for j in columns:
        diagonal[j] = pivot[j]


@njit
def _factorise(p: Pattern, columns: IntArray, diagonal: FloatArray, below: FloatArray, room: Workspace) -> None:
    """A = L D L^T: the inverses of D's blocks (n, 2, 2), and L's below its diagonal (m, 2, 2)."""
    # Columns that have a block in each row and are done, as a chain, and where in each column that is.
    pivot, factor, waiting, following, at, slot = room
    for j in columns:
        for q in range(p.begin[j], p.begin[j + 1]):
            slot[p.row[q]] = q
        k = waiting[j]
        waiting[j] = -1
        while k >= 0:
            then, own = following[k], at[k]
            for r in range(2):
                for c in range(2):
                    diagonal[j, r, c] -= factor[own, r, 0] * below[own, c, 0] + factor[own, r, 1] * below[own, c, 1]
            for q in range(own + 1, p.begin[k + 1]):
                to = slot[p.row[q]]
                for r in range(2):
                    for c in range(2):
                        below[to, r, c] -= factor[q, r, 0] * below[own, c, 0] + factor[q, r, 1] * below[own, c, 1]
            if own + 1 < p.begin[k + 1]:
                at[k] = own + 1
                following[k] = waiting[p.row[own + 1]]
                waiting[p.row[own + 1]] = k
            k = then
        pivot[j] = _inverse(diagonal[j])
        for q in range(p.begin[j], p.begin[j + 1]):
            for r in range(2):
                for c in range(2):
                    factor[q, r, c] = below[q, r, 0] * pivot[j, 0, c] + below[q, r, 1] * pivot[j, 1, c]
        if p.begin[j] < p.begin[j + 1]:
            at[j] = p.begin[j]
            following[j] = waiting[p.row[p.begin[j]]]
            waiting[p.row[p.begin[j]]] = j


@njit
def _invert(p: Pattern, columns: IntArray, pivot: FloatArray, factor: FloatArray, below: FloatArray) -> None:
    """Put the inverse's blocks into ``pivot`` and ``below``, from the last column to the first."""
    for j in columns[::-1]:
        begin, end = p.begin[j], p.begin[j + 1]
        below[begin:end] = 0.0
        for a in range(begin, end):
            i = p.row[a]
            for r in range(2):
                for c in range(2):
                    below[a, r, c] -= pivot[i, r, 0] * factor[a, 0, c] + pivot[i, r, 1] * factor[a, 1, c]
            # The column of row i has all rows that this one has below it, in the same order.
            q = p.begin[i]
            for b in range(a + 1, end):
                while p.row[q] != p.row[b]:
                    q += 1
                for r in range(2):
                    for c in range(2):
                        below[b, r, c] -= below[q, r, 0] * factor[a, 0, c] + below[q, r, 1] * factor[a, 1, c]
                        below[a, r, c] -= below[q, 0, r] * factor[b, 0, c] + below[q, 1, r] * factor[b, 1, c]
        for a in range(begin, end):
            for r in range(2):
                for c in range(2):
                    pivot[j, r, c] -= factor[a, 0, r] * below[a, 0, c] + factor[a, 1, r] * below[a, 1, c]
