"""Pairs of segments that were no match, from the corners in space that they run into.

A thin or steeply receding face looks different to each eye, and so do the segments around it: neither the greys beside
them nor their slopes say which belong together. But where both images show a corner that other edges know in space,
what leaves it unmatched in both, and ends at one height, is one edge (thesis 3.10: figural continuity).
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments
from ..matching.matches import Matches
from . import vertex_kernels
from .vertices import Vertices, line_tables

# One corner: heights, columns and disparities agree to this, pixels.
SAME_HEIGHT, SAME_COLUMN = 1.2, 1.5
# Far ends are at one height when they differ by less than this, pixels: when both are corners, and when not.
CORNERS_HEIGHT, ENDS_HEIGHT = 0.8, 3.0
# A segment flatter than this (sine) has to end at a corner at either end; a segment is at least so long, pixels.
FLAT = 0.15
SHORTEST = 4.0


def more_matches(
    matches: Matches,
    segments: tuple[Segments, Segments],
    junctions: tuple[Junctions, Junctions],
    known: Vertices,
    offset_v: float,
) -> Matches | None:
    """The matches and the pairs that known corners add, last; None when they add none."""
    if len(known.edge) == 0:
        return None
    rows = []
    for side, table, used in zip((0, 1), line_tables(segments, offset_v, junctions), (matches.left, matches.right)):
        free = np.ones(len(segments[side]), bool)
        free[used] = False
        free &= (segments[side].arc < 0) & (segments[side].length >= SHORTEST)
        found, value = vertex_kernels.meetings(table, known.point[side], known.disparity, known.sigma, known.own[side])
        segment, end = np.nonzero(found & free[:, None])
        here = _point(segments[side], segment, value[segment, end, 0])
        away = _point(segments[side], segment, junctions[side].abscissa[segment, 1 - end])
        here[:, 1] -= side * offset_v
        away[:, 1] -= side * offset_v
        rows.append(
            (
                segment,
                end,
                here,
                away,
                value[segment, end, 1],
                value[segment, end, 2],
                (junctions[side].neighbour[segment, 1 - end] >= 0) & ~junctions[side].t_junction[segment, 1 - end],
                np.where(junctions[side].t_junction[segment, 1 - end], junctions[side].neighbour[segment, 1 - end], -1),
            )
        )
    (i, end_l, p, far_p, d, sigma, corner_p, behind_p), (j, _, q, far_q, e, _, corner_q, behind_q) = rows
    if len(i) == 0 or len(j) == 0:
        return None
    # Only ends in one row; a cluttered picture has thousands.
    order = np.argsort(q[:, 1], kind='stable')
    first, last = (np.searchsorted(q[order, 1], p[:, 1] + off) for off in (-SAME_HEIGHT, SAME_HEIGHT))
    a = np.repeat(np.arange(len(i)), last - first)
    b = order[np.arange(len(a)) + np.repeat(first - np.concatenate([[0], np.cumsum(last - first)[:-1]]), last - first)]
    height = np.abs(far_p[a, 1] - far_q[b, 1])
    corners = corner_p[a] & corner_q[b]
    # Or both run into one edge that hides their ends.
    partner = np.full(len(segments[0]), -1)
    partner[matches.left[::-1]] = matches.right[::-1]
    hidden = (behind_p[a] >= 0) & (behind_q[b] >= 0) & (partner[behind_p[a]] == behind_q[b])
    steep = np.minimum(np.abs(segments[0].direction[i[a], 1]), np.abs(segments[1].direction[j[b], 1])) > FLAT
    good = np.abs(d[a] - e[b]) < SAME_COLUMN + 3.0 * sigma[a]
    good &= np.abs(p[a, 0] - q[b, 0] - d[a]) < SAME_COLUMN + 3.0 * sigma[a]
    good &= (corners & (height < CORNERS_HEIGHT)) | (steep & ((height < ENDS_HEIGHT) | hidden))
    good &= ((far_p[a, 1] - p[a, 1]) * (far_q[b, 1] - q[b, 1]) > 0.0) | ~steep
    a, b, height = a[good], b[good], height[good]
    added: list[tuple[int, int]] = []
    disparity, common = [], []
    for k in np.argsort(height, kind='stable'):
        pair = int(i[a[k]]), int(j[b[k]])
        if any(pair[0] == x or pair[1] == y for x, y in added):
            continue
        added.append(pair)
        ends = [float(d[a[k]]), float(far_p[a[k], 0] - far_q[b[k], 0])]
        ends = ends if end_l[a[k]] == 0 else ends[::-1]
        disparity.append([ends[0], 0.5 * (ends[0] + ends[1]), ends[1]])
        common.append(np.sort([p[a[k], 1], far_p[a[k], 1]]))
    if not added:
        return None
    left, right = np.array(added, np.int32).T
    return Matches(
        np.append(matches.left, left),
        np.append(matches.right, right),
        np.concatenate([matches.disparity, disparity]),
        np.concatenate([matches.rows, common]),
        np.append(matches.belief, np.ones(len(added))),
    )


def _point(segments: Segments, index: AnyArray, place: AnyArray) -> AnyArray:
    """(k, 2) float64, pixels: the points of segments at these abscissas."""
    point: AnyArray = segments.centre[index] + place[:, None] * segments.direction[index]
    return point
