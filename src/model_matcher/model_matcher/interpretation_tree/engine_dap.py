"""The tree search on the emulated array machine (thesis 5.7, appendix C): the same tables and interpretations.

A PE holds one pair of model features. For every data pair the constraints are tested on all PEs at once and kept as
bit-planes: the look-up table and the direction signs it allows. The traversal is serial between levels and parallel
within one: a level's consistent entries are a few logical operations, and ELN finds the next. Every operation is
charged to the machine; stats hold dap_cycles and dap_seconds, computed and not simulated.

Matrices are laid with the second data feature's model feature along the rows, because ELN counts down the columns and
the native search takes the first feature's model feature as its outer loop.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from dap_emulator import Dap, DapArray, OutOfStore
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import LOGICAL, integer, real
from msgs_py import BIN, FeatureSet
from msgs_py.numeric.typed import BoolArray, Int8Array, Int32Array, IntArray

from ..geometry import constraints as c
from ..geometry.settings import ROUNDING
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams
from .ordering import order_pairs
from .settings import INTERPRETATIONS
from .tables import (
    Tables,
    all_pairs,
    constraints_used,
    data_ranges,
    model_ranges,
    pair_number,
    position_errors,
    unary_table,
)
from .tree import (
    BACKTRACKS,
    COUNTERS,
    LEVELS,
    SIGN_CUTOFFS,
    TRUNCATED,
    UNASSIGNED,
    UNASSIGNED_PAIRS,
    Limits,
    Traversed,
    TreeResult,
    search_with_bin,
    sub_pairs,
    without_pairs,
)

SIGN_BITS = (c.SAME, c.DIFFERENT, c.A_PLUS, c.A_MINUS, c.B_PLUS, c.B_MINUS)
WORD = real(8)  # ranges, lengths and tolerances on the machine: 8 bytes
COUNT = integer(4)  # matches of a pair: 4 bytes
SMALL = integer(2)  # feature numbers: 2 bytes
# Larger than any number of matches: what a pair's number becomes once the sorts of appendix C have taken the pair.
TAKEN = 2**30


def tree_search(
    index: ModelIndex, data: FeatureSet, params: MatchParams, limit: int = INTERPRETATIONS, dap: Dap | None = None
) -> TreeResult:
    """Search the interpretation tree on the emulated machine; the interpretations are those of tree.tree_search.

    Parameters
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        Usable features (none without length), camera frame, metres.
    params : MatchParams
        ordering, constraints, signs, max_bin, tolerances and time limit.
    limit : int
        Most interpretations that are returned.
    dap : Dap, optional
        The machine; a new DAP 510 when not given.

    Returns
    -------
    TreeResult
        With dap_cycles, dap_seconds, dap_table_seconds and dap_planes in its statistics.

    Raises
    ------
    ValueError
        When the tables do not fit the machine's store.

    References
    ----------
    Thesis 5.7 and appendix C.
    """
    dap = dap or Dap.model('510', tracing=False)
    before = dap.cycles
    started = time.perf_counter()
    try:
        tables = DapTables(dap, index, data, params)
        making = dap.cycles - before
        deadline = started + params.time_limit_s
        result = search_with_bin(
            tables.tables,
            params,
            limit,
            None,
            True,
            lambda _, alive, params, in_bin, most, levels: _traverse_left(
                tables, alive, params, in_bin, most, levels, deadline
            ),
        )
    except OutOfStore as error:
        raise ValueError(f'engine: dap: {error}') from None
    spent = dap.cycles - before
    result.stats.update(
        dap_cycles=spent,
        dap_seconds=spent * dap.clock_s,
        dap_table_seconds=making * dap.clock_s,
        dap_planes=dap.store.peak,
    )
    return result


class DapTables:
    """The look-up tables as bit-planes on the machine, and a copy for the host's bookkeeping.

    match[p], signs[p] : LOGICAL (e, e) planes of data pair p, rows the second feature; tables : the native Tables
    """

    def __init__(self, dap: Dap, index: ModelIndex, data: FeatureSet, params: MatchParams) -> None:
        self.dap = dap
        n, e = len(data), len(index)
        pairs = all_pairs(n)
        tolerances = data_tolerances(data, feature_rows(data), index.size, params)
        unary = unary_table(index, data, tolerances, params)
        self.use = constraints_used(params).tolist()
        self.sign_test = params.signs
        model = model_ranges(index).transpose(1, 0, 2)
        self.angle = dap.matrix(model[:, :, 2], WORD)
        # Bounds widened by the rounding that the test allows, once for all data pairs.
        self.low = {k: dap.matrix(model[:, :, k], WORD) - ROUNDING for k in (0, 4, 6, 8)}
        self.high = {k: dap.matrix(model[:, :, k + 1], WORD) + ROUNDING for k in (0, 4, 6, 8)}
        self.crossed = dap.matrix(model[:, :, 10], WORD) > 0.0
        self.one_edge = f.unit_diagonal(dap, e, e)
        self.lengths = f.matr(dap.vector(2.0 * index.rows[:, 6], WORD))
        possible = [dap.vector(row) for row in unary]
        error = position_errors(tolerances)
        ranges = data_ranges(data, index.size, params, tolerances)
        # The data's own look-up tables: one vector over the pairs for every bound (thesis 5.7).
        bounds = [dap.vector(ranges[:, k], WORD) for k in range(ranges.shape[1])] if len(pairs) else []
        self.match: list[DapArray] = []
        self.signs: list[tuple[DapArray, ...]] = []
        code = np.zeros((len(pairs), e, e), np.uint8)
        for p, (a, b) in enumerate(pairs):
            numbers = [float(bound[p]) for bound in bounds]
            match, signs = self._constrain(numbers, float(error[a] + error[b]))
            match = match & f.matr(possible[a]) & f.matc(possible[b])
            self.match.append(match)
            self.signs.append(signs)
            for plane, bit in zip(signs, SIGN_BITS):
                code[p] |= np.where(plane.values & match.values, np.uint8(bit), np.uint8(0)).T
        self.tables = Tables(pairs, code, unary)
        self.sums = [int(f.sum_(match)) for match in self.match]

    def _inside(self, low: float, high: float, k: int) -> DapArray:
        return (self.low[k] <= low) & (self.high[k] >= high)

    def _constrain(self, data: list[float], slack: float) -> tuple[DapArray, tuple[DapArray, ...]]:
        """The constraints of one data pair on all model pairs: which agree, and the six sign planes."""
        dap, shape, pi = self.dap, self.angle.shape, np.pi
        yes = f.filled(dap, True, shape, LOGICAL)
        match = same = different = yes
        ends = [[yes, yes], [yes, yes]]
        if self.use[c.DISTANCE]:
            match = f.merge(self.lengths + slack >= data[1], self._inside(data[0], data[1], 0), self.one_edge)
        if self.use[c.ANGLE]:
            rounding = ROUNDING
            same = (self.angle >= data[3] - rounding) & (self.angle <= data[2] + rounding)
            different = (self.angle >= pi - data[2] - rounding) & (self.angle <= pi - data[3] + rounding)
        for k in range(2):
            if not self.use[c.DIRECTION1 + k]:
                continue
            low, high = data[4 + 2 * k], data[5 + 2 * k]
            if data[0] > 2.0 * slack and low < pi and high > 0.0:
                # Two pieces of one edge, clear of each other, would have to lie on one line.
                match = match & ~self.one_edge
            ends[k] = [
                self._inside(low, high, 4 + 2 * k) | self.one_edge,
                self._inside(pi - high, pi - low, 4 + 2 * k) | self.one_edge,
            ]
        if self.use[c.DIRECTION3] and data[10] > 0.0:
            free = ~self.crossed | self.one_edge
            same = same & (self._inside(data[8], data[9], 8) | free)
            different = different & (self._inside(pi - data[9], pi - data[8], 8) | free)
        (a_plus, a_minus), (b_plus, b_minus) = ends
        match = match & (same | different) & (a_plus | a_minus) & (b_plus | b_minus)
        if self.sign_test:
            match = match & (
                (same & ((a_plus & b_plus) | (a_minus & b_minus)))
                | (different & ((a_plus & b_minus) | (a_minus & b_plus)))
            )
        return match, (same, different, a_plus, a_minus, b_plus, b_minus)


def sort_pairs(dap: Dap, pairs: IntArray, sums: IntArray, ordering: str) -> IntArray:
    """(P,) int64: ordering.order_pairs by appendix C's means, minima and their first position, on the machine."""
    if ordering == 'consistency':
        return order_pairs(pairs, sums, ordering)
    count = dap.vector(np.asarray(sums), COUNT)
    if ordering in ('holder_buxton', 'worst'):
        order = []
        for _ in range(len(pairs)):
            position = f.eln(f.minp(count) if ordering == 'holder_buxton' else f.maxp(count))
            order.append(position - 1)
            count[position - 1] = TAKEN if ordering == 'holder_buxton' else -1
        return np.array(order, dtype=np.int64)
    second = dap.vector(np.asarray(pairs)[:, 1], SMALL)
    order = []
    start = f.eln(f.minp(count)) if ordering == 'combined' else 0
    if start:
        order.append(start - 1)
    # Groups are met in the order of their second feature; within a group the list's order is that of the first.
    for group in range(1, int(np.asarray(pairs)[:, 1].max()) + 1):
        members = second.compare('eq', group)
        if start:
            members[start - 1] = False
        if not f.any_(members):
            continue
        position = f.eln(f.minp(count, members))
        while position:
            order.append(position - 1)
            members[position - 1] = False
            position = f.eln(members)
    return np.array(order, dtype=np.int64)


def _traverse_left(
    store: DapTables, alive: BoolArray, params: MatchParams, in_bin: int, limit: int, levels: int, deadline: float
) -> Traversed:
    """As tree.traverse_left, on the machine; it also stops when perf_counter() passes ``deadline``."""
    trivial = without_pairs(alive, in_bin, limit)
    if trivial is not None:
        return trivial
    n = len(alive)
    left = np.flatnonzero(alive.any(axis=1))
    pairs, rows = sub_pairs(left, n)
    order = sort_pairs(store.dap, pairs, np.array([store.sums[row] for row in rows]), params.ordering)
    limits = Limits(in_bin - (n - len(left)), limit, levels, params.signs)
    search = _Traversal(store, alive, left[pairs[order]], rows[order], limits, deadline)
    search.run()
    assignments = np.full((len(search.found), n), BIN, np.int32)
    signs = np.zeros((len(search.found), n), np.int8)
    for row, (assignment, sign) in enumerate(search.found):
        assignments[row] = np.where(assignment == UNASSIGNED, BIN, assignment)
        signs[row] = sign
    return Traversed(assignments, signs, search.counters)


class _Entries(NamedTuple):
    """The consistent entries of a level that are left, and what is restored before the next of them is tried.

    Attributes
    ----------
    consistent : (side, side)
        LOGICAL.
    assigned
        Of the level's two features when it was entered.
    in_bin
        Features in the bin.
    signs
        Root, parity and known.
    still_open
        For each data feature, a LOGICAL vector of model features.
    """

    consistent: DapArray
    assigned: tuple[int, int]
    in_bin: int
    signs: tuple[DapArray, ...]
    still_open: list[DapArray]


class _Traversal:
    """Depth-first over the ordered data pairs; model feature e stands for the bin."""

    def __init__(
        self, store: DapTables, alive: BoolArray, pairs: IntArray, rows: IntArray, limits: Limits, deadline: float
    ) -> None:
        self.store, self.dap, self.pairs, self.rows = store, store.dap, pairs, rows
        self.n, self.e = alive.shape
        self.limits, self.deadline = limits, deadline
        self.side = self.e + (1 if limits.in_bin else 0)
        self.counters = np.zeros(len(COUNTERS), np.int64)
        self.assignment = np.full(self.n, UNASSIGNED, np.int32)
        self.in_bin = 0
        self.found: list[tuple[Int32Array, Int8Array]] = []
        self.group = _Signs(self.dap, self.n)
        possible = np.ones((self.n, self.side), bool)
        possible[:, : self.e] = alive
        self.possible = [self.dap.vector(row) for row in possible]
        self.open: list[DapArray] = [self.dap.vector(row) for row in alive]
        self.once = [bool(row.any()) for row in alive]

    def run(self) -> None:
        """Fill ``found``, up to the limit; counters[TRUNCATED] is set when levels or time run out."""
        pending: list[_Entries] = []
        entries = self._enter(0)
        level = 0
        while True:
            step = self._next(level, entries)
            if step and level + 1 < len(self.pairs):
                if self.counters[LEVELS] >= self.limits.levels or time.perf_counter() > self.deadline:
                    self.counters[TRUNCATED] = 1
                    return
                pending.append(entries)
                level += 1
                entries = self._enter(level)
                continue
            if step:
                if self.in_bin == self.limits.in_bin:
                    self.found.append((self.assignment.copy(), self.group.signs(self.assignment)))
                    if len(self.found) == self.limits.interpretations:
                        return
                self._restore(level, entries)
                continue
            self.counters[BACKTRACKS] += 1
            if level == 0:
                return
            level -= 1
            entries = pending.pop()
            self._restore(level, entries)

    def _enter(self, level: int) -> _Entries:
        """The consistent entries of a level, none of them tried yet."""
        self.counters[LEVELS] += 1
        a, b = self.pairs[level]
        fixed_a, fixed_b = int(self.assignment[a]), int(self.assignment[b])
        if fixed_a == UNASSIGNED and fixed_b == UNASSIGNED:
            self.counters[UNASSIGNED_PAIRS] += 1
        consistent = self._consistent(level, a, b, fixed_a, fixed_b)
        return _Entries(consistent, (fixed_a, fixed_b), self.in_bin, self.group.saved(), list(self.open))

    def _consistent(self, level: int, a: int, b: int, fixed_a: int, fixed_b: int) -> DapArray:
        """Appendix C's ConsistentMatch: the table, restricted by what is assigned, alive and still fits the bin."""
        dap, e, side = self.dap, self.e, self.side
        table = self.store.match[self.rows[level]]
        if self.limits.in_bin:
            padded = np.ones((side, side), bool)
            padded[:e, :e] = table.values
            table = table.like(LOGICAL, padded)
            table.charge('copy', LOGICAL)
        mask: DapArray = table & f.matr(self.possible[a], side) & f.matc(self.possible[b], side)
        for fixed, pattern in ((fixed_a, f.col), (fixed_b, f.row)):
            if fixed != UNASSIGNED:
                mask = mask & pattern(dap, (fixed if fixed >= 0 else e) + 1, side, side)
        if self.limits.in_bin:
            room = self.limits.in_bin - self.in_bin
            to_bin_a = f.col(dap, e + 1, side, side) if fixed_a == UNASSIGNED else None
            to_bin_b = f.row(dap, e + 1, side, side) if fixed_b == UNASSIGNED else None
            for one in (to_bin_a, to_bin_b):
                if one is not None and room < 1:
                    mask = mask & ~one
            if to_bin_a is not None and to_bin_b is not None and room < 2:
                mask = mask & ~(to_bin_a & to_bin_b)
        return mask

    def _next(self, level: int, entries: _Entries) -> bool:
        """Assign the level's next consistent entry; False when there is none."""
        consistent, (fixed_a, fixed_b) = entries.consistent, entries.assigned
        a, b = (int(k) for k in self.pairs[level])
        e, side = self.e, self.side
        while True:
            k = f.eln(consistent)
            if k == 0:
                return False
            i, j = (k - 1) // side, (k - 1) % side
            consistent[j, i] = False
            if i < e and j < e and self.limits.use_signs and not self._apply_signs(self.rows[level], a, b, i, j):
                self.counters[SIGN_CUTOFFS] += 1
                self.group.restore(entries.signs)
                continue
            self.dap.charge_mcu('scalar', 8 * self.dap.costs.mcu())
            self.assignment[a], self.assignment[b] = (i if i < e else BIN), (j if j < e else BIN)
            extra = (i == e and fixed_a == UNASSIGNED) + (j == e and fixed_b == UNASSIGNED)
            self.in_bin += extra
            if self.limits.in_bin and UNASSIGNED in (fixed_a, fixed_b) and self._hopeless(a, b, i, j, fixed_a, fixed_b):
                self._restore(level, entries)
                continue
            return True

    def _restore(self, level: int, entries: _Entries) -> None:
        """Go back to what was decided when the level was entered."""
        a, b = self.pairs[level]
        self.assignment[a], self.assignment[b] = entries.assigned
        self.in_bin = entries.in_bin
        self.group.restore(entries.signs)
        self.open = list(entries.still_open)

    def _apply_signs(self, row: int, a: int, b: int, i: int, j: int) -> bool:
        """Take over the signs of a table entry (signs.apply_code): absolute signs first, then the relation."""
        same, different, *ends = (bool(plane[j, i]) for plane in self.store.signs[row])
        for k, (plus, minus) in ((a, ends[:2]), (b, ends[2:])):
            if plus != minus and not self.group.set_sign(k, 1 if plus else -1):
                return False
        return same == different or self.group.relate(a, b, 1 if same else -1)

    def _hopeless(self, a: int, b: int, i: int, j: int, fixed_a: int, fixed_b: int) -> bool:
        """Look ahead: more features than the bin may take have no model feature left that agrees."""
        for k, choice, fixed in ((a, i, fixed_a), (b, j, fixed_b)):
            if fixed == UNASSIGNED and choice < self.e:
                self._close_inconsistent(k, choice)
        stranded = sum(
            1 for k in range(self.n) if self.assignment[k] == UNASSIGNED and self.once[k] and not f.any_(self.open[k])
        )
        return self.in_bin + stranded > self.limits.in_bin

    def _close_inconsistent(self, a: int, i: int) -> None:
        """Feature a is on model feature i: close what disagrees, by a row or column of each of its tables."""
        for k in range(self.n):
            if self.assignment[k] != UNASSIGNED or k == a:
                continue
            table = self.store.match[pair_number(min(a, k), max(a, k), self.n)]
            line = table.values[:, i] if a < k else table.values[i, :]
            table.charge('broadcast', LOGICAL)
            self.open[k] = self.open[k] & self.dap.vector(np.ascontiguousarray(line))


class _Signs:
    """Direction signs as vectors over the data features (thesis 5.7.2): a step changes a whole group at once."""

    def __init__(self, dap: Dap, n: int) -> None:
        self.dap = dap
        self.root = dap.vector(np.arange(n, dtype=np.int16))
        self.parity = dap.vector(np.ones(n, dtype=np.int8))
        self.known = dap.vector(np.zeros(n, dtype=np.int8))

    def saved(self) -> tuple[DapArray, ...]:
        return self.root.copy(), self.parity.copy(), self.known.copy()

    def restore(self, saved: tuple[DapArray, ...]) -> None:
        self.root, self.parity, self.known = (vector.copy() for vector in saved)

    def set_sign(self, k: int, sign: int) -> bool:
        """Give feature k an absolute sign; False when it is known to have the other."""
        root = int(self.root[k])
        wanted, now = sign * int(self.parity[k]), int(self.known[root])
        if now == 0:
            self.known[root] = wanted
        return now in (0, wanted)

    def relate(self, a: int, b: int, relation: int) -> bool:
        """Make b's sign equal (1) or opposite (-1) to a's; False when that contradicts what is known."""
        root_a, root_b = int(self.root[a]), int(self.root[b])
        factor = relation * int(self.parity[a]) * int(self.parity[b])
        if root_a == root_b:
            return factor == 1
        known_a, known_b = int(self.known[root_a]), int(self.known[root_b])
        if known_a and known_b and known_b != factor * known_a:
            return False
        keep, give = min(root_a, root_b), max(root_a, root_b)
        if int(self.known[keep]) == 0:
            self.known[keep] = factor * int(self.known[give])
        group = self.root.compare('eq', give)
        self.root.assign(keep, group)
        if factor < 0:
            self.parity.assign(-self.parity, group)
        return True

    def signs(self, assignment: Int32Array) -> Int8Array:
        """(n,) int8: absolute signs, 0 where unknown or in the bin."""
        root: Any = self.root.values.astype(np.int64)
        signs = self.known.values[root] * self.parity.values
        return np.where(assignment < 0, 0, signs).astype(np.int8)
