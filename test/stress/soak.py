"""Many stereo pairs through recognise, in one process: does memory grow, do pairs vanish, does it slow down?

    python test/stress/soak.py --pairs 10000
    python test/stress/soak.py --pairs 1000 --only recovery_node matcher_node

Every pair is a view of the L-shaped block with its own noise. The camera, which also waits for the poses, is a process
of its own, as a driver and a planner are. One pair is under way at a time, so every pair must come back as a pose
array. Memory is the resident set size, after the first tenth has warmed up. What it takes from the images to the pose
is set beside the sum of what recovery and matching take in it: the rest is what it costs that they are nodes. In
between, a bare node of rclpy in the same process answers the same messages with a pose: that much of the rest is the
way of messages from process to process and back. And both are done alone, by the libraries: what more they take in the
nodes they lose to what runs beside them.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

import numpy as np
import rclpy
from geometry_msgs.msg import Pose, PoseArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

import csg_renderer
import model_matcher.node
import stereo_recovery.node
from csg_renderer.raycast.render import scene_rig
from model_matcher.closed_form.recognise_node import NODES, Recognition
from model_matcher.image_pose.views import Views
from msgs_py import codecs
from msgs_py.node_runtime.runtime import INPUT_QOS, OUTPUT_QOS, STEREO_TOPICS
from msgs_py.node_runtime.transport import make_room_for_images

SCENE = 'l_shape_v1'
SIZE = 256
ANSWER_S = 5.0
READY_S = 300.0
GROWTH_MB = 20.0
DRIFT = 1.3
NODES_COST_MS = 2.0
# Of so many pairs one is also sent to a bare node, and done by the libraries alone.
ALONE_EVERY = 10
# Before topics of the nodes, and of the bare one.
BARE = 'bare/'
SPACES = ('', BARE)


def message_type(topic: str) -> type:
    return CameraInfo if topic.endswith('info') else Image


def resident_mb() -> float:
    with open('/proc/self/statm') as file:
        return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6


class Camera:
    """Publishes pairs, and waits for the poses found in each."""

    def __init__(self, domain: int, seed: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = Node('camera', context=self.context)
        self.executor.add_node(self.node)
        self.outputs = {
            space: [
                self.node.create_publisher(message_type(topic), f'{space}{topic}', OUTPUT_QOS)
                for topic in STEREO_TOPICS
            ]
            for space in SPACES
        }
        self.answered, self.poses = 0, 0
        self.inputs = [
            self.node.create_subscription(PoseArray, f'{space}interpretations', self._on_answer, 10) for space in SPACES
        ]
        scene = csg_renderer.load_scene(csg_renderer.scene_path(SCENE))
        self.rig = scene_rig(scene, width=SIZE)
        self.frames = [
            codecs.gray_from_image(codecs.array_to_image(frame.image, 'rgb8')).astype(np.int16)
            for frame in csg_renderer.render_stereo(scene, self.rig, antialias=4)
        ]
        self.rng = np.random.default_rng(seed)

    def _on_answer(self, message: PoseArray) -> None:
        self.answered, self.poses = message.header.stamp.sec, len(message.poses)

    def spin(self, done: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def connect(self) -> bool:
        """Whether the nodes are there."""
        return self.spin(
            lambda: (
                all(one.get_subscription_count() for ones in self.outputs.values() for one in ones)
                and all(one.get_publisher_count() for one in self.inputs)
            ),
            20.0,
        )

    def pair(self, number: int, space: str = '') -> tuple[float, bool] | None:
        """Send one pair; the seconds until its answer, and whether poses are in it. None without an answer."""
        header = Header(frame_id='camera_left_optical_frame')
        header.stamp.sec = number + 1
        noise = [self.rng.integers(-2, 3, frame.shape) for frame in self.frames]
        images = [np.clip(frame + one, 0, 255).astype(np.uint8) for frame, one in zip(self.frames, noise)]
        infos = codecs.camera_infos_from_rig(self.rig, header)
        messages = (
            codecs.array_to_image(images[0], 'mono8', header),
            infos[0],
            codecs.array_to_image(images[1], 'mono8', header),
            infos[1],
        )
        start = time.perf_counter()
        self.answered = 0
        for output, message in zip(self.outputs[space], messages):
            output.publish(message)
        if not self.spin(lambda: self.answered == number + 1, ANSWER_S):
            return None
        return time.perf_counter() - start, self.poses > 0


def run_camera(domain: int, seed: int, asked: Connection) -> None:
    """Send the pair of each number that is asked for, into a name space; None ends it."""
    camera = Camera(domain, seed)
    asked.send(camera.connect())
    while (number := asked.recv()) is not None:
        asked.send(camera.pair(*number))
    camera.executor.shutdown()
    camera.node.destroy_node()
    rclpy.try_shutdown(context=camera.context)


class Timed:
    """A function of a module, with what its last call took."""

    def __init__(self, module: Any, name: str) -> None:
        self.call = getattr(module, name)
        self.seconds, self.arguments, self.options = 0.0, (), {}
        setattr(module, name, self)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        start = time.perf_counter()
        result = self.call(*arguments, **options)
        self.seconds, self.arguments, self.options = time.perf_counter() - start, arguments, options
        return result

    def alone(self) -> float:
        """Seconds of the same call, without a deadline and without what images have kept since."""
        arguments = [
            Views(one.images, one.cameras, one.poses) if isinstance(one, Views) else one for one in self.arguments
        ]
        start = time.perf_counter()
        self.call(*arguments, **self.options)
        return time.perf_counter() - start


class Bare:
    """A node that does nothing but answer, in a thread of its own."""

    def __init__(self, context: Context) -> None:
        self.node = Node('bare', context=context)
        self.output = self.node.create_publisher(PoseArray, f'{BARE}interpretations', OUTPUT_QOS)
        self.heard = 0
        for topic in STEREO_TOPICS:
            self.node.create_subscription(message_type(topic), f'{BARE}{topic}', self._on_message, INPUT_QOS)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.ended = False
        self.thread.start()

    def _spin(self) -> None:
        while not self.ended:
            self.executor.spin_once(timeout_sec=0.2)

    def _on_message(self, message: Any) -> None:
        self.heard += 1
        if self.heard % len(STEREO_TOPICS) == 0:
            self.output.publish(PoseArray(header=message.header, poses=[Pose()]))

    def close(self) -> None:
        self.ended = True
        self.thread.join(5.0)
        self.executor.shutdown()
        self.node.destroy_node()


class Soak:
    """The nodes, and the camera in a process of its own."""

    def __init__(self, domain: int, seed: int = 0, names: Sequence[str] = tuple(NODES)) -> None:
        self.timed = Timed(stereo_recovery.node, 'recover'), Timed(model_matcher.node, 'survey')
        make_room_for_images()  # as the command does
        spawn = multiprocessing.get_context('spawn')
        self.asked, theirs = spawn.Pipe()
        self.camera = spawn.Process(target=run_camera, args=(domain, seed, theirs), daemon=True)
        self.camera.start()
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        models = [Parameter('models', value=[SCENE])]
        self.together = Recognition(self.context, names, parameter_overrides=models)
        self.nodes = self.together.nodes
        self.recovery, self.matcher = self.nodes[:2]
        self.bare = Bare(self.context)

    def connect(self) -> None:
        if not self.asked.recv():
            raise SystemExit('FAILED: topics did not connect')
        deadline = time.monotonic() + READY_S
        while any(node.compiling for node in self.nodes):
            if time.monotonic() > deadline:
                raise SystemExit('FAILED: not compiled')
            time.sleep(0.1)

    def pair(self, number: int, space: str = '') -> tuple[float, bool] | None:
        """See Camera."""
        self.asked.send((number, space))
        return self.asked.recv()

    def counted(self) -> int:
        """Pairs that did not come back but are in a counter of a node."""
        return (
            sum(node.health.lost + node.health.passed_over + node.health.dropped for node in self.nodes[:2])
            + self.recovery._sync.counters.unmatched
            + self.recovery._sync.counters.late
        )

    def close(self) -> None:
        self.asked.send(None)
        self.together.close()
        self.bare.close()
        self.camera.join(10.0)
        rclpy.try_shutdown(context=self.context)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--pairs', type=int, default=10000)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--domain', type=int, default=120, help='DDS domain (tests use 1 to 110)')
    parser.add_argument('--only', nargs='+', choices=tuple(NODES), default=tuple(NODES), help='these nodes')
    parser.add_argument(
        '--cost', type=float, default=NODES_COST_MS, help='allowed beyond recovery, matching and a bare node, p50 (ms)'
    )
    parser.add_argument('--drift', type=float, default=DRIFT, help='allowed growth of the 99th percentile (x)')
    arguments = parser.parse_args()
    soak = Soak(arguments.domain, arguments.seed, arguments.only)
    soak.connect()
    # The first pairs are still paying for threads and compiled code.
    warm = max(20, arguments.pairs // 10)
    seconds: list[float] = []
    within: list[float] = []
    alone: list[float] = []
    bare: list[float] = []
    missing = found = 0
    for number in range(warm + arguments.pairs):
        if number == warm:
            before = resident_mb()
        answer = soak.pair(number)
        if answer is None:
            missing += 1
        elif number >= warm:
            seconds.append(answer[0])
            within.append(sum(one.seconds for one in soak.timed))
            found += answer[1]
        if number % ALONE_EVERY == 0:
            alone.append(sum(one.alone() for one in soak.timed))
            answer = soak.pair(number, BARE)
            if answer is not None:
                bare.append(answer[0])
        if number % 1000 == 999:
            print(f'{number + 1} pairs, {resident_mb():.0f} MB', flush=True)
    growth, counted = resident_mb() - before, soak.counted()
    soak.close()
    block = min(1000, max(1, len(seconds) // 2))
    way = 1e3 * float(np.median(bare))
    cost = 1e3 * float(np.median(np.subtract(seconds, within))) - way
    first, last = (1e3 * float(np.percentile(part, 99)) for part in (seconds[:block], seconds[-block:]))
    print(
        f'{arguments.pairs} pairs: {found} recognised, {missing} unanswered, {counted} counted by the nodes; '
        f'memory {growth:+.1f} MB (allowed {GROWTH_MB:g}); p50 {1e3 * np.median(seconds):.1f} ms, '
        f'{1e3 * np.median(within):.1f} in recovery and matching ({1e3 * np.median(alone):.1f} when they are alone) '
        f'and {cost + way:.1f} beside: {way:.1f} as a bare node needs, {cost:.1f} more (allowed {arguments.cost:g}); '
        f'p99 of the first {block} {first:.1f} ms, of the last {last:.1f} ms ({last / first:.2f}x, '
        f'allowed {arguments.drift:g}x)'
    )
    good = growth < GROWTH_MB and missing <= counted and last <= arguments.drift * first and cost <= arguments.cost
    print('ok' if good else 'FAILED')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
