"""Where samples of a pixel may differ: edges and outlines of primitives in the image, held against what rays meet."""

import numpy as np
import pytest

from csg_renderer import Scene, Solid, render
from csg_renderer.raycast.kernels.differences import corner
from csg_renderer.raycast.programs.program import BLOCK, CONE, CYLINDER, SPHERE
from csg_renderer.raycast.raw_view import box_samples
from csg_renderer.raycast.tiling import edge_lines, silhouette
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(200, 160, 260.0)


def lines_of(kind, matrix):
    """(p, 6): the lines of one primitive, camera from unit frame."""
    origin = np.linalg.inv(matrix)[:3, 3]
    bounds, start = np.empty((1, 4)), np.empty(2, dtype=np.int64)
    frame = np.ascontiguousarray(matrix[None, :3])
    camera = CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy
    return edge_lines(np.array([kind]), frame, origin[None], 1e-6, *camera, bounds, start), bounds[0], start


def affine(seed):
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ np.diag(random.uniform(0.03, 0.1, 3))
    matrix[:3, 3] = random.uniform([-0.05, -0.05, 0.5], [0.05, 0.05, 0.7])
    return matrix


def test_a_block_has_its_twelve_edges_with_the_depths_of_their_ends():
    matrix = affine(0)
    lines, bounds, start = lines_of(BLOCK, matrix)
    ends = lines.reshape(-1, 2, 3)
    places = np.concatenate([(ends[..., :2] - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones((12, 2, 1))], axis=2)
    unit = (places / ends[..., 2:] - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    assert start.tolist() == [0, 12]
    assert np.allclose(unit, np.rint(unit), atol=1e-9)
    assert np.allclose(np.abs(unit[:, 0] - unit[:, 1]).sum(axis=1), 1.0)
    assert np.allclose(bounds[[0, 2]], ends[..., :2].min(axis=(0, 1)))


@pytest.mark.parametrize('seed', range(5))
def test_rays_to_the_outline_of_a_ball_touch_it(seed):
    matrix = affine(seed)
    inverse = np.linalg.inv(matrix)
    points = silhouette(SPHERE, np.ascontiguousarray(matrix[:3]), inverse[:3, 3], 24)
    unit = points @ inverse[:3, :3].T + inverse[:3, 3]
    assert np.allclose(np.linalg.norm(unit, axis=1), 1.0)
    # On the sphere, the way there is across the normal.
    assert np.allclose(((unit - inverse[:3, 3]) * unit).sum(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ('kind', 'name'), [(BLOCK, 'BLOCK'), (CYLINDER, 'CYLINDER'), (CONE, 'CONE'), (SPHERE, 'SPHERE')]
)
@pytest.mark.parametrize('seed', range(3))
def test_what_is_seen_ends_at_the_lines(kind, name, seed):
    matrix = affine(seed)
    seen = render(Scene(Solid.primitive(name, matrix)), CAMERA, Pose()).mask
    lines, bounds, _ = lines_of(kind, matrix)
    v, u = np.nonzero(seen)
    assert bounds[0] - 0.1 <= u.min() <= bounds[0] + 2.0
    assert bounds[1] - 2.0 <= u.max() <= bounds[1] + 0.1
    border = seen & ~(np.roll(seen, 1, 0) & np.roll(seen, -1, 0) & np.roll(seen, 1, 1) & np.roll(seen, -1, 1))
    pixels = np.argwhere(border)[:, ::-1].astype(float)
    a, way = lines[:, :2], lines[:, 3:5] - lines[:, :2]
    along = ((pixels[:, None] - a) * way).sum(axis=2) / np.maximum((way**2).sum(axis=1), 1e-12)
    off = pixels[:, None] - a - np.clip(along, 0.0, 1.0)[..., None] * way
    assert np.linalg.norm(off, axis=2).min(axis=1).max() < 1.0


def test_corners_lie_about_the_samples():
    for n in (2, 4, 16):
        assert corner(n, False) == pytest.approx(box_samples(n)[:, :2].max())
        assert corner(n, False) <= corner(n, True) < 0.5
