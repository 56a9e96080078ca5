"""Kernels counted plane by plane, as an assembly (APAL) programmer would write them.

Words are exactly as long as the values need, and grow by a plane with each sum; operands are read from neighbours
inside the operation that uses them.
"""

from __future__ import annotations

import numpy as np

from .arrays import DapArray
from .dap import Dap
from .kinds import bits


def sobel(dap: Dap, image: np.ndarray, mapping: str | None = None) -> DapArray:
    """|gx| + |gy| of the separable 3 x 3 Sobel operator (thesis 3.7.1) on 8-bit pixels; zeros lie beyond the border.

    dap : made with level='apal'; image : (h, w) uint8; mapping : sheet, crinkled or combined
    Nine arithmetic operations of 8 to 12 bits a pixel: what Reddaway timed (thesis 3.5.1).
    """
    pixels = dap.matrix(np.asarray(image, dtype=np.uint8), bits(8), mapping)
    gradients = []
    for axis in (0, 1):
        # Smooth along one axis, 1 2 1 (doubling is a plane's shift of address), and difference along the other.
        doubled = pixels.like(bits(9), pixels.values.astype(np.uint16) * 2)
        pair = pixels.neighbour(-1, axis).plus(pixels.neighbour(1, axis), bits(9))
        smooth = pair.plus(doubled, bits(10))
        across = 1 - axis
        gradients.append(abs(smooth.neighbour(1, across).minus(smooth.neighbour(-1, across), bits(11, signed=True))))
    return gradients[0].plus(gradients[1], bits(12, signed=True))
