"""Hidden-line removal: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from csg_renderer import Solid, model_features, visible_features, visible_fragments
from csg_renderer.visibility.hidden_lines import stereo_fragments
from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig

CAMERA = PinholeCamera.centred(640, 480, 600.0)
CUBE = Solid.block(1, 1, 1).transformed(Pose(np.eye(3), [-0.5, -0.5, -0.5]))
CORNER_ON = Pose.from_rotation_vector([0.5, 0.6, 0.1], [0.0, 0.0, 6.0])


def at(solid: Solid, x: float, y: float, z: float) -> Solid:
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def test_a_cube_shows_nine_of_its_edges_whole():
    seen = visible_fragments(CUBE, CORNER_ON, CAMERA)
    assert len(seen.features) == 9
    model = model_features(CUBE).transformed(CORNER_ON)
    np.testing.assert_allclose(seen.features.start, model.start[seen.model_index], atol=1e-12)
    np.testing.assert_allclose(seen.features.end, model.end[seen.model_index], atol=1e-12)


def test_the_hidden_edges_are_those_that_meet_in_the_far_corner():
    seen = visible_fragments(CUBE, CORNER_ON, CAMERA)
    model = model_features(CUBE).transformed(CORNER_ON)
    missing = model.select(np.setdiff1d(np.arange(12), seen.model_index))
    ends = np.concatenate([missing.start, missing.end])
    farthest = ends[np.linalg.norm(ends, axis=1).argmax()]
    assert (
        np.minimum(np.linalg.norm(missing.start - farthest, axis=1), np.linalg.norm(missing.end - farthest, axis=1))
        < 1e-12
    ).all()


def test_a_plate_in_front_cuts_edges_exactly_where_its_image_ends():
    # A wall at z = 5 whose right border is the plane x = 0; the edge behind it at z = 10 is seen from x = 0 on.
    bar = at(Solid.block(4, 0.1, 0.1), -2, 0, 10)
    wall = at(Solid.block(3, 4, 0.1), -3, -2, 5)
    seen = visible_fragments(bar, Pose(), CAMERA, others=[(wall, Pose())])
    long = seen.features.select(seen.features.lengths > 1.0)
    assert len(long) >= 2
    np.testing.assert_allclose(np.minimum(long.start[:, 0], long.end[:, 0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.maximum(long.start[:, 0], long.end[:, 0]), 2.0, atol=1e-9)


def test_a_post_in_front_makes_two_fragments_of_one_edge():
    bar = at(Solid.block(4, 0.5, 0.5), -2, 0, 10)
    post = at(Solid.block(0.2, 4, 0.2), -0.1, -2, 5)
    seen = visible_fragments(bar, Pose(), CAMERA, others=[(post, Pose())])
    alone = visible_fragments(bar, Pose(), CAMERA)
    index, count = np.unique(seen.model_index, return_counts=True)
    assert set(index) == set(alone.model_index)
    assert (count[np.isin(index, alone.model_index[alone.features.lengths > 3.0])] == 2).all()
    # The gap at z = 10 is the post's front, 0.2 wide at z = 5, seen twice as large.
    front = seen.features.select(np.abs(seen.features.midpoints[:, 2] - 10.0) < 1e-9)
    x = np.sort(np.stack([front.start[:, 0], front.end[:, 0]]).T[front.lengths > 1.0], axis=1)
    assert set(np.round(x, 9).ravel()) == {-2.0, -0.2, 0.2, 2.0}


def test_edges_end_at_the_image_border():
    bar = at(Solid.block(40, 0.5, 0.5), -20, 0, 10)
    seen = visible_features(bar, Pose(), CAMERA)
    u = CAMERA.project(np.concatenate([seen.start, seen.end]))[:, 0]
    np.testing.assert_allclose([u.min(), u.max()], [-0.5, CAMERA.width - 0.5], atol=1e-9)


@pytest.mark.parametrize('place', [Pose(np.eye(3), [0, 0, -6]), Pose(np.eye(3), [30, 0, 6]), Pose()])
def test_nothing_is_seen_behind_beside_or_from_inside(place):
    assert len(visible_features(CUBE, place, CAMERA)) == 0


def test_a_cylinder_shows_one_whole_rim_half_of_the_other_and_two_contours():
    cylinder = Solid.cylinder(1.0, (0, 0, 2))
    place = Pose.from_rotation_vector([2.2, 0.0, 0.0], [0.0, 0.5, 12.0])
    seen = visible_fragments(cylinder, place, CAMERA)
    curves = seen.features.of_kind(FeatureKind.CURVE)
    assert len(curves) == 2
    whole = curves.arc[:, 1] > 2 * np.pi - 1e-9
    assert whole.sum() == 1
    # The other rim ends at the contours, where the rays touch the surface.
    eye = place.inverse().translation
    reach = np.pi - 2 * np.arccos(1.0 / np.hypot(eye[0], eye[1]))
    np.testing.assert_allclose(2 * np.pi - curves.arc[~whole, 1], np.pi + reach, atol=1e-9)
    assert (seen.contours.kind == FeatureKind.EDGE).sum() == 2
    assert (seen.features.kind == FeatureKind.AXIS).sum() == 1


def test_the_contour_of_a_sphere_is_a_circle_before_its_centre():
    seen = visible_fragments(Solid.sphere(1.0), Pose(np.eye(3), [0, 0, 5]), CAMERA)
    assert len(seen.features) == 0
    np.testing.assert_allclose(seen.contours.start, [[0, 0, 5 - 1 / 5]], atol=1e-9)
    np.testing.assert_allclose(seen.contours.radii, [[np.sqrt(1 - 1 / 25)] * 2], atol=1e-9)
    np.testing.assert_allclose(seen.contours.directions, [[0, 0, -1]], atol=1e-9)


def test_an_axis_needs_both_rims():
    # Looking straight at one end of a cylinder hides the other rim.
    cylinder = Solid.cylinder(1.0, (0, 0, 2))
    seen = visible_features(cylinder, Pose(np.eye(3), [0, 0, 5]), CAMERA)
    assert [(seen.kind == k).sum() for k in FeatureKind] == [0, 1, 0]


def test_both_eyes_see_less_than_either():
    rig = StereoRig.symmetric(CAMERA, 1.2)
    post = at(Solid.block(0.2, 4, 0.2), -0.1, -2, 5)
    bar = at(Solid.block(4, 0.5, 0.5), -2, 0, 10)
    (features, index), _ = stereo_fragments([(bar, Pose()), (post, Pose())], rig)
    front = features.select((np.abs(features.midpoints[:, 2] - 10.0) < 1e-9) & (features.lengths > 0.55))
    x = np.stack([front.start[:, 0], front.end[:, 0]])
    # The left eye misses -0.2..0.2. The right eye, at x = 1.2, misses what the post's front left and back right hide.
    hidden = [10 / 5 * (-0.1 - 1.2) + 1.2, 10 / 5.2 * (0.1 - 1.2) + 1.2]
    np.testing.assert_allclose(np.unique(np.round(x, 9)), [-2.0, *hidden, -0.2, 0.2, 2.0], atol=1e-9)
    assert len(index) == len(features)


def test_scale_of_the_pose_is_followed():
    small = Pose(CORNER_ON.rotation, CORNER_ON.translation, 0.5)
    seen = visible_fragments(CUBE, small, CAMERA)
    np.testing.assert_allclose(seen.features.lengths, 0.5, atol=1e-12)
    assert len(seen.features) == 9
