"""Compiled geometry of straight lines in the image, and their fit to edgels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import CAUCHY, CORNER_TRIM, CORNER_TRIM_SHARE, LEAST_DIVISOR, LEAST_SCALE, MEDIAN_SAMPLES


class Lines(NamedTuple):
    """n segments as compiled loops take them.

    Attributes
    ----------
    centre : (n, 2) float64, pixels
    direction : (n, 2) float64, unit
    extent : (n, 2) float64, pixels
        Abscissa of the first and the last end, along the direction from the centre.
    sigma : (n, 2) float64
        Of the offset at the centre, pixels, and of the slope, radians.
    """

    centre: FloatArray
    direction: FloatArray
    extent: FloatArray
    sigma: FloatArray


class FittedLines(NamedTuple):
    """Lines through n runs of edgels.

    Attributes
    ----------
    centre, direction, extent : (n, 2) float64
        As in :class:`Lines`.
    rms : (n,) float64, pixels
        Robust residual.
    sagitta : (n,) float64, pixels
        Of the middle over the chord of the ends, signed.
    used : (n,) float64
        Edgels in the fit.
    weight : (n,) float64, 1 / px^2
        Sum of their weights.
    moment : (n,) float64
        Weighted second moment along the line.
    """

    centre: FloatArray
    direction: FloatArray
    extent: FloatArray
    rms: FloatArray
    sagitta: FloatArray
    used: FloatArray
    weight: FloatArray
    moment: FloatArray


@njit
def point_at(lines: Lines, i: int, s: float) -> tuple[float, float]:
    """The point of line i at abscissa s, pixels."""
    return lines.centre[i, 0] + s * lines.direction[i, 0], lines.centre[i, 1] + s * lines.direction[i, 1]


@njit
def abscissa_of(lines: Lines, i: int, x: float, y: float) -> float:
    """Pixels along line i from its centre to the foot of a point."""
    abscissa: float = (x - lines.centre[i, 0]) * lines.direction[i, 0] + (y - lines.centre[i, 1]) * lines.direction[
        i, 1
    ]
    return abscissa


@njit
def offset_of(lines: Lines, i: int, x: float, y: float) -> float:
    """Pixels from line i to a point, signed."""
    offset: float = (x - lines.centre[i, 0]) * lines.direction[i, 1] - (y - lines.centre[i, 1]) * lines.direction[i, 0]
    return offset


@njit
def length_of(lines: Lines, i: int) -> float:
    """Pixels."""
    length: float = lines.extent[i, 1] - lines.extent[i, 0]
    return length


@njit
def cosine_of(lines: Lines, i: int, k: int) -> float:
    """Cosine of the angle between the directions of lines i and k."""
    cosine: float = lines.direction[i, 0] * lines.direction[k, 0] + lines.direction[i, 1] * lines.direction[k, 1]
    return cosine


@njit
def sine_of(lines: Lines, i: int, k: int) -> float:
    """Sine of the angle from the direction of line i to that of line k."""
    sine: float = lines.direction[i, 0] * lines.direction[k, 1] - lines.direction[i, 1] * lines.direction[k, 0]
    return sine


@njit
def variance_at(lines: Lines, i: int, s: float) -> float:
    """Variance, px^2, of line i across itself at abscissa s."""
    variance: float = lines.sigma[i, 0] ** 2 + (s * lines.sigma[i, 1]) ** 2
    return variance


@njit
def regression(x: FloatArray, y: FloatArray, w: FloatArray, a: int, b: int) -> tuple[float, float, float, float]:
    """Orthogonal regression of points.

    Parameters
    ----------
    x, y : (n,) float64, pixels
    w : (n,) float64
        Weights.
    a, b : int
        Only points a..b-1 count.

    Returns
    -------
    cx, cy : float
        Pixels. Centre.
    tx, ty : float
        Unit direction, along the order of the points.
    """
    sw = sx = sy = 0.0
    for i in range(a, b):
        sw += w[i]
        sx += w[i] * x[i]
        sy += w[i] * y[i]
    cx, cy = sx / sw, sy / sw
    sxx = sxy = syy = 0.0
    for i in range(a, b):
        dx, dy = x[i] - cx, y[i] - cy
        sxx += w[i] * dx * dx
        sxy += w[i] * dx * dy
        syy += w[i] * dy * dy
    angle = 0.5 * np.arctan2(2.0 * sxy, sxx - syy)
    tx, ty = np.cos(angle), np.sin(angle)
    if tx * (x[b - 1] - x[a]) + ty * (y[b - 1] - y[a]) < 0.0:
        tx, ty = -tx, -ty
    return cx, cy, tx, ty


@njit
def _sagitta(
    x: FloatArray, y: FloatArray, w: FloatArray, a: int, b: int, line: tuple[float, float, float, float], length: float
) -> tuple[float, float, float]:
    """Sum of the weights of points a..b-1, second moment along their line (see :func:`regression`), and their sagitta.

    The sagitta, pixels, is that of the least-squares quadratic on the residuals over this length; abscissas are
    centred, so that the slope of the quadratic is zero.
    """
    cx, cy, tx, ty = line
    m2 = m4 = dq = 0.0
    sw = 0.0
    for i in range(a, b):
        if w[i] > 0.0:
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            m2 += w[i] * s * s
            sw += w[i]
    mean2 = m2 / sw
    for i in range(a, b):
        if w[i] > 0.0:
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            d = (x[i] - cx) * ty - (y[i] - cy) * tx
            q = s * s - mean2
            m4 += w[i] * q * q
            dq += w[i] * q * d
    sagitta = 0.25 * length * length * dq / m4 if m4 > LEAST_DIVISOR else 0.0
    return sw, m2, sagitta


@njit(nogil=True)
def fit_lines(x: FloatArray, y: FloatArray, sigma: FloatArray, bounds: IntArray) -> FittedLines:
    """Robust orthogonal regression of runs of edgels, without the edgels beside their ends.

    The first of three rounds leaves CORNER_TRIM pixels at each end out; the others give the rest Cauchy weights.

    Parameters
    ----------
    x, y, sigma : (n,) float64, pixels
        Position of edgels and its sigma.
    bounds : (k, 2) int64
        Runs [first, last).

    Returns
    -------
    FittedLines
        k lines.
    """
    lines = len(bounds)
    centre, direction, extent = np.zeros((lines, 2)), np.zeros((lines, 2)), np.zeros((lines, 2))
    rms, sagittas, count = np.zeros(lines), np.zeros(lines), np.zeros(lines)
    weights, moment = np.zeros(lines), np.zeros(lines)
    w = np.zeros(len(x))
    for k in range(lines):
        a, b = bounds[k, 0], bounds[k, 1]
        for i in range(a, b):
            w[i] = 1.0 / (sigma[i] * sigma[i])
        cx, cy, tx, ty = regression(x, y, w, a, b)
        lo, hi = np.inf, -np.inf
        for i in range(a, b):
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            lo, hi = min(lo, s), max(hi, s)
        cut = min(CORNER_TRIM, CORNER_TRIM_SHARE * (hi - lo))
        scale = 0.0
        for turn in range(3):
            used = 0
            total = weight = 0.0
            for i in range(a, b):
                s = (x[i] - cx) * tx + (y[i] - cy) * ty
                if turn == 0 and (s < lo + cut or s > hi - cut):
                    w[i] = 0.0
                if w[i] > 0.0:
                    base = 1.0 / (sigma[i] * sigma[i])
                    d = (x[i] - cx) * ty - (y[i] - cy) * tx
                    if turn > 0:
                        r = d / (CAUCHY * scale)
                        w[i] = base / (1.0 + r * r)
                    total += w[i] * d * d
                    weight += w[i]
                    used += 1
            if used < 3:
                for i in range(a, b):
                    w[i] = 1.0 / (sigma[i] * sigma[i])
            cx, cy, tx, ty = regression(x, y, w, a, b)
            total = weight = 0.0
            used = 0
            for i in range(a, b):
                if w[i] > 0.0:
                    d = (x[i] - cx) * ty - (y[i] - cy) * tx
                    total += w[i] * d * d
                    weight += w[i]
                    used += 1
            scale = max(LEAST_SCALE, np.sqrt(total / weight))
        sw, m2, sagittas[k] = _sagitta(x, y, w, a, b, (cx, cy, tx, ty), hi - lo)
        centre[k, 0], centre[k, 1], direction[k, 0], direction[k, 1] = cx, cy, tx, ty
        extent[k, 0], extent[k, 1] = np.inf, -np.inf
        for i in range(a, b):
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            extent[k, 0], extent[k, 1] = min(extent[k, 0], s), max(extent[k, 1], s)
        rms[k], count[k], weights[k], moment[k] = scale, used, sw, m2
    return FittedLines(centre, direction, extent, rms, sagittas, count, weights, moment)


@njit(nogil=True)
def medians(values: FloatArray, bounds: IntArray) -> FloatArray:
    """(k,) float64: median of each run [first, last) of values (n,), of long ones by samples; bounds (k, 2)."""
    out = np.empty(len(bounds))
    room = np.empty(2 * MEDIAN_SAMPLES)
    for k in range(len(bounds)):
        a, b = bounds[k, 0], bounds[k, 1]
        step = max(1, (b - a) // MEDIAN_SAMPLES)
        count = 0
        for i in range(a, b, step):
            room[count] = values[i]
            count += 1
        out[k] = np.median(room[:count])
    return out
