"""The one test of this room: whether a residual is one that its stated covariance allows."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.robust import outlying
from msgs_py.numeric.typed import FloatArray


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
    chi_squared = float(residual @ np.linalg.solve(covariance, residual))
    return bool(chi_squared < outlying(freedom or len(residual)))
