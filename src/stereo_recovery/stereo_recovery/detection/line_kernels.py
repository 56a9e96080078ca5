"""Compiled geometry of straight lines in the image, and their fit to edgels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import (
    BIAS_SHARE,
    CAUCHY,
    CORNER_TRIM,
    CORNER_TRIM_SHARE,
    CORRELATION_LENGTH,
    LEAST_BIAS,
    LEAST_SCALE,
    MEDIAN_SAMPLES,
    MOST_BIAS_SIGMA,
    MOST_DENSE,
    NOISE_SAGITTA,
    SAGITTA_OFFSET,
    SAGITTA_SLOPE,
    UNUSUAL_WIDTH,
    VARIED_WIDTH,
    WIDTH_DEVIATIONS,
    WIDTH_EDGELS,
    WIDTH_SIGMA,
)


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
    """Lines through n runs of edgels; fields as in :class:`.segments.Segments`, ``used`` its ``count``."""

    centre: FloatArray
    direction: FloatArray
    extent: FloatArray
    rms: FloatArray
    sagitta: FloatArray
    used: FloatArray
    sigma: FloatArray
    magnitude: FloatArray


class Run(NamedTuple):
    """What edgels are to the fit of a line.

    Attributes
    ----------
    x, y, sigma : (n,) float64, pixels
        Position of edgels and its sigma.
    width, bias : (n,) float64, pixels
    magnitude : (n,) float64, grey levels per pixel
        See :class:`.edgels.Edgels`.
    """

    x: FloatArray
    y: FloatArray
    sigma: FloatArray
    width: FloatArray
    bias: FloatArray
    magnitude: FloatArray


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
    sagitta = 0.25 * length * length * dq / m4 if m4 > NOT_ZERO else 0.0
    return sw, m2, sagitta


@njit
def _fit_line(
    run: Run, a: int, b: int, w: FloatArray
) -> tuple[tuple[float, float, float, float], tuple[float, float], tuple[float, int, float, float, float]]:
    """Robust orthogonal regression of edgels a..b-1, without those beside its ends; w : (n,) scratch.

    The first of three rounds leaves CORNER_TRIM pixels at each end out; the others give the rest Cauchy weights.

    Returns centre and direction; first and last abscissa; robust residual, edgels in the fit, sum of their weights,
    their weighted second moment along the line, and the sagitta.
    """
    x, y, sigma = run.x, run.y, run.sigma
    for i in range(a, b):
        w[i] = 1.0 / (sigma[i] * sigma[i])
    cx, cy, tx, ty = regression(x, y, w, a, b)
    lo, hi = np.inf, -np.inf
    for i in range(a, b):
        s = (x[i] - cx) * tx + (y[i] - cy) * ty
        lo, hi = min(lo, s), max(hi, s)
    cut = min(CORNER_TRIM, CORNER_TRIM_SHARE * (hi - lo))
    scale, used = 0.0, 0
    for turn in range(3):
        used = 0
        for i in range(a, b):
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            if turn == 0 and (s < lo + cut or s > hi - cut):
                w[i] = 0.0
            if w[i] > 0.0:
                if turn > 0:
                    r = ((x[i] - cx) * ty - (y[i] - cy) * tx) / (CAUCHY * scale)
                    w[i] = 1.0 / (sigma[i] * sigma[i]) / (1.0 + r * r)
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
    line = cx, cy, tx, ty
    weight, moment, sagitta = _sagitta(x, y, w, a, b, line, hi - lo)
    lo, hi = np.inf, -np.inf
    for i in range(a, b):
        s = (x[i] - cx) * tx + (y[i] - cy) * ty
        lo, hi = min(lo, s), max(hi, s)
    return line, (lo, hi), (scale, used, weight, moment, sagitta)


@njit
def _median(values: FloatArray, a: int, b: int) -> float:
    """Median of values a..b-1, of many by samples."""
    step = max(1, (b - a) // MEDIAN_SAMPLES)
    return float(np.median(values[a:b:step]))


@njit
def width_excess(width: FloatArray, bounds: IntArray) -> FloatArray:
    """How much the step width of runs of edgels differs from the usual one.

    Parameters
    ----------
    width : (n,) float64, pixels
        Of the edgels.
    bounds : (k, 2) int64
        Runs [first, last).

    Returns
    -------
    (k,) float64
        Difference from the picture's median width, as a share of it, beyond the difference that is common in the
        picture; 0 where the picture is out of focus in parts.
    """
    beyond, usual, total = np.zeros(len(bounds)), np.median(width), 0
    for k in range(len(bounds)):
        total += bounds[k, 1] - bounds[k, 0]
    off, place = np.empty(total), 0
    for k in range(len(bounds)):
        a, b = bounds[k, 0], bounds[k, 1]
        beyond[k] = abs(_median(width, a, b) / usual - 1.0)
        off[place : place + b - a] = beyond[k]
        place += b - a
    common = np.median(off)
    for k in range(len(bounds)):
        odd = common <= VARIED_WIDTH and bounds[k, 1] - bounds[k, 0] >= WIDTH_EDGELS
        beyond[k] = max(beyond[k] - max(UNUSUAL_WIDTH, WIDTH_DEVIATIONS * common), 0.0) if odd else 0.0
    return beyond


@njit(nogil=True)
def fit_lines(run: Run, bounds: IntArray, smoothing: float) -> FittedLines:
    """Lines through runs of edgels, and how well they are known.

    Parameters
    ----------
    run : Run
        Edgels, run after run.
    bounds : (k, 2) int64
        Runs [first, last).
    smoothing : float
        Pixels. Of the detector.

    Returns
    -------
    FittedLines
        k lines.
    """
    lines = len(bounds)
    out = FittedLines(
        np.empty((lines, 2)),
        np.empty((lines, 2)),
        np.empty((lines, 2)),
        np.empty(lines),
        np.empty(lines),
        np.empty(lines),
        np.empty((lines, 2)),
        np.empty(lines),
    )
    if lines == 0:
        return out
    w, excess = np.empty(len(run.x)), width_excess(run.width, bounds)
    for k in range(lines):
        a, b = bounds[k, 0], bounds[k, 1]
        line, ends, (rms, used, weight, moment, sagitta) = _fit_line(run, a, b, w)
        out.centre[k, 0], out.centre[k, 1], out.direction[k, 0], out.direction[k, 1] = line
        out.extent[k, 0], out.extent[k, 1] = ends
        out.rms[k], out.used[k] = rms, used
        count, length = max(used, 1), max(ends[1] - ends[0], 1.0)
        # So many neighbouring edgels have one error: correlation goes by distance, and a slanting edge has fewer a
        # pixel.
        correlated = max(1.0, CORRELATION_LENGTH * smoothing * min(count / length, MOST_DENSE))
        scale = max(1.0, rms * np.sqrt(weight / count)) * np.sqrt(correlated)
        offset = scale / np.sqrt(max(weight, NOT_ZERO))
        turn = scale / np.sqrt(max(moment, NOT_ZERO))
        # A bent line is not quite one (two edges that meet at a slight angle, a lens, a fold): its sigma grows with
        # the sagitta that noise does not explain.
        bend = np.sqrt(max(sagitta**2 - (NOISE_SAGITTA * offset) ** 2, 0.0))
        # A step of unusual width, or with a gradient on one flank, may be two edges or a shadow.
        biased = min(BIAS_SHARE * max(_median(run.bias, a, b) - LEAST_BIAS, 0.0), MOST_BIAS_SIGMA)
        spread = np.hypot(WIDTH_SIGMA * np.sqrt(excess[k]), biased)
        out.sigma[k, 0] = np.hypot(np.hypot(offset, SAGITTA_OFFSET * bend), spread)
        out.sigma[k, 1] = np.hypot(np.hypot(turn, SAGITTA_SLOPE * bend / length), spread / length)
        # The sign of the sagitta is kept even where noise explains its size.
        out.sagitta[k] = np.copysign(max(bend, NOT_ZERO), sagitta)
        out.magnitude[k] = run.magnitude[a:b].sum() / max(b - a, 1)
    return out
