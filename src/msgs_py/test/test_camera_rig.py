"""Rigs of any number of cameras: where they stand, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig

CAMERA = PinholeCamera(640, 480, 700.0, 710.0, 300.0, 250.0)
PAIR = StereoRig.symmetric(CAMERA, 0.12)
UP = Pose(translation=np.array([0.0, -0.1, 0.0]))


def info(tx: float = 0.0, ty: float = 0.0, **changed) -> SimpleNamespace:
    p = [700.0, 0.0, 300.0, -700.0 * tx, 0.0, 710.0, 250.0, -710.0 * ty, 0.0, 0.0, 1.0, 0.0]
    return SimpleNamespace(**{'width': 640, 'height': 480, 'p': p, **changed})


def test_a_pair_is_a_rig_of_two():
    rig = CameraRig.from_stereo(PAIR)
    point = np.array([0.1, 0.05, 0.8])
    for ours, pairs in zip(rig.project(point), PAIR.project(point)):
        np.testing.assert_allclose(ours, pairs, atol=1e-9)
    assert len(rig) == 2 and rig.poses[1].translation[0] == PAIR.baseline


def test_parallel_cameras_stand_where_their_camera_info_says():
    rig = CameraRig.from_camera_info([info(), info(0.12), info(0.06, -0.1)])
    np.testing.assert_allclose([pose.translation for pose in rig.poses], [[0, 0, 0], [0.12, 0, 0], [0.06, -0.1, 0]])
    # A camera above another shows what both see farther down.
    first, _, above = rig.project([0.0, 0.0, 1.0])
    assert above[1] > first[1]


def test_poses_from_elsewhere_take_the_place_of_what_camera_info_says():
    turned = Pose.from_rotation_vector([0.1, 0.2, 0.3], [0.1, 0.2, 0.3])
    rig = CameraRig.from_camera_info([info(), info()], [Pose.identity(), turned])
    assert rig.poses[1] == turned


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: CameraRig([CAMERA], [Pose.identity()]), 'cameras: expected two or more, got 1'),
        (lambda: CameraRig([CAMERA] * 3, [Pose.identity(), UP]), 'poses: expected one for each of 3 cameras, got 2'),
        (lambda: CameraRig([CAMERA] * 2, [Pose.identity(), None]), 'poses: camera 1 has no pose'),
        (lambda: CameraRig([CAMERA, 'camera'], [Pose.identity(), UP]), 'cameras: camera 1 is a str'),
        (lambda: CameraRig([CAMERA] * 2, [UP, Pose.identity()]), 'poses: that of camera 0 is .* expected the identity'),
        (lambda: CameraRig([CAMERA] * 3, [Pose.identity(), UP, UP]), 'poses: cameras 1 and 2 stand at one place'),
        (
            lambda: CameraRig([CAMERA] * 2, [Pose.identity(), Pose(translation=UP.translation, scale=2.0)]),
            'poses: that of camera 1 has scale 2, expected 1',
        ),
        (lambda: CameraRig.from_camera_info([info(), info()]), r'camera_1 camera_info: P\[0,3\] .* has no pose'),
        (lambda: CameraRig.from_camera_info([info(0.1), info()]), 'camera_0 camera_info: .* expected 0'),
        (lambda: CameraRig.from_camera_info([info(), info(0.1, p=[1.0])]), 'camera_1 camera_info: P has 1 elements'),
    ],
)
def test_what_is_no_rig_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
