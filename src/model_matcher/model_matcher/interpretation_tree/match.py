"""match() by a search of the thesis: tables, tree, a pose for each interpretation; then what all searches share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from msgs_py import BIN, FeatureSet, Interpretation
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import FloatArray, IntArray

from ..geometry.pose_rows import as_motion
from ..model.problem import Problem
from ..model.settings import PARALLEL_COSINE
from ..params import MatchParams, MatchResult, no_match
from ..verification.acceptance import accept
from ..verification.refinement import refine_all
from ..verification.settings import CANDIDATES
from .absolute_pose import Validation, validate
from .serial import serial_search
from .settings import FIRST_FRACDEV, INTERPRETATIONS
from .tables import build_tables
from .tree import TreeResult, subgraph_search, tree_search


def match_by_tree(problem: Problem, params: MatchParams, deadline: Deadline) -> MatchResult:
    """Match by the search that the parameters name: feasible interpretations, their poses, refined and judged.

    Parameters
    ----------
    problem : Problem
        Model, usable data and tolerances.
    params : MatchParams
        search is 'tree', 'subgraph' or 'serial'; with 'hypotheses' the tree is searched.
    deadline : Deadline
        Of the match.

    Returns
    -------
    MatchResult
        Statistics: feasible and valid interpretations, counts of the search; free_shift and free_turn (unit vectors,
        camera frame) when the data leaves a translation or a rotation open.
    """
    try:
        result = feasible(problem, params, deadline)
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
            else f'no feasible interpretation within {deadline.seconds:.3g} s'
        )
        return no_match(problem.data, why, **stats)
    checked = _validated(problem, result, params)
    for name, spent in checked.stats.items():
        stats[name] = {**stats[name], **spent} if isinstance(spent, dict) else stats[name] + spent
    matched = (result.assignments >= 0).sum(axis=1)
    stats['valid'] = int(checked.valid.sum())
    deviation = np.sqrt(np.nanmean(np.where(result.assignments >= 0, checked.deviations, np.nan) ** 2, axis=1))
    order = np.lexsort((deviation, -checked.passed.sum(axis=1), -matched))[:CANDIDATES]
    for name, free in (('free_shift', checked.free_shift), ('free_turn', checked.free_turn)):
        if np.isfinite(free[order[0]]).all():
            stats[name] = [float(value) for value in free[order[0]]]  # of the best, camera frame
    motions = np.array([as_motion(checked.poses[k]) for k in order])
    refined = refine_all(problem, motions, matched[order].astype(float), params, keep=0.0, deadline=deadline)
    accepted, rejected = accept(problem, refined, params)
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


def _with_free_shift(one: Interpretation, data: FeatureSet, keep: IntArray, free: FloatArray) -> Interpretation:
    """The interpretation with its free shift (unit vector, camera frame), if all that it pairs is parallel to that."""
    paired = one.assignment[keep] != BIN
    lines = data.directions[paired]
    return replace(one, free_shift=free) if (np.abs(lines @ free) > PARALLEL_COSINE).all() else one


def _array_machine() -> tuple[Callable[..., TreeResult], Callable[..., Validation]]:
    """The search and the validation of engine='dap'. Raises ValueError when they are not installed."""
    # The array machine takes a fifth of a second to import, and only engine='dap' needs it.
    try:
        from . import array_validation, engine_dap
    except ImportError as error:
        raise ValueError(f"engine: 'dap' is not available: {error}") from None
    return engine_dap.tree_search, array_validation.validated_by_machine


def _validated(problem: Problem, result: TreeResult, params: MatchParams) -> Validation:
    """Poses of all feasible interpretations, and what agrees with them; on the machine that searched."""
    index = problem.index
    limits = FIRST_FRACDEV * params.fracdev, params.curvedev, index.size
    arguments = result.assignments.astype(np.int64), result.signs
    if params.engine == 'native':
        return validate(index.features, problem.data, *arguments, *limits)
    _, validated_by_machine = _array_machine()
    return validated_by_machine(index, problem.data, *arguments, *limits, params.real_bytes)


def feasible(problem: Problem, params: MatchParams, deadline: Deadline) -> TreeResult:
    """Feasible interpretations of the usable data, parameters as for :func:`match_by_tree`.

    Raises ValueError when the tables would be too large or the engine is not installed.
    """
    if params.engine == 'dap':
        search_by_machine, _ = _array_machine()
        return search_by_machine(problem.index, problem.data, params, INTERPRETATIONS, deadline=deadline)
    if params.search == 'serial':
        return serial_search(problem.index, problem.data, params, INTERPRETATIONS, deadline)
    tables = build_tables(problem.index, problem.data, params)
    search = subgraph_search if params.search == 'subgraph' else tree_search
    return search(tables, params, INTERPRETATIONS, deadline)
