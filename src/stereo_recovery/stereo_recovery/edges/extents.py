"""Where straight edges begin and end: the part that both images show, and as far beyond as the pictures go on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from ..estimation.settings import LOOSE_END_SIGMA, SAME_PLACE, STEEP
from ..matching.stereo_segments import StereoSegments
from .following_kernels import Courses, follow


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
    """Where the part of edges that both images' segments show ends.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    x : (n, 2)
        Their disparities a + b s.
    """
    return _in_both(seen, _seen_by_right(seen, x))


def _in_both(seen: StereoSegments, its: FloatArray) -> Extents:
    """As :func:`extents`; its : (n, 2) where the right image's segments end, along the left ones."""
    own, other = seen.ends
    mine = own.abscissa
    corner, its_corner = own.neighbour >= 0, other.neighbour >= 0
    hidden = own.t_junction | other.t_junction
    inner = np.stack([np.maximum(mine[:, 0], its[:, 0]), np.minimum(mine[:, 1], its[:, 1])], axis=1)
    # Two corners that agree are one corner; the left image's is where its line is known.
    same = corner & (np.abs(its - mine) < SAME_PLACE) & ~hidden
    abscissa = np.where(same, mine, inner)
    cut = ~same & (inner != mine)
    told, sigma = np.where(cut, its_corner, corner), np.where(cut, other.sigma, own.sigma)
    return Extents(abscissa, np.where(told, sigma, LOOSE_END_SIGMA), same & its_corner)


def followed(
    seen: StereoSegments, found: tuple[FloatArray, FloatArray], greys: tuple[Float32Array, Float32Array]
) -> Extents:
    """Where edges end, when the pictures are asked whether they go on where a chain just stops.

    A chain is lost where its contrast fades, in one image sooner than in the other. An end is no such stop where it is
    a corner of the left image, or one that both images show.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    found : (n, 2), (n, 2, 2)
        Their disparities a + b s, and the covariance.
    greys : (h, w) float32, (h, w) float32
        The pictures.
    """
    own, other = seen.ends
    its = _seen_by_right(seen, found[0])
    ends = _in_both(seen, its)
    outward = np.array([-1.0, 1.0])
    stop = np.stack([own.abscissa, its])
    farther = outward * stop[1] > outward * stop[0]
    stop = outward * np.maximum(outward * stop, outward * ends.abscissa)
    corner, its_corner = own.neighbour >= 0, other.neighbour >= 0
    # What hides an edge from the left eye ends it; from the right one alone, it is no end of what the left one sees.
    shut = np.stack([corner | own.t_junction, its_corner & farther]) | ends.in_both | ~seen.paired[:, None]
    lines = seen.segments[0].lines, seen.segments[1].lines
    taken = seen.edge_of[0] >= 0, seen.edge_of[1] >= 0
    index = np.stack(seen.index).astype(np.int64)
    courses = Courses(lines, index, *found, stop, shut, np.stack([corner, its_corner]), taken)
    abscissa = follow(greys, courses, ends.abscissa)
    goes_on = abscissa != ends.abscissa
    # At a stop that the farther-sighted image shows, the edge ends as it does there.
    far = np.where(farther, stop[1], stop[0])
    reached = goes_on & (np.abs(abscissa - far) < 1.0)
    at_corner = reached & np.where(farther, its_corner, corner)
    # Elsewhere it may end anywhere on the way.
    on_the_way = np.hypot(LOOSE_END_SIGMA, (abscissa - ends.abscissa) / np.sqrt(3.0))
    its_sigma = np.where(at_corner, np.where(farther, other.sigma, own.sigma), on_the_way)
    return replace(ends, abscissa=np.where(reached, far, abscissa), sigma=np.where(goes_on, its_sigma, ends.sigma))
