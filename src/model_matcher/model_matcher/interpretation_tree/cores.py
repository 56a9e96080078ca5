"""Which pairings can be part of an interpretation of K features: core numbers over the look-up tables (thesis 7.4)."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, Int32Array

from .tables import Tables, pair_row


def core_numbers(tables: Tables) -> Int32Array:
    """The size of the largest interpretation that each pairing can be part of, as far as pairs tell.

    A pairing (a, i) of data feature a with model feature i stays for size K while at least K - 1 other data features
    still have a model feature that is consistent with it; the others are removed until nothing changes. This is arc
    consistency with a count, computed for all K at once as a core decomposition.

    Parameters
    ----------
    tables : Tables
        Look-up tables of n data and e model features.

    Returns
    -------
    (n, e) int32
        The largest K for which the pairing stays; 0 where the tests of single features fail.

    References
    ----------
    Thesis 7.4; Batagelj and Zaversnik (2003), An O(m) algorithm for cores decomposition of networks.
    """
    cores: Int32Array = _core(tables.code, tables.unary)
    return cores


def largest_core(core: Int32Array) -> int:
    """The largest K for which K data features have a pairing that stays: no interpretation is larger.

    Examples
    --------
    >>> largest_core(np.array([[3, 0], [0, 3], [1, 2], [3, 1]], np.int32))
    3
    """
    best = np.sort(core.max(axis=1, initial=0))[::-1]
    return int(np.max(np.minimum(best, np.arange(1, len(best) + 1)), initial=0))


@njit
def _core(code: ByteArray, unary: BoolArray) -> Int32Array:
    """Core numbers (n, e) int32 from tables (P, e, e) uint8 and unary (n, e) bool."""
    n, e = unary.shape
    counts = _agreeing(code, n, e)
    support = np.zeros((n, e), np.int32)  # how many data features have a model feature that agrees with the pairing
    core = np.zeros((n, e), np.int32)
    removed = ~unary
    for a in range(n):
        for i in range(e):
            for b in range(n):
                if not removed[a, i] and counts[a, i, b] > 0:
                    support[a, i] += 1
    stack = np.zeros((n * e, 2), np.int32)
    for size in range(1, n + 1):
        top = 0
        for a in range(n):
            for i in range(e):
                if not removed[a, i] and support[a, i] < size - 1:
                    removed[a, i] = True
                    stack[top, 0], stack[top, 1] = a, i
                    top += 1
        while top > 0:
            top -= 1
            a, i = stack[top, 0], stack[top, 1]
            core[a, i] = size - 1
            top = _withdraw(a, i, size, code, counts, support, removed, stack, top)
        if removed.all():
            return core
    for a in range(n):
        for i in range(e):
            if not removed[a, i]:
                core[a, i] = n
    return core


@njit
def _agreeing(code: ByteArray, n: int, e: int) -> Int32Array:
    """How many model features of each data feature agree with each pairing, (n, e, n) int32."""
    counts = np.zeros((n, e, n), np.int32)
    for a in range(n):
        for b in range(a + 1, n):
            table = code[pair_row(a, b, n)]
            for i in range(e):
                for j in range(e):
                    if table[i, j]:
                        counts[a, i, b] += 1
                        counts[b, j, a] += 1
    return counts


@njit
def _withdraw(
    a: int,
    i: int,
    size: int,
    code: ByteArray,
    counts: Int32Array,
    support: Int32Array,
    removed: BoolArray,
    stack: Int32Array,
    top: int,
) -> int:
    """Take the support of a on i, which is removed, from all that agree with it.

    What is left with too little for an interpretation of this size is removed too, and put on the stack (m, 2), whose
    new height is returned. counts : (n, e, n), support and removed : (n, e), changed in place.
    """
    n, e = support.shape
    for b in range(n):
        if b == a:
            continue
        table = code[pair_row(min(a, b), max(a, b), n)]
        for j in range(e):
            if removed[b, j] or not (table[i, j] if a < b else table[j, i]):
                continue
            counts[b, j, a] -= 1
            if counts[b, j, a] == 0:
                support[b, j] -= 1
                if support[b, j] < size - 1:
                    removed[b, j] = True
                    stack[top, 0], stack[top, 1] = b, j
                    top += 1
    return top
