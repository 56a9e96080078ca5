"""Graphs of many processes: killed and restarted nodes, namespaces side by side, a model library shared by matchers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped

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
