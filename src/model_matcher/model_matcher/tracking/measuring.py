"""One frame: a pose laid on the images from the one that was predicted, and whether they show the outline there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from ..geometry.least_squares import covariances
from ..geometry.settings import UNIFORM_VARIANCE
from ..image_pose.alignment import ModelError, Steps
from ..image_pose.measurement import Presence, drawn_to, elsewhere, fitted, laid, own_steps, searched, still_shown
from ..image_pose.model_error import settled
from ..image_pose.settings import DRAWN_IN, FARTHEST_STEP, FEWEST_POINTS, FLANK, ON_EDGE, REACH, SPACING, TO_POSE
from ..image_pose.sight import Outline, Shape, drawn
from ..image_pose.views import Views
from .settings import RARE

# Of a matrix of middle and turn (6, 6), that of turn and middle.
TURN_FIRST = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])


@dataclass(frozen=True, eq=False)
class Place:
    """A pose drawn in, and what the images say of it.

    Attributes
    ----------
    motion : (12,) float64
        first_T_model.
    presence : Presence
    steps : Steps
        That were found about the outline at this pose.
    """

    motion: FloatArray
    presence: Presence
    steps: Steps


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured pose.

    Attributes
    ----------
    motion : (12,) float64
        first_T_model.
    covariance : (6, 6) float64
        Of middle and turn.
    confirmed : (6, 6) float64
        Of middle and turn, by no more than that steps confirm the outline: each lies anywhere within ON_EDGE of its
        point. That is what was asked whether the object is there; how exactly they agree was not.
    error : ModelError
        What the outline was found to be off.
    """

    motion: FloatArray
    covariance: FloatArray
    confirmed: FloatArray
    error: ModelError


def searched_for(
    shape: Shape,
    outline: Outline,
    motion: FloatArray,
    views: Views,
    search_px: float,
    covariance: FloatArray,
    hidden: BoolArray | None,
) -> Place:
    """Draw a pose in, and ask the images.

    Parameters
    ----------
    shape : Shape
    outline : Outline
        About as the views see it.
    motion : (12,) float64
        Predicted.
    views : Views
    search_px : float
        How far the outline may be from where it is predicted.
    covariance : (6, 6) float64
        Of middle and turn, as predicted.
    hidden : (n,) bool, optional
        Points of the outline that something nearer hides.
    """
    seen = outline if hidden is None else _some(outline, ~hidden)
    prior = np.asarray(np.linalg.inv(covariance[TURN_FIRST]), np.float64)
    motion = motion.copy()
    levels = views.pyramid(search_px)
    for level in range(len(levels) - 1, -1, -1):
        # In an image of half the size neighbours are half as far apart: every second one is looked at.
        some = seen if level == 0 else _some(seen, np.arange(0, len(seen.eye), 2**level))
        sight = drawn(some, motion, shape.centre, levels[level], SPACING)
        reach = int(np.ceil(min(search_px, REACH)))
        # What is looked for near by serves to ask the images afterwards, when it is found where it was looked for: they
        # are asked within REACH and a pixel, and it may have moved by one.
        steps = searched(sight, levels[level], REACH + 2 if search_px <= FLANK else reach)
        near = within(steps, reach) if search_px <= FLANK else steps
        near = own_steps(near, sight, motion, levels[level])
        widths = np.array([width for width in DRAWN_IN if width <= 0.5 * reach + 1.0])
        laid(shape, motion, levels[level], sight, near, widths, elsewhere(near, reach), prior)
    there = drawn(seen, motion, shape.centre, views, SPACING)
    if search_px > FLANK or len(there) != len(sight):
        steps = searched(there, views, REACH + 1)
    else:
        moved = ((there.placed.pixel - sight.placed.pixel) * sight.placed.normal).sum(axis=1)
        near = np.abs(moved).max(initial=0.0) <= 1.0
        steps = steps._replace(offset=steps.offset - moved[:, None]) if near else searched(there, views, REACH + 1)
    return Place(motion, still_shown(there, steps, (RARE, RARE)), steps)


def within(steps: Steps, reach: int) -> Steps:
    """The steps within ``reach`` pixels."""
    offset, number = _within(steps, reach)
    return steps._replace(offset=offset, number=number)


@njit(nogil=True)
def _within(steps: Steps, reach: int) -> tuple[FloatArray, Int32Array]:
    """Places of steps (n, c), and how many they are (n,), less those farther away."""
    kept, count = np.full_like(steps.offset, np.nan), steps.number.copy()
    for k in range(len(count)):
        if steps.number[k] <= 0:
            continue
        count[k] = 0
        for j in range(steps.number[k]):
            if abs(steps.offset[k, j]) <= reach:
                kept[k, count[k]] = steps.offset[k, j]
                count[k] += 1
    return kept, count


def measured(shape: Shape, place: Place, views: Views, error: ModelError) -> Measured | None:
    """The pose by fitted steps; None where too little of the outline shows a step."""
    sight, motion = place.presence.sight, place.motion.copy()
    if len(sight) < FEWEST_POINTS:
        return None
    density = elsewhere(within(place.steps, FLANK), FLANK)
    steps = own_steps(fitted(sight, views), sight, motion, views)
    about = shape.centre, views.rows, sight.placed, steps
    _, weight, normal, error = settled(motion, *about, error, density, TO_POSE, drawn_to(views))
    if (weight > 0.0).sum() < FEWEST_POINTS:
        return None
    if error.point > FARTHEST_STEP:
        return None
    slope = sight.placed.slope[weight > 0.0, :6]
    confirmed = slope.T @ slope / (UNIFORM_VARIANCE * (2.0 * ON_EDGE) ** 2)
    both = covariances(np.stack([normal, confirmed]), np.ones(2), np.zeros((2, 3)), shape.size)
    return Measured(motion, both[0], both[1], error)


def _some(outline: Outline, rows: BoolArray | IntArray) -> Outline:
    """Some of the points of an outline."""
    point, tangent, outward, eye, curve, feature, spacing = outline
    return Outline(point[rows], tangent[rows], outward[rows], eye[rows], curve[rows], feature[rows], spacing[rows])
