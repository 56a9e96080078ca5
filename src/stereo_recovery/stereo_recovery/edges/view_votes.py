"""Which cameras agree on an edge: votes on matches, and cameras that do not see the scene at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.robust import OUTLYING
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..estimation.settings import OPEN_SIGMA
from .settings import BELIEF_MOST, BLIND_AGREEMENT, BLIND_PRIOR, CONFIRMED_RIGHT, CONFIRMED_WRONG, SIGHTED_AGREEMENT


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


def by_left(match: IntArray, x: FloatArray, covariance: FloatArray, belief: FloatArray) -> Hypotheses:
    """What matches say, by left segment.

    Parameters
    ----------
    match : (n,) int
        The match of each left segment, or -1.
    x, covariance, belief : (m, 2), (m, 2, 2), (m,)
        Of the matches.
    """
    known = match >= 0
    row = np.where(known, match, 0)
    if len(x) == 0:
        n = len(match)
        return Hypotheses(known, np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1)), np.zeros(n))
    certain = np.clip(belief, 1.0 - BELIEF_MOST, BELIEF_MOST)
    odds = np.where(known, np.log(certain / (1.0 - certain))[row], 0.0)
    return Hypotheses(known, x[row], covariance[row], odds)


def agreement(hypotheses: Sequence[Hypotheses]) -> BoolArray:
    """(v, v, n) bool: whether two cameras know a segment and what they say of it may be one edge."""
    count = len(hypotheses)
    result = np.zeros((count, count, len(hypotheses[0].known)), bool)
    for a in range(count):
        for b in range(count):
            one, other = hypotheses[a], hypotheses[b]
            off = one.x - other.x
            square = np.einsum('ni,nij,nj->n', off, np.linalg.inv(one.covariance + other.covariance), off)
            result[a, b] = one.known & other.known & (square < OUTLYING[2])
    return result


def sharp(hypotheses: Hypotheses, extent: FloatArray) -> BoolArray:
    """(n,) bool: segments of extents (n, 2) whose depth a camera's match alone tells."""
    rows = np.stack([np.ones_like(extent), extent], axis=-1)
    variance = np.einsum('nei,nij,nej->ne', rows, hypotheses.covariance, rows).max(axis=1)
    return np.asarray(hypotheses.known & (variance < OPEN_SIGMA**2))


def sighted(hypotheses: Sequence[Hypotheses], extent: FloatArray, confirmed: FloatArray) -> BoolArray:
    """(v,) bool: cameras that see the scene that the first one, the main pair, sees; a covered one does not.

    Each common segment whose depth both know is a witness: a camera that sees agrees on most, or says better where the
    pair is wrong, which the pair's own picture confirms and not the reverse; one that is blind does so by accident.

    Parameters
    ----------
    hypotheses : sequence of Hypotheses
        Of the main pair, and of each further camera.
    extent : (n, 2) float64, pixels
        Of the left segments.
    confirmed : (v, v, n) float64
        As :func:`.transfer.confirmations` says.
    """
    agree = agreement(hypotheses)
    result = np.ones(len(hypotheses), bool)
    for v in range(1, len(hypotheses)):
        both = sharp(hypotheses[0], extent) & sharp(hypotheses[v], extent)
        one_scene = agree[0, v] | (confirmed[v, 0] > confirmed[0, v])
        yes, no = int((both & one_scene).sum()), int((both & ~one_scene).sum())
        odds = np.log((1.0 - BLIND_PRIOR) / BLIND_PRIOR)
        odds += yes * np.log(SIGHTED_AGREEMENT / BLIND_AGREEMENT)
        odds += no * np.log((1.0 - SIGHTED_AGREEMENT) / (1.0 - BLIND_AGREEMENT))
        result[v] = odds > 0.0
    return result


def elected(hypotheses: Sequence[Hypotheses], confirmed: FloatArray) -> BoolArray:
    """(v, n) bool: the cameras whose matches of a segment count: of those that agree, the likeliest together.

    Parameters
    ----------
    hypotheses : sequence of Hypotheses
    confirmed : (v, v, n) float64
        As :func:`.transfer.confirmations` says.
    """
    agree = agreement(hypotheses)
    told = np.where(
        confirmed > 0.0,
        np.log(CONFIRMED_RIGHT / CONFIRMED_WRONG),
        np.where(confirmed < 0.0, np.log((1.0 - CONFIRMED_RIGHT) / (1.0 - CONFIRMED_WRONG)), 0.0),
    )
    odds = np.stack([each.log_odds for each in hypotheses]) + told.sum(axis=1)
    votes = np.einsum('abn,bn->an', agree, odds)
    known = np.stack([each.known for each in hypotheses])
    best = np.where(known, votes, -np.inf).argmax(axis=0)
    return np.asarray(agree[best, :, np.arange(len(best))].T & known)
