"""What is taken from scipy.spatial, whose import is a fifth of a node's start: made when it is first asked for.

Who only renders or finds edges does without; few points are compared with each other.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from .settings import MOST_COMPARED
from .typed import FloatArray, IntArray


@lru_cache
def _spatial() -> Any:
    """The library."""
    # The seam: the import takes 0.3 s.
    import scipy.spatial.transform

    return scipy.spatial


def rotations() -> Any:
    """scipy.spatial.transform.Rotation: the class, with its ways to make rotations."""
    return _spatial().transform.Rotation


def pairs_within(points: FloatArray, distance: float) -> IntArray:
    """Which points are near each other.

    Parameters
    ----------
    points : (n, d) float64
    distance : float
        In the points' unit.

    Returns
    -------
    (p, 2) int64
        Each pair once.

    Examples
    --------
    >>> pairs_within(np.array([[0.0], [3.0], [1.0]]), 1.5).tolist()
    [[0, 2]]
    """
    if len(points) ** 2 > MOST_COMPARED:
        pairs: IntArray = _spatial().cKDTree(points).query_pairs(distance, output_type='ndarray')
        return pairs
    near = _squares(points, points) <= distance**2
    return np.argwhere(np.triu(near, 1))


def any_within(some: FloatArray, others: FloatArray, distance: float) -> bool:
    """Whether any of some points (n, d) is nearer than a distance to any of others (m, d).

    Examples
    --------
    >>> any_within(np.array([[0.0], [3.0]]), np.array([[1.0]]), 1.5)
    True
    """
    if not (len(some) and len(others)):
        return False
    # Where both are.
    low = np.maximum(some.min(axis=0), others.min(axis=0)) - distance
    high = np.minimum(some.max(axis=0), others.max(axis=0)) + distance
    some, others = (points[((points >= low) & (points <= high)).all(axis=1)] for points in (some, others))
    if len(some) * len(others) > MOST_COMPARED:
        tree = _spatial().cKDTree(some)
        return bool(np.isfinite(tree.query(others, distance_upper_bound=distance)[0]).any())
    return bool((_squares(some, others) < distance**2).any())


def _squares(some: FloatArray, others: FloatArray) -> FloatArray:
    """(n, m) squared distances."""
    squares = np.zeros((len(some), len(others)))
    for one, other in zip(some.T, others.T):
        squares += np.square(one[:, None] - other)
    return squares
