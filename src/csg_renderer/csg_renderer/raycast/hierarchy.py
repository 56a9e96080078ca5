"""The hierarchy of bounding boxes over the children of a program, which rays in packets go down.

The boxes lie along the axes along which they are small: a table that is seen from a corner has its boards, legs and
knives along axes of its own, and boxes along those of the scene would hold mostly air.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from .kernels.records import Hierarchy
from .programs.program import DIFFERENCE, INTERSECT, PLANE, Program
from .settings import AXES_DIGITS, BOX_SLACK, FAR, NEVER


def boxes_of(program: Program) -> tuple[FloatArray, Hierarchy]:
    """The boxes (6, c) of a program's children, low x y z, high x y z, metres, and the hierarchy over them.

    A box is met as often as its surface is large. So of the scene's axes and those along which most of the surface
    of the leaves lies those are taken that leave the boxes the smaller surface.
    """
    found = [(frame, _child_boxes(program, frame)) for frame in (np.eye(3), *_common_axes(program))]
    frame, box = min(found, key=lambda one: _surface(one[1]))
    return box, hierarchy_of(box, frame)


def _common_axes(program: Program) -> list[FloatArray]:
    """The axes, (3, 3) with orthogonal rows, of those leaves that have the largest surface; none without leaves."""
    bounded = np.flatnonzero(program.kind != PLANE)
    if not len(bounded):
        return []
    unit_from_scene = program.inverse[bounded, :3, :3]
    left, _, right = np.linalg.svd(unit_from_scene)
    axes, group = np.unique(np.round(left @ right, AXES_DIGITS) + 0.0, axis=0, return_inverse=True)
    a, b, c = np.linalg.norm(np.linalg.inv(unit_from_scene), axis=1).T
    most = np.bincount(group.ravel(), weights=a * b + b * c + c * a).argmax()
    return [(left @ right)[group.ravel() == most][0]]


def _child_boxes(program: Program, frame: FloatArray) -> FloatArray:
    """(6, c): bounds of the children along the axes of a frame, low x y z, high x y z, metres."""
    leaves = _leaf_boxes(program, frame)
    return np.array([_child_box(code, leaves) for code in program.children]).reshape(-1, 6).T.copy()


def _surface(box: FloatArray) -> float:
    """Half the surface of all boxes (6, c) that are bounded."""
    a, b, c = np.maximum(box[3:] - box[:3], 0.0)[:, (np.abs(box) < NEVER).all(axis=0)]
    return float((a * b + b * c + c * a).sum())


def hierarchy_of(box: FloatArray, frame: FloatArray) -> Hierarchy:
    """A binary tree over boxes, split where the surface areas on both sides, each times its boxes, sum to the least.

    Parameters
    ----------
    box : (6, c) float64
        Low x y z, high x y z, metres.
    frame : (3, 3) float64
        See Hierarchy.

    Returns
    -------
    Hierarchy

    References
    ----------
    MacDonald & Booth, Heuristics for ray tracing using space subdivision, 1990.

    Examples
    --------
    >>> two = hierarchy_of(np.array([[0.0, 5.0], [0, 0], [0, 0], [1, 6], [1, 1], [1, 1]]), np.eye(3))
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
    return Hierarchy(frame, bounds, skip, child)


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


def _leaf_boxes(program: Program, frame: FloatArray) -> FloatArray:
    """(n, 2, 3): bounds of the leaves along the axes of a frame, metres."""
    boxes = np.empty((len(program.kind), 2, 3))
    outline = program.outline @ frame.T
    for leaf, (first, last) in enumerate(zip(program.outline_start[:-1], program.outline_start[1:])):
        if program.kind[leaf] == PLANE:
            boxes[leaf] = [[-FAR] * 3, [FAR] * 3]
        else:
            points = outline[first:last]
            slack = BOX_SLACK * (1.0 + np.abs(points).max())
            boxes[leaf] = points.min(axis=0) - slack, points.max(axis=0) + slack
    return boxes


def _child_box(code: IntArray, boxes: FloatArray) -> FloatArray:
    """(6,): bounds of a tree, low x y z, high x y z, from those of its leaves."""
    stack: list[FloatArray] = []
    for op in code:
        if op >= 0:
            stack.append(boxes[op])
            continue
        right, left = stack.pop(), stack.pop()
        if op == INTERSECT:
            stack.append(np.stack([np.maximum(left[0], right[0]), np.minimum(left[1], right[1])]))
        elif op == DIFFERENCE:
            stack.append(left)
        else:
            stack.append(np.stack([np.minimum(left[0], right[0]), np.maximum(left[1], right[1])]))
    return stack[0].ravel()
