"""Axes of the cylinders and cones that remain on a solid (thesis 6.3.2).

An axis runs between the centres of the planar ends of a connected piece of the curved surface: the points where the
ends' planes meet the axis. A cone's runs from its apex to its base; a truncated cone's from end to end.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.grouping import cluster, linked_groups
from msgs_py.numeric.typed import FloatArray

from .pieces import Pieces, line_pieces
from .settings import GENERIC_PHASE, ON_SURFACE, PARALLEL, RULINGS, SAME_HEIGHT, SHORTEST_AXIS
from .surfaces import SurfaceTable


def axes(table: SurfaceTable, curved: Pieces, closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The axes of the cylinders and cones on a boundary.

    Parameters
    ----------
    table : SurfaceTable
    curved : Pieces
        The boundary's pieces of conics.
    closed : (c,) bool
        Conics that are ellipses.

    Returns
    -------
    start, end : (a, 3) float64, normalised

    References
    ----------
    Thesis 6.3.2.
    """
    starts, ends = [], []
    g = len(table.planes)
    for k, leaf in enumerate(table.quadric_leaf):
        if table.leaves[leaf].kind == 'SPHERE':
            continue
        frame = table.frames[leaf]
        for low, high in _spans(table, curved, closed, g + k, frame, table.leaves[leaf].kind == 'CONE'):
            starts.append(frame[:3, 2] * low + frame[:3, 3])
            ends.append(frame[:3, 2] * high + frame[:3, 3])
    start, end = np.array(starts).reshape(-1, 3), np.array(ends).reshape(-1, 3)
    # Inner and outer wall of a tube between the same ends: one axis, whichever way each runs.
    both = np.sort(np.stack([start, end]), axis=0)
    once = cluster(np.concatenate([both[0], both[1]], axis=1), 10.0 * ON_SURFACE)[1]
    return start[once], end[once]


def _spans(
    table: SurfaceTable, curved: Pieces, closed: np.ndarray, group: int, frame: np.ndarray, cone: bool
) -> list[tuple[float, float]]:
    """Ranges of unit-frame z between the planar ends of each connected piece of one curved surface."""
    inverse = np.linalg.inv(frame)
    branches = curved.branches
    on = np.unique(branches.point[branches.group == group])
    flat = np.isin(branches.point, on) & (branches.group < len(table.planes)) & closed[curved.curve[branches.point]]
    if not flat.any():
        return []
    plane = table.planes[branches.group[flat]] @ frame
    # A plane parallel to the axis may touch where another end's conic passes; it is no end.
    ends = np.abs(plane[:, 2]) > PARALLEL * np.linalg.norm(plane[:, :3], axis=1)
    piece, plane = branches.point[flat][ends], plane[ends]
    height = -plane[:, 3] / plane[:, 2]
    local = curved.middle[piece] @ inverse[:3, :3].T + inverse[:3, 3]
    at = np.arctan2(local[:, 1], local[:, 0])
    angle = np.concatenate([at, GENERIC_PHASE + 2.0 * np.pi * np.arange(RULINGS) / RULINGS])

    ruling = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
    root = np.zeros_like(ruling)
    if not cone:
        root[:, :2] = ruling[:, :2]
        ruling[:, :2] = 0.0
    direction = ruling @ frame[:3, :3].T
    length = np.linalg.norm(direction, axis=1)
    found = line_pieces(table, root @ frame[:3, :3].T + frame[:3, 3], direction / length[:, None], faces=1)
    mine = np.unique(found.branches.point[found.branches.group == group])
    row = found.curve[mine]
    low, high = found.low[mine] / length[row], found.high[mine] / length[row]
    label = connected(angle, row, low, high)

    spans = []
    for part in range(label.max(initial=-1) + 1):
        member = label == part
        # An end belongs to the part if the part's ruling through the end's middle stops there.
        at_ends = [
            height[k]
            for k in range(len(at))
            if (
                member
                & (row == k)
                & ((np.abs(low - local[k, 2]) < SAME_HEIGHT) | (np.abs(high - local[k, 2]) < SAME_HEIGHT))
            ).any()
        ]
        if not at_ends:
            continue
        first, last = min(at_ends), max(at_ends)
        if last - first > SHORTEST_AXIS:
            spans.append((first, last))
        elif cone:
            spans.append((0.0, first))
        else:
            # One planar end: the axis goes on to the primitive's own other end, which may lie inside the solid.
            bottoms = _own_ends(table, group, inverse)
            bottoms = bottoms[np.abs(bottoms - first) > SAME_HEIGHT]
            far = low[member].min() if low[member].min() < first - SAME_HEIGHT else high[member].max()
            spans.append((first, float(bottoms[np.abs(bottoms - far).argmin()])))
    return spans


def _own_ends(table: SurfaceTable, group: int, inverse: np.ndarray) -> np.ndarray:
    """Unit-frame z of the ends of all cylinders that share the surface."""
    leaves = np.nonzero((table.slots == group).any(axis=1))[0]
    points = np.concatenate([[table.frames[k][:3, 3], table.frames[k][:3, 3] + table.frames[k][:3, 2]] for k in leaves])
    heights: FloatArray = points @ inverse[2, :3] + inverse[2, 3]
    return heights


def connected(angle: np.ndarray, row: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Label (n,) of the connected part that each interval belongs to, on lines round a surface.

    angle : (lines,) of all lines; row : (n,) int, each interval's line. Intervals of neighbouring lines are linked
    where they overlap, those of one line where they touch.
    """
    order = np.argsort(angle % (2.0 * np.pi), kind='stable')
    after = np.empty(len(angle), int)
    after[order] = np.roll(order, -1)
    same = row[:, None] == row[None, :]
    slack = np.where(same, SHORTEST_AXIS, -SHORTEST_AXIS)
    linked = (
        (same | (row[None, :] == after[row][:, None]))
        & (low[:, None] < high[None, :] + slack)
        & (low[None, :] < high[:, None] + slack)
    )
    return linked_groups(len(row), np.argwhere(linked))
