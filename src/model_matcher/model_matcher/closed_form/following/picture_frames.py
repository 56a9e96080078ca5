"""Sequences of pictures from folders and bags."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from msgs_py import PinholeCamera, StereoRig
from msgs_py.files import check_image
from msgs_py.numeric.typed import ByteArray
from stereo_recovery.cameras.calibration import load_rig

from ...match_cli import load_camera
from ..recordings.bag_reader import StereoBag, is_bag
from .follow import PictureFrame

PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm')


def picture_frames(path: Path, camera: Path | None = None, rate_hz: float = 30.0) -> Iterator[PictureFrame]:
    """The frames of a folder or of a bag.

    Parameters
    ----------
    path : Path
        A folder that ``closed_form --path`` has written; one of pictures, pairs of which are named alike but for
        ``left`` and ``right``; or a bag with the four topics of a rectified pair (needs rosbags), images raw or
        compressed, camera_info with each of them or once.
    camera : Path, optional
        Calibration of a folder; camera.json in it without.
    rate_hz : float
        Frames a second of a folder that does not say when they were taken.

    Raises
    ------
    OSError, ValueError
        Something is missing, or is not what it should be.
    """
    if is_bag(path):
        return _of_bag(path)
    if not path.is_dir():
        raise ValueError(f'{path}: no such folder, expected one of pictures, or a bag')
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
    for pair in StereoBag(path):
        yield PictureFrame(1e-9 * pair.stamp_ns, pair.images, pair.rig)
