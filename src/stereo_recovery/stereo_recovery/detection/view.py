"""All of one image: edgels, straight segments, ellipses; thresholds follow the noise and texture of the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import Float32Array

from .border import beside_border
from .chains import chains_of, completed
from .conics import Ellipse
from .edgels import Edgels, slopes_of
from .growing import grown
from .junctions import spurious
from .segments import Segments
from .settings import (
    KERNEL_RADIUS,
    LEAST_TOLERANCE,
    MOST_SEGMENTS,
    MOST_TOLERANCE,
    SCALES,
    SMALLEST_IMAGE,
    TOLERANCE_NOISE,
)
from .splitting import localisation_noise, split


@dataclass(frozen=True, eq=False)
class View:
    """What was detected in one image.

    Attributes
    ----------
    grey : (h, w) float32, grey levels
    edgels : Edgels
        Those of segments, in the segments' order.
    segments : Segments
        Straight segments and parts of arcs.
    ellipses : list of Ellipse
        Of the arcs.
    """

    grey: Float32Array
    edgels: Edgels
    segments: Segments
    ellipses: list[Ellipse]

    @property
    def matchable(self) -> Segments:
        """The segments worth matching: without spurious ones, and of too many the longest."""
        kept = self.segments.select(~spurious(self.segments))
        return kept.select(np.sort(np.argsort(-kept.length, kind='stable')[:MOST_SEGMENTS]))


def detect_view(grey: Float32Array, detector: str, sigma: float, low: float, high: float) -> View:
    """Detect edgels, straight segments and ellipses.

    Parameters
    ----------
    grey : (h, w) float32
        Grey levels.
    detector : str
        One of :data:`~stereo_recovery.params.DETECTORS`.
    sigma : float
        Pixels. Gaussian smoothing.
    low, high : float
        Grey levels per pixel. Thresholds of hysteresis, raised where the image is noisy or textured.

    Returns
    -------
    View
    """
    reach = int(np.ceil(KERNEL_RADIUS * sigma))
    border = beside_border(grey, reach)
    slopes = slopes_of(grey, detector, sigma)
    chains = chains_of(grey, detector, sigma, (low, high), slopes, border)
    reduced = grey
    for scale in range(1, SCALES):
        if min(reduced.shape) < 2 * SMALLEST_IMAGE:
            break
        reduced = _halved(reduced)
        beside = None if border is None else beside_border(reduced, reach)
        coarse = chains_of(reduced, detector, sigma, (low, high), border=beside)
        factor = 2.0**scale
        coarse = replace(coarse, edgels=coarse.edgels.magnified(factor, sigma))
        chains = completed(chains, coarse, grey.shape, high / factor)
    tolerance = float(np.clip(TOLERANCE_NOISE * localisation_noise(chains), LEAST_TOLERANCE, MOST_TOLERANCE))
    ordered, segments, ellipses = split(chains, tolerance, sigma)
    ordered, segments = grown(ordered, segments, slopes, sigma, tolerance, border)
    return View(grey, ordered, segments, ellipses)


def detect_views(greys: Sequence[Float32Array], detector: str, sigma: float, low: float, high: float) -> list[View]:
    """:func:`detect_view` of images (h, w), several at once."""
    return spread(lambda grey: detect_view(grey, detector, sigma, low, high), greys)


def _halved(grey: Float32Array) -> Float32Array:
    """(h // 2, w // 2) float32: means of 2 x 2 pixels; an odd last row or column is left out."""
    height, width = grey.shape[0] // 2, grey.shape[1] // 2
    even = grey[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), np.float32)
