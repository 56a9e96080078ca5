"""Which of many things belong together, given pairs that do."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def linked_groups(count: int, pairs: ArrayLike) -> np.ndarray:
    """Label (count,) int of the group that each of ``count`` things belongs to, numbered in order of first members.

    pairs : (n, 2) int, things that belong together; so do things that chains of pairs connect.

    As scipy.sparse.csgraph.connected_components. Nodes link edges in every image but need no more of scipy, and
    importing it would be a fifth of their start.
    """
    first, second = np.asarray(pairs, int).reshape(-1, 2).T
    root = np.arange(count)
    while (root[first] != root[second]).any():
        one, other = root[first], root[second]
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        while (root[root] != root).any():
            root = root[root]
    return np.unique(root, return_inverse=True)[1].reshape(-1)
