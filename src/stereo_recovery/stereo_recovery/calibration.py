"""Calibration files to a StereoRig: OpenCV's YAML with the projection matrices P1 and P2 of a rectified pair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from msgs_py import StereoRig


@dataclass(frozen=True)
class _Projection:
    """What StereoRig.from_camera_info wants of a camera."""

    width: int
    height: int
    p: np.ndarray


def load_rig(path: str | Path, image_size: tuple[int, int] | None = None) -> StereoRig:
    """The rectified rig of an OpenCV calibration file (cv2.stereoRectify's P1, P2 and the image size).

    image_size : (width, height), pixels, when the file has neither image_size nor image_width and image_height
    The baseline is in the file's unit of length.
    Raises FileNotFoundError, and ValueError that names the file and what it lacks.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f'{path}: no such calibration file')
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        projections = [storage.getNode(name).mat() for name in ('P1', 'P2')]
        width, height = image_size or _image_size(storage)
    except cv2.error as error:
        raise ValueError(f'{path}: not an OpenCV calibration file: {error}') from None
    for name, matrix in zip(('P1', 'P2'), projections):
        if matrix is None or matrix.shape != (3, 4):
            raise ValueError(f'{path}: {name} is missing, expected a 3 x 4 projection matrix of the rectified pair')
    if width < 1 or height < 1:
        raise ValueError(f'{path}: the image size is missing, expected image_size or image_width and image_height')
    try:
        return StereoRig.from_camera_info(*(_Projection(width, height, matrix) for matrix in projections))
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _image_size(storage: cv2.FileStorage) -> tuple[int, int]:
    node = storage.getNode('image_size')
    if not node.empty():
        if node.isSeq():
            return int(node.at(0).real()), int(node.at(1).real())
        values = node.mat()
        return (0, 0) if values is None else (int(values.ravel()[0]), int(values.ravel()[1]))
    return int(storage.getNode('image_width').real()), int(storage.getNode('image_height').real())
