"""Random models of kinds that the matcher was not developed with: symmetric, flat, round, few-edged, irregular."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from model_matcher.closed_form.synthetic.scenes import box, prism
from msgs_py import FeatureSet

Shape = Callable[[np.random.Generator], FeatureSet]


def _around(count: int, radius: float) -> np.ndarray:
    angle = np.arange(count) / count * 2.0 * np.pi
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def hex_nut(rng: np.random.Generator) -> FeatureSet:
    radius, height = rng.uniform(0.03, 0.06), rng.uniform(0.02, 0.05)
    hole = FeatureSet.from_curves([[0, 0, 0], [0, 0, -height]], [[0, 0, 1], [0, 0, 1]], [0.5 * radius] * 2)
    return FeatureSet.concatenate([prism(_around(6, radius), height), hole])


def cube(rng: np.random.Generator) -> FeatureSet:
    return box([rng.uniform(0.05, 0.1)] * 3)


def tetrahedron(rng: np.random.Generator) -> FeatureSet:
    points = 0.06 * rng.uniform(0.8, 1.4, (4, 1)) * _directions(rng, 4)
    first, last = np.triu_indices(4, 1)
    return FeatureSet.from_edges(points[first], points[last])


def flat_plate(rng: np.random.Generator) -> FeatureSet:
    """All edges in one plane: a notched outline and a hole."""
    w, h = rng.uniform(0.08, 0.15), rng.uniform(0.05, 0.1)
    outline = np.array([(0, 0), (1, 0), (1, 1), (0.6, 1), (0.6, 0.7), (0.3, 0.7), (0.3, 1), (0, 1)]) * [w, h]
    hole = np.array([(0.15, 0.2), (0.35, 0.2), (0.35, 0.5), (0.15, 0.4)]) * [w, h]
    loops = [np.column_stack([loop, np.zeros(len(loop))]) for loop in (outline, hole)]
    return FeatureSet.from_edges(np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops]))


def circles(rng: np.random.Generator) -> FeatureSet:
    """Curves and no edge."""
    count = int(rng.integers(7, 12))
    return FeatureSet.from_curves(
        rng.uniform(-0.06, 0.06, (count, 3)), _directions(rng, count), rng.uniform(0.008, 0.03, count)
    )


def flange(rng: np.random.Generator) -> FeatureSet:
    """A disc with a ring of holes and a block on it."""
    radius, holes = rng.uniform(0.04, 0.07), int(rng.integers(4, 7))
    ring = np.column_stack([_around(holes, 0.7 * radius), np.full(holes, 0.01)])
    centres = np.concatenate([[[0, 0, 0], [0, 0, 0.01]], ring])
    curves = FeatureSet.from_curves(centres, [[0, 0, 1]] * len(centres), [radius] * 2 + [0.08 * radius] * holes)
    return FeatureSet.concatenate([curves, box((0.03, 0.02, 0.02), (-0.015, -0.01, 0.03))])


def bracket(rng: np.random.Generator) -> FeatureSet:
    """An angle with a hole in each leg."""
    t, (a, b, w) = rng.uniform(0.006, 0.012), rng.uniform(0.05, 0.1, 3)
    holes = FeatureSet.from_curves(
        [[0.6 * a, t, -0.5 * w], [t, 0.6 * b, -0.3 * w]], [[0, 1, 0], [1, 0, 0]], [0.15 * w, 0.1 * w]
    )
    return FeatureSet.concatenate([prism([(0, 0), (a, 0), (a, t), (t, t), (t, b), (0, b)], w), holes])


def three_edges(rng: np.random.Generator) -> FeatureSet:
    points = rng.uniform(-0.06, 0.06, (4, 3))
    return FeatureSet.from_edges(points[:3], points[1:])


def boxes(rng: np.random.Generator) -> FeatureSet:
    """A union of two to four blocks."""
    return FeatureSet.concatenate(
        [box(rng.uniform(0.03, 0.1, 3), rng.uniform(-0.03, 0.05, 3)) for _ in range(int(rng.integers(2, 5)))]
    )


def wires(rng: np.random.Generator) -> FeatureSet:
    """Edges in all directions, none meeting another."""
    count = int(rng.integers(12, 40))
    start = rng.uniform(-0.06, 0.06, (count, 3))
    return FeatureSet.from_edges(start, start + _directions(rng, count) * rng.uniform(0.015, 0.06, (count, 1)))


SHAPES: dict[str, Shape] = {
    shape.__name__: shape
    for shape in (hex_nut, cube, tetrahedron, flat_plate, circles, flange, bracket, three_edges, boxes, wires)
}
