"""The scale of normal noise from medians, which outliers hardly move.

>>> import numpy as np
>>> noise = np.random.default_rng(0).normal(scale=2.0, size=100_000)
>>> round(sigma_from_median(float(np.median(np.abs(noise)))), 1)
2.0
"""

from __future__ import annotations

# The median of |x| of a normal variable x of sigma 1 (its upper quartile).
NORMAL_QUARTILE = 0.6745
# Times the median of |x| gives sigma: 1 / NORMAL_QUARTILE, rounded as in most textbooks.
MAD_TO_SIGMA = 1.4826


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
