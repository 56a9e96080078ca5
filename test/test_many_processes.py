"""Graphs of many processes: killed and restarted nodes, namespaces side by side, a model library shared by matchers."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from model_matcher.catalogue.build import indexed_model, write_catalogue
from model_matcher.closed_form.synthetic.scenes import make_scene, random_polyhedron
from msgs_py.codecs import features_to_cloud, interpretations_from_report, pose_from_message

pytestmark = pytest.mark.timeout(180)  # nodes compile when they run for the first time
RESTART = Path(__file__).resolve().parent / 'stress' / 'restart.py'


def test_a_killed_node_is_back_within_four_seconds_with_nothing_stale(graph):
    """Each node, killed and started again; test/stress/restart.py does it in every order, many times."""
    command = [
        sys.executable,
        str(RESTART),
        '--rounds',
        '1',
        '--alone',
        '--share-out',
        '--domain',
        str(graph.domain_id),
    ]
    result = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    assert result.returncode == 0, result.stdout + result.stderr[-2000:]
    assert '3 restarts' in result.stdout and 'no pose from before' in result.stdout


def test_two_graphs_run_side_by_side_in_their_namespaces(graph, processes):
    """All names are relative: a namespace is all it takes, and neither graph hears the other."""
    heard = {}
    for space, scene, model in (('one', 'l_shape_v1', 'l_shape'), ('two', 'chipped_block_v1', 'chipped_block')):
        remaps = [f'__ns:=/{space}']
        heard[space] = {
            name: graph.collect(PoseStamped, f'/{space}/interpretations/{name}')
            for name in ('l_shape', 'chipped_block')
        }
        processes('matcher_node', remaps, models="['l_shape', 'chipped_block']")
        processes('recovery_node', remaps)
        processes('renderer_node', remaps, scene=scene, rate='2.0', width='320')
        assert model in heard[space]
    graph.spin_until(
        lambda: len(heard['one']['l_shape']) >= 2 and len(heard['two']['chipped_block']) >= 2,
        40.0,
        'poses of both graphs',
    )
    assert not heard['one']['chipped_block'] and not heard['two']['l_shape']


def test_matchers_share_a_library_and_one_features_topic(graph, processes):
    """Scale-out: each matcher has its part of the models in a namespace of its own; features is remapped to the one."""
    poses = {}
    for space, model in (('part_a', 'l_shape'), ('part_b', 'chipped_block')):
        poses[space] = graph.collect(PoseStamped, f'/{space}/interpretations/{model}')
        processes('matcher_node', [f'__ns:=/{space}', 'features:=/features'], models=f"['{model}']")
    processes('recovery_node')
    renderer = {'rate': '2.0', 'width': '320'}
    first = processes('renderer_node', scene='l_shape_v1', **renderer)
    graph.spin_until(lambda: len(poses['part_a']) >= 2, 30.0, 'poses of the first part of the library')
    assert not poses['part_b']
    first.kill()
    first.wait()
    processes('renderer_node', scene='chipped_block_v1', **renderer)
    graph.spin_until(lambda: len(poses['part_b']) >= 2, 30.0, 'poses of the second part of the library')


def test_two_shards_of_an_index_and_who_merges_them_answer_as_one(graph, processes, tmp_path):
    """Three processes: each matcher_node has half of the index, merger_node puts together what they find."""
    index = tmp_path / 'parts.index'
    write_catalogue(index, [indexed_model(random_polyhedron(k), f'm{k}') for k in range(40)])
    reports = graph.collect(DiagnosticArray, '/interpretations/report')
    poses = {name: graph.collect(PoseStamped, f'/interpretations/{name}') for name in ('m5', 'm33')}
    features = graph.publisher(PointCloud2, '/features')
    for number in (1, 2):
        remaps = [f'__ns:=/shard_{number}', 'features:=/features']
        processes('matcher_node', remaps, models=f"['{index}']", shard=f'{number}/2', use_images='false')
    processes('merger_node', models=f"['{index}']", shards='2')
    graph.wait_matched(features, count=2)
    graph.spin_until(lambda: graph.tester.count_publishers('/interpretations/report') == 1, what='merger_node')
    for second, (name, which) in enumerate((('m5', 5), ('m33', 33)), start=1):
        scene = make_scene(random_polyhedron(which), which, clutter=0.5)
        header = Header(frame_id='left_optical')
        header.stamp.sec = second
        # A topic of a model comes with its first pose, and nodes that have not heard each other yet miss a message:
        # later ones have stamps of their own.
        end = time.monotonic() + 60.0
        while not poses[name]:
            assert time.monotonic() < end, f'no pose of {name}'
            header.stamp.nanosec += 1
            features.publish(features_to_cloud(scene.data, header))
            before, soon = len(reports), time.monotonic() + 5.0
            graph.spin_until(lambda: len(reports) > before or time.monotonic() > soon)  # noqa: B023
        best = interpretations_from_report(reports[-1])[0]
        assert best.accepted and best.model == name
        pose = pose_from_message(poses[name][-1].pose)
        errors = [one.error_to(scene.poses[0]).translation for one in (pose, *best.symmetric_poses)]
        assert min(errors) < 0.003 and poses[name][-1].header.stamp.sec == second
