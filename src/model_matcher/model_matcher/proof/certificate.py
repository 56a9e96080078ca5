"""Certificate that no larger interpretation exists, or none of some size at all.

Its exact statement. An interpretation pairs each data feature with one model feature at most, and there is a rigid
motion, its pose, under which every paired data feature lies on its model feature: end points within the tolerances
across and along, direction within its cone, radii within curvedev (back_projection.fit_one, width 1). ``proven``: no
interpretation of this data, whatever its pose, pairs more data features than this one. ``absent``: none pairs as many
as ``min_matched``. Clutter, occlusion and symmetry play no part in that; the tolerances do. An equally large one may
exist. docs/proof.md has the argument, and what computing with rounded numbers takes off it.

How it is shown: branch_and_bound.py.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from msgs_py import BIN, FeatureSet, Interpretation
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.typed import FloatArray, Int32Array

from ..geometry.pose_rows import as_motion, as_pose
from ..model.index import ModelIndex
from ..model.problem import Problem, make_problem
from ..model.symmetry import symmetric_poses
from ..params import MatchParams, MatchResult
from ..verification.interpretations import as_interpretation
from ..verification.pose_fit import fitted_poses, stated_errors
from ..verification.refinement import Refined
from .branch_and_bound import BranchAndBound, GivenUp, Larger, sample_of
from .feasibility import least_squares_pose
from .warm_up import compile_kernels


@dataclass(frozen=True)
class Proof:
    """The answer of an exhaustive search.

    Attributes
    ----------
    proven : bool
        No interpretation matches more data than asked about, or than ``assignment`` if there is one.
    assignment : (n,) int32, optional
        The largest interpretation found beyond what was asked about.
    motion : (12,) float64, optional
        A pose that explains it: rotation row by row, translation in metres.
    nodes : int
        Branches of the tree; 0 when arc consistency was enough.
    pairings : int
        Pairings that arc consistency left.
    reason : str, optional
        Why it is not proven; None when it is.
    seconds : float
        Time of all of it.
    """

    proven: bool
    assignment: Int32Array | None = None
    motion: FloatArray | None = None
    nodes: int = 0
    pairings: int = 0
    reason: str | None = None
    seconds: float = 0.0


def certify(problem: Problem, result: MatchResult, params: MatchParams, deadline: Deadline) -> MatchResult:
    """Mark the best interpretation of a match as proven, when it is, or that there is none at all.

    A larger interpretation that the proof comes across takes the place of the best one, unless it explains fewer
    distinct model features, by which interpretations are ranked: then nothing is proven.

    Parameters
    ----------
    problem : Problem
        What was matched.
    result : MatchResult
        Of the match.
    params : MatchParams
        Its parameters.
    deadline : Deadline
        Of the match.

    Returns
    -------
    MatchResult
        Statistics: proof_branches, proof_pairings, proof_seconds and, when it is not proven, unproven with the reason.
    """
    best = result.best
    compile_kernels()
    if deadline.passed:
        result.stats['unproven'] = 'time limit'
        return result
    if best is None:
        return _certify_absence(problem, result, params, deadline)
    motion = as_motion(best.pose)
    proof = prove_problem(problem, best.matched, params, deadline, motion)
    result.stats.update(proof_branches=proof.nodes, proof_pairings=proof.pairings, proof_seconds=proof.seconds)
    reason = proof.reason
    if proof.assignment is not None and proof.motion is not None:
        larger = _as_interpretation(problem, params, proof.assignment, proof.motion)
        distinct, known = (len(np.unique(one.assignment[one.assignment != BIN])) for one in (larger, best))
        if distinct >= known:
            best = larger
        else:
            reason = (
                f'another interpretation matches {larger.matched} data features, but only {distinct} distinct '
                f'model features; the best matches {best.matched} and {known}'
            )
    if reason is None:
        best = replace(best, proven=True)
    else:
        result.stats['unproven'] = reason
    return replace(result, interpretations=(best, *result.interpretations[1:]))


def _certify_absence(problem: Problem, result: MatchResult, params: MatchParams, deadline: Deadline) -> MatchResult:
    """Mark a match without an answer as absent, when no pose explains as many data features as an answer has to."""
    least = params.min_matched
    known = max((one.matched for one in result.rejected), default=0)
    proof = Proof(False, reason=f'a rejected pose explains {known} data features')
    if known < least:
        proof = prove_problem(problem, least - 1, params, deadline, only_whether=True)
    result.stats.update(proof_branches=proof.nodes, proof_pairings=proof.pairings, proof_seconds=proof.seconds)
    if not proof.proven:
        result.stats['unproven'] = proof.reason
        return result
    reason = f'{result.reason}; proven: no pose explains {least} data features within the tolerances'
    return replace(result, reason=reason, absent=True)


def _as_interpretation(
    problem: Problem, params: MatchParams, assignment: Int32Array, motion: FloatArray
) -> Interpretation:
    """A set of pairings as an interpretation, with the pose that they determine."""
    pose, sign = motion.copy(), np.zeros(len(assignment), np.int8)
    least_squares_pose(pose, assignment, sign, sample_of(problem))
    nothing = np.zeros(1)
    refined = Refined(pose[None], assignment[None], sign[None], nothing, nothing, nothing)
    (fitted,) = fitted_poses(
        problem, stated_errors(problem, params), pose[None], assignment[None], sign[None], np.zeros(1, bool)
    )
    equal = symmetric_poses(problem.index, as_pose(fitted.motion))
    return as_interpretation(problem, refined, 0, fitted, equal, None)


def prove(
    index: ModelIndex, data: FeatureSet, matched: int, params: MatchParams, deadline: Deadline | None = None
) -> Proof:
    """Find out whether no interpretation of the data matches more than so many features.

    Parameters
    ----------
    index : ModelIndex
        The model.
    data : FeatureSet
        Camera frame, metres; features without length take no part, but are counted in the answer's assignment.
    matched : int
        Data features that an interpretation is known to match.
    params : MatchParams
        The tolerances; scale must be 'known'.
    deadline : Deadline, optional
        After params.time_limit_s when not given.

    Returns
    -------
    Proof
    """
    problem = make_problem(index, data, params)
    found = prove_problem(problem, matched, params, deadline)
    if found.assignment is None:
        return found
    assignment = np.full(problem.n_data, BIN, np.int32)
    assignment[problem.keep] = found.assignment
    return replace(found, assignment=assignment)


def prove_problem(
    problem: Problem,
    matched: int,
    params: MatchParams,
    deadline: Deadline | None = None,
    motion: FloatArray | None = None,
    only_whether: bool = False,
) -> Proof:
    """As :func:`prove`; the assignment is of the problem's usable features.

    motion : (12,) the pose of what matched; only_whether : the first larger interpretation ends it, unproven
    """
    if params.scale != 'known':
        return Proof(False, reason="only data of known scale can be proven, not scale='free'")
    compile_kernels()
    started = time.perf_counter()
    tree = BranchAndBound(problem, matched, deadline or Deadline(params.time_limit_s))
    reason = None
    try:
        if motion is not None:
            tree.enlarge(motion)
        tree.prune()
        while True:
            try:
                tree.search()
                break
            except Larger:
                if only_whether:
                    raise GivenUp(f'a pose explains {tree.most} data features') from None
    except GivenUp as why:
        reason = str(why)
    except RecursionError:
        reason = 'the tree is too deep'
    return Proof(
        reason is None,
        tree.assignment,
        tree.motion,
        tree.branches,
        len(tree.nodes.a),
        reason,
        time.perf_counter() - started,
    )
