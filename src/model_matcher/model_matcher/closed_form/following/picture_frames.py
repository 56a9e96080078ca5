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
from msgs_py.files import check_image
from msgs_py.node_runtime.stamp_sync import StampSync
from msgs_py.numeric.typed import ByteArray
from stereo_recovery.cameras.calibration import load_rig

from ...match_cli import load_camera
from .follow import PictureFrame

# Topics of a pair in a bag end so; images may be compressed, and camera_info may be sent once.
IMAGES = ('left/image_rect', 'right/image_rect')
INFOS = ('left/camera_info', 'right/camera_info')
COMPRESSED = '/compressed'
PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm')


def picture_frames(path: Path, camera: Path | None = None, rate_hz: float = 30.0) -> Iterator[PictureFrame]:
    """The frames of a folder or of a bag.

    Parameters
    ----------
    path : Path
        A folder that ``closed_form --path`` has written; one of pictures, pairs of which are named alike but for
        ``left`` and ``right``; or a rosbag2 with the four topics of a rectified pair (needs rosbags), images
        raw or compressed, camera_info with each of them or once.
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
    image = cv2.imread(str(check_image(path)), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return np.asarray(image, np.uint8)


def _of_bag(path: Path) -> Iterator[PictureFrame]:
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(f'{path}: reading bags needs rosbags (pip install rosbags)') from None
    store = get_typestore(Stores.LATEST)
    sync = StampSync(IMAGES)
    with Reader(path) as reader:
        # A latched camera_info may stand anywhere in the bag: the first of each side holds until another comes.
        infos: dict[str, SimpleNamespace] = {}
        latched = [one for one in reader.connections if one.topic.endswith(INFOS)]
        # Of no connection at all the reader takes every one.
        for connection, _, data in reader.messages(latched) if latched else ():
            name = next(name for name in INFOS if connection.topic.endswith(name))
            infos.setdefault(name, _info(store.deserialize_cdr(data, connection.msgtype)))
            if len(infos) == len(INFOS):
                break
        missing = [name for name in INFOS if name not in infos]
        if missing:
            raise ValueError(f'{path}: no topic ends in {" or ".join(missing)}, and nothing says what the cameras are')
        for connection, _, data in reader.messages():
            topic = next((name for name in (*IMAGES, *INFOS) if _is_topic(connection.topic, name)), None)
            if topic is None:
                continue
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            if topic in INFOS:
                infos[topic] = _info(message)
                continue
            stamp = message.header.stamp
            together = sync.add(topic, stamp.sec * 10**9 + stamp.nanosec, message)
            if together is not None:
                images = tuple(_recorded_grey(together[name], path) for name in IMAGES)
                rig = StereoRig.from_camera_info(*(infos[name] for name in INFOS))
                yield PictureFrame(stamp.sec + 1e-9 * stamp.nanosec, images, rig)
    if not sync.counters.sets:
        raise ValueError(f'{path}: {sync.explain()}')


def _is_topic(recorded: str, name: str) -> bool:
    """Whether a recorded topic is one of this name, compressed or not."""
    return recorded.removesuffix(COMPRESSED).endswith(name)


def _recorded_grey(message: Any, path: Path) -> ByteArray:
    """(h, w) uint8 of a recorded image. Raises ValueError for one that cannot be read."""
    # The codecs need message classes, which a folder of pictures does without.
    from msgs_py.codecs import CodecError, gray_from_image

    try:
        return gray_from_image(message)
    except CodecError as error:
        raise ValueError(f'{path}: {error}') from None


def _info(message: Any) -> SimpleNamespace:
    """What of a recorded camera_info is needed."""
    return SimpleNamespace(width=message.width, height=message.height, p=list(message.p))
