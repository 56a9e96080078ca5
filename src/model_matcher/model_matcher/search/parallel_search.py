"""Poses from parallel data features, where pair_search.py needs two that are not.

A peg or a can shows two rims and an axis, a flange nothing but rims: all their normals are parallel. Such a pair fixes
a pose, or all of it but the turn about their common axis (parallel_pairs.py). Pairs with a curve or an axis among them
are few and always tried; pairs of edges are many, and fix a pose only where they are seen whole. One curve alone fixes
all but the turn about its axis: that of a solid of revolution needs no other, and of other models images tell the turn.
"""

from __future__ import annotations

import numpy as np

from msgs_py import FeatureKind
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.deadline import Deadline, blocks
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from ..geometry.back_projection import count_matches
from ..geometry.features import CURVE, DataFeatures, ModelFeatures
from ..geometry.pair_bounds import possible
from ..geometry.parallel_pairs import (
    KINDS,
    ParallelPairs,
    lever,
    matching_parallel,
    offsets,
    parallel_pose,
    seen_whole,
    single_pose,
)
from ..geometry.settings import PARALLEL_SINE
from ..model.problem import Problem
from ..model.settings import SEARCH_WIDTH
from ..model.symmetry import axis_of_revolution
from .pair_search import Candidates, gather, keep_candidate, worth_keeping
from .settings import ALL_PAIRED, EDGE_HYPOTHESES

EDGE = int(FeatureKind.EDGE)


def search_all_parallel(
    problem: Problem, edges: bool, candidates: Candidates, deadline: Deadline, images: bool = False
) -> int:
    """Try the parallel data pairs of a problem while there is time.

    Parameters
    ----------
    problem : Problem
        n data features, e model features.
    edges : bool
        Pairs of edges, rather than pairs with a curve or an axis, and single ones of a solid of revolution.
    candidates : Candidates
        Changed in place.
    deadline : Deadline
        When it has passed, no block of pairs begins but the first.
    images : bool
        Whether images are at hand to tell the turn about the one curve that was found of a model.

    Returns
    -------
    int
        Hypotheses tried.
    """
    model, data, index = problem.model, problem.features, problem.index
    may = possible(data.rows, data.kind, data.tolerances, model.rows, model.kind, data.radius_tolerance)
    if edges:
        may &= seen_whole(data, model)
    pairs = _data_pairs(problem, may, edges)
    is_round = axis_of_revolution(index) is not None
    if not edges and (is_round or images):
        alone = np.flatnonzero(may.any(axis=1) & (is_round | (data.kind == CURVE))).astype(np.int32)
        pairs = np.concatenate([pairs, np.stack([alone, alone], axis=1)])
    state = np.zeros(1, np.int64)
    most = EDGE_HYPOTHESES if edges else np.inf
    for first, last in blocks(len(pairs), deadline):
        search_parallel(pairs, may, model, index.parallel_pairs, data, SEARCH_WIDTH, first, last, candidates, state)
        if state[0] > most:
            break
    return int(state[0])


def _data_pairs(problem: Problem, may: BoolArray, edges: bool) -> Int32Array:
    """The data pairs to try, (p, 2) int32, those that show their direction over the greatest length first.

    may : (n, e) bool, which model features a data feature may be on by itself
    edges : pairs of edges, rather than pairs with a curve or an axis
    """
    usable = np.flatnonzero(may.any(axis=1) & ((problem.features.kind == EDGE) | (not edges)))
    if edges and len(usable) > ALL_PAIRED:
        usable = np.sort(usable[np.argsort(-problem.rows[usable, 6], kind='stable')[:ALL_PAIRED]])
    rows, kind = problem.rows[usable], problem.features.kind[usable]
    table = problem.index.parallel_pairs
    pairs, levers = _near_and_parallel(rows, kind, edges, problem.index.size, np.diff(table.starts) > 0)
    order = np.argsort(-levers, kind='stable')
    chosen: Int32Array = usable[pairs[order]].astype(np.int32).reshape(-1, 2)
    return chosen


@njit
def _near_and_parallel(
    rows: FloatArray, kind: IntArray, edges: bool, size: float, wanted: BoolArray
) -> tuple[Int32Array, FloatArray]:
    """Parallel pairs of data rows (n, 9) that one model of this size (metres) can show; the lever of the shorter.

    wanted : (9,) bool, pairs of kinds that the model has
    """
    n = rows.shape[0]
    pairs, levers, count = np.empty((64, 2), np.int32), np.empty(64), 0
    others = np.flatnonzero(kind != EDGE)
    for first in range(n if edges else len(others)):
        a = first if edges else others[first]
        if edges and kind[a] != EDGE:
            continue
        for b in range(n):
            # Each pair once; of two that are no edges the later one has had its turn.
            if a == b or (edges and (kind[b] != EDGE or b < a)) or (not edges and kind[b] != EDGE and b < a):
                continue
            if not wanted[KINDS * kind[a] + kind[b]]:
                continue
            apart, along, sine = offsets(rows[a], rows[b])
            reach = size + rows[a, 6] + rows[b, 6]
            if sine >= PARALLEL_SINE or apart * apart + along * along > reach * reach:
                continue
            if count == len(levers):
                more, longer = np.empty((2 * count, 2), np.int32), np.empty(2 * count)
                more[:count], longer[:count] = pairs, levers
                pairs, levers = more, longer
            pairs[count, 0], pairs[count, 1] = a, b
            levers[count] = min(lever(rows[a], kind[a] == CURVE), lever(rows[b], kind[b] == CURVE))
            count += 1
    return pairs[:count], levers[:count]


@njit(nogil=True)
def search_parallel(
    pairs: Int32Array,
    may: BoolArray,
    model: ModelFeatures,
    table: ParallelPairs,
    data: DataFeatures,
    widen: float,
    first: int,
    last: int,
    candidates: Candidates,
    state: IntArray,
) -> None:
    """Try the parallel data pairs from first to last - 1, and keep the best poses.

    Parameters
    ----------
    pairs : (p, 2) int32
        A pair of a feature with itself stands for the feature alone, as of a solid of revolution.
    may : (n, e) bool
        Which model features a data feature may be on by itself.
    model : ModelFeatures
    table : ParallelPairs
        Of the model.
    data : DataFeatures
    widen : float
        Tolerances count this many times.
    first, last : int
    candidates : Candidates
        Changed in place.
    state : (1,) int64
        Hypotheses so far; a new mark for each.

    """
    rows, tols, kind = data.rows, data.tolerances, data.kind
    stamp = np.full(model.rows.shape[0], -1, np.int64)
    motion, found = np.empty(12), np.empty(2 * table.members.shape[0], np.int32)
    around = DataFeatures(rows.copy(), kind.copy(), tols.copy(), data.radius_tolerance)
    count, gathered = 0, -1
    for p in range(first, last):
        a, b = pairs[p, 0], pairs[p, 1]
        if gathered != a:
            count = gather(data, a, model.size + lever(rows[a], kind[a] == CURVE), widen, around)
            near = DataFeatures(
                around.rows[:count], around.kind[:count], around.tolerances[:count], data.radius_tolerance
            )
            gathered = a
        near = DataFeatures(around.rows[:count], around.kind[:count], around.tolerances[:count], data.radius_tolerance)
        if a == b:
            for i in range(model.rows.shape[0]):
                for turning in range(2):
                    if may[a, i] and single_pose(data, a, model, i, 1.0 - 2.0 * turning, motion):
                        state[0] += 1
                        _try(motion, 1.0, model, near, widen, stamp, state[0], candidates)
            continue
        across = tols[a, 0] + tols[b, 0]
        for k in range(matching_parallel(data, model, table, a, b, may, found)):
            at, sense = found[k] // 2, 1.0 - 2.0 * (found[k] % 2)
            i, j = table.members[at, 0], table.members[at, 1]
            if parallel_pose(data, a, b, model, i, j, sense, table.apart[at] <= across, motion):
                state[0] += 1
                _try(motion, 2.0, model, near, widen, stamp, state[0], candidates)


@njit
def _try(
    motion: FloatArray,
    least: float,
    model: ModelFeatures,
    data: DataFeatures,
    widen: float,
    stamp: IntArray,
    mark: int,
    candidates: Candidates,
) -> None:
    """Count what a pose explains, and keep it when that is worth it."""
    needed = worth_keeping(candidates.scores, least)
    score = count_matches(motion, model, data, widen, stamp, mark, needed)
    if score >= needed:
        keep_candidate(motion, score, model, candidates)
