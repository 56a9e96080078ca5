"""Compiled choice of what the estimate starts with: for each open edge the statements of its likeliest depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.settings import SMALLEST
from .settings import MOST_SLOPE


class Statements(NamedTuple):
    """All factors by the edges that they are about, those of two edges twice.

    Attributes
    ----------
    first : (n + 1,) int64
        Where each edge's statements begin in ``factor`` and ``mirrored``, (m,).
    edge, other, row, other_row, value, sigma, prior, spread, with_next : (k, ...)
        The factors, see :class:`.factors.Factors`.
    """

    first: IntArray
    factor: IntArray
    mirrored: BoolArray
    edge: IntArray
    other: IntArray
    row: FloatArray
    other_row: FloatArray
    value: FloatArray
    sigma: FloatArray
    prior: FloatArray
    spread: FloatArray
    with_next: BoolArray


class Told(NamedTuple):
    """Statements of one edge by what known edges say: row x = value, up to the variance.

    Attributes
    ----------
    factor : (q,) int64
    row, value, variance : (q, 2), (q,), (q,) float64
    with_next : (q,) bool
    held, missed : (q,) float64
        Logarithms of the greatest density if a statement holds, with those that hold together with it, and of the
        density if it does not, each times its probability; by the first of them.
    pair : (m,) int64
        The first of two statements that hold together: they give both unknowns.
    foretold, miss, peak : (m, q) float64
        What such a pair foretells the value of every statement to be, the variance of what it misses it by, and the
        logarithm of its greatest density.
    log_spread : (q,) float64
    """

    factor: IntArray
    row: FloatArray
    value: FloatArray
    variance: FloatArray
    with_next: BoolArray
    held: FloatArray
    missed: FloatArray
    pair: IntArray
    foretold: FloatArray
    miss: FloatArray
    peak: FloatArray
    log_spread: FloatArray


@njit
def _told(s: Statements, e: int, known: BoolArray, x: FloatArray, covariance: FloatArray) -> Told:
    """What known edges say of edge e."""
    most = s.first[e + 1] - s.first[e]
    which, row, value, variance = np.empty(most, np.int64), np.empty((most, 2)), np.empty(most), np.empty(most)
    count = 0
    for place in range(s.first[e], s.first[e + 1]):
        k, mirrored = s.factor[place], s.mirrored[place]
        f = s.edge[k] if mirrored else s.other[k]
        if f >= 0 and not known[f]:
            continue
        which[count], value[count], variance[count] = k, s.value[k], s.sigma[k] ** 2
        row[count] = -s.other_row[k] if mirrored else s.row[k]
        if f >= 0:
            g, c = s.row[k] if mirrored else -s.other_row[k], covariance[f]
            value[count] -= g[0] * x[f, 0] + g[1] * x[f, 1]
            variance[count] += g[0] * (c[0, 0] * g[0] + c[0, 1] * g[1]) + g[1] * (c[1, 0] * g[0] + c[1, 1] * g[1])
        count += 1
    which, row, value, variance = which[:count], row[:count], value[:count], variance[:count]
    with_next, log_spread, prior = s.with_next[which], np.log(s.spread[which]), s.prior[which]
    held, missed = np.log(np.maximum(prior, SMALLEST)), np.log(np.maximum(1.0 - prior, SMALLEST))
    held -= 0.5 * np.log(2.0 * np.pi * variance)
    missed -= log_spread
    pair = np.flatnonzero(with_next)
    foretold, miss = np.empty((len(pair), count)), np.empty((len(pair), count))
    for m, q in enumerate(pair):
        held[q] -= 0.5 * np.log(2.0 * np.pi * variance[q + 1])
        missed[q] -= log_spread[q + 1]
        one, two = row[q], row[q + 1]
        det = one[0] * two[1] - one[1] * two[0]
        for k in range(count):
            a, b = (row[k, 0] * two[1] - row[k, 1] * two[0]) / det, (row[k, 1] * one[0] - row[k, 0] * one[1]) / det
            foretold[m, k] = a * value[q] + b * value[q + 1]
            miss[m, k] = a * a * variance[q] + b * b * variance[q + 1] + variance[k]
    return Told(
        which,
        row,
        value,
        variance,
        with_next,
        held,
        missed,
        pair,
        foretold,
        miss,
        -0.5 * np.log(2.0 * np.pi * miss),
        log_spread,
    )


@njit
def _fill_gains(x: FloatArray, told: Told, gain: FloatArray) -> None:
    """Log odds (q,) that statements hold at unknowns x (2,); NaN for those that hold together with the one before."""
    q = 0
    while q < len(gain):
        off = told.row[q, 0] * x[0] + told.row[q, 1] * x[1] - told.value[q]
        square = off * off / told.variance[q]
        if told.with_next[q]:
            off = told.row[q + 1, 0] * x[0] + told.row[q + 1, 1] * x[1] - told.value[q + 1]
            square += off * off / told.variance[q + 1]
            gain[q + 1] = np.nan
        gain[q] = told.held[q] - 0.5 * square - told.missed[q]
        q += 2 if told.with_next[q] else 1


@njit
def _add_causes(x: FloatArray, told: Told, gain: FloatArray, missed: FloatArray) -> None:
    """Add to ``missed`` (q,) how much likelier than by chance what does not hold is by a cause that others have.

    A strip of texture that the edge does not belong to is a surface behind it. Edges of that surface end at this one,
    and say what the strip says; and where a corner shows that the surface meets the edge, the strip says so as well.
    """
    for m, p in enumerate(told.pair):
        if gain[p] > 0.0:
            continue
        for q in range(len(gain)):
            if told.with_next[q] or np.isnan(gain[q]) or (gain[q] > 0.0 and abs(told.row[q, 0]) < 0.5):
                continue
            holds = gain[q] > 0.0
            value = told.row[q, 0] * x[0] + told.row[q, 1] * x[1] if holds else told.value[q]
            square = (told.foretold[m, q] - value) ** 2 / told.miss[m, q]
            k = p if holds else q
            missed[k] = max(missed[k], told.missed[k] + told.log_spread[k] + told.peak[m, q] - 0.5 * square)


@njit
def _log_evidence(
    x: FloatArray, told: Told, own: FloatArray, information: FloatArray, scratch: tuple[FloatArray, FloatArray]
) -> float:
    """Of a mode at unknowns x (2,), by what is told, and by the edge's own lines: its height and its width.

    What is told vaguely is nowhere as likely as where something sharp holds by accident; as a whole it may be likelier.
    """
    gain, missed = scratch
    a, b = x[0] - own[0], x[1] - own[1]
    i00, i01, i11 = information[0, 0], information[0, 1], information[1, 1]
    total = -0.5 * (a * (i00 * a + i01 * b) + b * (i01 * a + i11 * b))
    _fill_gains(x, told, gain)
    missed[:] = told.missed
    _add_causes(x, told, gain, missed)
    holds = False
    for q in range(len(gain)):
        if not np.isnan(gain[q]):
            holds = gain[q] > 0.0
            total += missed[q]
            more = gain[q] + told.missed[q] - missed[q]
            # Beyond these the sum of both is the larger one.
            total += more if more > 30.0 else np.log1p(np.exp(more)) if more > -30.0 else 0.0
        if holds:
            i00 += told.row[q, 0] ** 2 / told.variance[q]
            i01 += told.row[q, 0] * told.row[q, 1] / told.variance[q]
            i11 += told.row[q, 1] ** 2 / told.variance[q]
    return float(total - 0.5 * np.log(i00 * i11 - i01 * i01))


@njit
def _likeliest_mode(told: Told, own: FloatArray, covariance: FloatArray, information: FloatArray) -> FloatArray:
    """(2,) unknowns: of the edge's own lines, alone and with one statement, and of two statements."""
    scratch = np.empty(len(told.value)), np.empty(len(told.value))
    best, most = own.copy(), _log_evidence(own, told, own, information, scratch)
    trial, row, value = np.empty(2), told.row, told.value
    for p in range(len(value)):
        gain = covariance @ row[p]
        trial[:] = own + gain * ((value[p] - row[p] @ own) / (gain @ row[p] + told.variance[p]))
        if abs(trial[1]) < MOST_SLOPE:
            score = _log_evidence(trial, told, own, information, scratch)
            if score > most:
                best[:], most = trial, score
        for q in range(p):
            det = row[p, 0] * row[q, 1] - row[p, 1] * row[q, 0]
            # Two that are told at nearly one place say nothing of the slope.
            if abs(det) <= 4.0 * abs(row[p, 0] * row[q, 0]):
                continue
            trial[0] = (value[p] * row[q, 1] - value[q] * row[p, 1]) / det
            trial[1] = (value[q] * row[p, 0] - value[p] * row[q, 0]) / det
            if abs(trial[1]) >= MOST_SLOPE:
                continue
            score = _log_evidence(trial, told, own, information, scratch)
            if score > most:
                best[:], most = trial, score
    return best


@njit
def likeliest(
    s: Statements,
    edges: IntArray,
    known: BoolArray,
    solution: tuple[FloatArray, FloatArray],
    own: tuple[FloatArray, FloatArray, FloatArray],
    used: BoolArray,
) -> bool:
    """Mark in ``used`` (k,) which statements of open edges hold at their likeliest depths; whether any changed.

    edges : numbers of the open ones; known : (n,) edges that may tell; solution : x (n, 2) and covariance (n, 2, 2) so
    far; own : of every edge's own lines the information, and x and covariance by it.
    """
    x, covariance = solution
    information, own_x, own_covariance = own
    changed = False
    for e in edges:
        told = _told(s, e, known, x, covariance)
        gain = np.empty(len(told.value))
        _fill_gains(_likeliest_mode(told, own_x[e], own_covariance[e], information[e]), told, gain)
        holds = False
        for q in range(len(gain)):
            holds = holds if np.isnan(gain[q]) else gain[q] > 0.0
            changed |= used[told.factor[q]] != holds
            used[told.factor[q]] = holds
    return changed
