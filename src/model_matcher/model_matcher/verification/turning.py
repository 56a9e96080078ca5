"""The turn about an axis at which images show most of an outline.

A pulley is round but for its keyway, which is small: a point of it moves by few pixels where the rims' would move by
many, and is confirmed within one. One look at the outline serves for the turns within reach of it: each point moves
along its normal by as much as its derivative says, towards steps that were found once.
"""

from __future__ import annotations

import math

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..geometry.pose_rows import as_motion, as_pose
from ..geometry.settings import NOT_ZERO
from ..image_pose.alignment import Placed, Steps
from ..image_pose.measurement import elsewhere, fitted, laid, laid_on_steps, searched
from ..image_pose.presence import bent, by_hidden, chance_beside, confirmations, crowded, log_mean
from ..image_pose.settings import DRAWN_IN, FLANK, ON_EDGE, OTHERS_EDGES, REACH, SPACING, TONES
from ..image_pose.sight import Shape, Sight, look
from ..image_pose.views import Views
from ..model.index import ModelIndex
from ..model.symmetry import Axis, about_axis, equal_but_for_turn, symmetries
from .settings import SEEN_LARGE, STILL


def likeliest_turns(
    index: ModelIndex, shape: Shape, axis: Axis, pose: Pose, views: Views, deadline: Deadline
) -> list[Pose]:
    """A pose turned about an axis to where images show most of the outline.

    Parameters
    ----------
    index, shape
        The model.
    axis : Axis
        Model frame.
    pose : Pose
        first_T_model, right but for the turn.
    views : Views
    deadline : Deadline
        When it has passed, turns that were not looked at are left out.

    Returns
    -------
    list of Pose
        Best first, those that the images do not tell from it; none where they speak against each turn.
    """
    pose = _measured_without_turn(shape, axis, pose, views)
    lever = _lever(index, axis)
    coarse = halved_until_small(shape, lever, pose, views)
    poses, within = _turns(index, axis, pose, _pixels(shape, lever, pose, coarse))
    turned: list[Pose] = []
    # Seen coarsely many turns are as likely as the best one.
    for some, spacing in (*([] if coarse is views else [(coarse, float(REACH))]), (views, SPACING)):

        def best(one: Pose, some: Views = some, spacing: float = spacing) -> tuple[float, Pose]:
            return (-math.inf, one) if deadline.passed else best_turn(shape, one, axis, within, some, spacing)

        found = spread(best, poses)
        glances = np.array([nats for nats, _ in found])
        if not glances.max() > 0.0:
            return []
        poses, turned = likeliest(poses, glances), likeliest([one for _, one in found], glances)
    return turned


def laid_without_turn(shape: Shape, axis: Axis, pose: Pose, views: Views) -> tuple[FloatArray, Sight]:
    """A pose near one, laid on the steps of the curves that a turn about an axis of the model leaves where they are.

    At another turn than the model's the others lie beside their own steps; what they are laid on moves the axis.

    Parameters
    ----------
    shape : Shape
    axis : Axis
        Model frame.
    pose : Pose
        first_T_model, within REACH pixels.
    views : Views

    Returns
    -------
    motion : (12,) float64
    sight : Sight
        The outline there.
    """
    motion = as_motion(pose)
    sight = look(shape, pose, views)
    steps = _of_still(searched(sight, views, REACH), sight, shape, pose, axis)
    laid(shape, motion, views, sight, steps, np.array(DRAWN_IN), elsewhere(steps, REACH))
    return motion, look(shape, as_pose(motion), views)


def _measured_without_turn(shape: Shape, axis: Axis, pose: Pose, views: Views) -> Pose:
    """A pose near one, measured by the curves that a turn about an axis of the model leaves where they are.

    The keyway of a pulley is a few pixels large: where it is to be looked for has to be known to less than one.
    """
    sight = look(shape, pose, views)
    density = elsewhere(searched(sight, views, FLANK), FLANK)
    # What the images are like is told by what is accepted: until then this fit keeps to itself what it takes them for.
    told = views if views.tone[0] > 0.0 else views.coded(TONES[0])
    steps = _of_still(fitted(sight, told), sight, shape, pose, axis)
    return as_pose(laid_on_steps(shape, as_motion(pose), views, sight, steps, density).motion)


def _of_still(steps: Steps, sight: Sight, shape: Shape, pose: Pose, axis: Axis) -> Steps:
    """The steps, but none on curves that a turn about an axis moves."""
    return steps.without(_moving(sight.placed, _moves(sight, shape, pose, axis) * np.pi)[sight.placed.curve])


@njit(nogil=True)
def _moving(placed: Placed, moves: FloatArray) -> BoolArray:
    """Which curves do not stay where they are, (c,), when points move by so many pixels, (n,)."""
    out = np.zeros(placed.curve.max() + 1 if len(moves) else 0, np.bool_)
    out[placed.curve[np.abs(moves) > STILL]] = True
    return out


def likeliest(poses: list[Pose], glances: FloatArray) -> list[Pose]:
    """Of poses those that glances (n,), nats, do not tell from the best one, the best first."""
    order = np.argsort(-glances)
    return [poses[k] for k in order if glances[k] >= glances[order[0]] - DECISIVE]


def halved_until_small(shape: Shape, length: float, pose: Pose, views: Views) -> Views:
    """Images, halved until a length (metres) at a shape is not seen large in them."""
    while _pixels(shape, length, pose, views) > SEEN_LARGE:
        views = views.halved
    return views


def _pixels(shape: Shape, length: float, pose: Pose, views: Views) -> float:
    """How many pixels a length at a shape is in the first image."""
    return length * views.cameras[0].fx / max(float(pose.apply(shape.centre)[2]), shape.size)


def _turns(index: ModelIndex, axis: Axis, pose: Pose, lever: float) -> tuple[list[Pose], float]:
    """Turns of a pose about an axis of the model that together are all there are, each with those within an angle.

    lever : pixels, how far from the axis a point is at most that moves with a turn; none moves by more than REACH
    """
    # Turns that lay the model on itself: what is between two of them is all there is.
    fold = 1 + sum(equal_but_for_turn(motion, Pose.identity(), axis, index.size) for motion in symmetries(index))
    within = np.pi / fold / max(1.0, np.ceil(np.pi * lever / REACH / fold))
    return [pose.compose(axis.turn(turn)) for turn in np.arange(0.0, 2.0 * np.pi / fold - within, 2.0 * within)], within


def _lever(index: ModelIndex, axis: Axis) -> float:
    """Metres, how far from an axis a feature of a model reaches that is not about it."""
    rows = index.rows[~about_axis(index.rows, axis, index.size)]
    # Straight ones to their ends, curves to the farther side of their circle.
    half = np.where(np.isnan(rows[:, 7]), rows[:, 6], 0.0)[:, None] * rows[:, 3:6]
    off = axis.distances(np.concatenate([rows[:, :3] - half, rows[:, :3] + half]))
    return float((off + np.tile(np.nan_to_num(rows[:, 7]), 2)).max(initial=0.0))


def best_turn(shape: Shape, pose: Pose, axis: Axis, within: float, views: Views, spacing: float) -> tuple[float, Pose]:
    """The turn, within so much of a pose either way, at which images show most of an outline.

    Parameters
    ----------
    shape : Shape
    pose : Pose
        first_T_model.
    axis : Axis
        Model frame.
    within : float
        Radians; no point moves by more than REACH pixels.
    views : Views
    spacing : float
        Pixels between neighbouring points of the outline.

    Returns
    -------
    nats : float
        See :func:`..image_pose.presence.log_ratio`; nothing stands in front.
    pose : Pose
        Turned.
    """
    sight = look(shape, pose, views, spacing)
    if not len(sight):
        return -math.inf, pose
    moves = _moves(sight, shape, pose, axis)
    # So fine that no point misses its step.
    count = math.ceil(float(np.abs(moves).max()) * within / ON_EDGE)
    turns = within * np.arange(-count, count + 1) / max(count, 1)
    nats = ratios(sight.placed, sight.limb, searched(sight, views, REACH + 1), moves, turns)
    # A point is confirmed within a pixel either way: of turns as good, the one in the middle.
    best = np.flatnonzero(nats > nats.max() - NOT_ZERO)
    return float(nats.max()), pose.compose(axis.turn(float(turns[best[len(best) // 2]])))


def _moves(sight: Sight, shape: Shape, pose: Pose, axis: Axis) -> FloatArray:
    """How far each point moves along its normal by a turn of the model about an axis, (n,) pixels a radian."""
    direction = pose.rotation @ axis.direction
    shift = np.cross(direction, pose.apply(shape.centre) - pose.apply(axis.point))
    moves: FloatArray = sight.placed.slope[:, :6] @ np.concatenate([direction, shift])
    return moves


@njit(nogil=True)
def ratios(placed: Placed, limb: FloatArray, steps: Steps, moves: FloatArray, turns: FloatArray) -> FloatArray:
    """Nats of an outline (see :func:`..image_pose.presence.log_ratio`) of n points after each of t turns, (t,).

    Parameters
    ----------
    placed : Placed
    limb : (n,) float64
        See :class:`..image_pose.sight.Sight`.
    steps : Steps
        Along the normals, as :func:`..image_pose.presence.chance_beside` needs them.
    moves : (n,) float64
        Pixels along the normals a radian.
    turns : (t,) float64
        Radians.
    """
    chance = chance_beside(steps, placed.group, OTHERS_EDGES)
    is_bent, silent = bent(placed.point, placed.curve, limb), crowded(placed)
    found = confirmations(steps.offset, steps.number, 0.0)
    found[silent] = -1
    # Curves that stay where they are need one look.
    some = _moving(placed, moves * np.abs(turns).max())[placed.curve]
    still = by_hidden(found[~some], placed.group[~some], placed.curve[~some], is_bent, chance)
    offset, number, group, curve = steps.offset[some], steps.number[some], placed.group[some], placed.curve[some]
    out = np.empty(len(turns))
    for t in range(len(turns)):
        moved = confirmations(offset - np.expand_dims(moves[some] * turns[t], 1), number, 0.0)
        moved[silent[some]] = -1
        out[t] = log_mean(still + by_hidden(moved, group, curve, is_bent, chance))
    return out
