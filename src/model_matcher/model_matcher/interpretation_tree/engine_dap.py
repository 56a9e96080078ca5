"""The thesis' searches on the emulated array machine (thesis 5.7 to 5.10, appendix C): the native interpretations.

With params.eliminate off this is the algorithm as printed: ranges, tables, sorts, traversal, direction signs and bin
are made by the machine and charged to it, phase by phase. The cycles are computed and not simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dap_emulator import Dap, OutOfStore
from msgs_py import BIN, FeatureSet
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import BoolArray, Int8Array

from ..model.index import ModelIndex
from ..params import MatchParams
from .array_elimination import alive_for
from .array_sorts import sort_pairs
from .array_tables import ArrayTables, Phase
from .array_traversal import ArrayTraversal
from .settings import INTERPRETATIONS, LARGEST_PAIRS
from .tables import Tables
from .tree import UNASSIGNED, Limits, Traversed, TreeResult, search_with_bin, sub_pairs, without_pairs


def tree_search(
    index: ModelIndex,
    data: FeatureSet,
    params: MatchParams,
    limit: int = INTERPRETATIONS,
    dap: Dap | None = None,
    deadline: Deadline | None = None,
) -> TreeResult:
    """Search the interpretation tree on the emulated machine; the interpretations are those of tree.tree_search.

    Parameters
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        Usable features (none without length), camera frame, metres.
    params : MatchParams
        search ('subgraph': by quadrants), ordering, constraints, ranges, signs, max_bin, eliminate, real_bytes,
        tolerances and time limit.
    limit : int
        Most interpretations that are returned.
    dap : Dap, optional
        The machine; a new DAP 510 when not given.
    deadline : Deadline, optional
        After params.time_limit_s when not given.

    Returns
    -------
    TreeResult
        With dap_cycles, dap_seconds, dap_planes and dap_phases (seconds of each phase, by name) in its statistics.

    Raises
    ------
    ValueError
        When the tables do not fit the machine's store, or are not made in time.

    References
    ----------
    Thesis 5.7, 5.8, 5.10 and appendix C.
    """
    n = len(data)
    if n * (n - 1) // 2 > LARGEST_PAIRS:
        raise ValueError(f'engine: dap: {n * (n - 1) // 2} data pairs are too many, expected at most {LARGEST_PAIRS}')
    dap = dap or Dap.model('510', tracing=False)
    deadline = deadline or Deadline(params.time_limit_s)
    with dap.measured() as so_far:
        try:
            with in_time(dap, deadline):
                tables = ArrayTables(dap, index, data, params)
            search = _Search(tables, params, deadline)
            # The search needs to know how many features there are, and asks for the rest of the tables in parts.
            known = Tables(tables.pairs, np.zeros((0, 0, 0), np.uint8), tables.unary, tables.curves)
            result = search_with_bin(known, params, limit, deadline, search.alive, search.traverse)
        except OutOfStore as error:
            raise ValueError(f'engine: dap: {error}') from None
        spent = so_far()
    result.stats.update(
        dap_cycles=spent.cycles,
        dap_seconds=spent.seconds,
        dap_planes=spent.peak_planes,
        dap_phases={phase.name.lower(): spent.lines[phase][1] * dap.clock_s for phase in Phase if phase in spent.lines},
    )
    return result


@contextmanager
def in_time(dap: Dap, deadline: Deadline) -> Iterator[None]:
    """What the machine does inside ends with ValueError at the deadline."""
    before = dap.watch

    def look() -> None:
        if deadline.passed:
            raise ValueError(f'engine: dap: {deadline.seconds:.3g} s were not enough for the tables of so much data')
        if before is not None:
            before()

    dap.watch = look
    try:
        yield
    finally:
        dap.watch = before


class _Search:
    """What search_with_bin asks of the machine, with the tables made."""

    def __init__(self, tables: ArrayTables, params: MatchParams, deadline: Deadline) -> None:
        self.tables, self.params, self.deadline = tables, params, deadline

    def alive(self, size: int) -> BoolArray:
        """The pairings (n, e) bool that an interpretation of this size is searched among."""
        if not self.params.eliminate:
            return self.tables.unary.copy()
        with in_time(self.tables.dap, self.deadline):
            return alive_for(self.tables, size)

    def traverse(
        self, _: Tables, alive: BoolArray, params: MatchParams, in_bin: int, limit: int, levels: int
    ) -> Traversed:
        """As tree.traverse_left, on the machine; it also stops at the deadline."""
        trivial = without_pairs(alive, in_bin, limit)
        if trivial is not None:
            return trivial
        tables, n = self.tables, len(alive)
        left = np.flatnonzero(alive.any(axis=1))
        pairs, rows = sub_pairs(left, n)
        sums = np.array([tables.sums[row] for row in rows])
        with tables.dap.at_line(Phase.SORT):
            order = sort_pairs(tables.dap, pairs, sums, params.ordering, tables.curves[left])
        in_bin -= n - len(left)
        limits = Limits(in_bin, limit, levels, params.signs, params.eliminate and in_bin > 0)
        search = ArrayTraversal(tables, alive, left[pairs[order]], rows[order], limits, self.deadline)
        search.run()
        assignments = np.full((len(search.found), n), BIN, np.int32)
        signs: Int8Array = np.zeros((len(search.found), n), np.int8)
        for row, (assignment, sign) in enumerate(search.found):
            assignments[row] = np.where(assignment == UNASSIGNED, BIN, assignment)
            signs[row] = sign
        return Traversed(assignments, signs, search.counters)
