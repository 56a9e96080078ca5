"""Compiled choice of what the estimate starts with: for each open edge the statements of its likeliest depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.settings import SMALLEST
from .settings import MOST_SLOPE, SAME_PLACE


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


class Causes(NamedTuple):
    """What statements of one edge foretell others to say if they have one cause.

    Attributes
    ----------
    source, target : (c,) int64
    value, variance : (c,) float64
        What the target's value is then, and the variance of what it misses that by.
    peak : (c,) float64
        Logarithm of the greatest density of it.
    """

    source: IntArray
    target: IntArray
    value: FloatArray
    variance: FloatArray
    peak: FloatArray


class Told(NamedTuple):
    """Statements of one edge by what known edges say: row x = value, up to the variance.

    Attributes
    ----------
    factor : (q,) int64
    row, value, variance : (q, 2), (q,), (q,) float64
    with_next : (q,) bool
    first : (q,) bool
        False for those that hold together with the one before.
    held, missed : (q,) float64
        Logarithms of the greatest density if a statement holds, with those that hold together with it, and of the
        density if it does not, each times its probability; by the first of them.
    log_spread : (q,) float64
    causes : Causes
    """

    factor: IntArray
    row: FloatArray
    value: FloatArray
    variance: FloatArray
    with_next: BoolArray
    first: BoolArray
    held: FloatArray
    missed: FloatArray
    log_spread: FloatArray
    causes: Causes


@njit
def _causes(row: FloatArray, value: FloatArray, variance: FloatArray, with_next: BoolArray, first: BoolArray) -> Causes:
    """Two statements that hold together give both unknowns and foretell others; one foretells those of its place."""
    n = len(value)
    pair, count = np.empty((2, n * n), np.int64), 0
    told, spread = np.empty(n * n), np.empty(n * n)
    single = np.flatnonzero(first & ~with_next)
    for s in np.flatnonzero(first):
        one, two = row[s], row[(s + 1) % n]
        det = one[0] * two[1] - one[1] * two[0]
        for t in single:
            if s == t:
                continue
            if with_next[s]:
                a, b = (row[t, 0] * two[1] - row[t, 1] * two[0]) / det, (row[t, 1] * one[0] - row[t, 0] * one[1]) / det
                told[count] = a * value[s] + b * value[s + 1]
                spread[count] = a * a * variance[s] + b * b * variance[s + 1] + variance[t]
            else:
                away = abs(row[t, 1] * one[0] - one[1] * row[t, 0])
                if s > t or abs(one[0]) < 0.5 or away > SAME_PLACE * abs(one[0] * row[t, 0]):
                    continue
                a = row[t, 0] / one[0]
                told[count], spread[count] = a * value[s], a * a * variance[s] + variance[t]
            pair[0, count], pair[1, count] = s, t
            count += 1
    peak = -0.5 * np.log(2.0 * np.pi * spread[:count])
    return Causes(pair[0, :count], pair[1, :count], told[:count], spread[:count], peak)


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
    for q in np.flatnonzero(with_next):
        held[q] -= 0.5 * np.log(2.0 * np.pi * variance[q + 1])
        missed[q] -= log_spread[q + 1]
    first = np.ones(count, np.bool_)
    first[1:] = ~with_next[:-1]
    causes = _causes(row, value, variance, with_next, first)
    return Told(which, row, value, variance, with_next, first, held, missed, log_spread, causes)


@njit
def _fill_gains(x: FloatArray, told: Told, gain: FloatArray) -> None:
    """Log odds (q,) that statements hold at unknowns x (2,)."""
    for q in range(len(gain)):
        off = told.row[q, 0] * x[0] + told.row[q, 1] * x[1] - told.value[q]
        loss = 0.5 * off * off / told.variance[q]
        if told.first[q]:
            gain[q] = told.held[q] - told.missed[q] - loss
        else:
            gain[q - 1] -= loss
            gain[q] = gain[q - 1]


@njit
def _add_causes(x: FloatArray, told: Told, gain: FloatArray, missed: FloatArray) -> None:
    """Add to ``missed`` (q,) how much likelier than by chance what does not hold is by a cause that others have.

    A strip of texture that the edge does not belong to is a surface behind it. Edges of that surface end at this one,
    and say what the strip says; and where a corner shows that the surface meets the edge, the strip says so as well.
    Edges that end at one point of this one by accident are those of one corner in front of it or behind it.
    """
    c = told.causes
    for k in range(len(c.source)):
        s, t = c.source[k], c.target[k]
        if gain[s] > 0.0:
            continue
        holds = gain[t] > 0.0
        if holds and not (told.with_next[s] and abs(told.row[t, 0]) > 0.5):
            continue
        value = told.row[t, 0] * x[0] + told.row[t, 1] * x[1] if holds else told.value[t]
        q = s if holds else t
        density = c.peak[k] - 0.5 * (c.value[k] - value) ** 2 / c.variance[k]
        missed[q] = max(missed[q], told.missed[q] + told.log_spread[q] + density)


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
    for q in range(len(gain)):
        if told.first[q]:
            more = gain[q] + told.missed[q] - missed[q]
            # Beyond these the sum of both is the larger one.
            total += missed[q] + (more if more > 30.0 else np.log1p(np.exp(more)) if more > -30.0 else 0.0)
        if gain[q] > 0.0:
            i00 += told.row[q, 0] ** 2 / told.variance[q]
            i01 += told.row[q, 0] * told.row[q, 1] / told.variance[q]
            i11 += told.row[q, 1] ** 2 / told.variance[q]
    return float(total - 0.5 * np.log(i00 * i11 - i01 * i01))


@njit
def _likeliest_mode(
    told: Told, own: FloatArray, covariance: FloatArray, information: FloatArray
) -> tuple[FloatArray, float]:
    """Unknowns (2,), of the edge's own lines, alone and with one statement, or of two; and their evidence."""
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
    return best, most


@njit(nogil=True)
def likeliest(
    s: Statements,
    edges: IntArray,
    known: BoolArray,
    solution: tuple[FloatArray, FloatArray],
    own: tuple[FloatArray, FloatArray, FloatArray],
    used: BoolArray,
) -> bool:
    """Mark in ``used`` (k,) which statements hold of edges that are likelier elsewhere; whether any changed.

    edges : numbers of the open ones; known : (n,) edges that may tell; solution : x (n, 2) and covariance (n, 2, 2) so
    far; own : of every edge's own lines the information, and x and covariance by it.
    """
    x, covariance = solution
    information, own_x, own_covariance = own
    changed = False
    for e in edges:
        told = _told(s, e, known, x, covariance)
        gain, missed = np.empty(len(told.value)), np.empty(len(told.value))
        best, most = _likeliest_mode(told, own_x[e], own_covariance[e], information[e])
        if most <= _log_evidence(x[e], told, own_x[e], information[e], (gain, missed)):
            continue
        _fill_gains(best, told, gain)
        for k, holds in zip(told.factor, gain > 0.0):
            changed |= used[k] != holds
            used[k] = holds
    return changed
