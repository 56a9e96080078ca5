"""Undistorting and rectifying raw images from their calibration (Hartley & Zisserman 11.12; OpenCV's remap)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from msgs_py import StereoRig

MODELS = {'': 5, 'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}


@dataclass(frozen=True, eq=False)
class Calibration:
    """One camera of a pair, as sensor_msgs/CameraInfo gives it.

    width, height : pixels, of the raw image; model : 'plumb_bob', 'rational_polynomial' or 'equidistant'
    distortion : (n,) float64; matrix : (3, 3) of the raw camera; rotation : (3, 3), rectified_R_raw
    projection : (3, 4) float64, of the rectified camera
    """

    width: int
    height: int
    model: str
    distortion: np.ndarray
    matrix: np.ndarray
    rotation: np.ndarray
    projection: np.ndarray

    @classmethod
    def from_camera_info(cls, side: str, info: Any) -> Calibration:
        """From any object with the fields of a CameraInfo. Raises ValueError naming side and field."""
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
        if abs(np.linalg.det(arrays['r'])) < 0.5:
            raise ValueError(f'{side} camera_info: R is no rotation: {arrays["r"].ravel().tolist()}')
        model = str(getattr(info, 'distortion_model', ''))
        if model not in MODELS:
            raise ValueError(
                f'{side} camera_info: distortion_model {model!r} is unknown, expected one of '
                + ', '.join(repr(m) for m in MODELS if m)
            )
        distortion = np.asarray(info.d, dtype=np.float64).ravel()
        if not np.isfinite(distortion).all():
            raise ValueError(f'{side} camera_info: D contains NaN or infinity')
        if len(distortion) not in (0, 4, 5, 8, 12, 14):
            raise ValueError(f'{side} camera_info: D has {len(distortion)} elements, expected {MODELS[model]}')
        return cls(int(info.width), int(info.height), model, distortion, arrays['k'], arrays['r'], arrays['p'])


class Rectifier:
    """Maps for one pair of cameras, made once.

    rig : the StereoRig of the rectified images. Raises ValueError, naming what is wrong with the calibration.
    """

    def __init__(self, left: Any, right: Any) -> None:
        """left, right : CameraInfo messages, or objects with their fields."""
        self.rig = StereoRig.from_camera_info(left, right)
        self._maps = []
        self._sizes = []
        for side, info in (('left', left), ('right', right)):
            calibration = Calibration.from_camera_info(side, info)
            size = (calibration.width, calibration.height)
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
            self._maps.append(maps)
            self._sizes.append(size)

    def apply(self, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rectified images. Raises ValueError when an image is not of the calibration's size."""
        result = []
        for side, image, maps, size in zip(('left', 'right'), (left, right), self._maps, self._sizes):
            if image.shape[1::-1] != size:
                raise ValueError(
                    f'{side} image: {image.shape[1]} x {image.shape[0]} pixels, its camera_info says '
                    f'{size[0]} x {size[1]}'
                )
            # Lanczos keeps edges where they are; linear interpolation would blur them by place.
            result.append(cv2.remap(image, maps[0], maps[1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE))
        return result[0], result[1]
