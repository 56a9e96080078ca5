"""Directions in space: what is perpendicular to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .typed import FloatArray


def farthest_axis(directions: ArrayLike) -> FloatArray:
    """The coordinate axis that makes the largest angle with each direction.

    Parameters
    ----------
    directions : (..., 3) array_like of float64
        Directions of any length but zero, any frame.

    Returns
    -------
    (..., 3) float64
        Unit vectors along x, y or z of the same frame; of equal angles the first axis.

    Examples
    --------
    >>> farthest_axis([0.9, 0.1, 0.4])
    array([0., 1., 0.])
    """
    axes: FloatArray = np.eye(3)[np.abs(np.asarray(directions, dtype=np.float64)).argmin(axis=-1)]
    return axes


def perpendicular(directions: ArrayLike) -> FloatArray:
    """A unit vector perpendicular to each direction, the same for equal directions.

    It is the vector product of the coordinate axis that makes the largest angle with the direction, and the
    direction: no other axis keeps the product's length as far from zero.

    Parameters
    ----------
    directions : (..., 3) array_like of float64
        Directions of any length but zero, any frame.

    Returns
    -------
    (..., 3) float64
        Unit vectors. With ``second = np.cross(directions, first)`` they make a right-handed frame whose third axis is
        the direction.

    Examples
    --------
    >>> perpendicular([0.0, 0.0, 2.0])
    array([ 0., -1.,  0.])
    """
    directions = np.asarray(directions, dtype=np.float64)
    across = np.cross(farthest_axis(directions), directions)
    unit: FloatArray = across / np.linalg.norm(across, axis=-1 if across.ndim > 1 else None, keepdims=True)
    return unit
