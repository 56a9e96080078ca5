"""The thesis' search: traversal of the pruned interpretation tree by data pairs (5.7, 5.10, 7.4, appendix C).

One level of the tree is one data pair of the ordered match list. Its look-up table says which pairs of model features
are consistent; features assigned higher up restrict it to a row, a column or one entry. A data feature may also be put
into the bin, as many as a limit allows; the limit rises from the smallest possible, so interpretations with the fewest
features in the bin come first.

Subgraph matching (5.8) is the same search with another order of a table's entries: a machine smaller than a table
searches it by quadrants, those with the fewest matches first. A quadrant is entered only when it holds a match and the
model features to which the pair's data features are already assigned lie on its two sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from msgs_py import BIN
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import LOOK_S
from msgs_py.numeric.typed import BoolArray, ByteArray, Int8Array, Int32Array, IntArray

from ..params import MatchParams
from .cores import core_numbers, largest_core
from .ordering import order_pairs
from .settings import INTERPRETATIONS, RATES
from .signs import apply_code, restore_signs, save_signs, stacked_signs, unknown_signs, write_signs
from .tables import Tables, pair_number, pair_row

UNASSIGNED = -2  # in an assignment, beside model features (from 0) and the bin (-1)
# The counters that a traversal keeps, by place in its array; the names are those of the statistics.
COUNTERS = ('levels', 'backtracks', 'sign_cutoffs', 'unassigned_pairs', 'truncated')
LEVELS, BACKTRACKS, SIGN_CUTOFFS, UNASSIGNED_PAIRS, TRUNCATED = range(len(COUNTERS))
# Where a walk stands: the level that comes next, interpretations found, 1 when it is entered.
LEVEL, FOUND, ENTERING = range(3)


@dataclass(eq=False)
class TreeResult:
    """Feasible interpretations, fewest features in the bin first.

    Attributes
    ----------
    assignments : (m, n) int32
        Model feature of each data feature, BIN (-1) for the bin.
    signs : (m, n) int8
        Direction signs, 0 unknown.
    complete : bool
        The whole tree was searched (at the bin count of the result).
    stats : dict
        Counts of the search, by name.
    """

    assignments: Int32Array
    signs: Int8Array
    complete: bool
    stats: dict[str, Any] = field(default_factory=dict)


class Traversed(NamedTuple):
    """What a traversal with one bin count found: assignments (m, n) int32, signs (m, n) int8, counters (5,) int64."""

    assignments: Int32Array
    signs: Int8Array
    counters: IntArray


# From tables, nodes left (n, e), parameters, features in the bin, limit of interpretations, limit of levels.
Traversal = Callable[[Tables, BoolArray, MatchParams, int, int, int], Traversed]


def tree_search(
    tables: Tables, params: MatchParams, limit: int = INTERPRETATIONS, deadline: Deadline | None = None
) -> TreeResult:
    """Search the interpretation tree for feasible interpretations.

    Parameters
    ----------
    tables : Tables
        Look-up tables of the data and the model.
    params : MatchParams
        ordering, signs, max_bin (None: all but min_matched features may go into the bin), eliminate, time_limit_s; with
        search='subgraph' the tables are searched by quadrants of ``quadrant`` x ``quadrant`` model features.
    limit : int
        Most interpretations that are returned (the thesis' NOI).
    deadline : Deadline, optional
        After params.time_limit_s when not given.

    Returns
    -------
    TreeResult
        Those with the fewest features in the bin.

    References
    ----------
    Thesis 5.7, 5.8, 5.10, 7.4 and appendix C.
    """
    deadline = deadline or Deadline(params.time_limit_s)
    core = core_numbers(tables) if params.eliminate else None
    traverse = partial(traverse_left, deadline=deadline)
    return search_with_bin(tables, params, limit, deadline, lambda size: _alive(tables, core, size), traverse)


def _alive(tables: Tables, core: Int32Array | None, size: int) -> BoolArray:
    """(n, e) bool: the pairings that may be in an interpretation of this size; with core numbers, as far as they tell.

    In a consistent set of K features, each has a consistent model feature in all K - 1 others. Nothing is left when
    fewer than K features have such a pairing.
    """
    if core is None:
        return tables.unary.copy()
    return core >= size if size <= largest_core(core) else np.zeros_like(tables.unary)


def subgraph_search(
    tables: Tables, params: MatchParams, limit: int = INTERPRETATIONS, deadline: Deadline | None = None
) -> TreeResult:
    """As :func:`tree_search`, by quadrants of params.quadrant x params.quadrant model features (thesis 5.8)."""
    return tree_search(tables, params.replace(search='subgraph'), limit, deadline)


def search_with_bin(
    tables: Tables,
    params: MatchParams,
    limit: int,
    deadline: Deadline,
    alive_for: Callable[[int], BoolArray],
    traverse: Traversal,
) -> TreeResult:
    """Run a traversal with a rising number of features in the bin until it finds an interpretation.

    Parameters as for :func:`tree_search`; alive_for : the pairings (n, e) bool that may be in an interpretation of some
    size, none when there can be no such interpretation; traverse : :func:`traverse_left` or its counterpart on the
    array machine.
    """
    n = tables.unary.shape[0]
    budget = int(deadline.left * RATES.levels / max(1.0, tables.unary.size / RATES.level_size))
    stats: dict[str, Any] = dict.fromkeys(COUNTERS, 0)
    most = max(n - params.min_matched, 0) if params.max_bin is None else min(params.max_bin, n)
    stats['eliminated'] = 0
    for in_bin in range(0, most + 1):
        alive = alive_for(n - in_bin)
        left = int(alive.any(axis=1).sum())
        if left < n - in_bin:
            continue
        stats['eliminated'] = n - left
        found = traverse(tables, alive, params, in_bin, limit, budget - stats['levels'])
        for name, count in zip(COUNTERS, found.counters):
            stats[name] += int(count)
        if deadline.passed:
            stats['truncated'] += 1
        if len(found.assignments) or stats['truncated']:
            return TreeResult(found.assignments, found.signs, not stats['truncated'], stats)
    return TreeResult(np.zeros((0, n), np.int32), np.zeros((0, n), np.int8), not stats['truncated'], stats)


def without_pairs(alive: BoolArray, in_bin: int, limit: int) -> Traversed | None:
    """What a traversal finds when fewer than two features have a model feature left; None when there are two or more.

    alive : (n, e) bool, the model features each data feature may take
    """
    n = len(alive)
    left = np.flatnonzero(alive.any(axis=1))
    if len(left) > 1 and len(left) >= n - in_bin:
        return None
    options = np.flatnonzero(alive[left[0]])[:limit] if len(left) == 1 and n - in_bin <= 1 else np.zeros(0, np.int64)
    assignments = np.full((len(options), n), BIN, np.int32)
    if len(options):
        assignments[:, left[0]] = options
    return Traversed(assignments, np.zeros((len(options), n), np.int8), np.zeros(len(COUNTERS), np.int64))


def traverse_left(
    tables: Tables,
    alive: BoolArray,
    params: MatchParams,
    in_bin: int,
    limit: int,
    levels: int,
    deadline: Deadline | None = None,
) -> Traversed:
    """Traverse the pairs of the features that have a model feature left; the other features are in the bin at once.

    alive : (n, e) bool; in_bin : features in the bin; limit : most interpretations; levels : most levels visited
    deadline : when it ends, though there are levels left
    """
    found = without_pairs(alive, in_bin, limit)
    if found is not None:
        return found
    n, e = tables.unary.shape
    side = params.quadrant if params.search == 'subgraph' else e + 1
    left = np.flatnonzero(alive.any(axis=1))
    counters = np.zeros(len(COUNTERS), np.int64)
    pairs, rows = sub_pairs(left, n)
    order = order_pairs(pairs, tables.sums[rows], params.ordering, tables.curves[left])
    in_bin -= n - len(left)
    tree = PairTree(
        left[pairs[order]].astype(np.int32), rows[order], quadrants(tables, rows[order], side, in_bin > 0), side
    )
    at_once = max(1, int(LOOK_S * RATES.levels * RATES.level_size / (n * e)))
    limits = Limits(in_bin, limit, levels, params.signs, params.eliminate and in_bin > 0, at_once)
    walk = start_walk(len(order), n, e, limits, alive)

    def go_on(some: Limits) -> None:
        traverse_pairs(tree, tables.code, alive, some, walk, counters)

    until(go_on, limits, walk.place, counters, LEVELS, deadline or Deadline())
    count = int(walk.place[FOUND])
    assignments = np.where(walk.out[:count] == UNASSIGNED, np.int32(BIN), walk.out[:count])
    return Traversed(assignments, walk.out_sign[:count], counters)


def until(
    go_on: Callable[[Limits], None], limits: Limits, place: IntArray, counters: IntArray, work: int, deadline: Deadline
) -> None:
    """Go on with a walk until it ends, its steps are used up or the time is; the counters then say truncated.

    go_on : walks on from its place (3,) until the limits it is given; work : which counter it counts its steps by
    """
    while True:
        counters[TRUNCATED] = 0
        last = min(limits.levels, int(counters[work]) + limits.at_once)
        go_on(limits._replace(levels=last))
        over = counters[work] >= limits.levels or deadline.passed
        if over or not counters[TRUNCATED] or place[FOUND] >= limits.interpretations:
            return


def quadrants(tables: Tables, rows: IntArray, side: int, with_bin: bool) -> Int32Array:
    """(L, q) int32: the quadrants of each table that hold a match, fewest matches first; -1 fills the rest.

    A table has a row and a column more than there are model features, for the bin: while one feature of the pair is in
    it, the other may be whatever it may be by itself.
    """
    e = tables.unary.shape[1]
    across = (e + side) // side
    if across == 1:
        return np.zeros((len(rows), 1), np.int32)
    padded = np.zeros((len(rows), across * side, across * side), bool)
    padded[:, :e, :e] = tables.code[rows] != 0
    if with_bin:
        first, second = tables.pairs[rows].T
        padded[:, :e, e], padded[:, e, :e], padded[:, e, e] = tables.unary[first], tables.unary[second], True
    counts = padded.reshape(len(rows), across, side, across, side).sum(axis=(2, 4)).reshape(len(rows), -1)
    order = np.argsort(counts, axis=1, kind='stable').astype(np.int32)
    order = np.where(np.take_along_axis(counts, order, axis=1) == 0, np.int32(-1), order)
    # Those without a match come first in the sort; a second, stable sort moves them behind the others.
    return np.take_along_axis(order, np.argsort(order < 0, axis=1, kind='stable'), axis=1)


def sub_pairs(left: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Pairs (P, 2) among the features ``left``, numbered within them, and their rows (P,) among all of n features."""
    first, second = np.triu_indices(len(left), 1)
    return np.stack([first, second], axis=1), pair_number(left[first], left[second], n)


class PairTree(NamedTuple):
    """The levels of the tree.

    Attributes
    ----------
    pairs : (L, 2) int32
        The data pair of each level.
    rows : (L,) int64
        Its table in the match list.
    quadrants : (L, q) int32
        The order in which the quadrants of its table are entered, -1 at the end of the list.
    side
        Of a quadrant; one quadrant of side e + 1 is the plain search.
    """

    pairs: Int32Array
    rows: IntArray
    quadrants: Int32Array
    side: int


class Limits(NamedTuple):
    """Where a search ends.

    Attributes
    ----------
    in_bin
        Exactly so many features go into the bin.
    interpretations, levels
        Most of them; of the serial search tests instead of levels.
    use_signs
        Whether direction signs are kept consistent.
    look_ahead
        Whether a branch ends when more features than the bin may take have nothing left that agrees with it.
    at_once
        Levels, or tests, between two looks at the clock.
    """

    in_bin: int
    interpretations: int
    levels: int
    use_signs: bool
    look_ahead: bool
    at_once: int = 1


class _State(NamedTuple):
    """What is decided so far: the assignment (n,), signs, features in the bin (1,), open model features (n, e).

    A model feature is open to a data feature while it agrees with everything assigned so far. In ``_saved_states`` each
    array has one more axis, the level.
    """

    assignment: Any
    signs: Any
    in_bin: Any
    open_to: Any


@njit
def _saved_states(depth: int, n: int, e: int, look_ahead: bool) -> _State:
    """Room for what each level found when it was entered; of the assignment only the level's two features.

    Without looking ahead the open model features do not change, and none are kept.
    """
    open_to = np.zeros((depth if look_ahead else 0, n, e), np.bool_)
    return _State(np.zeros((depth, 2), np.int32), stacked_signs(depth, n), np.zeros(depth, np.int64), open_to)


@njit
def _save(state: _State, saved: _State, level: int, a: int, b: int) -> None:
    saved.assignment[level, 0], saved.assignment[level, 1] = state.assignment[a], state.assignment[b]
    save_signs(state.signs, saved.signs, level)
    saved.in_bin[level] = state.in_bin[0]
    if len(saved.open_to) > 0:
        saved.open_to[level] = state.open_to


@njit
def _restore(state: _State, saved: _State, level: int, a: int, b: int) -> None:
    state.assignment[a], state.assignment[b] = saved.assignment[level, 0], saved.assignment[level, 1]
    restore_signs(state.signs, saved.signs, level)
    state.in_bin[0] = saved.in_bin[level]
    if len(saved.open_to) > 0:
        state.open_to[:] = saved.open_to[level]


class Walk(NamedTuple):
    """A depth-first walk, which ends at its limit of levels and goes on from there.

    Attributes
    ----------
    state, saved
        What is decided, and was when each level was entered.
    cursor : (L, 2) int64
        Quadrant and entry in it, of each level.
    place : (3,) int64
        LEVEL that comes next, interpretations FOUND, 1 when ENTERING the level.
    out, out_sign : (m, n)
        The interpretations and their signs.
    """

    state: Any
    saved: Any
    cursor: IntArray
    place: IntArray
    out: Int32Array
    out_sign: Int8Array


def start_walk(depth: int, n: int, e: int, limits: Limits, alive: BoolArray) -> Walk:
    """A walk before its first of so many levels, over n data and e model features; alive : (n, e) bool."""
    return Walk(
        _State(np.full(n, UNASSIGNED, np.int32), unknown_signs(n), np.zeros(1, np.int64), alive.copy()),
        _saved_states(depth, n, e, limits.look_ahead),
        np.zeros((depth, 2), np.int64),
        np.array([0, 0, 1]),
        np.full((limits.interpretations, n), UNASSIGNED, np.int32),
        np.zeros((limits.interpretations, n), np.int8),
    )


@njit
def traverse_pairs(
    tree: PairTree, code: ByteArray, alive: BoolArray, limits: Limits, walk: Walk, counters: IntArray
) -> None:
    """Depth-first over the levels of the tree: appendix C, with the bin.

    code : (P, e, e) uint8, the look-up tables, row and column e of which stand for the bin; alive : (n, e) bool, the
    model features each data feature may take. The walk goes on from its place; it and the counters are changed.
    Backtracks when a pair has no consistent entry; when limits.look_ahead is set, also when more features than the bin
    may still take have no model feature left that agrees with everything assigned so far.
    """
    depth = tree.pairs.shape[0]
    state, saved, cursor, out, out_sign = walk.state, walk.saved, walk.cursor, walk.out, walk.out_sign
    level, found, entering = walk.place[LEVEL], walk.place[FOUND], walk.place[ENTERING] == 1
    while level >= 0:
        a, b = tree.pairs[level, 0], tree.pairs[level, 1]
        if entering:
            if counters[LEVELS] >= limits.levels:
                counters[TRUNCATED] = 1
                break
            counters[LEVELS] += 1
            _save(state, saved, level, a, b)
            cursor[level] = 0
            if state.assignment[a] == UNASSIGNED and state.assignment[b] == UNASSIGNED:
                counters[UNASSIGNED_PAIRS] += 1
        else:
            _restore(state, saved, level, a, b)
        if not _assign_next(tree, level, cursor, code, alive, limits, state, saved, counters):
            counters[BACKTRACKS] += 1
            level -= 1
            entering = False
        elif level + 1 < depth:
            level += 1
            entering = True
        else:
            if state.in_bin[0] == limits.in_bin:
                out[found] = state.assignment
                write_signs(state.signs, state.assignment, out_sign[found])
                found += 1
                if found == limits.interpretations:
                    break
            entering = False
    walk.place[LEVEL], walk.place[FOUND], walk.place[ENTERING] = level, found, 1 if entering else 0


@njit
def _assign_next(
    tree: PairTree,
    level: int,
    cursor: IntArray,
    code: ByteArray,
    alive: BoolArray,
    limits: Limits,
    state: _State,
    saved: _State,
    counters: IntArray,
) -> bool:
    """Assign the level's next consistent entry from the cursor on; False, with nothing assigned, when there is none."""
    e = alive.shape[1]
    side = tree.side
    across = (e + side) // side
    a, b = tree.pairs[level, 0], tree.pairs[level, 1]
    fixed_a, fixed_b = saved.assignment[level, 0], saved.assignment[level, 1]
    table = code[tree.rows[level]]
    first, last = _allowed(fixed_a, e)
    low, high = _allowed(fixed_b, e)
    while cursor[level, 0] < tree.quadrants.shape[1]:
        quadrant = tree.quadrants[level, cursor[level, 0]]
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
        extra = (1 if i == e and fixed_a == UNASSIGNED else 0) + (1 if j == e and fixed_b == UNASSIGNED else 0)
        if state.in_bin[0] + extra > limits.in_bin:
            continue
        if (i < e and not alive[a, i]) or (j < e and not alive[b, j]):
            continue
        if i < e and j < e:
            if table[i, j] == 0:
                continue
            if limits.use_signs and not apply_code(table[i, j], a, b, state.signs):
                counters[SIGN_CUTOFFS] += 1
                restore_signs(state.signs, saved.signs, level)
                continue
        state.assignment[a] = i if i < e else BIN
        state.assignment[b] = j if j < e else BIN
        state.in_bin[0] += extra
        if not limits.look_ahead or UNASSIGNED not in (fixed_a, fixed_b):
            return True
        if fixed_a == UNASSIGNED and i < e:
            _close_inconsistent(a, i, code, state.assignment, state.open_to)
        if fixed_b == UNASSIGNED and j < e:
            _close_inconsistent(b, j, code, state.assignment, state.open_to)
        if state.in_bin[0] + _stranded(alive, state.assignment, state.open_to) <= limits.in_bin:
            return True
        _restore(state, saved, level, a, b)
    return False


@njit
def _allowed(fixed: int, e: int) -> tuple[np.int64 | int, np.int64 | int]:
    """First and one past the last row (or column) of a table that a feature's assignment leaves; e is the bin."""
    if fixed == UNASSIGNED:
        return np.int64(0), e + 1
    at = np.int64(fixed) if fixed >= 0 else e
    return at, at + 1


@njit
def _close_inconsistent(a: int, i: int, code: ByteArray, assignment: Int32Array, open_to: BoolArray) -> None:
    """Feature a is on model feature i: close what disagrees with that, for every unassigned feature."""
    n, e = open_to.shape
    for k in range(n):
        if assignment[k] != UNASSIGNED or k == a:
            continue
        table = code[pair_row(min(a, k), max(a, k), n)]
        for j in range(e):
            if open_to[k, j] and not (table[i, j] if a < k else table[j, i]):
                open_to[k, j] = False


@njit
def _stranded(alive: BoolArray, assignment: Int32Array, open_to: BoolArray) -> int:
    """How many unassigned features that could once be matched have nothing left."""
    count = 0
    for k in range(alive.shape[0]):
        if assignment[k] == UNASSIGNED and not open_to[k].any() and alive[k].any():
            count += 1
    return count
