"""What a curve is fitted to: edgels of both images, and the cameras that project a curve into them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.edgels import Edgels
from .curve import CameraView, camera_views
from .inlier_kernels import boxes
from .settings import INLIER_DISTANCE, INLIER_SIGMAS

# Masks over the edgels of the left and of the right image.
EdgelMasks = tuple[BoolArray, BoolArray]


class Seen(NamedTuple):
    """The n edgels of both images, the left one's first, and what projects a curve into them, for compiled functions.

    Attributes
    ----------
    points : (n, 2) float64, pixels
    direction : (n,) float64, radians
        Of the gradients.
    sigma, bias : (n,) float64, pixels
        Along the gradient: of noise, and of localisation.
    limit : (n,) float64, pixels
        How far each may be from the image of the curve that it belongs to.
    left_count : int
        How many are the left image's.
    cameras : (2, 4) float64, pixels
        fx, fy, cx, cy of the left and of the right camera.
    baseline : float
        Metres.
    blur : float
        Squared pixels. Variance of the smoothing that edgels have gone through; 0 for points that come from no image.
    boxes : ((b, 6), (c, 6)) float64
        Of the left and of the right image's, see :func:`.inlier_kernels.boxes`.
    """

    points: FloatArray
    direction: FloatArray
    sigma: FloatArray
    bias: FloatArray
    limit: FloatArray
    left_count: int
    cameras: FloatArray
    baseline: float
    blur: float
    boxes: tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class StereoEdgels:
    """Edgels of a rectified pair.

    Parameters
    ----------
    left, right : Edgels
        Of the two images.
    rig : StereoRig
        The cameras.
    blur : float
        Squared pixels. Variance of all smoothing that the edgels have gone through, see
        :func:`.detection.edgels.blur_variance`. It moves an edgel on a circle of radius R pixels by blur / (2 R)
        towards the centre (exact for a blurred disc to first order), which fits take off.
    """

    left: Edgels
    right: Edgels
    rig: StereoRig
    blur: float

    @property
    def sides(self) -> tuple[tuple[Edgels, CameraView], tuple[Edgels, CameraView]]:
        """The edgels of the left and of the right image with their cameras."""
        left, right = camera_views(self.rig)
        return (self.left, left), (self.right, right)

    def masks(self, index: IntArray) -> EdgelMasks:
        """Edgels by their numbers in ``seen`` as masks over either image."""
        both = np.zeros(len(self.left) + len(self.right), bool)
        both[index] = True
        return both[: len(self.left)], both[len(self.left) :]

    @cached_property
    def seen(self) -> Seen:
        """For the compiled functions."""
        left, right = self.left, self.right
        sigma = np.concatenate([left.sigma_position, right.sigma_position])
        return Seen(
            np.concatenate([left.position, right.position]),
            np.concatenate([left.direction, right.direction]),
            sigma,
            np.concatenate([left.bias, right.bias]),
            np.maximum(INLIER_SIGMAS * sigma, INLIER_DISTANCE),
            len(left),
            np.array([view.intrinsics for view in camera_views(self.rig)]),
            float(self.rig.baseline),
            float(self.blur),
            (boxes(left.position), boxes(right.position)),
        )
