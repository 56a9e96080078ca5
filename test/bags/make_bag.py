"""Makes a small bag (rosbag2, sqlite3) of the chessboard pair, as a stereo driver would have recorded it.

    python test/bags/make_bag.py chessboards            # rectified images
    python test/bags/make_bag.py chessboards --raw      # images as they were taken: for recovery_node rectify:=true

Play it with ros2 bag play, or in Python with the functions below. Needs rosbags (pip).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from msgs_py import codecs
from stereo_recovery.cameras.calibration import CameraFile, load_cameras

# Calibration is in squares of the board; one is taken to be this long.
SQUARE_M = 0.025
START_S = 1_700_000_000
NANOSECONDS = 1_000_000_000
FRAME = 'chessboard_left_optical_frame'


def camera_info(camera: CameraFile, header: Header) -> CameraInfo:
    """The message of a calibration file, lengths in metres."""
    projection = np.array(camera.p, float)
    projection[3] *= SQUARE_M
    return CameraInfo(
        header=header,
        width=camera.width,
        height=camera.height,
        distortion_model=camera.distortion_model,
        d=list(map(float, camera.d)),
        k=list(map(float, camera.k)),
        r=list(map(float, camera.r)),
        p=projection.tolist(),
    )


def messages(pairs: int, rate: float, raw: bool, seed: int = 0) -> Iterator[tuple[str, int, Any]]:
    """(topic, time in ns, message). Every pair has sensor noise of its own, of one grey level."""
    folder = resources.files('stereo_recovery') / 'data' / 'chessboard'
    names = {side: f'{side}01.jpg' if raw else f'{side}01_rect.png' for side in ('left', 'right')}
    images = {side: cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for side, name in names.items()}
    height, width = images['left'].shape
    cameras = dict(zip(images, load_cameras(Path(str(folder / 'calibration.yaml')), (width, height))))
    rng = np.random.default_rng(seed)
    for number in range(pairs):
        time_ns = START_S * NANOSECONDS + round(number * NANOSECONDS / rate)
        header = Header(frame_id=FRAME)
        header.stamp.sec, header.stamp.nanosec = divmod(time_ns, NANOSECONDS)
        for side, image in images.items():
            noisy = np.clip(image + rng.normal(0.0, 1.0, image.shape), 0, 255).astype(np.uint8)
            yield f'/{side}/image_rect', time_ns, codecs.array_to_image(noisy, 'mono8', header)
            yield f'/{side}/camera_info', time_ns, camera_info(cameras[side], header)


def write_bag(path: Path, pairs: int = 5, rate: float = 2.0, raw: bool = False) -> None:
    """Write the bag; path must not exist yet."""
    store = get_typestore(Stores.LATEST)
    with Writer(path, version=9) as writer:
        connections: dict[str, Any] = {}
        for topic, time_ns, message in messages(pairs, rate, raw):
            if topic not in connections:
                kind = 'sensor_msgs/msg/' + type(message).__name__
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time_ns, serialize_message(message))


def read_bag(path: Path) -> Iterator[tuple[str, int, bytes]]:
    """(topic, time in ns, serialised message): a publisher of rclpy sends such bytes as they are."""
    with Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            yield connection.topic, time_ns, bytes(data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('bag', type=Path, help='folder to make')
    parser.add_argument('--pairs', type=int, default=5)
    parser.add_argument('--rate', type=float, default=2.0, help='pairs a second')
    parser.add_argument('--raw', action='store_true', help='images as taken, with their distortion')
    options = parser.parse_args()
    write_bag(options.bag, options.pairs, options.rate, options.raw)
    print(f'{options.bag}: {options.pairs} pairs')


if __name__ == '__main__':
    main()
