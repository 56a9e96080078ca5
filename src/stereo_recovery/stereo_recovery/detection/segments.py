"""Straight segments of edge chains: orthogonal regression of each, and how uncertain its line is (thesis 3.10.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, Int32Array, IntArray

from . import line_kernels
from .edgels import Edgels
from .settings import LEVEL_SINE


@dataclass(frozen=True, eq=False)
class Segments:
    """n straight segments of edge chains, each a line fitted by orthogonal regression.

    Attributes
    ----------
    bounds : (n, 2) int64
        Edgels [first, last) of each segment, in the order of the edgels that came with the segments.
    chain : (n,) int64
        The chain each segment is a part of.
    centre : (n, 2) float64, pixels
    direction : (n, 2) float64, unit
        Along the chain, so that the bright side is on the same hand throughout.
    extent : (n, 2) float64, pixels
        Abscissa of the first and the last end: along the direction, from the centre.
    rms : (n,) float64, pixels
        Robust residual of the edgels.
    sagitta : (n,) float64, pixels
        Offset of the middle from the chord of the ends, without the part that noise explains; its sign says to which
        side the segment bends.
    count : (n,) float64
        Edgels used in the fit.
    sigma : (n, 2) float64
        Of the line's offset at the centre, pixels, and of its slope, radians.
    magnitude : (n,) float64, grey levels per pixel
        Mean gradient.
    arc : (n,) int32
        Index of the ellipse that the segment is a part of, or -1 for a straight edge.
    """

    bounds: IntArray
    chain: IntArray
    centre: FloatArray
    direction: FloatArray
    extent: FloatArray
    rms: FloatArray
    sagitta: FloatArray
    count: FloatArray
    sigma: FloatArray
    magnitude: FloatArray
    arc: Int32Array

    def __len__(self) -> int:
        return len(self.bounds)

    @staticmethod
    def between(ends: FloatArray, sigma: float) -> Segments:
        """Straight segments whose ends are known, of no edgels: what another detector, or geometry, gives.

        Parameters
        ----------
        ends : (n, 2, 2) float64, pixels
            Start and end of each, the bright side on the same hand throughout.
        sigma : float, pixels
            Of the ends across the line.
        """
        count = len(ends)
        run = ends[:, 1] - ends[:, 0]
        length = np.maximum(np.hypot(run[:, 0], run[:, 1]), NOT_ZERO)
        return Segments(
            np.zeros((count, 2), np.int64),
            np.arange(count),
            ends.mean(axis=1),
            run / length[:, None],
            length[:, None] * [-0.5, 0.5],
            np.full(count, sigma),
            np.zeros(count),
            length,
            np.stack([np.full(count, sigma), 2.0 * sigma / length], axis=1),
            np.zeros(count),
            np.full(count, -1, np.int32),
        )

    def select(self, index: AnyArray) -> Segments:
        """A subset or reordering: (m,) indices or (n,) bool."""
        return Segments(*(getattr(self, f.name)[index] for f in fields(self)))

    def exchanged(self, index: IntArray, others: Segments, bounds: IntArray) -> Segments:
        """All of them with ``bounds`` (n, 2), those at indices (m,) exchanged for m others."""
        result = {f.name: getattr(self, f.name).copy() for f in fields(self)}
        for name, values in result.items():
            values[index] = getattr(others, name)
        return Segments(**{**result, 'bounds': bounds})

    @property
    def start(self) -> FloatArray:
        """(n, 2) float64, pixels."""
        return self.centre + self.extent[:, :1] * self.direction

    @property
    def end(self) -> FloatArray:
        """(n, 2) float64, pixels."""
        return self.centre + self.extent[:, 1:] * self.direction

    @property
    def length(self) -> FloatArray:
        """(n,) float64, pixels."""
        return self.extent[:, 1] - self.extent[:, 0]

    @property
    def normal(self) -> FloatArray:
        """(n, 2) float64, unit, across the segments towards their bright sides."""
        return np.stack([-self.direction[:, 1], self.direction[:, 0]], axis=1)

    def variance_at(self, abscissa: FloatArray) -> FloatArray:
        """(n,) float64, square pixels: of the lines' offset so far (n,), pixels, from their centres."""
        return np.asarray(self.sigma[:, 0] ** 2 + (self.sigma[:, 1] * abscissa) ** 2)

    def places(self, count: int) -> FloatArray:
        """(n, count, 2) float64, pixels: the middles of so many equal parts of each."""
        share = (np.arange(count) + 0.5) / count
        return np.asarray(self.start[:, None] + share[:, None] * (self.end - self.start)[:, None])

    def edgels(self, members: IntArray) -> IntArray:
        """(m,) int64: the numbers of the edgels of some of the segments (k,), ascending."""
        first, last = self.bounds[members].T
        size = last.max(initial=0) + 1
        begun = np.cumsum(np.bincount(first, minlength=size) - np.bincount(last, minlength=size))
        return np.flatnonzero(begun)

    @property
    def lines(self) -> line_kernels.Lines:
        """The lines as compiled loops take them."""
        arrays = (np.ascontiguousarray(a) for a in (self.centre, self.direction, self.extent, self.sigma))
        return line_kernels.Lines(*arrays)


def laid_out(count: IntArray) -> IntArray:
    """(n, 2) int: bounds [first, last) of runs of so many (n,) edgels that stand one after another."""
    last = np.cumsum(count)
    return np.stack([last - count, last], axis=1)


def ends_exchanged(values: AnyArray, flip: BoolArray) -> AnyArray:
    """(n, 2) values of both ends of n segments, the ends exchanged where ``flip`` (n,) says so."""
    return np.where(flip[:, None], values[:, ::-1], values)


def reversed_polarity(left: Segments, right: Segments, i: IntArray, j: IntArray) -> BoolArray:
    """Whether segments that show the same edge in both images are directed against each other.

    They are where the contrast changes its sign between the views. Rows have the same order in both images, columns
    need not.

    Parameters
    ----------
    left, right : Segments
        Of the left and the right image.
    i, j : (...) int
        Left and right segments that show the same edges.

    Returns
    -------
    (...) bool
    """
    t, u = left.direction[i], right.direction[j]
    rows = t[..., 1] * u[..., 1]
    steep = np.minimum(np.abs(t[..., 1]), np.abs(u[..., 1])) > LEVEL_SINE
    against: BoolArray = np.where(steep, rows, rows + t[..., 0] * u[..., 0]) < 0.0
    return against


def line_table(segments: Segments) -> FloatArray:
    """Segments as rows of numbers, for loops that take these.

    Parameters
    ----------
    segments : Segments
        n of one image.

    Returns
    -------
    (n, 8) float64
        Columns of centre, direction, extent, sigma.
    """
    return np.hstack([segments.centre, segments.direction, segments.extent, segments.sigma])


def fit_segments(e: Edgels, bounds: IntArray, chain: IntArray, sigma: float) -> Segments:
    """Lines through given runs of edgels.

    Parameters
    ----------
    e : Edgels
    bounds : (n, 2) int
        Runs [first, last).
    chain : (n,) int
        The chain of each run.
    sigma : float
        Pixels. Smoothing of the detector.

    Returns
    -------
    Segments
        All of them straight (arc -1).

    References
    ----------
    Thesis 3.10.1.
    """
    x, y = np.ascontiguousarray(e.position[:, 0]), np.ascontiguousarray(e.position[:, 1])
    run = line_kernels.Run(x, y, e.sigma_position, e.width, e.bias, e.magnitude)
    fitted: line_kernels.FittedLines = line_kernels.fit_lines(run, bounds, sigma)
    return Segments(bounds, chain, *fitted, np.full(len(bounds), -1, np.int32))
