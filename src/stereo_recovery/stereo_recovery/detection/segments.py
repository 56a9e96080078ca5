"""Straight segments of edge chains: orthogonal regression of each, and how uncertain its line is (thesis 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from . import splitting_kernels
from .edgels import Edgels

# Neighbouring edgels share pixels, so that several count as one: smoothing correlates them over sqrt(4 pi) sigma; the
# errors of lines against the truth say three quarters of that.
CORRELATION_LENGTH = 0.75 * np.sqrt(4.0 * np.pi)
# Pixels next to a corner whose edgels are pulled towards it.
CORNER_REACH = 3.0
# What a sagitta adds to the sigma of a line: to its offset, and (over its length) to its slope. Noise alone bends a
# straight line by 3.35 times the sigma of its offset (one sigma: 3/2 of the second Legendre coefficient's); a little
# more is taken off.
SAGITTA_OFFSET = 0.3
SAGITTA_SLOPE = 2.0
NOISE_SAGITTA = 4.0
# An edge is suspect when its width differs from the picture's by more than this share, or so many times the median;
# its place is then uncertain by so many pixels times the root of the excess. Few edgels say nothing, and neither do
# widths in a picture where the median is above a limit (out of focus, uneven light).
UNUSUAL = 0.05
BLURRED = 1.0
DEVIATIONS, LONG, VARIED = 3.0, 10, 0.05
# Another edge close beside a segment moves its edgels; they tell by how much at most, and this share of it is the sigma
# of the line, within the bounds given, pixels: less is noise, and with more the other edge is another segment.
MOVED, LEAST_SHIFT, MOST_MOVED = 0.5, 0.05, 0.7
# Segments flatter than this (sine) may run either way along their rows.
LEVEL = 0.1


@dataclass(frozen=True, eq=False)
class Segments:
    """n straight segments of chains, each fitted by orthogonal regression.

    bounds : (n, 2) int64, edgels [first, last) in the order that came with the segments; chain : (n,) int64
    centre, direction : (n, 2) float64, pixels; the unit direction runs along the chain
    extent : (n, 2) float64, pixels: first and last place along the direction, from the centre
    rms, sagitta : (n,) float64, pixels: residual, and how far the middle stands off the chord of the ends, beyond noise
    count : (n,) float64, edgels used in the fit
    sigma : (n, 2) float64: of the offset at the centre, pixels, and of the slope, radians
    magnitude : (n,) float64, mean gradient, grey levels per pixel
    arc : (n,) int32, the ellipse it is a segment of, or -1: straight
    """

    bounds: np.ndarray
    chain: np.ndarray
    centre: np.ndarray
    direction: np.ndarray
    extent: np.ndarray
    rms: np.ndarray
    sagitta: np.ndarray
    count: np.ndarray
    sigma: np.ndarray
    magnitude: np.ndarray
    arc: np.ndarray

    def __len__(self) -> int:
        return len(self.bounds)

    def select(self, index: np.ndarray) -> Segments:
        return Segments(*(getattr(self, f.name)[index] for f in fields(self)))

    @property
    def start(self) -> np.ndarray:
        """(n, 2) float64, pixels."""
        return self.centre + self.extent[:, :1] * self.direction

    @property
    def end(self) -> np.ndarray:
        """(n, 2) float64, pixels."""
        return self.centre + self.extent[:, 1:] * self.direction

    @property
    def length(self) -> np.ndarray:
        """(n,) float64, pixels."""
        return self.extent[:, 1] - self.extent[:, 0]


def reversed_polarity(left: Segments, right: Segments, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(...) bool: whether left segments i and right segments j that show the same edges are directed against each
    other, as when contrast changes its sign between the views. Rows have one order in both images, columns need not
    have."""
    t, u = left.direction[i], right.direction[j]
    rows = t[..., 1] * u[..., 1]
    return np.where(np.minimum(np.abs(t[..., 1]), np.abs(u[..., 1])) > LEVEL, rows, rows + t[..., 0] * u[..., 0]) < 0.0


def line_table(segments: Segments) -> np.ndarray:
    """(n, 8) float64 for the compiled loops: centre, direction, extent, sigma."""
    return np.hstack([segments.centre, segments.direction, segments.extent, segments.sigma])


def width_excess(e: Edgels, bounds: np.ndarray) -> np.ndarray:
    """(n,) float64: by how much the width of runs of edgels differs from the usual one, as a share, beyond what is
    common in the picture; nothing where some edges are out of focus."""
    if len(bounds) == 0:
        return np.zeros(0)
    off = np.abs(splitting_kernels.medians(e.width, bounds) / float(np.median(e.width)) - 1.0)
    count = np.diff(bounds, axis=1)[:, 0]
    common = float(np.median(np.repeat(off, count)))
    if common > VARIED:
        return np.zeros(len(bounds))
    return np.where(count >= LONG, np.maximum(off - max(UNUSUAL, DEVIATIONS * common), 0.0), 0.0)


def fit_segments(e: Edgels, bounds: np.ndarray, chain: np.ndarray, sigma: float) -> Segments:
    """Lines through given runs of edgels (n, 2)."""
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    rows = splitting_kernels.fit_lines(x, y, e.sigma_position, bounds, CORNER_REACH)
    weight, moment, count = rows[:, 9], rows[:, 10], np.maximum(rows[:, 8], 1.0)
    # Edgels a pixel: a slanting edge has fewer, and correlation is a matter of distance.
    density = count / np.maximum(rows[:, 5] - rows[:, 4], 1.0)
    together = np.maximum(1.0, CORRELATION_LENGTH * sigma * np.minimum(density, 1.5))
    excess = np.maximum(1.0, rows[:, 6] * np.sqrt(weight / count))
    fit_sigma = excess[:, None] * np.sqrt(together[:, None] / np.maximum(np.stack([weight, moment], axis=1), 1e-9))
    # A line that bends is not quite one: two edges that meet at a slight angle, a lens, a fold. Its place is as vague.
    sagitta = np.sqrt(np.maximum(rows[:, 7] ** 2 - (NOISE_SAGITTA * fit_sigma[:, 0]) ** 2, 0.0))
    length = np.maximum(rows[:, 5] - rows[:, 4], 1.0)
    fit_sigma = np.hypot(fit_sigma, np.column_stack([SAGITTA_OFFSET * sagitta, SAGITTA_SLOPE * sagitta / length]))
    # So is one that is narrower or wider than a step is in this picture, or brighter on one side than a step is: it is
    # two edges, or a shadow.
    moved = MOVED * np.maximum(splitting_kernels.medians(e.bias, bounds) - LEAST_SHIFT, 0.0)
    spread = np.hypot(BLURRED * np.sqrt(width_excess(e, bounds)), np.minimum(moved, MOST_MOVED))
    fit_sigma = np.hypot(fit_sigma, np.column_stack([spread, spread / length]))
    total = np.concatenate([[0.0], np.cumsum(e.magnitude)])
    magnitude = (total[bounds[:, 1]] - total[bounds[:, 0]]) / np.maximum(bounds[:, 1] - bounds[:, 0], 1)
    # Which way it bends is told even where noise hides by how much.
    signed = np.copysign(np.maximum(sagitta, 1e-9), rows[:, 7])
    return Segments(
        bounds,
        chain,
        rows[:, 0:2],
        rows[:, 2:4],
        rows[:, 4:6],
        rows[:, 6],
        signed,
        rows[:, 8],
        fit_sigma,
        magnitude,
        np.full(len(bounds), -1, np.int32),
    )
