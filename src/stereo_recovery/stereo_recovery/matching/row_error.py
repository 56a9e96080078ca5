"""How the rows of a rectified pair disagree, from what the pair itself shows.

Rectification leaves an error: a camera that has moved a little since it was calibrated shows its rows shifted and
turned. Corners that both images show, edges along the rows, and other witnesses that are given should be at one height;
what they say is fitted by a function linear in column and row, and what is left over is the sigma of single rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.settings import DECISIVE, NOT_ZERO
from msgs_py.numeric.typed import FloatArray

from ..detection.conics import Ellipse
from ..detection.edgels import Edgels
from ..detection.junctions import find_junctions
from .row_kernels import robust_fit, single_sigma
from .settings import LEVEL_DISPARITY, LEVEL_ROW, ROW_OFFSET_SIGMA, ROW_SHIFT_MOST, ROW_TURN_SIGMA, SEEN_AS_ONE
from .stereo_segments import StereoSegments


@dataclass(frozen=True, eq=False)
class RowError:
    """Pixels by which the right image's rows lie below the left's: offset + turn . (point - centre) / half size.

    Or by which its columns lie to the right of where another camera has them.

    Attributes
    ----------
    offset : float, pixels
    turn : (2,) float64, pixels
        What it gains from the middle to the border of the image, along columns and rows.
    centre, half : (2,) float64, pixels
        Of the right image.
    sigma : float, pixels
        Of what single rows differ from that, and of what is not known of it.
    count : int
        Corners and edges that it was fitted to.
    axis : int
        1 of rows, 0 of columns.
    """

    offset: float
    turn: FloatArray
    centre: FloatArray
    half: FloatArray
    sigma: float
    count: int
    axis: int = 1

    @property
    def rms(self) -> float:
        """Pixels, root mean square over the image, of the error itself, single rows' not counted."""
        return math.sqrt(self.offset**2 + float(self.turn @ self.turn) / 3.0)

    def at(self, points: FloatArray) -> FloatArray:
        """(...) float64, pixels: the error at points (..., 2) of the right image."""
        return np.asarray(self.offset + ((points - self.centre) / self.half) @ self.turn)

    def without(self, points: FloatArray) -> FloatArray:
        """(..., 2) float64, pixels: points of the right image where they are without the error."""
        moved = points.copy()
        moved[..., self.axis] -= self.at(points)
        return moved

    def aligned(self, seen: StereoSegments) -> StereoSegments:
        """A pair without the error of its right image."""
        right = seen.segments[1]
        if len(right) == 0 or not (self.offset or self.turn.any()):
            return seen
        start, end, centre = (self.without(points) for points in (right.start, right.end, right.centre))
        run = end - start
        direction = run / np.maximum(np.hypot(run[:, 0], run[:, 1]), NOT_ZERO)[:, None]
        extent = np.stack([((point - centre) * direction).sum(axis=1) for point in (start, end)], axis=1)
        right = replace(right, centre=centre, direction=direction, extent=extent)
        junctions = seen.junctions[0], find_junctions(right)
        return replace(seen, segments=(seen.segments[0], right), junctions=junctions)

    def aligned_edgels(self, right: Edgels) -> Edgels:
        """The right image's edgels at the left image's rows."""
        return replace(right, position=self.without(right.position))

    def aligned_ellipses(self, right: Sequence[Ellipse]) -> list[Ellipse]:
        """The right image's ellipses at the left image's rows."""
        slope = self.turn / self.half
        forward = np.eye(3)
        forward[1, :2] -= slope
        forward[1, 2] -= self.offset - slope @ self.centre
        back = np.linalg.inv(forward)
        return [replace(ellipse, conic=back.T @ ellipse.conic @ back) for ellipse in right]


class RowWitnesses(NamedTuple):
    """Places that both images show, and should show at one height.

    Attributes
    ----------
    point : (k, 2) float64, pixels
        Of the right image.
    off, sigma : (k,) float64, pixels
        By how much they are lower than in the left one.
    """

    point: FloatArray
    off: FloatArray
    sigma: FloatArray


def _witnesses(seen: StereoSegments) -> RowWitnesses:
    """Corners that both images show, and edges along the rows."""
    left, right = seen.segments
    i, j = seen.index
    p, q = seen.points
    mine, other = seen.ends
    neighbours = seen.neighbours(0), seen.neighbours(1)
    corner = (neighbours[0] >= 0) & (neighbours[0] == neighbours[1]) & ~mine.t_junction & ~other.t_junction
    # Parts of arcs end where their chains happen to be split.
    corner &= seen.straight[:, None] & seen.straight[neighbours[0]]
    variance = np.zeros(corner.shape)
    for side, index, ends in ((left, i, mine), (right, j, other)):
        u, v = side.direction[index].T
        variance += (ends.sigma * v[:, None]) ** 2 + ((side.sigma[index, 0] * u) ** 2)[:, None]
    e, end = np.nonzero(corner)
    # Two edges meet in one corner, which each of them shows: it is counted once, by the one that knows it better.
    first = np.argsort(variance[e, end], kind='stable')
    pair = np.sort(np.stack([e, neighbours[0][e, end]], axis=1), axis=1)[first]
    kept = first[np.unique(pair, axis=0, return_index=True)[1]]
    e, end = e[kept], end[kept]
    # A level line has one height, however far apart its matched ends are.
    along, across = left.direction[i].T
    level = np.flatnonzero((np.abs(across) < LEVEL_ROW) & (np.abs(right.direction[j, 1]) < LEVEL_ROW) & seen.straight)
    middle = 0.5 * (left.start + left.end)[i[level]]
    column = middle[:, 0] - seen.matches.disparity[level, 1]
    u, v = right.direction[j[level]].T
    row = right.centre[j[level], 1] + (column - right.centre[j[level], 0]) * v / u
    level_variance = (
        left.sigma[i[level], 0] ** 2 + right.sigma[j[level], 0] ** 2 + (across[level] * LEVEL_DISPARITY) ** 2
    )
    return RowWitnesses(
        np.concatenate([q[e, end], np.stack([column, row], axis=1)]),
        np.concatenate([(q - p)[e, end, 1], row - middle[:, 1]]),
        np.sqrt(np.concatenate([variance[e, end], level_variance])),
    )


def row_error(seen: StereoSegments, size: tuple[int, int], least: float, more: RowWitnesses | None = None) -> RowError:
    """The rows' error of a pair.

    Parameters
    ----------
    seen : StereoSegments
        Matched segments, most of them rightly.
    size : (int, int), pixels
        Width and height of the right image.
    least : float, pixels
        Least sigma of single rows.
    more : RowWitnesses, optional
        Beside corners and level edges.
    """
    return fitted_error(row_witnesses(seen, more), size, least)


def row_witnesses(seen: StereoSegments, *more: RowWitnesses | None) -> RowWitnesses:
    """Corners and edges along the rows that a pair shows, and more that is given."""
    every = [_witnesses(seen), *(one for one in more if one is not None)]
    return RowWitnesses(*(np.concatenate(some) for some in zip(*every)))


def fitted_error(witnesses: RowWitnesses, size: tuple[int, int], least: float, axis: int = 1) -> RowError:
    """The error that witnesses tell, some of which are none.

    Parameters
    ----------
    witnesses : RowWitnesses
    size : (int, int), pixels
        Width and height of the right image.
    least : float, pixels
        Least sigma of single rows or columns.
    axis : int
        1 of rows, 0 of columns.
    """
    half = 0.5 * np.array(size, float)
    centre = half - 0.5
    point, off, sigma = near_rows(witnesses)
    columns = np.column_stack([np.ones(len(point)), (point - centre) / half])
    prior = np.diag(np.array([ROW_OFFSET_SIGMA, ROW_TURN_SIGMA, ROW_TURN_SIGMA]) ** -2.0)
    value, single = robust_fit(columns, off, sigma, prior, least)
    left_over, by_chance = off - columns @ value, single_sigma(off, sigma, least)
    told = information(columns, left_over, sigma, single)
    # What an exact rig, single rows and a few wrong corners explain as well is no error, by Laplace's approximation.
    gain = _log_likelihood(left_over, sigma, single) - _log_likelihood(off, sigma, by_chance)
    spent = value @ prior @ value + np.linalg.slogdet(np.eye(3) + np.linalg.solve(prior, told))[1]
    if gain - 0.5 * spent < DECISIVE:
        return RowError(0.0, np.zeros(2), centre, half, by_chance, len(off), axis)
    # What few witnesses leave open counts where they are, as if each row had its own.
    left_open = np.linalg.inv(prior + told)
    common = float(np.einsum('ki,ij,kj->', columns, left_open, columns)) / len(off)
    return RowError(float(value[0]), value[1:], centre, half, math.sqrt(single**2 + common), len(off), axis)


def near_rows(witnesses: RowWitnesses) -> RowWitnesses:
    """Those that may be of one point, by their rows."""
    near = np.abs(witnesses.off) < ROW_SHIFT_MOST
    return RowWitnesses(*(each[near] for each in witnesses))


def information(
    columns: FloatArray, left_over: FloatArray, sigma: FloatArray, single: float | FloatArray
) -> FloatArray:
    """(n, n) float64: what witnesses say of the parameters, each as far as it is one."""
    right, wrong = _likelihoods(left_over, sigma, single)
    weight = right / (right + wrong) / (sigma**2 + single**2)
    return np.asarray((columns * weight[:, None]).T @ columns)


def _log_likelihood(left_over: FloatArray, sigma: FloatArray, single: float) -> float:
    """Of residuals (k,) of witnesses, some of which are none; see :func:`_likelihoods`."""
    right, wrong = _likelihoods(left_over, sigma, single)
    return float(np.log(right + wrong).sum())


def _likelihoods(left_over: FloatArray, sigma: FloatArray, single: float | FloatArray) -> tuple[FloatArray, float]:
    """Of residuals (k,), pixels: those of witnesses, and of what is none and lies anywhere in the range.

    single : sigma of single rows, pixels, of all or of each
    """
    variance = sigma**2 + single**2
    right = SEEN_AS_ONE * np.exp(-0.5 * left_over**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return right, (1.0 - SEEN_AS_ONE) / (2.0 * ROW_SHIFT_MOST)
