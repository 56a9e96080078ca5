"""Curves and axes of curved solids straight from the tree: closed forms (thesis 6.3, DESIGN's AXIS rule)."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import Solid, boundary, model_features
from msgs_py import FeatureKind, Pose

CYLINDER = Solid.cylinder(1.0, (0, 0, 2))
PLATE = Solid.block(4, 4, 1).transformed(Pose(np.eye(3), [-2, -2, 0]))


def at(solid: Solid, x: float, y: float, z: float) -> Solid:
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def test_cylinder():
    found = model_features(CYLINDER)
    assert found.kind.tolist() == [FeatureKind.CURVE] * 2 + [FeatureKind.AXIS]
    np.testing.assert_allclose(found.start[:2], [[0, 0, 0], [0, 0, 2]], atol=1e-9)
    np.testing.assert_allclose(found.directions[:2], [[0, 0, -1], [0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(found.radii[:2], 1.0, atol=1e-9)
    np.testing.assert_allclose(sorted([found.start[2, 2], found.end[2, 2]]), [0, 2], atol=1e-9)


# Counts of edges, curves and axes.
SOLIDS = {
    'sphere': (Solid.sphere(1.0), 0, 0, 0),
    'cone': (Solid.cone(1, (0, 0, 2)), 0, 1, 1),
    'truncated cone': (Solid.cone(1, (0, 0, 2)) - at(Solid.block(4, 4, 1), -2, -2, 0), 0, 2, 1),
    'tube: one axis for both walls': (CYLINDER - Solid.cylinder(0.5, (0, 0, 2)), 0, 4, 1),
    'equal cylinders end to end': (CYLINDER | at(CYLINDER, 0, 0, 2), 0, 2, 1),
    'a thinner cylinder on top': (CYLINDER | at(Solid.cylinder(0.5, (0, 0, 1)), 0, 0, 2), 0, 4, 2),
    'half cylinder': (CYLINDER & Solid.plane((1, 0, 0), 0.0), 4, 2, 1),
    'cylinder with a dome: the join is smooth': (CYLINDER | at(Solid.sphere(1), 0, 0, 2), 0, 1, 1),
    'cylinder cut at a slant': (CYLINDER & Solid.plane((0.3, 0, 1), 1.5), 0, 2, 1),
    'plate with a hole': (PLATE - at(CYLINDER, 0, 0, -0.5), 12, 2, 1),
    'plate with a boss': (PLATE | at(CYLINDER, 0, 0, 0.5), 12, 2, 1),
    'plate with a blind hole': (PLATE - at(CYLINDER, 0, 0, 0.5), 12, 2, 1),
    'buried cylinder': (PLATE | at(Solid.cylinder(0.2, (0, 0, 0.5)), 0, 0, 0.2), 12, 0, 0),
    'block with a round end: tangent planes': (
        at(Solid.block(4, 2, 2), 0, -1, -1) | at(Solid.cylinder(1, (0, 2, 0)), 0, -1, 0),
        8,
        2,
        1,
    ),
    'equal cylinders crossing: four half ellipses': (
        at(Solid.cylinder(1, (0, 0, 4)), 0, 0, -2) | at(Solid.cylinder(1, (4, 0, 0)), -2, 0, 0),
        0,
        8,
        2,
    ),
    'parallel cylinders overlapping': (CYLINDER | at(CYLINDER, 1, 0, 0), 2, 4, 2),
    'two spheres': (Solid.sphere(1) | at(Solid.sphere(1), 1, 0, 0), 0, 1, 0),
    'spheres touching in a point': (Solid.sphere(1) | at(Solid.sphere(1), 2, 0, 0), 0, 0, 0),
    'sphere on a coaxial cylinder': (CYLINDER | at(Solid.sphere(1.5), 0, 0, 3), 0, 2, 1),
    'cone base to base': (Solid.cone(1, (0, 0, 1)) | at(Solid.cone(1, (0, 0, -1)), 0, 0, 2), 0, 1, 0),
    'nothing left': (CYLINDER - at(Solid.block(4, 4, 4), -2, -2, -1), 0, 0, 0),
    'cut through the apex': (Solid.cone(1, (0, 0, 2)) & Solid.plane((1, 0, 0), 0.0), 3, 1, 1),
}


@pytest.mark.parametrize('name', SOLIDS)
def test_counts(name):
    solid, edges, curves, axes = SOLIDS[name]
    kind = model_features(solid).kind
    assert [(kind == k).sum() for k in FeatureKind] == [edges, curves, axes]


@pytest.mark.parametrize(
    'name',
    [
        'tube: one axis for both walls',
        'half cylinder',
        'cylinder cut at a slant',
        'block with a round end: tangent planes',
        'cut through the apex',
    ],
)
def test_counts_survive_any_affine_placement(name):
    solid, edges, curves, axes = SOLIDS[name]
    rng = np.random.default_rng(5)
    for _ in range(3):
        matrix = np.eye(4)
        matrix[:3] = np.concatenate([0.1 * np.eye(3) + 0.03 * rng.normal(size=(3, 3)), rng.normal(size=(3, 1))], axis=1)
        kind = model_features(solid.transformed(matrix)).kind
        assert [(kind == k).sum() for k in FeatureKind] == [edges, curves, axes]


def test_ellipse_of_a_slanted_cut():
    found = model_features(SOLIDS['cylinder cut at a slant'][0])
    oblique = found.select(found.radii[:, 0] > 1.0 + 1e-6)
    assert len(oblique) == 1
    np.testing.assert_allclose(oblique.radii, [[np.hypot(1, 0.3), 1.0]], atol=1e-9)
    np.testing.assert_allclose(oblique.start, [[0, 0, 1.5]], atol=1e-9)
    np.testing.assert_allclose(oblique.directions, [np.array([0.3, 0, 1]) / np.hypot(0.3, 1)], atol=1e-9)
    np.testing.assert_allclose(np.abs(oblique.major_axis), [np.array([1, 0, 0.3]) / np.hypot(0.3, 1)], atol=1e-9)


def test_normals_point_out_of_the_planar_face():
    found = model_features(SOLIDS['plate with a blind hole'][0]).of_kind(FeatureKind.CURVE)
    order = np.argsort(found.start[:, 2])
    np.testing.assert_allclose(found.start[order], [[0, 0, 0.5], [0, 0, 1]], atol=1e-9)
    # Rim and floor of the hole both look up.
    np.testing.assert_allclose(found.directions, [[0, 0, 1], [0, 0, 1]], atol=1e-9)


def test_axis_of_a_boss_starts_on_the_plate():
    found = model_features(SOLIDS['plate with a boss'][0]).of_kind(FeatureKind.AXIS)
    np.testing.assert_allclose(sorted([found.start[0, 2], found.end[0, 2]]), [1, 2.5], atol=1e-9)


def test_arcs_lie_where_they_say():
    half = model_features(SOLIDS['half cylinder'][0]).of_kind(FeatureKind.CURVE)
    for row in range(2):
        points = half.polyline(row, 33)
        np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 1.0, atol=1e-9)
        assert points[:, 0].max() < 1e-9
        np.testing.assert_allclose(half.arc[row, 1], np.pi, atol=1e-9)


def test_creases_in_no_plane_are_reported_and_not_faked():
    pipe = at(Solid.cylinder(1.0, (0, 0, 4)), 0, 0, -2)
    found = boundary(pipe | Solid.cylinder(0.5, (3, 0, 0)))
    assert [(found.features.kind == k).sum() for k in FeatureKind] == [0, 3, 2]
    assert len(found.space_curves) == 1 and any('no plane' in notice for notice in found.notices)
    x, y, z = found.space_curves[0].T
    np.testing.assert_allclose(np.hypot(x, y), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(y, z), 0.5, atol=1e-9)
    assert (x > 0).all() and np.ptp(np.arctan2(z, y)) > 6.0


def test_two_ellipsoids_meet_in_a_space_curve_on_both():
    one, two = np.diag([1.0, 0.8, 0.6, 1.0]), np.diag([0.5, 0.9, 0.9, 1.0])
    two[:3, 3] = 0.5, 0.1, 0.2
    found = boundary(Solid.primitive('SPHERE', one) | Solid.primitive('SPHERE', two))
    assert found.space_curves and not len(found.features)
    for points in found.space_curves:
        for matrix in (one, two):
            local = (points - matrix[:3, 3]) / np.diag(matrix)[:3]
            np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1.0, atol=1e-7)


def test_parabolas_and_hyperbolas_are_reported():
    cone = Solid.cone(1, (0, 0, 1))
    for cut in (Solid.plane((1, 0, 1), 1.2), Solid.plane((1, 0, 0), 0.3)):
        found = boundary(cone & cut)
        assert (~found.ellipse).sum() == 1
        assert any('parabola or hyperbola' in notice for notice in found.notices)
        assert [(found.features.kind == k).sum() for k in FeatureKind] == [1, 1, 1]
