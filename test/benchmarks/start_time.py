"""How long a user waits for the first pose: ``python test/benchmarks/start_time.py [--runs 3]``.

Starts the four nodes as processes, as launch does, and waits for the first pose of the model. Machine code comes from
the user's cache; with --cold from an empty one, so that the nodes compile.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped

from msgs_py.node_runtime.transport import make_room_for_images
from msgs_py.numeric.compiled import FOLDER_VARIABLE

MODEL = 'l_shape'
NODES = {
    'renderer_node': {'scene': f'{MODEL}_v1', 'rate': '2.0'},
    'recovery_node': {},
    'matcher_node': {'models': f'[{MODEL}]'},
    'emulator_node': {},
}
# A domain of its own, below the ephemeral ports, and above those that the tests take.
DOMAIN = 101
# Longest wait for a pose, seconds: with an empty cache everything is compiled.
LONGEST_S = 300.0


def parameters_of(node: str) -> list[str]:
    """Its part of the command; recovery listens where the renderer speaks, so nothing is remapped."""
    return [item for key, value in NODES[node].items() for item in ('-p', f'{key}:={value}')]


def seconds_to_first_pose(environment: dict[str, str]) -> float:
    """Start the four nodes, wait for a pose, end them."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    listener = rclpy.create_node('start_time', context=context)
    poses: list[PoseStamped] = []
    listener.create_subscription(PoseStamped, f'/interpretations/{MODEL}', poses.append, 10)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    folder = f'{Path(sys.executable).parent}{os.pathsep}{os.environ.get("PATH", "")}'
    started = time.perf_counter()
    processes = [
        subprocess.Popen(
            [shutil.which(node, path=folder) or node, '--ros-args', *parameters_of(node)],
            env={**environment, 'ROS_DOMAIN_ID': str(DOMAIN)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for node in NODES
    ]
    try:
        while not poses and time.perf_counter() - started < LONGEST_S:
            executor.spin_once(timeout_sec=0.05)
        return time.perf_counter() - started if poses else float('nan')
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(timeout=30.0)
        listener.destroy_node()
        rclpy.shutdown(context=context)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--cold', action='store_true', help='compile: an empty cache for every run')
    arguments = parser.parse_args()
    make_room_for_images()
    taken = []
    for _ in range(arguments.runs):
        with tempfile.TemporaryDirectory() as empty:
            environment = {**os.environ, FOLDER_VARIABLE: empty} if arguments.cold else dict(os.environ)
            taken.append(seconds_to_first_pose(environment))
            print(f'first pose after {taken[-1]:.1f} s', flush=True)
    print(f'median {np.median(taken):.1f} s')
    return int(not np.isfinite(taken).all())


if __name__ == '__main__':
    sys.exit(main())
