"""Image in, pose out, through the real recovery_node and matcher_node: latency, and the rate they sustain.

Three set-ups: both nodes in one process; one process a node as `ros2 run` starts them; and the same with reliable
inputs. The clock starts when the first image of a pair is published and stops when `interpretations` with its stamp has
arrived. Pairs come one at a time (each when the last is answered or given up), then at a steady rate, then faster than
anybody could answer.
"""

from __future__ import annotations

import random
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from measure import Absent, Measurement

from csg_renderer import default_rig, load_scene, render_stereo, scene_path
from csg_renderer.raycast.sensor import SensorModel, grey

SCENES = ('l_shape_v1', 'chipped_block_v1', 'computer_v1', 'plug_v1')
TOPICS = ('left/image_rect', 'left/camera_info', 'right/image_rect', 'right/camera_info')
RATE_HZ = 15.0
FLOOD_HZ = 60.0
START_S = 40.0
LOST_S = 0.5
ONE, MANY, RELIABLE = 'one process', 'a process a node', 'a process a node, reliable inputs'


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    for name in SCENES[:2] if quick else SCENES:
        try:
            path = str(scene_path(name))
        except (OSError, ValueError):
            yield Absent(f'{name}', 'no such scene in csg_renderer yet')
            continue
        for where in (ONE, MANY, RELIABLE):
            if quick and where != ONE and name != SCENES[0]:
                continue
            yield from _one(name, path, where, 4.0 if quick else 8.0)


def _one(name: str, path: str, where: str, seconds: float) -> Iterator[Measurement | Absent]:
    with Pipe(path, where) as pipe:
        try:
            pipe.warm_up()
        except TimeoutError as error:
            yield Absent(f'{name}, {where}', str(error))
            return
        sent, latencies = pipe.one_at_a_time(seconds)
        yield from _percentiles(f'{name}, {where}: image to pose', sent, latencies)
        sent, latencies = pipe.stream(RATE_HZ, seconds)
        yield from _percentiles(f'{name}, {where}: the same at {RATE_HZ:g} Hz', sent, latencies)
        started = time.perf_counter()
        _, latencies = pipe.stream(FLOOD_HZ, seconds / 2)
        elapsed = time.perf_counter() - started
        yield Measurement(
            f'{name}, {where}: poses a second, flooded',
            len(latencies) / elapsed,
            'Hz',
            lower_is_better=False,
            note=f'pairs sent at up to {FLOOD_HZ:g} Hz',
        )


def _percentiles(what: str, sent: int, latencies: np.ndarray) -> Iterator[Measurement]:
    share = 100.0 * len(latencies) / max(sent, 1)
    yield Measurement(f'{what}, pairs answered', share, '%', lower_is_better=False, note=f'of {sent}, 512 x 512')
    for percent in (50, 99):
        if len(latencies):
            yield Measurement(f'{what}, p{percent}', float(np.percentile(latencies, percent)))


class Pipe:
    """recovery_node and matcher_node, and what feeds and hears them."""

    def __init__(self, scene: str, where: str) -> None:
        self.scene, self.where = scene, where
        self.children: list[subprocess.Popen] = []
        self.nodes: list[Any] = []
        self.answers: dict[int, float] = {}
        self.poses = 0

    def __enter__(self) -> Pipe:
        import rclpy
        from geometry_msgs.msg import PoseArray
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from sensor_msgs.msg import CameraInfo, Image
        from std_msgs.msg import Header

        from msgs_py import codecs
        from msgs_py.node_runtime.transport import make_room_for_images

        # As our own renderer_node does; a camera driver with the default of 512 KiB loses a tenth of the pairs.
        make_room_for_images()
        self._rclpy = rclpy
        namespace = f'/bench_{random.SystemRandom().randrange(10**9)}'
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = Node('bench', context=self.context, namespace=namespace)
        self.executor.add_node(self.node)
        self._start_nodes(namespace)
        self.publishers = [
            self.node.create_publisher(Image if topic.endswith('rect') else CameraInfo, topic, 2) for topic in TOPICS
        ]
        self.node.create_subscription(PoseArray, 'interpretations', self._on_poses, 10)

        scene = load_scene(self.scene)
        rig = default_rig(scene)
        frames = render_stereo(scene, rig, antialias=4)
        images = [SensorModel(0.5, 2.0, (0, eye)).apply(grey(frame.image)) for eye, frame in enumerate(frames)]
        empty = Header(frame_id='camera_left_optical_frame')
        infos = codecs.camera_infos_from_rig(rig, empty)
        pictures = [codecs.array_to_image(image, 'mono8', empty) for image in images]
        self.messages = [pictures[0], infos[0], pictures[1], infos[1]]
        return self

    def _start_nodes(self, namespace: str) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.parameter import Parameter

        from model_matcher.node import MatcherNode
        from stereo_recovery.node import RecoveryNode

        if self.where != ONE:
            remap = ['--ros-args', '-r', f'__ns:={namespace}', '--log-level', 'error']
            qos: list[str] = []
            for publisher in TOPICS if self.where == RELIABLE else ():
                qos += ['-p', f'qos_overrides.{namespace}/{publisher}.subscription.reliability:=reliable']
            for module, extra in (('stereo_recovery', qos), ('model_matcher', ['-p', f'models:=["{self.scene}"]'])):
                code = f'import sys; from {module}.node import main; sys.exit(main(sys.argv))'
                self.children.append(
                    subprocess.Popen(
                        [sys.executable, '-c', code, *remap, *extra],
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                    )
                )
            return
        self.nodes = [
            RecoveryNode(context=self.context, namespace=namespace),
            MatcherNode(
                context=self.context, namespace=namespace, parameter_overrides=[Parameter('models', value=[self.scene])]
            ),
        ]
        # The nodes have a thread of their own, so that feeding them does not keep them from working.
        self.node_executor = SingleThreadedExecutor(context=self.context)
        for node in self.nodes:
            self.node_executor.add_node(node)
        self.thread = threading.Thread(target=self.node_executor.spin, daemon=True)
        self.thread.start()

    def __exit__(self, *exception: object) -> None:
        if self.nodes:
            self.node_executor.shutdown()
            self.thread.join(5.0)
        for node in [*self.nodes, self.node]:
            node.destroy_node()
        self.executor.shutdown()
        self._rclpy.try_shutdown(context=self.context)
        for child in self.children:
            child.terminate()
        for child in self.children:
            try:
                child.wait(5.0)
            except subprocess.TimeoutExpired:
                child.kill()

    def _on_poses(self, message: Any) -> None:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        self.answers[stamp] = time.perf_counter()
        self.poses += bool(message.poses)

    def send(self) -> tuple[int, float]:
        """Publish one pair; its stamp, and when."""
        now = self.node.get_clock().now()
        for message in self.messages:
            message.header.stamp = now.to_msg()
        started = time.perf_counter()
        for publisher, message in zip(self.publishers, self.messages):
            publisher.publish(message)
        return now.nanoseconds, started

    def warm_up(self) -> None:
        """Until poses have come out three times. Raises TimeoutError, saying what is missing."""
        end = time.monotonic() + START_S
        while self.poses < 3:
            if time.monotonic() > end:
                raise TimeoutError(f'no pose within {START_S:g} s; {len(self.answers)} answers without one')
            self.send()
            self._spin(time.perf_counter() + 0.3)
        self._spin(time.perf_counter() + 0.5)

    def one_at_a_time(self, seconds: float) -> tuple[int, np.ndarray]:
        """How many pairs were sent, each when the last was answered, and the latencies of those answered, ms."""
        latencies = []
        sent = 0
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            stamp, at = self.send()
            sent += 1
            while stamp not in self.answers and time.perf_counter() < at + LOST_S:
                self.executor.spin_once(timeout_sec=0.05)
            if stamp in self.answers:
                latencies.append(1e3 * (self.answers[stamp] - at))
        return sent, np.array(latencies)

    def stream(self, rate_hz: float, seconds: float) -> tuple[int, np.ndarray]:
        """Pairs at a steady rate: how many were sent, and the latencies of those answered, ms."""
        sent: dict[int, float] = {}
        due = time.perf_counter()
        end = due + seconds
        while due < end:
            stamp, at = self.send()
            sent[stamp] = at
            due += 1.0 / rate_hz
            self._spin(due)
            due = max(due, time.perf_counter() - 1.0 / rate_hz)
        self._spin(time.perf_counter() + 0.3)
        return len(sent), 1e3 * np.array(
            [self.answers[stamp] - at for stamp, at in sent.items() if stamp in self.answers]
        )

    def _spin(self, until: float) -> None:
        while (left := until - time.perf_counter()) > 0.0:
            self.executor.spin_once(timeout_sec=left)
