"""A part seen by cameras with unequal focal lengths, a region of interest and binning: the pose is the same."""

import copy

import numpy as np
import pytest

import csg_renderer
from csg_renderer.raycast.sensor import grey
from model_matcher import match
from msgs_py import PinholeCamera, StereoRig
from msgs_py.codecs import camera_infos_from_rig
from stereo_recovery import recover
from stereo_recovery.cameras.rectification import Rectifier


@pytest.fixture(scope='module')
def seen():
    """Scene, rig and the grey images of an L-shape, by a camera with pixels that are no squares."""
    scene = csg_renderer.load_scene(csg_renderer.scene_path('l_shape_v1'))
    rig = StereoRig.symmetric(PinholeCamera(1024, 800, 1400.0, 1250.0, 505.0, 410.0), 0.03)
    frames = csg_renderer.render_stereo(scene, rig, antialias=3)
    return scene, rig, [grey(frame.image) for frame in frames]


def pose_of(scene, images, rig):
    result = recover(*images, rig)
    model = csg_renderer.model_features(scene.placements[0].model)
    best = match(model, result.features).best
    assert best is not None, result.reason
    return best.pose.error_to(scene.camera_T_scene.compose(scene.placements[0].pose))


def windowed(images, infos, x, y, width, height, binning):
    """What a camera sends that reads a part of its pixels and adds up blocks of them, and its messages."""
    infos = copy.deepcopy(infos)
    for info in infos:
        info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = x, y, width, height
        info.binning_x = info.binning_y = binning
    across, down = width // binning, height // binning
    parts = [image[y : y + down * binning, x : x + across * binning].astype(float) for image in images]
    blocks = [part.reshape(down, binning, across, binning).mean(axis=(1, 3)) for part in parts]
    return [np.round(block).astype(np.uint8) for block in blocks], infos


@pytest.mark.parametrize(
    ('window', 'binning'),
    [((0, 0, 1024, 800), 1), ((120, 90, 801, 651), 1), ((0, 0, 1024, 800), 2), ((101, 93, 830, 650), 2)],
)
def test_the_pose_does_not_depend_on_which_pixels_are_sent(seen, window, binning):
    scene, rig, images = seen
    sent, infos = windowed(images, camera_infos_from_rig(rig), *window, binning)
    error = pose_of(scene, sent, StereoRig.from_camera_info(*infos))
    assert error.rotation_deg < 0.1 * binning and error.translation < 1e-4 * binning, error


@pytest.mark.parametrize('binning', [1, 2])
def test_raw_images_of_a_window_are_rectified(seen, binning):
    """Without distortion a rectified image is the raw one."""
    scene, rig, images = seen
    sent, infos = windowed(images, camera_infos_from_rig(rig), 101, 93, 830, 650, binning)
    rectifier = Rectifier(*infos)
    straight = rectifier.apply(*sent)
    for one, other in zip(straight, sent):
        np.testing.assert_allclose(one.astype(int), other.astype(int), atol=1)
    infos[1].k[1] = 3.0
    with pytest.raises(ValueError, match=r'right camera_info: K\[0,1\] \(skew\) is 3, expected 0'):
        Rectifier(*infos)
