"""Images and the cameras that took them, made ready for measuring."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.robust import sigma_from_median
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import ByteArray, FloatArray, IntArray

from ..geometry.settings import UNIFORM_VARIANCE
from .finding import Pictures
from .image_quality import Look
from .settings import NOISE_ROWS, QUALITY_POINTS, REACH


@dataclass(frozen=True, eq=False)
class Views:
    """Images of one moment, and where their cameras stand.

    Parameters
    ----------
    images : sequence of (h, w) uint8
        Grey, free of distortion; one for each camera.
    cameras : sequence of PinholeCamera
    poses : sequence of Pose
        first_T_camera of each.

    Raises
    ------
    ValueError
        Names the image that does not fit its camera.
    """

    images: Sequence[ByteArray]
    cameras: Sequence[PinholeCamera]
    poses: Sequence[Pose]

    def __post_init__(self) -> None:
        object.__setattr__(self, 'images', tuple(np.ascontiguousarray(image) for image in self.images))
        object.__setattr__(self, 'cameras', tuple(self.cameras))
        object.__setattr__(self, 'poses', tuple(self.poses))
        if not len(self.images) == len(self.cameras) == len(self.poses) > 0:
            raise ValueError(
                f'images: expected one for each camera, got {len(self.images)} for {len(self.cameras)} cameras '
                f'and {len(self.poses)} poses'
            )
        for k, (image, camera) in enumerate(zip(self.images, self.cameras)):
            if image.dtype != np.uint8 or image.shape != (camera.height, camera.width):
                raise ValueError(
                    f'images: image {k} is {image.dtype} of shape {image.shape}, expected uint8 of shape '
                    f'{(camera.height, camera.width)}, as its camera has it'
                )

    @classmethod
    def of(cls, images: Sequence[ByteArray], cameras: CameraRig | StereoRig | PinholeCamera) -> Views:
        """Images of a rig, or one image of one camera (in a sequence).

        Parameters
        ----------
        images : sequence of (h, w) uint8
        cameras : CameraRig, StereoRig or PinholeCamera
        """
        if isinstance(cameras, PinholeCamera):
            return cls(images, (cameras,), (Pose.identity(),))
        rig = CameraRig.from_stereo(cameras) if isinstance(cameras, StereoRig) else cameras
        return cls(images, rig.cameras, rig.poses)

    def __len__(self) -> int:
        return len(self.images)

    @cached_property
    def noise(self) -> FloatArray:
        """Sigma of each image's noise, (views,) float64, grey levels (Immerkaer 1996, along rows)."""
        return np.array([_noise(image) for image in self.images])

    @cached_property
    def look(self) -> FloatArray:
        """What each image is like besides (see :class:`.image_quality.Look`), (views, 3) float64; 0 until measured."""
        return np.zeros((len(self), len(Look._fields)))

    @cached_property
    def tone(self) -> FloatArray:
        """Exponent that makes light of the images' grey levels, (1,) float64; 0 where it has not been measured yet."""
        return np.zeros(1)

    @property
    def quality(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Noise, tone and look, as far as they have been measured."""
        return self.noise, self.tone, self.look

    def take_over(self, quality: tuple[FloatArray, FloatArray, FloatArray]) -> None:
        """Take those that were measured in other images of the same cameras."""
        noise, tone, look = (one.copy() for one in quality)
        # Where cached_property keeps what it has computed.
        self.__dict__.update(noise=noise, tone=tone, look=look)

    def coded(self, tone: float) -> Views:
        """The same with a tone curve; what else the images are like has to be measured by it."""
        views = Views(self.images, self.cameras, self.poses)
        views.take_over((self.noise, np.array([tone]), np.zeros_like(self.look)))
        return views

    @cached_property
    def halved(self) -> Views:
        """The same at half the resolution."""
        images = [np.asarray(cv2.pyrDown(image), np.uint8) for image in self.images]
        # A pixel of the smaller image is centred on every second one of the larger.
        cameras = [
            PinholeCamera(image.shape[1], image.shape[0], c.fx / 2, c.fy / 2, c.cx / 2, c.cy / 2)
            for image, c in zip(images, self.cameras)
        ]
        return Views(images, cameras, self.poses)

    @cached_property
    def _pixels(self) -> ByteArray:
        return np.concatenate([image.ravel() for image in self.images])

    @property
    def pictures(self) -> Pictures:
        """The images as compiled functions take them."""
        return Pictures(self._pixels, self.sizes, self.noise)

    def pyramid(self, search_px: float) -> list[Views]:
        """These and as many halvings of them as it takes until ``search_px`` pixels here are REACH there."""
        levels = [self]
        while REACH * 2 ** (len(levels) - 1) < search_px:
            levels.append(levels[-1].halved)
        return levels

    @cached_property
    def sizes(self) -> FloatArray:
        """Width and height of each image, (views, 2) float64, pixels."""
        return np.array([[camera.width, camera.height] for camera in self.cameras], float)

    @cached_property
    def rows(self) -> FloatArray:
        """The cameras as compiled functions take them, (views, 16): camera_R_first, camera_t_first, fx, fy, cx, cy."""
        out = np.empty((len(self), 16))
        for row, camera, pose in zip(out, self.cameras, self.poses):
            row[:9], row[9:12] = pose.rotation.T.ravel(), -(pose.rotation.T @ pose.translation)
            row[12:] = camera.fx, camera.fy, camera.cx, camera.cy
        return out


def _noise(image: ByteArray) -> float:
    """Sigma of the noise of an image (h, w), grey levels, where neither black nor white cuts it off."""
    some = image[::NOISE_ROWS].astype(np.int16)
    bend = np.abs(some[:, :-2] - 2 * some[:, 1:-1] + some[:, 2:])
    # Of black and white the noise is cut off, which is seen only once it is known how far it reaches.
    sigma = _sigma_of(bend)
    before = 0.0
    while sigma > before:
        before, reach = sigma, BOUND_SIGMA * sigma
        inside = (some >= reach) & (some <= 255.0 - reach)
        good = inside[:, :-2] & inside[:, 1:-1] & inside[:, 2:]
        if good.sum() < QUALITY_POINTS:
            break
        sigma = _sigma_of(bend[good])
    return sigma


def _sigma_of(bend: IntArray) -> float:
    """Sigma of the noise by the sizes of second differences (1, -2, 1), whole numbers; not less than rounding makes."""
    if bend.size == 0:  # an image of a pixel or two
        return math.sqrt(UNIFORM_VARIANCE)
    count = np.bincount(bend.ravel())
    # The median between whole numbers: values are taken as spread evenly about each.
    below = np.cumsum(count)
    middle = 0.5 * below[-1]
    level = int(np.searchsorted(below, middle))
    median = level - 0.5 + (middle - (below[level - 1] if level else 0)) / max(count[level], 1)
    return math.sqrt(max(sigma_from_median(median) ** 2 / (1.0 + 4.0 + 1.0), UNIFORM_VARIANCE))
