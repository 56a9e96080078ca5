"""The hierarchy of bounding boxes over the children of a program, which rays in packets go down."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from .kernels.records import Hierarchy


def hierarchy_of(box: FloatArray) -> Hierarchy:
    """A binary tree over boxes, split where the surface areas on both sides, each times its boxes, sum to the least.

    Parameters
    ----------
    box : (6, c) float64
        Low x y z, high x y z, metres.

    Returns
    -------
    Hierarchy

    References
    ----------
    MacDonald & Booth, Heuristics for ray tracing using space subdivision, 1990.

    Examples
    --------
    >>> two = hierarchy_of(np.array([[0.0, 5.0], [0, 0], [0, 0], [1, 6], [1, 1], [1, 1]]))
    >>> two.child.tolist(), two.skip.tolist(), two.box[3].tolist()
    ([-1, 0, 1], [3, 2, 3], [6.0, 1.0, 6.0])
    """
    # A box that nothing can be in (an intersection that is empty) stays out.
    pending = [np.flatnonzero((box[:3] <= box[3:]).all(axis=0))]
    members: list[IntArray] = []
    while pending:
        inside = pending.pop()
        if len(inside):
            members.append(inside)
        if len(inside) > 1:
            pending += _halves(box, inside)[::-1]
    bounds = np.empty((6, len(members)))
    for node, inside in enumerate(members):
        bounds[:3, node], bounds[3:, node] = box[:3, inside].min(axis=1), box[3:, inside].max(axis=1)
    # In preorder a tree of m boxes is the 2 m - 1 nodes from its root on.
    skip = np.array([node + 2 * len(inside) - 1 for node, inside in enumerate(members)], dtype=np.int64)
    child = np.array([inside[0] if len(inside) == 1 else -1 for inside in members], dtype=np.int64)
    return Hierarchy(bounds, skip, child)


def _halves(box: FloatArray, inside: IntArray) -> list[IntArray]:
    """The boxes ``inside`` in two parts."""
    best, split = np.inf, [inside[:1], inside[1:]]
    for axis in range(3):
        order = inside[np.argsort(box[axis, inside] + box[axis + 3, inside], kind='stable')]
        ahead, behind = box[:, order], box[:, order[::-1]]
        left, right = _areas(ahead)[:-1], _areas(behind)[-2::-1]
        count = np.arange(1, len(order))
        cost = left * count + right * (len(order) - count)
        place = int(cost.argmin())
        if cost[place] < best:
            best, split = float(cost[place]), [order[: place + 1], order[place + 1 :]]
    return split


def _areas(box: FloatArray) -> FloatArray:
    """(n,): half the surface areas of the bounds of the first 1, 2, .. n boxes."""
    sides = np.maximum.accumulate(box[3:], axis=1) - np.minimum.accumulate(box[:3], axis=1)
    areas: FloatArray = sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0]
    return areas
