"""From candidate poses to interpretations: the last step that every search shares.

A candidate is refined and its data re-assigned under the refined pose; poses that explain the
same data equally well are put together, competitors for the same data rejected, and so is what chance would explain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import BIN, Interpretation

from ..geometry.pose_rows import as_pose
from ..geometry.settings import NOT_ZERO, ROUNDING
from ..model.problem import Problem
from ..model.symmetry import all_near, symmetric_poses
from ..params import MatchParams
from .false_alarms import needed_evidence
from .interpretations import as_interpretation, covered
from .pose_fit import fitted_poses, stated_errors
from .refinement import Refined
from .settings import CANDIDATES, CLAIMED, FURTHER, NEARLY_ALL, PLACES, WORST


class _Groups(NamedTuple):
    """Candidates by what becomes of them, by their numbers.

    Attributes
    ----------
    equivalent
        By a representative, the candidates that explain the same data as well, at other poses.
    repeated
        Those that repeat a representative or one of its equivalents.
    competitors
        The better candidate by the worse that wants the same data.
    """

    equivalent: dict[int, list[int]]
    repeated: set[int]
    competitors: dict[int, int]


def accept(
    problem: Problem, refined: Refined, params: MatchParams, most: int | None = None
) -> tuple[tuple[Interpretation, ...], tuple[Interpretation, ...]]:
    """Make interpretations of refined candidates.

    Parameters
    ----------
    problem : Problem
        Model and data.
    refined : Refined
        The candidates; their evidence is changed in place.
    params : MatchParams
        Of the match.
    most : int, optional
        How many to make of both together, the accepted ones first; default: params.max_interpretations of each.

    Returns
    -------
    tuple of tuple of Interpretation
        The accepted and the rejected ones, best first.
    """
    matched = (refined.assignments != BIN).astype(np.float32)
    common = (matched @ matched.T).astype(int)
    _share_evidence(refined, common)
    order = _ranked(problem, refined)
    groups = _grouped(problem, refined, order, common)
    accepted: list[int] = []
    rejected: list[int] = []
    reasons: dict[int, str | None] = {}
    of_each = params.max_interpretations if most is None else most
    for k in order:
        if len(accepted) == len(rejected) == of_each:
            break
        if k in groups.repeated:
            continue
        reason = _why_rejected(problem, refined, params, k, int(common[k, k]), groups.competitors.get(k))
        target = accepted if reason is None else rejected
        if len(target) < of_each:
            target.append(k)
            reasons[k] = reason
    if most is not None:
        rejected = rejected[: most - len(accepted)]
    chosen = [t for k in accepted + rejected for t in (k, *groups.equivalent.get(k, []))]
    parts = refined.motions[chosen], refined.assignments[chosen], refined.signs[chosen]
    by_sight = np.full(len(chosen), params.scale == 'known')
    by_sight[sum(1 + len(groups.equivalent.get(k, [])) for k in accepted) :] = False
    fitted = dict(zip(chosen, fitted_poses(problem, stated_errors(problem, params), *parts, by_sight)))
    made = []
    for k in accepted + rejected:
        poses = tuple(as_pose(fitted[t].motion) for t in groups.equivalent.get(k, []))
        if reasons[k] is None:
            poses = symmetric_poses(problem.index, as_pose(fitted[k].motion), poses)
        made.append(as_interpretation(problem, refined, k, fitted[k], poses, reasons[k]))
    return tuple(made[: len(accepted)]), tuple(made[len(accepted) :])


def _grouped(problem: Problem, refined: Refined, order: list[int], common: np.ndarray) -> _Groups:
    """Put candidates together that explain the same data; common : (c, c) int, data that two candidates share."""
    scores, residuals, shared_data = refined.scores.tolist(), refined.residuals.tolist(), common.tolist()
    same = all_near(problem.index, refined.motions)
    groups = _Groups({}, set(), {})
    for k in order:
        total = max(shared_data[k][k], 1)
        for head, others in groups.equivalent.items():
            shared = shared_data[k][head]
            if shared <= CLAIMED * total:
                continue
            alike = int(scores[k]) >= int(scores[head]) and shared == total == shared_data[head][head]
            if alike and residuals[k] <= 1.5 * residuals[head] + ROUNDING:
                if not same[k, [head, *others]].any():
                    others.append(k)
                groups.repeated.add(k)
            else:
                groups.competitors[k] = head
            break
        else:
            groups.equivalent[k] = []
    return groups


def _why_rejected(
    problem: Problem, refined: Refined, params: MatchParams, k: int, matched: int, better: int | None
) -> str | None:
    """The reason to reject candidate k, or None; matched : its data; better : a candidate that wants the same data."""
    distinct, evidence, needed = int(refined.scores[k]), float(refined.evidence[k]), needed_evidence(problem, params)
    least = min(params.min_matched, len(problem.index))
    if distinct < least:
        of_all = '' if least == params.min_matched else ', all that the model has'
        return f'explains {distinct} distinct model features, fewer than min_matched = {least}{of_all}'
    if evidence < needed:
        return (
            f'chance explains as much: evidence {evidence:.1f} of {needed:.1f} nats needed for '
            f'false_alarm_rate = {params.false_alarm_rate:g}'
        )
    if better is not None:
        return (
            f'competes for the same data with a better interpretation '
            f'(evidence {evidence:.1f} against {float(refined.evidence[better]):.1f} nats)'
        )
    if params.max_bin is not None and problem.n_data - matched > params.max_bin:
        return f'leaves {problem.n_data - matched} data features unmatched, max_bin = {params.max_bin}'
    return None


def _share_evidence(refined: Refined, common: np.ndarray) -> None:
    """Let the evidence of a pose count for those that explain the same data and more.

    A pose that explains part of a model's own data by the model's likeness to itself can be the less probable accident
    of the two: it was not free to explain the rest. That the model is there is then as sure, and the pose that explains
    more is where. One that explains nothing says nothing of others. common : (c, c) int, data that two candidates share
    """
    distinct, evidence = np.floor(refined.scores), refined.evidence
    further = np.minimum(distinct[:, None] - distinct, FURTHER)
    more = (
        (further > 0.0)
        & (distinct > 0.0)
        & (common >= NEARLY_ALL * common.diagonal())
        & (evidence[:, None] < evidence)
        & (evidence[:, None] > evidence - WORST * further)
    )
    if not more.any():
        return
    for k in np.argsort(distinct, kind='stable'):
        if more[k].any():
            evidence[k] = max(evidence[k], evidence[more[k]].max() + 0.01)


def _ranked(problem: Problem, refined: Refined) -> list[int]:
    """The candidates that explain anything, best first: by evidence.

    Where a search kept more candidates than usual because many are nearly as good as the best (a grid moved by one
    period still has something along each of its lines), those under which data covers most of the model come first, but
    for what has more evidence than any of them.
    """
    distinct, evidence = np.floor(refined.scores), refined.evidence
    cover, alike = np.zeros(len(distinct)), -np.inf
    if len(distinct) > CANDIDATES:
        many = np.flatnonzero((distinct > 0.0) & (distinct >= NEARLY_ALL * distinct.max(initial=0.0)))
        alike = evidence[many].max(initial=-np.inf)
        for k in many:
            cover[k] = covered(problem, refined.motions[k], refined.assignments[k])
    step = max(cover.max(initial=0.0) / PLACES, NOT_ZERO)
    # Poses that a symmetry makes equal come in the order of their assignments, whatever search found them.
    return sorted(
        (k for k in range(len(distinct)) if distinct[k] > 0.0),
        key=lambda k: (
            evidence[k] <= alike,
            -round(float(cover[k]) / step),
            -round(float(evidence[k]), 3),
            refined.assignments[k].tolist(),
        ),
    )
