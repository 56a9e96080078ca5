"""What a terrain hides of the features of other objects: by hand, and against every cell tried on every ray."""

import numpy as np
import pytest

from csg_renderer import Scene, Solid, Terrain, ideal_data, visible_features
from csg_renderer.scene.scene import Placement
from csg_renderer.scene.terrain import first_crossing, hidden_by_terrain
from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig

CAMERA = PinholeCamera.centred(640, 480, 500.0)
# The terrain's z is up, the camera's -y; it lies across the view, 0.3 m below its middle.
LEVEL = Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), [-1.0, 0.3, 0.5])


def box(depth):
    return Solid.block(0.2, 0.4, 0.2), Pose(np.eye(3), [0.1, 0.1, depth])


@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_ground_cuts_off_what_is_below_it(interpolation):
    ground = Terrain(np.zeros((4, 5)), (0.5, 0.5), interpolation)
    solid, pose = box(1.5)
    whole = visible_features(solid, pose, CAMERA)
    cut = visible_features(solid, pose, CAMERA, [(ground, LEVEL)])
    upright = np.abs(cut.directions[:, 1]) > 0.99
    assert len(cut) < len(whole) and upright.sum() == 3
    # From the upper end at y = 0.1 down to the ground at y = 0.3, and not to the lower end at 0.5.
    ends = np.sort(np.stack([cut.start[upright, 1], cut.end[upright, 1]], axis=1), axis=1)
    assert np.abs(ends - [0.1, 0.3]).max() < 1e-6
    assert (cut.end[~upright, 1] < 0.11).all()


@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_only_the_cells_under_a_ray_need_be_looked_at(interpolation):
    random = np.random.default_rng(5)
    heights = random.normal(scale=0.3, size=(6, 7))
    heights[2, 3] = np.nan
    terrain = Terrain(heights, interpolation=interpolation)
    viewpoint = np.array([2.2, 1.7, 3.0])
    targets = np.concatenate([random.uniform(-2.0, 8.0, (400, 3)) - [0, 0, 6], [[2.2, 1.7, -1.0], [5.0, 1.7, 3.0]]])
    expected = first_crossing(terrain, np.broadcast_to(viewpoint, targets.shape), targets - viewpoint, 0.0, 1.0)
    hidden = hidden_by_terrain(terrain, viewpoint, targets)
    assert np.array_equal(hidden, np.isfinite(expected)) and 50 < hidden.sum() < 350


@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_what_is_seen_over_rough_ground_is_seen_and_what_is_missing_is_hidden(interpolation):
    random = np.random.default_rng(1)
    ground = Terrain(random.normal(scale=0.08, size=(9, 9)), (0.25, 0.25), interpolation)
    solid = Solid.block(0.3, 0.5, 0.3) | Solid.cylinder(0.1, (0.0, 0.5, 0.0)).transformed(Pose(np.eye(3), [-0.3, 0, 0]))
    pose = Pose.from_rotation_vector([0.1, 0.4, 0.0], [0.1, -0.05, 1.6])
    alone, behind = visible_features(solid, pose, CAMERA), visible_features(solid, pose, CAMERA, [(ground, LEVEL)])
    inverse = np.linalg.inv(LEVEL.matrix @ ground.matrix)

    def covered(points):
        local = points @ inverse[:3, :3].T + inverse[:3, 3]
        origin = np.broadcast_to(inverse[:3, 3], local.shape)
        return np.isfinite(first_crossing(ground, origin, local - origin, 0.0, 1.0 - 1e-6))

    def sampled(edges):
        t = np.linspace(0.002, 0.998, 60)[:, None, None]
        return (edges.start + t * (edges.end - edges.start)).reshape(-1, 3)

    whole, cut = (features.of_kind(FeatureKind.EDGE) for features in (alone, behind))
    assert not covered(sampled(cut)).any()
    free = ~covered(sampled(whole)).reshape(60, -1)
    assert cut.lengths.sum() == pytest.approx((free.mean(axis=0) * whole.lengths).sum(), rel=0.03)
    assert 0.2 * whole.lengths.sum() < cut.lengths.sum() < 0.95 * whole.lengths.sum()


def test_ideal_data_of_a_scene_with_a_terrain_is_of_its_solids():
    solid, pose = box(1.5)
    ground = Placement('ground', Terrain(np.zeros((4, 5)), (0.5, 0.5)), LEVEL.matrix)
    scene = Scene([ground, Placement('box', solid, pose.matrix)])
    data = ideal_data(scene, StereoRig.symmetric(CAMERA, 0.1))
    assert data.names == ('ground', 'box') and set(data.object_index) == {1}
    assert max(data.features.start[:, 1].max(), data.features.end[:, 1].max()) < 0.3 + 1e-6
