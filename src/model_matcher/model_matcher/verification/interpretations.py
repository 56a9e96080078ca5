"""What a refined pose says: what of the model it covers, and the interpretation to publish."""

from __future__ import annotations

import numpy as np

from msgs_py import BIN, FeatureKind, Interpretation, Pose

from ..geometry.pose_rows import as_pose
from ..model.equal_poses import apart
from ..model.problem import Problem
from ..model.regularity import regularity
from ..model.settings import SAME_POSE
from ..model.symmetry import Axis, axis_of_revolution, common_axis, equal_but_for_turn
from .false_alarms import chance_of
from .pose_fit import FittedPose
from .refinement import Refined
from .settings import PLACES

# Notes of an interpretation whose turn about an axis is free.
SAME_ALL_ROUND = 'free to turn: the model is the same all round its axis'
TURN_NOT_SEEN = 'free to turn: of the model only what is about one axis was found, and that does not tell its turn'


def covered(problem: Problem, motion: np.ndarray, assignment: np.ndarray) -> float:
    """How much of a model data lies along.

    Parameters
    ----------
    problem : Problem
        Model and data.
    motion : (12,) float64
        A pose.
    assignment : (n,) int32
        The model feature of each usable data feature, BIN for none.

    Returns
    -------
    float
        Metres of edges, each place counted once, and circumferences of matched curves.
    """
    model, used = problem.index.rows, np.flatnonzero(assignment != BIN)
    target = assignment[used]
    curves = problem.index.kind == FeatureKind.CURVE
    rims = np.where(curves, 2.0 * np.pi * np.nan_to_num(model[:, 7]), 0.0)[np.unique(target)].sum()
    edges = ~curves[target]
    used, target = used[edges], target[edges]
    rows = problem.rows[used]
    step = rows[:, 6:7] * rows[:, 3:6]
    ends = (np.stack([rows[:, :3] - step, rows[:, :3] + step], axis=1) - motion[9:]) @ motion[:9].reshape(3, 3)
    places = np.sort(((ends - model[target, None, :3]) * model[target, None, 3:6]).sum(axis=-1), axis=1)
    share = (np.arange(PLACES) + 0.5) / PLACES * 2.0 - 1.0
    at = share * model[target, 6:7]
    hit = np.zeros((len(model), PLACES), bool)
    np.logical_or.at(hit, target, (at >= places[:, :1]) & (at <= places[:, 1:]))
    return float(rims + (hit.mean(axis=1) * 2.0 * model[:, 6]).sum())


def free_axis(problem: Problem, assignment: np.ndarray) -> Axis | None:
    """The axis of the model about which paired data leaves a pose free to turn, None when it does not.

    Parameters
    ----------
    problem : Problem
        Model and data.
    assignment : (n,) int32
        The model feature of each usable data feature, BIN for none.
    """
    used = np.unique(assignment[assignment != BIN])
    direction = regularity(problem.index).direction[used]
    if len(used) == 0 or (direction != direction[0]).any():
        return None
    return common_axis(problem.index.rows[used], problem.index.size)


def as_interpretation(
    problem: Problem, refined: Refined, k: int, fitted: FittedPose, others: tuple[Pose, ...], reason: str | None
) -> Interpretation:
    """The interpretation that candidate k is, in numbers of all data and of the model as it was given.

    others : poses that are equal to the fitted one; reason : why it is rejected, None when it is not
    """
    assignment = np.full(problem.n_data, BIN, np.int32)
    sign = np.zeros(problem.n_data, np.int8)
    chosen = np.flatnonzero(refined.assignments[k] != BIN)
    assignment[problem.keep[chosen]] = problem.index.source[refined.assignments[k][chosen]]
    sign[problem.keep[chosen]] = refined.signs[k][chosen]
    pose = as_pose(fitted.motion)
    axis = free_axis(problem, refined.assignments[k])
    turn, note = None, None
    if axis is not None:
        turn = pose.rotate(axis.direction[None])[0]
        note = SAME_ALL_ROUND if axis_of_revolution(problem.index) is not None else TURN_NOT_SEEN
        others = _but_for_turns(pose, others, axis, problem.index.size)
    return Interpretation(
        problem.index.name,
        assignment,
        sign,
        pose,
        residual_rms=fitted.rms,
        covariance=fitted.covariance,
        symmetric_poses=others,
        ambiguous_poses=tuple(one for one in others if apart(problem.index, pose, one) > SAME_POSE),
        rejected_reason=reason,
        free_turn=turn,
        note=note,
        evidence=float(refined.evidence[k]),
        chance=chance_of(problem, float(refined.evidence[k])),
    )


def _but_for_turns(pose: Pose, others: tuple[Pose, ...], axis: Axis, size: float) -> tuple[Pose, ...]:
    """The other poses that differ from a pose, and from each other, by more than a turn about an axis of the model."""
    chosen: list[Pose] = []
    for other in others:
        if not any(equal_but_for_turn(other, one, axis, size) for one in (pose, *chosen)):
            chosen.append(other)
    return tuple(chosen)
