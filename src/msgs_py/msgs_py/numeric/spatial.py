"""What is taken from scipy.spatial, whose import is a fifth of a node's start: made when it is first asked for.

Who only renders or finds edges does without.

>>> int(nearest_neighbours([[0.0, 0.0], [1.0, 0.0]]).query([0.9, 0.0])[1])
1
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from numpy.typing import ArrayLike


@lru_cache
def _spatial() -> Any:
    """The library."""
    # The seam: the import takes 0.3 s.
    import scipy.spatial.transform

    return scipy.spatial


def rotations() -> Any:
    """scipy.spatial.transform.Rotation: the class, with its ways to make rotations."""
    return _spatial().transform.Rotation


def nearest_neighbours(points: ArrayLike) -> Any:
    """scipy.spatial.cKDTree of points (n, d): a tree to look for neighbours in."""
    return _spatial().cKDTree(points)
