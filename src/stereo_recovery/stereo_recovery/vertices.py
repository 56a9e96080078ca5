"""Corners in space that both images show, and what they say about the other edges that run into them.

An eye that sees past an object's side sees an edge there that the other eye does not, a few pixels beside one that both
see, and often running into the same corner. A pair of such neighbours looks like one edge, but in one image it ends at
a corner that other edges know in space, and in the other image it misses that corner. Such a pair is no edge. What runs
between two known corners, however, is an edge even when only one image shows it (thesis 3.10: figural continuity).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from . import wireframe
from .matching import Matches
from .segmentation import Corners, Pieces

# An edge tells of a corner when both its pieces end in one there, heights and columns agreeing to this, pixels.
SAME_HEIGHT, SAME_COLUMN = 0.8, 1.5
# Where only one image shows the corner, the other piece ends this near to it, pixels.
NEAR_END = 4.0
# Disparity known worse than this, pixels, is taken from the two corners themselves.
VAGUE = 0.5
# A piece runs into a corner that is this near to its line, and this far beyond or before its end, pixels and as a share
# of its length.
BESIDE, BEYOND, BEFORE, SHARE = 1.5, 10.0, 5.0, 0.5
# A pair whose line misses the corner by more than this, pixels, and so many sigma, is none.
MISS = 1.2
GATE = 3.5
# It must come this near to the corner, pixels along it.
ABSENT = 7.0
# What runs into a piece this far inside its ends, pixels, says that it is more than one edge.
INSIDE = 4.0
# What corners of straight pieces miss each other by in an image, pixels.
ROUNDED = 0.25
# The shortest piece, pixels, that makes an edge between two corners.
SHORTEST = 8.0


@dataclass(frozen=True, eq=False)
class Vertices:
    """m ends of matched edges that are corners in both images.

    edge : (m,) int, the match; point : (2, m, 2) float64, pixels, in the left and the right image;
    disparity, sigma : (m,) float64, pixels
    """

    edge: np.ndarray
    point: np.ndarray
    disparity: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class _Meeting:
    """A piece's end that is a corner in space: place along the piece; disparity and its sigma, pixels."""

    place: float
    disparity: float
    sigma: float


def vertices(matches: Matches, pieces: tuple[Pieces, Pieces], met: tuple[Corners, Corners], coefficient: np.ndarray,
             covariance: np.ndarray, offset_v: float) -> Vertices:
    """The corners that matched edges show in both images.

    coefficient (n, 2), covariance (n, 2, 2) : see :class:`.lines3d.Lines3D`; offset_v : pixels by which the right
    image's rows lie below the left's.
    """
    i, j = matches.left, matches.right
    flip = (pieces[0].direction[i] * pieces[1].direction[j]).sum(axis=1) < 0.0
    turned = np.where(flip[:, None], [1, 0], [0, 1])
    there = [np.take_along_axis(a[j], turned, axis=1)
             for a in (met[1].place, met[1].other, met[1].through, met[1].sigma)]
    here = [a[i] for a in (met[0].place, met[0].other, met[0].through, met[0].sigma)]
    p = pieces[0].centre[i][:, None] + here[0][..., None] * pieces[0].direction[i][:, None]
    q = pieces[1].centre[j][:, None] + there[0][..., None] * pieces[1].direction[j][:, None] - [0.0, offset_v]
    row = np.stack([np.ones_like(here[0]), here[0]], axis=-1)
    own = np.einsum('nei,ni->ne', row, coefficient)
    own_sigma = np.sqrt(np.einsum('nei,nij,nej->ne', row, covariance, row))
    seen = p[..., 0] - q[..., 0]
    seen_sigma = np.sqrt(here[3] ** 2 + there[3] ** 2 + wireframe.CORNER_SIGMA ** 2)
    corner = [(index >= 0) & ~through for _, index, through, _ in (here, there)]
    vague = own_sigma > VAGUE
    # Where only one image shows the corner, the other's piece must end there.
    ended = (corner[0] | corner[1]) & ~here[2] & ~there[2] & ~vague & (np.hypot(*np.moveaxis(
        p - q - own[..., None] * [1.0, 0.0], -1, 0)) < NEAR_END)
    good = (corner[0] & corner[1] & (np.abs(p[..., 1] - q[..., 1]) < SAME_HEIGHT)
            & (np.abs(seen - own) < SAME_COLUMN + GATE * own_sigma)) | (ended & (corner[0] ^ corner[1]))
    good &= (pieces[0].arc[i] < 0)[:, None]
    p = np.where(corner[0][..., None], p, q + own[..., None] * [1.0, 0.0])
    q = np.where(corner[1][..., None], q, p - own[..., None] * [1.0, 0.0])
    # An edge along the rows is only at the same corner in both images when it meets the same edge there.
    partner = np.full(len(pieces[0]), -1)
    partner[i[::-1]] = j[::-1]
    good &= ~vague | (partner[here[1]] == there[1])
    edge, end = np.nonzero(good)
    return Vertices(edge, np.stack([p[edge, end], q[edge, end]]), np.where(vague, seen, own)[edge, end],
                    np.hypot(np.where(vague, seen_sigma, own_sigma), wireframe.CORNER_SIGMA)[edge, end])


def _meeting(pieces: Pieces, k: int, end: int, known: Vertices, side: int, mine: np.ndarray) -> _Meeting | None:
    """The corner that piece k of an image (side) runs into, by what edges other than its own (mine) know of it."""
    t = pieces.direction[k]
    away = known.point[side] - pieces.centre[k]
    place = away @ t
    length = pieces.length[k]
    beyond = (place - pieces.reach[k, end]) * (1.0 if end else -1.0)
    near = (np.abs(away @ [-t[1], t[0]]) < BESIDE) & (beyond < min(BEYOND, SHARE * length))
    near &= (beyond > -min(BEFORE, SHARE * length)) & ~np.isin(known.edge, mine)
    if not near.any():
        return None
    near = np.flatnonzero(near)
    first = near[np.argmin(np.abs(beyond[near]))]
    near = near[np.hypot(*(known.point[side][near] - known.point[side][first]).T) < 2.0 * BESIDE]
    weight = 1.0 / known.sigma[near] ** 2
    disparity = float(np.average(known.disparity[near], weights=weight))
    if (np.abs(known.disparity[near] - disparity) > MISS + GATE * known.sigma[near]).any():
        return None
    return _Meeting(float(np.average(place[near], weights=weight)), disparity, float(weight.sum() ** -0.5))


def contradicted(matches: Matches, pieces: tuple[Pieces, Pieces], known: Vertices, offset_v: float) -> np.ndarray:
    """(n,) bool: pairs that end at a corner in one image and miss that corner in the other."""
    wrong = np.zeros(len(matches), bool)
    pairs = np.stack([matches.left, matches.right])
    for e in range(len(matches)):
        confirmed = known.point[:, known.edge == e]
        for side in (0, 1):
            own, other = int(pairs[side, e]), int(pairs[1 - side, e])
            if pieces[side].arc[own] >= 0 or pieces[1 - side].arc[other] >= 0:
                continue
            mine = np.flatnonzero(pairs[side] == own)
            for end in (0, 1):
                at = _meeting(pieces[side], own, end, known, side, mine)
                if at is None:
                    continue
                x = pieces[side].centre[own] + at.place * pieces[side].direction[own]
                if (np.hypot(*(confirmed[side] - x).T) < 2.0 * BESIDE).any():
                    continue
                x = x - [at.disparity if side == 0 else -at.disparity, 0.0]
                far = pieces[1 - side]
                t = far.direction[other]
                y = x - far.centre[other] + [0.0, offset_v if side == 0 else -offset_v]
                # A piece that stops before the corner need not lie on the line to it.
                if abs(y @ t - np.clip(y @ t, *far.reach[other])) > ABSENT:
                    continue
                line = np.hypot(far.sigma[other, 0], far.sigma[other, 1] * (y @ t))
                allowed = np.sqrt((at.sigma * t[1]) ** 2 + line ** 2 + ROUNDED ** 2)
                wrong[e] |= bool(abs(y @ [-t[1], t[0]]) > max(MISS, GATE * allowed))
    return wrong


def _is_one(pieces: Pieces, k: int, met: Corners, ends: list[_Meeting]) -> bool:
    """Whether nothing runs into piece k between these ends: two edges may look like one line to one eye."""
    piece, end = np.nonzero(met.other == k)
    x = pieces.centre[piece] + met.place[piece, end, None] * pieces.direction[piece] - pieces.centre[k]
    place = x @ pieces.direction[k]
    return not ((place > ends[0].place + INSIDE) & (place < ends[1].place - INSIDE)).any()


def between(matches: Matches, pieces: tuple[Pieces, Pieces], met: tuple[Corners, Corners],
            known: Vertices) -> list[tuple[int, int, list[_Meeting]]]:
    """Pieces of either image that belong to no pair and run from one corner to another: image, piece, its ends."""
    result: list[tuple[int, int, list[_Meeting]]] = []
    taken: list[np.ndarray] = []
    left = pieces[0]
    for i in matches.left:
        taken.append(np.stack([left.start[i], left.end[i]]))
    nobody = np.zeros(0, int)
    for side in (0, 1):
        used = np.isin(np.arange(len(pieces[side])), matches.left if side == 0 else matches.right)
        for k in np.flatnonzero(~used & (pieces[side].arc < 0) & (pieces[side].length >= SHORTEST)):
            first, last = (_meeting(pieces[side], int(k), end, known, side, nobody) for end in (0, 1))
            if first is None or last is None or last.place - first.place < SHORTEST:
                continue
            ends = [first, last]
            if not _is_one(pieces[side], int(k), met[side], ends):
                continue
            points = np.stack([pieces[side].centre[k] + end.place * pieces[side].direction[k]
                               + [end.disparity * side, 0.0] for end in ends])
            if any(_same(points, others) for others in taken):
                continue
            taken.append(points)
            result.append((side, int(k), ends))
    return result


def _same(points: np.ndarray, others: np.ndarray) -> bool:
    """Whether the ends of the first lie on the second edge, or the other way round."""
    for a, b in ((points, others), (others, points)):
        run = b[1] - b[0]
        length = max(float(np.hypot(*run)), 1e-9)
        away = (a - b[0]) / length
        along, off = away @ run / length, np.abs(away @ [-run[1], run[0]])
        if off.max() < 2.0 * BESIDE and min(1.0, along.max()) - max(0.0, along.min()) > 0.5 * np.ptp(along):
            return True
    return False


@dataclass(frozen=True, eq=False)
class Strut:
    """k edges from corner to corner, appended to the pieces of both images.

    pieces : of the left and the right image, with the edges as their last k; the rest: arrays of k rows as in
    :class:`.lines3d.Lines3D`
    """

    pieces: tuple[Pieces, Pieces]
    reach: np.ndarray
    coefficient: np.ndarray
    covariance: np.ndarray
    end_sigma: np.ndarray


def struts(found: list[tuple[int, int, list[_Meeting]]], pieces: tuple[Pieces, Pieces], offset_v: float) -> Strut:
    """The edges that :func:`between` found. The line of the image that shows one is its line in both images."""
    rows: list[list[dict[str, np.ndarray]]] = [[], []]
    reach, coefficient, covariance = [], [], []
    for side, k, ends in found:
        source = {f.name: getattr(pieces[side], f.name)[k] for f in fields(Pieces)}
        points = [source['centre'] + end.place * source['direction'] for end in ends]
        for image in (0, 1):
            row = dict(source)
            if image != side:
                shift = 1.0 if side == 1 else -1.0
                moved = [x + [shift * end.disparity, -shift * offset_v] for x, end in zip(points, ends)]
                run = moved[1] - moved[0]
                length = max(float(np.hypot(*run)), 1e-6)
                row |= {'centre': 0.5 * (moved[0] + moved[1]), 'direction': run / length,
                        'reach': np.array([-0.5, 0.5]) * length, 'bounds': np.zeros_like(source['bounds'])}
            else:
                row |= {'reach': np.array([end.place for end in ends])}
            rows[image].append(row)
        places = rows[0][-1]['reach']
        h = np.stack([np.ones(2), places], axis=1)
        inverse = np.linalg.inv(h)
        values = np.array([end.disparity for end in ends])
        coefficient.append(inverse @ values)
        covariance.append(inverse @ np.diag([end.sigma ** 2 + ROUNDED ** 2 for end in ends]) @ inverse.T)
        reach.append(places)
    grown = [Pieces(**{f.name: np.concatenate([getattr(pieces[image], f.name)]
                                              + [np.asarray(row[f.name])[None] for row in rows[image]])
                       for f in fields(Pieces)}) for image in (0, 1)]
    return Strut((grown[0], grown[1]), np.array(reach), np.array(coefficient), np.array(covariance),
                 np.full((len(found), 2), ROUNDED))
