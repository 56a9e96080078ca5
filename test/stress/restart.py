"""Nodes killed (SIGKILL) and started again in every order; how long until the graph gives poses again.

    python test/stress/restart.py --rounds 3

One round kills and restarts each node alone, and then any number of them together, started again in each order. The
time runs from the start of the last process to the first pose of an image taken since: it holds start of Python,
imports, discovery, one stereo pair. A pose of an image from before the kill is a failure, as are four seconds.

--busy N keeps N other processes computing meanwhile: restarts on a robot that has other work.
On a machine that is busy with other things every process takes longer; --share-out divides the times by how much longer
a process takes that only starts Python and imports numpy and scipy (its time by the clock over its processor time).
"""

from __future__ import annotations

import argparse
import itertools
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from msgs_py.node_runtime.transport import make_room_for_images

RECOVERED_S = 4.0
START_S = 120.0  # the first start of all may compile
SETTLED_S = 0.6  # three times the renderer's period: with a node gone no more poses come
SCENE = 'l_shape_v1'
NODES = {
    'renderer_node': {'scene': SCENE, 'rate': '5.0', 'width': '320', 'antialias': '3'},
    'recovery_node': {},
    'matcher_node': {'models': f"['{SCENE}']"},
}


def slowness() -> float:
    """How much longer than its processor time the start of a process takes now; 1 on an idle machine."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(
        [sys.executable, '-c', 'import numpy, scipy.spatial'],
        check=True,
        env=os.environ | {'OPENBLAS_NUM_THREADS': '1'},
    )
    took, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return max(1.0, took / (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))


class Failed(AssertionError):
    """The graph did not do what it must."""


class Restarts:
    """The three nodes as processes, and a listener to the poses."""

    def __init__(self, domain: int) -> None:
        make_room_for_images()
        self.environment = os.environ | {'ROS_DOMAIN_ID': str(domain)}
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = Node('listener', context=self.context)
        self.executor.add_node(self.node)
        self.poses: list[PoseStamped] = []
        self.node.create_subscription(PoseStamped, 'interpretations/l_shape', self.poses.append, 10)
        self.running: dict[str, subprocess.Popen] = {}

    def start(self, name: str) -> None:
        executable = shutil.which(name, path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ.get("PATH", "")}')
        if executable is None:
            raise Failed(f'{name} is not installed as an executable')
        parameters = [item for key, value in NODES[name].items() for item in ('-p', f'{key}:={value}')]
        self.running[name] = subprocess.Popen(
            [executable, '--ros-args', *parameters],
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def spin(self, until, timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not until():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def first_poses(self) -> None:
        for name in NODES:
            self.start(name)
        if not self.spin(lambda: len(self.poses) >= 2, START_S):
            raise Failed(f'no pose within {START_S:g} s of the first start')

    def kill_and_restart(self, names: tuple[str, ...]) -> float:
        """Kill all of them, start them again in this order; seconds from the last start to the first new pose."""
        killed = time.time()
        for name in names:
            self.running[name].kill()
        for name in names:
            self.running[name].wait()
        self.settle()
        for name in names:
            self.start(name)
        start = time.monotonic()
        if not self.spin(lambda: self.poses, 30.0):
            raise Failed(f'{names}: no pose within 30 s')
        took = time.monotonic() - start
        stamps = [pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec for pose in self.poses]
        if stamps != sorted(stamps) or stamps[0] < killed:
            raise Failed(f'{names}: a pose of {killed - stamps[0]:.2f} s before the kill')
        return took

    def settle(self) -> None:
        """Hear what was on its way when a node was killed: it may still arrive, and is no fault."""
        self.poses.clear()
        while self.spin(lambda: self.poses, SETTLED_S):
            self.poses.clear()

    def close(self) -> None:
        for process in self.running.values():
            if process.poll() is None:
                process.kill()
            process.wait()
        self.executor.remove_node(self.node)
        self.node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown(context=self.context)


def orders() -> list[tuple[str, ...]]:
    """Each node alone, then each pair and all three in each order: 3 + 6 + 6."""
    return [order for count in range(1, len(NODES) + 1) for order in itertools.permutations(NODES, count)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--rounds', type=int, default=3, help='each holds 15 restarts')
    parser.add_argument('--alone', action='store_true', help='only one node at a time')
    parser.add_argument('--allowed', type=float, default=RECOVERED_S, help='seconds that a restart may take')
    parser.add_argument('--share-out', action='store_true', help='divide the times by the slowness of the machine')
    parser.add_argument('--busy', type=int, default=0, metavar='N', help='other processes that compute meanwhile')
    parser.add_argument('--domain', type=int, default=101, help='DDS domain (tests use 1 to 100)')
    arguments = parser.parse_args()
    chosen = [order for order in orders() if len(order) == 1 or not arguments.alone]
    restarts, took = Restarts(arguments.domain), []
    others: list[subprocess.Popen] = []
    try:
        restarts.first_poses()
        others += [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(arguments.busy)]
        for order in chosen * arguments.rounds:
            slow = slowness() if arguments.share_out else 1.0
            seconds = restarts.kill_and_restart(order)
            if arguments.share_out:
                slow = (slow + slowness()) / 2
            took.append(seconds / slow)
            print(
                f'{seconds:5.2f} s  {" ".join(order)}' + f'  (machine {slow:.1f}x slow)' * arguments.share_out,
                flush=True,
            )
    except Failed as error:
        print(f'FAILED: {error}')
        return 1
    finally:
        for other in others:
            other.kill()
            other.wait()
        restarts.close()
    print(
        f'{len(took)} restarts: median {np.median(took):.2f} s, p95 {np.percentile(took, 95):.2f} s, '
        f'longest {max(took):.2f} s (allowed {arguments.allowed:g} s), no pose from before'
    )
    print('ok' if max(took) < arguments.allowed else 'FAILED')
    return int(max(took) >= arguments.allowed)


if __name__ == '__main__':
    sys.exit(main())
