"""Where straight edges begin and end: the part that both images show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments
from ..estimation.settings import LOOSE_END_SIGMA, STEEP
from ..matching.stereo_segments import StereoSegments
from .settings import FAR_GAP, FAR_SIGMA, LOST, LOST_SHARE, ONE_CORNER, SHORT_EDGE, SHORT_SIGMA, T_SIGMA


@dataclass(frozen=True, eq=False)
class Extents:
    """The ends of n edges along their left segments.

    Attributes
    ----------
    abscissa, sigma : (n, 2) float64, pixels
    fixed : (n, 2) bool
        The end is a corner.
    in_both : (n, 2) bool
        The end is the same corner in both images.
    """

    abscissa: FloatArray
    sigma: FloatArray
    fixed: BoolArray
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
    left = seen.segments[0]
    own, other = seen.ends
    mine, its = own.abscissa, _seen_by_right(seen, x)
    corner, its_corner = own.neighbour >= 0, other.neighbour >= 0
    hidden = own.t_junction | other.t_junction
    inner = np.stack([np.maximum(mine[:, 0], its[:, 0]), np.minimum(mine[:, 1], its[:, 1])], axis=1)
    # Two corners that agree are one corner; the left image's is where its line is known.
    same = corner & (np.abs(its - mine) < ONE_CORNER) & ~hidden
    abscissa = np.where(same, mine, inner)
    cut = ~same & (inner != mine)
    sigma = np.hypot(own.sigma, _doubt(left, seen.junctions[0])[seen.index[0]])
    sigma = np.where(cut, np.where(its_corner, other.sigma, LOOSE_END_SIGMA), np.where(corner, sigma, LOOSE_END_SIGMA))
    fixed = corner & ~cut
    # A chain that just stops is lost, not hidden: the edge goes on to the corner that the other image shows.
    span = np.maximum(inner[:, 1] - inner[:, 0], 1.0)[:, None]
    lost_right = cut & corner & ~own.t_junction & ~its_corner
    lost_left = ~corner & (inner == mine) & its_corner & ~other.t_junction
    lost = (lost_right | lost_left) & (np.abs(its - mine) < np.maximum(LOST, LOST_SHARE * span))
    abscissa = np.where(lost, np.where(lost_right, mine, its), abscissa)
    sigma = np.where(lost, np.where(lost_right, own.sigma, other.sigma), sigma)
    return Extents(abscissa, sigma, fixed | lost, same & its_corner)


def _doubt(segments: Segments, junctions: Junctions) -> FloatArray:
    """(n, 2) float64, pixels: sigma of a corner beyond that of its lines: short, hidden or far edges."""
    other = junctions.neighbour
    x = segments.centre[:, None] + junctions.abscissa[..., None] * segments.direction[:, None]
    along = ((x - segments.centre[other]) * segments.direction[other]).sum(axis=2)
    beyond = np.maximum(segments.extent[other, 0] - along, along - segments.extent[other, 1])
    short = np.minimum(segments.length[:, None], segments.length[other]) < SHORT_EDGE
    variance = (
        (T_SIGMA * junctions.t_junction) ** 2 + (SHORT_SIGMA * short) ** 2 + (FAR_SIGMA * (beyond > FAR_GAP)) ** 2
    )
    extra: FloatArray = np.sqrt(variance) * (other >= 0)
    return extra
