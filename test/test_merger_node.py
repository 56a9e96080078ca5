"""merger_node: answers of shards as one; a shard that is silent is named, and what comes too late is left out."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from std_msgs.msg import Header

from model_matcher.catalogue.build import indexed_model, write_catalogue
from model_matcher.closed_form.synthetic.scenes import make_scene, random_polyhedron
from model_matcher.merger_node import MergerNode
from model_matcher.pipeline import match
from msgs_py.codecs import report_from_interpretations


@pytest.fixture(scope='module')
def found():
    """What a search for one of the parts answers."""
    return match(random_polyhedron(3), make_scene(random_polyhedron(3), 3).data, name='m3').interpretations


@pytest.fixture
def bench(graph, tmp_path):
    """A merger of two shards, what it publishes, and the shards' publishers."""
    index = tmp_path / 'parts.index'
    write_catalogue(index, [indexed_model(random_polyhedron(k), f'm{k}') for k in range(5)])
    node = graph.add(MergerNode, parameters={'models': [str(index)], 'wait': 0.3})
    arrays = graph.collect(PoseArray, '/interpretations')
    shards = [graph.publisher(DiagnosticArray, f'/shard_{k}/interpretations/report') for k in (1, 2)]
    graph.wait_matched(*shards)
    graph.wait_heard('/interpretations')

    def say(number, interpretations, second):
        header = Header(frame_id='left_optical')
        header.stamp.sec, header.stamp.nanosec = int(second), round(second % 1.0 * 1e9)
        shards[number - 1].publish(report_from_interpretations(interpretations, header))

    return node, arrays, say


def test_an_answer_has_what_all_shards_found(graph, bench, found):
    node, arrays, say = bench
    say(1, [], 7)
    say(2, found, 7)
    graph.spin_until(lambda: arrays)
    assert len(arrays[0].poses) == 1 and arrays[0].header.stamp.sec == 7 and arrays[0].header.frame_id == 'left_optical'
    assert node.report_values()['models'] == '5 of 5 models of an index'
    say(2, [], 8)
    say(1, [], 8)
    graph.spin_until(lambda: len(arrays) == 2)
    assert len(arrays[1].poses) == 0 and node.report_values()['incomplete'] == 0


def test_a_silent_shard_is_named_and_the_others_answer_without_it(graph, bench, found):
    node, arrays, say = bench
    say(2, found, 7)
    graph.spin_until(lambda: arrays)
    assert len(arrays[0].poses) == 1 and node.report_values()['incomplete'] == 1
    assert node.health.last_error.endswith('no answer of shard 1 within 0.3 s')
    say(1, found, 7)  # too late
    say(1, [], 6.9)
    say(1, [], 9)
    say(2, [], 9)
    graph.spin_until(lambda: len(arrays) > 1)
    assert [array.header.stamp.sec for array in arrays] == [7, 9] and node.report_values()['waiting'] == 0


def test_what_a_shard_found_of_another_library_is_refused_by_name(graph, bench, found):
    node, arrays, say = bench
    say(1, [replace(found[0], model='stranger')], 7)
    say(2, [], 7)
    graph.spin_until(lambda: 'stranger' in node.health.last_error)
    assert not arrays
