"""Candidate straight edges: lines in which two bounding surfaces meet, and where other surfaces cut them.

A crease lies on a face of each of two leaves (or on two faces of one), so only lines with a piece inside both are kept.
Everything is in the normalised frame of a SurfaceTable.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.grouping import cluster

from .settings import CUT_MARGIN, DISCRIMINANT_ROUNDING, GENERIC_DIRECTION, LINE_CHUNK, ON_SURFACE, PARALLEL, RULED
from .surfaces import SLOTS, SurfaceTable


def touching_leaves(table: SurfaceTable) -> np.ndarray:
    """(k, 2) int: pairs of leaves, i <= j, whose boxes overlap; every leaf is paired with itself."""
    meet = np.ones((len(table.low),) * 2, bool)
    for axis in range(3):
        low, high = table.low[:, axis], table.high[:, axis]
        meet &= low[:, None] <= high[None, :] + CUT_MARGIN
        meet &= low[None, :] <= high[:, None] + CUT_MARGIN
    return np.argwhere(np.triu(meet))


def plane_pairs(table: SurfaceTable) -> tuple[np.ndarray, np.ndarray]:
    """Distinct lines in which the planar faces of touching leaves meet: point (n, 3) and unit direction (n, 3)."""
    g = len(table.planes)
    pairs = touching_leaves(table)
    if not len(pairs) or not g:
        return np.zeros((0, 3)), np.zeros((0, 3))
    face = np.where(table.slot_real & (table.slots < g), table.slots, -1)
    one = np.repeat(face[pairs[:, 0]], SLOTS, axis=1)
    two = np.tile(face[pairs[:, 1]], (1, SLOTS))
    pair, column = np.nonzero((one >= 0) & (two >= 0) & (one != two))
    first, second = one[pair, column], two[pair, column]
    swap = first > second
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    point, direction, sine = _meet(table.planes[first], table.planes[second])
    keep = sine > PARALLEL
    pair, point, direction, sine = pair[keep], point[keep], direction[keep], sine[keep]
    low_a, high_a = _inside_planes(table, pairs[pair, 0], point, direction)
    low_b, high_b = _inside_planes(table, pairs[pair, 1], point, direction)
    keep = np.minimum(high_a, high_b) - np.maximum(low_a, low_b) > ON_SURFACE
    return distinct_lines(point[keep], direction[keep], sine[keep])


def distinct_lines(point: np.ndarray, direction: np.ndarray, quality: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each line once, as the copy of highest quality; its point (k, 3) is the one nearest the origin."""
    flip = np.where(direction @ GENERIC_DIRECTION < 0.0, -1.0, 1.0)[:, None]
    direction = direction * flip
    point = point - direction * (point * direction).sum(axis=1, keepdims=True)
    order = np.argsort(-quality, kind='stable')
    first = cluster(np.concatenate([point, direction], axis=1)[order], ON_SURFACE)[1]
    return point[order][first], direction[order][first]


def line_cuts(table: SurfaceTable, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(n, c) float64: increasing parameters at which lines enter or leave a leaf, padded with NaN."""
    m = len(table.leaves)
    step = max(1, LINE_CHUNK // max(1, m * (SLOTS + 2) * SLOTS))
    parts = [_line_cuts(table, point[i : i + step], direction[i : i + step]) for i in range(0, len(point), step)]
    width = max((part.shape[1] for part in parts), default=0)
    return (
        np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=np.nan) for part in parts])
        if parts
        else np.zeros((0, 0))
    )


def _line_cuts(table: SurfaceTable, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """As line_cuts, all lines at once."""
    n, g = len(point), len(table.planes)
    square, linear, constant = (np.zeros((n, table.groups + 1)) for _ in range(3))
    linear[:, :g] = direction @ table.planes[:, :3].T
    constant[:, :g] = point @ table.planes[:, :3].T + table.planes[:, 3]
    constant[:, -1] = -1.0
    x = np.concatenate([point, np.ones((n, 1))], axis=1)
    d = np.concatenate([direction, np.zeros((n, 1))], axis=1)
    for k, q in enumerate(table.quadrics):
        square[:, g + k] = ((d @ q) * d).sum(axis=1)
        linear[:, g + k] = 2.0 * ((d @ q) * x).sum(axis=1)
        constant[:, g + k] = ((x @ q) * x).sum(axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        single = np.where(np.abs(linear) > PARALLEL, -constant / linear, np.nan)
        roots = single[:, table.slots]
        if len(table.quadrics):
            ruled = np.abs(square) <= RULED
            discriminant = linear**2 - 4.0 * square * constant
            # A line touches the quadric when its least distance from it is below ON_SURFACE.
            touch = np.abs(discriminant) <= 4.0 * np.abs(square) * ON_SURFACE * ON_SURFACE + DISCRIMINANT_ROUNDING
            root = np.sqrt(np.where(touch, 0.0, discriminant))
            pair = [np.where(ruled, single, (-linear + s * root) / (2.0 * square)) for s in (-1.0, 1.0)]
            quadric_slot = np.where((table.slots >= g) & (table.slots < table.groups), table.slots, -1).max(axis=1)
            curved = np.stack([np.where(quadric_slot >= 0, p[:, quadric_slot], np.nan) for p in pair], axis=2)
            planar = table.slots < g
            roots = np.concatenate([np.where(planar, roots, np.nan), curved], axis=2)
        t = roots[..., None]
        slots, sign = table.slots[:, None, :], table.slot_sign[:, None, :]
        value = (square[:, slots] * t + linear[:, slots]) * t + constant[:, slots]
        kept = (value * sign <= CUT_MARGIN).all(axis=-1)
    cuts = np.sort(np.where(kept, roots, np.nan).reshape(n, -1), axis=1)
    return cuts[:, : int(np.isfinite(cuts).sum(axis=1).max(initial=0))]


def _meet(one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Point nearest the origin and unit direction of the line of two planes (n, 4), and the sine of their angle."""
    cross = np.cross(one[:, :3], two[:, :3])
    sine = np.linalg.norm(cross, axis=1)
    safe = np.where(sine > 0.0, sine, 1.0)[:, None]
    point = np.cross(one[:, :3] * two[:, 3:] - two[:, :3] * one[:, 3:], cross) / safe**2
    return point, cross / safe, sine


def _inside_planes(
    table: SurfaceTable, leaf: np.ndarray, point: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Parameter ranges (n,), (n,) of lines inside the planar faces of their leaves; curved faces are ignored."""
    g = len(table.planes)
    slots = table.slots[leaf]
    plane = np.concatenate([table.planes, np.zeros((1, 4))])[np.minimum(slots, g)] * table.slot_sign[leaf][..., None]
    slope = np.einsum('nki,ni->nk', plane[..., :3], direction)
    value = np.einsum('nki,ni->nk', plane[..., :3], point) + plane[..., 3]
    with np.errstate(divide='ignore', invalid='ignore'):
        t = -value / slope
    level = np.abs(slope) <= PARALLEL
    low = np.where(level | (slope > 0.0), -np.inf, t).max(axis=1)
    high = np.where(level | (slope < 0.0), np.inf, t).min(axis=1)
    outside = (level & (value > CUT_MARGIN)).any(axis=1)
    return np.where(outside, np.inf, low), np.where(outside, -np.inf, high)
