"""The serial search of Grimson and Lozano-Perez, as a baseline (thesis 5.2, 5.11.3.2).

Data features are taken by decreasing length; each is tried on every model feature and tested against all assigned
before it, constraint by constraint, nothing tabulated beforehand but the ranges. The bin is the last branch.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import LOOK_S
from msgs_py.numeric.typed import BoolArray, Int8Array, Int32Array, IntArray

from ..geometry.constraints import entry
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..params import MatchParams
from .settings import INTERPRETATIONS, LARGEST_PAIRS, RATES
from .signs import Signs, apply_code, restore_signs, save_signs, stacked_signs, unknown_signs, write_signs
from .tables import PairTests, pair_row, pair_tests, unary_table
from .tree import (
    BACKTRACKS,
    COUNTERS,
    ENTERING,
    FOUND,
    LEVEL,
    LEVELS,
    SIGN_CUTOFFS,
    TRUNCATED,
    Limits,
    TreeResult,
    until,
)

WORK = len(COUNTERS)  # one more counter: pair tests and what counts as such


def serial_search(
    index: ModelIndex,
    data: FeatureSet,
    params: MatchParams,
    limit: int = INTERPRETATIONS,
    deadline: Deadline | None = None,
) -> TreeResult:
    """Find the feasible interpretations with the fewest features in the bin.

    Parameters
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        Usable features (none without length), camera frame, metres.
    params : MatchParams
        constraints, signs, max_bin, tolerances and time limit.
    limit : int
        Most interpretations that are returned.
    deadline : Deadline, optional
        After params.time_limit_s when not given.

    Returns
    -------
    TreeResult
        Its statistics count the nodes visited as levels.

    Raises
    ------
    ValueError
        When there are too many data pairs to keep the ranges of.

    References
    ----------
    W. E. L. Grimson and T. Lozano-Perez (1987), Localizing overlapping parts by searching the interpretation tree.
    """
    n = len(data)
    if n * (n - 1) // 2 > LARGEST_PAIRS:
        raise ValueError(f"{n * (n - 1) // 2} data pairs are too many for search='serial'; use search='hypotheses'")
    rows = feature_rows(data)
    tolerances = data_tolerances(data, rows, index.size, params)
    unary = unary_table(index, data, tolerances, params)
    length = np.where(data.kind == FeatureKind.CURVE, 0.0, data.lengths)
    order = np.argsort(-length, kind='stable')
    tests = pair_tests(index, rows[order], tolerances[order], params)
    counters = np.zeros(len(COUNTERS) + 1, np.int64)
    most = max(n - params.min_matched, 0) if params.max_bin is None else min(params.max_bin, n)
    deadline = deadline or Deadline(params.time_limit_s)
    budget = int(deadline.left * RATES.tests)
    impossible = int((~unary.any(axis=1)).sum())
    assignments, signs = np.zeros((0, n), np.int32), np.zeros((0, n), np.int8)
    for in_bin in range(impossible, most + 1):
        limits = Limits(in_bin, limit, budget, params.signs, False, max(1, int(LOOK_S * RATES.tests)))
        descent = _start(n, limits)

        def go_on(some: Limits, descent: Descent = descent) -> None:
            _descend(tests, unary[order], some, descent, counters)

        until(go_on, limits, descent.place, counters, WORK, deadline)
        found, inner, inner_signs = int(descent.place[FOUND]), descent.out, descent.out_sign
        if found or counters[TRUNCATED]:
            assignments = np.full((found, n), BIN, np.int32)
            signs = np.zeros((found, n), np.int8)
            assignments[:, order], signs[:, order] = inner[:found], inner_signs[:found]
            break
    stats = dict(zip(COUNTERS, counters.tolist()))
    return TreeResult(assignments, signs, not stats['truncated'], stats)


class Descent(NamedTuple):
    """A depth-first descent, which ends at its limit of tests and goes on from there.

    Attributes
    ----------
    assignment, cursor : (n,)
        What is decided, and the next model feature to try, of each level.
    signs, saved
        Direction signs, and those when each level was entered.
    saved_bin : (n + 1,) int64
        Features in the bin when a level is entered.
    place : (3,) int64
        LEVEL that comes next, interpretations FOUND, 1 when ENTERING the level.
    out, out_sign : (m, n)
        The interpretations and their signs.
    """

    assignment: Int32Array
    cursor: IntArray
    signs: Any
    saved: Any
    saved_bin: IntArray
    place: IntArray
    out: Int32Array
    out_sign: Int8Array


def _start(n: int, limits: Limits) -> Descent:
    """The descent before its first level."""
    return Descent(
        np.full(n, BIN, np.int32),
        np.zeros(n, np.int64),
        unknown_signs(n),
        stacked_signs(n, n),
        np.zeros(n + 1, np.int64),
        np.array([0, 0, 1]),
        np.full((limits.interpretations, n), BIN, np.int32),
        np.zeros((limits.interpretations, n), np.int8),
    )


@njit
def _descend(tests: PairTests, unary: BoolArray, limits: Limits, descent: Descent, counters: IntArray) -> None:
    """Depth-first over the data features; goes on as tree.traverse_pairs does, and fills the counters (6,) int64.

    unary : (n, e) bool, which model features a data feature may be on by itself
    """
    n, e = unary.shape
    assignment, cursor, signs, saved = descent.assignment, descent.cursor, descent.signs, descent.saved
    saved_bin, out, out_sign = descent.saved_bin, descent.out, descent.out_sign
    level, found, entering = descent.place[LEVEL], descent.place[FOUND], descent.place[ENTERING] == 1
    while level >= 0:
        if counters[WORK] > limits.levels:
            counters[TRUNCATED] = 1
            break
        if entering:
            counters[WORK] += n // RATES.signs_per_test
            save_signs(signs, saved, level)
            cursor[level] = 0
        advanced = False
        while cursor[level] <= e and not advanced:
            j = cursor[level]
            cursor[level] += 1
            restore_signs(signs, saved, level)
            if j == e:
                if saved_bin[level] < limits.in_bin:
                    saved_bin[level + 1] = saved_bin[level] + 1
                    assignment[level] = BIN
                    advanced = True
            elif unary[level, j] and _agrees(tests, assignment, level, j, limits.use_signs, signs, counters):
                saved_bin[level + 1] = saved_bin[level]
                assignment[level] = j
                advanced = True
        if not advanced:
            counters[BACKTRACKS] += 1
            level -= 1
            entering = False
        elif level + 1 < n:
            level += 1
            entering = True
        else:
            if saved_bin[n] == limits.in_bin:
                out[found] = assignment
                write_signs(signs, assignment, out_sign[found])
                found += 1
                if found == limits.interpretations:
                    break
            entering = False
    descent.place[LEVEL], descent.place[FOUND], descent.place[ENTERING] = level, found, 1 if entering else 0


@njit
def _agrees(
    tests: PairTests, assignment: Int32Array, level: int, j: int, use_signs: bool, signs: Signs, counters: IntArray
) -> bool:
    """Whether data feature ``level`` on model feature j agrees with all assigned before it; changes the signs."""
    n = len(assignment)
    counters[LEVELS] += 1
    counters[WORK] += 1 + n // RATES.signs_per_test
    for a in range(level):
        i = assignment[a]
        if i < 0:
            continue
        counters[WORK] += 1
        data, model = tests.data[pair_row(a, level, n)], tests.model[i, j]
        bits = entry(data, model, i == j, tests.lengths[i], tests.errors[a] + tests.errors[level], tests.use)
        if bits == 0:
            return False
        if use_signs and not apply_code(bits, a, level, signs):
            counters[SIGN_CUTOFFS] += 1
            return False
    return True
