"""All of one image: edgels, straight segments, ellipses; thresholds follow the noise and texture of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import edgels as edgel_module
from .chains import link, with_weak
from .conics import Ellipse
from .double_edges import fit_double_steps
from .edgels import Edgels
from .junctions import spurious
from .low_contrast import track_low_contrast
from .segments import Segments
from .splitting import localisation_noise, split

# Edgels per pixel, and edgels in all, of an image with texture everywhere: above that the strongest are kept.
MOST_EDGEL_DENSITY = 0.03
MOST_EDGELS = 40000
# Segments of an image that are matched, the longest first: an image of a room has a thousand; time grows with the
# square.
MOST_SEGMENTS = 6000
# Thresholds of hysteresis in sigmas of the gradient's noise; edgels between the two are kept in textured images from
# this share of the upper one.
LOW_SIGMA = 5.0
HIGH_SIGMA = 7.0
LOW_SHARE = 0.5
# Tolerance of straight segments: so many times the localisation noise, within these limits, pixels.
TOLERANCE_NOISE = 6.0
LEAST_TOLERANCE = 0.2
MOST_TOLERANCE = 0.5
# Fewer edgels per pixel than this make an image sparse: long chains of weak edgels count there. Least magnitude of an
# edgel and least mean of a chain, in sigmas of the gradient's noise; least number of edgels.
SPARSE_DENSITY = 0.01
WEAKEST_SIGMA = 2.7
WEAK_MEAN_SIGMA = 3.3
WEAK_COUNT = 14
# Edgels per pixel above which an image is cluttered: print and texture end near true edges everywhere.
CLUTTERED_DENSITY = 0.02


@dataclass(frozen=True, eq=False)
class View:
    """What was detected in one image.

    grey : (h, w) float32, grey levels; edgels : of chains, in their order; segments : straight segments and parts of
    arcs, which refer to edgels and ellipses by number; ellipses : of the arcs
    """

    grey: np.ndarray
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


def detect_view(grey: np.ndarray, detector: str, sigma: float, low: float, high: float) -> View:
    """Detect edgels, straight segments and ellipses.

    Parameters
    ----------
    grey : (h, w) float32
        Grey levels.
    detector : str
        One of :data:`.edgels.DETECTORS`.
    sigma : float, pixels
        Gaussian smoothing.
    low, high : float, grey levels per pixel
        Thresholds of hysteresis, raised where the image is noisy or textured.

    Returns
    -------
    View
    """
    noise = edgel_module.noise_level(grey)
    gradient_noise = noise / (np.sqrt(8.0 * np.pi) * sigma**2)
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
