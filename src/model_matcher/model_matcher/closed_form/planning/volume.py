"""Where in space and how turned a part is looked for, and views that cover all of that evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import FloatArray
from msgs_py.numeric.vectors import perpendicular

from .rig import PlannedRig
from .settings import PLACINGS


@dataclass(frozen=True)
class Volume:
    """A working volume.

    Parameters
    ----------
    nearest, farthest : float
        Metres, of the part's middle from the left camera's plane.
    tilt : (float, float)
        Degrees in 0..180, least and greatest angle between the part's ``up`` and the line of sight from the part to the
        camera: 0 is seen from above.
    turn : (float, float)
        Degrees in -180..180, turns about the line of sight.
    up : (3,) of float
        Direction, model frame.
    at_once : int
        How many parts lie in one picture.
    clutter : int
        Further solids in it, beside and behind the parts.

    Raises
    ------
    ValueError
        A field is out of its range; the message begins with its name.
    """

    nearest: float
    farthest: float
    tilt: tuple[float, float] = (0.0, 180.0)
    turn: tuple[float, float] = (-180.0, 180.0)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    at_once: int = 1
    clutter: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.nearest <= self.farthest < np.inf:
            raise ValueError(f'distance: expected 0 < nearest <= farthest, got {self.nearest}, {self.farthest}')
        for name, low, high in (('tilt', 0.0, 180.0), ('turn', -180.0, 180.0)):
            first, last = getattr(self, name)
            if not low <= first <= last <= high:
                raise ValueError(f'{name}: expected {low:g} <= least <= greatest <= {high:g}, got {first}, {last}')
        if not 0.0 < float(np.linalg.norm(self.up)) < np.inf:
            raise ValueError(f'up: expected a direction, got {self.up}')
        if self.at_once < 1:
            raise ValueError(f'at_once: expected 1 or more, got {self.at_once}')
        if self.clutter < 0:
            raise ValueError(f'clutter: expected 0 or more, got {self.clutter}')

    def views(self, count: int, rig: PlannedRig, ball: tuple[FloatArray, float]) -> list[Pose]:
        """Poses that cover it, one a view.

        Directions from which the part is seen are those of a Fibonacci lattice between the tilts. Distances, turns and
        places in the picture are those of an additive recurrence, which spreads them evenly however many there are.

        Parameters
        ----------
        count : int
            How many.
        rig : PlannedRig
            The part's middle lies where both cameras see all of it, where there is such a place.
        ball : (middle, radius)
            A sphere about the part: (3,) float64, metres, model frame, and metres.

        Returns
        -------
        list of Pose
            left_T_part.
        """
        numbers = np.arange(count)
        steps, (golden,) = spread(3), spread(1)
        share = (numbers[:, None] * steps + 0.5) % 1.0
        return [
            self._pose(direction, share[k], (numbers[k] * golden * steps[0]) % 1.0, rig, ball)
            for k, direction in enumerate(self.directions(count))
        ]

    def directions(self, count: int) -> FloatArray:
        """From the part to the camera, (count, 3) float64 unit vectors, model frame."""
        k = np.arange(count) + 0.5
        low, high = np.cos(np.radians(self.tilt[1])), np.cos(np.radians(self.tilt[0]))
        height = high - (high - low) * k / count
        ring, angle = np.sqrt(np.maximum(1.0 - height**2, 0.0)), 2.0 * np.pi * spread(1) * k
        z = np.array(self.up) / np.linalg.norm(self.up)
        x = perpendicular(z)
        y = np.cross(z, x)
        return np.asarray(np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1) @ np.stack([x, y, z]))

    def anywhere(self, rng: np.random.Generator, rig: PlannedRig, ball: tuple[FloatArray, float]) -> Pose:
        """A random pose of it, left_T_part; arguments as of :meth:`views`."""
        z = np.array(self.up) / np.linalg.norm(self.up)
        low, high = np.cos(np.radians(self.tilt[1])), np.cos(np.radians(self.tilt[0]))
        height, angle = rng.uniform(low, high), rng.uniform(0.0, 2.0 * np.pi)
        x = perpendicular(z)
        ring = np.sqrt(max(1.0 - height**2, 0.0))
        direction = ring * (np.cos(angle) * x + np.sin(angle) * np.cross(z, x)) + height * z
        return self._pose(direction, rng.uniform(size=3), float(rng.uniform()), rig, ball)

    def beside(
        self, first: Pose, rng: np.random.Generator, rig: PlannedRig, ball: tuple[FloatArray, float]
    ) -> list[Pose]:
        """As many poses as lie in a picture at once, the given one first; no part hides another or stands in it.

        Fewer where there is no room.
        """
        found = [first]
        for _ in range(PLACINGS):
            if len(found) == self.at_once:
                break
            other = self.anywhere(rng, rig, ball)
            if all(_apart(rig.pair.left, one.apply(ball[0]), other.apply(ball[0]), ball[1]) for one in found):
                found.append(other)
        return found

    def _pose(
        self, direction: FloatArray, share: FloatArray, turned: float, rig: PlannedRig, ball: tuple[FloatArray, float]
    ) -> Pose:
        """left_T_part: direction (3,) to the camera, shares (3,) of distance and of the picture, share of the turns."""
        depth = self.nearest + (self.farthest - self.nearest) * share[0]
        middle, radius = ball
        low, high = _room(rig, depth, radius)
        place = np.array([*(low + (high - low) * share[1:]), depth])
        ray = place / np.linalg.norm(place)
        # The part's direction to the camera goes to -z, is turned about z, and z is laid on the line of sight.
        x = perpendicular(direction)
        facing = np.stack([x, np.cross(-direction, x), -direction])
        angle = np.radians(self.turn[0] + (self.turn[1] - self.turn[0]) * turned)
        about = Pose.from_rotation_vector([0.0, 0.0, angle]).rotation
        lean = np.cross([0.0, 0.0, 1.0], ray)
        sine = float(np.linalg.norm(lean))
        axis = lean * (np.arctan2(sine, ray[2]) / sine) if sine > 0.0 else lean
        rotation = Pose.from_rotation_vector(axis).rotation @ about @ facing
        return Pose(rotation, place - rotation @ middle)


def spread(dimensions: int) -> FloatArray:
    """Steps whose multiples, less their whole parts, cover a cube most evenly; of a line, the golden section.

    They are the powers of one over the root of x^(d + 1) = x + 1 in d dimensions (Roberts 2018).

    Examples
    --------
    >>> spread(1).round(4).tolist(), spread(3).round(4).tolist()
    ([0.618], [0.8192, 0.671, 0.5497])
    """
    root = np.roots([1.0, *np.zeros(dimensions - 1), -1.0, -1.0]).real.max()
    return np.asarray(root ** -np.arange(1.0, dimensions + 1.0))


def _room(rig: PlannedRig, depth: float, radius: float) -> tuple[FloatArray, FloatArray]:
    """Least and greatest (2,) x, y, metres, of a sphere's middle that both cameras of a pair see whole.

    Where there is no such place, the middle of what both see.
    """
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    for camera, shift in ((rig.pair.left, 0.0), (rig.pair.right, rig.pair.baseline)):
        focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
        # A sphere's picture is a little wider than radius over depth: seen from beside, and its front is nearer.
        edge = focal * radius / max(depth - radius, 1e-9)
        offset, last = np.array([shift, 0.0]), np.array([camera.width, camera.height]) - 1.0
        low = np.maximum(low, (edge - centre) / focal * depth + offset)
        high = np.minimum(high, (last - edge - centre) / focal * depth + offset)
    middle = 0.5 * (low + high)
    fits = low <= high
    return np.where(fits, low, middle), np.where(fits, high, middle)


def _apart(camera: PinholeCamera, one: FloatArray, other: FloatArray, radius: float) -> bool:
    """Whether the pictures of two spheres do not overlap; middles (3,), metres, camera's frame."""
    reach = camera.fx * radius * (1.0 / one[2] + 1.0 / other[2])
    return bool(np.linalg.norm(camera.project(one) - camera.project(other)) > reach)
