"""The edges of a pair as all cameras show them: votes on its matches, and edges that only a further camera matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments
from ..estimation.own_lines import line_pairs
from ..matching.further_views import FurtherView
from ..matching.matches import Matches, match_of
from ..matching.stereo_segments import StereoSegments
from .column_error import with_columns
from .further_views import ViewLines, view_lines
from .settings import LOST_SIGMA
from .transfer import confirmations
from .view_votes import Hypotheses, by_left, elected, sighted


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
    of_pair = _main_hypotheses(seen, row_sigma)
    views = [view_lines(view, rig, len(left)) for view in further]
    aligned = [with_columns(view, of_pair, left, rig) for view in views]
    calibrated = [view for view in aligned if max(view.row_sigma, view.column_sigma) < LOST_SIGMA]
    views = [view_lines(view, rig, len(left)) for view in calibrated]
    hypotheses = [of_pair, *(view.hypotheses() for view in views)]
    confirmed = confirmations(seen, rig, views, hypotheses)
    kept = np.flatnonzero(sighted(hypotheses, left.extent, confirmed))
    views, hypotheses = [views[k - 1] for k in kept[1:]], [hypotheses[k] for k in kept]
    if not views:
        return AllViews(seen)
    chosen = elected(hypotheses, confirmed[np.ix_(kept, kept)])
    views = [replace(view, match=np.where(mine, view.match, -1)) for view, mine in zip(views, chosen[1:])]
    told_of = np.any(chosen[1:], axis=0)
    right = chosen[0][seen.matches.left] | ~told_of[seen.matches.left]
    votes = np.where(chosen, np.stack([each.log_odds for each in hypotheses]), 0.0).sum(axis=0)
    seen = replace(seen, matches=seen.matches.select(right))
    return _with_stand_ins(seen, views, told_of & ~chosen[0], 1.0 / (1.0 + np.exp(-votes)))


def _main_hypotheses(seen: StereoSegments, row_sigma: float) -> Hypotheses:
    """What the main pair's matches say, each alone, of its left segments."""
    matches, left = seen.matches, seen.segments[0]
    own = line_pairs(matches, seen.segments, row_sigma).own_lines(left.extent[matches.left])
    own = own.about(matches.disparity[:, 1])
    return by_left(match_of(matches.left, len(left)), own.x, own.covariance, matches.belief)


def _with_stand_ins(
    seen: StereoSegments, views: Sequence[ViewLines], open_segments: BoolArray, belief: FloatArray
) -> AllViews:
    """The pair with edges of left segments (n,) bool that it does not match, of beliefs (n,).

    The camera that knows a segment best says where it is. It may show it in parts, each of which is an edge.
    """
    left = seen.segments[0]
    spread = np.stack([_spread(view, left.extent) for view in views])
    best = np.where(open_segments, spread.argmin(axis=0), -1)
    owner, match, x = [], [], []
    for v, view in enumerate(views):
        segment = view.view.left[view.view.seen.matches.left]
        m = np.flatnonzero(best[segment] == v)
        owner.append(segment[m])
        match.append(np.stack([m if v == other else np.full(len(m), -1) for other in range(len(views))]))
        x.append(view.estimates()[0][m])
        first = match_of(segment[m], len(left))
        some = np.flatnonzero(first >= 0)
        for other in (k for k in range(len(views)) if k != v):
            match[-1][other, first[some]] = views[other].match[some]
    all_matches = np.concatenate(match, axis=1)
    views = tuple(replace(view, stand_in=mine) for view, mine in zip(views, all_matches))
    where = np.concatenate(owner)
    return AllViews(with_stand_ins(seen, where, np.concatenate(x), belief[where]), views)


def _spread(view: ViewLines, extent: FloatArray) -> FloatArray:
    """(n,) variance of disparity at the worse end, pixels squared; infinite where a view knows nothing."""
    known = view.hypotheses()
    rows = np.stack([np.ones_like(extent), extent], axis=-1)
    variance = np.einsum('nei,nij,nej->ne', rows, known.covariance, rows).max(axis=1)
    return np.where(known.known, variance, np.inf)


def with_stand_ins(seen: StereoSegments, alone: IntArray, x: FloatArray, belief: FloatArray) -> StereoSegments:
    """The pair with edges of left segments (k,), of disparities (k, 2) and beliefs (k,), as stand-ins."""
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
