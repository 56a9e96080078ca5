"""Faces, angles, boxes and volumes of solids: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import Solid, boundary
from msgs_py import Pose

PI = np.pi


def at(solid: Solid, x: float, y: float, z: float) -> Solid:
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


PLATE = at(Solid.block(4, 4, 1), -2, -2, 0)
CYLINDER = Solid.cylinder(1.0, (0, 0, 2))
CROSS = at(Solid.cylinder(1, (0, 0, 4)), 0, 0, -2), at(Solid.cylinder(1, (4, 0, 0)), -2, 0, 0)
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])

# Faces, vertices, area, volume.
SOLIDS = {
    'block': (Solid.block(1, 2, 3), 6, 8, 22, 6),
    'l-shape': (Solid.block(3, 1, 1) | Solid.block(1, 3, 1), 8, 12, 22, 5),
    'corner cut off': (
        Solid.block(1, 1, 1) & Solid.plane((1, 1, 1), 2.5),
        7,
        10,
        6 - 3 / 8 + np.sqrt(3) / 8,
        1 - 1 / 48,
    ),
    'square hole': (Solid.block(3, 3, 3) - at(Solid.block(1, 1, 5), 1, 1, -1), 10, 16, 64, 24),
    'hollow': (Solid.block(3, 3, 3) - at(Solid.block(1, 1, 1), 1, 1, 1), 12, 16, 60, 26),
    'a groove splits a face in two': (Solid.block(3, 3, 1) - at(Solid.block(1, 5, 0.5), 1, -1, 0.5), 10, 16, 32, 7.5),
    'two apart': (Solid.block(1, 1, 1) | at(Solid.block(1, 1, 1), 3, 0, 0), 12, 16, 12, 2),
    'two that share an edge': (Solid.block(1, 1, 1) | at(Solid.block(1, 1, 1), 1, 1, 0), 12, 14, 12, 2),
    'cylinder': (CYLINDER, 3, 0, 6 * PI, 2 * PI),
    'cone': (Solid.cone(1, (0, 0, 2)), 2, 1, PI + PI * np.sqrt(5), 2 * PI / 3),
    'sphere': (Solid.sphere(2), 1, 0, 16 * PI, 32 * PI / 3),
    'half sphere': (Solid.sphere(1) & Solid.plane((0, 0.3, 1), 0), 2, 0, 3 * PI, 2 * PI / 3),
    'lens': (Solid.sphere(1) & at(Solid.sphere(1), 1, 0, 0), 2, 0, 2 * PI, 5 * PI / 12),
    'tube': (CYLINDER - Solid.cylinder(0.5, (0, 0, 2)), 4, 0, 7.5 * PI, 1.5 * PI),
    'plate with a hole': (PLATE - at(CYLINDER, 0, 0, -0.5), 7, 8, 48, 16 - PI),
    'crossing cylinders': (CROSS[0] & CROSS[1], 4, 2, 16, 16 / 3),
    'mirrored cylinder': (CYLINDER.transformed(MIRROR), 3, 0, 6 * PI, 2 * PI),
}


@pytest.mark.parametrize('name', SOLIDS)
def test_faces_vertices_area_and_volume(name):
    solid, faces, vertices, area, volume = SOLIDS[name]
    found = boundary(solid).details
    assert len(found.faces) == faces
    assert len(found.vertices) == vertices
    np.testing.assert_allclose(found.area, area, rtol=1e-9)
    np.testing.assert_allclose(found.volume, volume, rtol=1e-9)


def test_two_faces_of_every_edge_and_the_angle_between_them():
    found = boundary(SOLIDS['l-shape'][0])
    faces = found.details.faces
    directions = found.features.directions
    for k, (one, two) in enumerate(found.details.edge_faces):
        for face in (faces[one], faces[two]):
            np.testing.assert_allclose(face.normal @ directions[k], 0, atol=1e-12)
        assert one != two
    angles = np.degrees(found.details.edge_angles)
    # All edges of the L are square, and the one in its inner corner is concave.
    assert (np.abs(angles - 90) < 1e-9).sum() == 17
    assert (np.abs(angles - 270) < 1e-9).sum() == 1


def test_angle_of_a_curve():
    np.testing.assert_allclose(boundary(Solid.cone(1, (0, 0, 2))).details.curve_angles, np.arctan(2), atol=1e-9)
    boss = boundary(PLATE | at(CYLINDER, 0, 0, 0.5))
    np.testing.assert_allclose(np.sort(boss.details.curve_angles), [PI / 2, 3 * PI / 2], atol=1e-9)


def test_an_edge_that_more_than_two_faces_share_says_so():
    found = boundary(SOLIDS['two that share an edge'][0])
    assert np.isnan(found.details.edge_angles).sum() == 1
    assert any('only touch' in notice for notice in found.notices)


@pytest.mark.parametrize(
    ('solid', 'low', 'high'),
    [
        (Solid.sphere(2), [-2, -2, -2], [2, 2, 2]),
        (Solid.primitive('SPHERE', np.diag([1, 2, 3, 1.0])) & Solid.plane((0, 0, 1), 0), [-1, -2, -3], [1, 2, 0]),
        (at(Solid.cone(1, (0, 0, 2)), 1, 1, 1), [0, 0, 1], [2, 2, 3]),
        (CYLINDER & Solid.plane((1, 0, 0), 0.5), [-1, -1, 0], [0.5, 1, 2]),
    ],
)
def test_bounding_box(solid, low, high):
    found = boundary(solid).details
    np.testing.assert_allclose(found.low, low, atol=1e-9)
    np.testing.assert_allclose(found.high, high, atol=1e-9)


def test_volume_is_a_measure():
    """What two solids share is counted twice by their sum, whatever curves they meet in."""
    rng = np.random.default_rng(4)
    kinds = ('BLOCK', 'CYLINDER', 'CONE', 'SPHERE')
    for k, kind in enumerate(kinds):
        for other in kinds[max(k, 1) :]:
            one, two = (Solid.primitive(k, matrix(rng)) for k in (kind, other))
            a, b, both, either, only = (boundary(s).details.volume for s in (one, two, one & two, one | two, one - two))
            np.testing.assert_allclose(either + both, a + b, rtol=1e-6)
            np.testing.assert_allclose(only, a - both, rtol=1e-6)


def matrix(rng: np.random.Generator) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 1.0, 3)
    out[:3, 3] = rng.uniform(-0.3, 0.3, 3)
    return out


def test_nothing_has_no_faces_and_gives_its_reason():
    found = boundary(Solid.empty())
    assert not found.details.faces and found.details.volume == 0.0
    assert found.notices
    assert boundary(Solid.block(1, 1, 1) - Solid.block(2, 2, 2)).notices


def test_an_unbounded_solid_says_so():
    found = boundary(Solid.plane((0, 0, 1), 0.0) - Solid.block(1, 1, -1))
    assert any('not bounded' in notice for notice in found.notices)
