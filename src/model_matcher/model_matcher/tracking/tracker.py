"""One object followed from image to image (Harris & Stennett 1990; Drummond & Cipolla 2002).

A frame is a prediction, a search about it as far as its covariance says, a measurement in the images, and a correction
by it. Whether the object is there at all is a second state, of two values, with the chances that it vanishes or is
there again from one frame to the next; the images speak for the one or the other by the log-likelihood ratio of its
outline (:mod:`..image_pose.presence`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msgs_py import CameraRig, Interpretation, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray

from ..geometry.pose_rows import as_motion, as_pose
from ..image_pose.measurement import Presence
from ..image_pose.model_error import FIRST_ERROR
from ..image_pose.settings import FLANK, REACH
from ..image_pose.sight import NO_SIGHT, Outline, Shape, Sight
from ..image_pose.views import Views
from .appearance import patches, shifted
from .aspect import AspectCache
from .hiding import behind
from .measuring import Place, measured, searched_for
from .motion_filter import (
    BodyState,
    about_middle,
    at_rest,
    carried,
    corrected,
    mahalanobis,
    moved_camera,
    occam,
    predicted,
)
from .settings import ACCELERATION, COVERED, JUMP_M, JUMP_RAD, PERIOD_S, RARE, REMEMBERED, SPEED, START, WEAK
from .texture import corners_of
from .texture import followed as by_corners

Cameras = PinholeCamera | StereoRig | CameraRig


@dataclass(frozen=True)
class TrackParams:
    """How an object is followed.

    Attributes
    ----------
    acceleration : float
        Metres a second squared: sigma of the acceleration of any point of it.
    speed : float
        Metres a second: sigma of the speed of any point of it at the start.
    period_s : float
        Seconds between frames where no others are given.
    """

    acceleration: float = ACCELERATION
    speed: float = SPEED
    period_s: float = PERIOD_S

    def __post_init__(self) -> None:
        for name in ('acceleration', 'speed', 'period_s'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name}: expected a number above 0, got {value!r}')


@dataclass(frozen=True, eq=False)
class Tracked:
    """What is known of an object after a frame.

    Attributes
    ----------
    pose : Pose, optional
        first_T_model; None when it is lost.
    covariance : (6, 6) float64
        Of (x, y, z, rx, ry, rz), metres and radians, first camera's frame.
    twist : (6,) float64
        Velocity of its middle and angular velocity, metres and radians a second, first camera's frame.
    presence : Presence
        What the images show of its outline.
    log_odds : float
        Nats, of its being there, by this and all earlier frames.
    search_px : float
        How far was searched.
    reason : str, optional
        Why it is lost; None when it is not.
    """

    pose: Pose | None
    covariance: FloatArray
    twist: FloatArray
    presence: Presence
    log_odds: float
    search_px: float
    reason: str | None = None


class _Guess(NamedTuple):
    """Where an object may be: a predicted body, pixels about it that are searched, and nats beforehand.

    by_texture : whether corners predict it
    """

    state: BodyState
    search_px: float
    prior: float
    by_texture: bool = False


class Tracker:
    """Follows an object whose pose is known about.

    Parameters
    ----------
    shape : Shape
        The model, such as a :class:`csg_renderer.visibility.outline.SolidOutline`.
    start : Pose or Interpretation
        first_T_model; an interpretation has its covariance.
    params : TrackParams, optional

    Attributes
    ----------
    frames, renewed : int
        Frames so far; outlines that were made for them.

    Examples
    --------
    ``pose = tracker(images, rig)`` for every frame, or ``for pose in tracker.follow(frames)``; None says that it is
    lost, and ``tracker.restart(pose)`` takes it up again.
    """

    def __init__(self, shape: Shape, start: Pose | Interpretation, params: TrackParams | None = None) -> None:
        self.shape = shape
        self.params = params or TrackParams()
        self.frames = 0
        self._aspects = AspectCache(shape)
        self._arm = 0.5 * shape.size
        self._state: BodyState
        self.restart(start)

    @property
    def renewed(self) -> int:
        """How many outlines were made."""
        return self._aspects.renewed

    @property
    def pose(self) -> Pose | None:
        """first_T_model in the last frame; None when it is lost."""
        return self._state.pose if self._log_odds > 0.0 else None

    def restart(self, start: Pose | Interpretation) -> None:
        """Take the object up at a pose first_T_model, at rest as far as is known."""
        pose, covariance = (start.pose, start.covariance) if isinstance(start, Interpretation) else (start, None)
        middle = self.shape.centre
        if covariance is None:
            spread = np.diag([START**2] * 3 + [(START / self._arm) ** 2] * 3)
        else:
            spread = about_middle(covariance, pose, middle)
        self._state = at_rest(pose, middle, spread, self.params.speed, self.params.speed / self._arm)
        self._error = FIRST_ERROR
        self._log_odds = -math.log(RARE)
        self._support = 1.0
        self._accelerations = np.array([self.params.acceleration**2, 1.0])
        self._begun = False
        self._last: tuple[Sight, Pose, Views] | None = None
        self._measured: FloatArray | None = None
        self._evidence = math.inf
        self._lost_s = 0.0
        self._quality: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def __call__(self, images: Sequence[ByteArray], cameras: Cameras) -> Pose | None:
        """The pose in the next frame, first_T_model, or None; see :meth:`step`."""
        return self.step(Views.of(images, cameras)).pose

    def follow(self, frames: Iterable[tuple[Sequence[ByteArray], Cameras]]) -> Iterator[Pose | None]:
        """The pose in each of some frames, images and their cameras; the cameras may differ from one to the next."""
        for images, cameras in frames:
            yield self(images, cameras)

    def step(
        self,
        views: Views,
        seconds: float | None = None,
        camera_motion: Pose | None = None,
        expected: Pose | None = None,
        nearer: Sequence[Sight] = (),
    ) -> Tracked:
        """Take in the next frame.

        Parameters
        ----------
        views : Views
            Its images and where their cameras stand.
        seconds : float, optional
            Since the last frame, or since that of the pose to start from; ``params.period_s``, and none, without it.
        camera_motion : Pose, optional
            new_T_old of the first camera, where it has moved and is known to have.
        expected : Pose, optional
            first_T_model where somebody else predicts it; the filter says how sure that is.
        nearer : sequence of Sight
            Outlines of other objects; what they hide of this one is not missed.

        Returns
        -------
        Tracked
        """
        if seconds is None:
            seconds = self.params.period_s if self._begun else 0.0
        self._begun = True
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise ValueError(f'seconds: expected a number of at least 0, got {seconds!r}')
        self.frames += 1
        lost = self._log_odds <= 0.0
        state = self._state if camera_motion is None else moved_camera(self._state, camera_motion)
        if not lost:
            acceleration = math.sqrt(self._accelerations[0] / self._accelerations[1])
            state = predicted(state, seconds, acceleration, acceleration / self._arm)
        if expected is not None:
            state = BodyState(expected, state.middle, state.twist, state.covariance)
        # What an image is like changes slowly: every so often they are measured again.
        if self._quality is not None and len(self._quality[0]) == len(views) and self.frames % REMEMBERED:
            views.take_over(self._quality)
        self._lost_s = self._lost_s + seconds if lost else 0.0
        # By then it may be anywhere but where it was: it has had the time to leave its own place.
        if self._lost_s * self.params.speed > self.shape.size:
            return self._result(state, Presence(-math.inf, 0.0, NO_SIGHT, np.zeros(0, np.int8)), 0.0)
        outline = self._aspects.outline(state.pose, views)
        hidden = behind(outline, state.pose, views, nearer) if nearer else None
        before = self._state if camera_motion is None else moved_camera(self._state, camera_motion)
        place, guess = self._best_place(outline, self._guesses(state, before, seconds, views, lost), views, hidden)
        found = measured(self.shape, place, views, self._error)
        if found is None:
            self._weigh(-math.inf)
            return self._result(state, place.presence, guess.search_px)
        covariance = found.covariance
        # Of a part that may be anywhere edges are chosen that agree; near where it is predicted they are looked at.
        told = covariance if lost or guess.search_px > REACH else found.confirmed
        evidence = place.presence.log_ratio + guess.prior - occam(guess.state.covariance[:6, :6], told)
        self._weigh(evidence)
        if self._log_odds > 0.0:
            if guess.state is state:
                self._learn(state, as_pose(found.motion), covariance)
            self._error, self._support, self._evidence = found.error, place.presence.support, evidence
            self._quality = views.quality
            self._measured = covariance
            state = self._state = corrected(guess.state, as_pose(found.motion), covariance)
            self._last = place.presence.sight, state.pose, views
        return self._result(state, place.presence, guess.search_px)

    def _guesses(
        self, state: BodyState, before: BodyState, seconds: float, views: Views, lost: bool
    ) -> Iterator[_Guess]:
        """Where the object may be, the likeliest first; each is made only when those before it have not served.

        state, before : predicted, and as it was in the last frame
        """
        far, jump = self._far(state, views), math.log(RARE)
        if not lost:
            near = self._near(state, views)
            yield _Guess(state, min(near, float(REACH)), 0.0)
            turned = self._by_texture(state, before, seconds, views, far)
            if turned is not None:
                yield _Guess(turned, max(FLANK, min(self._near(turned, views), float(REACH))), 0.0, True)
            if near > REACH:
                yield _Guess(state, near, 0.0)
        pushed = self._unsettled(state)
        there = self._as_it_looked(state, views, far)
        if there is not None and not lost:
            yield _Guess(replace(pushed, pose=there), float(REACH), jump)
        yield _Guess(pushed, far, 0.0 if lost else jump)

    def _best_place(
        self, outline: Outline, guesses: Iterable[_Guess], views: Views, hidden: BoolArray | None
    ) -> tuple[Place, _Guess]:
        """Where the images show the object best; guesses are tried until one shows as much of it as before."""
        best: tuple[float, Place, _Guess] | None = None
        served = False
        for guess in guesses:
            if served and not guess.by_texture:
                break
            spread = guess.state.covariance[:6, :6]
            start = as_motion(guess.state.pose)
            place = searched_for(self.shape, outline, start, views, guess.search_px, spread, hidden)
            # What a pose costs that is chosen from more: see occam; by the last measurement's covariance.
            cost = 0.0 if self._measured is None else occam(spread, self._measured)
            score = place.presence.log_ratio + guess.prior - cost
            if best is None or score > best[0]:
                best = score, place, guess
            served = served or place.presence.support >= self._support - COVERED
            # Where the outline says little the texture is asked, too.
            if served and (self._evidence >= WEAK or guess.by_texture):
                break
        assert best is not None
        return best[1], best[2]

    def _by_texture(
        self, state: BodyState, before: BodyState, seconds: float, views: Views, reach_px: float
    ) -> BodyState | None:
        """The body as the motion of its corners predicts it; None where it has too few."""
        if self._last is None or seconds <= 0.0:
            return None
        corners = corners_of(self.shape, self._last[1], self._last[0], self._last[2])
        found = by_corners(corners, state.pose, self._pushed, state.middle, views, reach_px)
        if found is None:
            return None
        pose, covariance = found
        change = state.covariance[6:, 6:] - before.covariance[6:, 6:]
        return carried(before, pose, covariance, seconds, change)

    def _as_it_looked(self, state: BodyState, views: Views, reach_px: float) -> Pose | None:
        """The predicted pose shifted to where the images look most as the object did when it was last seen."""
        if self._last is None:
            return None
        sight, pose, then = self._last
        return shifted(patches(sight, pose.apply(state.middle), then), state.pose, state.middle, views, reach_px)

    def _near(self, state: BodyState, views: Views) -> float:
        """How far points may be from where they are predicted, pixels: by the filter's covariance."""
        # Of the three shifts and turns each, the largest; a turn at the point that is farthest from the middle.
        blocks = np.stack([state.covariance[:3, :3], state.covariance[3:6, 3:6]])
        shift, turn = np.sqrt(np.linalg.eigvalsh(blocks)[:, -1]).tolist()
        return max(FLANK, BOUND_SIGMA * self._pixels(state, views) * math.hypot(shift, turn * self._arm))

    def _far(self, state: BodyState, views: Views) -> float:
        """The same after a sudden move."""
        return self._pixels(state, views) * (JUMP_M + JUMP_RAD * self._arm)

    def _pixels(self, state: BodyState, views: Views) -> float:
        """Pixels a metre at the object."""
        rows = views.rows
        return float((rows[:, 12] / np.maximum(rows[:, 6:9] @ state.place + rows[:, 11], self._arm)).max())

    @property
    def _pushed(self) -> FloatArray:
        """Covariance (6, 6) of middle and turn after a sudden move."""
        return np.diag([JUMP_M**2] * 3 + [JUMP_RAD**2] * 3)

    def _unsettled(self, state: BodyState) -> BodyState:
        """A body that has been pushed: where it is and how it moves is known no better than at the start."""
        return at_rest(state.pose, state.middle, self._pushed, self.params.speed, self.params.speed / self._arm)

    def _learn(self, state: BodyState, pose: Pose, covariance: FloatArray) -> None:
        """How much the object accelerates, from what the prediction was off: the mean over the last frames."""
        distance = mahalanobis(state, pose, covariance) / 6.0
        self._accelerations *= 1.0 - 1.0 / REMEMBERED
        self._accelerations += distance * self._accelerations[0] / self._accelerations[1], 1.0

    def _weigh(self, log_ratio: float) -> None:
        """One step of the hidden Markov chain of being there."""
        there = 1.0 / (1.0 + math.exp(-min(max(self._log_odds, -700.0), 700.0)))
        there = there * (1.0 - RARE) + (1.0 - there) * RARE
        self._log_odds = max(math.log(there) - math.log1p(-there) + log_ratio, math.log(RARE))

    def _result(self, state: BodyState, presence: Presence, search: float) -> Tracked:
        lost = self._log_odds <= 0.0
        reason = f'the images show {presence.support:.0%} of its outline, as chance does' if lost else None
        return Tracked(
            None if lost else state.pose, state.pose_covariance, state.twist, presence, self._log_odds, search, reason
        )
