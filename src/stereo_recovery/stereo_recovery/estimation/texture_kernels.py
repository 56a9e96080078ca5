"""Compiled alignment of the strips of texture beside straight edges: what disparity their surfaces have."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from ..detection.sampling import bilinear
from .settings import (
    CAUCHY,
    MATCH_SIGMA,
    STRIP_CONVERGED,
    STRIP_FAR,
    STRIP_GAIN_SIGMA,
    STRIP_LEAST_SCALE,
    STRIP_LEAST_SHARE,
    STRIP_NEAR,
    STRIP_ROUNDS,
    STRIP_SAMPLES,
    STRIP_SHIFT_SIGMA,
    STRIP_SLOPE_SIGMA,
)

# Unknowns of a strip: disparity where it begins, its gradients along and across the edge, gain and shift of grey
# levels, and the row in the right image over that in the left.
UNKNOWNS = 6


@njit
def _sample(images: tuple[Float32Array, Float32Array], place: FloatArray, p: FloatArray, out: FloatArray) -> int:
    """Fill ``out`` (m, 6) at a strip's places: s, o, left grey, right grey and its slopes in u and v. Returns m.

    place : (8,) centre u, v, direction u, v, first and last abscissa, side (+1, -1), step along; p : (6,)
    """
    left, right = images
    height, width = left.shape
    m = 0
    count = int((place[5] - place[4]) / place[7]) + 1
    for k in range(count):
        s = place[4] + k * place[7]
        for w in range(STRIP_FAR - STRIP_NEAR + 1):
            o = place[6] * (STRIP_NEAR + w)
            x = place[0] + s * place[2] - o * place[3]
            y = place[1] + s * place[3] + o * place[2]
            there = x - (p[0] + p[1] * s + p[2] * o)
            below = y + p[5]
            if y < 0.0 or y >= height - 1 or x < 0.0 or x >= width - 1:
                continue
            if there < 1.0 or there >= width - 2 or below < 1.0 or below >= height - 2:
                continue
            out[m, 0], out[m, 1] = s, o
            out[m, 2] = bilinear(left, x, y)
            out[m, 3] = bilinear(right, there, below)
            out[m, 4] = 0.5 * (bilinear(right, there + 1.0, below) - bilinear(right, there - 1.0, below))
            out[m, 5] = 0.5 * (bilinear(right, there, below + 1.0) - bilinear(right, there, below - 1.0))
            m += 1
    return m


@njit
def _align(
    images: tuple[Float32Array, Float32Array], place: FloatArray, p: FloatArray, prior: FloatArray, out: FloatArray
) -> tuple[bool, FloatArray, float]:
    """Gauss-Newton from p (6,), changed in place.

    prior : (6,) inverse variances of p; out : scratch space, see :func:`_sample`

    Returns whether it converged, the covariance (6, 6), and the share of the strip's variance that is explained.
    """
    inverse = np.zeros((UNKNOWNS, UNKNOWNS))
    share = 0.0
    lever = max(abs(place[4]), abs(place[5]), 1.0)
    converged = False
    for _ in range(STRIP_ROUNDS):
        m = _sample(images, place, p, out)
        if m < 4 * UNKNOWNS:
            return False, inverse, 0.0
        off = np.empty(m)
        total, total2 = 0.0, 0.0
        for k in range(m):
            off[k] = out[k, 2] - p[3] * out[k, 3] - p[4]
            total += out[k, 2]
            total2 += out[k, 2] ** 2
        scale = np.median(np.abs(off)) / NORMAL_QUARTILE + STRIP_LEAST_SCALE
        normal, right = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
        row = np.empty(UNKNOWNS)
        left_over = 0.0
        for k in range(m):
            weight = 1.0 / (1.0 + (off[k] / (CAUCHY * scale)) ** 2)
            slope = -p[3] * out[k, 4]
            row[0], row[1], row[2], row[3], row[4] = slope, slope * out[k, 0], slope * out[k, 1], out[k, 3], 1.0
            row[5] = p[3] * out[k, 5]
            left_over += min(off[k] ** 2, 9.0 * scale**2)
            for i in range(UNKNOWNS):
                right[i] += weight * row[i] * off[k]
                for j in range(i + 1):
                    normal[i, j] += weight * row[i] * row[j]
        for i in range(UNKNOWNS):
            for j in range(i):
                normal[j, i] = normal[i, j]
            normal[i, i] += scale**2 * prior[i]
            # Slopes and rows are none, and the gain is one; the disparity and the shift are where they began.
            if i > 0 and i != 4:
                right[i] += scale**2 * prior[i] * ((1.0 if i == 3 else 0.0) - p[i])
        inverse = np.linalg.inv(normal) * scale**2
        # The residual is left - model, whose derivative by disparity is minus the slope's.
        step = np.linalg.solve(normal, right)
        variance = max(total2 / m - (total / m) ** 2, 1e-6)
        share = 1.0 - left_over / m / variance
        for i in range(UNKNOWNS):
            p[i] += step[i]
        if abs(step[0]) + lever * abs(step[1]) < STRIP_CONVERGED:
            converged = True
            break
    return converged, inverse, share


@njit
def align_strips(
    levels: tuple[tuple[Float32Array, Float32Array], ...],
    scale: FloatArray,
    places: FloatArray,
    start: FloatArray,
    row_sigma: float,
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
    """Disparity of the surfaces beside edges, from strips of texture, the coarsest level first.

    levels : images of both sides, the coarsest first; scale : (levels,) their pixels a pixel; places : (n, 7) centre,
    direction, first and last abscissa, side; start : (n, 3) disparity at abscissa 0 and its gradients, pixels;
    row_sigma : pixels, by which rows may disagree

    Returns (n,) whether it aligned, (n, 2) disparity at abscissa 0 and its slope, on the edge, (n, 2, 2) their
    covariance, and (n, 2) by how much the right image's rows are lower, and its variance.
    """
    n = len(places)
    good = np.zeros(n, np.bool_)
    value, covariance = np.zeros((n, 2)), np.zeros((n, 2, 2))
    rows = np.zeros((n, 2))
    prior = np.array(
        [
            MATCH_SIGMA**-2.0,
            STRIP_SLOPE_SIGMA**-2.0,
            STRIP_SLOPE_SIGMA**-2.0,
            STRIP_GAIN_SIGMA**-2.0,
            STRIP_SHIFT_SIGMA**-2.0,
            1.0,
        ]
    )
    for e in range(n):
        p = np.zeros(UNKNOWNS)
        p[:3] = start[e]
        p[3] = 1.0
        for level in range(len(scale)):
            f = scale[level]
            place = np.empty(8)
            # Pixel centres have whole coordinates.
            place[0], place[1] = (places[e, 0] + 0.5) * f - 0.5, (places[e, 1] + 0.5) * f - 0.5
            place[2], place[3] = places[e, 2], places[e, 3]
            place[4], place[5], place[6] = places[e, 4] * f, places[e, 5] * f, places[e, 6]
            place[7] = max(1.0, (place[5] - place[4]) / STRIP_SAMPLES)
            out = np.empty(((int((place[5] - place[4]) / place[7]) + 2) * (STRIP_FAR - STRIP_NEAR + 1), UNKNOWNS))
            p[0] *= f
            p[5] *= f
            prior[5] = (f * row_sigma) ** -2.0
            if level == 0:
                # Grey levels first, so that a difference of exposure is no slope.
                m = _sample(levels[level], place, p, out)
                if m > 0:
                    p[4] = np.median(out[:m, 2] - out[:m, 3])
            fine, inverse, share = _align(levels[level], place, p, prior, out)
            p[0] /= f
            p[5] /= f
            if not fine or share < STRIP_LEAST_SHARE:
                good[e] = False
                break
            good[e] = True
            value[e, 0], value[e, 1] = p[0], p[1]
            rows[e, 0], rows[e, 1] = p[5], inverse[5, 5] / (f * f)
            covariance[e] = inverse[:2, :2]
            covariance[e, 0, 0] /= f * f
            covariance[e, 0, 1] /= f
            covariance[e, 1, 0] /= f
    return good, value, covariance, rows
