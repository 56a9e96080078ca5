"""All of one image: edgels, straight segments, ellipses; thresholds follow the noise and texture of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import Float32Array

from . import edgels as edgel_module
from .chains import link, with_weak
from .conics import Ellipse
from .double_edges import fit_double_steps
from .edgels import Edgels
from .junctions import spurious
from .low_contrast import track_low_contrast
from .segments import Segments
from .settings import (
    CLUTTERED_DENSITY,
    HIGH_SIGMA,
    LEAST_TOLERANCE,
    LOW_SHARE,
    LOW_SIGMA,
    MOST_EDGEL_DENSITY,
    MOST_EDGELS,
    MOST_SEGMENTS,
    MOST_TOLERANCE,
    SPARSE_DENSITY,
    TOLERANCE_NOISE,
    WEAK_COUNT,
    WEAK_MEAN_SIGMA,
    WEAKEST_SIGMA,
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
    def is_cluttered(self) -> bool:
        """Whether print or texture is nearly everywhere."""
        return len(self.edgels) / self.grey.size > CLUTTERED_DENSITY

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
    noise = edgel_module.noise_level(grey)
    gradient_noise = edgel_module.gradient_noise(noise, sigma)
    raised_low, high = max(low, LOW_SIGMA * gradient_noise), max(high, HIGH_SIGMA * gradient_noise)
    gradients = edgel_module.gradient(grey, detector, sigma)
    found = edgel_module.detect(grey, detector, sigma, raised_low, noise, gradients)
    most = min(int(MOST_EDGEL_DENSITY * grey.size), MOST_EDGELS)
    if len(found) > most:
        high = max(high, float(np.partition(found.magnitude, len(found) - most)[len(found) - most]))
        found = found.select(found.magnitude > max(raised_low, LOW_SHARE * high))
    chains = link(found, grey.shape, high)
    tolerance = float(np.clip(TOLERANCE_NOISE * localisation_noise(chains), LEAST_TOLERANCE, MOST_TOLERANCE))
    weakest = max(low, WEAKEST_SIGMA * gradient_noise)
    sparse = len(found) < SPARSE_DENSITY * grey.size and weakest < raised_low
    if sparse:
        usual_width = float(np.median(found.width)) if len(found) else None
        every = edgel_module.detect(grey, detector, sigma, weakest, noise, gradients, usual_width)
        chains = with_weak(chains, every, grey.shape, max(low, WEAK_MEAN_SIGMA * gradient_noise), WEAK_COUNT)
    ordered, segments, ellipses = split(chains, tolerance, sigma)
    if sparse:
        ordered, segments = track_low_contrast(ordered, segments, gradients, gradient_noise, sigma, tolerance)
    segments = fit_double_steps(gradients, ordered, segments, sigma)
    return View(grey, ordered, segments, ellipses)
