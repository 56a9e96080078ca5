"""What a curve is fitted to: edgels of both images, and the cameras that project a curve into them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..detection.edgels import Edgels
from .curve import CameraView, camera_views

# Masks over the edgels of the left and of the right image.
EdgelMasks = tuple[BoolArray, BoolArray]


class ImagePoints(NamedTuple):
    """Pixels of the two images, and what projects a curve into them, for the compiled functions.

    Attributes
    ----------
    points : (n, 2) float64, pixels
    left_count : int
        How many of them, the first ones, are the left image's.
    camera_left, camera_right : (4,) float64
        Pixels. fx, fy, cx, cy.
    baseline : float
        Metres.
    blur : float
        Squared pixels. Variance of the smoothing that edgels have gone through; 0 for points that come from no image.
    """

    points: FloatArray
    left_count: int
    camera_left: FloatArray
    camera_right: FloatArray
    baseline: float
    blur: float


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

    def select(self, masks: EdgelMasks) -> StereoEdgels:
        """Those that the masks of the two images allow."""
        return StereoEdgels(self.left.select(masks[0]), self.right.select(masks[1]), self.rig, self.blur)

    @cached_property
    def sigma(self) -> FloatArray:
        """(n,) float64, pixels: sigma across the edge, localisation bias included; the left image's first."""
        sigma: FloatArray = np.hypot(np.concatenate([self.left.sigma_position, self.right.sigma_position]), self.bias)
        return sigma

    @cached_property
    def bias(self) -> FloatArray:
        """(n,) float64, pixels: localisation bias; the left image's first."""
        return np.concatenate([self.left.bias, self.right.bias])

    @cached_property
    def points(self) -> ImagePoints:
        """For the compiled functions."""
        left, right = camera_views(self.rig)
        position = np.concatenate([self.left.position, self.right.position])
        return ImagePoints(
            position, len(self.left), left.intrinsics, right.intrinsics, float(self.rig.baseline), float(self.blur)
        )
