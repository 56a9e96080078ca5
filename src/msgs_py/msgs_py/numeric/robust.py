"""The scale of normal noise from medians, which outliers hardly move.

Examples
--------
>>> import numpy as np
>>> noise = np.random.default_rng(0).normal(scale=2.0, size=100_000)
>>> round(sigma_from_median(float(np.median(np.abs(noise)))), 1)
2.0
"""

from __future__ import annotations

from .settings import MAD_TO_SIGMA, NORMAL_QUARTILE

__all__ = ['MAD_TO_SIGMA', 'NORMAL_QUARTILE', 'sigma_from_median']


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
