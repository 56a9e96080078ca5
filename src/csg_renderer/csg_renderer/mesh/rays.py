"""Rays among triangles, by a hierarchy of bounding boxes: compiled.

References
----------
MacDonald & Booth, Heuristics for ray tracing using space subdivision, 1990; Wald, On fast construction of SAH-based
bounding volume hierarchies, 2007; Moeller & Trumbore, Fast, minimum storage ray/triangle intersection, 1997.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from .settings import BINS, LEAF, NO_DIRECTION, RIM


class TriangleTree(NamedTuple):
    """Triangles in the order of a binary tree of boxes, whose nodes stand in preorder.

    Attributes
    ----------
    corner : (m, 9) float64
        First corner of each triangle, and from there to the second and to the third, metres.
    source : (m,) int32
        Which triangle each was.
    box : (n, 6) float64
        Low x y z, high x y z of each node, metres.
    skip : (n,) int32
        The node that follows when a ray misses the box.
    span : (n, 2) int32
        First triangle of a leaf, and the end of its last; both -1 of an inner node.
    """

    corner: FloatArray
    source: Int32Array
    box: FloatArray
    skip: Int32Array
    span: Int32Array


def triangle_tree(corners: FloatArray) -> TriangleTree:
    """The tree of triangles, cut where the surface areas on both sides, each times its triangles, sum to the least.

    Parameters
    ----------
    corners : (m, 3, 3) float64
        Corners of each triangle, metres.

    Returns
    -------
    TriangleTree

    Examples
    --------
    >>> tree = triangle_tree(np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]]))
    >>> nearest_hits(tree, np.zeros(3), np.array([[0.1, 0.1, 0.5], [0.6, 0.6, 0.5]]))[0].tolist()
    [2.0, nan]
    """
    return TriangleTree(*_built(np.ascontiguousarray(corners, dtype=np.float64)))


@njit(nogil=True)
def _built(corners: FloatArray) -> tuple[FloatArray, Int32Array, FloatArray, Int32Array, Int32Array]:
    """The fields of a :class:`TriangleTree`."""
    count = len(corners)
    bounds, middle = np.empty((count, 6)), np.empty((count, 3))
    for k in range(count):
        for i in range(3):
            a, b, c = corners[k, 0, i], corners[k, 1, i], corners[k, 2, i]
            bounds[k, i], bounds[k, 3 + i] = min(a, b, c), max(a, b, c)
            middle[k, i] = bounds[k, i] + bounds[k, 3 + i]
    most = max(2 * count - 1, 1)
    box, skip, span = np.empty((most, 6)), np.empty(most, np.int32), np.full((most, 2), -1, np.int32)
    right = np.full(most, -1, np.int32)
    order = np.arange(count).astype(np.int32)
    stack = np.empty((count + 2, 3), np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, count, -1
    top, nodes = 1, 0
    while top > 0:
        top -= 1
        first, last, parent = stack[top]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        for i in range(3):
            box[node, i], box[node, 3 + i] = math.inf, -math.inf
        for k in range(first, last):
            for i in range(3):
                box[node, i] = min(box[node, i], bounds[order[k], i])
                box[node, 3 + i] = max(box[node, 3 + i], bounds[order[k], 3 + i])
        cut = first
        if last - first > LEAF:
            cut = _cut(order, first, last, bounds, middle)
        if cut == first:
            span[node, 0], span[node, 1] = first, last
            continue
        stack[top, 0], stack[top, 1], stack[top, 2] = cut, last, node
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = first, cut, -1
        top += 2
    skip[0] = nodes
    for node in range(nodes):
        if right[node] >= 0:
            skip[node + 1], skip[right[node]] = right[node], skip[node]
    corner = np.empty((count, 9))
    for k in range(count):
        for i in range(3):
            a = corners[order[k], 0, i]
            corner[k, i], corner[k, 3 + i] = a, corners[order[k], 1, i] - a
            corner[k, 6 + i] = corners[order[k], 2, i] - a
    return corner, order, box[:nodes].copy(), skip[:nodes].copy(), span[:nodes].copy()


@njit(nogil=True)
def _cut(order: Int32Array, first: int, last: int, bounds: FloatArray, middle: FloatArray) -> int:
    """Sort triangles from ``first`` to ``last`` to two sides: where the second begins; ``first`` where none is."""
    low, high = np.full(3, math.inf), np.full(3, -math.inf)
    for k in range(first, last):
        for i in range(3):
            low[i], high[i] = min(low[i], middle[order[k], i]), max(high[i], middle[order[k], i])
    best, best_axis, best_bin = math.inf, -1, 0
    box, inside, right = np.empty((BINS, 6)), np.empty(BINS, np.int64), np.empty(BINS)
    grown = np.empty(6)
    for axis in range(3):
        if not high[axis] > low[axis]:
            continue
        scale = BINS / (high[axis] - low[axis])
        for b in range(BINS):
            inside[b] = 0
            for i in range(3):
                box[b, i], box[b, 3 + i] = math.inf, -math.inf
        for k in range(first, last):
            b = min(int((middle[order[k], axis] - low[axis]) * scale), BINS - 1)
            inside[b] += 1
            for i in range(3):
                box[b, i] = min(box[b, i], bounds[order[k], i])
                box[b, 3 + i] = max(box[b, 3 + i], bounds[order[k], 3 + i])
        for side in range(2):
            for i in range(3):
                grown[i], grown[3 + i] = math.inf, -math.inf
            total = 0
            for step in range(BINS - 1):
                b = step if side else BINS - 1 - step
                for i in range(3):
                    grown[i], grown[3 + i] = min(grown[i], box[b, i]), max(grown[3 + i], box[b, 3 + i])
                total += inside[b]
                x, y, z = grown[3] - grown[0], grown[4] - grown[1], grown[5] - grown[2]
                area = (x * y + y * z + z * x) * total if total else 0.0
                if not side:
                    right[b] = area
                elif 0 < total < last - first and area + right[b + 1] < best:
                    best, best_axis, best_bin = area + right[b + 1], axis, b
    if best_axis < 0:
        # All middles are one point: in halves, by number.
        return (first + last) // 2
    scale = BINS / (high[best_axis] - low[best_axis])
    i, j = first, last - 1
    while i <= j:
        if min(int((middle[order[i], best_axis] - low[best_axis]) * scale), BINS - 1) <= best_bin:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            j -= 1
    return i


@njit(nogil=True)
def blocked(tree: TriangleTree, x: float, y: float, z: float, dx: float, dy: float, dz: float, end: float) -> bool:
    """Whether a triangle lies between a point and the part ``end`` of a ray from it, metres."""
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    node, nodes = 0, len(tree.skip)
    while node < nodes:
        if not _enters(tree.box[node], x, y, z, ix, iy, iz, end):
            node = tree.skip[node]
            continue
        for k in range(tree.span[node, 0], tree.span[node, 1]):
            t = _meets(tree.corner[k], x, y, z, dx, dy, dz)
            if 0.0 < t < end:
                return True
        node += 1
    return False


@njit(nogil=True)
def nearest_hit(tree: TriangleTree, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> tuple[float, int]:
    """How far along a ray the first triangle is, in lengths of the ray, and its row in the tree; infinity and -1."""
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    node, nodes = 0, len(tree.skip)
    best, row = math.inf, -1
    while node < nodes:
        if not _enters(tree.box[node], x, y, z, ix, iy, iz, best):
            node = tree.skip[node]
            continue
        for k in range(tree.span[node, 0], tree.span[node, 1]):
            t = _meets(tree.corner[k], x, y, z, dx, dy, dz)
            if 0.0 < t < best:
                best, row = t, k
        node += 1
    return best, row


@njit(nogil=True)
def nearest_hits(tree: TriangleTree, origin: FloatArray, ray: FloatArray) -> tuple[FloatArray, Int32Array]:
    """Where rays from one point first meet triangles.

    Parameters
    ----------
    tree : TriangleTree
    origin : (3,) float64, metres
    ray : (n, 3) float64

    Returns
    -------
    distance : (n,) float64
        In lengths of each ray; not a number where it meets none.
    triangle : (n,) int32
        Number of the triangle, -1 where there is none.
    """
    distance, triangle = np.full(len(ray), np.nan), np.full(len(ray), -1, np.int32)
    for k in range(len(ray)):
        t, row = nearest_hit(tree, origin[0], origin[1], origin[2], ray[k, 0], ray[k, 1], ray[k, 2])
        if row >= 0:
            distance[k], triangle[k] = t, tree.source[row]
    return distance, triangle


@njit(nogil=True)
def _inverse(step: float) -> float:
    """One over a component of a ray; a large number, and no infinite one, for nothing."""
    return 1.0 / step if abs(step) > NO_DIRECTION else 1.0 / NO_DIRECTION


@njit(nogil=True)
def _enters(box: FloatArray, x: float, y: float, z: float, ix: float, iy: float, iz: float, far: float) -> bool:
    """Whether a ray, given by its inverse, is in a box (6,) somewhere between 0 and ``far``."""
    a, b = (box[0] - x) * ix, (box[3] - x) * ix
    first, last = min(a, b), max(a, b)
    a, b = (box[1] - y) * iy, (box[4] - y) * iy
    first, last = max(first, min(a, b)), min(last, max(a, b))
    a, b = (box[2] - z) * iz, (box[5] - z) * iz
    first, last = max(first, min(a, b)), min(last, max(a, b))
    # Flat boxes: rounding must not part the planes of one.
    inside: bool = first <= last + RIM * abs(last) and first < far and last >= 0.0
    return inside


@njit(nogil=True)
def _meets(corner: FloatArray, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> float:
    """How far along a ray a triangle (9,) is, in lengths of the ray; -1 where it is missed."""
    ax, ay, az, bx, by, bz = corner[3], corner[4], corner[5], corner[6], corner[7], corner[8]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    det = ax * px + ay * py + az * pz
    if det == 0.0:
        return -1.0
    sx, sy, sz = x - corner[0], y - corner[1], z - corner[2]
    u = (sx * px + sy * py + sz * pz) / det
    if u < -RIM or u > 1.0 + RIM:
        return -1.0
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) / det
    if v < -RIM or u + v > 1.0 + RIM:
        return -1.0
    t: float = (bx * qx + by * qy + bz * qz) / det
    return t
