"""Hypotheses weighed again by the images: what is there is accepted, where the images have it.

The evidence of a hypothesis is that of its features, that of its outline in the images (:mod:`..image_pose.presence`)
and that of its surface (:mod:`..image_pose.surface`). All come from the same pictures and say partly the same: what
each counts for, and what chance reaches, was fitted to the hypotheses of searches whose answer is known
(test/benchmarks/calibrate_evidence.py). Hypotheses are taken in the order of their evidence. A feature, and a step of
the image, belong to the first that explains it. What else explains them about as well is another pose that the object
may have: a box seen from behind may be the other way round. An answer names all of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msgs_py import BIN, Interpretation, Pose
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import FloatArray, IntArray

from ..geometry.pose_rows import as_motion, as_pose
from ..image_pose.measurement import ImagePose, Presence, looked_for, polished, presence, shown
from ..image_pose.presence import overlap
from ..image_pose.settings import SPACING, UNSEEN_TURN
from ..image_pose.sight import Shape
from ..image_pose.surface import Agreement, agreement, log_ratio
from ..image_pose.views import Views
from ..model.equal_poses import apart
from ..model.index import ModelIndex
from ..model.problem import Problem
from ..model.regularity import regularity
from ..model.settings import SAME_POSE
from ..model.symmetry import Axis, about_axis, axis_of_revolution, common_axis, near, symmetric_poses, symmetries
from .evidence import displaced
from .false_alarms import chance_with_images
from .refinement import evidence_at
from .settings import CLAIMED, DRAWN, IMAGE_EVIDENCE, TURNED, WHOLE
from .turning import halved_until_small, laid_without_turn, likeliest, likeliest_turns


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis as the images have it.

    Attributes
    ----------
    hypothesis : Interpretation
        What the features say of the pose as the images have it.
    motion : (12,) float64
        Its pose, drawn in.
    shown : Presence
        What the images show of its outline.
    surface : tuple of Agreement, optional
        What they show of its faces; None where that was not asked.
    rivals : tuple of Weighed
        Other poses of the same data, of which the images show less.
    twice : float
        Nats of the images that repeat what the features have told.
    """

    hypothesis: Interpretation
    motion: FloatArray
    shown: Presence
    surface: tuple[Agreement, ...] | None = None
    rivals: tuple[Weighed, ...] = ()
    twice: float = 0.0

    @cached_property
    def evidence(self) -> float:
        """Nats, of features and images together."""
        nats = self.hypothesis.evidence, self.shown.log_ratio - self.twice, log_ratio(self.surface or ())
        return float(np.dot(IMAGE_EVIDENCE, nats))


def weigh(
    problem: Problem,
    shape: Shape,
    hypothesis: Interpretation,
    views: Views,
    deadline: Deadline | None = None,
    needed: float = -math.inf,
) -> Weighed:
    """Look for a hypothesis in the images.

    Of the poses that explain its data equally well, the one is taken that the images show most of. Features and images
    speak of one pose: where the images have drawn it away from its data, that is no longer explained.

    Where the images, seen coarsely, speak against it, and it is far from what it needs, it stays where it is.

    Parameters
    ----------
    problem : Problem
        The model and the data.
    shape : Shape
        Of the same model.
    hypothesis : Interpretation
        Its pose is first_T_model.
    views : Views
    deadline : Deadline, optional
        When it has passed, only the first of the poses is looked at.
    needed : float
        Nats, from which on it is accepted.

    Returns
    -------
    Weighed
    """
    deadline = deadline or Deadline()
    poses = _equal_poses(problem.index, hypothesis)
    coarse = halved_until_small(shape, shape.size, hypothesis.pose, views)
    poses, looks = _looked_at(shape, poses, coarse, deadline)
    best, pose = max(zip(looks, poses), key=lambda one: one[0].log_ratio)
    seen = Weighed(hypothesis, as_motion(pose), best)
    if best.log_ratio <= 0.0 and seen.evidence + DECISIVE < needed:
        return seen
    # A look at each, as coarse as its steps are, says which to look at closely, and that which to draw in.
    if len(poses) > TURNED:
        poses = _likeliest(poses, looks)
    if len(poses) > TURNED:
        poses = _likeliest(*_looked_at(shape, poses, views, deadline))
    axis = None if hypothesis.free_turn is None else _free_axis(problem.index, hypothesis)
    return _drawn_in(problem, shape, hypothesis, poses, views, deadline, axis)


def weigh_turned(problem: Problem, shape: Shape, one: Weighed, axis: Axis, views: Views, deadline: Deadline) -> Weighed:
    """A hypothesis that leaves a turn free at the turn that the images show most of.

    Parameters
    ----------
    problem, shape, views : as of :func:`weigh`
    one : Weighed
        The hypothesis, drawn in at any turn.
    axis : Axis
        That it is about, model frame.
    deadline : Deadline
        When it has passed, the turn stays.

    Returns
    -------
    Weighed
        As it was where the images speak against each turn. Its rivals stay: they are no turns of it.
    """
    turned = likeliest_turns(problem.index, shape, axis, as_pose(one.motion), views, deadline)
    if not turned:
        return one
    best = _drawn_in(problem, shape, one.hypothesis, turned, views, deadline)
    return replace(best, rivals=(*best.rivals, *one.rivals))


def _drawn_in(
    problem: Problem,
    shape: Shape,
    hypothesis: Interpretation,
    poses: list[Pose],
    views: Views,
    deadline: Deadline,
    axis: Axis | None = None,
) -> Weighed:
    """A hypothesis at that of its first poses of which the images show most; axis : about which its turn is open."""

    def drawn(pose: Pose) -> Weighed:
        if axis is None:
            motion, sight = looked_for(shape, pose, views)
        else:
            motion, sight = laid_without_turn(shape, axis, pose, views)
        return Weighed(_at(problem, hypothesis, motion), motion, shown(sight, views))

    # The first is drawn in whatever the time.
    some = spread(lambda k: None if k and deadline.passed else drawn(poses[k]), range(min(len(poses), DRAWN)))
    best, *others = sorted((one for one in some if one is not None), key=lambda one: -one.shown.log_ratio)
    return replace(best, rivals=tuple(others))


def _looked_at(shape: Shape, poses: list[Pose], views: Views, deadline: Deadline) -> tuple[list[Pose], list[Presence]]:
    """Those of some poses that there is time for, the first in any case, and what images show of the outline there."""
    looks = spread(lambda k: None if k and deadline.passed else presence(shape, poses[k], views), range(len(poses)))
    seen = [(pose, one) for pose, one in zip(poses, looks) if one is not None]
    return [pose for pose, _ in seen], [one for _, one in seen]


def _likeliest(poses: list[Pose], looks: list[Presence]) -> list[Pose]:
    return likeliest(poses, np.array([one.log_ratio for one in looks]))


def _at(problem: Problem, hypothesis: Interpretation, motion: FloatArray) -> Interpretation:
    """A hypothesis with the data that it explains at another pose (12,), and the evidence of that."""
    evidence, chosen, way = evidence_at(problem, motion)
    assignment, sign = np.full(problem.n_data, BIN, np.int32), np.zeros(problem.n_data, np.int8)
    used = np.flatnonzero(chosen != BIN)
    assignment[problem.keep[used]] = problem.index.source[chosen[used]]
    sign[problem.keep[used]] = way[used]
    return replace(hypothesis, assignment=assignment, sign=sign, matched=len(used), evidence=evidence)


def _matched(hypothesis: Interpretation) -> IntArray:
    """The features of the model that data was matched to."""
    return np.unique(hypothesis.assignment[hypothesis.assignment != BIN])


def _equal_poses(index: ModelIndex, hypothesis: Interpretation) -> list[Pose]:
    """The poses equal for the data of a hypothesis, but for those that a symmetry of the model makes look the same."""
    alike = [hypothesis.pose.compose(motion) for motion in symmetries(index)]
    others = (one for one in hypothesis.symmetric_poses if not any(near(index, one, other) for other in alike))
    return [hypothesis.pose, *others]


class LookedAt(NamedTuple):
    """Hypotheses of one model after the images were asked.

    Attributes
    ----------
    accepted, rejected : tuple of Interpretation
        Best first. The poses of the accepted ones are measured in the images.
    outlines : tuple of Presence
        What the images show of each accepted one.
    """

    accepted: tuple[Interpretation, ...]
    rejected: tuple[Interpretation, ...]
    outlines: tuple[Presence, ...]


def accepted_by_images(
    problem: Problem,
    shape: Shape,
    hypotheses: Sequence[Interpretation],
    views: Views,
    needed: float,
    deadline: Deadline,
    claimed: Sequence[Presence] = (),
) -> LookedAt:
    """Accept and reject hypotheses of one model by their features and the images.

    Parameters
    ----------
    problem : Problem
        The model and the data that the hypotheses explain.
    shape : Shape
        Of the same model.
    hypotheses : sequence of Interpretation
        Best first.
    views : Views
    needed : float
        Nats, see :func:`.false_alarms.needed_with_images`.
    deadline : Deadline
        Hypotheses that it does not leave time for stay as they are.
    claimed : sequence of Presence
        Outlines of what was found before.

    Returns
    -------
    LookedAt
    """
    weighed, rejected = _all_weighed(problem, shape, hypotheses, views, needed, deadline)
    weighed = _with_turns(problem, shape, weighed, views, deadline, claimed)
    every = [each for one in weighed for each in (one, *one.rivals)]
    told = [_told_once(problem.index, one, views, needed) for one in every]
    weighed = [_with_surface(shape, one, views, needed) for one in told]
    accepted: list[Interpretation] = []
    taken: list[Weighed] = []
    refused = []
    for drawn in sorted(weighed, key=lambda one: -one.evidence):
        found, reason = drawn, _why_rejected(drawn, taken, claimed, needed) or _another(problem, drawn)
        if reason is None:
            measured = polished(shape, drawn.motion, views)
            # What is accepted is the pose that is told, not the one near it that it was measured from.
            found = replace(drawn, shown=measured.presence)
            reason = _why_rejected(found, taken, claimed, needed)
        if reason is None:
            taken.append(found)
            others = tuple(
                polished(shape, other.motion, views).pose for other in _rivals(problem.index, drawn, weighed)
            )
            accepted.append(_answer(problem.index, found, measured, others))
        else:
            hypothesis = found.hypothesis
            refused.append(
                replace(
                    hypothesis,
                    evidence=found.evidence,
                    chance=chance_with_images(found.evidence),
                    support=found.shown.support,
                    rejected_reason=reason,
                )
            )
    return LookedAt(tuple(accepted), (*refused, *rejected), tuple(one.shown for one in taken))


def _all_weighed(
    problem: Problem,
    shape: Shape,
    hypotheses: Sequence[Interpretation],
    views: Views,
    needed: float,
    deadline: Deadline,
) -> tuple[list[Weighed], list[Interpretation]]:
    """Hypotheses weighed, and those that were not: no time was left, or one that is seen whole has their data."""
    index = problem.index
    weighed: list[Weighed] = []
    rejected: list[Interpretation] = []
    # The best one often leaves no room for any other; there is one beside it, so that no processor waits for it.
    for some in (hypotheses[:2], hypotheses[2:]):
        with_room = [one for one in some if not any(_leaves_no_room(index, other, one, needed) for other in weighed)]
        found = spread(
            lambda one: None if deadline.passed else weigh(problem, shape, one, views, deadline, needed), with_room
        )
        looked_at = dict(zip(map(id, with_room), found))
        for one in some:
            if any(_leaves_no_room(index, other, one, needed) for other in weighed):
                rejected.append(replace(one, rejected_reason='competes for the same data with one that is seen whole'))
            elif (seen := looked_at[id(one)]) is None:
                rejected.append(replace(one, rejected_reason=one.rejected_reason or 'no time was left to look for it'))
            else:
                weighed.append(seen)
    return weighed, rejected


def _leaves_no_room(index: ModelIndex, found: Weighed, other: Interpretation, needed: float) -> bool:
    """Whether a hypothesis is seen so well that no other one can explain the same data as well."""
    if found.evidence < needed or found.shown.support <= WHOLE or not _shares_data(other, found.hypothesis):
        return False
    behind = found.hypothesis.evidence - other.evidence
    return behind > DECISIVE or apart(index, as_pose(found.motion), other.pose) < SAME_POSE


def _shares_data(one: Interpretation, other: Interpretation) -> bool:
    """Whether another one claims more than CLAIMED of the data that one explains."""
    mine = one.assignment != BIN
    return int((mine & (other.assignment != BIN)).sum()) > CLAIMED * int(mine.sum())


def _with_turns(
    problem: Problem,
    shape: Shape,
    weighed: list[Weighed],
    views: Views,
    deadline: Deadline,
    claimed: Sequence[Presence],
) -> list[Weighed]:
    """The hypotheses, the best of those that leave a turn open at the turn that the images show most of.

    What is round has its edges at any turn: one that another holds, of ``claimed``, has no turn to be looked for, nor
    has one that features and images together speak against. A turn that one feature tells is open, too: it may be
    another object's.
    """
    weighed = sorted(weighed, key=lambda one: -one.evidence)
    if axis_of_revolution(problem.index) is not None:
        return weighed
    axes = [_open_axis(problem.index, one.hypothesis) if one.evidence > 0.0 else None for one in weighed]
    for k, axis in [(k, axis) for k, axis in enumerate(axes) if axis is not None][:TURNED]:
        one = weighed[k]
        if not deadline.passed and not compete([one.shown], claimed):
            turned = weigh_turned(problem, shape, one, axis, views, deadline)
            if one.hypothesis.free_turn is not None or turned.evidence > one.evidence:
                weighed[k] = turned
    return weighed


def _open_axis(index: ModelIndex, hypothesis: Interpretation) -> Axis | None:
    """The axis that all matched features of a model are about, but for one of three or more; None where there is none.

    Of two features each is about an axis of its own.
    """
    rows = _matched_rows(index, hypothesis)
    if len(rows) < 3:
        return common_axis(rows, index.size)
    about = about_axis(rows, Axis(rows[0, :3], rows[0, 3:6]), index.size)
    but_first = None if about.all() else common_axis(rows[1:], index.size)
    # If it is not the first that is about none, the axis is that of the first.
    return common_axis(rows[about], index.size) if but_first is None and about.sum() >= len(rows) - 1 else but_first


def _free_axis(index: ModelIndex, hypothesis: Interpretation) -> Axis | None:
    """The axis that all matched features of a model are about; None where they leave no turn free."""
    return common_axis(_matched_rows(index, hypothesis), index.size)


def _matched_rows(index: ModelIndex, hypothesis: Interpretation) -> FloatArray:
    """(m, 9) rows of the features of a model that data was matched to."""
    return np.asarray(index.rows[np.isin(index.source, _matched(hypothesis))], np.float64)


def _told_once(index: ModelIndex, one: Weighed, views: Views, needed: float) -> Weighed:
    """A hypothesis from one feature of what is not round: that is in the images, too, whatever it is a feature of.

    The turn, and with it what the object is, all else has to tell.
    """
    if one.evidence < needed or one.hypothesis.matched != 1 or axis_of_revolution(index) is not None:
        return one
    others = ~np.isin(one.shown.sight.feature, _matched(one.hypothesis))
    return replace(one, twice=one.shown.log_ratio - shown(one.shown.sight.select(others), views).log_ratio)


def _with_surface(shape: Shape, one: Weighed, views: Views, needed: float) -> Weighed:
    """A hypothesis with what the images show of its surface, where that is likely to decide."""
    if one.evidence + DECISIVE < needed:
        return one
    return replace(one, surface=agreement(shape, as_pose(one.motion), one.shown.sight, views))


def _another(problem: Problem, one: Weighed) -> str | None:
    """Why a hypothesis is another object that is like the model, or None.

    Both have the same outline, so it does not matter how much of that is seen: a curve where the model has none
    decides.
    """
    assignment = np.full(len(problem.rows), BIN, np.int32)
    number = np.full(int(problem.index.source.max()) + 1, BIN, np.int32)
    number[problem.index.source] = np.arange(len(problem.index))
    matched = one.hypothesis.assignment[problem.keep]
    assignment[matched != BIN] = number[matched[matched != BIN]]
    used = np.isin(problem.index.source, np.concatenate([_matched(one.hypothesis), _seen_whole(one.shown)]))
    faces = regularity(problem.index).faces
    against = displaced(one.motion, problem.model, problem.features, assignment, used, faces)
    if against < DECISIVE:
        return None
    return f'a curve is seen where the model has none ({against:.1f} nats): this is another object like it'


def _seen_whole(shown: Presence) -> IntArray:
    """The features of a model's outline that images confirm where they are, whatever was recovered of them."""
    asked = (shown.sight.feature >= 0) & (shown.found >= 0)
    feature = shown.sight.feature[asked]
    share = np.bincount(feature, shown.found[asked] == 1) / np.maximum(np.bincount(feature), 1)
    return np.flatnonzero(share > WHOLE)


def _rivals(index: ModelIndex, one: Weighed, weighed: Sequence[Weighed]) -> list[Weighed]:
    """Hypotheses at other poses that explain the same data or edges of images, none much worse, the best first."""
    found: list[Weighed] = []
    for other in sorted(weighed, key=lambda each: -each.evidence):
        if not 0.0 <= one.evidence - other.evidence <= DECISIVE:
            continue
        if not (_shares_data(other.hypothesis, one.hypothesis) or compete([other.shown], [one.shown])):
            continue
        poses = [as_pose(each.motion) for each in (one, *found)]
        if all(apart(index, pose, as_pose(other.motion)) > SAME_POSE for pose in poses):
            found.append(other)
    return found


def _answer(index: ModelIndex, one: Weighed, found: ImagePose, others: tuple[Pose, ...]) -> Interpretation:
    """An accepted hypothesis at the pose that the images give it; others : those that it may have instead."""
    hypothesis = one.hypothesis
    turn, note = hypothesis.free_turn, hypothesis.note
    if turn is not None and float(turn @ found.covariance[3:, 3:] @ turn) < UNSEEN_TURN:
        turn, note = None, None  # the images tell what the features left open
    return replace(
        hypothesis,
        pose=found.pose,
        symmetric_poses=symmetric_poses(index, found.pose, others),
        ambiguous_poses=others,
        covariance=found.covariance,
        evidence=one.evidence,
        chance=chance_with_images(one.evidence),
        support=found.presence.support,
        rejected_reason=None,
        free_turn=turn,
        note=note,
    )


def _why_rejected(one: Weighed, taken: list[Weighed], claimed: Sequence[Presence], needed: float) -> str | None:
    """The reason to reject a hypothesis, or None; taken, claimed : what is accepted of this model and of others."""
    if not one.evidence >= needed:
        faces = one.surface or ()
        agree, looked = (sum(counts) for counts in zip((0, 0), *faces))
        return (
            f'chance explains as much: evidence {one.evidence:.1f} of {needed:.1f} nats needed, features '
            f'{one.hypothesis.evidence:.1f}, images {one.shown.log_ratio:+.1f} (they confirm {one.shown.support:.0%} '
            f'of the outline), surface {log_ratio(faces):+.1f} ({agree} of {looked} patches of it agree)'
        )
    if one.hypothesis.matched == 0:
        return 'the images have it where it explains none of the data that it was made from'
    for other in taken:
        if _shares_data(one.hypothesis, other.hypothesis):
            return (
                'competes for the same data with a better interpretation '
                f'(evidence {one.evidence:.1f} against {other.evidence:.1f} nats)'
            )
    if compete([one.shown], [*claimed, *(other.shown for other in taken)]):
        return 'competes for the same edges of the images with a better interpretation'
    return None


def compete(some: Sequence[Presence], others: Sequence[Presence]) -> bool:
    """Whether any of some outlines lies on edges of which another one holds more than CLAIMED."""
    return any(
        overlap(one.sight.placed, one.found, other.sight.placed, other.found, SPACING) > CLAIMED
        for one in some
        for other in others
    )
