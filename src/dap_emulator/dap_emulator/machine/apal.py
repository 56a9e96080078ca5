"""Kernels counted plane by plane, as an assembly (APAL) programmer would write them.

Words are exactly as long as the values need, and grow by a plane with each sum; operands are read from neighbours
inside the operation that uses them.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import ByteArray

from .arrays import DapArray
from .dap import Dap
from .kinds import bits


def sobel(dap: Dap, image: ByteArray, mapping: str | None = None) -> DapArray:
    """Magnitude |gx| + |gy| of the separable 3 x 3 Sobel operator, by nine operations of 8 to 12 bits a pixel.

    Parameters
    ----------
    dap : Dap
        Made with level='apal'.
    image : (h, w) uint8 array
        Grey values; zeros lie beyond the border.
    mapping : {'sheet', 'crinkled', 'combined'}, optional
        The machine's mapping when not given.

    Returns
    -------
    DapArray
        (h, w) INTEGER of 12 bits.

    References
    ----------
    Thesis 3.7.1 for the operator, 3.5.1 for Reddaway's times.
    """
    pixels = dap.matrix(np.asarray(image, dtype=np.uint8), bits(8), mapping)
    gradients = []
    for axis in (0, 1):
        # Smooth along one axis by 1 2 1, where doubling is a change of address; difference along the other.
        doubled = pixels.like(bits(9), pixels.values.astype(np.uint16) * 2)
        pair = pixels.neighbour(-1, axis).plus(pixels.neighbour(1, axis), bits(9))
        smooth = pair.plus(doubled, bits(10))
        across = 1 - axis
        gradients.append(abs(smooth.neighbour(1, across).minus(smooth.neighbour(-1, across), bits(11, signed=True))))
    return gradients[0].plus(gradients[1], bits(12, signed=True))
