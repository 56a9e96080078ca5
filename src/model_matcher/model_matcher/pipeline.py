"""The facade: match one model, recognise several."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from msgs_py import BIN, FeatureSet, Interpretation

from .finishing import SEARCH_WIDTH, Problem, conclude, make_problem, refine_all
from .model_index import ModelIndex, indexed
from .params import MatchParams, MatchResult, no_match

NEIGHBOURS = 24
BLOCK = 256  # data pairs between two looks at the clock
EVERYONE = np.zeros((0, 0), np.int32)


def match(model: FeatureSet | ModelIndex, data: FeatureSet, params: MatchParams | None = None,
          name: str = 'model') -> MatchResult:
    """Find one model in recovered features.

    model : FeatureSet in the model frame, metres (or a ModelIndex); data : FeatureSet in the camera frame, metres
    name : written to the interpretations

    Returns interpretations best first, or the reason why there is none. An empty model or empty data is such a
    reason. Raises TypeError for arguments of another type, ValueError for bad parameters.
    """
    started = time.perf_counter()
    params = params or MatchParams()
    if not isinstance(data, FeatureSet):
        raise TypeError(f'data: expected a FeatureSet, got {type(data).__name__}')
    try:
        index = indexed(model, name)
    except ValueError as error:
        return no_match(data, str(error))
    problem = make_problem(index, data, params)
    if len(problem.rows) == 0:
        return no_match(data, 'the data holds no features' if len(data) == 0 else 'every data feature has length zero')
    result = _match_hypotheses(problem, params, started)
    result.stats['seconds'] = time.perf_counter() - started
    return result


def _match_hypotheses(problem: Problem, params: MatchParams, started: float) -> MatchResult:
    """The production search and what follows it."""
    from . import hypotheses
    from .kernels import rank_pairs
    search: Any = hypotheses.search_pairs
    index, rows = problem.index, problem.rows
    n = len(rows)
    neighbours = EVERYONE
    if n > 600:
        _, near = cKDTree(rows[:, :3]).query(rows[:, :3], k=min(n, 3 * NEIGHBOURS))
        neighbours = near.astype(np.int32)
    pairs, _ = rank_pairs(rows, neighbours, index.size, NEIGHBOURS)
    table = problem.table
    motions = np.zeros((hypotheses.CANDIDATES, 12))
    scores = np.zeros(hypotheses.CANDIDATES)
    state = np.zeros(4, np.int64)
    confident = min(0.35 * len(index), n)
    patience = int(200 * max(1.0, n / (2.0 * len(index))) ** 2)
    first = 0
    in_time = True
    while first < len(pairs) and not state[3] and in_time:
        last = min(len(pairs), first + BLOCK)
        search(pairs, index.rows, index.kind, index.pair_starts, index.pair_members, index.pair_values,
               index.pair_reach, table.low, table.cell, table.shape, table.starts, table.items, index.middle,
               index.size, *problem.sample, SEARCH_WIDTH, problem.radius_tol, first, last, patience, confident, motions,
               scores, state)
        first = last
        in_time = time.perf_counter() - started <= params.time_limit_s
    accepted, rejected = conclude(problem, refine_all(problem, motions, scores), params)
    stopped = 'patience' if state[3] else 'exhausted' if in_time else 'time limit'
    stats = {'search': 'hypotheses', 'data_features': problem.n_data, 'pairs': int(state[2]),
             'hypotheses': int(state[0]), 'stopped_by': stopped}
    reason = None
    if not accepted:
        reason = rejected[0].rejected_reason if rejected else 'no pair of data features fits the model'
    return MatchResult(accepted, rejected, stats, reason)


def recognise(models: Sequence[FeatureSet | ModelIndex], data: FeatureSet,
              params: MatchParams | None = None) -> list[Interpretation]:
    """Find several models, and several instances of each.

    The best interpretation over all models claims its data; the search goes on in what is left, until nothing is
    accepted. Interpretations come best first (most data explained); assignments refer to the whole of ``data``.
    """
    params = params or MatchParams()
    found: list[Interpretation] = []
    for number, model in enumerate(models):
        name = model.name if isinstance(model, ModelIndex) else f'model{number}'
        left = np.arange(len(data))
        while len(left):
            best = match(model, data.select(left), params, name).best
            if best is None:
                break
            assignment = np.full(len(data), BIN, np.int32)
            sign = np.zeros(len(data), np.int8)
            assignment[left], sign[left] = best.assignment, best.sign
            found.append(Interpretation(name, assignment, sign, best.pose, residual_rms=best.residual_rms,
                                        covariance=best.covariance, symmetric_poses=best.symmetric_poses,
                                        proven=best.proven))
            left = left[best.assignment == BIN]
    found.sort(key=lambda one: -one.matched)
    kept: list[Interpretation] = []
    claimed = np.zeros(len(data), bool)
    for one in found:
        mine = one.assignment != BIN
        if (mine & claimed).sum() > 0.34 * mine.sum():
            continue
        claimed |= mine
        kept.append(one)
    return kept
