"""Points of a visible outline lie on what exact hidden-line removal leaves, and cover it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from csg_renderer import Solid, SolidOutline, load_models, visible_fragments
from msgs_py import FeatureKind, PinholeCamera, Pose

CAMERA = PinholeCamera.centred(640, 480, 600.0)


def seen_from(outline: SolidOutline, seed: int) -> Pose:
    turn = Rotation.random(random_state=seed).as_matrix()
    return Pose(turn, np.array([0.0, 0.0, 3.0 * outline.size]) - turn @ outline.centre)


@pytest.mark.parametrize('name', ['l_shape', 'plug', 'cylinder_box', 'widget', 'lamp'])
@pytest.mark.parametrize('seed', [0, 1])
def test_points_lie_on_the_visible_fragments_and_cover_them(name, seed):
    solid = next(iter(load_models(name).values()))
    outline = SolidOutline(solid)
    pose = seen_from(outline, seed)
    points = outline.visible(pose, CAMERA, 2.0)
    exact = visible_fragments(solid, pose, CAMERA)
    edges = exact.features.kind == FeatureKind.EDGE
    at = pose.apply(points.point)
    for row, feature in zip(np.flatnonzero(edges), exact.model_index[edges]):
        mine = at[points.feature == feature]
        start, end = exact.features.start[row], exact.features.end[row]
        pixels = np.linalg.norm(CAMERA.project(end) - CAMERA.project(start))
        along = (mine - start) @ (end - start) / ((end - start) @ (end - start))
        on = np.abs(mine - start - along[:, None] * (end - start)).max(initial=0.0)
        assert on < 1e-9
        inside = (along > -1e-9) & (along < 1 + 1e-9)
        # Points are 2 px apart, so a fragment is covered but for one at either end.
        assert inside.sum() >= pixels / 2.0 - 2.0
    seen = set(exact.model_index.tolist())
    assert set(points.feature[points.feature >= 0].tolist()) <= seen


def test_the_contour_of_a_sphere_is_seen_at_right_angles():
    outline = SolidOutline(Solid.sphere(0.05))
    pose = Pose(np.eye(3), np.array([0.02, -0.01, 0.6]))
    points = outline.visible(pose, CAMERA, 3.0)
    at = pose.apply(points.point)
    assert len(points) > 50
    np.testing.assert_allclose(np.linalg.norm(at - pose.translation, axis=1), 0.05, atol=1e-12)
    np.testing.assert_allclose((at * points.outward).sum(axis=1), 0.0, atol=1e-9)
    assert (points.feature == -1).all()


def test_spacing_and_tangents_are_those_of_the_image():
    outline = SolidOutline(Solid.block(0.1, 0.08, 0.06))
    pose = seen_from(outline, 3)
    points = outline.visible(pose, CAMERA, 4.0)
    pixel = CAMERA.project(pose.apply(points.point))
    same = np.diff(points.curve) == 0
    step = np.linalg.norm(np.diff(pixel, axis=0), axis=1)[same]
    np.testing.assert_allclose(step, points.spacing[1:][same], rtol=0.02)
    assert points.spacing.max() <= 4.0 + 1e-9
    along = np.diff(points.point, axis=0)[same]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((along * points.tangent[1:][same]).sum(axis=1)), 1.0, atol=1e-9)


def test_nothing_is_seen_of_what_lies_behind_the_camera():
    outline = SolidOutline(Solid.block(0.1, 0.1, 0.1))
    assert len(outline.visible(Pose(np.eye(3), np.array([0.0, 0.0, -1.0])), CAMERA, 4.0)) == 0


def test_the_surface_is_where_rays_meet_it():
    camera = PinholeCamera.centred(64, 64, 80.0)
    ball = SolidOutline(Solid.sphere(0.05) - Solid.sphere(0.02))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 0.3]))
    seen = ball.surface(pose, camera, np.array([[31.5, 31.5], [40.0, 28.0], [0.0, 0.0]]))
    np.testing.assert_allclose(seen[0], [0.0, 0.0, -0.05], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(seen[1]), 0.05, atol=1e-9)
    np.testing.assert_allclose(camera.project(pose.apply(seen[1])), [40.0, 28.0], atol=1e-9)
    assert np.isnan(seen[2]).all()
    hollow = SolidOutline(Solid.block(0.1, 0.1, 0.1) - Solid.block(0.05, 0.05, 0.2))
    front = hollow.surface(Pose(np.eye(3), np.array([-0.025, -0.025, 0.2])), camera, np.array([[31.5, 31.5]]))
    assert np.isnan(front).all()


def test_the_limbs_of_a_cylinder_run_from_rim_to_rim():
    """Its rulings are as long as the cylinders are that share the surface, one on the other."""
    shared = Solid.cylinder(0.01, (0.0, 0.0, 0.03)) | Solid.cylinder(0.01, (0.0, 0.0, 0.05)).transformed(
        Pose(np.eye(3), np.array([0.0, 0.0, 0.04]))
    )
    outline = SolidOutline(shared)
    pose = Pose(Rotation.from_euler('x', 90, degrees=True).as_matrix(), np.array([0.0, 0.045, 0.5]))
    points = outline.visible(pose, CAMERA, 2.0)
    limb = points.point[(points.outward**2).sum(axis=1) > 0.5]
    height = np.sort(limb[:, 2])
    # Both cylinders from end to end, two points at each height, and none in the gap between them.
    step = np.diff(np.unique(height.round(9)))
    assert height[0] < 0.001 and height[-1] > 0.089
    assert not ((height > 0.03) & (height < 0.04)).any()
    assert np.sort(step)[-2] < 0.003
