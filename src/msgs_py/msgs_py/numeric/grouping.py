"""Which of many things belong together, given pairs that do."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .typed import IntArray


def linked_groups(count: int, pairs: ArrayLike) -> IntArray:
    """Connected components: which of many things belong to one group.

    As scipy.sparse.csgraph.connected_components. Nodes link edges in every image but need no more of scipy, and
    importing it would be a fifth of their start.

    Parameters
    ----------
    count : int
        Number of things.
    pairs : (n, 2) array_like of int
        Things that belong together; so do things that chains of pairs connect.

    Returns
    -------
    (count,) int64
        Label of each thing's group; groups are numbered from 0 in the order of their first members.

    Examples
    --------
    >>> linked_groups(5, [[0, 3], [3, 4]]).tolist()
    [0, 1, 2, 0, 0]
    """
    first, second = np.asarray(pairs, int).reshape(-1, 2).T
    root = np.arange(count)
    while (root[first] != root[second]).any():
        one, other = root[first], root[second]
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        while (root[root] != root).any():
            root = root[root]
    labels: IntArray = np.unique(root, return_inverse=True)[1].reshape(-1)
    return labels
