"""The graph in one process: real nodes, a real executor, real topics. From an image to a pose."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

import csg_renderer
from csg_renderer.node import RendererNode
from model_matcher import match
from model_matcher.node import MatcherNode
from msgs_py import FeatureSet, codecs
from stereo_recovery import recover
from stereo_recovery.node import RecoveryNode

SCENE = 'l_shape_v1'
RENDERER = {'scene': SCENE, 'rate': 0.0, 'antialias': 4, 'noise': 1.0}


@pytest.fixture(scope='module')
def scene():
    return csg_renderer.load_scene(csg_renderer.scene_path(SCENE))


@pytest.fixture(scope='module')
def rig(scene):
    return csg_renderer.default_rig(scene)


@pytest.fixture(scope='module')
def pair(scene, rig):
    """Grey left and right image, anti-aliased."""
    frames = csg_renderer.render_stereo(scene, rig, antialias=4)
    return tuple(codecs.gray_from_image(codecs.array_to_image(frame.image, 'rgb8')) for frame in frames)


def header(sec: int) -> Header:
    result = Header(frame_id='cam_left_optical_frame')
    result.stamp.sec = sec
    return result


class StereoSource:
    """Publishes a pair on the four topics, as a camera driver would."""

    def __init__(self, graph, rig):
        self.rig = rig
        self.images = [graph.publisher(Image, f'{side}/image_rect') for side in ('left', 'right')]
        self.infos = [graph.publisher(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')]
        graph.wait_matched(*self.images, *self.infos)

    def send(self, left, right, stamp_header):
        for publisher, image in zip(self.images, (left, right)):
            publisher.publish(codecs.array_to_image(image, 'mono8', stamp_header))
        for publisher, info in zip(self.infos, codecs.camera_infos_from_rig(self.rig, stamp_header)):
            publisher.publish(info)


def shoot(graph):
    answer = graph.call(Trigger, '/renderer_node/render', Trigger.Request())
    assert answer.success, answer.message


def test_from_scene_file_to_pose(graph, scene):
    graph.add(RendererNode, parameters=RENDERER)
    graph.add(RecoveryNode)
    graph.add(MatcherNode, parameters={'models': [SCENE]})
    name = next(iter(csg_renderer.load_models(csg_renderer.scene_path(SCENE))))
    poses = graph.collect(PoseStamped, f'interpretations/{name}')
    arrays = graph.collect(PoseArray, 'interpretations')
    lefts = graph.collect(Image, 'left/image_rect')
    truths = graph.collect(PoseStamped, 'ground_truth/pose')
    reports = graph.collect(DiagnosticArray, 'interpretations/report')
    graph.wait_heard(
        '/left/image_rect',
        '/left/camera_info',
        '/right/image_rect',
        '/right/camera_info',
        '/features',
        '/interpretations',
        f'/interpretations/{name}',
        '/interpretations/report',
        '/ground_truth/pose',
    )
    shoot(graph)
    graph.spin_until(lambda: poses and arrays and truths and reports, 40.0, 'a pose')
    assert poses[0].header == lefts[0].header == arrays[0].header == truths[0].header
    assert poses[0].header.frame_id.endswith('_left_optical_frame')
    found, true = codecs.pose_from_message(poses[0].pose), codecs.pose_from_message(truths[0].pose)
    assert true.error_to(scene.placements[0].pose).rotation < 1e-6
    error = true.error_to(found)
    assert error.rotation_deg < 0.5 and error.translation < 1e-3
    assert codecs.array_to_poses(arrays[0])[0] == found
    best = codecs.interpretations_from_report(reports[0])[0]
    assert best.accepted and best.model == name and best.matched >= 8


def test_recovery_node_alone_says_what_the_library_says(graph, pair, rig):
    graph.add(RecoveryNode)
    clouds = graph.collect(PointCloud2, 'features')
    source = StereoSource(graph, rig)
    graph.wait_heard('/features')
    source.send(*pair, header(7))
    graph.spin_until(lambda: clouds, what='features')
    assert clouds[0].header == header(7)
    sent_rig = codecs.rig_from_camera_infos(*codecs.camera_infos_from_rig(rig))
    assert codecs.cloud_to_features(clouds[0]) == recover(*pair, sent_rig).features


def test_matcher_node_alone_says_what_the_library_says(graph, pair, rig):
    data = recover(*pair, rig).features
    node = graph.add(MatcherNode, parameters={'models': [SCENE]})
    arrays = graph.collect(PoseArray, 'interpretations')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/interpretations')
    talk.publish(codecs.features_to_cloud(data, header(9)))
    graph.spin_until(lambda: arrays, what='interpretations')
    assert arrays[0].header == header(9)
    model = csg_renderer.model_features(csg_renderer.load_scene(csg_renderer.scene_path(SCENE)).placements[0].model)
    best = match(model, data, node.config.match_params()).interpretations[0].pose
    assert codecs.array_to_poses(arrays[0])[0].error_to(best).rotation < 1e-9


def test_matcher_node_answers_nothing_with_an_empty_array(graph):
    graph.add(MatcherNode, parameters={'models': [SCENE]})
    arrays = graph.collect(PoseArray, 'interpretations')
    reports = graph.collect(DiagnosticArray, 'interpretations/report')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/interpretations', '/interpretations/report')
    talk.publish(codecs.features_to_cloud(FeatureSet.empty(), header(3)))
    graph.spin_until(lambda: arrays and reports)
    assert arrays[0].poses == [] and arrays[0].header == header(3)


def test_renderer_node_alone_publishes_four_equal_stamps_and_the_truth_behind_them(graph, scene):
    graph.add(RendererNode, parameters=RENDERER | {'baseline': 0.03})
    images = {topic: graph.collect(Image, topic) for topic in ('left/image_rect', 'right/image_rect', 'left/depth')}
    infos = {topic: graph.collect(CameraInfo, topic) for topic in ('left/camera_info', 'right/camera_info')}
    features = graph.collect(PointCloud2, 'ground_truth/features')
    graph.wait_heard(*(f'/{topic}' for topic in (*images, *infos, 'ground_truth/features')))
    shoot(graph)
    graph.spin_until(lambda: all(images.values()) and all(infos.values()) and features)
    stamps = {str(messages[0].header.stamp) for messages in (*images.values(), *infos.values(), features)}
    assert len(stamps) == 1
    rig = codecs.rig_from_camera_infos(infos['left/camera_info'][0], infos['right/camera_info'][0])
    assert rig.baseline == pytest.approx(0.03) and infos['right/camera_info'][0].p[3] == -rig.left.fx * rig.baseline
    depth, encoding = codecs.image_to_array(images['left/depth'][0])
    frame = csg_renderer.render(scene, rig.left)
    assert encoding == '32FC1' and np.array_equal(depth, frame.depth, equal_nan=True)
    assert len(codecs.cloud_to_features(features[0])) >= 15
