"""Nodes of one process that hand messages over: one copy of an image, none of a result, and the network as before."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String

from msgs_py.codecs import array_to_image, image_to_array
from msgs_py.node_runtime.adapted import Adapted
from msgs_py.node_runtime.config import Config
from msgs_py.node_runtime.hand_over import HandOver
from msgs_py.node_runtime.runtime import GraphNode


class Watcher(GraphNode):
    """Hears images and words, and repeats the words that it hears in its own."""

    def __init__(self, name='watcher', **kwargs):
        super().__init__(name, Config, **kwargs)
        self.images, self.words = [], []
        self.start()

    def configure(self):
        self.out = self.create_output(String, f'said_by_{self.get_name()}')

    def activate(self):
        self.listen(Image, 'image', self.images.append)
        self.listen(String, 'said_by_first', self.words.append, optional=True)


@pytest.fixture
def pair(graph):
    hand_over = HandOver(graph.context)
    nodes = [graph.add(Watcher, name, hand_over=hand_over) for name in ('first', 'second')]
    yield graph, hand_over, nodes
    hand_over.close()


def test_an_image_is_taken_from_the_network_once_and_shared(pair):
    graph, _, nodes = pair
    camera = graph.publisher(Image, 'image')
    graph.wait_matched(camera)
    assert camera.get_subscription_count() == 1
    camera.publish(array_to_image(np.arange(48, dtype=np.uint8).reshape(6, 8), 'mono8', Image().header))
    graph.spin_until(lambda: all(node.images for node in nodes))
    assert nodes[0].images[0] is nodes[1].images[0]
    pictures = [image_to_array(node.images[0])[0] for node in nodes]
    assert np.shares_memory(*pictures) and pictures[0][5, 7] == 47


def test_what_a_node_publishes_goes_to_the_others_as_it_is_and_to_the_network(pair):
    graph, _, (first, second) = pair
    word = String(data='hello')
    first.out.publish(word)
    graph.spin_until(lambda: second.words and first.words)
    assert second.words[0] is word and first.words[0] is word  # once each, though nobody else listened
    assert first.wanted(first.out) and not second.wanted(second.out)
    heard = graph.collect(String, 'said_by_first')
    graph.wait_heard('/said_by_first')
    first.out.publish(String(data='again'))
    graph.spin_until(lambda: heard and len(second.words) == 2)
    assert heard[0].data == 'again' and heard[0] is not second.words[1]


def test_a_value_is_handed_over_as_it_is_and_made_a_message_once_for_who_asks(pair):
    graph, _, (first, second) = pair
    made, values = [], []

    def to_message(value, header):
        made.append(value)
        return String(data=f'{value} at {header.stamp.sec}')

    def given(number):
        header = Header()
        header.stamp.sec = number
        return Adapted(number, header, to_message)

    second.trigger_deactivate()
    first.destroy_subscription(first._inputs.pop())
    first.listen(String, 'said_by_first', values.append, adapted=True)
    one = given(1)
    first.give(first.out, one)
    graph.spin_until(lambda: values)
    assert values == [one] and not made  # nobody has asked for a message
    second.trigger_activate()
    heard = graph.collect(String, 'said_by_first')
    graph.wait_heard('/said_by_first')
    first.give(first.out, given(2))
    graph.spin_until(lambda: heard and second.words and len(values) == 2)
    assert values[1].value == 2 and made == [2]
    assert heard[0].data == second.words[0].data == '2 at 2'


def test_without_a_hand_over_a_value_goes_as_a_message(graph):
    node = graph.add(Watcher)
    heard = graph.collect(String, 'said_by_watcher')
    graph.wait_heard('/said_by_watcher')
    node.give(node.out, Adapted('word', Header(), lambda value, header: String(data=value)))
    graph.spin_until(lambda: heard)
    assert heard[0].data == 'word'


def test_a_slow_node_takes_the_newest_counts_the_rest_and_keeps_no_other_waiting(pair):
    graph, _, (first, second) = pair
    graph.executor.remove_node(second)
    for number in range(10):
        first.out.publish(String(data=str(number)))
        graph.spin_until(lambda number=number: len(first.words) == number + 1)
    graph.executor.add_node(second)
    graph.spin_until(lambda: len(second.words) == 2)
    assert [word.data for word in second.words] == ['8', '9'] and first.health.lost == 0
    first.out.publish(String(data='next'))
    graph.spin_until(lambda: len(second.words) == 3)
    assert second.health.lost == 0  # nobody knows of what came before the first that it was given
    graph.executor.remove_node(second)
    for number in range(5):
        first.out.publish(String(data=str(number)))
    graph.executor.add_node(second)
    graph.spin_until(lambda: len(second.words) == 5)
    assert second.health.lost == 3


def test_names_are_remapped_once_and_quality_of_service_is_overridden(graph):
    hand_over = HandOver(graph.context)
    try:
        swapped = ['--ros-args', '-r', 'image:=picture', '-r', 'picture:=image']
        given = [Parameter('qos_overrides./picture.subscription.reliability', value='reliable')]
        node = Watcher('first', context=graph.context, hand_over=hand_over, cli_args=swapped, parameter_overrides=given)
        graph.nodes.append(node)
        graph.executor.add_node(node)
        camera = graph.publisher(Image, 'picture')
        graph.wait_matched(camera)
        camera.publish(Image())
        graph.spin_until(lambda: node.images)
        (ear,) = graph.tester.get_subscriptions_info_by_topic('/picture')
        assert ear.qos_profile.reliability.name == 'RELIABLE'
        assert node._ignored_overrides() == []
    finally:
        hand_over.close()


def test_who_is_deactivated_hears_nothing_and_the_others_go_on(pair):
    graph, _, (first, second) = pair
    second.trigger_deactivate()
    first.out.publish(String(data='to one'))
    graph.spin_until(lambda: first.words)
    assert not second.words
    second.trigger_activate()
    first.out.publish(String(data='to both'))
    graph.spin_until(lambda: second.words)
    assert [word.data for word in second.words] == ['to both']
