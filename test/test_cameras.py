"""Cameras as their drivers publish them: compressed, in any encoding, side by side, calibrated once."""

from __future__ import annotations

import array

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from csg_renderer import load_scene, render_stereo, scene_path
from model_matcher.node import MatcherNode
from model_matcher.tracker_node import TrackerNode
from msgs_py import PinholeCamera, StereoRig, codecs
from stereo_recovery import recover
from stereo_recovery.node import RecoveryNode

RIG = StereoRig.symmetric(PinholeCamera.centred(320, 320, 440.0), 0.03)
MODEL = 'l_shape_v1'
FRAME = 'left_optical'


@pytest.fixture(scope='module')
def pictures() -> tuple[np.ndarray, np.ndarray]:
    """A pair in colour, BGR."""
    frames = render_stereo(load_scene(scene_path(MODEL)), RIG, antialias=True)
    return tuple(np.ascontiguousarray(frame.image[..., ::-1]) for frame in frames)


def header(second: int) -> Header:
    found = Header(frame_id=FRAME)
    found.stamp.sec = second
    return found


def packed(ending: str, pixels: np.ndarray, form: str, at: Header) -> CompressedImage:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 95] if ending == '.jpg' else []
    data = cv2.imencode(ending, pixels, quality)[1].tobytes()
    return CompressedImage(header=at, format=form, data=array.array('B', data))


def deep(pixels: np.ndarray) -> np.ndarray:
    """The same in 16 bits."""
    return pixels.astype(np.uint16) * 257


def mosaic(colour: np.ndarray) -> np.ndarray:
    """BGR behind a filter in the order rggb."""
    out = colour[..., 1].copy()
    out[::2, ::2], out[1::2, 1::2] = colour[::2, ::2, 2], colour[1::2, 1::2, 0]
    return out


def grey(colour: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)


# How a camera of each kind publishes a picture.
RAW = {
    'mono16': lambda bgr, at: codecs.array_to_image(deep(grey(bgr)), 'mono16', at),
    'rgba8': lambda bgr, at: codecs.array_to_image(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGBA), 'rgba8', at),
    'bgr8': lambda bgr, at: codecs.array_to_image(bgr, 'bgr8', at),
    'mono8': lambda bgr, at: codecs.array_to_image(grey(bgr), 'mono8', at),
    'bayer_rggb8': lambda bgr, at: codecs.array_to_image(mosaic(bgr), 'bayer_rggb8', at),
    'bayer_rggb16': lambda bgr, at: codecs.array_to_image(deep(mosaic(bgr)), 'bayer_rggb16', at),
}
PACKED = {
    'jpeg': lambda bgr, at: packed('.jpg', bgr, 'bgr8; jpeg compressed bgr8', at),
    'png': lambda bgr, at: packed('.png', bgr, 'png', at),
    'png16': lambda bgr, at: packed('.png', deep(grey(bgr)), 'mono16; png compressed ', at),
    'bayer': lambda bgr, at: packed('.png', mosaic(bgr), 'bayer_rggb8; png compressed ', at),
}


NAMES = (('image_rect', 'image_raw'), ('camera_info', 'info'))


class Driver:
    """A stereo driver: topics of one transport, camera_info with each pair, or once and latched."""

    def __init__(self, graph, compressed: bool = False, latched: bool = False, side_by_side: bool = False) -> None:
        kind, ending = (CompressedImage, '/compressed') if compressed else (Image, '')
        sides = ('',) if side_by_side else ('left/', 'right/')
        self.images = [graph.publisher(kind, f'{side}image_rect{ending}') for side in sides]
        quality = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL) if latched else 10
        self.infos = [graph.publisher(CameraInfo, f'{side}/camera_info', quality) for side in ('left', 'right')]
        self.latched = latched
        if latched:
            self.calibrate(header(1))

    def calibrate(self, at: Header, rig: StereoRig = RIG) -> None:
        for publisher, info in zip(self.infos, codecs.camera_infos_from_rig(rig, at)):
            publisher.publish(info)

    def publish(self, *messages: Image | CompressedImage) -> None:
        for publisher, message in zip(self.images, messages):
            publisher.publish(message)
        if not self.latched:
            self.calibrate(messages[0].header)


def heard(graph, node_class, driver: Driver, *topics: str, **parameters) -> object:
    node = graph.add(node_class, parameters=parameters)
    graph.wait_heard(*topics)
    graph.wait_matched(*driver.images, *([] if driver.latched else driver.infos))
    return node


@pytest.mark.parametrize('compressed', [False, True], ids=['raw', 'compressed'])
def test_recovery_node_takes_every_encoding_and_names_a_broken_one(graph, pictures, compressed):
    """One node, one encoding after the other, a different one a side; each cut short gets one clear error."""
    driver = Driver(graph, compressed=compressed)
    clouds = graph.collect(PointCloud2, 'features')
    kinds = PACKED if compressed else RAW
    node = heard(graph, RecoveryNode, driver, '/features', image_transport='compressed' if compressed else 'raw')
    expected = len(recover(*map(grey, pictures), RIG).features)
    names = list(kinds)
    for second, (name, other) in enumerate(zip(names, [*names[1:], names[0]]), 1):
        at = header(2 * second)
        driver.publish(kinds[name](pictures[0], at), kinds[other](pictures[1], at))
        graph.spin_until(lambda n=second: len(clouds) == n, what=f'features of {name} and {other}')
        assert clouds[-1].header == at
        assert len(codecs.cloud_to_features(clouds[-1])) >= 0.7 * expected, f'{name} and {other}'
        at = header(2 * second + 1)
        broken = kinds[name](pictures[0], at)
        broken.data = broken.data[: len(broken.data) // 2]
        dropped = node.health.dropped
        driver.publish(broken, kinds[other](pictures[1], at))
        graph.spin_until(lambda n=dropped: node.health.dropped > n, what=f'the refusal of half a {name}')
        topic = 'left/image_rect/compressed' if compressed else 'left/image_rect'
        assert node.health.last_error.startswith(f'stereo pair: {topic}: image.data: ')
        assert len(clouds) == second


@pytest.mark.parametrize('late', [False, True], ids=['before', 'after'])
def test_a_calibration_published_once_holds_for_all_images(graph, pictures, late):
    """Latched, with a stamp of its own; the node comes before or after it was published."""
    node = graph.add(RecoveryNode) if late else None
    clouds = graph.collect(PointCloud2, 'features')
    driver = Driver(graph, latched=True)
    node = node or graph.add(RecoveryNode)
    graph.wait_heard('/features')
    graph.wait_matched(*driver.images)
    for second in range(100, 104):
        driver.publish(*(RAW['mono8'](picture, header(second)) for picture in pictures))
        graph.spin_until(lambda n=second: clouds and clouds[-1].header.stamp.sec == n, what='features')
    assert [cloud.header.stamp.sec for cloud in clouds] == [100, 101, 102, 103]
    assert len({len(codecs.cloud_to_features(cloud)) for cloud in clouds}) == 1
    # A new calibration holds from then on: twice the baseline, twice the depth.
    driver.calibrate(header(2), StereoRig(RIG.left, RIG.right, 2.0 * RIG.baseline))
    depth = codecs.cloud_to_features(clouds[-1]).midpoints[:, 2].mean()
    graph.spin_until(lambda: node._sync.last('left/camera_info').header.stamp.sec == 2, what='the calibration')
    graph.spin_until(lambda: node._sync.last('right/camera_info').header.stamp.sec == 2, what='the calibration')
    driver.publish(*(RAW['mono8'](picture, header(104)) for picture in pictures))
    graph.spin_until(lambda: clouds[-1].header.stamp.sec == 104, what='features')
    assert codecs.cloud_to_features(clouds[-1]).midpoints[:, 2].mean() == pytest.approx(2.0 * depth, rel=0.01)
    assert node.silence() is None


def test_a_pair_side_by_side_is_found_and_followed(graph, pictures):
    """One image of both, compressed, calibrated once: recovery_node, matcher_node and tracker_node."""
    clouds = graph.collect(PointCloud2, 'features')
    found = graph.collect(PoseArray, 'interpretations')
    tracked = graph.collect(PoseWithCovarianceStamped, 'tracked/l_shape')
    driver = Driver(graph, compressed=True, latched=True, side_by_side=True)
    given = {'image_transport': 'compressed', 'side_by_side': True}
    recovery = graph.add(RecoveryNode, parameters=given)
    matcher = graph.add(MatcherNode, parameters=given | {'models': [MODEL]})
    tracker = graph.add(TrackerNode, parameters=given | {'models': [MODEL]})
    graph.wait_heard('/features', '/interpretations', '/tracked/l_shape')
    graph.wait_matched(*driver.images, count=3)
    for second in range(1, 4):
        driver.publish(packed('.png', np.hstack(pictures), 'png', header(second)))
        graph.spin_until(lambda n=second: found and found[-1].header.stamp.sec == n, what='an interpretation')
    graph.spin_until(lambda: tracked, what='a pose that is tracked')
    assert len(codecs.cloud_to_features(clouds[-1])) > 8
    assert [node.health.dropped for node in (recovery, matcher, tracker)] == [0, 0, 0]
    assert matcher.report_values()['with_images'] > 0
    pose = codecs.pose_from_message(found[-1].poses[0])
    assert pose.error_to(codecs.pose_from_message(tracked[-1].pose.pose)).rotation_deg < 0.2


def test_an_image_that_has_no_halves_is_named(graph, pictures):
    driver = Driver(graph, side_by_side=True)
    node = heard(graph, RecoveryNode, driver, side_by_side=True)
    driver.publish(RAW['mono8'](np.hstack(pictures)[:, 1:], header(1)))
    graph.spin_until(lambda: node.health.dropped, what='the refusal')
    assert 'image_rect: image.width: 639, expected an even number' in node.health.last_error


def test_silence_names_the_transport_that_is_there(graph, pictures, monkeypatch):
    """Who publishes compressed images only, to a node that listens to raw ones, is told."""
    monkeypatch.setattr('msgs_py.node_runtime.runtime.SILENCE_S', 0.0)
    driver = Driver(graph, compressed=True)
    node = graph.add(RecoveryNode)
    graph.wait_matched(*driver.infos)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    driver.publish(*(PACKED['png'](picture, header(1)) for picture in pictures))
    graph.spin_until(
        lambda: any('image_transport' in status.message for m in statuses for status in m.status),
        what='the remedy in the diagnostics',
    )
    assert 'left/image_rect/compressed is published: set image_transport to compressed' in node.silence()


def test_remapping_a_topic_remaps_its_compressed_images(graph, pictures):
    """As for every image_transport; a namespace applies as well."""
    remaps = [f'{side}/{ours}:=/cam_{side}/{theirs}' for side in ('left', 'right') for ours, theirs in NAMES]
    arguments = ['--ros-args', *(item for remap in remaps for item in ('-r', remap))]
    clouds = graph.collect(PointCloud2, '/rig/features')
    images = [graph.publisher(CompressedImage, f'/cam_{side}/image_raw/compressed') for side in ('left', 'right')]
    infos = [graph.publisher(CameraInfo, f'/cam_{side}/info') for side in ('left', 'right')]
    graph.add(RecoveryNode, parameters={'image_transport': 'compressed'}, namespace='rig', cli_args=arguments)
    graph.wait_heard('/rig/features')
    graph.wait_matched(*images, *infos)
    at = header(1)
    for publisher, info in zip(infos, codecs.camera_infos_from_rig(RIG, at)):
        publisher.publish(info)
    for publisher, picture in zip(images, pictures):
        publisher.publish(PACKED['png'](picture, at))
    graph.spin_until(lambda: clouds, what='features')


def test_side_by_side_is_of_two_cameras(graph):
    node = graph.add(RecoveryNode, parameters={'cameras': 3, 'side_by_side': True})
    assert 'parameter side_by_side: is of two cameras, expected cameras to be 2, got 3' in node.health.last_error
