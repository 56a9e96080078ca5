"""Edges of little contrast, that noise breaks into fragments: joined and followed along their lines.

No edgel of such an edge is beyond doubt, but a line that some of them give says where the others must be, and there the
gradient over several pixels tells whether it goes on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import low_contrast_kernels
from .edgels import Edgels
from .segments import Segments, line_table
from .splitting import join_collinear

# Segments with a mean gradient below this, in units of the gradient's noise, are faint; shorter ones, pixels, give no
# line to follow; and the median of a window shows the edge when it exceeds this.
FAINT = 9.0
SHORTEST = 9.0
SEEN = 1.2


def track_low_contrast(
    edgels: Edgels,
    segments: Segments,
    gradients: tuple[np.ndarray, np.ndarray],
    noise: float,
    sigma: float,
    tolerance: float,
) -> tuple[Edgels, Segments]:
    """Edgels and segments with faint segments of one line joined, and reaching as far as the picture shows them.

    gradients : two (h, w) float32, and their noise, grey levels per pixel; sigma : smoothing; tolerance : see
    :func:`.splitting.split`, pixels
    """
    for _ in range(2):
        faint = _faint(segments, noise)
        if not faint.any():
            return edgels, segments
        extent = low_contrast_kernels.extend(line_table(segments), segments.magnitude, faint, *gradients, SEEN * noise)
        longer = replace(segments, extent=extent)
        count = len(segments)
        edgels, segments = join_collinear(edgels, longer, sigma, tolerance)
        if len(segments) == count:
            return edgels, longer
    faint = _faint(segments, noise)
    return edgels, replace(
        segments,
        extent=low_contrast_kernels.extend(line_table(segments), segments.magnitude, faint, *gradients, SEEN * noise),
    )


def _faint(segments: Segments, noise: float) -> np.ndarray:
    return (segments.magnitude < FAINT * noise) & (segments.length > SHORTEST) & (segments.arc < 0)


def warm_up() -> None:
    """Compile the loop, which only pictures with faint edges reach."""
    slope = np.zeros((16, 16), np.float32)
    low_contrast_kernels.extend(np.zeros((1, 8)), np.ones(1), np.ones(1, bool), slope, slope, 1.0)
