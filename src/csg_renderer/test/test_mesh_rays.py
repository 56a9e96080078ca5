"""Rays among triangles: the same as by looking at every one of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer.mesh.rays import blocked, nearest_hit, nearest_hits, triangle_tree


def by_hand(corners, origin, ray):
    """Where a ray meets triangles (m, 3, 3), (k,), ascending."""
    found = []
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        slope = normal @ ray
        if slope == 0.0:
            continue
        t = normal @ (a - origin) / slope
        p = origin + t * ray
        inside = [normal @ np.cross(two - one, p - one) for one, two in ((a, b), (b, c), (c, a))]
        if t > 0.0 and min(inside) >= 0.0:
            found.append(t)
    return sorted(found)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.05, 0.5, 3.0]))
def test_the_nearest_of_random_triangles(seed, count, extent):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) + extent * rng.normal(size=(count, 3, 3))
    tree, origin = triangle_tree(corners), np.array([0.0, 0.0, -6.0])
    rays = rng.normal(size=(20, 3)) * [0.2, 0.2, 0.0] + [0.0, 0.0, 1.0]
    rays[0] = 0.0, 0.0, 1.0
    distance, triangle = nearest_hits(tree, origin, rays)
    for ray, t, row in zip(rays, distance, triangle):
        every = by_hand(corners, origin, ray)
        assert (row >= 0) == bool(every)
        if every:
            assert t == pytest.approx(every[0])
            assert by_hand(corners[[row]], origin, ray) == pytest.approx([t])
            assert blocked(tree, *origin, *ray, 1.001 * t)
            assert not blocked(tree, *origin, *ray, 0.999 * t)
        else:
            assert not blocked(tree, *origin, *ray, 1e9)


def test_every_triangle_stands_in_one_leaf_and_every_box_holds_those_below():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(500, 1, 3)) + 0.1 * rng.normal(size=(500, 3, 3))
    tree = triangle_tree(corners)
    assert sorted(tree.source.tolist()) == list(range(500))
    leaves = tree.span[tree.span[:, 0] >= 0]
    assert np.concatenate([np.arange(a, b) for a, b in leaves]).tolist() == list(range(500))
    for node in range(len(tree.skip)):
        below = tree.span[node : tree.skip[node]]
        rows = slice(below[below >= 0].min(), below.max())
        points = corners[tree.source[rows]].reshape(-1, 3)
        np.testing.assert_array_equal(tree.box[node], [*points.min(axis=0), *points.max(axis=0)])


def test_triangles_on_one_spot_are_a_tree():
    tree = triangle_tree(np.repeat(np.eye(3)[None], 50, axis=0))
    assert nearest_hit(tree, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0)[0] == pytest.approx(1.0 / 3.0)
    assert nearest_hit(tree, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0)[1] == -1


def test_no_ray_slips_through_between_two_triangles():
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(1)
    flat = np.concatenate([rng.uniform(-1, 1, (200, 2)), [[-1, -1], [-1, 1], [1, -1], [1, 1]]])
    points = np.column_stack([flat, np.full(len(flat), 2.0)])
    tree = triangle_tree(points[Delaunay(flat).simplices])
    through = points[rng.integers(0, len(points), (2, 400))]
    rays = through[0] + rng.uniform(0, 1, (400, 1)) * (through[1] - through[0])
    np.testing.assert_allclose(nearest_hits(tree, np.zeros(3), 0.999 * rays)[0], 1.0 / 0.999)
