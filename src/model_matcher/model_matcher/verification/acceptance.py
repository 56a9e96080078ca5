"""From candidate poses to interpretations: the last step that every search shares.

A candidate is refined, its data re-assigned under the refined pose, its covariance estimated; poses that explain the
same data equally well are put together, competitors for the same data rejected, and so is what chance would explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Interpretation, Pose

from ..model.index import SMALLEST_FEATURE, ModelIndex, VoxelTable, data_tolerances, feature_rows
from ..model.regularity import regularity
from ..model.symmetry import symmetric_poses
from ..params import MatchParams

# Tolerance widths of successive fits: a pose from two short edges is off by more than the data's own error.
WIDTHS = np.array([1.5, 1.2, 1.0, 1.0])
SEARCH_WIDTH = 1.6
# Candidates within this share of the best score are refined; all of them, when the best evidence is less than what is
# needed and so many nats.
KEEP = 0.6
DOUBTFUL = 5.0
# Evidence that the best pose of an absent model has by chance: more than LEAST + PER_DATA x ln(data features) +
# TAIL x t in less than exp(-t) of the scenes, as measured among other objects: bench_matcher.py --presets false_alarms.
LEAST, PER_DATA, TAIL = -0.6, 1.5, 1.3
# A candidate whose data is claimed to more than this share by a better interpretation competes with it.
CLAIMED = 0.34
# A pose explains the data of another and more: this share of the data, and evidence of its own that is less by no more
# than so many nats for each further model feature; features beyond FURTHER make no difference.
SAME_DATA, OUTDONE, FURTHER = 0.9, 4.0, 2.0
# Candidates that explain this share of the most distinct model features are ranked by how much of them is covered;
# covers that differ by less than that share are equal.
NEARLY, SAME_COVER = 0.9, 0.02
BINS = 64  # places along a model edge that are looked at
# Metres: what is said to be farther is a mistake, and its squares and cubes would be without number.
FARTHEST = 1e6


@dataclass(eq=False)
class Problem:
    """A model and data, made ready.

    data : the n usable features; keep : (n,) their numbers among all n_data
    rows : (n, 9), tolerances : (n, 3) as kernels.py wants them; radius_tol : metres
    """

    index: ModelIndex
    data: FeatureSet
    keep: np.ndarray
    n_data: int
    rows: np.ndarray
    tolerances: np.ndarray
    table: VoxelTable
    radius_tol: float

    @property
    def grid(self) -> tuple:
        """What the back-projection kernels take, model first."""
        table = self.table
        return (self.index.rows, self.index.kind, table.low, table.cell, table.shape, table.starts, table.items)

    @property
    def sample(self) -> tuple:
        """The data as the kernels take it."""
        return (self.rows, self.data.kind, self.tolerances)


def usable(data: FeatureSet, unit: float | None = 1.0) -> np.ndarray:
    """Numbers (k,) of the features that are neither without length nor beyond all distance, in place or in error.

    unit : metres, of the data; None when it is not known: what most of the data is away then stands for a metre
    """
    far = np.maximum(np.abs(data.start), np.abs(data.end)).max(axis=1, initial=0.0)
    if unit is None:
        unit = 1.0 / (float(np.median(far)) or 1.0) if len(far) else 1.0
    far = np.maximum(far, np.maximum(data.err_par, data.err_per))
    return np.flatnonzero((data.lengths > SMALLEST_FEATURE) & (far < FARTHEST / unit))


def make_problem(index: ModelIndex, data: FeatureSet, params: MatchParams) -> Problem:
    """Prepare data for a model; of it, what is :func:`usable`."""
    keep = usable(data)
    used = data if len(keep) == len(data) else data.select(keep)
    rows = feature_rows(used)
    tolerances = data_tolerances(used, rows, index.size, params)
    widest = SEARCH_WIDTH * float(tolerances[:, 0].max(initial=0.0))
    return Problem(
        index, used, keep, len(data), rows, tolerances, index.voxels(widest), params.curvedev * index.max_radius
    )


@dataclass(eq=False)
class Refined:
    """c refined candidates: motions (c, 12), assignments and signs (c, n) among used features, normals (c, 6, 6),
    figures (c, 8) as hypotheses.refine_candidates gives them."""

    motions: np.ndarray
    assignments: np.ndarray
    signs: np.ndarray
    normals: np.ndarray
    figures: np.ndarray


def refine_all(
    problem: Problem, motions: np.ndarray, scores: np.ndarray, params: MatchParams, keep: float = KEEP
) -> Refined:
    """Refine candidate poses (c, 12) with search scores (c,), best first."""
    from ..search import pair_search

    refine: Any = pair_search.refine_candidates
    c, n = len(scores), len(problem.rows)
    refined = Refined(
        motions, np.empty((c, n), np.int32), np.empty((c, n), np.int8), np.empty((c, 6, 6)), np.zeros((c, 8))
    )
    index = problem.index
    doubtful = needed_evidence(problem, params) + DOUBTFUL
    refine(
        motions,
        scores,
        keep,
        doubtful,
        *problem.grid,
        *problem.sample,
        WIDTHS,
        problem.radius_tol,
        index.middle,
        index.size,
        *regularity(index).arrays,
        refined.assignments,
        refined.signs,
        refined.normals,
        refined.figures,
    )
    return refined


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
    from . import line_of_sight

    settle: Any = line_of_sight.settle
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
                    *problem.sample,
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
        _interpretation(problem, refined, k, pose, covariance, others, reason)
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
        & (common >= SAME_DATA * common.diagonal())
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
    from ..search.pair_search import CANDIDATES

    if len(distinct) > CANDIDATES:
        for k in np.flatnonzero((distinct > 0.0) & (distinct >= NEARLY * distinct.max(initial=0.0))):
            cover[k] = covered(problem, refined.motions[k], refined.assignments[k])
    step = max(SAME_COVER * cover.max(initial=0.0), 1e-12)
    # Poses that a symmetry makes equal come in the order of their assignments, whatever search found them.
    return sorted(
        (k for k in range(len(distinct)) if distinct[k] > 0.0),
        key=lambda k: (-round(float(cover[k]) / step), -round(float(evidence[k]), 3), refined.assignments[k].tolist()),
    )


def covered(problem: Problem, motion: np.ndarray, assignment: np.ndarray) -> float:
    """Metres of model edges that data lies along, each place counted once, and circumferences of matched curves.

    motion : (12,), pose; assignment : (n,), BIN or a model feature
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
    share = (np.arange(BINS) + 0.5) / BINS * 2.0 - 1.0
    at = share * model[target, 6:7]
    hit = np.zeros((len(model), BINS), bool)
    np.logical_or.at(hit, target, (at >= places[:, :1]) & (at <= places[:, 1:]))
    return float(rims + (hit.mean(axis=1) * 2.0 * model[:, 6]).sum())


def needed_evidence(problem: Problem, params: MatchParams) -> float:
    """Nats below which an interpretation counts as chance. A rate of 1 turns the test off."""
    if params.false_alarm_rate >= 1.0:
        return -np.inf
    return false_alarm_evidence(len(problem.rows), params.false_alarm_rate)


def false_alarm_evidence(n: int, rate: float) -> float:
    """Nats that chance reaches in a share ``rate`` of the scenes of n data features."""
    return LEAST + PER_DATA * math.log(max(n, 1)) - TAIL * math.log(max(rate, 1e-12))


def as_pose(motion: np.ndarray) -> Pose:
    return Pose(motion[:9].reshape(3, 3), motion[9:])


def _near(problem: Problem, refined: Refined, k: int, others: list[int]) -> bool:
    """Whether a pose repeats another: within 1 degree and 1 % of the model's size."""
    mine = refined.motions[k]
    for other in refined.motions[others]:
        if mine[:9] @ other[:9] < 3.0 - 3e-4:
            continue
        gap = (mine[:9] - other[:9]).reshape(3, 3) @ problem.index.middle + mine[9:] - other[9:]
        if np.linalg.norm(gap) < 0.01 * problem.index.size:
            return True
    return False


def _interpretation(
    problem: Problem,
    refined: Refined,
    k: int,
    pose: Pose,
    covariance: np.ndarray,
    others: tuple[Pose, ...],
    reason: str | None,
) -> Interpretation:
    assignment = np.full(problem.n_data, BIN, np.int32)
    sign = np.zeros(problem.n_data, np.int8)
    chosen = np.flatnonzero(refined.assignments[k] != BIN)
    assignment[problem.keep[chosen]] = problem.index.source[refined.assignments[k][chosen]]
    sign[problem.keep[chosen]] = refined.signs[k][chosen]
    return Interpretation(
        problem.index.name,
        assignment,
        sign,
        pose,
        residual_rms=refined.figures[k, 1],
        covariance=covariance,
        symmetric_poses=others,
        rejected_reason=reason,
    )


def pose_covariances(index: ModelIndex, refined: Refined, chosen: list[int]) -> np.ndarray:
    """(c, 6, 6) covariances of (x, y, z, rx, ry, rz), metres and radians, of the chosen candidates, from their fits.

    A direction that the data leaves free gets the variance of its whole range: the model's size, or a half turn.
    """
    from ..geometry import least_squares

    covariances: Any = least_squares.covariances
    figures = refined.figures[chosen]
    # The fit turns about the data's centre; the pose's translation is that of the model's origin.
    return covariances(
        refined.normals[chosen],
        figures[:, 2].copy(),
        refined.motions[chosen, 9:] - figures[:, 3:6],
        index.size,
        SMALLEST_FEATURE,
    )
