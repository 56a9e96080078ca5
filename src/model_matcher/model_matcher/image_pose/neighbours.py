"""What else of an outline is near each of its points, compiled."""

from __future__ import annotations

import math

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..geometry.rigid_motion import transform
from .alignment import Placed
from .settings import BESIDE, FLANK, LEAST_FLANK, ON_EDGE, SPACING


@njit(nogil=True)
def begins(number: Int32Array) -> Int32Array:
    """Where each run of one number (n,) begins, and the end of the last, (m + 1,)."""
    begin = np.empty(len(number) + 1, np.int32)
    count = 0
    for k in range(len(number)):
        if k == 0 or number[k] != number[k - 1]:
            begin[count] = k
            count += 1
    begin[count] = len(number)
    return begin[: count + 1]


@njit(nogil=True)
def curve_boxes(placed: Placed) -> tuple[Int32Array, FloatArray]:
    """Where each curve begins among the points, and the end of the last (c + 1,), and the boxes of their pixels (c, 4).

    A box is the least u and v, and the greatest.
    """
    begin = begins(placed.group)
    box = np.empty((len(begin) - 1, 4))
    for c in range(len(box)):
        u, v = placed.pixel[begin[c], 0], placed.pixel[begin[c], 1]
        box[c, 0], box[c, 1], box[c, 2], box[c, 3] = u, v, u, v
        for k in range(begin[c] + 1, begin[c + 1]):
            u, v = placed.pixel[k, 0], placed.pixel[k, 1]
            box[c, 0], box[c, 1] = min(box[c, 0], u), min(box[c, 1], v)
            box[c, 2], box[c, 3] = max(box[c, 2], u), max(box[c, 3], v)
    return begin, box


@njit(nogil=True)
def beside_box(box: FloatArray, c: int, u: float, v: float, reach: float) -> bool:
    """Whether a pixel is farther than ``reach`` from box c, in u or in v."""
    beside: bool = u < box[c, 0] - reach or v < box[c, 1] - reach or u > box[c, 2] + reach or v > box[c, 3] + reach
    return beside


@njit(nogil=True)
def neighbours(placed: Placed, spacing: FloatArray) -> tuple[FloatArray, Int32Array]:
    """Curves that run beside each point, and how far its normal is free of others.

    Parameters
    ----------
    placed : Placed
        n points, those of one view together.
    spacing : (n,) float64
        Pixels between them.

    Returns
    -------
    beside : (n, BESIDE, 2) float64
        Curves about parallel, the nearest: pixels along the normal, and by how many for each along the tangent this
        changes, in size; not a number where there are fewer.
    flank : (n,) int32
        Pixels that no curve across it reaches, at most FLANK; 0 where these are too few.
    """
    n = len(placed.eye)
    beside, flank = np.full((n, BESIDE, 2), np.nan), np.full(n, FLANK, np.int32)
    group, gap = np.full((n, BESIDE), -1, np.int32), np.full((n, BESIDE), np.inf)
    begin, box = curve_boxes(placed)
    most = spacing.max() if n else 0.0
    for one in range(len(box)):
        for k in range(begin[one], begin[one + 1]):
            u, v = placed.pixel[k, 0], placed.pixel[k, 1]
            for other in range(one + 1, len(box)):
                if placed.eye[begin[other]] != placed.eye[k]:
                    break
                if beside_box(box, other, u, v, FLANK + most):
                    continue
                for j in range(begin[other], begin[other + 1]):
                    du, dv = placed.pixel[j, 0] - u, placed.pixel[j, 1] - v
                    reach = FLANK + max(spacing[k], spacing[j])
                    if abs(du) > reach or abs(dv) > reach:
                        continue
                    cosine = placed.normal[k, 0] * placed.normal[j, 0] + placed.normal[k, 1] * placed.normal[j, 1]
                    # Edges that leave a pixel to either side across a point's stretch run across one another.
                    if (1.0 - cosine * cosine) * SPACING * SPACING > 1.0:
                        free = np.int32(np.sqrt(du * du + dv * dv) - 0.5 * max(spacing[k], spacing[j]))
                        free = free if free >= LEAST_FLANK else np.int32(0)
                        flank[k], flank[j] = min(flank[k], free), min(flank[j], free)
                        continue
                    ahead = placed.normal[j, 0] * du + placed.normal[j, 1] * dv
                    back = -(placed.normal[k, 0] * du + placed.normal[k, 1] * dv)
                    turn = math.sqrt(max(1.0 - cosine * cosine, 0.0)) / abs(cosine)
                    _note(beside, group, gap, k, placed.group[j], (ahead / cosine, turn), du, dv, placed, spacing[j])
                    _note(beside, group, gap, j, placed.group[k], (back / cosine, turn), du, dv, placed, spacing[k])
    return beside, flank


@njit
def own_step(spacing: float = SPACING) -> float:
    """Pixels between points of two curves within which one step confirms both: it lies within ON_EDGE of either.

    Along the curves it may lie half the spacing of points away.
    """
    return math.hypot(2.0 * ON_EDGE, 0.5 * spacing)


@njit(nogil=True)
def may_hide(placed: Placed, motion: FloatArray, cameras: FloatArray) -> BoolArray:
    """Points, (n,) bool, that a curve nearer to the camera passes so closely that one step would serve both.

    It tells of the nearer one: the farther hides behind that as soon as the object turns a little. A pose that held
    both to one step would keep the face between them edge-on, however far it has turned.

    Parameters
    ----------
    placed : Placed
        n points, those of one view together.
    motion : (12,) float64
        first_T_model.
    cameras : (v, 16) float64
        See :attr:`.views.Views.rows`.
    """
    out, near = np.zeros(len(placed.eye), np.bool_), own_step()
    depth = np.empty(len(placed.eye))
    for k in range(len(placed.eye)):
        x, y, z = transform(motion, placed.point[k, 0], placed.point[k, 1], placed.point[k, 2])
        c = cameras[placed.eye[k]]
        depth[k] = c[6] * x + c[7] * y + c[8] * z + c[11]
    begin, box = curve_boxes(placed)
    for one in range(len(box)):
        for other in range(one - 1, -1, -1):
            if placed.eye[begin[other]] != placed.eye[begin[one]]:
                break
            apart = max(box[one, 0] - box[other, 2], box[other, 0] - box[one, 2])
            if max(apart, box[one, 1] - box[other, 3], box[other, 1] - box[one, 3]) > near:
                continue
            for k in range(begin[one], begin[one + 1]):
                u, v = placed.pixel[k, 0], placed.pixel[k, 1]
                if beside_box(box, other, u, v, near):
                    continue
                for j in range(begin[other], begin[other + 1]):
                    du, dv = placed.pixel[j, 0] - u, placed.pixel[j, 1] - v
                    if du * du + dv * dv < near * near:
                        out[k if depth[k] > depth[j] else j] = True
    return out


@njit(nogil=True)
def _note(
    beside: FloatArray,
    group: Int32Array,
    gap: FloatArray,
    k: int,
    other: int,
    line: tuple[float, float],
    du: float,
    dv: float,
    placed: Placed,
    spacing: float,
) -> None:
    """Note a curve ``other`` that crosses the normal of point k, by its point nearest to the normal.

    line : its offset along the normal, and by what this changes along the tangent
    """
    offset, turn = line
    along = abs(placed.normal[k, 0] * dv - placed.normal[k, 1] * du)
    if along > 0.75 * spacing or abs(offset) > FLANK + 2.0:
        return
    at = -1
    for i in range(BESIDE):
        if group[k, i] == other:
            if along < gap[k, i]:
                beside[k, i, 0], beside[k, i, 1], gap[k, i] = offset, turn, along
            return
        if at < 0 and group[k, i] < 0:
            at = i
    if at < 0:  # all taken: instead of the farthest
        at = 0
        for i in range(1, BESIDE):
            if abs(beside[k, i, 0]) > abs(beside[k, at, 0]):
                at = i
        if abs(beside[k, at, 0]) <= abs(offset):
            return
    beside[k, at, 0], beside[k, at, 1], group[k, at], gap[k, at] = offset, turn, other, along
