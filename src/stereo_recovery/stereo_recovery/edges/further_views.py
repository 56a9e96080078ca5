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
from msgs_py.numeric.typed import FloatArray, IntArray

from ..estimation.estimate import OwnLines
from ..estimation.own_lines import LinePairs, line_pairs
from ..matching.further_views import FurtherView
from ..matching.matches import match_of
from ..matching.stereo_segments import StereoSegments
from .extents import Extents, extents
from .settings import LEAST_LEFT_SHARE
from .view_votes import Hypotheses, by_left


@dataclass(frozen=True, eq=False)
class ViewLines:
    """What a further camera says of the main pair's edges.

    Attributes
    ----------
    view : FurtherView
        With m matches.
    match : (n,) int64
        The match of each of the main pair's left segments, or -1.
    stand_in : (k,) int64
        The match of each edge that stands in for one of the right image, or -1.
    pairs : LinePairs
        What the matches' lines say of their own unknowns, x'.
    turn, shift : (m, 2, 2), (m, 2)
        x' = turn x + shift, with the main pair's unknowns x.
    left_turn : (m, 2, 2)
        What the error of the main pair's left line, offset and slope, is in the view's own pair.
    """

    view: FurtherView
    match: IntArray
    stand_in: IntArray
    pairs: LinePairs
    turn: FloatArray
    shift: FloatArray
    left_turn: FloatArray

    def estimates(self) -> tuple[FloatArray, FloatArray]:
        """(m, 2), (m, 2, 2): what each match alone, and roughly its place, says of the main pair's unknowns."""
        matches, left = self.view.seen.matches, self.view.seen.segments[0]
        own = self.pairs.own_lines(left.extent[matches.left]).about(matches.disparity[:, 1])
        back = np.linalg.inv(self.turn)
        x = np.einsum('nij,nj->ni', back, own.x - self.shift)
        return x, np.einsum('nij,njk,nlk->nil', back, own.covariance, back)

    def hypotheses(self) -> Hypotheses:
        """The same by left segments."""
        return by_left(self.match, *self.estimates(), self.view.seen.matches.belief)

    def match_of(self, seen: StereoSegments) -> IntArray:
        """(n,) the match of each edge of the main pair, or -1."""
        result = self.match[seen.matches.left]
        stand_in = seen.matches.right - (len(seen.segments[1]) - seen.stand_ins)
        result[~seen.paired] = self.stand_in[stand_in[~seen.paired]]
        return np.asarray(result)

    def extents(self, own: IntArray, x: FloatArray) -> Extents:
        """Where edges of disparities (k, 2) end by this view's matches (k,)."""
        seen = self.view.seen
        its = np.einsum('nij,nj->ni', self.turn[own], x) + self.shift[own]
        found = extents(replace(seen, matches=seen.matches.select(own)), its)
        along = self.view.turned.along[seen.matches.left[own]]
        w, p, q = along[:, :, 0], along[:, :1, 1], along[:, 1:, 1]
        below = q - found.abscissa * w[:, 1:]
        sigma = found.sigma * np.abs(w[:, :1] * q - p * w[:, 1:]) / below**2
        return replace(found, abscissa=(found.abscissa * w[:, :1] - p) / below, sigma=sigma)


def view_lines(view: FurtherView, main: StereoRig, count: int) -> ViewLines:
    """A further view's lines as information of the main pair's ``count`` left segments."""
    seen = view.seen
    pairs = line_pairs(seen.matches, seen.segments, view.row_sigma, view.column_sigma)
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
    none = np.zeros(0, np.int64)
    return ViewLines(view, match, none, pairs, np.asarray(ratio * inverse), shift, scale[:, None, None] * inverse)


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
    of_views = [view.match_of(seen) for view in views]
    e = np.flatnonzero(np.any([match >= 0 for match in of_views], axis=0)) if views else np.zeros(0, np.int64)
    # A stand-in of the right image says nothing.
    mask = seen.paired[:, None, None]
    information, right, with_line = (
        np.where(mask, each, 0.0) for each in (own.information, own.vector[..., None], np.asarray(own.with_line))
    )
    if len(e) == 0:
        return OwnLines(information, right[..., 0], own.extent, with_line)
    normal, vector = np.zeros((len(e), 4, 4)), np.zeros((len(e), 4))
    prior = np.zeros((len(e), 2, 2))
    eye = np.eye(2)
    shown = np.flatnonzero(seen.paired[e])
    at = e[shown]
    prior[shown] = pairs.left_variance[at, :, None] * eye
    _add((normal, vector), shown, (pairs, at), pairs.rise[at, None, None] * eye, pairs.value[at], eye)
    for view, match in zip(views, of_views):
        k = np.flatnonzero(match[e] >= 0)
        m = match[e[k]]
        back = np.linalg.inv(view.left_turn[m])
        fresh = ~prior[k].any(axis=(1, 2))
        prior[k[fresh]] = np.einsum('nij,nj,nkj->nik', back, view.pairs.left_variance[m], back)[fresh]
        rise = view.pairs.rise[m, None]
        rows, value = rise[..., None] * view.turn[m], view.pairs.value[m] - rise * view.shift[m]
        _add((normal, vector), k, (view.pairs, m), rows, value, view.left_turn[m])
    normal[:, 2:, 2:] += np.linalg.inv(prior)
    gain = np.einsum('nij,njk->nik', normal[:, :2, 2:], np.linalg.inv(normal[:, 2:, 2:]))
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
    open_edges = ~seen.paired
    for view in views:
        own = view.match_of(seen)
        e = np.flatnonzero(open_edges & (own >= 0))
        if len(e):
            more = view.extents(own[e], x[e])
            for name, values in arrays.items():
                values[e] = getattr(more, name)
            open_edges[e] = False
    return Extents(**arrays)
