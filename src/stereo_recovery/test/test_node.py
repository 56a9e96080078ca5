"""recovery_node alone: what goes in and out of its topics."""

from __future__ import annotations

import os
import time

import cv2
import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image, PointCloud2  # noqa: E402
from std_msgs.msg import Header  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig  # noqa: E402
from msgs_py.codecs import array_to_image, camera_infos_from_rig, cloud_to_features, image_to_array  # noqa: E402
from stereo_recovery import recover  # noqa: E402
from stereo_recovery.node import RecoveryConfig, RecoveryNode  # noqa: E402

RIG = StereoRig.symmetric(PinholeCamera.centred(256, 256, 350.0), 0.05)


class Bench:
    """The node, a tester that feeds it, and what it published."""

    def __init__(self, **parameters) -> None:
        self.context = Context()
        worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0')[2:])
        rclpy.init(context=self.context, domain_id=101 + worker)
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.node = RecoveryNode(context=self.context, parameter_overrides=overrides)
        self.tester = Node('tester', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.node, self.tester):
            self.executor.add_node(node)
        self.out = {
            topic: self._collect(kind, topic)
            for kind, topic in ((PointCloud2, 'features'), (MarkerArray, 'features/markers'), (Image, 'debug_image'))
        }
        count = parameters.get('cameras', 2)
        self.sources = [
            self.tester.create_publisher(kind, f'{side}/{name}', 10)
            for side in (('left', 'right') if count == 2 else (f'camera_{k}' for k in range(count)))
            for kind, name in ((Image, 'image_rect'), (CameraInfo, 'camera_info'))
        ]
        self.until(
            lambda: (
                all(s.get_subscription_count() for s in self.sources)
                and self.node.features_out.get_subscription_count()
                and self.node.debug_out.get_subscription_count()
            )
        )

    def _collect(self, kind, topic) -> list:
        received: list = []
        self.tester.create_subscription(kind, topic, received.append, 10)
        return received

    def until(self, predicate, seconds: float = 20.0) -> None:
        deadline = time.monotonic() + seconds
        while not predicate():
            assert time.monotonic() < deadline, self.node.health.last_error
            self.executor.spin_once(timeout_sec=0.02)

    def send(self, left, right, rig, sec: int, encoding: str = 'mono8', infos=None) -> Header:
        header = Header(frame_id='left_optical')
        header.stamp.sec = sec
        infos = infos or camera_infos_from_rig(rig, header)
        for info in infos:
            info.header = header
        messages = [array_to_image(left, encoding, header), infos[0], array_to_image(right, encoding, header), infos[1]]
        for source, message in zip(self.sources, messages):
            source.publish(message)
        return header

    def send_all(self, images, infos, sec: int) -> Header:
        header = Header(frame_id='first_optical')
        header.stamp.sec = sec
        for k, (image, info) in enumerate(zip(images, infos)):
            info.header = header
            self.sources[2 * k].publish(array_to_image(image, 'mono8', header))
            self.sources[2 * k + 1].publish(info)
        return header

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.tester.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def bench():
    made = []

    def make(**parameters) -> Bench:
        made.append(Bench(**parameters))
        return made[-1]

    yield make
    for item in made:
        item.close()


@pytest.fixture(scope='module')
def pair(synthetic, solids):
    solid = solids['wedge'].at(Pose.from_rotation_vector([-0.6, 0.5, 0.4], [0.025, 0, 0.25]))
    return synthetic.render_pair(solid, RIG)


def test_node_says_what_the_library_says_in_the_inputs_frame(bench, pair):
    b = bench()
    header = b.send(*pair, RIG, 7)
    b.until(lambda: all(b.out.values()))
    message = b.out['features'][0]
    assert message.header == header
    expected = recover(*pair, RIG).features
    found = cloud_to_features(message)
    assert len(found) == len(expected) > 3
    assert np.allclose(found.start, expected.start, atol=1e-6)
    picture, encoding = image_to_array(b.out['debug_image'][0])
    assert picture.shape == (256, 256, 3) and encoding == 'rgb8'
    assert b.out['debug_image'][0].header == header
    assert len(b.out['features/markers'][0].markers) >= 1


def test_colour_and_raw_images_are_understood(bench, pair):
    b = bench(rectify=True)
    b.send(*(np.dstack([image] * 3) for image in pair), RIG, 1, 'bgr8')
    b.until(lambda: b.out['features'])
    expected = recover(*pair, RIG).features
    found = cloud_to_features(b.out['features'][0])
    # Identity maps: Lanczos at whole pixels changes nothing but the border.
    assert len(found) == len(expected)


def test_nothing_found_is_an_empty_cloud_and_a_reason(bench):
    b = bench()
    blank = np.full((256, 256), 90, np.uint8)
    header = b.send(blank, blank, RIG, 3)
    b.until(lambda: b.out['features'])
    assert b.out['features'][0].header == header
    assert len(cloud_to_features(b.out['features'][0])) == 0
    assert 'no texture' in b.node.health.last_error
    assert 'no texture' in str(b.node.report_values()['reason'])


def test_unusable_camera_info_is_reported_and_the_node_lives(bench, pair):
    b = bench()
    infos = camera_infos_from_rig(RIG, None)
    infos[1].p[3] = 0.0
    b.send(*pair, RIG, 1, infos=infos)
    b.until(lambda: b.node.health.dropped == 1)
    assert 'baseline' in b.node.health.last_error
    b.send(cv2.resize(pair[0], (64, 64)), pair[1], RIG, 2)
    b.until(lambda: b.node.health.dropped == 2)
    assert '64 x 64' in b.node.health.last_error
    b.send(*pair, RIG, 3)
    b.until(lambda: b.out['features'])


ABOVE = Pose(translation=np.array([0.02, -0.045, 0.0]))
TURNED = Pose.from_rotation_vector([-0.16, 0.03, 0.05], [0.02, -0.045, 0.002])


@pytest.fixture(scope='module')
def wedge(solids):
    return solids['wedge'].at(Pose.from_rotation_vector([-0.6, 0.5, 0.4], [0.025, 0, 0.25]))


def third(synthetic, wedge, pose: Pose) -> np.ndarray:
    return synthetic.render(wedge.at(pose.inverse()), RIG.left, seed=5)


def infos_of(x: float, y: float) -> list[CameraInfo]:
    """Of the pair, and of a third camera at (x, y)."""
    infos = [*camera_infos_from_rig(RIG, None), camera_infos_from_rig(RIG, None)[0]]
    infos[2].p[3], infos[2].p[7] = -RIG.left.fx * x, -RIG.left.fy * y
    return infos


def test_three_cameras_are_heard_together_and_stand_where_camera_info_says(bench, synthetic, wedge, pair):
    b = bench(cameras=3)
    images = [*pair, third(synthetic, wedge, ABOVE)]
    header = b.send_all(images, infos_of(*ABOVE.translation[:2]), 7)
    b.until(lambda: all(b.out.values()))
    rig = CameraRig([RIG.left] * 3, [*CameraRig.from_stereo(RIG).poses, ABOVE])
    expected = recover(images, rig).features
    found = cloud_to_features(b.out['features'][0])
    assert b.out['features'][0].header == b.out['debug_image'][0].header == header
    assert len(found) == len(expected) > 3
    assert np.allclose(found.start, expected.start, atol=1e-6)
    assert int(b.node.report_values()['matches of camera 2']) > 3


def test_a_calibration_file_says_where_cameras_stand_that_are_not_parallel(bench, synthetic, wedge, pair, tmp_path):
    places = [*CameraRig.from_stereo(RIG).poses, TURNED]
    k = RIG.left.matrix.tolist()
    back = [pose.inverse() for pose in places]
    file = tmp_path / 'rig.yaml'
    file.write_text(str({'cameras': [{'K': k, 'R': p.rotation.tolist(), 't': p.translation.tolist()} for p in back]}))
    b = bench(cameras=3, calibration=str(file), rectify=True)
    images = [*pair, third(synthetic, wedge, TURNED)]
    b.send_all(images, infos_of(0.0, 0.0), 7)
    b.until(lambda: b.out['features'])
    expected = recover(images, CameraRig([RIG.left] * 3, places)).features
    found = cloud_to_features(b.out['features'][0])
    assert len(found) == len(expected) > 3
    # Maps of cameras without distortion change nothing but the border.
    assert np.allclose(found.start, expected.start, atol=1e-4)


def test_what_is_wrong_with_three_cameras_is_named_once_and_the_node_lives(bench, synthetic, wedge, pair, tmp_path):
    b = bench(cameras=3)
    images = [*pair, third(synthetic, wedge, ABOVE)]
    b.send_all(images, infos_of(0.0, 0.0), 1)
    b.until(lambda: b.node.health.dropped == 1)
    assert 'camera_2 camera_info: P[0,3] and P[1,3] are 0' in b.node.health.last_error
    b.send_all([*images[:2], images[2][:64]], infos_of(*ABOVE.translation[:2]), 2)
    b.until(lambda: b.node.health.dropped == 2)
    assert 'images[2]: image is 256 x 64' in b.node.health.last_error
    b.send_all(images, infos_of(*ABOVE.translation[:2]), 3)
    b.until(lambda: b.out['features'])


def test_a_calibration_file_for_other_cameras_is_named(bench, pair, tmp_path):
    file = tmp_path / 'pair.json'
    file.write_text('{"K": [[350, 0, 127.5], [0, 350, 127.5], [0, 0, 1]], "baseline": 0.05}')
    b = bench(cameras=3, calibration=str(file))
    b.send_all([*pair, pair[0]], infos_of(0.0, 0.0), 1)
    b.until(lambda: b.node.health.dropped == 1)
    assert 'parameter calibration: ' in b.node.health.last_error
    assert 'pair.json: has 2 cameras, expected 3' in b.node.health.last_error
    with pytest.raises(ValueError, match='parameter calibration: of two cameras'):
        RecoveryConfig(calibration=str(file))


def test_parameters_are_checked_before_they_are_used(bench):
    b = bench(sigma=1.0)
    refused = b.node.set_parameters([Parameter('sigma', value=99.0)])[0]
    assert not refused.successful and 'sigma' in refused.reason
    assert b.node.set_parameters([Parameter('sigma', value=1.5)])[0].successful
    assert b.node.config.params().sigma == 1.5
    with pytest.raises(ValueError, match='high'):
        RecoveryConfig(low=5.0, high=2.0)


def test_the_config_file_states_the_defaults():
    from importlib import resources

    import yaml

    text = (resources.files('stereo_recovery') / 'config' / 'recovery.yaml').read_text()
    assert yaml.safe_load(text)['/**']['ros__parameters'] == RecoveryConfig().as_parameters()
