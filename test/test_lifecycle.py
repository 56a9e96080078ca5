"""Every node as a managed one, through the services of lifecycle_msgs over real DDS."""

from __future__ import annotations

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from csg_renderer.node import RendererNode
from dap_emulator.node import EmulatorNode
from model_matcher.merger_node import MergerNode
from model_matcher.node import MatcherNode
from model_matcher.tracker_node import TrackerNode
from model_matcher.viewer_node import ViewerNode
from msgs_py import FeatureSet
from msgs_py.codecs import features_to_cloud
from stereo_recovery.node import RecoveryNode

# With each: parameters, a parameter that cannot be used, what is said of it, and what it hears when it is active.
NODES = {
    'renderer_node': (
        RendererNode,
        {'rate': 20.0, 'width': 64, 'scene': 'l_shape_v1'},
        {'scene': 'no_such'},
        'no_such',
        (),
    ),
    'recovery_node': (
        RecoveryNode,
        {'sigma': 1.0},
        {'sigma': -1.0},
        'sigma',
        ('/left/image_rect', '/right/camera_info'),
    ),
    'matcher_node': (MatcherNode, {'models': ['l_shape']}, {'models': ['no_such']}, 'no_such', ('/features',)),
    'tracker_node': (
        TrackerNode,
        {'models': ['l_shape']},
        {},
        'models is empty',
        ('/left/image_rect', '/track/l_shape'),
    ),
    'merger_node': (
        MergerNode,
        {'models': ['l_shape']},
        {'models': ['no_such']},
        'no_such',
        ('/shard_1/interpretations/report', '/shard_2/interpretations/report'),
    ),
    'emulator_node': (
        EmulatorNode,
        {'image_program': 'sobel'},
        {'image_program': 'no_such'},
        'no_such',
        ('/image_in',),
    ),
}
# It publishes nothing, and ends when its port is taken.
VIEWER = {'viewer_node': (ViewerNode, {'port': 0}, {}, '', ('/left/image_rect', '/features'))}
LED = NODES | VIEWER
STEPS = (
    ('configure', 'inactive'),
    ('activate', 'active'),
    ('deactivate', 'inactive'),
    ('activate', 'active'),
    ('deactivate', 'inactive'),
    ('cleanup', 'unconfigured'),
    ('configure', 'inactive'),
    ('activate', 'active'),
)


def add(graph, name, parameters):
    return graph.add(LED[name][0], parameters={'autostart': False, **parameters})


def state(graph, name):
    return graph.call(GetState, f'/{name}/get_state', GetState.Request()).current_state.label


def change(graph, name, label):
    request = ChangeState.Request(transition=Transition(label=label))
    return graph.call(ChangeState, f'/{name}/change_state', request).success


def hears(graph, topics):
    return [topic for topic in topics if graph.tester.count_subscribers(topic)] == list(topics)


@pytest.mark.parametrize('name', LED)
def test_a_manager_leads_a_node_through_its_life(graph, name):
    _, parameters, _, _, topics = LED[name]
    node = add(graph, name, parameters)
    assert state(graph, name) == 'unconfigured' and not hears(graph, topics or ('/none',))
    outputs = len(list(node.publishers))
    for label, after in STEPS:
        assert change(graph, name, label), (label, node.health.last_error)
        assert state(graph, name) == after
        graph.spin_until(
            lambda after=after: after != 'active' or hears(graph, topics), what=f'{name} hears {topics} when {after}'
        )
        graph.spin_until(
            lambda after=after: after == 'active' or not any(map(graph.tester.count_subscribers, topics)),
            what=f'{name} hears nothing when {after}',
        )
        assert (len(list(node.publishers)) > outputs) == (after != 'unconfigured' and name not in VIEWER)
    assert graph.call(Trigger, f'/{name}/reset', Trigger.Request()).success
    assert change(graph, name, 'shutdown')
    assert state(graph, name) == 'finalized' and len(list(node.publishers)) == outputs


@pytest.mark.parametrize('name', NODES)
def test_what_cannot_be_configured_says_why_and_can_be_set_right(graph, name):
    _, parameters, bad, words, _ = NODES[name]
    node = add(graph, name, bad)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    assert not change(graph, name, 'configure')
    assert state(graph, name) == 'unconfigured'
    assert words in node.health.last_error

    def told():
        return [s for m in statuses for s in m.status if s.name == f'/{name}' and words in s.message]

    status = graph.spin_until(told)[-1]
    assert status.level == DiagnosticStatus.WARN and status.message.startswith('unconfigured: ')
    given = [Parameter(key, value=value).to_parameter_msg() for key, value in parameters.items()]
    request = SetParametersAtomically.Request(parameters=given)
    assert graph.call(SetParametersAtomically, f'/{name}/set_parameters_atomically', request).result.successful
    assert change(graph, name, 'configure'), node.health.last_error
    assert state(graph, name) == 'inactive'


def test_what_the_state_does_not_allow_is_answered_and_reported(graph):
    node = add(graph, 'matcher_node', {'models': ['l_shape']})
    assert not change(graph, 'matcher_node', 'activate') and 'activate' in node.health.last_error
    assert not change(graph, 'matcher_node', 'no_such_transition')
    wrong = ChangeState.Request(transition=Transition(id=213))
    assert not graph.call(ChangeState, '/matcher_node/change_state', wrong).success
    service = '/matcher_node/get_available_transitions'
    offered = graph.call(GetAvailableTransitions, service, GetAvailableTransitions.Request()).available_transitions
    assert {one.transition.label for one in offered} == {'configure', 'shutdown'}


def test_nothing_is_published_but_by_an_active_node(graph):
    add(graph, 'renderer_node', NODES['renderer_node'][1])
    images = graph.collect(Image, '/left/image_rect')
    assert change(graph, 'renderer_node', 'configure')
    refused = graph.call(Trigger, '/renderer_node/render', Trigger.Request())
    assert not refused.success and 'inactive' in refused.message and not images
    assert change(graph, 'renderer_node', 'activate')
    graph.spin_until(lambda: len(images) > 2)
    assert change(graph, 'renderer_node', 'deactivate')
    count, end = len(images), time.monotonic() + 0.5
    graph.spin_until(lambda: time.monotonic() > end)
    assert len(images) <= count + 1  # one may have been on its way
    assert change(graph, 'renderer_node', 'activate')
    graph.spin_until(lambda: len(images) > count + 2)


def test_a_matcher_is_deaf_while_inactive_and_nothing_old_is_answered_later(graph):
    node = add(graph, 'matcher_node', {'models': ['l_shape']})
    latched = graph.collect(String, '/interpretations/symmetries')
    features = graph.publisher(PointCloud2, '/features')
    assert change(graph, 'matcher_node', 'configure') and change(graph, 'matcher_node', 'activate')
    graph.wait_matched(features)
    graph.spin_until(lambda: latched)

    def send(second):
        header = Header(frame_id='left_optical')
        header.stamp.sec = second
        features.publish(features_to_cloud(FeatureSet.empty(), header))

    send(1)
    graph.spin_until(lambda: node.health.processed == 1)
    assert change(graph, 'matcher_node', 'deactivate')
    send(2)
    graph.spin_until(lambda: features.get_subscription_count() == 0)
    assert change(graph, 'matcher_node', 'activate')
    graph.wait_matched(features)
    send(3)
    graph.spin_until(lambda: node.health.processed == 2)
    assert node.health.dropped == 0


def test_a_node_starts_itself_unless_told_otherwise(graph):
    node = graph.add(RecoveryNode)
    assert state(graph, 'recovery_node') == 'active' and node.active
    assert node.get_parameter('autostart').value is True
    assert not node.set_parameters_atomically([Parameter('autostart', value=False)]).successful
