"""Parts of a machine shop by the hundred thousand: brackets, flanges, shafts and housings of varied dimensions, seeded.

Each part's features are written down in closed form, which takes a fraction of a millisecond; ``solid`` makes the same
part for csg_renderer, whose boundary evaluation finds the same features some tens of times more slowly (compared by
test_parts_generator.py). Dimensions are millimetres, drawn from what such parts have and not rounded: no two parts are
equal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from csg_renderer import Solid
from msgs_py import FeatureKind, FeatureSet

Point = tuple[float, float, float]
MM = 1e-3
FAMILIES = ('bracket', 'flange', 'shaft', 'housing')


@dataclass
class Part:
    """A part: the tree of its solid, and its features in millimetres.

    Attributes
    ----------
    name : str
    features : list of tuple
        Kind, start, end and radius of each.
    added, cut : list of tuple
        'block' with corner and size, or 'cylinder' with base, axis and radius: what makes the solid, and what is taken
        away from it.
    """

    name: str
    features: list[tuple[FeatureKind, Point, Point, float]] = field(default_factory=list)
    added: list[tuple[str, Point, Point, float]] = field(default_factory=list)
    cut: list[tuple[str, Point, Point, float]] = field(default_factory=list)

    def edge(self, start: Point, end: Point) -> None:
        """A straight edge."""
        self.features.append((FeatureKind.EDGE, start, end, np.nan))

    def circle(self, centre: Point, axis: Point, radius: float) -> None:
        """A circle about a centre, in the plane upright to an axis of the frame."""
        end = (centre[0] + axis[0] / MM, centre[1] + axis[1] / MM, centre[2] + axis[2] / MM)
        self.features.append((FeatureKind.CURVE, centre, end, radius))

    def axis(self, start: Point, end: Point) -> None:
        """The axis of a surface of revolution."""
        self.features.append((FeatureKind.AXIS, start, end, np.nan))

    def prism(self, outline: list[tuple[float, float]], depth: float) -> None:
        """The edges of a prism: an outline in x and y, from z = 0 to a depth."""
        for (x, y), (u, v) in zip(outline, outline[1:] + outline[:1]):
            self.edge((x, y, 0.0), (u, v, 0.0))
            self.edge((x, y, depth), (u, v, depth))
            self.edge((x, y, 0.0), (x, y, depth))

    def bore(self, start: Point, along: int, depth: float, radius: float) -> None:
        """A hole through a wall: its rims and its axis; along : axis of the frame that it runs along."""
        axis = tuple(float(k == along) for k in range(3))
        end = tuple(start[k] + depth * axis[k] for k in range(3))
        self.circle(start, axis, radius)
        self.circle(end, axis, radius)
        self.axis(start, end)
        beyond = 1.0  # cut through both faces
        base = tuple(start[k] - beyond * axis[k] for k in range(3))
        self.cut.append(('cylinder', base, tuple((depth + 2.0 * beyond) * a for a in axis), radius))

    def feature_set(self) -> FeatureSet:
        """The features, metres."""
        kind, start, end, radius = zip(*self.features)
        kinds = np.array(kind, np.uint8)
        radii = np.repeat(MM * np.array(radius)[:, None], 2, axis=1)
        none = np.zeros(len(kinds))
        return FeatureSet(kinds, MM * np.array(start), MM * np.array(end), radii, none, none)

    def solid(self) -> Solid:
        """The same part as a tree of solids, metres."""
        made = _united(self.added)
        for one in self.cut:
            made = made - _united([one])
        return made


def _united(pieces: list[tuple[str, Point, Point, float]]) -> Solid:
    """The union of pieces."""
    solid = None
    for what, place, size, radius in pieces:
        one = (
            Solid.block(*(MM * v for v in size))
            if what == 'block'
            else Solid.cylinder(MM * radius, MM * np.array(size))
        )
        matrix = np.eye(4)
        matrix[:3, 3] = MM * np.array(place)
        one = one.transformed(matrix)
        solid = one if solid is None else solid | one
    assert solid is not None
    return solid


def bracket(rng: np.random.Generator, name: str) -> Part:
    """An angle, or a channel, with bores in its base and its wall."""
    part = Part(name)
    w, h, d = rng.uniform(40, 140), rng.uniform(30, 110), rng.uniform(25, 80)
    t, s = rng.uniform(4, 14), rng.uniform(4, 14)
    outline = [(0.0, 0.0), (w, 0.0), (w, t), (s, t), (s, h), (0.0, h)]
    part.added = [('block', (0.0, 0.0, 0.0), (w, t, d), np.nan), ('block', (0.0, 0.0, 0.0), (s, h, d), np.nan)]
    if rng.random() < 0.4:
        second, high = rng.uniform(4, 14), rng.uniform(0.4, 1.0) * h
        outline[1:3] = [(w, 0.0), (w, max(high, t + 6.0)), (w - second, max(high, t + 6.0)), (w - second, t)]
        part.added.append(('block', (w - second, 0.0, 0.0), (second, max(high, t + 6.0), d), np.nan))
        w = w - second
    part.prism(outline, d)
    for x in _places(rng, s + 2.0, w - 2.0, int(rng.integers(1, 4))):
        part.bore((x[0], 0.0, rng.uniform(0.35, 0.65) * d), 1, t, min(x[1], 0.3 * d) * rng.uniform(0.4, 0.95))
    for y in _places(rng, t + 2.0, h - 2.0, int(rng.integers(0, 3))):
        part.bore((0.0, y[0], rng.uniform(0.35, 0.65) * d), 0, s, min(y[1], 0.3 * d) * rng.uniform(0.4, 0.95))
    return part


def flange(rng: np.random.Generator, name: str) -> Part:
    """A disc with a hub, a bore, a ring of holes, and a pin hole that tells how it is turned."""
    part = Part(name)
    big, thick = rng.uniform(30, 90), rng.uniform(6, 20)
    hub, high = rng.uniform(0.35, 0.55) * big, thick + rng.uniform(8, 50)
    bore = rng.uniform(0.4, 0.85) * hub
    z: Point = (0.0, 0.0, 1.0)
    for height, radius in ((0.0, big), (0.0, bore), (thick, big), (thick, hub), (high, hub), (high, bore)):
        part.circle((0.0, 0.0, height), z, radius)
    for low, top in ((0.0, thick), (thick, high), (0.0, high)):
        part.axis((0.0, 0.0, low), (0.0, 0.0, top))
    part.added = [
        ('cylinder', (0.0, 0.0, 0.0), (0.0, 0.0, thick), big),
        ('cylinder', (0.0, 0.0, 0.0), (0.0, 0.0, high), hub),
    ]
    part.cut = [('cylinder', (0.0, 0.0, -1.0), (0.0, 0.0, high + 2.0), bore)]
    holes = int(rng.integers(3, 7))
    room = 0.5 * (big - hub)
    ring, radius = hub + room * rng.uniform(0.9, 1.1), room * rng.uniform(0.25, 0.6)
    for k in range(holes):
        angle = 2.0 * np.pi * k / holes
        part.bore((ring * np.cos(angle), ring * np.sin(angle), 0.0), 2, thick, radius)
    angle = np.pi / holes
    part.bore(
        (ring * np.cos(angle), ring * np.sin(angle), 0.0), 2, thick, min(radius, 0.5) * rng.uniform(0.5, 1.0) + 1.0
    )
    return part


def shaft(rng: np.random.Generator, name: str) -> Part:
    """Three to five steps about one axis, and a keyway in the thickest."""
    part = Part(name)
    count = int(rng.integers(3, 6))
    radii = rng.uniform(6, 32, count)
    while np.abs(np.diff(radii)).min() < 1.5:  # a step is one that can be seen
        radii = rng.uniform(6, 32, count)
    lengths = rng.uniform(12, 55, count)
    places = np.concatenate([[0.0], np.cumsum(lengths)])
    z: Point = (0.0, 0.0, 1.0)
    for k in range(count):
        low, high, radius = float(places[k]), float(places[k + 1]), float(radii[k])
        part.circle((0.0, 0.0, low), z, radius)
        part.circle((0.0, 0.0, high), z, radius)
        part.axis((0.0, 0.0, low), (0.0, 0.0, high))
        part.added.append(('cylinder', (0.0, 0.0, low), (0.0, 0.0, high - low), radius))
    thick = int(np.argmax(radii))
    radius = float(radii[thick])
    half, deep = rng.uniform(0.12, 0.3) * radius, radius * rng.uniform(0.55, 0.8)
    low = float(places[thick] + lengths[thick] * rng.uniform(0.08, 0.3))
    high = float(places[thick + 1] - lengths[thick] * rng.uniform(0.08, 0.3))
    top = float(np.sqrt(radius * radius - half * half))
    for side in (-half, half):
        part.edge((side, deep, low), (side, deep, high))
        part.edge((side, top, low), (side, top, high))
    for end in (low, high):
        part.edge((-half, deep, end), (half, deep, end))
        part.circle((0.0, 0.0, end), z, radius)
        for side in (-half, half):
            part.edge((side, deep, end), (side, top, end))
    part.cut = [('block', (-half, deep, low), (2.0 * half, radius, high - low), np.nan)]
    return part


def housing(rng: np.random.Generator, name: str) -> Part:
    """A box with a pocket, a step along its edge, and bores through floor and walls."""
    part = Part(name)
    w, h, d = rng.uniform(50, 150), rng.uniform(30, 90), rng.uniform(50, 130)
    wall = rng.uniform(5, 12)
    step, low = w + rng.uniform(8, 40), rng.uniform(0.2, 0.7) * h
    part.prism([(0.0, 0.0), (step, 0.0), (step, low), (w, low), (w, h), (0.0, h)], d)
    part.added = [('block', (0.0, 0.0, 0.0), (w, h, d), np.nan), ('block', (0.0, 0.0, 0.0), (step, low, d), np.nan)]
    floor = rng.uniform(5, 12)
    x0, x1, z0, z1 = wall, w - wall, wall, d - wall
    corners = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
    for (x, z), (u, v) in zip(corners, corners[1:] + corners[:1]):
        part.edge((x, h, z), (u, h, v))
        part.edge((x, floor, z), (u, floor, v))
        part.edge((x, floor, z), (x, h, z))
    part.cut = [('block', (x0, floor, z0), (x1 - x0, h, z1 - z0), np.nan)]
    for x in _places(rng, x0 + 2.0, x1 - 2.0, int(rng.integers(1, 4))):
        reach = 0.3 * (z1 - z0)
        part.bore((x[0], 0.0, rng.uniform(0.35, 0.65) * d), 1, floor, min(x[1], reach) * rng.uniform(0.4, 0.95))
    if rng.random() < 0.7:
        middle = 0.5 * (floor + h)
        part.bore((rng.uniform(0.4, 0.6) * w, middle, 0.0), 2, wall, 0.3 * (h - floor) * rng.uniform(0.4, 0.95))
    return part


def _places(rng: np.random.Generator, low: float, high: float, count: int) -> list[tuple[float, float]]:
    """Places on a line with the room about each, none near another."""
    span = (high - low) / max(count, 1)
    return [] if span < 6.0 else [(low + (k + rng.uniform(0.4, 0.6)) * span, 0.35 * span) for k in range(count)]


MAKERS: dict[str, Callable[[np.random.Generator, str], Part]] = {
    'bracket': bracket,
    'flange': flange,
    'shaft': shaft,
    'housing': housing,
}


def part(number: int, seed: int = 0) -> Part:
    """The part of a number; families take turns."""
    family = FAMILIES[number % len(FAMILIES)]
    return MAKERS[family](np.random.default_rng([seed, number]), f'{family}_{number:06d}')


def parts(count: int, seed: int = 0, first: int = 0) -> Iterator[tuple[str, FeatureSet]]:
    """Names and features of so many parts."""
    for number in range(first, first + count):
        made = part(number, seed)
        yield made.name, made.feature_set()
