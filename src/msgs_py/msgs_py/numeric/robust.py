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

__all__ = ['MAD_TO_SIGMA', 'NORMAL_QUARTILE', 'OUTLYING', 'sigma_from_median']

# Chi squared, by its degrees of freedom, beyond which a normal error is as rarely as a single one beyond three sigma.
OUTLYING = (0.0, *(float(chdtri(degrees, math.erfc(BOUND_SIGMA / math.sqrt(2.0)))) for degrees in range(1, 13)))


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
