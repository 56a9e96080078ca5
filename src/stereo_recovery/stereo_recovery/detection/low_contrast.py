"""Edges of little contrast, that noise breaks into fragments: joined and followed along their lines.

No edgel of such an edge is beyond doubt, but a line that some of them give says where the others must be, and there the
gradient over several pixels tells whether it goes on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import low_contrast_kernels
from .edgels import Edgels
from .segmentation import Pieces, joined, line_table

# Pieces with a mean gradient below this, in units of the gradient's noise, are faint; shorter ones, pixels, give no
# line to follow; and the median of a window shows the edge when it exceeds this.
FAINT = 9.0
SHORTEST = 9.0
SEEN = 1.2


def followed(
    edgels: Edgels,
    pieces: Pieces,
    gradients: tuple[np.ndarray, np.ndarray],
    noise: float,
    sigma: float,
    tolerance: float,
) -> tuple[Edgels, Pieces]:
    """Edgels and pieces with faint pieces of one line joined, and reaching as far as the picture shows them.

    gradients : two (h, w) float32, and their noise, grey levels per pixel; sigma : smoothing; tolerance : see
    :func:`.segmentation.split`, pixels
    """
    for _ in range(2):
        faint = _faint(pieces, noise)
        if not faint.any():
            return edgels, pieces
        reach = low_contrast_kernels.extend(line_table(pieces), pieces.magnitude, faint, *gradients, SEEN * noise)
        longer = replace(pieces, reach=reach)
        count = len(pieces)
        edgels, pieces = joined(edgels, longer, sigma, tolerance)
        if len(pieces) == count:
            return edgels, longer
    faint = _faint(pieces, noise)
    return edgels, replace(
        pieces, reach=low_contrast_kernels.extend(line_table(pieces), pieces.magnitude, faint, *gradients, SEEN * noise)
    )


def _faint(pieces: Pieces, noise: float) -> np.ndarray:
    return (pieces.magnitude < FAINT * noise) & (pieces.length > SHORTEST) & (pieces.arc < 0)


def warm_up() -> None:
    """Compile the loop, which only pictures with faint edges reach."""
    slope = np.zeros((16, 16), np.float32)
    low_contrast_kernels.extend(np.zeros((1, 8)), np.ones(1), np.ones(1, bool), slope, slope, 1.0)
