"""What cameras beyond the main pair say of its edges: more lines through the same two unknowns.

In the frame of its own pair with the main left camera, an edge that a further camera shows has a disparity
a' + b' s', which its two lines measure as those of any pair do. Both frames share the left camera's centre, so that
depth in the one is depth in the other times w(s), which is linear along the segment: (a', b') is linear in (a, b), and
what the further camera measures is information of the main pair's unknowns. The left line is one for all of them, and
its error is counted once.

References
----------
N. Ayache, F. Lustman, "Trinocular stereo vision for robotics", PAMI 13(1), 1991; Hartley and Zisserman, Multiple View
Geometry, 2nd edition, section 15.1 (transfer of lines).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments
from ..matching.further_views import FurtherView
from ..matching.matches import Matches, match_of
from ..matching.stereo_segments import StereoSegments
from .estimate import OwnLines
from .extents import Extents, extents
from .own_lines import LinePairs, line_pairs
from .settings import (
    BELIEF_MOST,
    BLIND_AGREEMENT,
    BLIND_PRIOR,
    LEAST_LEFT_SHARE,
    OPEN_SIGMA,
    SIGHTED_AGREEMENT,
    VIEW_GATE,
)


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """What one camera's matches say of n left segments of the main pair.

    Attributes
    ----------
    known : (n,) bool
    x, covariance : (n, 2), (n, 2, 2)
        Disparity a + b s, pixels of the main pair, of those it knows.
    log_odds : (n,) float64
        That its match is right; 0 where there is none.
    """

    known: BoolArray
    x: FloatArray
    covariance: FloatArray
    log_odds: FloatArray


@dataclass(frozen=True, eq=False)
class ViewLines:
    """What a further camera says of the main pair's edges.

    Attributes
    ----------
    view : FurtherView
        With m matches.
    match : (n,) int64
        The match of each of the main pair's left segments, or -1.
    pairs : LinePairs
        What the matches' lines say of their own unknowns, x'.
    turn, shift : (m, 2, 2), (m, 2)
        x' = turn x + shift, with the main pair's unknowns x.
    left_turn : (m, 2, 2)
        What the error of the main pair's left line, offset and slope, is in the view's own pair.
    """

    view: FurtherView
    match: IntArray
    pairs: LinePairs
    turn: FloatArray
    shift: FloatArray
    left_turn: FloatArray

    def hypotheses(self) -> Hypotheses:
        """What each match alone says, and roughly its place."""
        matches, left = self.view.seen.matches, self.view.seen.segments[0]
        own = self.pairs.own_lines(left.extent[matches.left]).about(matches.disparity[:, 1])
        covariance = np.linalg.inv(own.information)
        back = np.linalg.inv(self.turn)
        x = np.einsum('nij,nj->ni', back, np.einsum('nij,nj->ni', covariance, own.vector) - self.shift)
        covariance = np.einsum('nij,njk,nlk->nil', back, covariance, back)
        return _by_left(self.match, x, covariance, matches.belief)

    def restricted(self, kept: BoolArray) -> ViewLines:
        """The same of some of the left segments, (n,) bool, only."""
        return replace(self, match=np.where(kept, self.match, -1))

    def extents(self, left: IntArray, x: FloatArray) -> Extents:
        """Where edges end by this view: of left segments (k,) that it matches, with disparities (k, 2)."""
        own = self.match[left]
        its = self.hypotheses()
        of_match = its.x[self._left_of_match()]
        of_match[own] = x
        found = extents(self.view.seen, np.einsum('nij,nj->ni', self.turn, of_match) + self.shift)
        along = self.view.turned.along[self.view.seen.matches.left[own]]
        w, p, q = along[:, :, 0], along[:, :1, 1], along[:, 1:, 1]
        place = found.abscissa[own]
        below = q - place * w[:, 1:]
        abscissa = (place * w[:, :1] - p) / below
        sigma = found.sigma[own] * np.abs(w[:, :1] * q - p * w[:, 1:]) / below**2
        return Extents(abscissa, sigma, found.fixed[own], found.in_both[own])

    def _left_of_match(self) -> IntArray:
        """(m,) the main pair's left segment of each match."""
        return self.view.left[self.view.seen.matches.left]


def view_lines(view: FurtherView, main: StereoRig, count: int) -> ViewLines:
    """A further view's lines as information of the main pair's ``count`` left segments."""
    seen = view.seen
    pairs = line_pairs(seen.matches, seen.segments, view.row_sigma)
    i = seen.matches.left
    along, scale = view.turned.along[i], view.turned.scale[i]
    inverse = np.linalg.inv(along)
    # Disparity over that at infinity, times depth, is focal length times baseline; depth grows by w.
    ratio = view.rig.left.fx * view.rig.baseline / (main.left.fx * main.baseline)
    here, there = main.left.cx - main.right.cx, view.rig.left.cx - view.rig.right.cx
    rest = there * along[:, :, 0] - ratio * here * np.array([1.0, 0.0])
    match = np.full(count, -1)
    match[view.left] = match_of(i, len(seen.segments[0]))
    shift = np.einsum('nij,nj->ni', inverse, rest)
    return ViewLines(view, match, pairs, np.asarray(ratio * inverse), shift, scale[:, None, None] * inverse)


def joint_lines(seen: StereoSegments, row_sigma: float, views: Sequence[ViewLines]) -> OwnLines:
    """What the lines of all cameras say of the edges, each by itself.

    The unknowns are the edge's disparity and the error of its left line, which all pairs share; the latter is
    eliminated (Schur's complement).

    Parameters
    ----------
    seen : StereoSegments
        n edges of the main pair.
    row_sigma : float, pixels
        By which its single rows disagree.
    views : sequence of ViewLines
    """
    pairs = line_pairs(seen.matches, seen.segments, row_sigma)
    left = seen.matches.left
    own = pairs.own_lines(seen.segments[0].extent[left])
    told = np.zeros(len(left), bool)
    for view in views:
        told |= view.match[left] >= 0
    if not told.any():
        return own
    e = np.flatnonzero(told)
    normal, vector = np.zeros((len(e), 4, 4)), np.zeros((len(e), 4))
    prior = np.zeros((len(e), 2, 2))
    eye = np.eye(2)
    shown = np.flatnonzero(seen.paired[e])
    at = e[shown]
    prior[shown] = pairs.left_variance[at, :, None] * eye
    _add((normal, vector), shown, (pairs, at), pairs.rise[at, None, None] * eye, pairs.value[at], eye)
    for view in views:
        match = view.match[left[e]]
        k = np.flatnonzero(match >= 0)
        m = match[k]
        back = np.linalg.inv(view.left_turn[m])
        fresh = ~prior[k].any(axis=(1, 2))
        prior[k[fresh]] = np.einsum('nij,nj,nkj->nik', back, view.pairs.left_variance[m], back)[fresh]
        rise = view.pairs.rise[m, None]
        rows, value = rise[..., None] * view.turn[m], view.pairs.value[m] - rise * view.shift[m]
        _add((normal, vector), k, (view.pairs, m), rows, value, view.left_turn[m])
    normal[:, 2:, 2:] += np.linalg.inv(prior)
    gain = np.einsum('nij,njk->nik', normal[:, :2, 2:], np.linalg.inv(normal[:, 2:, 2:]))
    # A stand-in of the right image says nothing.
    information, right, with_line = (
        np.where(seen.paired[:, None, None], each, 0.0)
        for each in (own.information, own.vector[..., None], np.asarray(own.with_line))
    )
    information[e] = normal[:, :2, :2] - np.einsum('nij,nkj->nik', gain, normal[:, :2, 2:])
    right[e, :, 0] = vector[:, :2] - np.einsum('nij,nj->ni', gain, vector[:, 2:])
    with_line[e] = gain
    return OwnLines(information, right[..., 0], own.extent, with_line)


def _add(
    system: tuple[FloatArray, FloatArray],
    at: IntArray,
    measured: tuple[LinePairs, IntArray],
    rows: FloatArray,
    value: FloatArray,
    left_turn: FloatArray,
) -> None:
    """Add statements rows x = value + cosine left_turn z + noise to normal equations of (x, z).

    measured : the line pairs, and which of them, whose covariance without the left line's error is the noise's.
    """
    pairs, index = measured
    noise = pairs.other_covariance[index] + LEAST_LEFT_SHARE * pairs.left_variance[index, :, None] * np.eye(2)
    both = np.concatenate([rows, -pairs.cosine[index, None, None] * left_turn], axis=2)
    weighted = np.einsum('nji,njk->nik', both, np.linalg.inv(noise))
    normal, vector = system
    normal[at] += weighted @ both
    vector[at] += np.einsum('nij,nj->ni', weighted, value)


# -- which cameras agree -----------------------------------------------------------------------------------------------


def _by_left(match: IntArray, x: FloatArray, covariance: FloatArray, belief: FloatArray) -> Hypotheses:
    """What matches say, by left segment: match (n,) is the one of each, or -1."""
    known = match >= 0
    row = np.where(known, match, 0)
    if len(x) == 0:
        n = len(match)
        return Hypotheses(known, np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1)), np.zeros(n))
    certain = np.clip(belief, 1.0 - BELIEF_MOST, BELIEF_MOST)
    odds = np.where(known, np.log(certain / (1.0 - certain))[row], 0.0)
    return Hypotheses(known, x[row], covariance[row], odds)


def main_hypotheses(seen: StereoSegments, row_sigma: float) -> Hypotheses:
    """What the main pair's matches say, each alone, of its left segments."""
    matches, left = seen.matches, seen.segments[0]
    own = line_pairs(matches, seen.segments, row_sigma).own_lines(left.extent[matches.left])
    own = own.about(matches.disparity[:, 1])
    covariance = np.asarray(np.linalg.inv(own.information), np.float64)
    x = np.einsum('nij,nj->ni', covariance, own.vector)
    return _by_left(match_of(matches.left, len(left)), x, covariance, matches.belief)


def agreement(hypotheses: Sequence[Hypotheses]) -> BoolArray:
    """(v, v, n) bool: whether two cameras know a segment and what they say of it may be one edge."""
    count = len(hypotheses)
    result = np.zeros((count, count, len(hypotheses[0].known)), bool)
    for a in range(count):
        for b in range(count):
            one, other = hypotheses[a], hypotheses[b]
            off = one.x - other.x
            square = np.einsum('ni,nij,nj->n', off, np.linalg.inv(one.covariance + other.covariance), off)
            result[a, b] = one.known & other.known & (square < VIEW_GATE)
    return result


def sighted(hypotheses: Sequence[Hypotheses], extent: FloatArray) -> BoolArray:
    """(v,) bool: cameras that see the scene that the first one, the main pair, sees; a covered one does not.

    Each common segment whose depth both know is a witness: cameras that see agree on most of them, and one that is
    blind on few, by accident.

    Parameters
    ----------
    hypotheses : sequence of Hypotheses
        Of the main pair, and of each further camera.
    extent : (n, 2) float64, pixels
        Of the left segments.
    """
    rows = np.stack([np.ones_like(extent), extent], axis=-1)
    sharp = [
        each.known & (np.einsum('nei,nij,nej->ne', rows, each.covariance, rows).max(axis=1) < OPEN_SIGMA**2)
        for each in hypotheses
    ]
    agree = agreement(hypotheses)
    result = np.ones(len(hypotheses), bool)
    for v in range(1, len(hypotheses)):
        both = sharp[0] & sharp[v]
        yes, no = int((both & agree[0, v]).sum()), int((both & ~agree[0, v]).sum())
        odds = np.log((1.0 - BLIND_PRIOR) / BLIND_PRIOR)
        odds += yes * np.log(SIGHTED_AGREEMENT / BLIND_AGREEMENT)
        odds += no * np.log((1.0 - SIGHTED_AGREEMENT) / (1.0 - BLIND_AGREEMENT))
        result[v] = odds > 0.0
    return result


def elected(hypotheses: Sequence[Hypotheses]) -> BoolArray:
    """(v, n) bool: the cameras whose matches of a segment count: of those that agree, the likeliest together."""
    agree = agreement(hypotheses)
    odds = np.stack([each.log_odds for each in hypotheses])
    votes = np.einsum('abn,bn->an', agree, odds)
    known = np.stack([each.known for each in hypotheses])
    best = np.where(known, votes, -np.inf).argmax(axis=0)
    return np.asarray(agree[best, :, np.arange(len(best))].T & known)


# -- one set of edges --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class AllViews:
    """The edges of a pair as all cameras show them.

    Attributes
    ----------
    seen : StereoSegments
        With those that the right image does not show, or not rightly, last; stand-ins take its place.
    views : tuple of ViewLines
        Of the further cameras that see the scene, only what counts.
    """

    seen: StereoSegments
    views: tuple[ViewLines, ...] = ()


def all_views(seen: StereoSegments, row_sigma: float, further: Sequence[FurtherView], rig: StereoRig) -> AllViews:
    """The edges of a pair with what further cameras say of them.

    Parameters
    ----------
    seen : StereoSegments
        Matched segments of the main pair.
    row_sigma : float, pixels
        By which its single rows disagree.
    further : sequence of FurtherView
    rig : StereoRig
        The main pair.
    """
    if not further:
        return AllViews(seen)
    left = seen.segments[0]
    views = [view_lines(view, rig, len(left)) for view in further]
    hypotheses = [main_hypotheses(seen, row_sigma), *(view.hypotheses() for view in views)]
    kept = np.flatnonzero(sighted(hypotheses, left.extent))
    views, hypotheses = [views[k - 1] for k in kept[1:]], [hypotheses[k] for k in kept]
    if not views:
        return AllViews(seen)
    chosen = elected(hypotheses)
    views = [view.restricted(mine) for view, mine in zip(views, chosen[1:])]
    told_of = np.any(chosen[1:], axis=0)
    right = chosen[0][seen.matches.left] | ~told_of[seen.matches.left]
    alone = np.flatnonzero(told_of & ~chosen[0])
    # Of several cameras the one that knows the segment best says roughly where it is.
    spread = np.stack(
        [np.where(each.known & mine, _spread(each, left.extent), np.inf) for each, mine in zip(hypotheses, chosen)]
    )[:, alone]
    x = np.stack([each.x[alone] for each in hypotheses])[spread.argmin(axis=0), np.arange(len(alone))]
    votes = np.where(chosen, np.stack([each.log_odds for each in hypotheses]), 0.0)[:, alone].sum(axis=0)
    belief = 1.0 / (1.0 + np.exp(-votes))
    seen = replace(seen, matches=seen.matches.select(right))
    return AllViews(_with_stand_ins(seen, alone, x, belief), tuple(views))


def _spread(hypotheses: Hypotheses, extent: FloatArray) -> FloatArray:
    """(n,) variance of disparity at the worse end, pixels squared."""
    rows = np.stack([np.ones_like(extent), extent], axis=-1)
    return np.asarray(np.einsum('nei,nij,nej->ne', rows, hypotheses.covariance, rows).max(axis=1))


def _with_stand_ins(seen: StereoSegments, alone: IntArray, x: FloatArray, belief: FloatArray) -> StereoSegments:
    """The pair with edges of left segments (k,) that it does not match, of disparities (k, 2) and beliefs (k,)."""
    left, right = seen.segments
    junctions = seen.junctions[1]
    own = left.select(alone)
    disparity = x[:, :1] + x[:, 1:] * np.stack([own.extent[:, 0], own.extent.mean(axis=1), own.extent[:, 1]], axis=1)
    ends = np.stack([own.start, own.end], axis=1)
    ends[..., 0] -= disparity[:, [0, 2]]
    run = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.hypot(run[:, 0], run[:, 1]), 1e-6)
    stand_ins = replace(
        own,
        bounds=np.zeros_like(own.bounds),
        centre=ends.mean(axis=1),
        direction=run / length[:, None],
        extent=length[:, None] * [-0.5, 0.5],
    )
    loose = Junctions(
        stand_ins.extent,
        np.full((len(alone), 2), -1, np.int32),
        np.zeros((len(alone), 2), bool),
        np.zeros((len(alone), 2)),
    )
    added = Matches(
        alone.astype(np.int32),
        (len(right) + np.arange(len(alone))).astype(np.int32),
        disparity,
        np.sort(np.stack([own.start[:, 1], own.end[:, 1]], axis=1), axis=1),
        belief,
    )
    return replace(
        seen,
        matches=Matches.concatenate([seen.matches, added]),
        segments=(left, Segments(*(_joined(right, stand_ins, f.name) for f in fields(Segments)))),
        junctions=(seen.junctions[0], Junctions(*(_joined(junctions, loose, f.name) for f in fields(Junctions)))),
        stand_ins=len(alone),
    )


def _joined(first: object, second: object, name: str) -> AnyArray:
    """One attribute of both."""
    return np.concatenate([getattr(first, name), getattr(second, name)])


def view_extents(views: Sequence[ViewLines], seen: StereoSegments, x: FloatArray, found: Extents) -> Extents:
    """Where edges end: as the pair shows them, and of those it does not match, as a further camera does.

    Parameters
    ----------
    views : sequence of ViewLines
    seen : StereoSegments
        n edges of the pair.
    x : (n, 2)
        Their disparities.
    found : Extents
        Of the pair.
    """
    arrays = {f.name: getattr(found, f.name).copy() for f in fields(Extents)}
    left = seen.matches.left
    open_edges = ~seen.paired
    for view in views:
        e = np.flatnonzero(open_edges & (view.match[left] >= 0))
        if len(e):
            more = view.extents(left[e], x[e])
            for name, values in arrays.items():
                values[e] = getattr(more, name)
            open_edges[e] = False
    return Extents(**arrays)
