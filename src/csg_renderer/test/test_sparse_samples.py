"""Samples only where they can differ: the picture is that of all samples, to half a grey level and its rounding."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, Terrain, render
from csg_renderer.raycast.raw_view import box_samples
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(72, 60, 110.0)


def placed(random, kind, size, low, high):
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ np.diag(size)
    matrix[:3, 3] = random.uniform(low, high)
    return Solid.primitive(kind, matrix)


def needles(seed):
    """Primitives of all shapes, as thin as a hundredth of a pixel, also over the borders of the picture."""
    random = np.random.default_rng(seed)
    parts = []
    for _ in range(25):
        kind = random.choice(['BLOCK', 'CYLINDER', 'CONE', 'SPHERE'])
        part = placed(random, kind, 0.5 * 10.0 ** random.uniform(-4.5, -1, 3), [-0.13, -0.12, 0.35], [0.13, 0.12, 0.5])
        parts.append(part.painted(Surface(random.uniform(0.3, 1.0, 3), ambient=1.0, diffuse=0.0)))
    if seed % 2:
        wall = Solid.block(1, 1, 0.1).transformed(Pose(np.eye(3), [-0.5, -0.5, 0.5]))
        parts.append(wall.painted(Surface((0.1, 0.1, 0.1), ambient=1.0, diffuse=0.0)))
    return Scene(parts, ambient_light=(1, 1, 1))


def carved(seed):
    """Solids with others taken away, with highlights and edges of light."""
    random = np.random.default_rng(seed)
    parts = []
    for _ in range(4):
        one, other, third = (
            placed(random, kind, random.uniform(0.02, 0.08, 3), [-0.05, -0.05, 0.35], [0.05, 0.05, 0.45])
            for kind in random.choice(['BLOCK', 'CYLINDER', 'CONE', 'SPHERE'], 3)
        )
        shine = Surface(random.uniform(0.3, 1.0, 3), specular=0.5, shininess=float(random.integers(5, 60)))
        parts.append(((one - other) | (one & third)).painted(shine))
    return Scene(parts, [Light((0.3, -0.3, 0.0)), Light((-0.2, 0.0, -0.1), (0.5, 0.4, 0.3))])


@pytest.mark.parametrize('build', [needles, carved])
@pytest.mark.parametrize('seed', range(5))
def test_no_pixel_is_off_by_more_than_rounding(build, seed):
    scene = build(seed)
    sparse, full, one = (render(scene, CAMERA, antialias=n, every_pixel=every) for n, every in ((4, 0), (4, 1), (0, 0)))
    difference = np.abs(sparse.image.astype(int) - full.image).max(axis=2)
    assert difference.max() <= 1 and (difference > 0).mean() < 0.02
    assert (np.abs(one.image.astype(int) - full.image).max(axis=2) > 1).mean() > 0.01
    for name in ('depth', 'primitive_id', 'face_id', 'normal'):
        assert np.array_equal(getattr(sparse, name), getattr(full, name), equal_nan=name in ('depth', 'normal'))


def test_most_of_the_work_is_saved_where_edges_are_few():
    ball = Solid.sphere(0.03).transformed(Pose(np.eye(3), [-0.04, 0, 0.4]))
    block = Solid.block(0.05, 0.05, 0.05).transformed(Pose.from_rotation_vector([0.5, 0.4, 0.3], [0.01, 0, 0.4]))
    scene, camera = Scene([ball, block], [Light((0.3, -0.3, 0.0))]), PinholeCamera.centred(256, 256, 700.0)
    sparse, full = (render(scene, camera, antialias=4, every_pixel=every) for every in (False, True))
    assert np.abs(sparse.image.astype(int) - full.image).max() <= 1
    assert 3 * sparse.stats.intersections < full.stats.intersections


@pytest.mark.parametrize('options', [{'shadows': True}, {'levels': 2}, {'tiling': False}, {'radiance': True}, {}])
def test_what_is_not_certain_takes_all_samples(options):
    parts = [Solid.sphere(0.03).transformed(Pose(np.eye(3), [0, 0, 0.4]))]
    if not options:
        sheet = Terrain(np.zeros((3, 3)), (0.02, 0.02))
        parts.append(sheet.transformed(Pose.from_rotation_vector([1.0, 0, 0], [0, 0, 0.4])))
    scene = Scene(parts, [Light((0.3, -0.3, 0.0))])
    sparse, full = (render(scene, CAMERA, antialias=2, every_pixel=every, **options) for every in (False, True))
    assert np.array_equal(sparse.image, full.image)
    assert sparse.stats.intersections == full.stats.intersections


def test_samples_are_all_in_columns_and_rows_of_their_own():
    for n in (1, 2, 3, 6, 16):
        right, below, weight = box_samples(n).T
        even = (np.arange(n * n) + 0.5) / (n * n) - 0.5
        np.testing.assert_allclose(np.sort(right), even, atol=1e-12)
        np.testing.assert_allclose(np.sort(below), even, atol=1e-12)
        assert weight.sum() == pytest.approx(1.0)
