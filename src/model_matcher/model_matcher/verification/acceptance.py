"""From candidate poses to interpretations: the last step that every search shares.

A candidate is refined, its data re-assigned under the refined pose, its covariance estimated; poses that explain the
same data equally well are put together, competitors for the same data rejected, and so is what chance would explain.
"""

from __future__ import annotations

import numpy as np

from msgs_py import BIN, Interpretation, Pose

from ..model.problem import Problem
from ..model.settings import SAME_POSE_SHARE
from ..model.symmetry import symmetric_poses
from ..params import MatchParams
from .false_alarms import needed_evidence
from .interpretations import as_interpretation, as_pose, covered, pose_covariances
from .line_of_sight import settle
from .refinement import Refined
from .settings import CANDIDATES, CLAIMED, FURTHER, NEARLY_ALL, OUTDONE, SAME_COVER


def conclude(
    problem: Problem, refined: Refined, params: MatchParams
) -> tuple[tuple[Interpretation, ...], tuple[Interpretation, ...]]:
    """Accepted and rejected interpretations, each best first."""
    matched = (refined.assignments != BIN).astype(np.float32)
    shared_data = (matched @ matched.T).astype(int)
    _presence(refined, shared_data)
    scores, residuals, evidence = (refined.figures[:, column].tolist() for column in (0, 1, 7))
    order = _ranked(problem, refined)
    common = shared_data.tolist()
    heads: list[int] = []
    twins: dict[int, list[int]] = {}
    rivals: dict[int, int] = {}
    for k in order:
        row = common[k]
        total = max(row[k], 1)
        for head in heads:
            shared = row[head]
            if shared <= CLAIMED * total:
                continue
            alike = int(scores[k]) >= int(scores[head]) and shared == total == common[head][head]
            if alike and residuals[k] <= 1.5 * residuals[head] + 1e-9:
                if not _near(problem, refined, k, [head, *twins[head]]):
                    twins[head].append(k)
                rivals[k] = -1
            else:
                rivals[k] = head
            break
        else:
            heads.append(k)
            twins[k] = []
    needed = needed_evidence(problem, params)
    accepted: list[tuple[int, Pose, tuple[Pose, ...], str | None]] = []
    rejected: list[tuple[int, Pose, tuple[Pose, ...], str | None]] = []
    for k in order:
        if len(accepted) == len(rejected) == params.max_interpretations:
            break
        if rivals.get(k) == -1:
            continue
        reason = None
        distinct = int(scores[k])
        if distinct < min(params.min_matched, len(problem.index)):
            reason = f'explains {distinct} distinct model features, fewer than min_matched = {params.min_matched}'
        elif evidence[k] < needed:
            reason = (
                f'chance explains as much: evidence {evidence[k]:.1f} of {needed:.1f} nats needed for '
                f'false_alarm_rate = {params.false_alarm_rate:g}'
            )
        elif k in rivals:
            better = rivals[k]
            reason = (
                f'competes for the same data with a better interpretation '
                f'(evidence {evidence[k]:.1f} against {evidence[better]:.1f} nats)'
            )
        elif params.max_bin is not None and problem.n_data - common[k][k] > params.max_bin:
            unmatched = problem.n_data - common[k][k]
            reason = f'leaves {unmatched} data features unmatched, max_bin = {params.max_bin}'
        if reason is None and params.scale == 'known':
            for t in (k, *twins.get(k, ())):
                settle(
                    refined.motions[t],
                    problem.index.rows,
                    problem.rows,
                    problem.data.kind,
                    problem.tolerances,
                    refined.assignments[t],
                    refined.signs[t],
                    problem.index.size,
                )
        target = accepted if reason is None else rejected
        if len(target) == params.max_interpretations:
            continue
        pose, others = as_pose(refined.motions[k]), tuple(as_pose(refined.motions[t]) for t in twins.get(k, ()))
        if reason is None:
            others = symmetric_poses(problem.index, pose, others)
        target.append((k, pose, others, reason))
    chosen = accepted + rejected
    covariances = pose_covariances(problem.index, refined, [k for k, _, _, _ in chosen]) if chosen else ()
    made = tuple(
        as_interpretation(problem, refined, k, pose, covariance, others, reason)
        for (k, pose, others, reason), covariance in zip(chosen, covariances)
    )
    return made[: len(accepted)], made[len(accepted) :]


def _presence(refined: Refined, common: np.ndarray) -> None:
    """Let the evidence of a pose count for those that explain the same data and more.

    A pose that explains part of a model's own data by the model's likeness to itself can be the less probable accident
    of the two: it was not free to explain the rest. That the model is there is then as sure, and the pose that explains
    more is where. common : (c, c) int, data that two candidates share
    """
    distinct, evidence = np.floor(refined.figures[:, 0]), refined.figures[:, 7]
    further = np.minimum(distinct[:, None] - distinct, FURTHER)
    more = (
        (further > 0.0)
        & (common >= NEARLY_ALL * common.diagonal())
        & (evidence[:, None] < evidence)
        & (evidence[:, None] > evidence - OUTDONE * further)
    )
    if not more.any():
        return
    for k in np.argsort(distinct, kind='stable'):
        if more[k].any():
            evidence[k] = max(evidence[k], evidence[more[k]].max() + 0.01)


def _ranked(problem: Problem, refined: Refined) -> list[int]:
    """The candidates that explain anything, best first: by evidence.

    Where a search kept more candidates than usual because many are nearly as good as the best (a grid moved by one
    period still has something along each of its lines), those under which data covers most of the model come first.
    """
    distinct, evidence = np.floor(refined.figures[:, 0]), refined.figures[:, 7]
    cover = np.zeros(len(distinct))
    if len(distinct) > CANDIDATES:
        for k in np.flatnonzero((distinct > 0.0) & (distinct >= NEARLY_ALL * distinct.max(initial=0.0))):
            cover[k] = covered(problem, refined.motions[k], refined.assignments[k])
    step = max(SAME_COVER * cover.max(initial=0.0), 1e-12)
    # Poses that a symmetry makes equal come in the order of their assignments, whatever search found them.
    return sorted(
        (k for k in range(len(distinct)) if distinct[k] > 0.0),
        key=lambda k: (-round(float(cover[k]) / step), -round(float(evidence[k]), 3), refined.assignments[k].tolist()),
    )


def _near(problem: Problem, refined: Refined, k: int, others: list[int]) -> bool:
    """Whether a pose repeats another: within 1 degree and 1 % of the model's size."""
    mine = refined.motions[k]
    for other in refined.motions[others]:
        if mine[:9] @ other[:9] < 3.0 - 3e-4:
            continue
        gap = (mine[:9] - other[:9]).reshape(3, 3) @ problem.index.middle + mine[9:] - other[9:]
        if np.linalg.norm(gap) < SAME_POSE_SHARE * problem.index.size:
            return True
    return False
