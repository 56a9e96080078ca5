"""Pieces of one edge that an image shows broken, made one line again; and two edges that one eye sees as one line.

Real edges are not as straight as their strings are precise: card folds, worn corners, print that runs across. One eye
may see such an edge as one piece and the other as two. What the one eye sees as one edge is one edge. But an eye in
the plane of two edges that meet sees one line, where the other eye sees a corner: that line is two edges.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..detection.edgels import Edgels
from ..detection.segmentation import BOW_OFFSET, BOW_SLOPE, LEVEL, Pieces, fit_pieces
from .relaxation import Matches

# Two pieces are parts of one edge when their directions differ by less than this (sine), when no end of theirs is off
# the line through both by more than so many pixels, and when the gap between them is at most this share of both.
ONE_DIRECTION = 0.14
ONE_LINE = 1.0
WIDEST_SHARE = 0.3
# Two pieces meet in a corner when their lines cross within so many pixels of the gap between their strings. A line is
# cut there when either part keeps so many edgels, and is fitted to them when that moves its ends by less than this.
AT_GAP = 4.0
FEWEST = 6
MOVED = 1.0


@dataclass(frozen=True)
class JoinedLine:
    """One line through several pieces; fields as in :class:`.segmentation.Pieces`, of one piece.

    miss : pixels, the largest distance of an end of the pieces from the line
    """

    centre: np.ndarray
    direction: np.ndarray
    reach: np.ndarray
    rms: float
    bow: float
    sigma: np.ndarray
    miss: float


def joined_line(pieces: Pieces, members: np.ndarray, along: np.ndarray) -> JoinedLine:
    """The line that orthogonal regression over all points of these pieces gives.

    members : (k,) indices of pieces; along : (2,) a direction that the result's roughly has.
    """
    length = np.maximum(pieces.length[members], 1.0)
    middle = 0.5 * (pieces.start[members] + pieces.end[members])
    run = pieces.direction[members]
    centre = np.average(middle, axis=0, weights=length)
    away = middle - centre
    scatter = (
        np.einsum('n,ni,nj->ij', length, away, away) + np.einsum('n,ni,nj->ij', length**3 / 12.0, run, run)
    ) / length.sum()
    direction = np.linalg.eigh(scatter)[1][:, 1]
    if direction @ along < 0.0:
        direction = -direction
    across = np.array([-direction[1], direction[0]])
    ends = np.stack([pieces.start[members], pieces.end[members]], axis=1) - centre
    places, off = ends @ direction, ends @ across
    first, last = places.min(), places.max()
    span = max(last - first, 1.0)
    # The residual's second-order part: how far the middle stands off the chord.
    chord = 0.5 * (off.flat[np.argmin(places)] + off.flat[np.argmax(places)])
    bow = float(off.flat[np.argmin(np.abs(places - 0.5 * (first + last)))] - chord)
    share = length / length.sum()
    plain = np.sqrt(np.maximum(pieces.sigma[members, 0] ** 2 - (BOW_OFFSET * pieces.bow[members]) ** 2, 1e-4))
    spread = float(np.sqrt((share * (away @ across) ** 2).sum()))
    offset = float(np.hypot(np.sqrt(((share * plain) ** 2).sum()), 0.5 * spread))
    sigma = np.array([np.hypot(offset, BOW_OFFSET * bow), np.hypot(np.sqrt(12.0) * offset, BOW_SLOPE * bow) / span])
    rms = float(np.sqrt((share * (pieces.rms[members] ** 2 + (away @ across) ** 2)).sum()))
    return JoinedLine(centre, direction, np.array([first, last]), rms, bow, sigma, float(np.abs(off).max()))


def with_line(pieces: Pieces, index: int, line: JoinedLine) -> Pieces:
    """The pieces, one of them replaced."""
    changed = {name: getattr(pieces, name).copy() for name in ('centre', 'direction', 'reach', 'rms', 'bow', 'sigma')}
    for name, values in changed.items():
        values[index] = getattr(line, name)
    return replace(pieces, **changed)


def join_matched(matches: Matches, left: Pieces, right: Pieces) -> tuple[Matches, Pieces, Pieces]:
    """Neighbouring pieces of either image that match one straight piece of the other become one piece.

    Returns the matches and pieces after that; pieces that went up in others are left out.
    """
    for mirrored in (False, True):
        own, other = (matches.right, matches.left) if mirrored else (matches.left, matches.right)
        side, far = (right, left) if mirrored else (left, right)
        crowd = np.flatnonzero((np.bincount(other, minlength=len(far)) > 1) & (far.arc < 0))
        kept = np.ones(len(side), bool)
        becomes = np.arange(len(side))
        for j in crowd:
            members = np.unique(own[other == j])
            members = members[(side.arc[members] < 0) & kept[members]]
            # A piece that is also part of another pair is not all one edge.
            members = np.array([i for i in members if (other[own == i] == j).all()], int)
            if len(members) < 2:
                continue
            axis = side.direction[members[np.argmax(side.length[members])]]
            members = members[np.argsort(0.5 * (side.start[members] + side.end[members]) @ axis)]
            head = members[0]
            for i in members[1:]:
                pair = np.array([head, i])
                line = joined_line(side, pair, side.direction[head])
                gap = line.reach[1] - line.reach[0] - side.length[pair].sum()
                (ax, ay), (bx, by) = side.direction[pair]
                if (
                    abs(ax * by - ay * bx) < ONE_DIRECTION
                    and line.miss < ONE_LINE
                    and -4.0 < gap < WIDEST_SHARE * side.length[pair].sum()
                ):
                    side = with_line(side, head, line)
                    kept[i] = False
                    becomes[i] = head
                else:
                    head = i
        if kept.all():
            continue
        place = np.cumsum(kept) - 1
        own = place[becomes[own]].astype(np.int32)
        side = side.select(kept)
        left, right = (left, side) if mirrored else (side, right)
        matches = _without_doubles(replace(matches, **{'right' if mirrored else 'left': own}), left)
    return matches, left, right


def _without_doubles(matches: Matches, left: Pieces) -> Matches:
    """Pairs that have become the same, as one: disparity at the new piece's ends by the line through all of theirs."""
    pairs, first, inverse = np.unique(
        np.stack([matches.left, matches.right], axis=1), axis=0, return_index=True, return_inverse=True
    )
    inverse = inverse.ravel()
    disparity, rows = matches.disparity.copy(), matches.rows.copy()
    for k in np.flatnonzero(np.bincount(inverse) > 1):
        same = np.flatnonzero(inverse == k)
        rows[first[k]] = rows[same, 0].min(), rows[same, 1].max()
        low, high = disparity[same][:, [0, 2]].min(axis=0), disparity[same][:, [0, 2]].max(axis=0)
        ends = (low[0], high[1]) if disparity[same[0], 0] < disparity[same[0], 2] else (high[0], low[1])
        disparity[first[k]] = ends[0], 0.5 * (ends[0] + ends[1]), ends[1]
    order = np.sort(first)
    return Matches(matches.left[order], matches.right[order], disparity[order], rows[order], matches.belief[order])


def split_matched(
    matches: Matches, left: Pieces, right: Pieces, edgels: tuple[Edgels, Edgels], sigma: float
) -> tuple[Matches, Pieces, Pieces]:
    """Pieces of either image that match two pieces which meet in a corner in the other image become two.

    edgels : as the pieces' bounds count; sigma : smoothing of the detector, pixels. Returns the matches and pieces
    after that, the second parts last.
    """
    pieces = [left, right]
    for image in (0, 1):
        own, other = (matches.left, matches.right) if image == 0 else (matches.right, matches.left)
        for i in np.flatnonzero(np.bincount(own, minlength=len(pieces[image])) == 2):
            rows = np.flatnonzero(own == i)
            corner = _crossing(pieces[1 - image], *other[rows])
            parts = None if corner is None else _cut(pieces[image], int(i), corner[1], edgels[image], sigma)
            if corner is None or parts is None:
                continue
            second = len(pieces[image])
            whole = pieces[image].select(np.array([i]))
            pieces[image] = Pieces(
                *(np.concatenate([getattr(pieces[image], f.name), getattr(parts, f.name)[1:]]) for f in fields(Pieces))
            )
            for f in fields(Pieces):
                getattr(pieces[image], f.name)[i] = getattr(parts, f.name)[0]
            # The second part lies beyond the corner in the direction of the piece.
            far = pieces[1 - image]
            middle = 0.5 * (far.start[other[rows], 1] + far.end[other[rows], 1])
            beyond = (middle - corner[1]) * whole.direction[0, 1] > 0.0
            own = own.copy()
            own[rows[beyond]] = second
            disparity, common = matches.disparity.copy(), matches.rows.copy()
            for row in rows:
                half = pieces[image].select(own[row : row + 1])
                ends = np.stack([half.start[0], half.end[0]])
                common[row] = np.clip(common[row], ends[:, 1].min(), ends[:, 1].max())
                if image == 0:
                    share = ((ends - whole.start[0]) @ whole.direction[0]) / max(float(whole.length[0]), 1e-9)
                    first, last = (1.0 - share) * disparity[row, 0] + share * disparity[row, 2]
                    disparity[row] = first, 0.5 * (first + last), last
            matches = replace(matches, disparity=disparity, rows=common, **{'right' if image else 'left': own})
    return matches, pieces[0], pieces[1]


def _crossing(pieces: Pieces, j: int, k: int) -> np.ndarray | None:
    """Where pieces j and k, whose strings stop before it, meet in a corner; None when they do not."""
    (tu, tv), (xu, xv) = pieces.direction[j], pieces.direction[k]
    sine = tu * xv - tv * xu
    if abs(sine) < 1e-6 or pieces.arc[j] >= 0 or pieces.arc[k] >= 0:
        return None
    run = pieces.centre[k] - pieces.centre[j]
    corner = pieces.centre[j] + (run[0] * xv - run[1] * xu) / sine * pieces.direction[j]
    ends = [np.stack([pieces.start[p], pieces.end[p]]) for p in (j, k)]
    nearest = [np.hypot(*(end - corner).T).min() for end in ends]
    gap = np.hypot(*(ends[0][:, None] - ends[1][None]).reshape(-1, 2).T).min()
    return corner if max(nearest) < gap + AT_GAP else None


def _cut(pieces: Pieces, i: int, height: float, edgels: Edgels, sigma: float) -> Pieces | None:
    """Piece i as two, cut at this row; None when that leaves too little of either."""
    direction, first = pieces.direction[i], int(pieces.bounds[i, 0])
    if abs(direction[1]) < LEVEL or pieces.arc[i] >= 0:
        return None
    place = (height - pieces.centre[i, 1]) / direction[1]
    along = (edgels.position[first : pieces.bounds[i, 1]] - pieces.centre[i]) @ direction
    count = int((along < place).sum())
    if min(count, len(along) - count) < FEWEST:
        return None
    bounds = np.array([[first, first + count], [first + count, pieces.bounds[i, 1]]])
    result = pieces.select(np.array([i, i]))
    reach = np.array([[pieces.reach[i, 0], place], [place, pieces.reach[i, 1]]])
    parts = fit_pieces(edgels, bounds, result.string, sigma)
    across = np.array([-direction[1], direction[0]])
    if max(np.abs((end - pieces.centre[i]) @ across).max() for end in (parts.start, parts.end)) < MOVED:
        # A string that was followed beyond its edgels still is.
        outer = [(pieces.centre[i] + reach[k, k] * direction - parts.centre[k]) @ parts.direction[k] for k in (0, 1)]
        reach = parts.reach.copy()
        reach[0, 0], reach[1, 1] = min(reach[0, 0], outer[0]), max(reach[1, 1], outer[1])
        return replace(parts, reach=reach)
    return replace(result, bounds=bounds, reach=reach)
