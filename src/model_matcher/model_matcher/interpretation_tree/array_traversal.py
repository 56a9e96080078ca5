"""Appendix C's TraverseTree on the array machine: serial between levels, parallel within one (thesis 5.7, 5.8, 5.10).

A level's consistent entries are a few logical operations on a table, and ELN finds the next. In subgraph matching a
level goes through its quadrants, those with the fewest matches first; which of them may be entered at all is one test
on a vector of quadrants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dap_emulator import DapArray
from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.kinds import LOGICAL, integer
from msgs_py import BIN
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import BoolArray, Int8Array, Int32Array, IntArray

from .array_signs import ArraySigns
from .array_tables import ArrayTables, Phase
from .tables import pair_number
from .tree import BACKTRACKS, COUNTERS, LEVELS, SIGN_CUTOFFS, TRUNCATED, UNASSIGNED, UNASSIGNED_PAIRS, Limits


@dataclass(eq=False)
class _Level:
    """A level of the search: what is left of it, and what is restored before its next entry is tried.

    Attributes
    ----------
    consistent : (r, c)
        LOGICAL, the entries of the quadrant it is in that are not tried yet; None before the first quadrant.
    part
        The quadrant it is in.
    waiting
        LOGICAL vector of the quadrants not entered yet; None where a table is one part.
    assigned
        Of the level's two features when it was entered.
    in_bin
        Features in the bin then.
    signs
        Root, parity and known then.
    still_open
        For each data feature, a LOGICAL vector of model features.
    """

    consistent: DapArray | None
    part: int
    waiting: DapArray | None
    assigned: tuple[int, int]
    in_bin: int
    signs: tuple[DapArray, ...]
    still_open: list[DapArray]


class ArrayTraversal:
    """Depth-first over the ordered data pairs; model feature e stands for the bin.

    Parameters
    ----------
    tables : ArrayTables
    alive : (n, e) bool
        The model features each data feature may take.
    pairs : (L, 2) int
        The data pair of each level.
    rows : (L,) int
        Its table in the match list.
    limits : Limits
    deadline : Deadline
        When the search stops.

    Attributes
    ----------
    found : list of (assignment, signs)
        (n,) int32 and (n,) int8 of each interpretation.
    counters : (5,) int64
        As of tree.traverse_pairs.
    """

    def __init__(
        self, tables: ArrayTables, alive: BoolArray, pairs: IntArray, rows: IntArray, limits: Limits, deadline: Deadline
    ) -> None:
        self.tables, self.dap, self.pairs, self.rows = tables, tables.dap, pairs, rows
        self.n, self.e = alive.shape
        self.limits, self.deadline = limits, deadline
        self.with_bin = limits.in_bin > 0
        self.counters = np.zeros(len(COUNTERS), np.int64)
        self.assignment = np.full(self.n, UNASSIGNED, np.int32)
        self.in_bin = 0
        self.found: list[tuple[Int32Array, Int8Array]] = []
        with self.dap.at_line(Phase.SIGNS):
            self.group = ArraySigns(self.dap, self.n)
        # What pairs left out needs a mask of its own; the tables hold what single features may be.
        self.restricted = not np.array_equal(alive, tables.unary)
        self.alive = alive
        self.open: list[DapArray] = [self.dap.vector(row) for row in alive] if limits.look_ahead else []
        self.once = [bool(row.any()) for row in alive]
        self._counts: dict[int, DapArray] = {}

    def run(self) -> None:
        """Fill ``found``, up to the limit; counters[TRUNCATED] is set when levels or time run out."""
        with self.dap.at_line(Phase.TRAVERSAL):
            self._run()

    def _run(self) -> None:
        pending: list[_Level] = []
        current = self._enter(0)
        level = 0
        while True:
            step = self._next(level, current)
            if step and level + 1 < len(self.pairs):
                if self.counters[LEVELS] >= self.limits.levels or self.deadline.passed:
                    self.counters[TRUNCATED] = 1
                    return
                pending.append(current)
                level += 1
                current = self._enter(level)
                continue
            if step:
                if self.in_bin == self.limits.in_bin:
                    self.found.append((self.assignment.copy(), self.group.written(self.assignment)))
                    if len(self.found) == self.limits.interpretations:
                        return
                self._restore(level, current)
                continue
            self.counters[BACKTRACKS] += 1
            if level == 0:
                return
            level -= 1
            current = pending.pop()
            self._restore(level, current)

    def _enter(self, level: int) -> _Level:
        """A level none of whose entries is tried yet: CALL TraverseTree."""
        self.counters[LEVELS] += 1
        self.dap.charge_mcu('call', round(self.dap.costs['mcu_call']))
        a, b = self.pairs[level]
        fixed = int(self.assignment[a]), int(self.assignment[b])
        if fixed == (UNASSIGNED, UNASSIGNED):
            self.counters[UNASSIGNED_PAIRS] += 1
        with self.dap.at_line(Phase.SIGNS):
            signs = self.group.saved() if self.limits.use_signs else ()
        waiting, consistent = None, None
        if len(self.tables.parts) > 1:
            waiting = self._quadrants(int(self.rows[level]), fixed)
        else:
            consistent = self._consistent(level, 0, fixed)
        return _Level(consistent, 0, waiting, fixed, self.in_bin, signs, list(self.open))

    # Quadrants (thesis 5.8).

    def _quadrants(self, row: int, fixed: tuple[int, int]) -> DapArray:
        """The four tests of a pair's quadrants at once: matches there, and assigned model edges on their sides."""
        may = self._matches(row) > 0
        parts = self.tables.parts
        for k, label in enumerate(fixed):
            if label == UNASSIGNED:
                continue
            sides = [part.columns if k == 0 else part.rows for part in parts]
            begin, end = (self.dap.vector(np.array([side[j] for side in sides]), integer()) for j in range(2))
            feature = label if label >= 0 else self.e
            may = may & (begin <= feature) & (end > feature)
        return may

    def _matches(self, row: int) -> DapArray:
        """Matches of each quadrant of a table, a vector; summed once."""
        if row not in self._counts:
            with self.dap.at_line(Phase.SORT):
                counts = [
                    0 if (plane := self.tables.table(row, part, self.with_bin)) is None else int(f.sum_(plane))
                    for part in range(len(self.tables.parts))
                ]
                self._counts[row] = self.dap.vector(np.array(counts), integer())
        return self._counts[row]

    def _next_quadrant(self, level: int, entries: _Level) -> bool:
        """Go to the quadrant of fewest matches among those that wait; False when there is none."""
        if entries.waiting is None or not f.any_(entries.waiting):
            return False
        part = f.eln(f.minp(self._matches(int(self.rows[level])), entries.waiting)) - 1
        entries.waiting[part] = False
        entries.part, entries.consistent = part, self._consistent(level, part, entries.assigned)
        return True

    # Entries.

    def _consistent(self, level: int, part: int, fixed: tuple[int, int]) -> DapArray | None:
        """Appendix C's ConsistentMatch: the table, where it agrees with what is assigned and still fits the bin."""
        table = self.tables.table(int(self.rows[level]), part, self.with_bin)
        if table is None:
            return None
        labels = self.tables.labels(part, self.with_bin)
        mask: DapArray = table
        for label, edge in zip(fixed, labels):
            wanted = 0 if label == UNASSIGNED else label + 1 if label >= 0 else self.e + 1
            mask = mask & (edge.compare('eq', wanted) | (wanted == 0))
        if self.restricted:
            mask = mask & self._possible(level, part, mask.shape)
        if self.with_bin:
            mask = mask & ~self._overfull(labels, fixed)
        return mask

    def _possible(self, level: int, part: int, shape: tuple[int, ...]) -> DapArray:
        """What elimination has left of a part's rows and columns; the bin always."""
        sides = []
        for feature, (begin, _), extent in zip(
            self.pairs[level], (self.tables.parts[part].columns, self.tables.parts[part].rows), shape[::-1]
        ):
            row = np.append(self.alive[feature], True)
            sides.append(self.dap.vector(row[begin : begin + extent]))
        left: DapArray = f.matr(sides[0], shape[0]) & f.matc(sides[1], shape[1])
        return left

    def _overfull(self, labels: tuple[DapArray, DapArray], fixed: tuple[int, int]) -> DapArray:
        """The entries that would put more features into the bin than it may hold (thesis 5.10)."""
        room = self.limits.in_bin - self.in_bin
        to_bin = [
            labels[k].compare('eq', self.e + 1)
            if fixed[k] == UNASSIGNED
            else f.filled(self.dap, False, labels[k].shape)
            for k in range(2)
        ]
        if room < 1:
            return to_bin[0] | to_bin[1]
        return to_bin[0] & to_bin[1] if room < 2 else f.filled(self.dap, False, labels[0].shape)

    def _next(self, level: int, entries: _Level) -> bool:
        """Assign the level's next consistent entry; False when there is none."""
        a, b = (int(k) for k in self.pairs[level])
        fixed_a, fixed_b = entries.assigned
        while True:
            k = 0 if entries.consistent is None else f.eln(entries.consistent)
            if k == 0:
                if self._next_quadrant(level, entries):
                    continue
                return False
            assert entries.consistent is not None
            part, height = self.tables.parts[entries.part], entries.consistent.shape[0]
            column, row = (k - 1) // height, (k - 1) % height
            entries.consistent[row, column] = False
            i, j = part.columns[0] + column, part.rows[0] + row
            if self.limits.use_signs and i < self.e and j < self.e:
                planes = self.tables.signs[self.rows[level]][entries.part]
                with self.dap.at_line(Phase.SIGNS):
                    if not self.group.apply(planes, a, b, (row, column)):
                        self.counters[SIGN_CUTOFFS] += 1
                        self.group.restore(entries.signs)
                        continue
            # Appendix C's scalar operations between ELN and the next level: loads of the pair, labels, stores, tests.
            self.dap.charge_mcu('scalar', 8 * self.dap.costs.mcu())
            self.assignment[a], self.assignment[b] = (i if i < self.e else BIN), (j if j < self.e else BIN)
            self.in_bin += (i == self.e and fixed_a == UNASSIGNED) + (j == self.e and fixed_b == UNASSIGNED)
            if self.limits.look_ahead and UNASSIGNED in (fixed_a, fixed_b) and self._hopeless((a, b), (i, j), entries):
                self._restore(level, entries)
                continue
            return True

    def _restore(self, level: int, entries: _Level) -> None:
        """Go back to what was decided when the level was entered."""
        a, b = self.pairs[level]
        self.assignment[a], self.assignment[b] = entries.assigned
        self.in_bin = entries.in_bin
        if self.limits.use_signs:
            with self.dap.at_line(Phase.SIGNS):
                self.group.restore(entries.signs)
        self.open = list(entries.still_open)

    # Looking ahead (thesis 7.4).

    def _hopeless(self, features: tuple[int, int], choices: tuple[int, int], entries: _Level) -> bool:
        """More features than the bin may take have no model feature left that agrees."""
        for k, choice, fixed in zip(features, choices, entries.assigned):
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
            line = self.tables.line(pair_number(min(a, k), max(a, k), self.n), i, a < k)
            self.open[k] = self.open[k] & self.dap.vector(line, LOGICAL)
