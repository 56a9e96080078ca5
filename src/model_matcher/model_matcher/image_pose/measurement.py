"""The pose of a model measured in images, from a pose near it (Harris & Stennett 1990; Drummond & Cipolla 2002).

First the pose is drawn in: steps of grey are looked for along the normals of the visible outline, several of each, and
the pose is laid on them by a mixture of normal errors and steps that are something else, at half the resolution first
where it may be far off. Then every step is fitted with its blur and with what runs beside it, and the pose is laid on
those, each by the variance that noise gives it and by what the outline itself may be off. Last the images are asked
whether the outline is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from ..geometry.least_squares import covariances
from ..geometry.pose_rows import as_motion, as_pose, step_between
from .alignment import ModelError, Placed, Steps, align, moved_by, new_fit
from .ends import ends_seen, log_ratio
from .finding import Pictures, steps_about
from .image_quality import look_of
from .model_error import FIRST_ERROR, NO_ERROR, likeliest, of_pose, settled
from .neighbours import may_hide, neighbours
from .presence import bent, shown_outline
from .profiles import FITTED, Quality, Stretches, fit_steps
from .settings import (
    CANDIDATES,
    DRAWN_ANEW,
    DRAWN_IN,
    FEWEST_POINTS,
    FIRST_SLOPE,
    FLANK,
    LONGEST_FIT_STEP,
    MOST_MOVED,
    ON_EDGE,
    OTHERS_EDGES,
    REACH,
    SEEN_STEP,
    TO_ERROR,
    TONES,
)
from .shade import settle_slopes
from .sight import Shape, Sight, drawn, look, outline_of
from .views import Views

# Where nothing is known of a pose beforehand.
NO_PRIOR = np.zeros((6, 6))


@dataclass(frozen=True, eq=False)
class Presence:
    """How far the images show an outline at a pose.

    Attributes
    ----------
    log_ratio : float
        Nats: log-likelihood ratio of the outline being there, parts of it hidden, against other edges being there.
    support : float
        Share of the length of the outline that the images confirm.
    sight : Sight
        The points of the outline.
    found : (n,) int8
        Of each, whether it is confirmed: 1, 0, or -1 outside the images and where another curve is as near.
    """

    log_ratio: float
    support: float
    sight: Sight = field(repr=False)
    found: Int8Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class ImagePose:
    """A pose as the images have it.

    Attributes
    ----------
    pose : Pose
        first_T_model.
    covariance : (6, 6) float64
        Of (x, y, z, rx, ry, rz), metres and radians, first camera's frame. A direction that the images leave free has
        the variance of its whole range.
    presence : Presence
        Whether the model is there at all.
    residual : (n,) float64
        Pixels along the normals, of the points of ``presence.sight``; not a number where no step was measured.
    weight : (n,) float64
        What each counted for: the chance that its step is the outline's, over its variance; one over square pixels.
    error : ModelError
        What the outline was found to be off, pixels.
    reason : str, optional
        Why there is no such pose; None when there is one.
    """

    pose: Pose
    covariance: FloatArray
    presence: Presence
    residual: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    weight: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    error: ModelError = NO_ERROR
    reason: str | None = None


def measure_pose(shape: Shape, pose: Pose, views: Views, search_px: float = REACH) -> ImagePose:
    """Measure where a model is.

    Parameters
    ----------
    shape : Shape
        The model, such as a :class:`csg_renderer.visibility.outline.SolidOutline`.
    pose : Pose
        first_T_model near the true one: its outline lies within ``search_px`` of the true one.
    views : Views
        Images of one moment, of any number of cameras.
    search_px : float
        Pixels.

    Returns
    -------
    ImagePose
        With a reason when nothing of the model is in view.
    """
    motion = drawn_in(shape, as_motion(pose), views, search_px)
    return polished(shape, motion, views)


def looked_for(shape: Shape, pose: Pose, views: Views, search_px: float = REACH) -> tuple[FloatArray, Sight]:
    """A pose near one, drawn in, and the outline there: one look at the shape serves for both, where it is near.

    Parameters
    ----------
    shape : Shape
    pose : Pose
        first_T_model, its outline within ``search_px`` pixels of where it is.
    views : Views
    search_px : float

    Returns
    -------
    motion : (12,) float64
    sight : Sight
    """
    motion = as_motion(pose)
    for level in views.pyramid(search_px)[:0:-1]:
        _draw_in(shape, motion, level, look(shape, as_pose(motion), level))
    outline = outline_of(shape, as_pose(motion), views.cameras, views.poses)
    _draw_in(shape, motion, views, drawn(outline, motion, shape.centre, views))
    return motion, drawn(outline, motion, shape.centre, views)


def drawn_in(shape: Shape, motion: FloatArray, views: Views, search_px: float = REACH) -> FloatArray:
    """A pose (12,) laid on the steps within ``search_px`` of its outline; a rough one, a tenth of a pixel off."""
    motion = motion.copy()
    for level in views.pyramid(search_px)[::-1]:
        _draw_in(shape, motion, level, look(shape, as_pose(motion), level))
    return motion


def _draw_in(shape: Shape, motion: FloatArray, views: Views, sight: Sight) -> None:
    """Lay a pose (12,), in place, on the steps within REACH of its outline."""
    steps = searched(sight, views, REACH)
    laid(shape, motion, views, sight, steps, np.array(DRAWN_IN), elsewhere(steps, REACH))


class Laid(NamedTuple):
    """A pose (12,) laid on fitted steps; the rest as :func:`settled` returns it."""

    motion: FloatArray
    residual: FloatArray
    weight: FloatArray
    normal: FloatArray
    error: ModelError


def polished(shape: Shape, motion: FloatArray, views: Views) -> ImagePose:
    """The pose from fitted steps, from one (12,) that is a pixel or so off; see :func:`measure_pose`.

    Steps are fitted where the outline is drawn: if the pose moves it farther than steps are told from, and than its
    curves are found to be off themselves, it is drawn anew. What images are like that nothing is known of yet is told
    anew as well where it has moved by much: a pixel off their edges, any of it may seem to be so.

    Whether the camera codes light by a tone curve is not said in an image. A wrong curve moves every step to its dark
    side, and which side that is differs from edge to edge: the right one leaves the outline less to be off. Where that
    is not clear the pose may be where the other curve has it.
    """
    tone_is_known, doubt = bool(views.tone[0] > 0.0), np.zeros((6, 6))
    for _ in range(DRAWN_ANEW):
        outline = outline_of(shape, as_pose(motion), views.cameras, views.poses)
        sight = drawn(outline, motion, shape.centre, views)
        if len(sight) < FEWEST_POINTS:
            return _nothing(motion, _unseen(sight))
        density = elsewhere(searched(sight, views, FLANK), FLANK)
        if tone_is_known:
            found = _laid_on_fitted(shape, motion, sight, density, views)
        else:
            coded = [views.coded(tone) for tone in TONES]
            laid_on = spread(partial(_laid_on_fitted, shape, motion, sight, density), coded)
            odds = _log_odds_of_code(laid_on, sight)
            best = int(odds > 0.0)
            found = laid_on[best]
            doubt = _of_other(as_pose(found.motion), as_pose(laid_on[1 - best].motion), abs(odds))
            views.take_over(coded[best].quality)
        motion = found.motion
        off, moved = math.hypot(found.error.curve, found.error.view), moved_by(motion, views.rows, sight.placed)
        if not moved > max(MOST_MOVED, off):
            break
        if moved < LONGEST_FIT_STEP:
            # So near, the steps told as much of the images as they will.
            tone_is_known = True
    pose = as_pose(motion)
    arm = (pose.translation - pose.apply(shape.centre))[None]
    covariance = covariances(found.normal[None], np.ones(1), arm, shape.size)[0] + doubt
    there = shown(drawn(outline, motion, shape.centre, views), views)
    return ImagePose(pose, covariance, there, found.residual, found.weight, found.error)


def _log_odds_of_code(found: list[Laid], sight: Sight) -> float:
    """Nats for the second of two tone curves against the first, by how far each leaves the outline off.

    All views show a curve off by the same, where a model is wrong or a tone: it is one witness, of two numbers.
    """
    off = [one.error.curve**2 + one.error.view**2 for one in found]
    told = np.bincount(sight.placed.curve, found[0].weight + found[1].weight)
    # By so much noise moves each curve in either case: errors that are far less do not tell the two apart.
    noise = 2.0 / told[told > 0.0]
    # The pose has taken six of the errors of the curves.
    return max(len(noise) - 3, 0) * float(np.log((off[0] + noise) / (off[1] + noise)).mean()) if len(noise) else 0.0


def _of_other(pose: Pose, other: Pose, odds: float) -> FloatArray:
    """(6, 6) what it adds to a pose's covariance that another is as well possible, against which there are odds, nats.

    Of (x, y, z, rx, ry, rz), metres and radians, first camera's frame.
    """
    away = step_between(pose, other)
    return np.asarray(0.5 * (1.0 - math.tanh(0.5 * odds)) * np.outer(away, away))


def _laid_on_fitted(shape: Shape, motion: FloatArray, sight: Sight, density: float, views: Views) -> Laid:
    """A pose near (12,), with the tone curve of the views; density : see :func:`elsewhere`."""
    return laid_on_steps(shape, motion, views, sight, own_steps(fitted(sight, views), sight, motion, views), density)


def laid_on_steps(shape: Shape, motion: FloatArray, views: Views, sight: Sight, steps: Steps, density: float) -> Laid:
    """A pose near (12,), laid on fitted steps; density : see :func:`elsewhere`."""
    # While the outline may be off by much, a turn that little tells of goes after whatever runs beside its edges: the
    # pose is laid anew once it is known by how little.
    about = shape.centre, views.rows, sight.placed, steps
    off = drawn_to(views)
    error = likeliest(motion.copy(), *about, FIRST_ERROR, density, TO_ERROR, off)[0]
    motion = motion.copy()
    return Laid(motion, *settled(motion, *about, error, density, TO_ERROR, off))


def drawn_to(views: Views) -> float:
    """Pixels, sigma, to which an outline is drawn in: a pixel, and in pictures blurred by more than that, the blur."""
    return max(ON_EDGE, float(views.look[:, 0].max()))


def presence(shape: Shape, pose: Pose, views: Views) -> Presence:
    """Whether images show an outline at a pose.

    Parameters
    ----------
    shape : Shape
    pose : Pose
        first_T_model, laid on the images.
    views : Views

    Returns
    -------
    Presence
    """
    return shown(look(shape, pose, views), views)


def shown(sight: Sight, views: Views) -> Presence:
    """Whether images show an outline where it is drawn; see :func:`presence`."""
    if not len(sight):
        return _unseen(sight)
    ratio, support, found = _shown(views.pictures, sight.placed, sight.spacing, sight.stretch, sight.limb)
    return Presence(ratio, support, sight, found)


@njit(nogil=True)
def _shown(
    pictures: Pictures, placed: Placed, spacing: FloatArray, stretch: FloatArray, limb: FloatArray
) -> tuple[float, float, Int8Array]:
    """See :func:`.presence.shown_outline`; something straight may stand in front, and edges may go on past ends."""
    steps = steps_about(pictures, placed.eye, placed.pixel, placed.normal, stretch, REACH + 1)
    is_bent = bent(placed.point, placed.curve, limb)
    ratio, support, found = shown_outline(placed, spacing, is_bent, steps, OTHERS_EDGES, True)
    gone, ends = ends_seen(pictures, placed, spacing, stretch, found, is_bent)
    return ratio + log_ratio(gone, ends), support, found


def still_shown(sight: Sight, steps: Steps, in_space: tuple[float, float]) -> Presence:
    """Whether images show an outline that was seen before: nothing straight stands in front, nor is it a longer one.

    steps : as :func:`searched` finds them within REACH and one; in_space : see :class:`.presence.Chance`
    """
    if not len(sight):
        return _unseen(sight)
    placed = sight.placed
    is_bent = bent(placed.point, placed.curve, sight.limb)
    ratio, support, found = shown_outline(placed, sight.spacing, is_bent, steps, in_space, False)
    return Presence(ratio, support, sight, found)


def _unseen(sight: Sight) -> Presence:
    """Nothing of it can be."""
    return Presence(-np.inf, 0.0, sight, np.zeros(len(sight), np.int8))


def searched(sight: Sight, views: Views, reach: int) -> Steps:
    """The strongest steps within ``reach`` pixels of all points, along their normals."""
    placed = sight.placed
    return Steps(*steps_about(views.pictures, placed.eye, placed.pixel, placed.normal, sight.stretch, reach))


def elsewhere(steps: Steps, reach: int) -> float:
    """Steps a pixel that are not the outline's, over the chance that a point of it shows one."""
    each: float = _mean_number(steps.number)
    return max(each, 1.0 / CANDIDATES) / (2 * reach + 1) / SEEN_STEP


@njit(nogil=True)
def _mean_number(number: Int32Array) -> float:
    """Steps of a profile, of those inside their images; 0 where none is."""
    inside, total = 0, 0
    for one in number:
        if one >= 0:
            inside += 1
            total += one
    return total / max(inside, 1)


def fitted(sight: Sight, views: Views) -> Steps:
    """The step at each point where the outline says it is, fitted to the grey levels."""
    tone = max(float(views.tone[0]), TONES[0])
    beside, flank = neighbours(sight.placed, sight.spacing)
    together = np.bincount(sight.placed.group)[sight.placed.group].astype(float)
    out = np.empty((len(sight), FITTED))

    def fit(eye: int) -> None:
        rows, image, noise = sight.rows(eye), views.images[eye], float(views.noise[eye])
        outline = Stretches(
            sight.placed.pixel[rows],
            sight.placed.normal[rows],
            sight.stretch[rows],
            sight.bend[rows],
            sight.limb[rows],
            flank[rows],
            together[rows],
        )
        if not views.look[eye].any():
            views.look[eye] = look_of(image, outline, beside[rows], tone, noise)
        blur, walk, slope = views.look[eye].tolist()
        shaded = max(slope, FIRST_SLOPE)
        fit_steps(image, outline, beside[rows], Quality(tone, blur, noise, walk, shaded), out[rows])
        settle_slopes(sight.placed.group[rows], slope, shaded, out[rows])

    # What an image is like takes long to tell; fits alone do not, and threads would take as long to begin.
    spread(fit, range(len(views)), 1 if views.look.any(axis=1).all() else None)
    known = np.isfinite(out[:, 0])
    offset, variance = (np.where(known, out[:, k], other) for k, other in enumerate((0.0, 1.0)))
    return Steps(offset[:, None], known.astype(np.int32), variance)


def own_steps(steps: Steps, sight: Sight, motion: FloatArray, views: Views) -> Steps:
    """The steps, but none at points that may hide at a pose (12,): one step does not hold two curves.

    Of two edges that blur into one, or of one that is hidden by now, a fit makes two as well as it can.
    """
    return steps.without(may_hide(sight.placed, motion, views.rows))


def laid(
    shape: Shape,
    motion: FloatArray,
    views: Views,
    sight: Sight,
    steps: Steps,
    widths: FloatArray,
    density: float,
    prior: FloatArray = NO_PRIOR,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lay a pose (12,) on steps, in place: residuals, weights (n,) and the normal matrix (6, 6); see :func:`.align`."""
    fit = new_fit(sight.placed, prior)
    align(motion, shape.centre, views.rows, sight.placed, steps, widths, density, NO_ERROR, fit)
    return fit.residual, fit.weight, of_pose(fit.equations.normal, 0.0)


def _nothing(motion: FloatArray, there: Presence) -> ImagePose:
    """The result where nothing can be measured."""
    return ImagePose(as_pose(motion), np.full((6, 6), np.nan), there, reason='too little of the model is in view')
