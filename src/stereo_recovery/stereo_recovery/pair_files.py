"""A stereo pair as files: two images and their calibration, read, and checked against each other.

What does not go together is refused here, where the names of the files are known, with what to do about it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from msgs_py import StereoRig
from msgs_py.files import check_image
from msgs_py.numeric.typed import AnyArray

from .cameras.calibration import CameraFile, load_cameras
from .cameras.rectification import Rectifier
from .settings import PICTURES

ORDER = 'expected the left image, the right image and the calibration, in this order'


@dataclass(frozen=True, eq=False)
class PairFiles:
    """A rectified pair, and what it was read from.

    Attributes
    ----------
    left, right : (h, w) or (h, w, 3) uint8 or uint16
        Rectified.
    rig : StereoRig
        Metres, or the unit of the calibration.
    images : (Path, Path)
        Files of the left and of the right image.
    calibration : Path
    lenses : bool
        The calibration has distortion or turns that the images were not corrected for, being taken as rectified.
    """

    left: AnyArray
    right: AnyArray
    rig: StereoRig
    images: tuple[Path, Path]
    calibration: Path
    lenses: bool = False

    def __str__(self) -> str:
        camera = self.rig.left
        return (
            f'{camera.width} x {camera.height} pixels, focal length {camera.fx:.1f} pixels, '
            f'baseline {1e3 * self.rig.baseline:.4g} mm'
        )


def read_pair(
    images: tuple[Path, Path], calibration: Path, raw: bool = False, baseline: float | None = None
) -> PairFiles:
    """Read a pair.

    Parameters
    ----------
    images : (Path, Path)
        Left and right.
    calibration : Path
        In a form of :func:`~stereo_recovery.cameras.calibration.load_cameras`.
    raw : bool
        The images are as the cameras took them: undistort and rectify them.
    baseline : float, optional
        Metres, in place of the calibration's.

    Raises
    ------
    OSError, ValueError
        A file is missing or none of its kind, or they do not go together; the message begins with the file's name and
        ends with the remedy.
    """
    if baseline is not None and not 0.0 < baseline < np.inf:
        raise ValueError(f'--baseline: expected metres above 0, got {baseline:g}')
    left, right = (read_image(path) for path in images)
    if left.shape[:2] != right.shape[:2]:
        raise ValueError(
            f'{images[1]}: {_size(right)} pixels, but {images[0]} has {_size(left)}: '
            'give two images of one moment from the same pair of cameras'
        )
    if np.array_equal(left, right):
        raise ValueError(f'{images[1]}: the same picture as {images[0]}: give the right one of the pair')
    size = (left.shape[1], left.shape[0])
    if calibration.suffix.lower() in PICTURES:
        raise ValueError(f'{calibration}: a picture, and no calibration: {ORDER}')
    cameras = _with_baseline(load_cameras(calibration, size), calibration, baseline)
    for camera, path in zip(cameras, images):
        if (camera.width, camera.height) != size:
            raise ValueError(
                f'{calibration}: is for images of {camera.width} x {camera.height} pixels, but {path} has '
                f'{size[0]} x {size[1]}: give images of the size that was calibrated, or calibrate at this size'
            )
    try:
        if raw:
            rectifier = Rectifier(*cameras)
            left, right = rectifier.apply(left, right)
            return PairFiles(left, right, rectifier.rig, images, calibration)
        rig = StereoRig.from_camera_info(*cameras)
    except ValueError as error:
        raise ValueError(f'{calibration}: {str(error).split("; P =")[0]}') from None
    return PairFiles(left, right, rig, images, calibration, any(_corrects(camera) for camera in cameras))


def read_image(path: Path) -> AnyArray:
    """(h, w) or (h, w, 3): the image in a file. Raises OSError or ValueError when there is none."""
    image = cv2.imread(str(check_image(path)), cv2.IMREAD_UNCHANGED)
    if image is None:
        other = '' if path.suffix.lower() in PICTURES else f': {ORDER}'
        raise ValueError(f'{path}: not a readable image{other}')
    return np.asarray(image)


def _size(image: AnyArray) -> str:
    return f'{image.shape[1]} x {image.shape[0]}'


def _with_baseline(
    cameras: tuple[CameraFile, CameraFile], path: Path, baseline: float | None
) -> tuple[CameraFile, CameraFile]:
    """The cameras with this baseline, metres. Raises ValueError where neither they nor the caller has one."""
    left, right = cameras
    if len(right.p) != 12 or len(left.p) != 12:
        return cameras  # refused with its own words
    if baseline is not None:
        return replace(left, p=[*left.p[:3], 0.0, *left.p[4:]]), replace(
            right, p=[*right.p[:3], -right.p[0] * baseline, *right.p[4:]]
        )
    if left.p[3] == 0.0 and right.p[3] == 0.0 and right.p[0] > 0.0:
        raise ValueError(
            f'{path}: the baseline is missing: P[0,3] of the right camera is 0, expected -fx * baseline. '
            "Give the calibration of both cameras (not the left one's twice), or --baseline METRES"
        )
    return cameras


def _corrects(camera: CameraFile) -> bool:
    """Whether a calibration says that raw images of this camera are not rectified."""
    k, p = np.asarray(camera.k, float), np.asarray(camera.p, float).reshape(3, 4)[:, :3].ravel()
    turned = len(camera.r) == 9 and not np.array_equal(camera.r, np.eye(3).ravel())
    return bool(np.any(camera.d)) or turned or not np.array_equal(k, p)
