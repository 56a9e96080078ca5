"""What an integrator relies on: simulated time, remaps, QoS overrides, floods of input, diagnostics that add up."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

import csg_renderer
from csg_renderer.node import RendererNode
from model_matcher.node import MatcherNode
from msgs_py import PinholeCamera, StereoRig, codecs
from msgs_py.runtime import STEREO_TOPICS
from stereo_recovery.node import RecoveryNode


def header(sec: int) -> Header:
    result = Header(frame_id='cam_left_optical_frame')
    result.stamp.sec = sec
    return result


@pytest.fixture(scope='module')
def frames():
    scene = csg_renderer.load_scene('l_shape_v1')
    rig = StereoRig.symmetric(PinholeCamera.centred(128, 128, 176.0), csg_renderer.default_rig(scene).baseline)
    return rig, [codecs.gray_from_image(codecs.array_to_image(frame.image, 'rgb8'))
                 for frame in csg_renderer.render_stereo(scene, rig, antialias=2)]


def test_simulated_time_stamps_the_images_and_diagnostics_go_on_when_it_stands_still(graph):
    node = graph.add(RendererNode, parameters={'rate': 0.0, 'use_sim_time': True, 'width': 64, 'antialias': 0})
    images = graph.collect(Image, 'left/image_rect')
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    clock = graph.publisher(Clock, '/clock')
    graph.wait_matched(clock)
    graph.wait_heard('/left/image_rect')
    message = Clock()
    message.clock.sec = 1234
    clock.publish(message)
    graph.spin_until(lambda: node.get_clock().now().nanoseconds == 1234 * 10**9, what='the simulated time')
    assert graph.call(Trigger, '/renderer_node/render', Trigger.Request()).success
    graph.spin_until(lambda: images)
    assert (images[0].header.stamp.sec, images[0].header.stamp.nanosec) == (1234, 0)
    count = len(statuses)
    graph.spin_until(lambda: len(statuses) >= count + 2, what='diagnostics without the clock')


def test_topics_are_remapped_and_namespaces_apply_to_all_of_them(graph):
    node = graph.add(MatcherNode, parameters={'models': ['l_shape']}, namespace='arm', cli_args=[
        '--ros-args', '-r', 'features:=/shared/features', '-r', 'interpretations/l_shape:=part_pose'])
    assert [s.topic_name for s in node.subscriptions if 'features' in s.topic_name] == ['/shared/features']
    published = {p.topic_name for p in node.publishers}
    assert {'/arm/part_pose', '/arm/interpretations', '/diagnostics'} <= published


def test_quality_of_service_is_overridden_by_parameters(graph):
    node = graph.add(MatcherNode, parameters={
        'models': ['l_shape'], 'qos_overrides./features.subscription.reliability': 'reliable',
        'qos_overrides./features.subscription.depth': 7})
    subscription = next(s for s in node.subscriptions if s.topic_name == '/features')
    assert subscription.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
    assert subscription.qos_profile.depth == 7


def test_ten_times_too_many_pairs_are_answered_with_the_newest_and_the_rest_is_counted(graph, frames):
    rig, images = frames
    node = graph.add(RecoveryNode)
    clouds = graph.collect(PointCloud2, 'features')
    outputs = {topic: graph.publisher(CameraInfo if topic.endswith('info') else Image, topic)
               for topic in STEREO_TOPICS}
    graph.wait_matched(*outputs.values())
    graph.wait_heard('/features')
    sent = 0
    for burst in (1, *[10] * 6):  # what was published before a node came to hear anything is not its loss
        for _ in range(burst):  # the node is busy with the last ones
            sent += 1
            stamp = header(sent)
            infos = codecs.camera_infos_from_rig(rig, stamp)
            for topic, message in zip(STEREO_TOPICS, (codecs.array_to_image(images[0], 'mono8', stamp), infos[0],
                                                      codecs.array_to_image(images[1], 'mono8', stamp), infos[1])):
                outputs[topic].publish(message)
        graph.spin_until(lambda newest=sent: clouds and clouds[-1].header.stamp.sec == newest, what='the newest pair')
    stamps = [cloud.header.stamp.sec for cloud in clouds]
    assert stamps == sorted(set(stamps)), 'in order, none twice'
    heard = sum(node._received.values())
    assert heard + node.health.lost == 4 * sent, 'what was not heard is counted'
    sync = node._sync.counters
    waiting = sum(len(messages) for _, messages in node._sync._pending)
    assert 4 * sync.sets + sync.unmatched + sync.late + waiting == heard
    assert node.health.processed == sync.sets == len(clouds)
