"""The tests of this room: whether a residual is what its covariance allows, and which of several is none by chance."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.robust import outlying
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import AnyArray, FloatArray

from .settings import PLANE_PRIOR


def chi_squared(residual: AnyArray, covariance: AnyArray) -> FloatArray:
    """(...) float64: squares of residuals (..., n) in units of their covariances (..., n, n)."""
    whitened = np.linalg.solve(covariance, residual[..., None])[..., 0]
    return np.asarray((residual * whitened).sum(axis=-1))


def agrees(residual: FloatArray, covariance: FloatArray, freedom: int | None = None) -> bool:
    """Whether chi squared of a residual is as probable as three sigma of a single normal number are, or more.

    Parameters
    ----------
    residual : (n,) float64
        In any unit.
    covariance : (n, n) float64
        Its square.
    freedom : int, optional
        Of the residual, where it is what a fit has left; else n.

    Returns
    -------
    bool

    Examples
    --------
    Three sigma of one number, and what is as rare among four:

    >>> agrees(np.array([2.9]), np.eye(1)), agrees(np.array([3.1]), np.eye(1))
    (True, False)
    >>> agrees(np.array([2.0, 2.0, 2.0, 2.0]), np.eye(4)), agrees(np.array([4.1, 0.0, 0.0, 0.0]), np.eye(4))
    (True, False)
    """
    return bool(chi_squared(residual, covariance) < outlying(freedom or len(residual)))


def likeliest(residual: FloatArray, covariance: FloatArray, log_range: FloatArray) -> int | None:
    """Which of several statements holds, of which no more than one does.

    Parameters
    ----------
    residual : (k, n) float64
        In any unit; normal where a statement holds.
    covariance : (k, n, n) float64
        Their squares.
    log_range : (k,) float64
        Logarithm of the volume over which a residual is even where its statement does not hold.

    Returns
    -------
    int or None
        Its number; None where the odds settle on none.

    Examples
    --------
    Of two numbers that may be anything between -500 and 500, and between -5 and 5:

    >>> likeliest(np.array([[7.0], [0.5]]), np.ones((2, 1, 1)), np.log([1000.0, 1000.0]))
    1
    >>> likeliest(np.array([[7.0], [0.5]]), np.ones((2, 1, 1)), np.log([10.0, 10.0])) is None
    True
    """
    if len(residual) == 0:
        return None
    off = chi_squared(residual, covariance)
    log_odds = log_range - 0.5 * (off + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
    log_odds += np.log(PLANE_PRIOR / len(residual))
    log_odds[off >= outlying(residual.shape[1])] = -np.inf
    best = int(np.argmax(log_odds))
    return best if log_odds[best] > DECISIVE else None
