"""Sequences of pictures from folders and bags."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from msgs_py import PinholeCamera, StereoRig
from msgs_py.node_runtime.stamp_sync import StampSync
from msgs_py.numeric.typed import ByteArray
from stereo_recovery.cameras.calibration import load_rig

from ..match_cli import load_camera
from .follow import PictureFrame

# Topics of a pair in a bag end so.
TOPICS = ('left/image_rect', 'left/camera_info', 'right/image_rect', 'right/camera_info')
PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm')


def picture_frames(path: Path, camera: Path | None = None, rate_hz: float = 30.0) -> Iterator[PictureFrame]:
    """The frames of a folder or of a bag.

    Parameters
    ----------
    path : Path
        A folder that ``closed_form --path`` has written; one of pictures, pairs of which are named alike but for
        ``left`` and ``right``; or a rosbag2 with the four topics of a rectified pair (needs rosbags).
    camera : Path, optional
        Calibration of a folder; camera.json in it without.
    rate_hz : float
        Frames a second of a folder that does not say when they were taken.

    Raises
    ------
    OSError, ValueError
        Something is missing, or is not what it should be.
    """
    if not path.is_dir():
        raise ValueError(f'{path}: no such folder, expected one of pictures, or a bag')
    if (path / 'metadata.yaml').exists():
        return _of_bag(path)
    return _of_folder(path, camera, rate_hz)


def _of_folder(path: Path, camera: Path | None, rate_hz: float) -> Iterator[PictureFrame]:
    pictures = path / 'images' if (path / 'images').is_dir() else path
    names = sorted(item for item in pictures.iterdir() if item.suffix.lower() in PICTURES)
    lefts = [name for name in names if 'left' in name.name]
    given = camera or path / 'camera.json'
    if not names:
        raise ValueError(f'{pictures}: there are no pictures')
    if not given.exists():
        raise ValueError(f'{path}: has no camera.json; expected --camera')
    stamps = _stamps(path)
    rig: StereoRig | PinholeCamera | None = None
    for number, name in enumerate(lefts or names):
        sides = [name]
        if lefts:
            sides.append(name.with_name(re.sub('left', 'right', name.name)))
        images = tuple(_grey(side) for side in sides)
        if rig is None:
            rig = load_rig(given, images[0].shape[::-1]) if lefts else load_camera(given)
        stamp = stamps[number] if number < len(stamps) else number / rate_hz
        yield PictureFrame(stamp, images, rig)


def _stamps(path: Path) -> list[float]:
    """When the frames of a written sequence were taken, seconds; none where nothing says."""
    truth = path / 'truth.csv'
    if not truth.exists():
        return []
    with truth.open(newline='', encoding='utf-8') as file:
        return [float(row['stamp_s']) for row in csv.DictReader(file)]


def _grey(path: Path) -> ByteArray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return np.asarray(image, np.uint8)


def _of_bag(path: Path) -> Iterator[PictureFrame]:
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(f'{path}: reading bags needs rosbags (pip install rosbags)') from None
    from ..node_views import grey_image

    store = get_typestore(Stores.LATEST)
    sync = StampSync(TOPICS)
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            topic = next((name for name in TOPICS if connection.topic.endswith(name)), None)
            if topic is None:
                continue
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp
            together = sync.add(topic, stamp.sec * 10**9 + stamp.nanosec, message)
            if together is None:
                continue
            images = tuple(grey_image(together[name]) for name in (TOPICS[0], TOPICS[2]))
            infos = [_info(together[name]) for name in (TOPICS[1], TOPICS[3])]
            yield PictureFrame(stamp.sec + 1e-9 * stamp.nanosec, images, StereoRig.from_camera_info(*infos))
    if not sync.counters.sets:
        raise ValueError(f'{path}: {sync.explain()}')


def _info(message: Any) -> SimpleNamespace:
    """What of a recorded camera_info is needed."""
    return SimpleNamespace(width=message.width, height=message.height, p=list(message.p))
