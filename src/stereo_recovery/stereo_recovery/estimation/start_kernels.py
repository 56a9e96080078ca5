"""Compiled choice of what the estimate starts with: for each open edge the statements of its likeliest depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .settings import MOST_SLOPE


class Statements(NamedTuple):
    """All factors by the edges that they are about, those of two edges twice.

    Attributes
    ----------
    first : (n + 1,) int64
        Where each edge's statements begin in ``factor`` and ``mirrored``, (m,).
    edge, other, row, other_row, value, sigma, prior, spread : (k, ...)
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


@njit
def _told(
    s: Statements, e: int, known: BoolArray, x: FloatArray, covariance: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """What known edges say of edge e: factors (q,), rows (q, 2), and value, variance, prior, spread (q, 4)."""
    most = s.first[e + 1] - s.first[e]
    which, row, number = np.empty(most, np.int64), np.empty((most, 2)), np.empty((most, 4))
    count = 0
    for place in range(s.first[e], s.first[e + 1]):
        k = s.factor[place]
        f = s.edge[k] if s.mirrored[place] else s.other[k]
        if f >= 0 and not known[f]:
            continue
        value, variance = s.value[k], s.sigma[k] ** 2
        if s.mirrored[place]:
            row[count] = -s.other_row[k]
            value -= s.row[k, 0] * x[f, 0] + s.row[k, 1] * x[f, 1]
        else:
            row[count] = s.row[k]
            if f >= 0:
                value += s.other_row[k, 0] * x[f, 0] + s.other_row[k, 1] * x[f, 1]
        if f >= 0:
            g = s.row[k] if s.mirrored[place] else s.other_row[k]
            c = covariance[f]
            variance += g[0] * (c[0, 0] * g[0] + c[0, 1] * g[1]) + g[1] * (c[1, 0] * g[0] + c[1, 1] * g[1])
        which[count] = k
        number[count, 0], number[count, 1], number[count, 2], number[count, 3] = (
            value,
            variance,
            s.prior[k],
            s.spread[k],
        )
        count += 1
    return which[:count], row[:count], number[:count]


@njit
def _log_likelihood(
    x: FloatArray, row: FloatArray, number: FloatArray, own: FloatArray, information: FloatArray
) -> float:
    """Of unknowns x (2,), by what is told, and by the edge's own lines."""
    a, b = x[0] - own[0], x[1] - own[1]
    total = -0.5 * (
        a * (information[0, 0] * a + information[0, 1] * b) + b * (information[1, 0] * a + information[1, 1] * b)
    )
    for q in range(len(row)):
        off = row[q, 0] * x[0] + row[q, 1] * x[1] - number[q, 0]
        total += np.log(_inlier(off, number[q]) + (1.0 - number[q, 2]) / number[q, 3])
    return float(total)


@njit
def _inlier(off: float, number: FloatArray) -> float:
    """Density of a residual if its statement holds, times the probability that it does."""
    return float(number[2] * np.exp(-0.5 * off * off / number[1]) / np.sqrt(2.0 * np.pi * number[1]))


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
        which, row, number = _told(s, e, known, x, covariance)
        if len(which) == 0:
            continue
        best, most = own_x[e].copy(), _log_likelihood(own_x[e], row, number, own_x[e], information[e])
        trial = np.empty(2)
        for p in range(len(which)):
            # The edge's own lines with one statement, and two statements.
            gain = own_covariance[e] @ row[p]
            spread = gain @ row[p] + number[p, 1]
            off = number[p, 0] - row[p] @ own_x[e]
            trial[:] = own_x[e] + gain * (off / spread)
            score = _log_likelihood(trial, row, number, own_x[e], information[e])
            if score > most and abs(trial[1]) < MOST_SLOPE:
                best[:], most = trial, score
            for q in range(p):
                det = row[p, 0] * row[q, 1] - row[p, 1] * row[q, 0]
                # Two that are told at nearly one place say nothing of the slope.
                if abs(det) <= 4.0 * abs(row[p, 0] * row[q, 0]):
                    continue
                trial[0] = (number[p, 0] * row[q, 1] - number[q, 0] * row[p, 1]) / det
                trial[1] = (number[q, 0] * row[p, 0] - number[p, 0] * row[q, 0]) / det
                if abs(trial[1]) >= MOST_SLOPE:
                    continue
                score = _log_likelihood(trial, row, number, own_x[e], information[e])
                if score > most:
                    best[:], most = trial, score
        for p in range(len(which)):
            off = row[p, 0] * best[0] + row[p, 1] * best[1] - number[p, 0]
            holds = _inlier(off, number[p]) > (1.0 - number[p, 2]) / number[p, 3]
            if used[which[p]] != holds:
                used[which[p]] = holds
                changed = True
    return changed
