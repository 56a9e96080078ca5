"""How a part moves before the cameras, and what passes in front of it: plain values, and poses at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import Pose

from ..settings import OCCLUDER, PATH

PATHS = ('turn', 'tumble')


@dataclass(frozen=True)
class Motion:
    """The path of a part.

    Attributes
    ----------
    path : str
        'turn' (about the camera's vertical through the part's middle, always on) or 'tumble' (to and fro about all
        three axes); either way the middle swings to and fro along all three.
    frames : int
        How many.
    rate_hz : float
        Frames a second.
    turn_deg_s, shift_m_s : float
        How fast it turns and how fast its middle moves, degrees and metres a second; of what swings, at the fastest and
        along one axis.
    exposure : float
        Share of the time between two frames for which the shutter is open; 0 for sharp pictures.
    occluders : int
        Bars that pass in front, one after the other.
    occlusion : float
        Width of a bar as the left camera sees it, in widths of the part at the start: 0.5 hides up to about half of it,
        1.5 all for a while.
    jump : int
        The first frame after a sudden move by ``jump_m`` and ``jump_deg``; 0 for none.
    jump_m, jump_deg : float
        Metres and degrees.

    Raises
    ------
    ValueError
        Naming the attribute.

    Examples
    --------
    >>> Motion(frames=60, rate_hz=30.0).duration_s
    2.0
    """

    path: str = 'turn'
    frames: int = 100
    rate_hz: float = 30.0
    turn_deg_s: float = 40.0
    shift_m_s: float = 0.05
    exposure: float = 0.0
    occluders: int = 0
    occlusion: float = 0.5
    jump: int = 0
    jump_m: float = 0.02
    jump_deg: float = 5.0

    def __post_init__(self) -> None:
        if self.path not in PATHS:
            raise ValueError(f'path: expected one of {", ".join(PATHS)}, got {self.path!r}')
        for name, low, high in (
            ('frames', 1, np.inf),
            ('turn_deg_s', -np.inf, np.inf),
            ('shift_m_s', 0.0, np.inf),
            ('exposure', 0.0, 1.0),
            ('occluders', 0, np.inf),
            ('occlusion', 0.0, 10.0),
            ('jump', 0, np.inf),
            ('jump_m', 0.0, np.inf),
            ('jump_deg', 0.0, 180.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f'{name}: expected a number from {low:g} to {high:g}, got {getattr(self, name)!r}')
        if not 0.0 < self.rate_hz < np.inf:
            raise ValueError(f'rate_hz: expected a number above 0, got {self.rate_hz!r}')

    @property
    def duration_s(self) -> float:
        """Seconds from the first frame to where one after the last would be."""
        return self.frames / self.rate_hz

    @property
    def stamps(self) -> np.ndarray:
        """(frames,) float64, seconds: the middle of each exposure; the first is 0."""
        return np.arange(self.frames) / self.rate_hz


class Course:
    """Where a part is at any time of a motion.

    Parameters
    ----------
    motion : Motion
        How it moves.
    start : Pose
        left_T_part at time 0.
    middle : (3,) float64
        Metres, of the part in its own frame; it turns about this point.
    """

    def __init__(self, motion: Motion, start: Pose, middle: np.ndarray) -> None:
        self.motion, self.start, self.middle = motion, start, np.asarray(middle, float)
        self.centre = start.apply(self.middle)
        # No swing leads farther than its share of the depth: a fast one returns the sooner.
        reach = PATH.reach * float(self.centre[2])
        self._swing = np.maximum(2.0 * np.pi * np.array(PATH.shift_hz), motion.shift_m_s / reach)
        self._rock = np.maximum(
            2.0 * np.pi * np.array(PATH.turn_hz), abs(motion.turn_deg_s) / PATH.rock_deg * np.ones(3)
        )

    @property
    def reach(self) -> float:
        """Metres that the middle goes at most from where it starts."""
        swings = float(np.linalg.norm(self.motion.shift_m_s / self._swing))
        return swings + (self.motion.jump_m if self.motion.jump else 0.0)

    def pose(self, time: float) -> Pose:
        """left_T_part at a time, seconds."""
        motion = self.motion
        shift = motion.shift_m_s / self._swing * np.sin(self._swing * time)
        if motion.path == 'turn':
            turn = np.array([0.0, np.radians(motion.turn_deg_s) * time, 0.0])
        else:
            turn = np.radians(motion.turn_deg_s) / self._rock * np.sin(self._rock * time)
        rotation = Pose.from_rotation_vector(turn).rotation
        # Half a frame before the jump's frame nothing has been exposed that shows it.
        if motion.jump and time >= (motion.jump - 0.5) / motion.rate_hz:
            aside = Pose.from_rotation_vector(np.radians(motion.jump_deg) * np.array([1.0, 0.0, 0.0]))
            rotation = aside.rotation @ rotation
            shift = shift + [motion.jump_m, 0.0, 0.0]
        rotation = rotation @ self.start.rotation
        return Pose(rotation, self.centre + shift - rotation @ self.middle)


@dataclass(frozen=True)
class Bar:
    """Something that passes in front of the part. size : (3,) metres; centre : of the bar, left frame."""

    size: tuple[float, float, float]
    centre: tuple[float, float, float]

    @property
    def corner(self) -> np.ndarray:
        """(3,) float64, metres: where the bar's least corner is."""
        return np.asarray(self.centre) - 0.5 * np.asarray(self.size)


@dataclass(frozen=True, eq=False)
class Foreground:
    """What there is to know of a view to put something in front of the part.

    Attributes
    ----------
    middle, size : (2,) float64
        Of the part's image at the start, in units of the focal length (x / z, y / z).
    view : (2,) float64
        Width and height of the image in the same units.
    depth : float
        Metres: the part is never nearer.
    """

    middle: np.ndarray
    size: np.ndarray
    view: np.ndarray
    depth: float


def bars_at(motion: Motion, foreground: Foreground, time: float) -> list[Bar]:
    """The occluders at a time, seconds; each second one lies across and moves downwards."""
    depth = OCCLUDER.depth * foreground.depth
    bars = []
    for k in range(motion.occluders):
        # They take turns: each crosses the picture, then waits for the others.
        way = (time / OCCLUDER.pass_s + OCCLUDER.first - k) % motion.occluders
        along = k % 2
        width = motion.occlusion * foreground.size[along]
        place = foreground.middle.copy()
        place[along] += (way - 0.5) * 2.0 * (foreground.view[along] + width)
        size = np.full(2, 3.0 * foreground.view.max())
        size[along] = width
        size, place = size * depth, place * depth
        bars.append(
            Bar((float(size[0]), float(size[1]), OCCLUDER.thickness * depth), (float(place[0]), float(place[1]), depth))
        )
    return bars
