"""The scale of normal noise from medians, which outliers hardly move, and beyond what something is one of these.

Examples
--------
>>> import numpy as np
>>> noise = np.random.default_rng(0).normal(scale=2.0, size=100_000)
>>> round(sigma_from_median(float(np.median(np.abs(noise)))), 1)
2.0
"""

from __future__ import annotations

import math
from functools import cache

from .settings import BISECTIONS, BOUND_SIGMA, MAD_TO_SIGMA, NORMAL_QUARTILE

__all__ = ['MAD_TO_SIGMA', 'NORMAL_QUARTILE', 'OUTLYING', 'outlying', 'sigma_from_median']


@cache
def outlying(freedom: int) -> float:
    """Chi squared beyond which a normal error is as rarely as a single number beyond three sigma.

    Parameters
    ----------
    freedom : int
        Degrees of freedom of the error.

    Returns
    -------
    float

    Examples
    --------
    >>> round(outlying(1), 6), round(outlying(2), 1)
    (9.0, 11.8)
    """
    rare = math.erfc(BOUND_SIGMA / math.sqrt(2.0))
    low, high = 0.0, 10.0 * (freedom + BOUND_SIGMA**2)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _beyond(middle, freedom) > rare else (low, middle)
    return high


def _beyond(x: float, freedom: int) -> float:
    """The chance of a chi squared above x (Abramowitz and Stegun 26.4.4, 26.4.5).

    As scipy.special.chdtrc, whose import is a tenth of a node's start.
    """
    half, odd = 0.5 * x, freedom % 2
    powers = [k + 0.5 * odd for k in range(freedom // 2)]
    terms = math.fsum(half**power / math.gamma(power + 1.0) for power in powers)
    return math.exp(-half) * terms + (math.erfc(math.sqrt(half)) if odd else 0.0)


# For compiled code and loops: :func:`outlying` of each number of degrees of freedom.
OUTLYING = (0.0, *map(outlying, range(1, 13)))


def sigma_from_median(median: float) -> float:
    """The sigma of normal noise whose absolute values have this median.

    Parameters
    ----------
    median : float
        Median of absolute deviations, in any unit.

    Returns
    -------
    float
        Sigma, in the same unit.

    Examples
    --------
    >>> sigma_from_median(0.6745)
    1.0
    """
    return median / NORMAL_QUARTILE
