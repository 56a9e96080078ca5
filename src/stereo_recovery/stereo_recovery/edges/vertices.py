"""Corners in space that both images show, and what they say about the other edges that run into them.

An eye that sees past an object's side sees an edge there that the other eye does not, a few pixels beside one that both
see, and often running into the same corner. A pair of such neighbours looks like one edge, but in one image it ends at
a corner that other edges know in space, and in the other image it misses that corner. Such a pair is no edge. What runs
between two known corners, however, is an edge even when only one image shows it (thesis 3.10: figural continuity).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments, ends_exchanged, line_table, reversed_polarity
from ..matching.matches import Matches
from . import vertex_kernels, wireframe

# An edge tells of a corner when both its segments end in one there, heights and columns agreeing to this, pixels.
SAME_HEIGHT, SAME_COLUMN = 0.8, 1.5
# Where only one image shows the corner, the other segment ends this near to it, pixels.
NEAR_END = 4.0
# A chain stops this near to its corner's height, pixels.
STOPS = 4.0
# Disparity known worse than this, pixels, is taken from the two corners themselves.
VAGUE = 0.5
# What runs into a segment this far inside its ends, pixels, says that it is more than one edge.
INSIDE = 4.0
# The shortest segment, pixels, that makes an edge between two corners.
SHORTEST = 8.0


@dataclass(frozen=True, eq=False)
class Vertices:
    """m ends of matched edges that are corners in both images.

    Attributes
    ----------
    edge : (m,) int
        The match, ascending.
    own : (2, m) int
        Its segments in the left and the right image.
    point : (2, m, 2) float64
        Pixels, in the left and the right image, at the left one's height.
    disparity, sigma : (m,) float64
        Pixels.
    """

    edge: AnyArray
    own: AnyArray
    point: AnyArray
    disparity: AnyArray
    sigma: AnyArray


@dataclass(frozen=True)
class _Meeting:
    """A segment's end that is a corner in space: place along the segment; disparity and its sigma, pixels."""

    abscissa: float
    disparity: float
    sigma: float


def vertices(
    matches: Matches,
    segments: tuple[Segments, Segments],
    junctions: tuple[Junctions, Junctions],
    coefficient: AnyArray,
    covariance: AnyArray,
    offset_v: float,
) -> Vertices:
    """The corners that matched edges show in both images.

    coefficient (n, 2), covariance (n, 2, 2) : see :class:`.lines3d.Lines3D`; offset_v : pixels by which the right
    image's rows lie below the left's.
    """
    i, j = matches.left, matches.right
    flip = reversed_polarity(segments[0], segments[1], i, j)
    there: list[AnyArray] = [
        ends_exchanged(a[j], flip)
        for a in (junctions[1].abscissa, junctions[1].neighbour, junctions[1].t_junction, junctions[1].sigma)
    ]
    here: list[AnyArray] = [
        a[i] for a in (junctions[0].abscissa, junctions[0].neighbour, junctions[0].t_junction, junctions[0].sigma)
    ]
    p = segments[0].centre[i][:, None] + here[0][..., None] * segments[0].direction[i][:, None]
    q = segments[1].centre[j][:, None] + there[0][..., None] * segments[1].direction[j][:, None] - [0.0, offset_v]
    row = np.stack([np.ones_like(here[0]), here[0]], axis=-1)
    own = np.einsum('nei,ni->ne', row, coefficient)
    own_sigma = np.sqrt(np.einsum('nei,nij,nej->ne', row, covariance, row))
    seen = p[..., 0] - q[..., 0]
    seen_sigma = np.sqrt(here[3] ** 2 + there[3] ** 2 + wireframe.CORNER_SIGMA**2)
    corner = [(index >= 0) & ~through for _, index, through, _ in (here, there)]
    vague = own_sigma > VAGUE
    # Where only one image shows the corner, the other's segment must end there.
    ended = (
        (corner[0] | corner[1])
        & ~here[2]
        & ~there[2]
        & ~vague
        & (np.hypot(*np.moveaxis(p - q - own[..., None] * [1.0, 0.0], -1, 0)) < NEAR_END)
    )
    good = (
        corner[0]
        & corner[1]
        & (np.abs(p[..., 1] - q[..., 1]) < SAME_HEIGHT)
        & (np.abs(seen - own) < SAME_COLUMN + vertex_kernels.GATE * own_sigma)
    ) | (ended & (corner[0] ^ corner[1]))
    good &= (segments[0].arc[i] < 0)[:, None]
    p = np.where(corner[0][..., None], p, q + own[..., None] * [1.0, 0.0])
    q = np.where(corner[1][..., None], q, p - own[..., None] * [1.0, 0.0])
    # An edge along the rows is only at the same corner in both images when it meets the same edge there, or edges that
    # have no partner at that height.
    partner = np.full(len(segments[0]), -1)
    partner[i[::-1]] = j[::-1]
    owner = np.full(len(segments[1]), -1)
    owner[j[::-1]] = i[::-1]
    alone = ~_at_height(segments[1], partner[here[1]], q[..., 1] + offset_v) & ~_at_height(
        segments[0], owner[there[1]], p[..., 1]
    )
    good &= ~vague | (partner[here[1]] == there[1]) | alone
    edge, end = np.nonzero(good)
    return Vertices(
        edge,
        np.stack([i[edge], j[edge]]),
        np.stack([p[edge, end], q[edge, end]]),
        np.where(vague, seen, own)[edge, end],
        np.hypot(np.where(vague, seen_sigma, own_sigma), wireframe.CORNER_SIGMA)[edge, end],
    )


def _at_height(segments: Segments, index: AnyArray, height: AnyArray) -> AnyArray:
    """(...) bool: whether segment ``index`` (-1: none) is seen at this height, pixels."""
    a, b = segments.start[index, 1], segments.end[index, 1]
    seen: AnyArray = (index >= 0) & (height > np.minimum(a, b) - STOPS) & (height < np.maximum(a, b) + STOPS)
    return seen


def line_tables(
    segments: tuple[Segments, Segments], offset_v: float, junctions: tuple[Junctions, Junctions] | None = None
) -> tuple[AnyArray, AnyArray]:
    """Rows of both images' segments (:func:`.vertex_kernels.meetings`) at the left heights, up to given corners."""
    left, right = line_table(segments[0]), line_table(segments[1])
    if junctions is not None:
        left[:, 4:6], right[:, 4:6] = junctions[0].abscissa, junctions[1].abscissa
    right[:, 1] -= offset_v
    return left, right


def contradicted(matches: Matches, segments: tuple[Segments, Segments], known: Vertices, offset_v: float) -> AnyArray:
    """(n,) bool: pairs that end at a corner in one image and miss that corner in the other."""
    wrong = np.zeros(len(matches), bool)
    pairs, tables = (matches.left, matches.right), line_tables(segments, offset_v)
    for side, sign in ((0, -1.0), (1, 1.0)):
        found, value = vertex_kernels.meetings(
            tables[side], known.point[side], known.disparity, known.sigma, known.own[side]
        )
        wrong |= vertex_kernels.missed(
            pairs[side],
            pairs[1 - side],
            found,
            value,
            tables[side],
            tables[1 - side],
            known.edge,
            known.point[side],
            sign,
        )
    return wrong & (segments[0].arc[pairs[0]] < 0) & (segments[1].arc[pairs[1]] < 0)


def _is_one(segments: Segments, k: int, junctions: Junctions, ends: list[_Meeting]) -> bool:
    """Whether nothing runs into segment k between these ends: two edges may look like one line to one eye."""
    segment, end = np.nonzero(junctions.neighbour == k)
    x = (
        segments.centre[segment]
        + junctions.abscissa[segment, end, None] * segments.direction[segment]
        - segments.centre[k]
    )
    place = x @ segments.direction[k]
    return not ((place > ends[0].abscissa + INSIDE) & (place < ends[1].abscissa - INSIDE)).any()


def between(
    matches: Matches,
    segments: tuple[Segments, Segments],
    junctions: tuple[Junctions, Junctions],
    known: Vertices,
    offset_v: float,
) -> list[tuple[int, int, list[_Meeting]]]:
    """Segments of either image that belong to no pair and run from one corner to another: image, segment, its ends."""
    result: list[tuple[int, int, list[_Meeting]]] = []
    taken = np.stack([segments[0].start[matches.left], segments[0].end[matches.left]], axis=1)
    tables = line_tables(segments, offset_v, junctions)
    for side in (0, 1):
        found, value = vertex_kernels.meetings(
            tables[side], known.point[side], known.disparity, known.sigma, known.own[side]
        )
        used = np.isin(np.arange(len(segments[side])), matches.left if side == 0 else matches.right)
        good = ~used & found.all(axis=1) & (segments[side].arc < 0) & (segments[side].length >= SHORTEST)
        for k in np.flatnonzero(good & (value[:, 1, 0] - value[:, 0, 0] >= SHORTEST)):
            ends = [_Meeting(*(float(x) for x in value[k, end])) for end in (0, 1)]
            if not _is_one(segments[side], int(k), junctions[side], ends):
                continue
            points = np.stack(
                [
                    segments[side].centre[k]
                    + end.abscissa * segments[side].direction[k]
                    + [end.disparity * side, -offset_v * side]
                    for end in ends
                ]
            )
            if _same(points, taken):
                continue
            taken = np.concatenate([taken, points[None]])
            result.append((side, int(k), ends))
    return result


def _same(points: AnyArray, others: AnyArray) -> bool:
    """Whether an edge (2, 2) lies on one of the others (n, 2, 2), or one of them on it."""
    here = np.broadcast_to(points, others.shape)
    same = np.zeros(len(others), bool)
    for a, b in ((here, others), (others, here)):
        run = b[:, 1] - b[:, 0]
        length = np.maximum(np.hypot(run[:, 0], run[:, 1]), 1e-9)[:, None]
        away = (a - b[:, :1]) / length[..., None]
        along = (away * run[:, None]).sum(axis=2) / length
        off = np.abs(away[..., 1] * run[:, None, 0] - away[..., 0] * run[:, None, 1])
        common = np.minimum(1.0, along.max(axis=1)) - np.maximum(0.0, along.min(axis=1))
        same |= (off.max(axis=1) < 2.0 * vertex_kernels.BESIDE) & (common > 0.5 * np.ptp(along, axis=1))
    return bool(same.any())


@dataclass(frozen=True, eq=False)
class Strut:
    """k edges from corner to corner, appended to the segments of both images.

    Attributes
    ----------
    segments
        Of the left and the right image, with the edges as their last k; the rest: arrays of k rows as in
        :class:`.lines3d.Lines3D`.
    """

    segments: tuple[Segments, Segments]
    extent: AnyArray
    coefficient: AnyArray
    covariance: AnyArray
    end_sigma: AnyArray


def struts(found: list[tuple[int, int, list[_Meeting]]], segments: tuple[Segments, Segments], offset_v: float) -> Strut:
    """The edges that :func:`between` found. The line of the image that shows one is its line in both images."""
    rows: list[list[dict[str, AnyArray]]] = [[], []]
    extent, coefficient, covariance = [], [], []
    for side, k, ends in found:
        source = {f.name: getattr(segments[side], f.name)[k] for f in fields(Segments)}
        points = [source['centre'] + end.abscissa * source['direction'] for end in ends]
        for image in (0, 1):
            row = dict(source)
            if image != side:
                shift = 1.0 if side == 1 else -1.0
                moved = [x + [shift * end.disparity, -shift * offset_v] for x, end in zip(points, ends)]
                run = moved[1] - moved[0]
                length = max(float(np.hypot(*run)), 1e-6)
                row |= {
                    'centre': 0.5 * (moved[0] + moved[1]),
                    'direction': run / length,
                    'extent': np.array([-0.5, 0.5]) * length,
                    'bounds': np.zeros_like(source['bounds']),
                }
            else:
                row |= {'extent': np.array([end.abscissa for end in ends])}
            rows[image].append(row)
        places = rows[0][-1]['extent']
        h = np.stack([np.ones(2), places], axis=1)
        inverse = np.linalg.inv(h)
        values = np.array([end.disparity for end in ends])
        coefficient.append(inverse @ values)
        covariance.append(inverse @ np.diag([end.sigma**2 + vertex_kernels.ROUNDED**2 for end in ends]) @ inverse.T)
        extent.append(places)
    grown = [
        Segments(
            **{
                f.name: np.concatenate(
                    [getattr(segments[image], f.name)] + [np.asarray(row[f.name])[None] for row in rows[image]]
                )
                for f in fields(Segments)
            }
        )
        for image in (0, 1)
    ]
    return Strut(
        (grown[0], grown[1]),
        np.array(extent),
        np.array(coefficient),
        np.array(covariance),
        np.full((len(found), 2), vertex_kernels.ROUNDED),
    )
