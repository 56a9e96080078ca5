"""Pinhole cameras and rectified stereo rigs, in the ROS optical frame (x right, y down, z forward).

Pixels follow OpenCV: integer (u, v) is a pixel's centre, so a centred principal point is (width - 1) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .numeric.typed import BoolArray, FloatArray
from .settings import RECTIFIED_TOLERANCE


@dataclass(frozen=True)
class PinholeCamera:
    """An ideal pinhole camera.

    Parameters
    ----------
    width, height : int
        Size of the image, pixels.
    fx, fy : float
        Focal lengths, pixels, above 0.
    cx, cy : float
        Principal point, pixels from the centre of the upper left pixel.

    Raises
    ------
    ValueError
        Names the field.

    References
    ----------
    Hartley & Zisserman, Multiple View Geometry, 6.1.

    Examples
    --------
    >>> camera = PinholeCamera.centred(640, 480, 800.0)
    >>> camera.project([0.1, 0.0, 0.5])
    array([479.5, 239.5])
    >>> camera.rays([479.5, 239.5])
    array([0.2, 0. , 1. ])
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
        """A camera with square pixels and its principal point in the middle of the image.

        Parameters
        ----------
        width, height : int
            Size of the image, pixels.
        focal : float
            Focal length, pixels.
        """
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    @property
    def matrix(self) -> FloatArray:
        """The calibration matrix K, (3, 3) float64, pixels (Hartley & Zisserman 6.1)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels where the camera sees points.

        Parameters
        ----------
        points : (..., 3) array_like of float64
            Metres, camera frame.

        Returns
        -------
        (..., 2) float64
            (u, v), pixels; NaN for points that do not lie before the camera (z <= 0).
        """
        p = np.asarray(points, dtype=np.float64)
        z = np.where(p[..., 2] > 0.0, p[..., 2], np.nan)
        return np.stack([self.fx * p[..., 0] / z + self.cx, self.fy * p[..., 1] / z + self.cy], axis=-1)

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Back-projection: the viewing directions of pixels.

        Parameters
        ----------
        pixels : (..., 2) array_like of float64
            (u, v), pixels.

        Returns
        -------
        (..., 3) float64
            Directions with z = 1, not normalised, camera frame.
        """
        uv = np.asarray(pixels, dtype=np.float64)
        x = (uv[..., 0] - self.cx) / self.fx
        y = (uv[..., 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def pixel_grid(self) -> FloatArray:
        """The centre (u, v) of every pixel, (height, width, 2) float64."""
        v, u = np.mgrid[0 : self.height, 0 : self.width]
        return np.stack([u, v], axis=-1).astype(np.float64)

    def contains(self, pixels: ArrayLike) -> BoolArray:
        """Whether pixels lie inside the image area, borders of the outermost pixels included.

        Parameters
        ----------
        pixels : (..., 2) array_like of float64
            (u, v), pixels.

        Returns
        -------
        (...,) bool
            False for NaN.
        """
        uv = np.asarray(pixels, dtype=np.float64)
        u, v = uv[..., 0], uv[..., 1]
        with np.errstate(invalid='ignore'):
            inside: BoolArray = (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)
        return inside


@dataclass(frozen=True)
class StereoRig:
    """A rectified pair: equal fx, fy, cy and size; the right camera sits at +baseline along the left camera's x.

    Parameters
    ----------
    left, right : PinholeCamera
        Their cx may differ, which is an offset of the disparity.
    baseline : float
        Distance of the cameras, metres, above 0.

    Raises
    ------
    ValueError
        Names what disagrees.

    Examples
    --------
    >>> rig = StereoRig.symmetric(PinholeCamera.centred(640, 480, 800.0), baseline=0.1)
    >>> left, right = rig.project([0.0, 0.0, 0.5])
    >>> rig.triangulate(left, right[0]).tolist()
    [0.0, 0.0, 0.5]
    >>> float(rig.disparity(0.5))
    160.0
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
        """A rig of two equal cameras.

        Parameters
        ----------
        camera : PinholeCamera
            Both of them.
        baseline : float
            Their distance, metres.
        """
        return cls(camera, camera, baseline)

    @classmethod
    def from_camera_info(cls, left: Any, right: Any) -> StereoRig:
        """The rig that the projection matrices of two camera_info messages describe.

        Parameters
        ----------
        left, right : sensor_msgs.msg.CameraInfo
            Or any objects with width, height (pixels) and the 12 elements p of P.

        Raises
        ------
        ValueError
            When P[0,3] of the right camera is not -fx * baseline: negative, in pixel-metres. The matrix is printed.

        References
        ----------
        The comments in sensor_msgs/CameraInfo.msg.
        """
        p_left, p_right = (projection_of(side, info) for side, info in (('left', left), ('right', right)))
        windows = [ImageWindow.of(side, info) for side, info in (('left', left), ('right', right))]
        _check_rows(*windows)
        for side, p in (('left', p_left), ('right', p_right)):
            if abs(p[1, 3]) > RECTIFIED_TOLERANCE * p[1, 1]:
                raise ValueError(
                    f'{side} camera_info: P[1,3] is {p[1, 3]:g}, expected 0: the cameras of a pair stand side by side; '
                    f'P =\n{p}'
                )
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
            PinholeCamera(window.width, window.height, p[0, 0], p[1, 1], p[0, 2], p[1, 2])
            for window, p in zip(windows, (p_left, p_right))
        ]
        return cls(cameras[0], cameras[1], -offset / p_right[0, 0])

    @property
    def right_T_left(self) -> FloatArray:
        """What is added to left-frame points to get right-frame points, (3,) float64, metres."""
        return np.array([-self.baseline, 0.0, 0.0])

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels where both cameras see points.

        Parameters
        ----------
        points : (..., 3) array_like of float64
            Metres, left frame.

        Returns
        -------
        left, right : (..., 2) float64
            (u, v), pixels; NaN for points that do not lie before the cameras.
        """
        p = np.asarray(points, dtype=np.float64)
        return self.left.project(p), self.right.project(p + self.right_T_left)

    def disparity(self, depth: ArrayLike) -> FloatArray:
        """The disparity u_left - u_right of points at a depth.

        Parameters
        ----------
        depth : (...,) array_like of float64
            Coordinate z, metres, left frame.

        Returns
        -------
        (...,) float64
            Pixels.
        """
        disparity: FloatArray = self.left.fx * self.baseline / np.asarray(depth, dtype=np.float64) + (
            self.left.cx - self.right.cx
        )
        return disparity

    def triangulate(self, left_pixels: ArrayLike, u_right: ArrayLike) -> FloatArray:
        """Points that both cameras see where they are said to.

        Parameters
        ----------
        left_pixels : (..., 2) array_like of float64
            (u, v) in the left image, pixels.
        u_right : (...,) array_like of float64
            Columns of the same points in the right image, pixels.

        Returns
        -------
        (..., 3) float64
            Metres, left frame; NaN where the disparity puts the point at or beyond infinity.
        """
        uv = np.asarray(left_pixels, dtype=np.float64)
        d = uv[..., 0] - np.asarray(u_right, dtype=np.float64) - (self.left.cx - self.right.cx)
        z = self.left.fx * self.baseline / np.where(d > 0.0, d, np.nan)
        return self.left.rays(uv) * z[..., None]


@dataclass(frozen=True)
class ImageWindow:
    """Which pixels of a camera are in its images: a region of interest, and blocks of pixels that are added up.

    Attributes
    ----------
    width, height : int
        Pixels of the images.
    x_offset, y_offset : int
        Pixels of the camera to the left of the region of interest, and above it.
    binning_x, binning_y : int
        Pixels of the camera in one of the images.

    References
    ----------
    The comments in sensor_msgs/CameraInfo.msg and RegionOfInterest.msg.
    """

    width: int
    height: int
    x_offset: int
    y_offset: int
    binning_x: int
    binning_y: int

    @classmethod
    def of(cls, side: str, info: Any) -> ImageWindow:
        """That of a camera_info message, or of any object with width and height.

        Parameters
        ----------
        side : str
            What the camera is called in errors.
        info : sensor_msgs.msg.CameraInfo

        Raises
        ------
        ValueError
            Names the camera and the field, and what was expected.
        """
        width, height = int(info.width), int(info.height)
        if width < 1 or height < 1:
            raise ValueError(f'{side} camera_info: size {width} x {height}, expected at least one pixel')
        roi = getattr(info, 'roi', None)
        left, top, across, down = (int(getattr(roi, name, 0)) for name in ('x_offset', 'y_offset', 'width', 'height'))
        if across == 0 and down == 0 and left == 0 and top == 0:
            across, down = width, height
        if not (0 < across <= width - left and 0 < down <= height - top and left >= 0 and top >= 0):
            raise ValueError(
                f'{side} camera_info: roi is {across} x {down} pixels at ({left}, {top}), expected a part of the '
                f'{width} x {height} pixels of the camera, or zeros for all of them'
            )
        binning = [max(int(getattr(info, f'binning_{axis}', 0)), 1) for axis in 'xy']
        if across < binning[0] or down < binning[1]:
            raise ValueError(
                f'{side} camera_info: binning_x, binning_y are {binning[0]}, {binning[1]}, expected no more than the '
                f'{across} x {down} pixels that are read'
            )
        return cls(across // binning[0], down // binning[1], left, top, binning[0], binning[1])

    def seen(self, matrix: FloatArray) -> FloatArray:
        """K (3, 3) or P (3, 4) of the camera's pixels as that of the images' pixels.

        A pixel of an image lies in the middle of those that were added up for it.
        """
        out = np.array(matrix, dtype=np.float64)
        for row, (offset, binning) in enumerate(((self.x_offset, self.binning_x), (self.y_offset, self.binning_y))):
            out[row] /= binning
            # So written that what is not binned stays as it is to the last bit.
            out[row, 2] = (matrix[row, 2] - offset) / binning + 0.5 * (1.0 / binning - 1.0)
        return out

    def __str__(self) -> str:
        return (
            f'{self.width} x {self.height} (roi at ({self.x_offset}, {self.y_offset}), '
            f'binning {self.binning_x} x {self.binning_y})'
        )


def _check_rows(left: ImageWindow, right: ImageWindow) -> None:
    """Refuse a pair whose images do not show the same rows of their cameras, by the fields' names."""
    for field in ('binning_x', 'binning_y', 'y_offset'):
        a, b = getattr(left, field), getattr(right, field)
        if a != b:
            name = field if field.startswith('binning') else f'roi.{field}'
            raise ValueError(f'camera_info: {name}: left has {a} and right {b}, expected the same in a rectified pair')


def projection_of(side: str, info: Any) -> FloatArray:
    """P of a CameraInfo as (3, 4) float64, checked, of the pixels of its images.

    Parameters
    ----------
    side : str
        What the camera is called in errors.
    info : sensor_msgs.msg.CameraInfo
        Or any object with width, height (pixels) and the 12 elements p of P. Binning and region of interest, which P
        does not know, are taken into account.

    Raises
    ------
    ValueError
        Names the camera and what is unusable.
    """
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
    if abs(p[0, 1]) > RECTIFIED_TOLERANCE * p[0, 0]:
        raise ValueError(f'{side} camera_info: P[0,1] (skew) is {p[0, 1]:g}, expected 0: square axes; P =\n{p}')
    for row, column, expected in ((1, 0, 0.0), (2, 0, 0.0), (2, 1, 0.0), (2, 2, 1.0), (2, 3, 0.0)):
        if abs(p[row, column] - expected) > RECTIFIED_TOLERANCE:
            raise ValueError(
                f'{side} camera_info: P[{row},{column}] is {p[row, column]:g}, expected {expected:g}; P =\n{p}'
            )
    return ImageWindow.of(side, info).seen(p)
