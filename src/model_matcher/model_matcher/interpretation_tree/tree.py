"""The thesis' search: traversal of the pruned interpretation tree by data pairs (5.7, 5.10, 7.4, appendix C).

One level of the tree is one data pair of the ordered match list. Its look-up table says which pairs of model features
are consistent; features assigned higher up restrict it to a row, a column or one entry. A data feature may also be put
into the bin, as many as a limit allows; the limit rises from the smallest possible, so interpretations with the fewest
features in the bin come first.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs_py import BIN
from msgs_py.numeric.compiled import njit

from ..params import MatchParams
from .ordering import order_pairs
from .signs import apply_code, write_signs
from .tables import Tables, pair_number

UNASSIGNED = -2
LEVELS_PER_SECOND = 1_000_000  # only to turn a time limit into a limit of levels
LEVEL_SIZE = 1000  # data x model features of which a level is that fast
# Names of the counters that the kernels keep.
COUNTERS = ('levels', 'backtracks', 'sign_cutoffs', 'unassigned_pairs', 'truncated')


@dataclass(eq=False)
class TreeResult:
    """Feasible interpretations, fewest features in the bin first.

    assignments : (m, n) int32, BIN (-1) for the bin; signs : (m, n) int8, 0 unknown
    complete : the search has seen the whole tree (at the bin count of the result)
    """

    assignments: np.ndarray
    signs: np.ndarray
    complete: bool
    stats: dict[str, Any] = field(default_factory=dict)


def tree_search(
    tables: Tables, params: MatchParams, limit: int = 256, seconds: float | None = None, eliminate: bool = True
) -> TreeResult:
    """Search the tree for at most ``limit`` interpretations (the thesis' NOI).

    params : ordering, signs, max_bin (None: all but min_matched features may go into the bin), time_limit_s
    eliminate : leave out beforehand what cannot be part of an interpretation of the size looked for (7.4)
    """
    return search_with_bin(tables, params, limit, seconds, eliminate, traverse_left)


def search_with_bin(
    tables: Tables, params: MatchParams, limit: int, seconds: float | None, eliminate: bool, traverse: Any
) -> TreeResult:
    """Run a traversal with a rising number of features in the bin until something is found."""
    n = tables.unary.shape[0]
    # Levels instead of a clock: the result does not depend on the machine's mood, nor on compile time.
    limit_s = params.time_limit_s if seconds is None else seconds
    budget = int(limit_s * LEVELS_PER_SECOND / max(1.0, tables.unary.size / LEVEL_SIZE))
    started = time.perf_counter()
    stats = dict.fromkeys(COUNTERS, 0)
    most = max(n - params.min_matched, 0) if params.max_bin is None else min(params.max_bin, n)
    core = core_numbers(tables)
    # Whatever is consistent and of size K has all its nodes supported by K - 1 other data features.
    largest = largest_core(core) if eliminate else n
    stats['eliminated'] = int((core.max(axis=1, initial=0) < max(largest, 1)).sum()) if eliminate else 0
    for in_bin in range(max(n - largest, 0), most + 1):
        alive = core >= n - in_bin if eliminate else tables.unary.copy()
        left = budget - stats['levels']
        assignments, signs, counters = traverse(tables, alive, params, in_bin, limit, left)
        for name, count in zip(COUNTERS, counters):
            stats[name] += int(count)
        if time.perf_counter() - started > 2.0 * limit_s:  # a machine much slower than the budget has it
            stats['truncated'] += 1
        if len(assignments) or stats['truncated']:
            return TreeResult(assignments, signs, not stats['truncated'], stats)
    return TreeResult(np.zeros((0, n), np.int32), np.zeros((0, n), np.int8), not stats['truncated'], stats)


def traverse_left(
    tables: Tables, alive: np.ndarray, params: MatchParams, in_bin: int, limit: int, levels: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every level in turn, over the pairs of the features that are left; the others go into the bin at once."""
    n, e = tables.unary.shape
    side = params.quadrant if params.search == 'subgraph' else e + 1
    left = np.flatnonzero(alive.any(axis=1))
    assignments = np.full((limit, n), BIN, np.int32)
    signs = np.zeros((limit, n), np.int8)
    counters = np.zeros(len(COUNTERS), np.int64)
    if len(left) < n - in_bin or len(left) == 0:
        return assignments[:0], signs[:0], counters
    if len(left) == 1:
        options = np.flatnonzero(alive[left[0]])[:limit]
        assignments[: len(options), left[0]] = options
        return assignments[: len(options)], signs[: len(options)], counters
    pairs, rows = sub_pairs(left, n)
    sums = tables.sums[rows]
    order = order_pairs(pairs, sums, params.ordering)
    found, inner, inner_signs = traverse_pairs(
        left[pairs[order]].astype(np.int32),
        rows[order],
        tables.code,
        alive,
        quadrants(tables, rows[order], side, in_bin > n - len(left)),
        side,
        in_bin - (n - len(left)),
        limit,
        levels,
        params.signs,
        counters,
    )
    assignments[:found] = np.where(inner[:found] == UNASSIGNED, BIN, inner[:found])
    signs[:found] = inner_signs[:found]
    return assignments[:found], signs[:found], counters


def quadrants(tables: Tables, rows: np.ndarray, side: int, with_bin: bool) -> np.ndarray:
    """(L, q) int32: the quadrants of each table that hold a match, fewest matches first; -1 fills the rest.

    A table has a row and a column more than there are model features, for the bin, all true when there is a bin.
    """
    e = tables.unary.shape[1]
    across = (e + side) // side
    if across == 1:
        return np.zeros((len(rows), 1), np.int32)
    padded = np.zeros((len(rows), across * side, across * side), bool)
    padded[:, :e, :e] = tables.code[rows] != 0
    if with_bin:
        padded[:, e, : e + 1] = padded[:, : e + 1, e] = True
    counts = padded.reshape(len(rows), across, side, across, side).sum(axis=(2, 4)).reshape(len(rows), -1)
    order = np.argsort(counts, axis=1, kind='stable').astype(np.int32)
    order = np.where(np.take_along_axis(counts, order, axis=1) == 0, -1, order)
    # Those without a match come first in the sort; a stable second one moves them behind the others.
    return np.take_along_axis(order, np.argsort(order < 0, axis=1, kind='stable'), axis=1).astype(np.int32)


def sub_pairs(left: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs among the features ``left``, numbered within them, and their rows in the table of all n features."""
    first, second = np.triu_indices(len(left), 1)
    a, b = left[first], left[second]
    rows = np.array([pair_number(int(x), int(y), n) for x, y in zip(a, b)], dtype=np.int64)
    return np.stack([first, second], axis=1), rows


@njit
def traverse_pairs(pairs, rows, code, alive, quadrants, side, bin_limit, limit, levels, use_signs, counters):
    """Depth-first over the ordered data pairs (L, 2); ``rows`` are their tables. Appendix C, with the bin.

    quadrants : (L, q) int32, the order in which the tables' quadrants of the given side are entered, -1 at the end of
        the list; row and column e of a table stand for the bin. One quadrant of side e + 1 is the plain search.
    alive : (n, e) bool, the model features each data feature may take. Exactly bin_limit features go into the bin.
    Backtracks early when a pair has no consistent entry; with a bin, also when more features than it may still take
    have no model feature left that agrees with everything assigned so far.
    """
    n, e = alive.shape
    depth = pairs.shape[0]
    out = np.full((limit, n), -2, np.int32)
    out_sign = np.zeros((limit, n), np.int8)
    assignment = np.full(n, -2, np.int32)
    root = np.arange(n).astype(np.int32)
    parity = np.ones(n, np.int8)
    known = np.zeros(n, np.int8)
    in_bin = 0
    # What a level found when it was entered, to be restored before its next entry is tried.
    saved_a = np.zeros(depth, np.int32)
    saved_b = np.zeros(depth, np.int32)
    saved_root = np.zeros((depth, n), np.int32)
    saved_parity = np.zeros((depth, n), np.int8)
    saved_known = np.zeros((depth, n), np.int8)
    saved_bin = np.zeros(depth, np.int64)
    look_ahead = bin_limit > 0
    open_to = alive.copy()
    saved_open = np.zeros((depth if look_ahead else 0, n, e), np.bool_)
    cursor = np.zeros((depth, 2), np.int64)  # quadrant and entry in it
    across = (e + side) // side
    found = 0
    level = 0
    entering = True
    while level >= 0:
        a, b = pairs[level, 0], pairs[level, 1]
        if entering:
            counters[0] += 1
            if counters[0] > levels:
                counters[4] = 1
                return found, out, out_sign
            saved_a[level], saved_b[level] = assignment[a], assignment[b]
            saved_root[level], saved_parity[level], saved_known[level] = root, parity, known
            saved_bin[level] = in_bin
            if look_ahead:
                saved_open[level] = open_to
            cursor[level] = 0
            if assignment[a] == -2 and assignment[b] == -2:
                counters[3] += 1
        else:
            assignment[a], assignment[b] = saved_a[level], saved_b[level]
            root[:], parity[:], known[:] = saved_root[level], saved_parity[level], saved_known[level]
            in_bin = saved_bin[level]
            if look_ahead:
                open_to[:] = saved_open[level]
        fixed_a, fixed_b = saved_a[level], saved_b[level]
        table = code[rows[level]]
        first, last = (0, e + 1) if fixed_a == -2 else (fixed_a, fixed_a + 1) if fixed_a >= 0 else (e, e + 1)
        low, high = (0, e + 1) if fixed_b == -2 else (fixed_b, fixed_b + 1) if fixed_b >= 0 else (e, e + 1)
        advanced = False
        while cursor[level, 0] < quadrants.shape[1]:
            quadrant = quadrants[level, cursor[level, 0]]
            if quadrant < 0:
                break
            # A feature that is assigned already must have its model feature in the quadrant (thesis 5.8).
            i0, i1 = max(first, quadrant // across * side), min(last, (quadrant // across + 1) * side)
            j0, j1 = max(low, quadrant % across * side), min(high, (quadrant % across + 1) * side)
            at = cursor[level, 1]
            if i0 >= i1 or j0 >= j1 or at >= (i1 - i0) * (j1 - j0):
                cursor[level, 0] += 1
                cursor[level, 1] = 0
                continue
            cursor[level, 1] += 1
            i, j = i0 + at // (j1 - j0), j0 + at % (j1 - j0)
            extra = (1 if i == e and fixed_a == -2 else 0) + (1 if j == e and fixed_b == -2 else 0)
            if in_bin + extra > bin_limit:
                continue
            if i < e and j < e:
                bits = table[i, j]
                if bits == 0 or not alive[a, i] or not alive[b, j]:
                    continue
                if use_signs and not apply_code(bits, a, b, root, parity, known):
                    counters[2] += 1
                    root[:], parity[:], known[:] = saved_root[level], saved_parity[level], saved_known[level]
                    continue
            elif (i < e and not alive[a, i]) or (j < e and not alive[b, j]):
                continue
            assignment[a] = i if i < e else -1
            assignment[b] = j if j < e else -1
            in_bin += extra
            if look_ahead and (fixed_a == -2 or fixed_b == -2):
                if fixed_a == -2 and i < e:
                    _narrow(a, i, code, assignment, open_to)
                if fixed_b == -2 and j < e:
                    _narrow(b, j, code, assignment, open_to)
                if in_bin + _stranded(alive, assignment, open_to) > bin_limit:
                    assignment[a], assignment[b] = fixed_a, fixed_b
                    in_bin -= extra
                    root[:], parity[:], known[:] = saved_root[level], saved_parity[level], saved_known[level]
                    open_to[:] = saved_open[level]
                    continue
            advanced = True
            break
        if not advanced:
            counters[1] += 1
            level -= 1
            entering = False
            continue
        if level + 1 < depth:
            level += 1
            entering = True
            continue
        if in_bin == bin_limit:
            out[found] = assignment
            write_signs(root, parity, known, out_sign[found])
            for k in range(n):
                if assignment[k] < 0:
                    out_sign[found, k] = 0
            found += 1
            if found == limit:
                return found, out, out_sign
        entering = False
    return found, out, out_sign


@njit
def _narrow(a, i, code, assignment, open_to):
    """Feature a is on model feature i: close what disagrees with that, for every unassigned feature."""
    n, e = open_to.shape
    for k in range(n):
        if assignment[k] != -2 or k == a:
            continue
        lo, hi = min(a, k), max(a, k)
        table = code[lo * n - lo * (lo + 1) // 2 + hi - lo - 1]
        for j in range(e):
            if open_to[k, j] and not (table[i, j] if a < k else table[j, i]):
                open_to[k, j] = False


@njit
def _stranded(alive, assignment, open_to):
    """How many unassigned features that could once be matched have nothing left."""
    count = 0
    for k in range(alive.shape[0]):
        if assignment[k] == -2 and not open_to[k].any() and alive[k].any():
            count += 1
    return count


def core_numbers(tables: Tables) -> np.ndarray:
    """(n, e) int32: the largest K for which data feature a on model feature i can be among K mutually supporting data.

    A node (a, i) survives for K while at least K - 1 other data features still have a model feature that agrees with
    it; what does not is taken away, and so on (thesis 7.4, as a core decomposition). 0 where the unary tests fail.
    """
    return _core(tables.code, tables.unary)


def largest_core(core: np.ndarray) -> int:
    """The largest K for which K data features are left: no interpretation is larger."""
    best = np.sort(core.max(axis=1, initial=0))[::-1]
    return int(np.max(np.minimum(best, np.arange(1, len(best) + 1)), initial=0))


@njit
def _core(code, unary):
    n, e = unary.shape
    counts = np.zeros((n, e, n), np.int32)  # how many model features of the third agree with the node
    for a in range(n):
        for b in range(a + 1, n):
            table = code[a * n - a * (a + 1) // 2 + b - a - 1]
            for i in range(e):
                for j in range(e):
                    if table[i, j]:
                        counts[a, i, b] += 1
                        counts[b, j, a] += 1
    support = np.zeros((n, e), np.int32)
    core = np.zeros((n, e), np.int32)
    gone = np.zeros((n, e), np.bool_)
    for a in range(n):
        for i in range(e):
            if not unary[a, i]:
                gone[a, i] = True
                continue
            for b in range(n):
                if counts[a, i, b] > 0:
                    support[a, i] += 1
    stack = np.zeros((n * e, 2), np.int32)
    for size in range(1, n + 1):
        top = 0
        left = 0
        for a in range(n):
            for i in range(e):
                if gone[a, i]:
                    continue
                if support[a, i] < size - 1:
                    gone[a, i] = True
                    stack[top, 0], stack[top, 1] = a, i
                    top += 1
                else:
                    left += 1
        while top > 0:
            top -= 1
            a, i = stack[top, 0], stack[top, 1]
            core[a, i] = size - 1
            for b in range(n):
                if b == a:
                    continue
                lo, hi = min(a, b), max(a, b)
                table = code[lo * n - lo * (lo + 1) // 2 + hi - lo - 1]
                for j in range(e):
                    if gone[b, j]:
                        continue
                    agree = table[i, j] if a < b else table[j, i]
                    if not agree:
                        continue
                    counts[b, j, a] -= 1
                    if counts[b, j, a] == 0:
                        support[b, j] -= 1
                        if support[b, j] < size - 1:
                            gone[b, j] = True
                            left -= 1
                            stack[top, 0], stack[top, 1] = b, j
                            top += 1
        if left == 0:
            return core
    for a in range(n):
        for i in range(e):
            if not gone[a, i]:
                core[a, i] = n
    return core
