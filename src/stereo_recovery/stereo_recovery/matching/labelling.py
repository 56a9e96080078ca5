"""Which segment of the right image shows the same edge as a segment of the left one (thesis 3.10, after PMF).

One labelling: each left segment has a partner, several that are parts of one edge, or none. Every candidate pair has
log odds: how many pairs chance would offer, against what its geometry, the grey levels on either side and, where there
is texture, dense disparity say for it. Neighbours that may lie on one surface support each other when their disparities
agree (Pollard, Mayhew and Frisby's disparity gradient as a density), and candidates that exclude each other compete:
loopy belief propagation, a few rounds. What the pair's cameras make of one surface is learnt between two passes.

References
----------
S. Pollard, J. Mayhew, J. Frisby, "PMF: a stereo correspondence algorithm using a disparity gradient limit", Perception
14, 1985; A. Yuille, D. Geiger, H. Buelthoff, "Stereo integration, mean field theory and psychophysics", ECCV 1990.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from msgs_py.numeric.threads import parts_of, spread, together
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, Int32Array, IntArray

from ..detection.junctions import find_junctions
from ..detection.segments import Segments
from ..stopwatch import Late, never
from . import candidate_kernels, labelling_kernels
from .candidate_kernels import Candidates, Photometry, SegmentTable
from .dense import DenseDisparity
from .labelling_kernels import CandidateLists, Neighbours, Rivals, Support
from .matches import Matches
from .settings import (
    FEW_MATCHES,
    FIRST_ROUNDS,
    FIRST_SCALE,
    HISTOGRAM_SIGMA,
    LEAST_CANDIDATES,
    LEAST_ODDS,
    MOST_CANDIDATES,
    MOST_ODDS,
    OUTLYING,
    PARTNER_ODDS,
    PROFILE_SIGMA,
    RANDOM_SHARE,
    ROOM,
    ROOM_SHARE,
    ROUNDS,
    SEEN_AS_ONE,
    SETTLED,
)


@dataclass(frozen=True)
class Exposure:
    """How the right camera shows what the left one shows as ``grey``: gain * grey + shift, give or take ``scale``."""

    gain: float = 1.0
    shift: float = 0.0
    scale: float = FIRST_SCALE


@dataclass(frozen=True, eq=False)
class Labelling:
    """The candidates that are in the game, and how they stand.

    node, value : (k, 2), (k, 9), see :func:`.candidate_kernels.candidates`; belief : (k,), probability; chosen : (m,)
    candidates that are matches, best first
    """

    node: Int32Array
    value: FloatArray
    belief: FloatArray
    chosen: IntArray


def match(
    greys: tuple[Float32Array, Float32Array],
    segments: tuple[Segments, Segments],
    window: tuple[float, float],
    radius: float,
    least_belief: float,
    late: Late = never,
) -> tuple[Matches, DenseDisparity | None]:
    """Pairs of segments that show one edge.

    Parameters
    ----------
    greys : (h, w) float32 each, grey levels
    segments : (Segments, Segments)
        Of the left and the right image.
    window : (float, float), pixels
        Allowed disparity.
    radius : float, pixels
        Neighbourhood of support.
    least_belief : float
        Probability below which a pair is no match.
    late : callable
        Whether it is too late for the second pass, with dense disparity; then what the first has found is the result.

    Returns
    -------
    Matches
        Best first; a part of a segment is in one pair only.
    DenseDisparity or None
        Of the pair; None when an image has no segments.
    """
    left, right = segments
    if len(left) == 0 or len(right) == 0:
        return Matches.empty(), None
    left_eye, right_eye = spread(lambda eye: _Eye.of(greys[eye], segments[eye]), range(2))
    density = grey_density(right_eye.profiles)
    near, every = together(
        lambda: labelling_kernels.neighbours(left_eye.table, left_eye.met, radius),
        lambda: candidate_kernels.candidates(left_eye.table, right_eye.table, greys[0].shape, *window),
    )

    def odds(exposure: Exposure, of: Candidates) -> FloatArray:
        """(k,) log odds of candidates by themselves, without dense disparity."""
        seen = (exposure.gain * left_eye.profiles + exposure.shift).astype(np.float32)
        photometry = Photometry(seen, right_eye.smooth, density, exposure.scale)
        chance = np.log(PARTNER_ODDS / np.maximum(of.chances[of.node[:, 0]], 1.0))
        return np.asarray(of.value[:, 5] + candidate_kernels.photometric(photometry, left_eye.table, of) + chance)

    own = odds(Exposure(), every)
    kept = _in_the_game(every.node, own, len(left), len(right))
    game = Candidates(every.node[kept], every.value[kept], every.samples[kept], every.reverse[kept], every.chances)
    if not kept.any():
        return Matches.empty(), None
    node, value, own = game.node, game.value, own[kept]
    lists = _lists(node, len(left), len(right))
    anywhere = min(window[1] - window[0], RANDOM_SHARE * greys[0].shape[1])
    support, against = together(
        lambda: labelling_kernels.supporters(node, value, lists.first, near, right_eye.met, anywhere),
        lambda: labelling_kernels.rival_lists(node, value, lists),
    )

    def labelled(own: FloatArray, rounds: int) -> Labelling:
        segment = np.ascontiguousarray(node[:, 0])
        score, belief = propagate(segment, own, near, support, against, radius, rounds)
        return _labelling(node, value, score, belief, least_belief)

    first = labelled(own, FIRST_ROUNDS)
    if late():
        return _matches(first), None
    exposure = learnt_exposure([left_eye.profiles, right_eye.profiles], node[first.chosen])
    dense = None
    if (np.minimum(first.belief, 1.0 - first.belief) > SETTLED).any():
        disparities = _range(value[first.chosen], window)
        own, dense = together(lambda: odds(exposure, game), lambda: DenseDisparity(*greys, *disparities))
        own += dense.log_ratio(node, value, left)
    else:
        own = odds(exposure, game)
    return _matches(labelled(own, ROUNDS)), dense


def propagate(
    segment: Int32Array,
    own: FloatArray,
    near: Neighbours,
    support: Support,
    against: Rivals,
    radius: float,
    rounds: int,
) -> tuple[FloatArray, FloatArray]:
    """Log odds (k,) and belief (k,) of every candidate, by messages between neighbours.

    Parameters
    ----------
    segment : (k,) int32
        The left segment of each.
    own : (k,) float64
        Log odds by itself.
    near, support, against
        As from :func:`.labelling_kernels.neighbours`, ``supporters`` and ``rival_lists``.
    radius : float, pixels
        Of support.
    rounds : int
    """
    parts = parts_of(len(own), LEAST_CANDIDATES)
    same = SEEN_AS_ONE * np.exp(-near.gap / radius)
    score, likelihood, belief, told = own.copy(), np.empty_like(own), np.empty_like(own), np.empty_like(own)
    matched = np.empty(len(near.other))

    def weigh(part: tuple[int, int]) -> None:
        labelling_kernels.beliefs(part, likelihood, against, belief)

    def ask(part: tuple[int, int]) -> None:
        labelling_kernels.told_by_neighbours(part, segment, near, same, support, belief, matched, told)

    for turn in range(rounds + 1):
        np.exp(np.minimum(score, MOST_ODDS), out=likelihood)
        spread(weigh, parts)
        if turn < rounds:
            matched[:] = np.bincount(segment, belief, len(matched))
            spread(ask, parts)
            np.add(own, told, out=score)
    return score, belief


def _matches(found: Labelling) -> Matches:
    """The candidates that are chosen."""
    node, value = found.node[found.chosen], found.value[found.chosen]
    return Matches(node[:, 0], node[:, 1], value[:, :3], value[:, 3:5], found.belief[found.chosen])


class _Eye(NamedTuple):
    """What one image shows of its segments: the image smoothed, (h, w) float32, and what kernels take of them."""

    smooth: Float32Array
    table: SegmentTable
    profiles: Float32Array
    met: Int32Array

    @classmethod
    def of(cls, grey: Float32Array, segments: Segments) -> _Eye:
        table = _table(segments)
        smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), PROFILE_SIGMA), np.float32)
        return cls(smooth, table, candidate_kernels.profiles(smooth, table), _met(segments))


def _table(segments: Segments) -> SegmentTable:
    """Segments as the loops take them."""
    return SegmentTable(*(np.ascontiguousarray(a) for a in (segments.start, segments.end, segments.direction)))


def _met(segments: Segments) -> Int32Array:
    """(n, 2) the segment that each end meets in a corner, or -1."""
    junctions = find_junctions(segments)
    return np.where(junctions.t_junction, -1, junctions.neighbour).astype(np.int32)


def grey_density(profile: Float32Array) -> FloatArray:
    """(256,) float64: density of the grey levels beside segments, by which a look-alike is known from a rarity.

    Parameters
    ----------
    profile : (n, ...) float32, grey levels

    Examples
    --------
    >>> density = grey_density(np.full((4, 8), 100.0, np.float32))
    >>> int(density.argmax()), round(float(density.sum()), 6)
    (100, 1.0)
    """
    # One grey level in all at random keeps every level possible.
    counts = np.bincount(np.clip(profile, 0, 255).astype(np.intp).ravel(), minlength=256) + 1.0 / 256.0
    smooth = cv2.GaussianBlur(counts.reshape(1, -1), (0, 0), HISTOGRAM_SIGMA, borderType=cv2.BORDER_REFLECT)
    return np.asarray(smooth.ravel() / smooth.sum())


def learnt_exposure(profiles: list[Float32Array], node: Int32Array) -> Exposure:
    """What the two cameras make of the surfaces beside matched edges, by a robust fit.

    Parameters
    ----------
    profiles : (n, samples, 2, offsets), (m, samples, 2, offsets) float32
        Grey levels beside the segments of the two images.
    node : (k, 2) int
        Matched segments.
    """
    if len(node) < FEW_MATCHES:
        return Exposure()
    return Exposure(*candidate_kernels.learnt_exposure(profiles[0], profiles[1], node))


def _range(value: FloatArray, window: tuple[float, float]) -> tuple[float, float]:
    """Disparities that the first matches show, with room on either side, pixels."""
    if len(value) < FEW_MATCHES:
        return window
    low, high = np.quantile(value[:, [0, 2]], [OUTLYING, 1.0 - OUTLYING])
    room = ROOM + ROOM_SHARE * (high - low)
    return max(window[0], float(low - room)), min(window[1], float(high + room))


def _lists(node: Int32Array, n: int, m: int) -> CandidateLists:
    """Candidates by left and by right segment, of which there are n and m."""
    right_of = np.argsort(node[:, 1], kind='stable')
    first = np.searchsorted(node[:, 0], np.arange(n + 1))
    return CandidateLists(first, right_of, np.searchsorted(node[right_of, 1], np.arange(m + 1)))


def _in_the_game(node: Int32Array, own: FloatArray, n: int, m: int) -> BoolArray:
    """(k,) bool: candidates that are not hopeless by themselves, the strongest of each segment."""
    kept = own > LEAST_ODDS
    some = np.flatnonzero(kept)
    kept[some] = labelling_kernels.strongest(own[some], _lists(node[some], n, m), MOST_CANDIDATES)
    return np.asarray(kept)


def _labelling(
    node: Int32Array, value: FloatArray, score: FloatArray, belief: FloatArray, least_belief: float
) -> Labelling:
    """The choice that follows from scores and beliefs."""
    # Several disparities of one pair of segments are one answer to the question which segments belong together.
    pair = np.concatenate([[0], np.cumsum((np.diff(node, axis=0) != 0).any(axis=1))])
    order = np.flatnonzero(np.bincount(pair, belief)[pair] >= least_belief)
    order = order[np.argsort(-score[order], kind='stable')]
    return Labelling(node, value, belief, labelling_kernels.unique(node, value, order))
