"""Which of many things belong together, given pairs that do."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .spatial import pairs_within
from .typed import FloatArray, IntArray


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


def cluster(rows: FloatArray, tolerance: float) -> tuple[IntArray, IntArray]:
    """Group equal rows.

    Parameters
    ----------
    rows : (n, k) float64
        Points of a space of k dimensions.
    tolerance : float
        Root mean square of the differences of two rows that are equal.

    Returns
    -------
    labels : (n,) int
        Group of each row; groups are numbered in the order of their first rows.
    first : (groups,) int
        First row of each group.

    Examples
    --------
    >>> labels, first = cluster(np.array([[0.0, 1.0], [2.0, 2.0], [0.0, 1.0]]), 1e-9)
    >>> labels.tolist(), first.tolist()
    ([0, 1, 0], [0, 1])
    """
    if not len(rows):
        return np.zeros(0, int), np.zeros(0, int)
    labels = linked_groups(len(rows), pairs_within(rows, tolerance * np.sqrt(rows.shape[1])))
    return labels, np.unique(labels, return_index=True)[1]
