"""Points that a solid hides from a viewpoint, exactly: every leaf is convex, so a ray meets it in one interval.

The ends of all intervals cut a ray into stretches. Of each leaf a word of bits says which stretches lie in it, and one
walk over the tree says of all stretches at once which lie in the solid.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, WordArray

from ..brep.settings import ON_SURFACE
from ..brep.surfaces import INTERSECT, UNION, SurfaceRows, SurfaceTable
from .settings import BESIDE_BOX, LEVEL_RAY, NO_DIRECTION, PARALLEL_RAY, THIN

WORD = 64
ONE = np.uint64(1)
NONE = np.uint64(0)

# What a ray does at every leaf: a call would hand on all arrays of two records, which costs more than what it does.
inlined = njit(nogil=True, forceinline=True)


class RayWork(NamedTuple):
    """Of rays from one viewpoint, in a solid of m leaves, g planes and q quadrics: what all share, and room for one.

    Attributes
    ----------
    box : (m, 6) float64
        From the viewpoint to the lowest and the highest corner of the boxes of the leaves, a little larger.
    above : (g,) float64
        Value of each plane's equation at the viewpoint.
    polar : (q, 4) float64
        Half the gradient of each quadric's equation there, and its value.
    leaf : (m,) int32
        Leaves that the ray meets.
    span : (m, 2) float64
        Where it enters and leaves each of those.
    stop : (2 m + 2,) float64
        Their ends and those of the ray, ascending.
    cover : (m,) uint64
        Stretches between stops that lie in each leaf, a bit each; zero but while a ray is looked at.
    stack : (m + 1,) uint64
        Of the walk over the tree.
    """

    box: FloatArray
    above: FloatArray
    polar: FloatArray
    leaf: Int32Array
    span: FloatArray
    stop: FloatArray
    cover: WordArray
    stack: WordArray


def hidden(table: SurfaceTable, viewpoint: np.ndarray, targets: np.ndarray, thin: float = THIN) -> np.ndarray:
    """Points that a solid hides.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame
    targets : (n, 3) float64, metres, model frame
    thin : float
        Least thickness along the ray, in model sizes, of material that hides.

    Returns
    -------
    (n,) bool
        Material of the solid stands between the viewpoint and the target.
    """
    seen_from = np.ascontiguousarray(table.normalised(viewpoint))
    out: BoolArray = _hidden(table.rows, seen_from, np.ascontiguousarray(table.normalised(targets)), thin)
    return out


def first_hit(table: SurfaceTable, viewpoint: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """How far along rays a solid begins.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame
    ray : (n, 3) float64, model frame

    Returns
    -------
    (n,) float64
        In lengths of each ray; not a number where it meets nothing.
    """
    out: FloatArray = _first_hits(table.rows, np.ascontiguousarray(table.normalised(viewpoint)), ray / table.size)
    return out


@njit(nogil=True)
def _hidden(surfaces: SurfaceRows, viewpoint: FloatArray, targets: FloatArray, thin: float) -> BoolArray:
    """As :func:`hidden`, normalised frame."""
    work = ray_work(surfaces, viewpoint)
    out = np.empty(len(targets), np.bool_)
    x, y, z = viewpoint
    for k in range(len(targets)):
        out[k] = hides(surfaces, work, targets[k, 0] - x, targets[k, 1] - y, targets[k, 2] - z, thin)
    return out


@njit(nogil=True)
def _first_hits(surfaces: SurfaceRows, viewpoint: FloatArray, ray: FloatArray) -> FloatArray:
    """As :func:`first_hit`, normalised frame."""
    work = ray_work(surfaces, viewpoint)
    out = np.full(len(ray), np.nan)
    x, y, z = viewpoint
    # Beyond this lies nothing: a whole solid, and the viewpoint's distance from it.
    farthest = 2.0 * (math.sqrt(x * x + y * y + z * z) + 1.0)
    for k in range(len(ray)):
        dx, dy, dz = ray[k]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        far = max(farthest / length, 1.0)
        count = _spans(surfaces, work, dx, dy, dz, far)
        stops = _stops(work, count, far)
        for first in range(0, stops - 1, WORD):
            solid = _material(surfaces, work, count, first)
            for j in range(first, min(first + WORD, stops - 1)):
                if (solid >> np.uint64(j - first)) & ONE and work.stop[j + 1] > work.stop[j]:
                    out[k] = work.stop[j]
                    break
            if not math.isnan(out[k]):
                break
    return out


@njit(nogil=True)
def ray_work(surfaces: SurfaceRows, viewpoint: FloatArray) -> RayWork:
    """What the rays of one thread need from a viewpoint (3,), normalised frame."""
    m, x, y, z = len(surfaces.cone), viewpoint[0], viewpoint[1], viewpoint[2]
    box = np.empty((m, 6))
    box[:, :3] = surfaces.low - BESIDE_BOX - viewpoint
    box[:, 3:] = surfaces.high + BESIDE_BOX - viewpoint
    p, q = surfaces.planes, surfaces.quadrics
    above = p[:, 0] * x + p[:, 1] * y + p[:, 2] * z + p[:, 3]
    polar = q[:, :, 0] * x + q[:, :, 1] * y + q[:, :, 2] * z + q[:, :, 3]
    polar[:, 3] += polar[:, 0] * x + polar[:, 1] * y + polar[:, 2] * z
    return RayWork(
        box,
        above,
        polar,
        np.empty(m, np.int32),
        np.empty((m, 2)),
        np.empty(2 * m + 2),
        np.zeros(m, np.uint64),
        np.zeros(m + 1, np.uint64),
    )


@njit(nogil=True)
def hides(surfaces: SurfaceRows, work: RayWork, dx: float, dy: float, dz: float, thin: float) -> bool:
    """Whether material thicker than ``thin`` lies between the viewpoint and the end of a ray from it, normalised."""
    count = _spans(surfaces, work, dx, dy, dz, 1.0)
    if count == 0:
        return False
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    stops = _stops(work, count, 1.0)
    for first in range(0, stops - 1, WORD):
        solid = _material(surfaces, work, count, first)
        for j in range(first, min(first + WORD, stops - 1)):
            if (solid >> np.uint64(j - first)) & ONE and (work.stop[j + 1] - work.stop[j]) * length > thin:
                return True
    return False


@njit(nogil=True)
def ahead_and_behind(
    surfaces: SurfaceRows, work: RayWork, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[bool, bool]:
    """Whether material is at a point moved by a shift, and moved back by it; normalised frame."""
    met = 0
    for leaf in range(len(surfaces.cone)):
        cover = NONE
        if _inside(surfaces, leaf, x + dx, y + dy, z + dz):
            cover |= ONE
        if _inside(surfaces, leaf, x - dx, y - dy, z - dz):
            cover |= ONE << ONE
        if cover:
            work.cover[leaf] = cover
            work.leaf[met] = leaf
            met += 1
    if met == 0:
        return False, False
    both = _combined(surfaces, work)
    for k in range(met):
        work.cover[work.leaf[k]] = NONE
    return (both & ONE) != NONE, (both & (ONE << ONE)) != NONE


@inlined
def _in_box(surfaces: SurfaceRows, leaf: int, x: float, y: float, z: float) -> bool:
    """Whether a point is in the box of a leaf."""
    low, high = surfaces.low, surfaces.high
    inside: bool = (
        low[leaf, 0] - BESIDE_BOX <= x <= high[leaf, 0] + BESIDE_BOX
        and low[leaf, 1] - BESIDE_BOX <= y <= high[leaf, 1] + BESIDE_BOX
        and low[leaf, 2] - BESIDE_BOX <= z <= high[leaf, 2] + BESIDE_BOX
    )
    return inside


@njit(nogil=True)
def may_bound(surfaces: SurfaceRows, which: int, x: float, y: float, z: float) -> bool:
    """Whether a point of a quadric is in the box of a leaf that it bounds."""
    for leaf in range(len(surfaces.cone)):
        if surfaces.quadric_slot[leaf] == which and _in_box(surfaces, leaf, x, y, z):
            return True
    return False


@njit(nogil=True)
def _inside(surfaces: SurfaceRows, leaf: int, x: float, y: float, z: float) -> bool:
    """Whether a point is inside a leaf."""
    if not _in_box(surfaces, leaf, x, y, z):
        return False
    for slot in range(surfaces.plane_slots.shape[1]):
        group = surfaces.plane_slots[leaf, slot]
        if group < 0:
            continue
        p = surfaces.planes[group]
        if not (p[0] * x + p[1] * y + p[2] * z + p[3]) * surfaces.slot_sign[leaf, slot] < 0.0:
            return False
    if surfaces.quadric_slot[leaf] < 0:
        return True
    q = surfaces.quadrics[surfaces.quadric_slot[leaf]]
    hx = q[0, 0] * x + q[0, 1] * y + q[0, 2] * z
    hy = q[1, 0] * x + q[1, 1] * y + q[1, 2] * z
    hz = q[2, 0] * x + q[2, 1] * y + q[2, 2] * z
    value: float = (hx + 2.0 * q[0, 3]) * x + (hy + 2.0 * q[1, 3]) * y + (hz + 2.0 * q[2, 3]) * z + q[3, 3]
    return value < 0.0


@inlined
def _spans(surfaces: SurfaceRows, work: RayWork, dx: float, dy: float, dz: float, far: float) -> int:
    """How many leaves a ray meets between 0 and ``far``; their intervals are in ``work``."""
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    count = 0
    for leaf in range(len(surfaces.cone)):
        a, b = work.box[leaf, 0] * ix, work.box[leaf, 3] * ix
        first, last = min(a, b), max(a, b)
        a, b = work.box[leaf, 1] * iy, work.box[leaf, 4] * iy
        first, last = max(first, min(a, b)), min(last, max(a, b))
        a, b = work.box[leaf, 2] * iz, work.box[leaf, 5] * iz
        first, last = max(first, min(a, b)), min(last, max(a, b))
        if first > last or first > far or last < 0.0:
            continue
        enter, leave = _leaf_span(surfaces, work, leaf, dx, dy, dz, length)
        enter, leave = max(enter, 0.0), min(leave, far)
        if enter < leave:
            work.leaf[count] = leaf
            work.span[count, 0], work.span[count, 1] = enter, leave
            count += 1
    return count


@inlined
def _inverse(step: float) -> float:
    """One over a component of a ray; a large number, and no infinite one, for nothing."""
    return 1.0 / step if abs(step) > NO_DIRECTION else 1.0 / NO_DIRECTION


@inlined
def _leaf_span(
    surfaces: SurfaceRows, work: RayWork, leaf: int, dx: float, dy: float, dz: float, length: float
) -> tuple[float, float]:
    """Where a ray enters and leaves a leaf; it enters after it leaves where it misses the leaf."""
    enter, leave = -math.inf, math.inf
    apex_slope = 0.0
    for slot in range(surfaces.plane_slots.shape[1]):
        group = surfaces.plane_slots[leaf, slot]
        if group < 0:
            continue
        planes, sign = surfaces.planes, surfaces.slot_sign[leaf, slot]
        slope = (planes[group, 0] * dx + planes[group, 1] * dy + planes[group, 2] * dz) * sign
        value = work.above[group] * sign
        if slot == 1:
            apex_slope = slope
        if abs(slope) <= PARALLEL_RAY * length:
            # A ray inside a face's plane passes beside the leaf: the leaf is open there.
            if value > -ON_SURFACE:
                return math.inf, -math.inf
        elif slope > 0.0:
            leave = min(leave, -value / slope)
        else:
            enter = max(enter, -value / slope)
        if enter >= leave:
            return math.inf, -math.inf
    which = surfaces.quadric_slot[leaf]
    if which < 0:
        return enter, leave
    q, polar = surfaces.quadrics, work.polar
    hx = q[which, 0, 0] * dx + q[which, 0, 1] * dy + q[which, 0, 2] * dz
    hy = q[which, 1, 0] * dx + q[which, 1, 1] * dy + q[which, 1, 2] * dz
    hz = q[which, 2, 0] * dx + q[which, 2, 1] * dy + q[which, 2, 2] * dz
    a = hx * dx + hy * dy + hz * dz
    b = polar[which, 0] * dx + polar[which, 1] * dy + polar[which, 2] * dz
    low, high = _quadric_span(a, b, polar[which, 3], surfaces.cone[leaf], apex_slope < 0.0)
    return max(enter, low), min(leave, high)


@inlined
def _quadric_span(a: float, b: float, c: float, cone: bool, up: bool) -> tuple[float, float]:
    """Where a t^2 + 2 b t + c < 0; of a cone only on its real nappe, towards which a ray goes ``up`` or not."""
    if abs(a) <= LEVEL_RAY:
        if abs(b) <= LEVEL_RAY:
            return (-math.inf, math.inf) if c < 0.0 else (math.inf, -math.inf)
        single = -0.5 * c / b
        return (single, math.inf) if b < 0.0 else (-math.inf, single)
    root = b * b - a * c
    steep = cone and a < 0.0
    if root <= 0.0 and not steep:
        return math.inf, -math.inf
    # The root of larger magnitude first; the other from the product, which loses no digits.
    large = -(b + math.copysign(math.sqrt(max(root, 0.0)), b))
    one = large / a
    two = c / large if large != 0.0 else one
    low, high = min(one, two), max(one, two)
    if steep:
        # A ray steeper than the cone's side is inside before the first and after the last crossing. The sign of the
        # slope of the apex plane (slot 1) along it selects the real nappe.
        return (high, math.inf) if up else (-math.inf, low)
    return low, high


@inlined
def _stops(work: RayWork, count: int, far: float) -> int:
    """The number of ends of ``count`` intervals and of the ray; they are in ``work``, ascending."""
    work.stop[0], work.stop[1] = 0.0, far
    n = 2
    for k in range(count):
        for end in range(2):
            at = work.span[k, end]
            j = n
            while j > 0 and work.stop[j - 1] > at:
                work.stop[j] = work.stop[j - 1]
                j -= 1
            work.stop[j] = at
            n += 1
    return n


@inlined
def _material(surfaces: SurfaceRows, work: RayWork, count: int, first: int) -> np.uint64:
    """Which of the stretches from number ``first`` on lie in the solid, a bit each."""
    stretches = min(WORD, 2 * count + 1 - first)
    for k in range(count):
        enter, leave = work.span[k, 0], work.span[k, 1]
        cover = NONE
        for j in range(stretches):
            middle = 0.5 * (work.stop[first + j] + work.stop[first + j + 1])
            if enter < middle < leave:
                cover |= ONE << np.uint64(j)
        work.cover[work.leaf[k]] = cover
    solid: np.uint64 = _combined(surfaces, work)
    for k in range(count):
        work.cover[work.leaf[k]] = NONE
    return solid


@inlined
def _combined(surfaces: SurfaceRows, work: RayWork) -> np.uint64:
    """What lies in the solid of what ``work.cover`` says lies in its leaves, a bit each."""
    top = 0
    for step in surfaces.program:
        if step >= 0:
            work.stack[top] = work.cover[step]
            top += 1
            continue
        top -= 1
        left, right = work.stack[top - 1], work.stack[top]
        if step == UNION:
            work.stack[top - 1] = left | right
        elif step == INTERSECT:
            work.stack[top - 1] = left & right
        else:
            work.stack[top - 1] = left & ~right
    solid: np.uint64 = work.stack[0] if top else NONE
    return solid
