"""Undistorting and rectifying raw images from their calibration (Hartley & Zisserman 11.12; OpenCV's remap)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from msgs_py import CameraRig, Pose, StereoRig
from msgs_py.camera import ImageWindow
from msgs_py.numeric.typed import AnyArray, FloatArray
from msgs_py.settings import RECTIFIED_TOLERANCE

from .calibration import nearest_rotation
from .settings import COEFFICIENTS, DISTORTION_MODELS


@dataclass(frozen=True, eq=False)
class Calibration:
    """One camera of a pair, as sensor_msgs/CameraInfo gives it.

    Attributes
    ----------
    width, height : int
        Pixels. Of the raw image, after region of interest and binning; the matrices are of its pixels.
    model : str
        One of :data:`~.settings.DISTORTION_MODELS`.
    distortion : (n,) float64
        Coefficients of the model.
    matrix : (3, 3) float64, pixels
        Calibration matrix of the raw camera.
    rotation : (3, 3) float64
        rectified_R_raw.
    projection : (3, 4) float64, pixels
        Of the rectified camera.
    """

    width: int
    height: int
    model: str
    distortion: FloatArray
    matrix: FloatArray
    rotation: FloatArray
    projection: FloatArray

    @classmethod
    def from_camera_info(cls, side: str, info: Any) -> Calibration:
        """From any object with the fields of a CameraInfo.

        Parameters
        ----------
        side : str
            'left' or 'right', for messages.
        info : CameraInfo
            The message, or an object with its fields.

        Returns
        -------
        Calibration

        Raises
        ------
        ValueError
            When a field is unusable; the message names side and field.
        """
        arrays = {}
        for name, shape in (('k', (3, 3)), ('r', (3, 3)), ('p', (3, 4))):
            value = np.asarray(getattr(info, name), dtype=np.float64)
            if value.size != shape[0] * shape[1] or not np.isfinite(value).all():
                raise ValueError(
                    f'{side} camera_info: {name.upper()} has to be {shape[0]} x {shape[1]} finite '
                    f'numbers, got {value.ravel().tolist()}'
                )
            arrays[name] = value.reshape(shape)
        if arrays['k'][0, 0] <= 0.0 or arrays['k'][1, 1] <= 0.0:
            raise ValueError(
                f'{side} camera_info: K has focal lengths {arrays["k"][0, 0]:g} and '
                f'{arrays["k"][1, 1]:g}, expected > 0 (is the camera calibrated?)'
            )
        skew = arrays['k'][0, 1]
        if abs(skew) > RECTIFIED_TOLERANCE * arrays['k'][0, 0]:
            raise ValueError(f'{side} camera_info: K[0,1] (skew) is {skew:g}, expected 0: square axes')
        rotation = nearest_rotation(arrays['r'])
        if rotation is None:
            raise ValueError(f'{side} camera_info: R is no rotation: {arrays["r"].ravel().tolist()}')
        model = str(getattr(info, 'distortion_model', ''))
        if model not in DISTORTION_MODELS:
            raise ValueError(
                f'{side} camera_info: distortion_model {model!r} is unknown, expected one of '
                + ', '.join(repr(m) for m in DISTORTION_MODELS if m)
            )
        distortion = np.asarray(info.d, dtype=np.float64).ravel()
        if not np.isfinite(distortion).all():
            raise ValueError(f'{side} camera_info: D contains NaN or infinity')
        if len(distortion) not in COEFFICIENTS:
            raise ValueError(
                f'{side} camera_info: D has {len(distortion)} elements, expected {DISTORTION_MODELS[model]}'
            )
        # Lenses distort where a point is seen, not which pixels are read: only the matrices know of these.
        window = ImageWindow.of(side, info)
        matrix, projection = window.seen(arrays['k']), window.seen(arrays['p'])
        return cls(window.width, window.height, model, distortion, matrix, rotation, projection)


class Straightener:
    """Undistortion and rectification of one camera's images, by maps that are made once.

    Parameters
    ----------
    side : str
        What the camera is called in messages: left, right, camera_0.
    info : CameraInfo
        The message, or an object with its fields.

    Raises
    ------
    ValueError
        For an unusable calibration; the message names what is wrong with it.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd edition, section 11.12.
    """

    def __init__(self, side: str, info: Any) -> None:
        self.side = side
        calibration = Calibration.from_camera_info(side, info)
        self.rotation = calibration.rotation
        self._size = size = (calibration.width, calibration.height)
        new = np.ascontiguousarray(calibration.projection[:, :3])
        if calibration.model == 'equidistant':
            distortion = np.resize(calibration.distortion, 4) if len(calibration.distortion) else np.zeros(4)
            maps = cv2.fisheye.initUndistortRectifyMap(
                calibration.matrix, distortion.reshape(4, 1), calibration.rotation, new, size, cv2.CV_32FC1
            )
        else:
            distortion = calibration.distortion if len(calibration.distortion) else np.zeros(5)
            maps = cv2.initUndistortRectifyMap(
                calibration.matrix, distortion, calibration.rotation, new, size, cv2.CV_32FC1
            )
        self._maps = np.asarray(maps[0]), np.asarray(maps[1])

    def apply(self, image: AnyArray) -> AnyArray:
        """The rectified image, (h, w) or (h, w, 3), of the same element type. Raises ValueError for another size."""
        if image.shape[1::-1] != self._size:
            raise ValueError(
                f'{self.side} image: {image.shape[1]} x {image.shape[0]} pixels, its camera_info says '
                f'{self._size[0]} x {self._size[1]}'
            )
        # Lanczos keeps edges where they are; linear interpolation would blur them by their sub-pixel position.
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE))


class Rectifier:
    """Undistortion and rectification of one pair of cameras.

    Parameters
    ----------
    left, right : CameraInfo
        The messages, or objects with their fields.

    Attributes
    ----------
    rig : StereoRig
        Of the rectified images.

    Raises
    ------
    ValueError
        For an unusable calibration; the message names what is wrong with it.
    """

    def __init__(self, left: Any, right: Any) -> None:
        self.rig = StereoRig.from_camera_info(left, right)
        self._sides = Straightener('left', left), Straightener('right', right)

    def apply(self, left: AnyArray, right: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Rectified images.

        Parameters
        ----------
        left, right : (h, w) or (h, w, 3)
            Raw images.

        Returns
        -------
        left, right : (h, w) or (h, w, 3)
            Of the same element type.

        Raises
        ------
        ValueError
            When an image is not of the calibration's size.
        """
        return self._sides[0].apply(left), self._sides[1].apply(right)


class RigImages:
    """What takes messages of any number of cameras to images without distortion, and to their rig.

    Parameters
    ----------
    infos : sequence of CameraInfo
        The messages, or objects with their fields.
    poses : sequence of Pose, optional
        first_T_camera of the cameras whose images come; by default those that P says.
    raw : bool
        Whether the images are raw: they are undistorted, and turned as R says.

    Attributes
    ----------
    rig : CameraRig
        Of the images without distortion.

    Raises
    ------
    ValueError
        For an unusable calibration; the message names camera and field.
    """

    def __init__(self, infos: Sequence[Any], poses: Sequence[Pose] | None = None, raw: bool = False) -> None:
        self._sides = [Straightener(f'camera_{k}', info) for k, info in enumerate(infos)] if raw else []
        if poses is not None and raw and len(poses) == len(infos):
            # The poses are those of the raw cameras, and R turns each about its centre.
            turns = [Pose(side.rotation) for side in self._sides]
            poses = [turns[0].compose(pose).compose(turn.inverse()) for pose, turn in zip(poses, turns)]
            poses[0] = Pose.identity()
        self.rig = CameraRig.from_camera_info(infos, poses)

    def apply(self, images: Sequence[AnyArray]) -> list[AnyArray]:
        """Images without distortion, of one raw or rectified image of each camera, (h, w) or (h, w, 3).

        Raises ValueError when one is not of its calibration's size.
        """
        return [side.apply(image) for side, image in zip(self._sides, images)] if self._sides else list(images)
