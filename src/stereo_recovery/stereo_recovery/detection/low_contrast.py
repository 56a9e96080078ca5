"""Edges of low contrast, that noise breaks into fragments: joined and tracked along their lines.

No edgel of such an edge stands out of the noise by itself. The line that some of them give says where the others must
be, and there the median gradient over several pixels shows whether the edge goes on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from . import line_kernels, low_contrast_kernels
from .edgels import Edgels
from .segments import Segments
from .settings import LOW_CONTRAST, SEEN, SHORTEST_TRACKED
from .splitting import join_collinear


def track_low_contrast(
    edgels: Edgels,
    segments: Segments,
    gradients: tuple[Float32Array, Float32Array],
    noise: float,
    sigma: float,
    tolerance: float,
) -> tuple[Edgels, Segments]:
    """Extend segments of low contrast as far as the picture shows them, and join those of one line.

    Parameters
    ----------
    edgels : Edgels
        As the segments' bounds count.
    segments : Segments
    gradients : pair of (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image, see :func:`.edgels.gradient`.
    noise : float
        Grey levels per pixel. Sigma of the derivatives.
    sigma : float
        Pixels. Of the smoothing.
    tolerance : float
        Pixels. See :func:`.splitting.split`.

    Returns
    -------
    edgels : Edgels
        In the order of the segments returned.
    segments : Segments
    """
    for _ in range(2):
        if not _low_contrast(segments, noise).any():
            return edgels, segments
        longer = replace(segments, extent=_tracked(segments, gradients, noise))
        count = len(segments)
        edgels, segments = join_collinear(edgels, longer, sigma, tolerance)
        if len(segments) == count:
            return edgels, longer
    return edgels, replace(segments, extent=_tracked(segments, gradients, noise))


def _low_contrast(segments: Segments, noise: float) -> BoolArray:
    """(n,) bool: straight segments of low contrast that are long enough to track; noise : of the gradient."""
    return (segments.magnitude < LOW_CONTRAST * noise) & (segments.length > SHORTEST_TRACKED) & (segments.arc < 0)


def _tracked(segments: Segments, gradients: tuple[Float32Array, Float32Array], noise: float) -> FloatArray:
    """(n, 2) float64, pixels: extent of segments, of those with low contrast as far as the picture shows them."""
    extent: FloatArray = low_contrast_kernels.track(
        segments.lines, segments.magnitude, _low_contrast(segments, noise), *gradients, SEEN * noise
    )
    return extent


def warm_up() -> None:
    """Compile the loop, which only pictures with edges of low contrast need."""
    slope = np.zeros((16, 16), np.float32)
    nothing = line_kernels.Lines(*(np.zeros((1, 2)) for _ in range(4)))
    low_contrast_kernels.track(nothing, np.ones(1), np.ones(1, bool), slope, slope, 1.0)
