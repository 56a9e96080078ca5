"""The behaviour every node shares, shown with a node that only repeats what it hears."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.qos import QoSHistoryPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msgs_py.node_runtime.config import Config, parameter
from msgs_py.node_runtime.runtime import STEREO_TOPICS, GraphNode, spin_once
from msgs_py.numeric.steps import CompileStep


@dataclass(frozen=True)
class EchoConfig(Config):
    prefix: str = parameter('', 'Put before every text')
    gain: float = parameter(1.0, 'A number', unit='px', minimum=0.0, maximum=10.0)
    low: int = parameter(1, 'Lower limit', name='limits.low', minimum=0, maximum=100)
    high: int = parameter(5, 'Upper limit', name='limits.high', minimum=0, maximum=100)
    mode: str = parameter('loud', 'How', choices=('loud', 'soft'))
    names: tuple[str, ...] = parameter((), 'Names')
    fixed: tuple[str, ...] = parameter((), 'Names that stay', read_only=True)

    def validate(self) -> None:
        if self.low > self.high:
            raise ValueError(f'parameter limits.low: {self.low} is above limits.high {self.high}')


class EchoNode(GraphNode):
    def __init__(self, **kwargs):
        super().__init__('echo_node', EchoConfig, **kwargs)
        self.changes = []
        self.start()

    def configure(self):
        self.out = self.create_output(String, 'out')

    def activate(self):
        self.listen(String, 'in', self.on_text)

    def on_text(self, message):
        if message.data == 'bad value':
            raise ValueError('in.data: expected anything else')
        if message.data == 'bug':
            raise ZeroDivisionError('oops')
        self.out.publish(String(data=self.config.prefix + message.data))
        self.done()

    def on_config(self, old, new):
        self.changes.append((old, new))


class StereoEchoNode(GraphNode):
    def __init__(self, **kwargs):
        super().__init__('stereo_echo_node', EchoConfig, **kwargs)
        self.seen = []
        self.start()

    def activate(self):
        self.listen_stereo(self.on_pair)

    def on_pair(self, pair):
        self.seen.append(pair.left.header.stamp.sec)
        if len(self.seen) == 1:
            raise RuntimeError('first one fails')
        self.done()


def latest(statuses, name):
    found = [s for message in statuses for s in message.status if s.name.endswith(name)]
    return found[-1] if found else None


def values(status):
    return {item.key: item.value for item in status.values}


def set_atomically(graph, node, **changes):
    kinds = {
        str: (ParameterType.PARAMETER_STRING, 'string_value'),
        int: (ParameterType.PARAMETER_INTEGER, 'integer_value'),
        float: (ParameterType.PARAMETER_DOUBLE, 'double_value'),
        list: (ParameterType.PARAMETER_STRING_ARRAY, 'string_array_value'),
    }
    parameters = []
    for name, value in changes.items():
        kind, attribute = kinds[type(value)]
        wrapped = ParameterValue(type=kind, **{attribute: value})
        parameters.append(Parameter(name=name.replace('__', '.'), value=wrapped))
    request = SetParametersAtomically.Request(parameters=parameters)
    return graph.call(SetParametersAtomically, f'/{node.get_name()}/set_parameters_atomically', request).result


def test_initial_values_come_from_overrides_and_integers_pass_for_numbers(graph):
    node = graph.add(EchoNode, parameters={'prefix': '> ', 'gain': 3, 'names': ['a', 'b']})
    assert (node.config.prefix, node.config.gain, node.config.names) == ('> ', 3.0, ('a', 'b'))


@pytest.mark.parametrize(
    ('name', 'value', 'text'),
    [
        ('gain', 11.0, 'gain'),
        ('gain', 'much', 'gain'),
        ('mode', 'silent', 'mode'),
        ('limits.low', 9, 'limits.low'),
        ('prefix', 3, 'prefix'),
        ('names', 'one', 'names'),
    ],
)
def test_a_bad_initial_value_is_reported_and_the_default_used(graph, name, value, text):
    node = graph.add(EchoNode, parameters={name: value})
    assert node.config == EchoConfig()
    assert text in node.health.last_error
    assert node.get_parameter(name).value == EchoConfig().as_parameters()[name] or name == 'names'


def test_parameters_change_together_or_not_at_all(graph):
    node = graph.add(EchoNode)
    assert set_atomically(graph, node, limits__low=20, limits__high=30, names=['x']).successful
    assert (node.config.low, node.config.high, node.config.names) == (20, 30, ('x',))
    assert len(node.changes) == 1 and node.changes[0][0].low == 1
    refused = set_atomically(graph, node, limits__low=50, gain=2.0)
    assert not refused.successful and 'limits.low: 50 is above limits.high 30' in refused.reason
    assert node.config.gain == 1.0


@pytest.mark.parametrize('given', [{}, {'fixed': ['a']}])
def test_a_read_only_list_keeps_what_it_was_started_with(graph, given):
    node = graph.add(EchoNode, parameters=given)
    assert node.config.fixed == tuple(given.get('fixed', ()))
    refused = set_atomically(graph, node, fixed=['b'])
    assert not refused.successful and 'read' in refused.reason and node.config.fixed == tuple(given.get('fixed', ()))


def test_a_check_that_fails_for_reasons_of_its_own_refuses_the_change(graph):
    node = graph.add(EchoNode)
    node.check_config = lambda new: os.stat('x' * 5000)
    refused = set_atomically(graph, node, prefix='long')
    assert not refused.successful and 'File name too long' in refused.reason and len(refused.reason) < 1000


def test_parameters_describe_themselves(graph):
    node = graph.add(EchoNode)
    reply = graph.call(
        DescribeParameters,
        f'/{node.get_name()}/describe_parameters',
        DescribeParameters.Request(names=['gain', 'mode']),
    )
    assert reply.descriptors[0].description == 'A number [px]'
    assert reply.descriptors[0].floating_point_range[0].to_value == 10.0
    assert "one of 'loud', 'soft'" in reply.descriptors[1].additional_constraints


def test_a_raising_callback_is_reported_once_and_the_node_lives(graph):
    node = graph.add(EchoNode)
    heard = graph.collect(String, 'out')
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk, node.out)
    for text in ('bad value', 'bug', 'bug', 'fine'):
        talk.publish(String(data=text))
        graph.spin_until(lambda text=text: node.health.problems + node.health.processed >= 1)
        graph.spin_until(lambda: node._received['in'] > 0)
    graph.spin_until(lambda: heard, what='an echo after the failures')
    assert heard[0].data == 'fine'
    assert 'ZeroDivisionError: oops' in node.health.last_error and 'on_text' in node.health.last_error
    assert node.health.dropped >= 2


def test_diagnostics_tell_rate_latency_and_last_error(graph):
    node = graph.add(EchoNode)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk)
    talk.publish(String(data='bad value'))
    graph.spin_until(lambda: node.health.problems)
    talk.publish(String(data='fine'))
    graph.spin_until(lambda: node.health.processed)
    status = graph.spin_until(
        lambda: (
            latest(statuses, 'echo_node')
            if (latest(statuses, 'echo_node') is not None and values(latest(statuses, 'echo_node'))['processed'] == '1')
            else None
        )
    )
    found = values(status)
    assert found['last_error'] == 'in: in.data: expected anything else'
    assert float(found['rate_hz']) > 0 and float(found['latency_p50_ms']) >= 0


def test_a_slow_consumer_takes_the_newest_and_counts_what_it_missed(graph):
    node = graph.add(EchoNode)
    heard = graph.collect(String, 'out')
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk, node.out)
    talk.publish(String(data='first'))
    graph.spin_until(lambda: heard)
    for number in range(20):  # nobody spins: the node is busy
        talk.publish(String(data=str(number)))
    graph.spin_until(lambda: heard[-1].data == '19', what='the newest')
    # The middleware may hand a message on while the node takes the one before; what it keeps are two.
    numbers = [int(message.data) for message in heard[1:]]
    assert numbers == sorted(set(numbers)) and numbers[-1] == 19, 'in order, the newest at the end'
    assert len(numbers) < 20 and node.health.lost == 20 - len(numbers), 'the oldest dropped, and counted'
    assert node.health.values(time.monotonic())['lost_inputs'] == node.health.lost
    queue = next(s for s in node.subscriptions if s.topic_name == '/in').qos_profile
    assert (queue.history, queue.depth) == (QoSHistoryPolicy.KEEP_LAST, 2), 'a bounded queue'


def test_a_message_that_cannot_be_deserialised_is_counted_and_the_next_one_heard(graph):
    node = graph.add(EchoNode)
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk)
    whole = serialize_message(String(data='hello'))
    for message in (String(data='one'), whole[:7], whole[:4] + b'\xff\xff\xff\x7f' + whole[8:], String(data='two')):
        talk.publish(message)
        for _ in range(3):
            spin_once(node, graph.executor, 0.02)
    graph.spin_until(lambda: node.health.processed == 2)
    assert node.health.lost == 2


def test_reset_clears_the_counters(graph):
    node = graph.add(EchoNode)
    node.problem('something')
    reply = graph.call(Trigger, '/echo_node/reset', Trigger.Request())
    assert reply.success and 'counters' in reply.message
    assert node.health.problems == 0 and node.health.last_error == ''


def test_silence_names_the_missing_topics(graph):
    node = graph.add(StereoEchoNode)
    node.health.started -= 60.0
    assert 'right/camera_info' in node.silence()


def publish_pair(publishers, sec):
    for topic, publisher in publishers.items():
        message = CameraInfo() if topic.endswith('camera_info') else Image()
        message.header.stamp.sec = sec
        publisher.publish(message)


def test_stereo_topics_are_joined_and_survive_a_raising_callback_and_a_backward_clock_jump(graph):
    node = graph.add(StereoEchoNode)
    publishers = {
        topic: graph.publisher(CameraInfo if topic.endswith('camera_info') else Image, topic) for topic in STEREO_TOPICS
    }
    graph.wait_matched(*publishers.values())
    for count, sec in enumerate((100, 101, 5, 6), start=1):
        publish_pair(publishers, sec)
        graph.spin_until(lambda count=count: len(node.seen) >= count, what=f'pair at {sec} s')
    assert node.seen == [100, 101, 5, 6]
    assert 'first one fails' in node.health.last_error
    assert node._sync.counters.clock_jumps == 1


class CompilingEchoNode(EchoNode):
    """Has to compile something that takes until the test says so."""

    steps: tuple[CompileStep, ...] = ()

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.prepare(self.steps)


class CompilingStereoNode(StereoEchoNode):
    steps: tuple[CompileStep, ...] = ()

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.prepare(self.steps)


@pytest.fixture
def compiler():
    """Two stand-ins for compiling, each waiting for its event; released at the end whatever happens."""
    events = [threading.Event(), threading.Event()]
    steps = tuple(CompileStep(name, event.wait) for name, event in zip(('edges', 'curves'), events))
    CompilingEchoNode.steps = CompilingStereoNode.steps = steps
    yield events
    for event in events:
        event.set()


def status_that(graph, statuses, name, predicate):
    """The newest status of a node for which the predicate holds."""

    def found():
        status = latest(statuses, name)
        return status if status is not None and predicate(status) else None

    return graph.spin_until(found, what=f'such a status of {name}')


def test_a_node_that_compiles_says_how_far_it_is_and_answers_meanwhile(graph, compiler):
    node = graph.add(CompilingEchoNode)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    status = status_that(graph, statuses, 'echo_node', lambda s: s.message == 'compiling: 1 of 2: edges')
    assert status.level == DiagnosticStatus.OK and values(status)['compiling'] == '1 of 2: edges'
    assert set_atomically(graph, node, prefix='> ').successful and node.config.prefix == '> '
    assert graph.call(Trigger, '/echo_node/reset', Trigger.Request()).success
    compiler[0].set()
    status_that(graph, statuses, 'echo_node', lambda s: s.message == 'compiling: 2 of 2: curves')
    compiler[1].set()
    status = status_that(graph, statuses, 'echo_node', lambda s: s.message == 'ok')
    assert values(status)['compiling'] == ''


def test_the_newest_input_is_kept_until_all_is_compiled(graph, compiler):
    node = graph.add(CompilingEchoNode)
    heard = graph.collect(String, 'out')
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk, node.out)
    for number in range(3):
        talk.publish(String(data=str(number)))
        graph.spin_until(lambda number=number: node._received['in'] > number)
    assert node.health.processed == 0 and not heard
    for event in compiler:
        event.set()
    graph.spin_until(lambda: heard, what='the input that waited')
    assert [message.data for message in heard] == ['2']
    assert (node.health.processed, node.health.passed_over) == (1, 2)
    talk.publish(String(data='after'))
    graph.spin_until(lambda: len(heard) == 2)


def test_the_newest_stereo_pair_is_kept_until_all_is_compiled(graph, compiler):
    node = graph.add(CompilingStereoNode)
    outputs = [graph.publisher(CameraInfo if 'info' in topic else Image, topic) for topic in STEREO_TOPICS]
    graph.wait_matched(*outputs)
    for sec in (1, 2):
        for output in outputs:
            message = output.msg_type()
            message.header.stamp.sec = sec
            output.publish(message)
        graph.spin_until(lambda sec=sec: node._sync.counters.sets == sec, what='a pair')
    assert node.seen == []
    for event in compiler:
        event.set()
    graph.spin_until(lambda: node.seen)
    assert node.seen == [2]


def test_nothing_received_is_no_warning_while_another_node_compiles(graph, compiler, monkeypatch):
    monkeypatch.setattr('msgs_py.node_runtime.runtime.SILENCE_S', 0.0)
    graph.add(CompilingEchoNode)
    graph.add(StereoEchoNode)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    status = status_that(graph, statuses, 'stereo_echo_node', lambda s: s.message.startswith('waiting'))
    assert status.level == DiagnosticStatus.OK
    assert status.message == 'waiting: /echo_node is compiling: 1 of 2: edges'
    for event in compiler:
        event.set()
    status = status_that(graph, statuses, 'stereo_echo_node', lambda s: s.message.startswith('nothing received'))
    assert status.level == DiagnosticStatus.WARN


def test_a_step_that_fails_is_reported_and_the_node_works(graph, compiler):
    def fail():
        raise ZeroDivisionError('oops')

    CompilingEchoNode.steps = (CompileStep('edges', fail), CompileStep('curves', compiler[1].wait))
    node = graph.add(CompilingEchoNode)
    heard = graph.collect(String, 'out')
    talk = graph.publisher(String, 'in')
    graph.wait_matched(talk, node.out)
    talk.publish(String(data='first'))
    compiler[1].set()
    graph.spin_until(lambda: heard)
    assert node.health.last_error == 'compiling: edges: ZeroDivisionError: oops'


def test_a_node_that_is_destroyed_begins_no_further_step(graph, compiler):
    node = graph.add(CompilingEchoNode)
    preparation = node._preparation
    graph.executor.remove_node(node)
    graph.nodes.remove(node)
    node.destroy_node()
    compiler[0].set()
    preparation._thread.join(10.0)
    assert not preparation.running and not preparation.done
