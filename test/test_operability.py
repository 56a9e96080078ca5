"""What an integrator relies on: simulated time, remaps, QoS overrides, floods of input, diagnostics that add up."""

from __future__ import annotations

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

import csg_renderer
from csg_renderer.node import RendererNode
from model_matcher.node import MatcherNode
from msgs_py import PinholeCamera, StereoRig, codecs
from msgs_py.node_runtime.runtime import STEREO_TOPICS
from stereo_recovery import recover
from stereo_recovery.node import RecoveryNode


def header(sec: int) -> Header:
    result = Header(frame_id='cam_left_optical_frame')
    result.stamp.sec = sec
    return result


@pytest.fixture(scope='module')
def frames():
    scene = csg_renderer.load_scene('l_shape_v1')
    rig = StereoRig.symmetric(PinholeCamera.centred(128, 128, 176.0), csg_renderer.default_rig(scene).baseline)
    return rig, [
        codecs.gray_from_image(codecs.array_to_image(frame.image, 'rgb8'))
        for frame in csg_renderer.render_stereo(scene, rig, antialias=2)
    ]


def test_a_recovery_that_takes_long_holds_nothing_up(graph, frames, monkeypatch):
    """It is ended when parameters change, and the newest pair recovered by the new ones; a reset drops it."""
    rig, pictures = frames
    sigmas = []

    def endless(left, right, rig, params, deadline):
        sigmas.append(params.sigma)
        while params.sigma > 1.5 and not deadline.passed:
            time.sleep(0.001)
        return recover(left, right, rig, params)

    monkeypatch.setattr('stereo_recovery.node.recover', endless)
    node = graph.add(RecoveryNode, parameters={'sigma': 2.0})
    graph.spin_until(lambda: not node.compiling, 120.0)
    clouds = graph.collect(PointCloud2, 'features')
    outputs = {topic: graph.publisher(CameraInfo if 'info' in topic else Image, topic) for topic in STEREO_TOPICS}
    graph.wait_matched(*outputs.values())
    graph.wait_heard('/features')

    def send(second):
        infos = codecs.camera_infos_from_rig(rig, header(second))
        images = [codecs.array_to_image(picture, 'mono8', header(second)) for picture in pictures]
        for topic, message in zip(STEREO_TOPICS, (images[0], infos[0], images[1], infos[1])):
            outputs[topic].publish(message)

    def set_sigma(value):
        request = SetParametersAtomically.Request(parameters=[Parameter('sigma', value=value).to_parameter_msg()])
        answer = graph.call(SetParametersAtomically, '/recovery_node/set_parameters_atomically', request)
        assert answer.result.successful

    send(1)
    graph.spin_until(lambda: sigmas)
    send(2)
    graph.spin_until(lambda: node._work._newest is not None)
    set_sigma(1.0)
    graph.spin_until(lambda: clouds)
    assert [cloud.header.stamp.sec for cloud in clouds] == [2] and sigmas == [2.0, 1.0]
    set_sigma(2.0)
    send(3)
    graph.spin_until(lambda: len(sigmas) == 3)
    assert graph.call(Trigger, '/recovery_node/reset', Trigger.Request()).success
    set_sigma(1.0)
    send(4)
    graph.spin_until(lambda: len(clouds) == 2)
    assert clouds[1].header.stamp.sec == 4 and sigmas[2:] == [2.0, 1.0]


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


def test_a_simulated_clock_that_jumps_back_stops_nothing(graph, frames):
    """A bag that is played in a loop, or a simulation that is reset."""
    renderer = graph.add(RendererNode, parameters={'rate': 2.0, 'use_sim_time': True, 'width': 128, 'antialias': 2})
    recovery = graph.add(RecoveryNode, parameters={'use_sim_time': True})
    clouds = graph.collect(PointCloud2, 'features')
    clock = graph.publisher(Clock, '/clock')
    graph.wait_matched(clock, count=2)
    graph.wait_heard('/features', *(f'/{topic}' for topic in STEREO_TOPICS))

    def play(first: int, seconds: int) -> list[int]:
        del clouds[:]
        for tenth in range(10 * first, 10 * (first + seconds) + 1):
            message = Clock()
            message.clock.sec, message.clock.nanosec = tenth // 10, tenth % 10 * 10**8
            clock.publish(message)
            graph.spin_until(
                lambda now=tenth: all(
                    node.get_clock().now().nanoseconds == now * 10**8 for node in (renderer, recovery)
                ),
                what='the simulated time',
            )
            graph.executor.spin_once(timeout_sec=0.01)
            graph.spin_until(
                lambda: renderer._picture is None and recovery.health.processed >= renderer.report_values()['pairs'],
                what='the pair rendered and recovered',
            )
        return [cloud.header.stamp.sec for cloud in clouds]

    before, after = play(1000, 3), play(7, 3)
    after = [sec for sec in after if sec < 1000]  # the last pair from before may still have been on its way
    assert len(before) >= 3 and min(before) >= 1000 and len(after) >= 3 and all(7 <= sec <= 10 for sec in after)
    assert renderer.health.problems == 0 and recovery.health.problems == 0


def test_a_real_source_takes_the_place_of_a_simulated_one_by_remaps_alone(graph):
    for space in ('simulated', 'camera'):
        graph.add(
            RendererNode,
            namespace=space,
            parameters={'rate': 5.0, 'width': 128, 'antialias': 2, 'frame_id': f'{space}_optical_frame'},
        )
    clouds = {}
    for space, source in (('one', 'simulated'), ('two', 'camera')):
        remaps = [item for topic in STEREO_TOPICS for item in ('-r', f'{topic}:=/{source}/{topic}')]
        graph.add(RecoveryNode, namespace=space, cli_args=['--ros-args', *remaps])
        clouds[source] = graph.collect(PointCloud2, f'/{space}/features')
    graph.spin_until(lambda: all(len(heard) >= 2 for heard in clouds.values()), what='features from both sources')
    for source, heard in clouds.items():
        assert {cloud.header.frame_id for cloud in heard} == {f'{source}_optical_frame'}


def test_topics_are_remapped_and_namespaces_apply_to_all_of_them(graph):
    node = graph.add(
        MatcherNode,
        parameters={'models': ['l_shape']},
        namespace='arm',
        cli_args=['--ros-args', '-r', 'features:=/shared/features', '-r', 'interpretations/l_shape:=part_pose'],
    )
    assert [s.topic_name for s in node.subscriptions if 'features' in s.topic_name] == ['/shared/features']
    published = {p.topic_name for p in node.publishers}
    assert {'/arm/part_pose', '/arm/interpretations', '/diagnostics'} <= published


def test_quality_of_service_is_overridden_by_parameters(graph):
    node = graph.add(
        MatcherNode,
        parameters={
            'models': ['l_shape'],
            'qos_overrides./features.subscription.reliability': 'reliable',
            'qos_overrides./features.subscription.depth': 7,
        },
    )
    subscription = next(s for s in node.subscriptions if s.topic_name == '/features')
    assert subscription.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
    assert subscription.qos_profile.depth == 7
    other = graph.add(MatcherNode, parameters={'models': ['l_shape']}, namespace='other')
    subscription = next(s for s in other.subscriptions if s.topic_name == '/other/features')
    assert subscription.qos_profile.depth == 2, 'the next node of the process has its own'


def test_ten_times_too_many_pairs_are_answered_with_the_newest_and_the_rest_is_counted(graph, frames):
    rig, images = frames
    node = graph.add(RecoveryNode)
    clouds = graph.collect(PointCloud2, 'features')
    outputs = {
        topic: graph.publisher(CameraInfo if topic.endswith('info') else Image, topic) for topic in STEREO_TOPICS
    }
    graph.wait_matched(*outputs.values())
    graph.wait_heard('/features')
    sent = 0
    for burst in (1, *[10] * 6):  # what was published before a node came to hear anything is not its loss
        for _ in range(burst):  # the node is busy with the last ones
            sent += 1
            stamp = header(sent)
            infos = codecs.camera_infos_from_rig(rig, stamp)
            for topic, message in zip(
                STEREO_TOPICS,
                (
                    codecs.array_to_image(images[0], 'mono8', stamp),
                    infos[0],
                    codecs.array_to_image(images[1], 'mono8', stamp),
                    infos[1],
                ),
            ):
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
