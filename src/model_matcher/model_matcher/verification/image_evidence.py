"""Hypotheses weighed again by the images: what is there is accepted, where the images have it.

The evidence of a hypothesis is that of its features and, of the outline that no feature was matched to, that of the
images (:mod:`..image_pose.presence`): nothing is counted twice. Hypotheses are taken in the order of both together. A
feature, and a step of the image, belong to the first that explains it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msgs_py import BIN, Interpretation, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..image_pose.measurement import Presence, as_motion, as_pose, drawn_in, polished, presence
from ..image_pose.sight import Shape
from ..image_pose.views import Views
from ..model.index import ModelIndex
from ..model.symmetry import axis_of_revolution, common_axis, near, symmetries
from .settings import CLAIMED, FREE_TURN_VARIANCE, SAME_STEP, TURN_PX


@dataclass(frozen=True, eq=False)
class Weighed:
    """A hypothesis as the images have it.

    Attributes
    ----------
    hypothesis : Interpretation
        What the features say.
    motion : (12,) float64
        Its pose, drawn in.
    rest : Presence
        Of the outline that no feature was matched to.
    evidence : float
        Nats, of features and images together.
    """

    hypothesis: Interpretation
    motion: FloatArray
    rest: Presence
    evidence: float


def weigh(index: ModelIndex, shape: Shape, hypothesis: Interpretation, views: Views) -> Weighed:
    """Look for a hypothesis in the images.

    Of the poses that explain its data equally well, and of the turns that it leaves free, the one is taken that the
    images show most of.

    Parameters
    ----------
    index : ModelIndex
    shape : Shape
        Of the same model.
    hypothesis : Interpretation
        Its pose is first_T_model.
    views : Views

    Returns
    -------
    Weighed
    """
    best: tuple[float, FloatArray] | None = None
    for pose in _poses(index, shape, hypothesis, views):
        motion = drawn_in(shape, as_motion(pose), views)
        ratio = presence(shape, as_pose(motion), views).log_ratio
        if best is None or ratio > best[0]:
            best = ratio, motion
    assert best is not None
    rest = presence(shape, as_pose(best[1]), views, _matched(hypothesis))
    return Weighed(hypothesis, best[1], rest, hypothesis.evidence + rest.log_ratio)


def _matched(hypothesis: Interpretation) -> IntArray:
    """The features of the model that data was matched to."""
    return np.unique(hypothesis.assignment[hypothesis.assignment != BIN])


def _poses(index: ModelIndex, shape: Shape, hypothesis: Interpretation, views: Views) -> Iterator[Pose]:
    """The poses that a hypothesis stands for: its own, those equal to it for the data, and its free turns.

    What a symmetry of the model makes equal looks the same, and is left out.
    """
    own = hypothesis.pose
    alike = [own.compose(motion) for motion in symmetries(index)]
    poses = [own, *(one for one in hypothesis.symmetric_poses if not any(near(index, one, other) for other in alike))]
    rows = np.flatnonzero(np.isin(index.source, _matched(hypothesis)))
    axis = common_axis(index.rows[rows], index.size) if hypothesis.free_turn is not None else None
    if axis is None or axis_of_revolution(index) is not None:
        yield from poses
        return
    # So fine that the outline moves by TURN_PX from one to the next.
    depth = max(float(own.apply(shape.centre)[2]), shape.size)
    steps = int(np.ceil(np.pi * shape.size * views.cameras[0].fx / depth / TURN_PX))
    for pose in poses:
        for angle in np.arange(steps) * (2.0 * np.pi / steps):
            turn = Pose.from_rotation_vector(angle * axis.direction)
            yield pose.compose(Pose(turn.rotation, axis.point - turn.rotation @ axis.point))


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
    index: ModelIndex,
    shape: Shape,
    hypotheses: Sequence[Interpretation],
    views: Views,
    needed: float,
    deadline: float,
    claimed: Sequence[Presence] = (),
) -> LookedAt:
    """Accept and reject hypotheses of one model by their features and the images.

    Parameters
    ----------
    index : ModelIndex
    shape : Shape
        Of the same model.
    hypotheses : sequence of Interpretation
        Best first.
    views : Views
    needed : float
        Nats that an accepted one has.
    deadline : float
        Of ``time.perf_counter``; hypotheses that it does not leave time for stay as they are.
    claimed : sequence of Presence
        Outlines of what was found before.

    Returns
    -------
    LookedAt
    """
    weighed, rejected = [], []
    for one in hypotheses:
        if time.perf_counter() < deadline:
            weighed.append(weigh(index, shape, one, views))
        else:
            rejected.append(replace(one, rejected_reason=one.rejected_reason or 'no time was left to look for it'))
    accepted: list[Interpretation] = []
    taken: list[Weighed] = []
    refused = []
    for found in sorted(weighed, key=lambda one: -one.evidence):
        reason = _why_rejected(found, taken, claimed, needed)
        if reason is None:
            taken.append(found)
            accepted.append(_measured(shape, found, views))
        else:
            hypothesis = found.hypothesis
            refused.append(
                replace(hypothesis, evidence=found.evidence, support=found.rest.support, rejected_reason=reason)
            )
    return LookedAt(tuple(accepted), (*refused, *rejected), tuple(one.rest for one in taken))


def _measured(shape: Shape, one: Weighed, views: Views) -> Interpretation:
    """An accepted hypothesis at the pose that the images give it."""
    found = polished(shape, one.motion, views)
    hypothesis = one.hypothesis
    turn, note = hypothesis.free_turn, hypothesis.note
    if turn is not None and float(turn @ found.covariance[3:, 3:] @ turn) < FREE_TURN_VARIANCE:
        turn, note = None, None  # the images tell what the features left open
    return replace(
        hypothesis,
        pose=found.pose,
        covariance=found.covariance,
        evidence=one.evidence,
        support=found.presence.support,
        rejected_reason=None,
        free_turn=turn,
        note=note,
    )


def _why_rejected(one: Weighed, taken: list[Weighed], claimed: Sequence[Presence], needed: float) -> str | None:
    """The reason to reject a hypothesis, or None; taken, claimed : what is accepted of this model and of others."""
    if not one.evidence >= needed:
        return (
            f'chance explains as much: evidence {one.evidence:.1f} of {needed:.1f} nats needed, features '
            f'{one.hypothesis.evidence:.1f}, images {one.rest.log_ratio:+.1f} (they confirm {one.rest.support:.0%} of '
            'the outline)'
        )
    mine = one.hypothesis.assignment != BIN
    for other in taken:
        shared = int((mine & (other.hypothesis.assignment != BIN)).sum())
        if shared > CLAIMED * int(mine.sum()):
            return (
                'competes for the same data with a better interpretation '
                f'(evidence {one.evidence:.1f} against {other.evidence:.1f} nats)'
            )
    if compete([one.rest], [*claimed, *(other.rest for other in taken)]):
        return 'competes for the same edges of the images with a better interpretation'
    return None


def compete(some: Sequence[Presence], others: Sequence[Presence]) -> bool:
    """Whether any of some outlines lies on edges of which another one holds more than CLAIMED."""
    return any(_overlap(one, other) > CLAIMED for one in some for other in others)


def _overlap(one: Presence, other: Presence) -> float:
    """Share of the confirmed points of an outline that lie on those of another, edges about as steep."""
    mine, theirs = one.sight.placed, other.sight.placed
    rows, others = np.flatnonzero(one.found == 1), np.flatnonzero(other.found == 1)
    if not len(rows) or not len(others):
        return 0.0
    gap = np.abs(mine.pixel[rows, None] - theirs.pixel[None, others]).max(axis=2)
    parallel: BoolArray = np.abs(mine.normal[rows] @ theirs.normal[others].T) > np.sqrt(0.5)
    same = (mine.eye[rows, None] == theirs.eye[None, others]) & (gap < SAME_STEP) & parallel
    return float(same.any(axis=1).mean())
