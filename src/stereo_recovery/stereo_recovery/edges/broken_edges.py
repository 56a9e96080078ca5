"""Long edges along the rows, broken by print or by a background that changes, from the corners at their ends.

An edge along the rows has no depth of its own, and each image breaks it at other places, so that its segments have no
partners. But its ends are corners: edges that leave the rows run into them and know their depth. Both images must show
the line between the two corners; then the edge is the line between two points in space (thesis 3.10: figural
continuity). An end without such an edge counts as seen where the line stops in both images, with a wide sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.segments import Segments
from ..matching.matches import Matches
from ..matching.merging import JoinedLine, joined_line, with_line

# A segment flatter than the first sine has no depth of its own; one steeper than the second can tell its depth.
FLAT, STEEP = 0.15, 0.3
# The shortest segment that starts a line, pixels, and the shortest that continues one.
SEED, SCRAP = 20.0, 8.0
# Segments of one broken line: both ends within this share of its length of it (within these bounds, pixels), turned by
# at most this (sine), across
# gaps of at most this share, or so many pixels.
STRAIGHTNESS, LEAST_MISS, MOST_MISS, ONE_DIRECTION = 0.012, 0.7, 2.0, 0.06
GAP_SHARE, LEAST_GAP = 0.3, 15.0
# How far beyond the line's end, and beyond the other edge's, a corner may lie: shares of their lengths, and pixels.
END_SHARE, END_LEAST, INSIDE = 0.25, 12.0, 8.0
# An edge tells a corner's disparity when it knows it this well there, pixels.
KNOWN = 1.5
# Disparity, pixels, by which edges miss each other at a real, rounded corner; and where a line just stops.
ROUNDED, STOPPED = 0.4, 4.0
# Ends whose disparity is vaguer than this may lie elsewhere along the line, too.
VAGUE_END = 6.0
# The share of the line that each image has to show, and how much may go on beyond its ends, pixels.
SHOWN, BEYOND = 0.6, 12.0
# How differently far from a corner the two images' chains may stop, pixels and as a share of the edge.
LEAST_APART, APART_SHARE = 4.0, 0.07
# The largest slope of disparity along such an edge, pixels a pixel; where only one corner is known.
RECEDING, STEEPEST = 0.3, 0.15
# Only edges whose disparity is worse than this at an end, pixels, are replaced.
VAGUE = 2.0
GATE = 3.0
# How much likelier, over its sigma in pixels, a teller's disparity is when it is the edge's than when it is anything in
# the picture (30 pixels, half of the tellers); how near to each other, pixels, they are at one corner; the lines of
# disparity that are looked at; and what it counts that the images show the whole edge.
CLEAR = 12.0
ONE_PLACE = 4.0
MOST_LINES = 12
SHOWN_WEIGHT = 4.0
# What the match knows of a broken edge's ends is what its tellers do: only their own gate limits what may improve it.
WHOLE_ENDS = 4.0


@dataclass(frozen=True, eq=False)
class FlatEdge:
    """One edge along the rows.

    members : (k,) left segments it consists of; partner : a right segment of it; line : through the left segments;
    extent : (2,) pixels along the line: its corners; coefficient (2,), covariance (2, 2) : of disparity along it;
    end_sigma, fixed : (2,) as in :class:`.lines3d.Lines3D`; told : (2,) pixels, sigma of disparity at the ends
    """

    members: AnyArray
    partner: int
    line: JoinedLine
    extent: AnyArray
    coefficient: AnyArray
    covariance: AnyArray
    end_sigma: AnyArray
    fixed: AnyArray
    told: AnyArray


@dataclass(frozen=True, eq=False)
class _Corner:
    """place : pixels along the line; disparity, sigma : pixels."""

    abscissa: float
    disparity: float
    sigma: float


def broken_lines(segments: Segments) -> list[tuple[AnyArray, JoinedLine]]:
    """Flat straight segments, those that lie on one line together: indices and the line through them, longest first."""
    flat = np.flatnonzero((np.abs(segments.direction[:, 1]) < FLAT) & (segments.length > SCRAP))
    flat = flat[np.argsort(-segments.length[flat], kind='stable')]
    start, end, used = segments.start, segments.end, np.zeros(len(segments), bool)
    result = []
    for seed in flat:
        # A bent edge may pass for an arc here and there, but not everywhere.
        if segments.length[seed] < SEED or used[seed] or segments.arc[seed] >= 0:
            continue
        members = np.array([seed])
        line = joined_line(segments, members, np.array([1.0, 0.0]))
        refused = used.copy()
        refused[seed] = True
        while True:
            span = line.extent[1] - line.extent[0]
            others = flat[~refused[flat]]
            ends = np.stack([start[others], end[others]], axis=1) - line.centre
            off = np.abs(ends @ [-line.direction[1], line.direction[0]]).max(axis=1)
            place = ends @ line.direction
            gap = np.maximum(place.min(axis=1) - line.extent[1], line.extent[0] - place.max(axis=1))
            turn = np.abs(segments.direction[others] @ [-line.direction[1], line.direction[0]])
            # A bent line misses a long segment that continues it by more than both miss the line through both.
            reached = 1.0 + np.minimum(segments.length[others] / span, 1.0)
            near = (
                (turn < ONE_DIRECTION)
                & (off < reached * np.clip(STRAIGHTNESS * span, LEAST_MISS, MOST_MISS))
                & (gap < max(LEAST_GAP, GAP_SHARE * span))
            )
            if not near.any():
                break
            chosen = others[near][np.argmin(np.maximum(gap[near], 0.0) + 5.0 * off[near])]
            refused[chosen] = True
            grown = np.append(members, chosen)
            longer = joined_line(segments, grown, line.direction)
            if longer.miss < np.clip(STRAIGHTNESS * span, LEAST_MISS, MOST_MISS):
                members, line = grown, longer
        used[members] = True
        result.append((members, line))
    return result


def complete(
    matches: Matches, left: Segments, right: Segments, coefficient: AnyArray, covariance: AnyArray
) -> list[FlatEdge]:
    """The flat edges of which at least one end is a corner with an edge that tells its depth.

    coefficient (n, 2), covariance (n, 2, 2) : of the matched edges, see :class:`.lines3d.Lines3D`.
    """
    i = matches.left
    steep = np.flatnonzero((np.abs(left.direction[i, 1]) > STEEP) & (left.arc[i] < 0) & (left.length[i] > SCRAP))
    if len(steep) == 0:
        return []
    teller = left.select(i[steep])
    known = coefficient[steep], covariance[steep]
    worst = np.full(len(left), np.inf)
    ends = np.stack([np.ones((len(i), 2)), left.extent[i]], axis=-1)
    np.minimum.at(worst, i, np.sqrt(np.einsum('nei,nij,nej->ne', ends, covariance, ends)).max(axis=1))
    common = np.zeros(len(left))
    np.maximum.at(common, i, np.minimum(left.length[i], right.length[matches.right]))
    flat_right = np.flatnonzero((np.abs(right.direction[:, 1]) < FLAT) & (right.length > SCRAP))
    result = []
    for members, line in broken_lines(left):
        if common[members[worst[members] < VAGUE]].sum() > 0.6 * left.length[members].sum():
            continue
        tellers = _tellers(line, teller, *known)
        if len(tellers) == 0:
            continue
        signs = {bool(left.direction[k] @ line.direction > 0.0) for k in members}
        partners = np.array([j for j in flat_right if bool(right.direction[j] @ line.direction > 0.0) in signs], int)
        edge = _told(members, line, tellers, left, right, partners) if len(partners) else None
        if edge is not None:
            result.append(edge)
    return result


def with_whole(
    whole: list[FlatEdge],
    matches: Matches,
    left: Segments,
    coefficient: AnyArray,
    covariance: AnyArray,
    ends_sigma: AnyArray,
) -> tuple[Matches, Segments, AnyArray, AnyArray, AnyArray]:
    """Matches, left segments, coefficients, covariances and end sigmas, with these edges, last, for their segments."""
    keep = ~np.isin(matches.left, np.concatenate([edge.members for edge in whole]))
    for edge in whole:
        left = with_line(left, int(edge.members[0]), edge.line)
    disparity = [
        edge.coefficient[0] + edge.coefficient[1] * np.array([a, 0.5 * (a + b), b])
        for edge in whole
        for a, b in [edge.line.extent]
    ]
    rows = [np.sort(edge.line.centre[1] + edge.line.extent * edge.line.direction[1]) for edge in whole]
    matches = Matches(
        np.append(matches.left[keep], [edge.members[0] for edge in whole]).astype(np.int32),
        np.append(matches.right[keep], [edge.partner for edge in whole]).astype(np.int32),
        np.concatenate([matches.disparity[keep], disparity]),
        np.concatenate([matches.rows[keep], rows]),
        np.append(matches.belief[keep], np.ones(len(whole))),
    )
    return (
        matches,
        left,
        np.concatenate([coefficient[keep], [edge.coefficient for edge in whole]]),
        np.concatenate([covariance[keep], [edge.covariance for edge in whole]]),
        np.concatenate([ends_sigma[keep], [WHOLE_ENDS * edge.told for edge in whole]]),
    )


def _tellers(line: JoinedLine, teller: Segments, coefficient: AnyArray, covariance: AnyArray) -> AnyArray:
    """(k, 3) float64: abscissa, disparity and its sigma, pixels, that steep edges tell of a line, by abscissa."""
    sine = line.direction[0] * teller.direction[:, 1] - line.direction[1] * teller.direction[:, 0]
    away = teller.centre - line.centre
    with np.errstate(divide='ignore', invalid='ignore'):
        place = (away[:, 0] * teller.direction[:, 1] - away[:, 1] * teller.direction[:, 0]) / sine
        own = (away[:, 0] * line.direction[1] - away[:, 1] * line.direction[0]) / sine
    row = np.stack([np.ones_like(own), own], axis=1)
    disparity = (row * coefficient).sum(axis=1)
    # The corner is known along the steep edge to about a pixel.
    sigma = np.sqrt(np.einsum('ni,nij,nj->n', row, covariance, row) + coefficient[:, 1] ** 2)
    beyond = np.maximum(teller.extent[:, 0] - own, own - teller.extent[:, 1])
    good = (np.abs(sine) > STEEP) & (beyond > -INSIDE) & (sigma < KNOWN)
    good &= beyond < np.maximum(END_LEAST, END_SHARE * teller.length)
    far = max(END_LEAST, END_SHARE * (line.extent[1] - line.extent[0]))
    good &= (place > line.extent[0] - far) & (place < line.extent[1] + far)
    table: AnyArray = np.column_stack([place, disparity, sigma])[good]
    ordered: AnyArray = table[np.argsort(table[:, 0], kind='stable')]
    return ordered


def _told(
    members: AnyArray, line: JoinedLine, tellers: AnyArray, left: Segments, right: Segments, partners: AnyArray
) -> FlatEdge | None:
    """The edge that its tellers support best among those that both images show; None when they show none."""
    span = line.extent[1] - line.extent[0]
    inside = min(INSIDE, 0.1 * span)
    at = tellers[:, 0] < line.extent[0] + inside, tellers[:, 0] > line.extent[1] - inside
    spread = np.hypot(tellers[:, 2], ROUNDED)
    # Disparity along the line: through any two tellers, and from one at an end to where both images' lines stop.
    p, q = np.nonzero(tellers[None, :, 0] > tellers[:, None, 0] + SEED)
    slope = (tellers[q, 1] - tellers[p, 1]) / (tellers[q, 0] - tellers[p, 0])
    lines: list[tuple[float, float, _Corner | None]]
    lines = [(a, b, None) for a, b in zip(tellers[p, 1] - slope * tellers[p, 0], slope) if abs(b) < RECEDING]
    for end in (0, 1):
        for k in np.flatnonzero(at[end]):
            ends = _with_stop(line, _Corner(*tellers[k]), end, right, partners)
            if ends is not None:
                b = (ends[1].disparity - ends[0].disparity) / (ends[1].abscissa - ends[0].abscissa)
                lines.append((ends[0].disparity - b * ends[0].abscissa, b, ends[1 - end]))
    if not lines:
        return None
    a, b = np.array([row[:2] for row in lines]).T
    miss = (a[:, None] + b[:, None] * tellers[:, 0] - tellers[:, 1]) / spread
    # A teller is of the edge, or of anything in the picture. What ends at one place is one corner, and counts once.
    corner = np.flatnonzero(np.diff(tellers[:, 0], prepend=-np.inf) > ONE_PLACE)
    support = np.maximum.reduceat(np.log1p(CLEAR / spread * np.exp(-0.5 * miss**2)), corner, axis=1).sum(axis=1)
    best: tuple[float, FlatEdge] | None = None
    for k in np.argsort(-support, kind='stable')[:MOST_LINES]:
        edge = _edge(members, line, tellers, at, np.abs(miss[k]) < GATE, lines[k][2], right, partners)
        if edge is None or (best is not None and support[k] < best[0] - SHOWN_WEIGHT):
            continue
        shown = _shown(line, _ends_of(edge), left, members, right, partners)
        score = float(support[k] + SHOWN_WEIGHT * shown)
        if shown >= SHOWN and (best is None or score > best[0]):
            best = score, edge
    return None if best is None else best[1]


def _ends_of(edge: FlatEdge) -> list[_Corner]:
    return [
        _Corner(float(place), float(edge.coefficient @ [1.0, place]), float(sigma))
        for place, sigma in zip(edge.extent, edge.told)
    ]


def _edge(
    members: AnyArray,
    line: JoinedLine,
    tellers: AnyArray,
    at: tuple[AnyArray, AnyArray],
    agree: AnyArray,
    stop: _Corner | None,
    right: Segments,
    partners: AnyArray,
) -> FlatEdge | None:
    """The edge that these tellers agree on: least squares of what they say; None when they leave it open.

    at : two (k,) bool, tellers that are at either end; stop : what the line's end says, where nothing else does.
    """
    fixed = np.array([bool((agree & side).any()) for side in at])
    if stop is None and not fixed.all():
        # One teller besides the corner could be anything.
        away = agree & ~(at[0] | at[1])
        if not fixed.any() or away.sum() < 2:
            return None
    weight = 1.0 / (tellers[:, 2] ** 2 + ROUNDED**2)
    extent = np.array(
        [
            np.average(tellers[agree & side, 0], weights=1.0 / tellers[agree & side, 2] ** 2) if known else own
            for side, known, own in zip(at, fixed, line.extent)
        ]
    )
    rows = [np.column_stack([np.ones(agree.sum()), tellers[agree, 0], tellers[agree, 1]])]
    weights = [weight[agree]]
    if stop is not None:
        rows.append(np.array([[1.0, stop.abscissa, stop.disparity]]))
        weights.append(np.array([1.0 / (stop.sigma**2 + ROUNDED**2)]))
    table, weight = np.concatenate(rows), np.concatenate(weights)
    design, values = table[:, :2], table[:, 2]
    covariance = np.linalg.inv(design.T @ (design * weight[:, None]))
    coefficient = covariance @ (design.T @ (weight * values))
    if len(values) > 2:
        misses = (values - design @ coefficient) ** 2 * weight
        covariance = covariance * max(1.0, float(misses.sum()) / (len(values) - 2))
    ends = np.column_stack([np.ones(2), extent])
    told = np.sqrt(np.einsum('ei,ij,ej->e', ends, covariance, ends))
    corners = [_Corner(float(x), float(coefficient @ [1.0, x]), float(s)) for x, s in zip(extent, told)]
    partner = int(partners[np.argmax(_overlap(line, corners, right, partners))])
    return FlatEdge(members, partner, line, extent, coefficient, covariance, np.where(fixed, 1.0, 3.0), fixed, told)


def _with_stop(line: JoinedLine, known: _Corner, end: int, right: Segments, partners: AnyArray) -> list[_Corner] | None:
    """Both ends, of which one (0 or 1) is known; the other is where the line stops in the left and the right image."""
    # From the corner along the line, which has nearly the same slope in the right image.
    run = (1.0 if end == 0 else -1.0) * line.direction
    corner = line.centre + known.abscissa * line.direction - [known.disparity, 0.0]
    points = np.stack([right.start[partners], right.end[partners]], axis=1) - corner
    place = points[..., 0] / run[0]
    off = np.abs(points[..., 1] - place * run[1]) - STEEPEST * np.abs(place * run[1])
    span = line.extent[1] - line.extent[0]
    place = place[off.max(axis=1) < np.clip(STRAIGHTNESS * span, LEAST_MISS, MOST_MISS)]
    stop = float(line.extent[1] - known.abscissa if end == 0 else known.abscissa - line.extent[0])
    front, nearest = 0.0, np.inf
    for near, far in sorted(np.sort(place, axis=1).tolist()):
        if far > front and near < front + max(LEAST_GAP, GAP_SHARE * front):
            front = far
            nearest = front if abs(stop - front) < abs(stop - nearest) else nearest
    if stop < SEED or front < SEED:
        return None
    # Where both stop is one point. Lines that stop at places of their own only tell that disparity hardly changes.
    miss, sigma = (stop - nearest) * run[0], STOPPED
    if abs(miss) > 2.0 * STOPPED:
        miss, sigma = 0.0, 0.5 * STEEPEST * stop
    other = _Corner(float(line.extent[1 - end]), float(known.disparity + miss), sigma)
    return [known, other] if end == 0 else [other, known]


def _overlap(line: JoinedLine, ends: list[_Corner], right: Segments, partners: AnyArray) -> AnyArray:
    """(k,) pixels that each right segment shows of the edge between two corners."""
    places = _along(line, ends, right, partners)
    first, last = ends[0].abscissa, ends[1].abscissa
    overlap: AnyArray = np.nan_to_num(np.minimum(places[:, 1], last) - np.maximum(places[:, 0], first))
    overlap = np.maximum(overlap, 0.0)
    return overlap


def _along(line: JoinedLine, ends: list[_Corner], right: Segments, partners: AnyArray) -> AnyArray:
    """(k, 2) ends of right segments as abscissas on the left line, by the edge's disparity; NaN for those off it."""
    corner = [line.centre + end.abscissa * line.direction - [end.disparity, 0.0] for end in ends]
    run = corner[1] - corner[0]
    length = max(float(np.hypot(*run)), 1e-9)
    run = run / length
    points = np.stack([right.start[partners], right.end[partners]], axis=1) - corner[0]
    off = np.abs(points @ [-run[1], run[0]]).max(axis=1)
    share = np.sort(points @ run, axis=1) / length
    places = ends[0].abscissa + share * (ends[1].abscissa - ends[0].abscissa)
    places[off > np.clip(STRAIGHTNESS * length, LEAST_MISS, MOST_MISS)] = np.nan
    return places


def _shown(
    line: JoinedLine, ends: list[_Corner], left: Segments, members: AnyArray, right: Segments, partners: AnyArray
) -> float:
    """Share of the edge that both images show; 0 when either shows that the line goes on beyond its ends."""
    if len(partners) == 0:
        return 0.0
    corner = [line.centre + end.abscissa * line.direction - [end.disparity, 0.0] for end in ends]
    if (corner[1] - corner[0]) @ line.direction < SEED:
        return 0.0
    points = np.stack([left.start[members], left.end[members]], axis=1) - line.centre
    first, last = ends[0].abscissa, ends[1].abscissa
    sample = first + (np.arange(100) + 0.5) / 100 * (last - first)
    shares, stops = [], []
    for places in (np.sort(points @ line.direction, axis=1), _along(line, ends, right, partners)):
        places = places[np.isfinite(places).all(axis=1) & (places[:, 1] > first) & (places[:, 0] < last)]
        if len(places) == 0:
            return 0.0
        stops.append((places.min(), places.max()))
        hit = ((sample >= places[:, :1] - 1.0) & (sample <= places[:, 1:] + 1.0)).any(axis=0)
        shares.append(float(hit.mean()))
        beyond = (
            np.minimum(places[:, 1], first) - np.maximum(places[:, 0], first - 2 * BEYOND),
            np.minimum(places[:, 1], last + 2 * BEYOND) - np.maximum(places[:, 0], last),
        )
        # Where nothing but a vague stop tells the end it may be elsewhere.
        if any(end.sigma < VAGUE_END and np.maximum(outside, 0.0).sum() > BEYOND for end, outside in zip(ends, beyond)):
            return 0.0
    # Both images' chains stop about as far from a corner.
    apart = np.abs(np.array(stops[0]) - np.array(stops[1]))
    if any(
        end.sigma < KNOWN and miss > max(LEAST_APART, APART_SHARE * (last - first)) for end, miss in zip(ends, apart)
    ):
        return 0.0
    return min(shares)
