"""Predictions of plan_rig: what a step tells, views that cover a volume, covariances against bounds and trials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from csg_renderer.raycast.sensor import SensorModel
from model_matcher.closed_form.planning.part import PlannedPart, load_part
from model_matcher.closed_form.planning.prediction import _in_pieces, _information, predict
from model_matcher.closed_form.planning.rig import PlannedRig, Sensor, read_sensor, rig_of_numbers
from model_matcher.closed_form.planning.settings import DRAWN_LINE_PX, DRAWN_VIEW_PX
from model_matcher.closed_form.planning.steps import Profiles, edge_information, place_variances
from model_matcher.closed_form.planning.volume import Volume
from model_matcher.image_pose.measurement import measure_pose
from model_matcher.image_pose.profiles import FITTED, Quality, Stretches, fit_steps
from model_matcher.image_pose.settings import LEAST_SLOPE, WALKS
from model_matcher.image_pose.views import Views
from msgs_py import Pose

RIG = PlannedRig(rig_of_numbers((320, 240), 440.0, 0.06))
VOLUME = Volume(0.25, 0.35)


@pytest.fixture(scope='module')
def l_shape() -> PlannedPart:
    return load_part('l_shape')


def test_a_step_that_is_crowded_tells_less_and_one_without_contrast_nothing():
    flank = np.array([4, 2, 4, 4, 4, 0], np.int32)
    beside = np.full((6, 2), np.nan)
    beside[3, 0] = 2.0
    limb = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    contrast = np.array([50.0, 50.0, 50.0, 50.0, 0.5, 50.0])
    found = place_variances(contrast, Profiles(flank, limb, beside, np.full(6, 4.0)), 0.6, 2.0)
    assert (found[1:4] > 1.01 * found[0]).all() and np.isinf(found[4:]).all()
    assert 4.0 * edge_information(50.0, 0.6, 2.0) > 1.0 / found[0]


@pytest.mark.parametrize(('contrast', 'noise', 'flank'), [(50.0, 2.0, 4), (90.0, 4.0, 3), (30.0, 1.0, 4)])
def test_places_of_steps_in_noise_spread_as_much_as_they_are_said_to(contrast, noise, flank):
    """Fitted as a pose is measured, over 3000 rows of four pixels."""
    rng = np.random.default_rng(3)
    n, blur, at = 3000, 0.6, 12.25
    levels = 80.0 + contrast * ndtr((np.arange(26.0) - at) / blur)
    image = np.rint(levels + noise * rng.standard_normal((4 * n + 4, 26))).astype(np.uint8)
    pixel = np.column_stack([np.full(n, 12.0), 4.0 * np.arange(n) + 2.5])
    outline = Stretches(
        pixel,
        np.tile([1.0, 0.0], (n, 1)),
        np.full(n, 4.0),
        np.zeros(n),
        np.zeros(n),
        np.full(n, flank, np.int32),
        np.ones(n),
    )
    fitted, nothing = np.empty((n, FITTED)), np.full((n, 2, 2), np.nan)
    pixel_noise = float(np.sqrt(noise**2 + 1.0 / 12.0))
    fit_steps(image, outline, nothing, Quality(1.0, blur, pixel_noise, WALKS[0], LEAST_SLOPE), fitted)
    profiles = Profiles(outline.flank[:1], np.zeros(1), nothing[:1, :, 0], np.full(1, 4.0))
    expected = place_variances(np.array([contrast]), profiles, blur, pixel_noise)[0]
    assert np.var(fitted[:, 0]) == pytest.approx(expected, rel=0.1)
    assert fitted[:, 0].mean() == pytest.approx(0.25, abs=0.02)


def test_views_cover_a_volume_and_both_cameras_see_all_of_the_part(l_shape):
    volume = Volume(0.25, 0.35, tilt=(20.0, 70.0), turn=(-30.0, 40.0), up=(0.0, 1.0, 0.0))
    middle, radius = l_shape.ball
    poses = volume.views(50, RIG, l_shape.ball)
    depths = [pose.apply(middle)[2] for pose in poses]
    assert 0.25 <= min(depths) < 0.26 and 0.34 < max(depths) <= 0.35
    to_camera = [-pose.apply(middle) / np.linalg.norm(pose.apply(middle)) for pose in poses]
    tilts = [
        np.degrees(np.arccos(pose.rotate(np.array([[0.0, 1.0, 0.0]]))[0] @ way)) for pose, way in zip(poses, to_camera)
    ]
    assert 20.0 <= min(tilts) < 24.0 and 66.0 < max(tilts) <= 70.0
    assert np.allclose(
        [pose.inverse().rotate(way[None])[0] for pose, way in zip(poses, to_camera)], volume.directions(50), atol=1e-9
    )
    corners = middle + radius * np.concatenate([np.eye(3), -np.eye(3)])
    for pose in poses:
        for pixels in RIG.cameras.project(pose.apply(corners)):
            assert (pixels > -1.0).all() and (pixels < [320.0, 240.0]).all()


def test_parts_at_once_do_not_hide_each_other(l_shape):
    rig = PlannedRig(rig_of_numbers((640, 480), 440.0, 0.06))
    volume = Volume(0.3, 0.4, at_once=3)
    first = volume.views(1, rig, l_shape.ball)[0]
    poses = volume.beside(first, np.random.default_rng(1), rig, l_shape.ball)
    pixels = rig.pair.left.project(np.array([pose.apply(l_shape.ball[0]) for pose in poses]))
    gaps = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)[np.triu_indices(len(poses), 1)]
    assert poses[0] == first and len(poses) == 3 and gaps.min() > 2.0 * 440.0 * l_shape.ball[1] / 0.4


def test_predicted_errors_are_those_of_poses_measured_in_drawn_pictures(l_shape):
    """As large, within what the median of two dozen allows; bench_planning has the figures of all models."""
    middle, _ = l_shape.ball
    ratios = []
    for number, pose in enumerate(VOLUME.views(24, RIG, l_shape.ball)):
        prediction = predict(l_shape, pose, RIG)
        images = [
            SensorModel(noise_sigma=RIG.sensor.noise, seed=(number, eye)).apply(picture)
            for eye, picture in enumerate(l_shape.pictures([pose], RIG, 4))
        ]
        found = measure_pose(l_shape.index.shape, pose, Views.of(images, RIG.cameras)).pose
        shift = np.linalg.norm(found.apply(middle) - pose.apply(middle))
        ratios.append([shift / prediction.position[0], found.error_to(pose).rotation_deg / prediction.rotation[0]])
    assert (np.median(ratios, axis=0) > 0.5).all() and (np.median(ratios, axis=0) < 2.0).all()


def test_more_noise_a_shorter_baseline_and_a_rough_calibration_cost_and_a_third_camera_helps(l_shape):
    pose = VOLUME.views(5, RIG, l_shape.ball)[2]
    usual = predict(l_shape, pose, RIG).position[0]
    worse = [
        PlannedRig(RIG.pair, sensor=Sensor(8.0, 0.5)),
        PlannedRig(RIG.pair, sensor=Sensor(2.0, 1.5)),
        PlannedRig(RIG.pair, outline_px=0.2),
        RIG.with_baseline(0.5),
    ]
    assert all(predict(l_shape, pose, rig).position[0] > 1.1 * usual for rig in worse)
    assert predict(l_shape, pose, RIG.with_third()).position[0] < usual


def test_noise_that_grows_with_the_light_is_that_of_the_pictures():
    sensor = Sensor(1.5, 0.0, 0.1)
    for level in (20.0, 200.0):
        picture = sensor.model((3, 1)).apply(np.full((200, 200), level))
        assert picture.std() == pytest.approx(sensor.pixel_noise(level), rel=0.03)


def test_what_symmetry_leaves_free_is_no_error_and_what_is_out_of_view_is_unknown(tmp_path):
    file = tmp_path / 'pin.csg'
    file.write_text('UNITS MM;\npin = CYLINDER (10, 0, 40, 0) AT (70, 20, 5) PAINT FACES;\nDRAW pin;\n')
    pin = load_part(str(file))
    pose = VOLUME.views(3, RIG, pin.ball)[1]
    seen = predict(pin, pose, RIG)
    turn = pose.rotate(pin.axis.direction[None])[0]
    arm = pose.rotate((pin.ball[0] - pin.axis.point)[None])[0]
    # Perpendicular to it where turns are measured in radii of the part.
    free = np.concatenate([pin.ball[1] ** 2 * turn, np.cross(turn, arm)])
    assert abs(seen.covariance @ free).max() < 1e-15 and seen.rotation[1] < 1.0
    beside = predict(pin, Pose(pose.rotation, pose.translation + [2.0, 0.0, 0.0]), RIG)
    assert beside.measured == 0 and beside.position[0] > 0.1 * pin.ball[1] and beside.rotation[0] > 10.0


def test_a_camera_as_it_was_measured_is_read_and_anything_else_is_refused(tmp_path):
    file = tmp_path / 'camera.json'
    file.write_text('{"noise": 3.5, "read_noise": 1, "gain": 0.1, "psf": 0.8}')
    assert read_sensor(file) == Sensor(1.0, 0.8, 0.1)
    file.write_text('{"noise": 3.5, "read_noise": null, "gain": null, "psf": 0.8}')
    assert read_sensor(file) == Sensor(3.5, 0.8)
    for text, problem in (
        ('{"noise": 3.5}', 'psf'),
        ('[]', 'object'),
        ('{', 'JSON'),
        ('{"noise":-1,"psf":0}', 'noise'),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=f'camera.json: .*{problem}'):
            read_sensor(file)


def test_unknown_faults_of_lines_and_cameras_are_eliminated_as_a_dense_solution_does_it(l_shape):
    """The same information as of the normal equations of pose, lines and cameras, all at once."""
    rig = PlannedRig(RIG.pair, sensor=RIG.sensor, outline_px=0.1, calibration_px=0.3)
    pose = VOLUME.views(4, rig, l_shape.ball)[1]
    seen = predict(l_shape, pose, rig)
    placed, weight = _in_pieces(seen.sight.placed), seen.weight
    line = np.stack([np.ones(len(weight)), placed.abscissa], axis=1)
    columns, sigmas = [placed.slope[:, :6]], [np.full(6, np.inf)]
    for number, drawn in ((placed.curve, DRAWN_LINE_PX), (placed.group, DRAWN_VIEW_PX)):
        of_line = (number[:, None] == np.arange(number.max() + 1))[:, :, None] * line[:, None]
        columns += [of_line.reshape(len(weight), -1)]
        sigmas += [np.full(columns[-1].shape[1], np.hypot(0.1, drawn))]
    off = (placed.pixel - [rig.pair.right.cx, rig.pair.right.cy]) * (placed.eye == 1)[:, None] / 160.0
    normal = placed.normal * (placed.eye == 1)[:, None]
    turned = normal[:, 1] * off[:, 0] - normal[:, 0] * off[:, 1]
    columns += [normal, np.stack([turned, (normal * off).sum(axis=1)], axis=1)]
    sigmas += [np.full(4, 0.3)]
    rows = np.hstack(columns)
    whole = (rows * weight[:, None]).T @ rows + np.diag(1.0 / np.square(np.concatenate(sigmas)))
    expected = np.linalg.inv(np.linalg.inv(whole)[:6, :6])
    assert np.allclose(_information(placed, weight, rig), expected, rtol=1e-5, atol=1e-6 * np.trace(expected))
