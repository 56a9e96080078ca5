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

from scipy.special import chdtri

from .settings import BOUND_SIGMA, MAD_TO_SIGMA, NORMAL_QUARTILE

__all__ = ['MAD_TO_SIGMA', 'NORMAL_QUARTILE', 'OUTLYING', 'outlying', 'sigma_from_median']


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
    return float(chdtri(freedom, math.erfc(BOUND_SIGMA / math.sqrt(2.0))))


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
