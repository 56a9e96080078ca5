"""Tracking: the filter in closed form, what is reused and hidden, and objects followed through rendered pictures."""

from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from csg_renderer import Light, Scene, Solid, SolidOutline, load_models, render_stereo
from csg_renderer.raycast.sensor import SensorModel
from model_matcher.image_pose.alignment import Steps
from model_matcher.image_pose.sight import look
from model_matcher.image_pose.views import Views
from model_matcher.tracking.appearance import patches, shifted
from model_matcher.tracking.aspect import AspectCache
from model_matcher.tracking.hiding import behind
from model_matcher.tracking.measuring import within
from model_matcher.tracking.motion_filter import (
    BodyState,
    about_middle,
    about_origin,
    at_rest,
    carried,
    corrected,
    mahalanobis,
    moved_camera,
    placed,
    predicted,
)
from model_matcher.tracking.texture import corners_of, followed
from model_matcher.tracking.tracker import Tracker, TrackParams
from msgs_py import PinholeCamera, Pose, StereoRig

RIG = StereoRig.symmetric(PinholeCamera.centred(320, 240, 300.0), 0.06)
DISTANCE = 0.3


def turned(degrees, place=(0.0, 0.0, DISTANCE), middle=(0.0, 0.0, 0.0)):
    rotation = Rotation.from_euler('xyz', degrees, degrees=True).as_matrix()
    return placed(rotation, np.array(place), np.array(middle))


# -- the filter ----------------------------------------------------------------------------------------------------


def test_a_body_at_constant_velocity_is_predicted_where_it_will_be():
    middle = np.array([0.1, -0.2, 0.05])
    state = at_rest(turned([10, 20, 30]), middle, np.eye(6), 1.0, 1.0)
    twist = np.array([0.1, 0.0, -0.2, 0.0, 1.0, 0.0])
    ahead = predicted(BodyState(state.pose, middle, twist, state.covariance), 0.5, 1.0, 1.0)
    np.testing.assert_allclose(ahead.place, state.place + [0.05, 0.0, -0.1], atol=1e-12)
    expected = Rotation.from_rotvec([0.0, 0.5, 0.0]).as_matrix() @ state.pose.rotation
    np.testing.assert_allclose(ahead.pose.rotation, expected, atol=1e-12)


def test_variances_grow_as_those_of_a_constant_acceleration_do():
    state = at_rest(turned([0, 0, 0]), np.zeros(3), np.zeros((6, 6)), 0.3, 0.0)
    ahead = predicted(state, 2.0, 0.5, 4.0)
    # Of the place: (0.3 * 2)^2 + (0.5 * 2^2 / 2)^2; of the velocity: 0.3^2 + (0.5 * 2)^2; of the turn: (4 * 2^2 / 2)^2.
    assert ahead.covariance[0, 0] == pytest.approx(0.36 + 1.0)
    assert ahead.covariance[6, 6] == pytest.approx(0.09 + 1.0)
    assert ahead.covariance[3, 3] == pytest.approx(64.0)
    assert ahead.covariance[0, 6] == pytest.approx(2.0 * 0.09 + 0.5 * 2.0 * 1.0)


def test_prediction_and_measurement_count_by_their_variances():
    state = at_rest(turned([0, 0, 0]), np.zeros(3), 4.0 * np.eye(6), 1.0, 1.0)
    after = corrected(state, turned([0, 0, 0], (0.5, 0.0, DISTANCE)), np.eye(6))
    assert after.place[0] == pytest.approx(0.5 * 4.0 / 5.0)
    np.testing.assert_allclose(after.covariance[:6, :6], np.eye(6) * 4.0 / 5.0, atol=1e-12)
    assert mahalanobis(state, turned([0, 0, 0], (0.5, 0.0, DISTANCE)), np.eye(6)) == pytest.approx(0.25 / 5.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_covariances_move_between_origin_and_middle_and_back(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6))
    pose = Pose.from_rotation_vector(rng.normal(size=3), rng.normal(size=3))
    middle = rng.normal(size=3)
    there = about_middle(root @ root.T, pose, middle)
    np.testing.assert_allclose(about_origin(there, pose, middle), root @ root.T, atol=1e-9)
    # Small turns about the origin move the middle by turn x arm.
    step = 1e-6 * (root @ rng.normal(size=6))
    moved = Pose(Rotation.from_rotvec(step[3:]).as_matrix() @ pose.rotation, pose.translation + step[:3])
    arm = pose.rotate(middle)
    np.testing.assert_allclose(moved.apply(middle) - pose.apply(middle), step[:3] + np.cross(step[3:], arm), atol=1e-10)


def test_errors_of_a_filtered_path_are_as_stated():
    rng = np.random.default_rng(3)
    sigma, noise, dt = 2.0, 1e-3, 1 / 30
    state = at_rest(turned([0, 0, 0]), np.zeros(3), 1e-6 * np.eye(6), 0.1, 0.1)
    place, speed = state.place.copy(), rng.normal(scale=0.1, size=3)
    distances = []
    for _ in range(400):
        push = rng.normal(scale=sigma, size=3)
        place, speed = place + dt * speed + 0.5 * dt * dt * push, speed + dt * push
        state = predicted(state, dt, sigma, sigma)
        seen = placed(np.eye(3), place + rng.normal(scale=noise, size=3), np.zeros(3))
        state = corrected(state, seen, noise**2 * np.eye(6))
        off = state.place - place
        distances.append(off @ np.linalg.solve(state.covariance[:3, :3], off))
    assert np.mean(distances) == pytest.approx(3.0, rel=0.15)


def test_a_turn_that_nobody_sees_stays_where_it_is():
    state = at_rest(turned([0, 0, 0]), np.zeros(3), 1e-4 * np.eye(6), 0.1, 1.0)
    free = np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, np.pi**2 / 3])
    for k in range(50):
        state = predicted(state, 1 / 30, 2.0, 40.0)
        state = corrected(state, turned([0.2 * k, 0, 0]), free)
    assert state.twist[5] == 0.0
    assert abs(Rotation.from_matrix(state.pose.rotation).as_euler('xyz')[2]) < 1e-3


def test_a_camera_that_moves_leaves_the_body_where_it_is():
    state = at_rest(turned([10, 0, 0]), np.full(3, 0.01), np.diag(np.arange(1.0, 7.0)), 0.1, 0.2)
    motion = Pose.from_rotation_vector([0.1, 0.2, 0.3], [0.01, 0.0, 0.02])
    there = moved_camera(state, motion)
    np.testing.assert_allclose(there.place, motion.apply(state.place))
    back = moved_camera(there, motion.inverse())
    np.testing.assert_allclose(back.covariance, state.covariance, atol=1e-12)


# -- outlines that are kept, hidden and looked for -----------------------------------------------------------------


def test_an_outline_is_made_again_only_after_a_turn_that_shows():
    shape = SolidOutline(Solid.block(0.06, 0.05, 0.04))
    blank = np.zeros((240, 320), np.uint8)
    views, cache = Views.of([blank, blank], RIG), AspectCache(SolidOutline(Solid.block(0.06, 0.05, 0.04)))
    for angle in np.arange(0.0, 20.0, 0.25):
        cache.outline(turned([30 + angle, 20, 0], middle=shape.centre), views)
    # Half the size is 44 mm, 44 px: sqrt(0.2 / 44) rad are 3.9 degrees.
    assert 5 <= cache.renewed <= 7
    for _ in range(5):
        cache.outline(turned([50, 20, 0], middle=shape.centre), views)
    assert cache.renewed <= 8


def test_what_lies_inside_another_outline_is_hidden():
    shape = SolidOutline(Solid.block(0.04, 0.04, 0.04))
    blank = np.zeros((240, 320), np.uint8)
    views = Views.of([blank, blank], RIG)
    pose = turned([20, 30, 0], middle=shape.centre)
    outline = AspectCache(shape).outline(pose, views)
    front = look(shape, turned([20, 30, 0], (0.02, 0.0, 0.2), shape.centre), views)
    hidden = behind(outline, pose, views, [front])
    assert 0.2 < hidden.mean() < 0.9
    left = views.cameras[0].project(pose.apply(outline.point[outline.eye == 0]))
    assert left[hidden[outline.eye == 0], 0].min() > left[:, 0].min() + 10.0


# -- rendered --------------------------------------------------------------------------------------------------------

LIGHTS = [Light((0.3, -0.5, 0.2), (0.8,) * 3), Light((-0.5, -0.2, -0.3), (0.3,) * 3)]


@lru_cache(maxsize=4)
def part(name):
    solid = next(iter(load_models(name).values()))
    return solid, SolidOutline(solid)


def distance(shape):
    return 3.0 * shape.size


def rig_for(shape):
    return StereoRig.symmetric(PinholeCamera.centred(320, 240, 420.0), 0.15 * distance(shape))


def at(shape, degrees, shift=(0.0, 0.0, 0.0)):
    """A pose before the rig, turned, and shifted by parts of the shape's size."""
    place = np.array([0.5 * rig_for(shape).baseline, 0.0, distance(shape)]) + shape.size * np.array(shift)
    return turned(degrees, place, shape.centre)


def images(solid, shape, poses, front=(), seed=0):
    """Two (240, 320) uint8: what the rig sees of a part at some poses, something before it, with noise."""
    scene = Scene([*(solid.transformed(pose) for pose in poses), *front], LIGHTS, (0.2,) * 3, (0.4,) * 3)
    frames = render_stereo(scene, rig_for(shape), antialias=2, psf=0.5)
    return [SensorModel(0.5, 1.5, (seed, eye)).picture(frame, monochrome=True) for eye, frame in enumerate(frames)]


def bar(shape, left, right):
    """A bar before a part, from left to right of its middle in parts of its size."""
    size = np.array([(right - left) * shape.size, 4.0 * shape.size, 0.02 * shape.size])
    place = np.array([0.5 * rig_for(shape).baseline + left * shape.size, -2.0 * shape.size, 0.6 * distance(shape)])
    return Solid.block(*size).transformed(Pose(np.eye(3), place))


def test_a_turning_part_is_followed_and_a_jump_survived():
    solid, shape = part('l_shape')
    tracker, rig = Tracker(shape, at(shape, [25, 30, 0])), rig_for(shape)
    for frame in range(14):
        pushed = 5.0 if frame >= 8 else 0.0
        shift = [0.01 * frame + (0.02 / shape.size if frame >= 8 else 0.0), 0.0, 0.0]
        pose = at(shape, [25 + pushed, 30 + 1.5 * frame, 0], shift)
        found = tracker(images(solid, shape, [pose], seed=frame), rig)
        assert found is not None
        assert pose.error_to(found).rotation_deg < 0.2
        assert np.linalg.norm(pose.apply(shape.centre) - found.apply(shape.centre)) < 2e-3 * shape.size
    assert tracker.renewed < 14


@pytest.mark.parametrize(('way', 'seed'), [(-1, 200), (1, 100)])
def test_a_face_that_turns_away_does_not_hold_the_pose_edge_on(way, seed):
    """One camera sees a long face edge-on, and then no more, while the other still sees it narrow."""
    solid, shape = part('l_shape_v2')
    poses = [at(shape, [0, 180 + way * (0.67 * frame - 14.0), 0]) for frame in range(44)]
    rig, tracker = rig_for(shape), Tracker(shape, poses[0])
    in_a_row, most = 0, 0
    for frame, pose in enumerate(poses):
        found = tracker(images(solid, shape, [pose], seed=seed + frame), rig)
        assert found is not None
        in_a_row = in_a_row + 1 if pose.error_to(found).rotation_deg > 3.0 else 0
        most = max(most, in_a_row)
    assert most < 10, 'with both curves on one step it is 24 and 25'
    assert in_a_row == 0


def test_half_an_outline_is_enough_and_none_is_noticed():
    solid, shape = part('l_shape')
    pose, rig = at(shape, [25, 30, 0]), rig_for(shape)
    tracker = Tracker(shape, pose)
    for frame in range(8):  # a bar comes in from the left, as wide as the part
        front = [bar(shape, -1.6, -0.5 + 0.07 * frame)]
        found = tracker(images(solid, shape, [pose], front, frame), rig)
        assert found is not None
        assert pose.error_to(found).rotation_deg < 0.5
    for frame in range(8, 11):
        result = tracker.step(Views.of(images(solid, shape, [], seed=frame), rig))
    assert result.pose is None
    assert tracker.pose is None
    assert 'as chance does' in result.reason
    tracker.restart(pose)
    assert tracker(images(solid, shape, [pose], seed=20), rig) is not None


def test_a_part_that_is_there_again_at_once_is_taken_up_again():
    solid, shape = part('l_shape')
    pose, rig = at(shape, [25, 30, 0]), rig_for(shape)
    tracker = Tracker(shape, pose)
    shown = [[pose], [pose], [], [], [], [pose], [pose]]
    found = list(tracker.follow((images(solid, shape, ones, seed=k), rig) for k, ones in enumerate(shown)))
    assert found[4] is None
    assert found[-1] is not None
    assert pose.error_to(found[-1]).rotation_deg < 0.2


def test_what_can_be_turned_unseen_does_not_spin():
    solid = Solid.cylinder(0.03, (0.0, 0.0, 0.05))
    shape = SolidOutline(solid)
    rig = rig_for(shape)
    tracker = Tracker(shape, at(shape, [60, 0, 0]))
    for frame in range(12):
        pose = at(shape, [60 + 1.5 * frame, 2.0 * frame, 0])
        result = tracker.step(Views.of(images(solid, shape, [pose], seed=frame), rig))
        assert result.pose is not None
    axis = result.pose.rotation[:, 2]
    assert np.degrees(np.arccos(axis @ pose.rotation[:, 2])) < 0.3
    assert abs(axis @ result.twist[3:]) < 0.01
    assert axis @ result.covariance[3:, 3:] @ axis > 0.05


def test_a_part_behind_another_one_is_not_missed():
    solid, shape = part('l_shape')
    rig = rig_for(shape)
    back, front = at(shape, [25, 30, 0]), at(shape, [10, 50, 0], (0.35, 0.0, -1.0))
    both = images(solid, shape, [back, front])
    views = Views.of(both, rig)
    nearer = look(shape, front, views)
    alone = Tracker(shape, back).step(views)
    knowing = Tracker(shape, back).step(views, nearer=[nearer])
    assert knowing.presence.support > alone.presence.support


def test_one_camera_with_a_motion_of_its_own():
    solid, shape = part('l_shape')
    pose, rig = at(shape, [25, 30, 0]), rig_for(shape)
    tracker = Tracker(shape, pose)
    left, right = images(solid, shape, [pose])
    assert tracker([left], rig.left) is not None
    # The next picture is taken from where the right camera stands.
    new_T_old = Pose(np.eye(3), rig.right_T_left)
    result = tracker.step(Views.of([right], rig.left), camera_motion=new_T_old)
    assert result.pose is not None
    assert new_T_old.compose(pose).error_to(result.pose).rotation_deg < 0.5
    assert result.search_px < 30.0


def test_where_an_object_looks_as_it_did_is_found_in_both_views():
    solid, shape = part('l_shape')
    pose, there = at(shape, [25, 30, 0]), at(shape, [25, 30, 0], (0.2, -0.1, 0.1))
    rig = rig_for(shape)
    before, after = (Views.of(images(solid, shape, [one]), rig) for one in (pose, there))
    was = patches(look(shape, pose, before), pose.apply(shape.centre), before)
    found = shifted(was, pose, shape.centre, after, 60.0)
    moved = found.translation - pose.translation
    assert np.abs(moved - (there.translation - pose.translation))[:2].max() < 0.03 * shape.size


def test_what_has_passed_a_camera_looks_like_nothing_it_was():
    """Its middle behind a camera, before or now, is at no pixel."""
    solid, shape = part('l_shape')
    pose, rig = at(shape, [25, 30, 0]), rig_for(shape)
    views = Views.of(images(solid, shape, [pose]), rig)
    sight, behind = look(shape, pose, views), Pose(pose.rotation, -pose.translation)
    assert patches(sight, behind.apply(shape.centre), views) == (None, None)
    was = patches(sight, pose.apply(shape.centre), views)
    assert None not in was and shifted(was, behind, shape.centre, views, 60.0) is None


@pytest.mark.parametrize('seconds', [-1.0, float('nan')])
def test_time_that_does_not_pass_is_refused(seconds):
    _, shape = part('l_shape')
    views = Views.of([np.zeros((240, 320), np.uint8)] * 2, rig_for(shape))
    with pytest.raises(ValueError, match='seconds'):
        Tracker(shape, at(shape, [0, 0, 0])).step(views, seconds)


def test_parameters_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match='acceleration'):
        TrackParams(acceleration=0.0)


# -- texture ---------------------------------------------------------------------------------------------------------


def test_corners_of_the_surface_tell_a_motion():
    shape = SolidOutline(Solid.block(0.06, 0.05, 0.04))
    middle, camera = shape.centre, RIG.left
    before = turned([20, 30, 0], middle=middle)
    after = turned([22, 31, 1], (0.01, -0.005, DISTANCE + 0.004), middle)
    rng = np.random.default_rng(2)
    print_ = rng.integers(0, 255, (64, 64)).astype(np.float32)

    def picture(pose):
        """A block whose faces are printed with noise that stays where it is."""
        v, u = np.mgrid[0:240, 0:320]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
        point = shape.surface(pose, camera, pixels)
        cell = np.nan_to_num((point * [600.0, 600.0, 600.0]) @ [[1.0, 0.3], [0.2, 1.0], [0.7, 0.6]])
        value = print_[cell[:, 0].astype(int) % 64, cell[:, 1].astype(int) % 64]
        grey_ = np.where(np.isfinite(point[:, 0]), value, 20.0).reshape(240, 320)
        return cv2.GaussianBlur(grey_.astype(np.uint8), None, 1.0)

    first, second = (Views.of([picture(pose)], camera) for pose in (before, after))
    corners = corners_of(shape, before, look(shape, before, first), first)
    assert len(corners[0].point) > 20
    start = np.diag([0.02**2] * 3 + [0.087**2] * 3)
    pose, covariance = followed(corners, before, start, middle, second, 30.0)
    assert after.error_to(pose).rotation_deg < 0.5
    off = pose.apply(middle) - after.apply(middle)
    assert np.linalg.norm(off) < 2e-3
    assert off @ np.linalg.solve(covariance[:3, :3], off) < 40.0
    blank = Views.of([np.full((240, 320), 20, np.uint8)], camera)
    assert followed(corners, before, start, middle, blank, 30.0) is None


def test_a_motion_that_was_seen_carries_the_pose_and_its_doubt():
    state = at_rest(turned([10, 0, 0]), np.zeros(3), 1e-6 * np.eye(6), 0.1, 0.1)
    there = turned([13, 0, 0], (0.01, 0.0, DISTANCE))
    after = carried(state, there, 1e-8 * np.eye(6), 0.1, 4.0 * np.eye(6))
    np.testing.assert_allclose(after.twist, [0.1, 0.0, 0.0, np.radians(30.0), 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(after.covariance[:6, :6], 1.01e-6 * np.eye(6))
    np.testing.assert_allclose(after.covariance[6:, 6:], (1.0 + 1e-6) * np.eye(6))
    # Over the whole way it is off by as much as its mean velocity says.
    np.testing.assert_allclose(after.covariance[:6, 6:], 1e-7 * np.eye(6))


def test_only_near_steps_are_kept():
    offset = np.array([[-5.0, 1.0, 3.0], [2.0, np.nan, np.nan], [np.nan] * 3])
    steps = Steps(offset, np.array([3, 1, -1], np.int32), np.zeros(3))
    near = within(steps, 3)
    assert near.number.tolist() == [2, 1, -1]
    assert near.offset[0, :2].tolist() == [1.0, 3.0]
