"""The root of a distance behind a blur: how shade begins at the limb of a curved surface."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import trapezoid

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray

# Sigmas of the blur between values of the table, and before and beyond which it ends: there the root is none, or sharp.
STEP, FIRST, LAST = 0.0625, -4.0, 8.0
# Values from which one of the table is summed: their error is less than that of interpolating it.
SUMMED = 2001


def _table() -> FloatArray:
    """(2, n): the mean of sqrt(t + z) over standard normal z, where it is real, and its derivative by t."""
    t = np.arange(FIRST, LAST + 0.5 * STEP, STEP)[:, None]
    root = np.linspace(0.0, math.sqrt(LAST - FIRST + 8.0), SUMMED)
    density = np.exp(-0.5 * (root * root - t) ** 2) / math.sqrt(2.0 * math.pi)
    # By the root r in place of z: dz is 2 r dr.
    return np.stack([trapezoid(2.0 * root**2 * density, root), trapezoid(density, root)])


ROOTS = _table()


@njit(nogil=True)
def blurred_root(distance: float, narrow: float) -> tuple[float, float]:
    """The root of a distance, 0 before it begins, behind a Gaussian blur, and its derivative.

    Parameters
    ----------
    distance : float
        Pixels.
    narrow : float
        One over the sigma of the blur, pixels.

    Returns
    -------
    root, slope : float
    """
    t = distance * narrow
    if t <= FIRST:
        return 0.0, 0.0
    scale = 1.0 / math.sqrt(narrow)
    if t >= LAST:
        root = math.sqrt(t)
        return scale * root, 0.5 * scale * narrow / root
    place = (t - FIRST) / STEP
    k = int(place)
    share = place - k
    root = (1.0 - share) * ROOTS[0, k] + share * ROOTS[0, k + 1]
    slope = (1.0 - share) * ROOTS[1, k] + share * ROOTS[1, k + 1]
    return scale * root, scale * narrow * slope
