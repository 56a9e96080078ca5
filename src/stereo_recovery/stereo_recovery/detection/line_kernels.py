"""Compiled geometry of straight lines in the image, and their fit to edgels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import (
    BIAS_SHARE,
    CAUCHY,
    CORNER_TRIM_SHARE,
    CORRELATION_LENGTH,
    FIT_ROUNDS,
    LEAST_DIVISOR,
    NOISE_SAGITTA,
    REACH,
    SAGITTA_OFFSET,
    SAGITTA_SLOPE,
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
    bias : (n,) float64, pixels
    magnitude : (n,) float64, grey levels per pixel
        See :class:`.edgels.Edgels`.
    """

    x: FloatArray
    y: FloatArray
    sigma: FloatArray
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
def regression(x: FloatArray, y: FloatArray, w: FloatArray) -> tuple[float, float, float, float]:
    """Orthogonal regression of points.

    Parameters
    ----------
    x, y : (n,) float64, pixels
    w : (n,) float64
        Weights.

    Returns
    -------
    cx, cy : float
        Pixels. Centre.
    tx, ty : float
        Unit direction, along the order of the points.
    """
    sw = sx = sy = 0.0
    for i in range(len(x)):
        sw += w[i]
        sx += w[i] * x[i]
        sy += w[i] * y[i]
    cx, cy = sx / sw, sy / sw
    sxx = sxy = syy = 0.0
    for i in range(len(x)):
        dx, dy = x[i] - cx, y[i] - cy
        sxx += w[i] * dx * dx
        sxy += w[i] * dx * dy
        syy += w[i] * dy * dy
    angle = 0.5 * np.arctan2(2.0 * sxy, sxx - syy)
    tx, ty = np.cos(angle), np.sin(angle)
    if tx * (x[-1] - x[0]) + ty * (y[-1] - y[0]) < 0.0:
        tx, ty = -tx, -ty
    return cx, cy, tx, ty


@njit
def _along_and_off(
    x: FloatArray, y: FloatArray, line: tuple[float, float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """(n,), (n,), pixels: abscissas and offsets of points in a line, see :func:`regression`."""
    cx, cy, tx, ty = line
    return (x - cx) * tx + (y - cy) * ty, (x - cx) * ty - (y - cy) * tx


@njit
def _fit_line(
    run: Run, a: int, b: int
) -> tuple[tuple[float, float, float, float], tuple[float, float], tuple[float, int, float, float, float]]:
    """Robust orthogonal regression of edgels a..b-1, without those within REACH pixels of its ends.

    Returns centre and direction; first and last abscissa; robust residual, edgels in the fit, sum of their weights,
    their weighted second moment along the line, and the sagitta of the least-squares quadratic on the residuals.
    """
    x, y, information = run.x[a:b], run.y[a:b], 1.0 / run.sigma[a:b] ** 2
    line = regression(x, y, information)
    s, off = _along_and_off(x, y, line)
    cut = min(REACH, CORNER_TRIM_SHARE * (s.max() - s.min()))
    inner = (s >= s.min() + cut) & (s <= s.max() - cut)
    if inner.sum() > 2:  # a line and its sagitta
        information = np.where(inner, information, 0.0)
    w, scale = information, 0.0
    for turn in range(FIT_ROUNDS):
        if turn > 0:
            w = information / (1.0 + (off / (CAUCHY * scale)) ** 2)
        line = regression(x, y, w)
        s, off = _along_and_off(x, y, line)
        scale = max(LEAST_DIVISOR, np.sqrt((w * off * off).sum() / w.sum()))
    weight, moment = w.sum(), (w * s * s).sum()
    # Abscissas are centred, so that the slope of the quadratic is zero.
    bow = s * s - moment / weight
    sagitta = 0.25 * (s.max() - s.min()) ** 2 * (w * bow * off).sum() / max((w * bow * bow).sum(), LEAST_DIVISOR)
    return line, (s.min(), s.max()), (scale, (w > 0.0).sum(), weight, moment, sagitta)


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
    for k in range(lines):
        a, b = bounds[k, 0], bounds[k, 1]
        line, ends, (rms, used, weight, moment, sagitta) = _fit_line(run, a, b)
        out.centre[k, 0], out.centre[k, 1], out.direction[k, 0], out.direction[k, 1] = line
        out.extent[k, 0], out.extent[k, 1] = ends
        out.rms[k], out.used[k] = rms, used
        count, length = max(used, 1), max(ends[1] - ends[0], 1.0)
        # So many neighbouring edgels have one error: correlation goes by distance, and a slanting edge has fewer a
        # pixel.
        correlated = max(1.0, CORRELATION_LENGTH * smoothing * count / length)
        scale = max(1.0, rms * np.sqrt(weight / count)) * np.sqrt(correlated)
        offset = scale / np.sqrt(max(weight, LEAST_DIVISOR))
        turn = scale / np.sqrt(max(moment, LEAST_DIVISOR))
        # A bent line is not quite one (two edges that meet at a slight angle, a lens, a fold): its sigma grows with
        # the sagitta that noise does not explain.
        bend = np.sqrt(max(sagitta**2 - (NOISE_SAGITTA * offset) ** 2, 0.0))
        # A step with a gradient on one flank may be two edges or a shadow.
        biased = BIAS_SHARE * np.median(run.bias[a:b])
        out.sigma[k, 0] = np.hypot(np.hypot(offset, SAGITTA_OFFSET * bend), biased)
        out.sigma[k, 1] = np.hypot(np.hypot(turn, SAGITTA_SLOPE * bend / length), biased / length)
        # The sign of the sagitta is kept even where noise explains its size.
        out.sagitta[k] = np.copysign(max(bend, LEAST_DIVISOR), sagitta)
        out.magnitude[k] = run.magnitude[a:b].sum() / max(b - a, 1)
    return out
