"""Intervals of rays in trees of leaves say what points sampled along the rays say; contours touch their rays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from csg_renderer import Scene, Solid, SolidOutline, render
from csg_renderer.brep.surfaces import compile_surfaces
from csg_renderer.visibility.contours import Quadrics, polar_sections
from csg_renderer.visibility.occlusion import first_hit, hidden
from msgs_py import PinholeCamera, Pose

SAMPLES = 400
KINDS = ('BLOCK', 'CYLINDER', 'CONE', 'SPHERE')


def random_leaf(rng: np.random.Generator, kinds: tuple[str, ...] = KINDS) -> Solid:
    """About the origin; some along the axes, some sheared."""
    matrix = np.eye(4)
    if rng.random() < 0.6:
        matrix[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    matrix[:3, :3] = matrix[:3, :3] * rng.uniform(0.4, 1.0, 3) + (rng.random() < 0.3) * 0.1 * rng.normal(size=(3, 3))
    matrix[:3, 3] = rng.uniform(-0.8, 0.4, 3)
    return Solid.primitive(str(rng.choice(kinds)), matrix)


def random_solid(rng: np.random.Generator, count: int) -> Solid:
    """Up to count leaves."""
    solid = random_leaf(rng)
    for _ in range(int(rng.integers(1, count))):
        other, choice = random_leaf(rng), rng.random()
        solid = solid | other if choice < 0.5 else solid - other if choice < 0.8 else solid & other
    return solid


def material_along(table, viewpoint: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(n, SAMPLES) bool: material at the middles of equal parts of the way to each target."""
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    points = viewpoint + share[:, None] * (targets[:, None] - viewpoint)
    return table.contains(table.normalised(points).reshape(-1, 3)).reshape(len(targets), SAMPLES)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 12))
def test_what_hides_a_point_is_material_on_the_way_to_it(seed, count):
    rng = np.random.default_rng(seed)
    table = compile_surfaces(random_solid(rng, count))
    viewpoint = rng.normal(size=3) * 1.5
    targets = rng.normal(size=(40, 3))
    inside = material_along(table, viewpoint, targets)
    answer = hidden(table, viewpoint, targets)
    assert answer[inside.any(axis=1)].all()
    # Samples miss what is thinner than their distance; what shows through with material of twice that is an error.
    length = np.linalg.norm(targets - viewpoint, axis=1) / table.size
    for k in np.flatnonzero(~inside.any(axis=1)):
        assert not hidden(table, viewpoint, targets[k : k + 1], 2.0 * length[k] / SAMPLES)[0]


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 12))
def test_a_ray_meets_the_solid_where_samples_do(seed, count):
    rng = np.random.default_rng(seed)
    table = compile_surfaces(random_solid(rng, count))
    viewpoint = rng.normal(size=3) * 1.5
    targets = rng.normal(size=(40, 3))
    inside = material_along(table, viewpoint, targets)
    hit = first_hit(table, viewpoint, targets - viewpoint)
    some = inside.any(axis=1)
    assert (hit[some] <= (inside[some].argmax(axis=1) + 0.5) / SAMPLES).all()
    at = viewpoint + hit[:, None] * (targets - viewpoint)
    met = np.isfinite(hit)
    for step, expected in ((1e-5, True), (-1e-5, False)):
        beside = at[met] + step * (targets - viewpoint)[met]
        entered = hit[met] > 1e-4
        same = table.contains(table.normalised(beside)) == expected
        # A ray may only graze an edge: there is no room on either side.
        assert same[entered].mean() > 0.97 if entered.any() else True


def test_more_stretches_than_a_word_has_bits_are_told_apart():
    comb = Solid.block(0.001, 1.0, 1.0)
    for k in range(1, 50):
        comb = comb | Solid.block(0.001, 1.0, 1.0).transformed(Pose(np.eye(3), np.array([0.01 * k, 0.0, 0.0])))
    table = compile_surfaces(comb - Solid.block(0.485, 2.0, 2.0))
    viewpoint = np.array([-1.0, 0.5, 0.5])
    # All but the last plate are cut away: what stands before it is seen, what stands behind it is not.
    targets = np.array([[0.4895, 0.5, 0.5], [0.6, 0.5, 0.5]])
    assert hidden(table, viewpoint, targets).tolist() == [False, True]
    assert first_hit(table, viewpoint, np.array([[1.0, 0.0, 0.0]]))[0] == pytest.approx(1.49)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6))
def test_polar_sections_touch_the_rays_of_their_viewpoint(seed):
    rng = np.random.default_rng(seed)
    table = compile_surfaces(random_leaf(rng, KINDS[1:]) | random_leaf(rng, KINDS[1:]))
    viewpoint = rng.normal(size=3) * 2.0
    most = 2 * len(table.quadrics)
    matrix, quadric = np.empty((most, 4, 3)), np.empty(most, np.int32)
    count = polar_sections(Quadrics.of(table), viewpoint, matrix, quadric)
    for curve, k in zip(matrix[:count], quadric[:count]):
        for t in (-0.4, 0.3, 2.0):
            straight = not curve[:, 1].any()
            at = curve @ ([t, 0.0, 1.0] if straight else [np.cos(t), np.sin(t), 1.0])
            polar = table.quadrics[k] @ at
            assert at[3] == pytest.approx(1.0)
            assert abs(polar @ at) < 1e-9 * (at @ at)
            assert abs(polar @ np.append(viewpoint, 1.0)) < 1e-9 * (at @ at) * (1.0 + viewpoint @ viewpoint)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 10**6))
def test_the_ray_caster_sees_the_surface_where_rays_first_meet_it(seed):
    solid = random_solid(np.random.default_rng(seed), 5)
    camera = PinholeCamera.centred(40, 40, 50.0)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 3.0]))
    depth = render(Scene([solid]), camera, pose).depth
    seen = pose.apply(SolidOutline(solid).surface(pose, camera, camera.pixel_grid().reshape(-1, 2)))[:, 2]
    differ = ~np.isclose(depth.ravel(), seen, rtol=1e-5, equal_nan=True)
    # Rays along an edge may pass it on either side.
    assert differ.mean() < 0.005
