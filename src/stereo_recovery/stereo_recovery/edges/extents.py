"""Where straight edges begin and end: the part that both images show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray

from ..estimation.settings import END_SHARE, LOOSE_END_SIGMA, SAME_PLACE, STEEP
from ..matching.stereo_segments import StereoSegments
from .settings import LOST


@dataclass(frozen=True, eq=False)
class Extents:
    """The ends of n edges along their left segments.

    Attributes
    ----------
    abscissa, sigma : (n, 2) float64, pixels
    in_both : (n, 2) bool
        The end is the same corner in both images.
    """

    abscissa: FloatArray
    sigma: FloatArray
    in_both: BoolArray


def _seen_by_right(seen: StereoSegments, x: FloatArray) -> FloatArray:
    """(n, 2) abscissas along the left segments of the right segments' ends: by row, or by column if they are level."""
    left, right = seen.segments
    i, j = seen.index
    centre, direction = left.centre[i][:, None], left.direction[i][:, None]
    point = seen.points[1]
    by_row = np.abs(right.direction[j, 1:2]) > STEEP
    down, along = direction[..., 1], direction[..., 0] - x[:, 1:2]
    down, along = (np.where(np.abs(run) < 1e-3, 1e-3, run) for run in (down, along))
    result: FloatArray = np.where(
        by_row, (point[..., 1] - centre[..., 1]) / down, (point[..., 0] - centre[..., 0] + x[:, :1]) / along
    )
    return result


def extents(seen: StereoSegments, x: FloatArray) -> Extents:
    """Where the edges end.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    x : (n, 2)
        Their disparities a + b s.
    """
    own, other = seen.ends
    mine, its = own.abscissa, _seen_by_right(seen, x)
    corner, its_corner = own.neighbour >= 0, other.neighbour >= 0
    hidden = own.t_junction | other.t_junction
    inner = np.stack([np.maximum(mine[:, 0], its[:, 0]), np.minimum(mine[:, 1], its[:, 1])], axis=1)
    # Two corners that agree are one corner; the left image's is where its line is known.
    same = corner & (np.abs(its - mine) < SAME_PLACE) & ~hidden
    abscissa = np.where(same, mine, inner)
    cut = ~same & (inner != mine)
    told, sigma = np.where(cut, its_corner, corner), np.where(cut, other.sigma, own.sigma)
    sigma = np.where(told, sigma, LOOSE_END_SIGMA)
    # A chain that just stops is lost, not hidden: the edge goes on to the corner that the other image shows.
    span = np.maximum(inner[:, 1] - inner[:, 0], 1.0)[:, None]
    lost_right = cut & corner & ~own.t_junction & ~its_corner
    lost_left = ~corner & (inner == mine) & its_corner & ~other.t_junction
    lost = (lost_right | lost_left) & (np.abs(its - mine) < np.maximum(LOST, END_SHARE * span))
    abscissa = np.where(lost, np.where(lost_right, mine, its), abscissa)
    sigma = np.where(lost, np.where(lost_right, own.sigma, other.sigma), sigma)
    return Extents(abscissa, sigma, same & its_corner)
