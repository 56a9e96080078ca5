"""Segments of one edge that an image shows broken, made one line again; and two edges that one eye sees as one line.

Real edges are not as straight as their chains are precise: card folds, worn corners, print that runs across. One eye
may see such an edge as one segment and the other as two. What the one eye sees as one edge is one edge. But an eye in
the plane of two edges that meet sees one line, where the other eye sees a corner: that line is two edges.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray

from ..detection.edgels import Edgels
from ..detection.segments import Segments, fit_segments
from ..detection.settings import LEVEL_SINE, SAGITTA_OFFSET, SAGITTA_SLOPE
from .matches import Matches
from .settings import AT_GAP, FEWEST, PARTS_GAP, PARTS_MISS, PARTS_SINE


@dataclass(frozen=True)
class JoinedLine:
    """One line through several segments; fields as in :class:`.segments.Segments`, of one segment.

    Attributes
    ----------
    miss
        Pixels, the largest distance of an end of the segments from the line.
    """

    centre: AnyArray
    direction: AnyArray
    extent: AnyArray
    rms: float
    sagitta: float
    sigma: AnyArray
    miss: float


def joined_line(segments: Segments, along: AnyArray) -> JoinedLine:
    """The line that orthogonal regression over all points of segments gives.

    along : (2,) a direction that the result's roughly has.
    """
    start, end, run = segments.start, segments.end, segments.direction
    length = np.maximum(segments.length, 1.0)
    middle = 0.5 * (start + end)
    centre = np.average(middle, axis=0, weights=length)
    away = middle - centre
    scatter = (
        np.einsum('n,ni,nj->ij', length, away, away) + np.einsum('n,ni,nj->ij', length**3 / 12.0, run, run)
    ) / length.sum()
    direction = np.linalg.eigh(scatter)[1][:, 1]
    if direction @ along < 0.0:
        direction = -direction
    across = np.array([-direction[1], direction[0]])
    ends = np.stack([start, end], axis=1) - centre
    places, off = ends @ direction, ends @ across
    first, last = places.min(), places.max()
    span = max(last - first, 1.0)
    # The residual's second-order part: how far the middle stands off the chord.
    chord = 0.5 * (off.flat[np.argmin(places)] + off.flat[np.argmax(places)])
    sagitta = float(off.flat[np.argmin(np.abs(places - 0.5 * (first + last)))] - chord)
    share = length / length.sum()
    plain = np.sqrt(np.maximum(segments.sigma[:, 0] ** 2 - (SAGITTA_OFFSET * segments.sagitta) ** 2, 1e-4))
    spread = float(np.sqrt((share * (away @ across) ** 2).sum()))
    offset = float(np.hypot(np.sqrt(((share * plain) ** 2).sum()), 0.5 * spread))
    sigma = np.array(
        [np.hypot(offset, SAGITTA_OFFSET * sagitta), np.hypot(np.sqrt(12.0) * offset, SAGITTA_SLOPE * sagitta) / span]
    )
    rms = float(np.sqrt((share * (segments.rms**2 + (away @ across) ** 2)).sum()))
    return JoinedLine(centre, direction, np.array([first, last]), rms, sagitta, sigma, float(np.abs(off).max()))


def with_line(segments: Segments, index: int, line: JoinedLine) -> Segments:
    """The segments, one of them replaced."""
    changed = {
        name: getattr(segments, name).copy() for name in ('centre', 'direction', 'extent', 'rms', 'sagitta', 'sigma')
    }
    for name, values in changed.items():
        values[index] = getattr(line, name)
    return replace(segments, **changed)


def join_matched(matches: Matches, left: Segments, right: Segments) -> tuple[Matches, Segments, Segments]:
    """Neighbouring segments of either image that match one straight segment of the other become one segment.

    Returns the matches and segments after that; segments that went up in others are left out.
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
            # A segment that is also part of another pair is not all one edge.
            members = np.array([i for i in members if (other[own == i] == j).all()], int)
            if len(members) < 2:
                continue
            axis = side.direction[members[np.argmax(side.length[members])]]
            members = members[np.argsort(0.5 * (side.start[members] + side.end[members]) @ axis)]
            head = members[0]
            for i in members[1:]:
                line = _one_line(side.select(np.array([head, i])))
                if line is not None:
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
        matches = _without_doubles(replace(matches, **cast(Any, {'right' if mirrored else 'left': own})), left)
    return matches, left, right


def _one_line(pair: Segments) -> JoinedLine | None:
    """The line of two segments that follow each other, None where they are not on one."""
    (ax, ay), (bx, by) = pair.direction
    if abs(ax * by - ay * bx) >= PARTS_SINE:
        return None
    line, length = joined_line(pair, pair.direction[0]), pair.length.sum()
    gap = line.extent[1] - line.extent[0] - length
    return line if line.miss < PARTS_MISS and -4.0 < gap < PARTS_GAP * length else None


def _without_doubles(matches: Matches, left: Segments) -> Matches:
    """Pairs that have become the same, as one, with the disparity that the line through all of theirs gives."""
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
    matches: Matches, left: Segments, right: Segments, edgels: tuple[Edgels, Edgels], sigma: float
) -> tuple[Matches, Segments, Segments]:
    """Segments of either image that match two segments which meet in a corner in the other image become two.

    edgels : as the segments' bounds count; sigma : smoothing of the detector, pixels. Returns the matches and segments
    after that, the second parts last.
    """
    segments = [left, right]
    for image in (0, 1):
        own, other = (matches.left, matches.right) if image == 0 else (matches.right, matches.left)
        for i in np.flatnonzero(np.bincount(own, minlength=len(segments[image])) == 2):
            rows = np.flatnonzero(own == i)
            corner = _crossing(segments[1 - image], *other[rows])
            parts = None if corner is None else _cut(segments[image], int(i), corner[1], edgels[image], sigma)
            if corner is None or parts is None:
                continue
            second = len(segments[image])
            whole = segments[image].select(np.array([i]))
            segments[image] = Segments(
                *(
                    np.concatenate([getattr(segments[image], f.name), getattr(parts, f.name)[1:]])
                    for f in fields(Segments)
                )
            )
            for f in fields(Segments):
                getattr(segments[image], f.name)[i] = getattr(parts, f.name)[0]
            # The second part lies beyond the corner in the direction of the segment.
            far = segments[1 - image]
            middle = 0.5 * (far.start[other[rows], 1] + far.end[other[rows], 1])
            beyond = (middle - corner[1]) * whole.direction[0, 1] > 0.0
            own = own.copy()
            own[rows[beyond]] = second
            disparity, common = matches.disparity.copy(), matches.rows.copy()
            for row in rows:
                half = segments[image].select(own[row : row + 1])
                ends = np.stack([half.start[0], half.end[0]])
                common[row] = np.clip(common[row], ends[:, 1].min(), ends[:, 1].max())
                if image == 0:
                    share = ((ends - whole.start[0]) @ whole.direction[0]) / max(float(whole.length[0]), NOT_ZERO)
                    first, last = (1.0 - share) * disparity[row, 0] + share * disparity[row, 2]
                    disparity[row] = first, 0.5 * (first + last), last
            matches = replace(
                matches, disparity=disparity, rows=common, **cast(Any, {'right' if image else 'left': own})
            )
    return matches, segments[0], segments[1]


def _crossing(segments: Segments, j: int, k: int) -> AnyArray | None:
    """Where segments j and k, whose chains stop before it, meet in a corner; None when they do not."""
    (tu, tv), (xu, xv) = segments.direction[j], segments.direction[k]
    sine = tu * xv - tv * xu
    if abs(sine) < 1e-6 or segments.arc[j] >= 0 or segments.arc[k] >= 0:
        return None
    run = segments.centre[k] - segments.centre[j]
    corner = segments.centre[j] + (run[0] * xv - run[1] * xu) / sine * segments.direction[j]
    ends = [np.stack([segments.start[p], segments.end[p]]) for p in (j, k)]
    nearest = [np.hypot(*(end - corner).T).min() for end in ends]
    gap = np.hypot(*(ends[0][:, None] - ends[1][None]).reshape(-1, 2).T).min()
    return corner if max(nearest) < gap + AT_GAP else None


def _cut(segments: Segments, i: int, height: float, edgels: Edgels, sigma: float) -> Segments | None:
    """Segment i as two, cut at this row; None when that leaves too little of either."""
    direction, first = segments.direction[i], int(segments.bounds[i, 0])
    if abs(direction[1]) < LEVEL_SINE or segments.arc[i] >= 0:
        return None
    place = (height - segments.centre[i, 1]) / direction[1]
    along = (edgels.position[first : segments.bounds[i, 1]] - segments.centre[i]) @ direction
    count = int((along < place).sum())
    if min(count, len(along) - count) < FEWEST:
        return None
    bounds = np.array([[first, first + count], [first + count, segments.bounds[i, 1]]])
    result = segments.select(np.array([i, i]))
    extent = np.array([[segments.extent[i, 0], place], [place, segments.extent[i, 1]]])
    parts = fit_segments(edgels, bounds, result.chain, sigma)
    across = np.array([-direction[1], direction[0]])
    if max(np.abs((end - segments.centre[i]) @ across).max() for end in (parts.start, parts.end)) < PARTS_MISS:
        # A chain that was followed beyond its edgels still is.
        outer = [(segments.centre[i] + extent[k, k] * direction - parts.centre[k]) @ parts.direction[k] for k in (0, 1)]
        extent = parts.extent.copy()
        extent[0, 0], extent[1, 1] = min(extent[0, 0], outer[0]), max(extent[1, 1], outer[1])
        return replace(parts, extent=extent)
    return replace(result, bounds=bounds, extent=extent)
