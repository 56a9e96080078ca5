"""The neighbourhood of points of candidate curves: which surfaces bound the solid there, and where it lies.

Cut across a curve of the boundary, a solid is a fan of sectors: every surface through the point sends two branches into
the cut, and between neighbouring branches the solid is everywhere in or everywhere out. The tree decides each sector
from the signs of the surfaces there, so coincident faces, seams and buried pieces need no special case, and because
only open sectors are classified the set operators are regularised (Requicha & Voelcker, Boolean operations in solid
modeling, 1985). Branches with one direction (a plane tangent to a cylinder) are told apart by their curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray
from msgs_py.numeric.vectors import perpendicular

from .settings import GRAZING_SLOPE, NO_GRADIENT, ON_SURFACE, SAME_ANGLE, SAME_CURVATURE, SECTOR_CHUNK
from .surfaces import SurfaceTable


@dataclass(frozen=True)
class Branches:
    """Where the boundary leaves the curve, one row a branch; rows of one point stand together, in angular order.

    Parameters
    ----------
    point : (b,) int
        Row of the classified point.
    group : (b,) int
        The surface group.
    direction : (b, 3) float64
        Unit vector across the curve and along the surface.
    outward : (b, 3) float64
        Unit vector out of the solid.
    crease : (n,) bool
        The boundary is no single smooth sheet at the point.
    signature : (n,) uint64
        Equal where the same surfaces meet in the same way; 0 where there is no boundary.
    """

    point: np.ndarray
    group: np.ndarray
    direction: np.ndarray
    outward: np.ndarray
    crease: np.ndarray
    signature: np.ndarray


def faces_through(table: SurfaceTable, points: np.ndarray) -> np.ndarray:
    """(n, groups) bool: groups of which a leaf has a face (or its edge) at the point."""
    values = table.values(points)
    seen = table.leaf_values(values)
    touched = np.abs(seen.max(axis=-1)) <= ON_SURFACE
    row, leaf, slot = np.nonzero((np.abs(seen) <= ON_SURFACE) & touched[..., None])
    on = np.zeros((len(points), table.groups + 1), bool)
    on[row, table.slots[leaf, slot]] = True
    return on[:, :-1]


def classify(table: SurfaceTable, points: np.ndarray, tangents: np.ndarray) -> Branches:
    """The boundary's branches at points (n, 3) of curves with unit tangents (n, 3), normalised frame."""
    step = max(1, SECTOR_CHUNK // max(1, 12 * table.slots.size))
    parts = [
        _classify(table, points[i : i + step], tangents[i : i + step]) for i in range(0, max(len(points), 1), step)
    ]
    offset = np.cumsum([0] + [len(part.crease) for part in parts])
    return Branches(
        np.concatenate([part.point + k for part, k in zip(parts, offset)]),
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ('group', 'direction', 'outward', 'crease', 'signature')
        ),
    )


def _classify(table: SurfaceTable, points: np.ndarray, tangents: np.ndarray) -> Branches:
    """As classify, all points at once: n points, k groups at each, 2 k branches and sectors."""
    n = len(points)
    groups = _pack(faces_through(table, points), table.groups)
    k = groups.shape[1]
    gradient = table.gradients(points, groups)
    first, second = _frame(tangents)
    across = np.arctan2(np.einsum('nki,ni->nk', gradient, second), np.einsum('nki,ni->nk', gradient, first))
    dummy = (groups == table.groups) | (np.linalg.norm(gradient, axis=-1) < NO_GRADIENT)

    # Two branches a surface, at right angles to its gradient; dummies repeat the first real branch and add nothing.
    angle = np.concatenate([across - 0.5 * np.pi, across + 0.5 * np.pi], axis=1) % (2.0 * np.pi)
    owner = np.concatenate([np.broadcast_to(np.arange(k), (n, k))] * 2, axis=1)
    unused = np.concatenate([dummy, dummy], axis=1)
    angle = np.where(unused, angle[:, :1], angle)
    direction = np.cos(angle)[..., None] * first[:, None] + np.sin(angle)[..., None] * second[:, None]
    turn = -np.sin(angle)[..., None] * first[:, None] + np.cos(angle)[..., None] * second[:, None]
    curvature = _curvature(table, points, groups[np.arange(n)[:, None], owner], direction, turn)
    curvature = np.where(unused, curvature[:, :1], curvature)

    # Start the count in the widest gap, so that no bundle of equal directions is cut in two.
    order = np.argsort(angle, axis=1)
    ordered = np.take_along_axis(angle, order, 1)
    gap = np.diff(ordered, axis=1, prepend=ordered[:, -1:] - 2.0 * np.pi)
    start = np.take_along_axis(ordered, gap.argmax(axis=1)[:, None], 1)
    angle = (angle - start + SAME_ANGLE) % (2.0 * np.pi)
    ordered = np.sort(angle, axis=1)
    bundle_edges = np.diff(ordered, axis=1, prepend=ordered[:, :1]) > SAME_ANGLE
    bundle = np.empty(angle.shape, int)
    order = np.argsort(angle, axis=1)
    np.put_along_axis(bundle, order, np.cumsum(bundle_edges, axis=1), 1)
    order = np.lexsort((~unused, curvature, bundle), axis=1)
    angle, bundle, curvature, owner, unused = (
        np.take_along_axis(a, order, 1) for a in (angle, bundle, curvature, owner, unused)
    )
    direction, turn = (np.take_along_axis(a, order[..., None], 1) for a in (direction, turn))

    # Sector j lies between branch j and the next; its angle is in the middle, or the branches' own in a cusp.
    following = np.roll(angle, -1, axis=1)
    following[:, -1] += 2.0 * np.pi
    next_curvature = np.roll(curvature, -1, axis=1)
    cusp = np.roll(bundle, -1, axis=1) == bundle
    cusp[:, -1] &= bundle[:, 0] == bundle[:, -1]
    empty = cusp & (np.abs(next_curvature - curvature) <= SAME_CURVATURE)
    empty[:, -1] |= cusp[:, -1]
    middle = np.where(cusp, angle, 0.5 * (angle + following)) + start - SAME_ANGLE
    bend = 0.5 * (curvature + next_curvature)

    # The sign of every surface in every sector. Along a surface's own direction its curvature decides.
    cosine = np.cos(middle[:, :, None] - across[:, None, :])
    sine = np.sin(middle[:, :, None] - across[:, None, :])
    along = (np.abs(cosine) < 2.0 * SAME_ANGLE) & cusp[..., None]
    sector_direction = np.cos(middle)[..., None] * first[:, None] + np.sin(middle)[..., None] * second[:, None]
    own_bend = _bend_along(table, points, groups, sector_direction, along)
    # Seen along the sector's direction the gradient points to increasing angle where sine is negative.
    beyond = -np.sign(sine) * bend[..., None] > own_bend
    sign = np.where(along, np.where(beyond, 1.0, -1.0), np.sign(cosine))
    sign[np.broadcast_to(dummy[:, None, :], sign.shape)] = 0.0

    inside = _sector_truth(table, points, groups, sign)
    truth = table.combine(inside)
    truth = _fill_forward(truth, empty)
    change = truth != np.roll(truth, 1, axis=1)
    row, branch = np.nonzero(change)
    outward = np.where(truth[row, branch][:, None], -turn[row, branch], turn[row, branch])
    count = change.sum(axis=1)
    crease = count > 2
    two = np.nonzero(count == 2)[0]
    if len(two):
        pick = np.sort(np.argsort(~change[two], axis=1, kind='stable')[:, :2], axis=1)
        opposite = direction[two, pick[:, 0]] + direction[two, pick[:, 1]]
        crease[two] = np.linalg.norm(opposite, axis=1) > SAME_ANGLE
    column = owner[row, branch]
    group, along_surface = groups[row, column], direction[row, branch]
    side = np.einsum('ni,ni->n', np.cross(gradient[row, column], tangents[row]), along_surface) > 0.0
    face_up = np.einsum('ni,ni->n', gradient[row, column], outward) > 0.0
    signature = np.zeros(n, np.uint64)
    np.add.at(signature, row, _mix(group * 4 + face_up * 2 + side))
    return Branches(row, group, along_surface, outward, crease, signature)


def _sector_truth(table: SurfaceTable, points: np.ndarray, groups: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """(n, sectors, m) bool: the sector is inside the leaf."""
    n, sectors, _ = sign.shape
    values = table.values(points)
    seen = table.leaf_values(values)
    side = np.zeros((n, sectors, table.groups + 1), np.int8)
    np.put_along_axis(side, np.broadcast_to(groups[:, None, :], sign.shape), sign.astype(np.int8), 2)
    local = side[..., table.slots] * table.slot_sign.astype(np.int8)
    # A group that does not pass through the point keeps the sign that it has there.
    far = np.where(np.abs(seen) > ON_SURFACE, np.sign(seen), 0.0).astype(np.int8)
    inside: BoolArray = np.where(far[:, None] != 0, far[:, None], local).max(axis=-1) < 1
    return inside


def _mix(code: np.ndarray) -> np.ndarray:
    """(n,) uint64: codes >= 0 scattered (splitmix64), so that the sum over a set of them names the set."""
    z = (code.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _pack(on: np.ndarray, dummy: int) -> np.ndarray:
    """(n, k) int: the indices set in each row of (n, groups) bool, padded with dummy; k >= 1."""
    k = max(1, int(on.sum(axis=1).max(initial=0)))
    out = np.full((len(on), k), dummy)
    row, group = np.nonzero(on)
    column = np.arange(len(row)) - np.searchsorted(row, row)
    out[row, column] = group
    return out


def _frame(tangents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two (n, 3) unit directions across each tangent; first x second = tangent."""
    first = perpendicular(tangents)
    return first, np.cross(tangents, first)


def _curvature(
    table: SurfaceTable, points: np.ndarray, groups: np.ndarray, direction: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """(n, b): how the section of each branch's surface bends from direction towards turn; 0 for planes."""
    out = np.zeros(groups.shape)
    g = len(table.planes)
    row, column = np.nonzero((groups >= g) & (groups < table.groups))
    if len(row):
        q = table.quadrics[groups[row, column] - g]
        d, m = direction[row, column], turn[row, column]
        slope = np.einsum('nij,nj->ni', q[:, :3, :3], points[row]) + q[:, :3, 3]
        steep = np.einsum('ni,ni->n', slope, m)
        steep = np.where(np.abs(steep) > GRAZING_SLOPE, steep, np.inf)
        out[row, column] = -np.einsum('ni,nij,nj->n', d, q[:, :3, :3], d) / steep
    return out


def _bend_along(
    table: SurfaceTable, points: np.ndarray, groups: np.ndarray, direction: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """(n, sectors, k): curvature, towards its gradient, of each surface along sectors of its own direction, else 0."""
    out = np.zeros(along.shape)
    g = len(table.planes)
    curved = (groups >= g) & (groups < table.groups)
    row, sector, k = np.nonzero(along & curved[:, None, :])
    if len(row):
        q = table.quadrics[groups[row, k] - g]
        d = direction[row, sector]
        slope = np.einsum('nij,nj->ni', q[:, :3, :3], points[row]) + q[:, :3, 3]
        steep = np.linalg.norm(slope, axis=1)
        out[row, sector, k] = -np.einsum('ni,nij,nj->n', d, q[:, :3, :3], d) / np.maximum(steep, GRAZING_SLOPE)
    return out


def _fill_forward(truth: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """Sectors of no width take the value of the sector before them, round the circle."""
    twice = np.concatenate([truth, truth], axis=1)
    index = np.where(np.concatenate([empty, empty], axis=1), 0, np.arange(twice.shape[1]))
    return np.take_along_axis(twice, np.maximum.accumulate(index, axis=1), 1)[:, truth.shape[1] :]
