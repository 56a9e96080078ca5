"""Junctions: where the ends of segments meet other segments, and which short segments are spurious (thesis 3.10.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from . import junction_kernels
from .segments import Segments
from .settings import JUNCTION_GAP, LEAST_LENGTH


@dataclass(frozen=True, eq=False)
class Junctions:
    """Where both ends of n segments are: at the crossing with the line that they run into, where there is one.

    Attributes
    ----------
    abscissa : (n, 2) float64, pixels
        Of the first and the last end along the segment, from its centre; at the crossing where there is a neighbour.
    neighbour : (n, 2) int32
        The segment that is met there, or -1.
    t_junction : (n, 2) bool
        Whether the neighbour goes on beyond the crossing, so that one of the two edges may hide the other.
    sigma : (n, 2) float64, pixels
        Of the abscissa.
    """

    abscissa: FloatArray
    neighbour: Int32Array
    t_junction: BoolArray
    sigma: FloatArray


def spurious(segments: Segments) -> BoolArray:
    """Which segments are too short to mean anything, or only show how the end of a longer one bends.

    Parameters
    ----------
    segments : Segments
        n of one image.

    Returns
    -------
    (n,) bool
        Of segments of arcs only the shortest are spurious.
    """
    result: BoolArray = (segments.length < LEAST_LENGTH) | (
        (segments.arc < 0) & junction_kernels.spurious(segments.lines)
    )
    return result


def find_junctions(segments: Segments, gap: float = JUNCTION_GAP) -> Junctions:
    """Intersect each segment with the one that its ends run into.

    Parameters
    ----------
    segments : Segments
        n of one image.
    gap : float
        Pixels. Largest distance of an end from the crossing; less at square corners.

    Returns
    -------
    Junctions
        Of both ends of every segment.

    References
    ----------
    Thesis 3.10.3.
    """
    if len(segments) == 0:
        return Junctions(np.zeros((0, 2)), np.zeros((0, 2), np.int32), np.zeros((0, 2), bool), np.zeros((0, 2)))
    return Junctions(*junction_kernels.find_junctions(segments.lines, gap))
