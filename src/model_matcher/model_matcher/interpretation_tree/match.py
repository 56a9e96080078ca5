"""match() by a search of the thesis: tables, tree, validation; then the finish that all searches share."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from msgs_py import BIN, FeatureSet, Interpretation

from ..params import MatchParams, MatchResult, no_match
from ..verification.acceptance import Problem, conclude, refine_all
from .absolute_pose import validate
from .tree import TreeResult

INTERPRETATIONS = 256  # how many feasible interpretations are validated at most
REFINED = 16  # how many of them, best first, are refined
# The closed-form pose is tested more generously than the refined one.
FIRST_FRACDEV = 4.0
ALONG = 0.98  # cosine of a feature parallel to the free shift


def match_by_tree(problem: Problem, params: MatchParams, started: float) -> MatchResult:
    """Feasible interpretations by params.search, validated, refined and judged."""
    try:
        result = feasible(problem, params, started)
    except ValueError as error:
        return no_match(problem.data, str(error))
    stats = {
        'search': params.search,
        'engine': params.engine,
        'data_features': problem.n_data,
        'feasible': len(result.assignments),
        'complete': result.complete,
        **result.stats,
    }
    stats['stopped_by'] = 'exhausted' if result.complete else 'time limit'
    if not len(result.assignments):
        why = (
            'no feasible interpretation'
            if result.complete
            else f'no feasible interpretation within {params.time_limit_s:g} s'
        )
        return no_match(problem.data, why, **stats)
    index = problem.index
    checked = validate(
        index.features,
        problem.data,
        result.assignments,
        result.signs,
        FIRST_FRACDEV * params.fracdev,
        params.curvedev,
        index.size,
    )
    matched = (result.assignments >= 0).sum(axis=1)
    stats['valid'] = int(checked.valid.sum())
    deviation = np.sqrt(np.nanmean(np.where(result.assignments >= 0, checked.deviations, np.nan) ** 2, axis=1))
    order = np.lexsort((deviation, -checked.passed.sum(axis=1), -matched))[:REFINED]
    for name, free in (('free_shift', checked.free_shift), ('free_turn', checked.free_turn)):
        if np.isfinite(free[order[0]]).all():
            stats[name] = [float(value) for value in free[order[0]]]  # of the best, camera frame
    motions = np.array(
        [np.concatenate([checked.poses[k].rotation.ravel(), checked.poses[k].translation]) for k in order]
    )
    refined = refine_all(problem, motions, matched[order].astype(float), params, keep=0.0)
    accepted, rejected = conclude(problem, refined, params)
    if 'free_shift' in stats:
        free = np.array(stats['free_shift'])
        accepted, rejected = (
            tuple(_with_free_shift(one, problem.data, problem.keep, free) for one in ones)
            for ones in (accepted, rejected)
        )
    reason = None
    if not accepted:
        reason = rejected[0].rejected_reason if rejected else 'no feasible interpretation is a rigid motion'
    return MatchResult(accepted, rejected, stats, reason)


def _with_free_shift(one: Interpretation, data: FeatureSet, keep: np.ndarray, free: np.ndarray) -> Interpretation:
    """An interpretation that says along what it may move, when all that it pairs is parallel to that."""
    paired = one.assignment[keep] != BIN
    lines = data.directions[paired]
    return replace(one, free_shift=free) if (np.abs(lines @ free) > ALONG).all() else one


def feasible(problem: Problem, params: MatchParams, started: float) -> TreeResult:
    """Feasible interpretations of the usable data. Raises ValueError when the tables would be too large."""
    seconds = max(params.time_limit_s - (time.perf_counter() - started), 0.0)
    if params.engine == 'dap':
        try:
            engine_dap: Any = import_module('.engine_dap', __package__)
        except ImportError as error:
            raise ValueError(f"engine: 'dap' is not available: {error}") from None
        return engine_dap.tree_search(problem.index, problem.data, params, INTERPRETATIONS)
    if params.search == 'serial':
        from .serial import serial_search

        return serial_search(problem.index, problem.data, params, INTERPRETATIONS, seconds)
    from .tables import build_tables

    tables = build_tables(problem.index, problem.data, params)
    if params.search == 'subgraph':
        from .subgraph import subgraph_search

        return subgraph_search(tables, params, INTERPRETATIONS, seconds)
    from .tree import tree_search

    return tree_search(tables, params, INTERPRETATIONS, seconds)
