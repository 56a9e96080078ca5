"""Bad input: one clear error that names topic and field, the node alive, and the next good input processed."""

from __future__ import annotations

import array
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

import csg_renderer
from csg_renderer.node import RendererNode
from model_matcher import model_node
from model_matcher.node import MatcherNode
from msgs_py import FeatureSet, PinholeCamera, StereoRig, codecs
from stereo_recovery.node import RecoveryNode

RIG = StereoRig.symmetric(PinholeCamera.centred(96, 80, 130.0), 0.05)


def picture(seed: int = 0) -> np.ndarray:
    """A bright square on grey, with a little noise: enough to be recovered or not, as the node pleases."""
    image = np.full((80, 96), 60, np.uint8)
    image[20:60, 30:70] = 180
    return image + np.random.default_rng(seed).integers(0, 3, image.shape, dtype=np.uint8)


def header(sec: int) -> Header:
    result = Header(frame_id='cam_left_optical_frame')
    result.stamp.sec = sec
    return result


def stereo_messages(sec: int) -> dict[str, object]:
    left_info, right_info = codecs.camera_infos_from_rig(RIG, header(sec))
    return {
        'left/image_rect': codecs.array_to_image(picture(), 'mono8', header(sec)),
        'left/camera_info': left_info,
        'right/image_rect': codecs.array_to_image(np.roll(picture(1), -8, axis=1), 'mono8', header(sec)),
        'right/camera_info': right_info,
    }


def truncate(messages):
    messages['left/image_rect'].data = array.array('B', messages['left/image_rect'].data[:100])


def unknown_encoding(messages):
    messages['right/image_rect'].encoding = 'yuv422_yuy2'


def nan_camera(messages):
    messages['left/camera_info'].p[0] = float('nan')


def no_baseline(messages):
    messages['right/camera_info'].p[3] = 0.0


def exchanged_cameras(messages):
    messages['left/camera_info'], messages['right/camera_info'] = (
        messages['right/camera_info'],
        messages['left/camera_info'],
    )


def other_size(messages):
    messages['left/camera_info'].width = messages['right/camera_info'].width = 640


def uncalibrated(messages):
    for side in ('left', 'right'):
        stamp = messages[f'{side}/camera_info'].header
        messages[f'{side}/camera_info'] = CameraInfo(header=stamp, width=96, height=80)


@pytest.mark.parametrize(
    ('damage', 'words'),
    [
        (truncate, ('image.data', 'truncated')),
        (unknown_encoding, ('image.encoding', 'yuv422_yuy2')),
        (nan_camera, ('camera_info', 'NaN')),
        (no_baseline, ('camera_info', 'baseline')),
        (exchanged_cameras, ('camera_info', 'exchanged')),
        (other_size, ('640', '96')),
        (uncalibrated, ('camera_info', 'uncalibrated')),
    ],
)
def test_recovery_node_names_a_bad_pair_once_and_takes_the_next_good_one(graph, damage, words):
    node = graph.add(RecoveryNode)
    clouds = graph.collect(PointCloud2, 'features')
    outputs = {
        topic: graph.publisher(CameraInfo if topic.endswith('info') else Image, topic) for topic in stereo_messages(0)
    }
    graph.wait_matched(*outputs.values())
    graph.wait_heard('/features')

    def send(sec, change=None):
        messages = stereo_messages(sec)
        if change:
            change(messages)
        for topic, message in messages.items():
            outputs[topic].publish(message)

    send(1, damage)
    graph.spin_until(lambda: node.health.problems, what='a report')
    assert all(word in node.health.last_error for word in words), node.health.last_error
    send(2)
    graph.spin_until(lambda: any(cloud.header.stamp.sec == 2 for cloud in clouds), what='features of the good pair')
    assert node.health.problems == 1


@pytest.mark.parametrize(
    ('damage', 'words'),
    [
        (lambda cloud: setattr(cloud, 'data', cloud.data[:-8]), ('features.data', 'truncated')),
        (lambda cloud: setattr(cloud, 'fields', cloud.fields[:3]), ('features.fields', 'kind')),
        (lambda cloud: setattr(cloud, 'data', array.array('B', b'\xff' * len(cloud.data))), ('features.data',)),
    ],
)
def test_matcher_node_names_a_bad_cloud_and_takes_the_next_good_one(graph, damage, words):
    node = graph.add(MatcherNode, parameters={'models': ['l_shape']})
    arrays = graph.collect(PoseArray, 'interpretations')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/interpretations')
    cloud = codecs.features_to_cloud(FeatureSet.from_edges([[0, 0, 1]], [[0.1, 0, 1]]), header(1))
    damage(cloud)
    talk.publish(cloud)
    graph.spin_until(lambda: node.health.problems)
    assert all(word in node.health.last_error for word in words), node.health.last_error
    model = csg_renderer.model_features(csg_renderer.load_models(csg_renderer.scene_path('l_shape'))['l_shape'])
    talk.publish(codecs.features_to_cloud(model, header(2)))
    graph.spin_until(lambda: arrays, what='an answer to the good cloud')
    assert arrays[-1].header.stamp.sec == 2


def test_matcher_node_names_a_missing_model_and_keeps_the_others(graph, tmp_path):
    broken = tmp_path / 'broken.csg'
    broken.write_text('box = BLOCK(10, 20);\nDRAW (box)\n')
    node = graph.add(MatcherNode, parameters={'models': ['l_shape', str(tmp_path / 'gone.csg'), str(broken)]})
    assert 'l_shape' in node.report_values()['models']
    assert 'gone.csg' in node.report_values()['unusable_models']
    assert 'broken.csg:1:' in node.report_values()['unusable_models'], 'file, line and column'


def test_renderer_node_names_the_place_of_a_syntax_error_and_recovers(graph, tmp_path):
    path = tmp_path / 'scene.csg'
    path.write_text('UNITS MM;\nbox = BLOCK(10, 20, 30;\nDRAW (box) AT (0, 0, 200)\n')
    node = graph.add(RendererNode, parameters={'scene': str(path), 'rate': 0.0})
    assert 'scene.csg:2:' in node.health.last_error
    answer = graph.call(Trigger, '/renderer_node/render', Trigger.Request())
    assert not answer.success and 'scene.csg:2:' in answer.message
    path.write_text('UNITS MM;\nbox = BLOCK(10, 20, 30);\nDRAW (box) AT (0, 0, 200)\n')
    answer = graph.call(Trigger, '/renderer_node/render', Trigger.Request())
    assert answer.success, answer.message


@pytest.mark.parametrize(
    ('node_class', 'name', 'value', 'words'),
    [
        (RecoveryNode, 'no_such_parameter', 1.0, ('no_such_parameter',)),
        (RendererNode, 'encoding', 'jpeg', ('encoding', 'mono8')),
        (RendererNode, 'scene', 'no_such_scene', ('scene', 'no_such_scene')),
        (MatcherNode, 'search', 'guess', ('search', 'hypotheses')),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_with_the_reason(graph, node_class, name, value, words):
    node = graph.add(node_class)
    before = node.config
    kind = ParameterType.PARAMETER_STRING if isinstance(value, str) else ParameterType.PARAMETER_DOUBLE
    wrapped = ParameterValue(type=kind)
    setattr(wrapped, 'string_value' if isinstance(value, str) else 'double_value', value)
    reply = graph.call(
        SetParameters,
        f'/{node.get_name()}/set_parameters',
        SetParameters.Request(parameters=[Parameter(name=name, value=wrapped)]),
    )
    assert not reply.results[0].successful
    assert all(word in reply.results[0].reason for word in words), reply.results[0].reason
    assert node.config == before


def test_a_model_that_vanishes_is_reported_and_used_again_when_it_returns(graph, tmp_path):
    path = tmp_path / 'l_shape.csg'
    text = csg_renderer.scene_path('l_shape').read_text()
    path.write_text(text)
    node = graph.add(MatcherNode, parameters={'models': [str(path)]})
    arrays = graph.collect(PoseArray, 'interpretations')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/interpretations')
    model = csg_renderer.model_features(csg_renderer.load_models(path)['l_shape'])

    def answer(sec: int) -> PoseArray:
        node._looked_at -= 60.0  # as if the files had not been looked at for a minute
        talk.publish(codecs.features_to_cloud(model, header(sec)))
        return graph.spin_until(lambda: [a for a in arrays if a.header.stamp.sec == sec], what=f'answer {sec}')[0]

    assert answer(1).poses
    path.unlink()
    assert not answer(2).poses and 'l_shape.csg' in node.health.last_error
    path.write_text(text[: len(text) // 2])
    assert not answer(3).poses and 'l_shape.csg:' in node.health.last_error, 'half written: file, line and column'
    problems = node.health.problems
    assert not answer(4).poses and node.health.problems == problems, 'reported once'
    path.write_text(text)
    assert answer(5).poses


def test_a_model_put_into_the_folder_is_found(graph, tmp_path):
    node = graph.add(MatcherNode, parameters={'models': [str(tmp_path)]})
    assert node.report_values()['models'] == ''
    (tmp_path / 'l_shape.csg').write_text(csg_renderer.scene_path('l_shape').read_text())
    assert node._library.changed()


def test_broadcasting_without_tf2_is_refused_by_name(graph):
    if codecs.transform_message_type() is not None:
        pytest.skip('tf2_msgs is installed')
    node = graph.add(MatcherNode, parameters={'models': ['l_shape']})
    refused = node.set_parameters_atomically([rclpy.Parameter('tf', value=True)])
    assert not refused.successful and 'tf2_msgs' in refused.reason
    started = graph.add(MatcherNode, parameters={'models': ['l_shape'], 'tf': True}, namespace='other')
    assert 'tf2_msgs' in started.health.last_error


def test_poses_are_broadcast_when_asked_for(graph):
    messages = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs does not come with the wheels')
    graph.add(MatcherNode, parameters={'models': ['l_shape'], 'tf': True, 'tf_prefix': 'found/'})
    heard = graph.collect(messages.TFMessage, '/tf')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/tf')
    model = csg_renderer.model_features(csg_renderer.load_models(csg_renderer.scene_path('l_shape'))['l_shape'])
    talk.publish(codecs.features_to_cloud(model, header(1)))
    graph.spin_until(lambda: heard, what='a transform')
    assert heard[0].transforms[0].child_frame_id == 'found/l_shape' and heard[0].transforms[0].header == header(1)


def test_what_is_broadcast_with_a_stand_in_for_tf2(graph, monkeypatch):
    """tf2_msgs does not come with the wheels; its message holds a list of transforms and no more."""
    sent = []

    @dataclass
    class TFMessage:
        transforms: list

    class Broadcasting(MatcherNode):
        def create_publisher(self, kind, topic, *arguments, **options):
            if kind is TFMessage:
                assert topic == '/tf'
                return SimpleNamespace(publish=sent.append)
            return super().create_publisher(kind, topic, *arguments, **options)

        def destroy_publisher(self, publisher):
            return isinstance(publisher, SimpleNamespace) or super().destroy_publisher(publisher)

    monkeypatch.setattr(model_node, 'transform_message_type', lambda: TFMessage)
    node = graph.add(Broadcasting, parameters={'models': ['l_shape'], 'tf': True, 'tf_prefix': 'found/'})
    arrays = graph.collect(PoseArray, 'interpretations')
    talk = graph.publisher(PointCloud2, 'features')
    graph.wait_matched(talk)
    graph.wait_heard('/interpretations')
    model = csg_renderer.model_features(csg_renderer.load_models(csg_renderer.scene_path('l_shape'))['l_shape'])

    def answer(sec: int, features: FeatureSet) -> PoseArray:
        talk.publish(codecs.features_to_cloud(features, header(sec)))
        return graph.spin_until(lambda: [a for a in arrays if a.header.stamp.sec == sec], what=f'answer {sec}')[0]

    (pose,) = answer(1, model).poses[:1]
    (transform,) = sent[0].transforms
    assert transform.child_frame_id == 'found/l_shape' and transform.header == header(1)
    assert transform.transform.rotation == pose.orientation
    assert transform.transform.translation.x == pose.position.x
    answer(2, FeatureSet.empty())
    assert len(sent) == 1, 'nothing found, nothing broadcast: tf keeps no pose alive'
    assert node.set_parameters_atomically([rclpy.Parameter('tf', value=False)]).successful
    answer(3, model)
    assert len(sent) == 1
