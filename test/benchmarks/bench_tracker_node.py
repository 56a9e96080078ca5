"""How long tracker_node takes from image to pose, in a process of its own, with two objects, at a rate.

    python test/benchmarks/bench_tracker_node.py --rate 30 60 120

Two parts turn before a rendered pair of 640 x 480; every pair is published on time, whether or not the one before is
answered. The time runs from the first of its four messages to the pose on ``tracked/<model>``; two poses a pair.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from results import add_record_option, keep
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from csg_renderer import Light, Scene, SolidOutline, load_models, render_stereo
from csg_renderer.raycast.sensor import SensorModel
from model_matcher.tracking.motion_filter import placed
from msgs_py import PinholeCamera, Pose, StereoRig
from msgs_py.codecs import array_to_image, camera_infos_from_rig, pose_to_message
from msgs_py.node_runtime.transport import make_room_for_images

PARTS = ('l_shape', 'chipped_block')
RIG = StereoRig.symmetric(PinholeCamera.centred(640, 480, 600.0), 0.06)
DOMAIN, TURN_DEG_S, FRAMES = '93', 20.0, 60
QUANTILES = (50, 90, 99)
PSF = 0.5


class Player:
    """A node that publishes pairs and hears poses, spun by a thread."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        solids = [next(iter(load_models(name).values())) for name in PARTS]
        self.shapes = [SolidOutline(solid) for solid in solids]
        lights = [Light((0.3, -0.5, 0.2), (0.8,) * 3)]
        self.pairs = []
        for frame in range(FRAMES):
            placed_solids = [solid.transformed(pose) for solid, pose in zip(solids, self.poses(frame))]
            frames = render_stereo(Scene(placed_solids, lights, (0.2,) * 3, (0.4,) * 3), RIG, antialias=2, psf=PSF)
            self.pairs.append(
                [SensorModel(PSF, 1.5, (frame, eye)).picture(one, monochrome=True) for eye, one in enumerate(frames)]
            )
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=int(DOMAIN))
        self.node = node = Node('player', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(node)
        self.sent: dict[tuple[int, int], float] = {}
        self.times: list[float] = []
        for name in PARTS:
            node.create_subscription(PoseWithCovarianceStamped, f'tracked/{name}', self._heard, 10)
        self.infos = [node.create_publisher(CameraInfo, f'{side}/camera_info', 5) for side in ('left', 'right')]
        self.images = [node.create_publisher(Image, f'{side}/image_rect', 5) for side in ('left', 'right')]
        self.starts = [node.create_publisher(PoseWithCovarianceStamped, f'track/{name}', 5) for name in PARTS]
        self.stopped = False
        threading.Thread(target=self._spin, daemon=True).start()

    def poses(self, frame: int) -> list[Pose]:
        """Of both parts; they turn to and fro."""
        way = frame % (2 * FRAMES - 2)
        angle = TURN_DEG_S / self.rate * min(way, 2 * FRAMES - 2 - way)
        return [
            placed(
                Rotation.from_euler('xyz', [25, 30 + angle, 10 * k], degrees=True).as_matrix(),
                np.array([-0.06 + 0.13 * k, 0.0, 4.0 * shape.size]),
                shape.centre,
            )
            for k, shape in enumerate(self.shapes)
        ]

    def send(self, number: int) -> None:
        """Publish a pair."""
        header = self.header(number)
        way = number % (2 * FRAMES - 2)
        pair = self.pairs[min(way, 2 * FRAMES - 2 - way)]
        messages = [array_to_image(image, 'mono8', header) for image in pair]
        self.sent[header.stamp.sec, header.stamp.nanosec] = time.perf_counter()
        for out, message in zip((*self.infos, *self.images), (*camera_infos_from_rig(RIG, header), *messages)):
            out.publish(message)

    def begin(self) -> None:
        """Say where both parts are in the first pair."""
        for out, pose in zip(self.starts, self.poses(0)):
            message = PoseWithCovarianceStamped(header=self.header(0))
            message.pose.pose = pose_to_message(pose)
            out.publish(message)

    def header(self, number: int) -> Header:
        header = Header(frame_id='left')
        header.stamp.sec, header.stamp.nanosec = divmod(10**9 + int(number * 1e9 / self.rate), 10**9)
        return header

    def heard_by_node(self) -> bool:
        outs = (*self.infos, *self.images, *self.starts)
        return all(out.get_subscription_count() for out in outs)

    def close(self) -> None:
        self.stopped = True
        time.sleep(0.2)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def _heard(self, message: PoseWithCovarianceStamped) -> None:
        stamp = message.header.stamp
        self.times.append(1e3 * (time.perf_counter() - self.sent[stamp.sec, stamp.nanosec]))

    def _spin(self) -> None:
        while not self.stopped:
            self.executor.spin_once(timeout_sec=0.05)


def run(rate: float, pairs: int) -> dict[str, float]:
    """How many poses came of how many, and how long they took, ms. Raises RuntimeError where none come."""
    player = Player(rate)
    models = f'models:=[{", ".join(repr(name) for name in PARTS)}]'
    command = [sys.executable, '-m', 'model_matcher.tracker_node', '--ros-args', '-p', models]
    process = subprocess.Popen(command, env={**os.environ, 'ROS_DOMAIN_ID': DOMAIN, 'OPENBLAS_NUM_THREADS': '1'})
    try:
        deadline = time.monotonic() + 60.0
        while not player.heard_by_node():
            if time.monotonic() > deadline:
                raise RuntimeError(f'{rate:g} Hz: tracker_node does not come')
            time.sleep(0.1)
        deadline = time.monotonic() + 120.0
        while len(player.times) < len(PARTS):  # once it has loaded what was compiled
            if time.monotonic() > deadline:
                raise RuntimeError(f'{rate:g} Hz: tracker_node does not answer')
            player.send(0)
            time.sleep(0.5)
            player.begin()
            time.sleep(0.5)
        player.times.clear()
        begun = time.perf_counter()
        for number in range(1, pairs + 1):
            time.sleep(max(0.0, begun + number / rate - time.perf_counter()))
            player.send(number)
        time.sleep(1.0)
    finally:
        process.terminate()
        process.wait(10.0)
        player.close()
    quantiles = {f'p{q}': float(np.percentile(player.times, q)) for q in QUANTILES}
    return {'asked': len(PARTS) * pairs, 'poses': len(player.times), **quantiles}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description='tracker_node: image to pose.')
    parser.add_argument('--rate', type=float, nargs='+', default=[30.0, 60.0], metavar='HZ')
    parser.add_argument('--pairs', type=int, default=300)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    make_room_for_images()
    figures = {}
    for rate in options.rate:
        row = figures[f'{rate:g} Hz'] = run(rate, options.pairs)
        print(
            f'{rate:g} Hz: {row["poses"]} of {row["asked"]} poses; image to pose '
            + ', '.join(f'p{q} {row[f"p{q}"]:.1f}' for q in QUANTILES)
            + ' ms',
            flush=True,
        )
    if options.record:
        keep(options.record, figures, timed=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
