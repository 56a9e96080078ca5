"""Pinhole cameras and rectified stereo rigs, in the ROS optical frame (x right, y down, z forward).

Pixels follow OpenCV: integer (u, v) is a pixel's centre, so a centred principal point is (width - 1) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

# Relative slack when two intrinsics that a rectified pair must share are compared: calibration files carry about
# this many digits.
RECTIFIED_TOLERANCE = 1e-6


@dataclass(frozen=True)
class PinholeCamera:
    """An ideal pinhole camera.

    width, height : int, pixels; fx, fy : float > 0, pixels; cx, cy : float, pixels.
    Raises ValueError, naming the field.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ('width', 'height'):
            value = getattr(self, name)
            if int(value) != value or value < 1:
                raise ValueError(f'{name}: expected a whole number of pixels >= 1, got {value}')
            object.__setattr__(self, name, int(value))
        for name in ('fx', 'fy', 'cx', 'cy'):
            value = float(getattr(self, name))
            if not np.isfinite(value):
                raise ValueError(f'{name}: expected a finite number of pixels, got {value}')
            if name in ('fx', 'fy') and value <= 0.0:
                raise ValueError(f'{name}: expected a focal length > 0 pixels, got {value} (is the camera calibrated?)')
            object.__setattr__(self, name, value)

    @classmethod
    def centred(cls, width: int, height: int, focal: float) -> PinholeCamera:
        """Square pixels, principal point in the middle of the image; focal in pixels."""
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) float64, the calibration matrix K (Hartley & Zisserman 6.1)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points: ArrayLike) -> np.ndarray:
        """Camera-frame points (..., 3), metres, to pixels (..., 2). Points with z <= 0 give NaN."""
        p = np.asarray(points, dtype=np.float64)
        z = np.where(p[..., 2] > 0.0, p[..., 2], np.nan)
        return np.stack([self.fx * p[..., 0] / z + self.cx, self.fy * p[..., 1] / z + self.cy], axis=-1)

    def rays(self, pixels: ArrayLike) -> np.ndarray:
        """Pixels (..., 2) to viewing directions (..., 3) with z = 1 (not normalised), camera frame."""
        uv = np.asarray(pixels, dtype=np.float64)
        x = (uv[..., 0] - self.cx) / self.fx
        y = (uv[..., 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def pixel_grid(self) -> np.ndarray:
        """(height, width, 2) float64: (u, v) of every pixel's centre."""
        v, u = np.mgrid[0 : self.height, 0 : self.width]
        return np.stack([u, v], axis=-1).astype(np.float64)

    def contains(self, pixels: ArrayLike) -> np.ndarray:
        """(...,) bool: inside the image area, borders of the outermost pixels included. NaN is outside."""
        uv = np.asarray(pixels, dtype=np.float64)
        u, v = uv[..., 0], uv[..., 1]
        with np.errstate(invalid='ignore'):
            return (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)


@dataclass(frozen=True)
class StereoRig:
    """A rectified pair: equal fx, fy, cy and size; the right camera sits at +baseline along the left camera's x.

    left, right : PinholeCamera (cx may differ: a disparity offset); baseline : float > 0, metres.
    Raises ValueError, naming what disagrees.
    """

    left: PinholeCamera
    right: PinholeCamera
    baseline: float

    def __post_init__(self) -> None:
        baseline = float(self.baseline)
        if not np.isfinite(baseline) or baseline <= 0.0:
            raise ValueError(f'baseline: expected a finite distance > 0 m, got {baseline}')
        object.__setattr__(self, 'baseline', baseline)
        for name in ('width', 'height'):
            a, b = getattr(self.left, name), getattr(self.right, name)
            if a != b:
                raise ValueError(f'{name}: left image has {a} pixels and right {b}; a rectified pair has one size')
        for name in ('fx', 'fy', 'cy'):
            a, b = getattr(self.left, name), getattr(self.right, name)
            if abs(a - b) > RECTIFIED_TOLERANCE * max(abs(a), abs(b), 1.0):
                raise ValueError(f'{name}: left camera has {a} and right {b}; they are equal in a rectified pair')

    @classmethod
    def symmetric(cls, camera: PinholeCamera, baseline: float) -> StereoRig:
        """Both eyes alike."""
        return cls(camera, camera, baseline)

    @classmethod
    def from_camera_info(cls, left: Any, right: Any) -> StereoRig:
        """From the projection matrices P of two sensor_msgs/CameraInfo (any objects with width, height, p).

        The right camera's P[0,3] must be -fx * baseline: negative, in pixel-metres. Zero, positive and
        non-finite values are refused with the matrix printed (sensor_msgs/CameraInfo.msg).
        """
        p_left, p_right = (_projection(side, info) for side, info in (('left', left), ('right', right)))
        if abs(p_left[0, 3]) > RECTIFIED_TOLERANCE * p_left[0, 0]:
            hint = ' (are left and right exchanged?)' if p_right[0, 3] == 0.0 else ''
            raise ValueError(f'left camera_info: P[0,3] is {p_left[0, 3]:g}, expected 0{hint}; P =\n{p_left}')
        offset = p_right[0, 3]
        if offset == 0.0:
            raise ValueError(
                'right camera_info: P[0,3] is 0, so the baseline is missing; '
                f'expected -fx * baseline < 0; P =\n{p_right}'
            )
        if offset > 0.0:
            raise ValueError(
                f'right camera_info: P[0,3] is {offset:g}, the wrong sign; expected -fx * baseline < 0 '
                f'(are left and right exchanged?); P =\n{p_right}'
            )
        cameras = [
            PinholeCamera(info.width, info.height, p[0, 0], p[1, 1], p[0, 2], p[1, 2])
            for info, p in ((left, p_left), (right, p_right))
        ]
        return cls(cameras[0], cameras[1], -offset / p_right[0, 0])

    @property
    def right_T_left(self) -> np.ndarray:
        """(3,) float64, metres: add it to left-frame points to get right-frame points."""
        return np.array([-self.baseline, 0.0, 0.0])

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Left-frame points (..., 3), metres, to left and right pixels (..., 2)."""
        p = np.asarray(points, dtype=np.float64)
        return self.left.project(p), self.right.project(p + self.right_T_left)

    def disparity(self, depth: ArrayLike) -> np.ndarray:
        """u_left - u_right, pixels, of points at the given depth z, metres."""
        return self.left.fx * self.baseline / np.asarray(depth, dtype=np.float64) + (self.left.cx - self.right.cx)

    def triangulate(self, left_pixels: ArrayLike, u_right: ArrayLike) -> np.ndarray:
        """Left pixels (..., 2) and their right columns (...,) to left-frame points (..., 3), metres.

        A disparity that puts the point at or beyond infinity gives NaN.
        """
        uv = np.asarray(left_pixels, dtype=np.float64)
        d = uv[..., 0] - np.asarray(u_right, dtype=np.float64) - (self.left.cx - self.right.cx)
        z = self.left.fx * self.baseline / np.where(d > 0.0, d, np.nan)
        return self.left.rays(uv) * z[..., None]


def _projection(side: str, info: Any) -> np.ndarray:
    """P of a CameraInfo as (3, 4) float64, checked."""
    p = np.asarray(info.p, dtype=np.float64)
    if p.size != 12:
        raise ValueError(f'{side} camera_info: P has {p.size} elements, expected 12')
    p = p.reshape(3, 4)
    if not np.isfinite(p).all():
        raise ValueError(f'{side} camera_info: P contains NaN or infinity; P =\n{p}')
    if p[0, 0] <= 0.0 or p[1, 1] <= 0.0:
        raise ValueError(
            f'{side} camera_info: fx = {p[0, 0]:g}, fy = {p[1, 1]:g} in P, expected > 0 '
            f'(an uncalibrated camera sends zeros); P =\n{p}'
        )
    if info.width < 1 or info.height < 1:
        raise ValueError(f'{side} camera_info: size {info.width} x {info.height}, expected at least one pixel')
    return p
