"""Junctions: where the ends of segments meet other segments, and which short segments are spurious (thesis 3.10.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import junction_kernels
from .segments import Segments, line_table


@dataclass(frozen=True, eq=False)
class Junctions:
    """Where each end of each segment really is: on the line it runs into.

    abscissa : (n, 2) float64, pixels along the segment from its centre: of its first and last end, corrected where it
        has a neighbour
    neighbour : (n, 2) int32, the segment it meets there, or -1
    t_junction : (n, 2) bool, whether the neighbour goes on beyond the meeting, so that one may hide the other
    sigma : (n, 2) float64, pixels, of the abscissa
    """

    abscissa: np.ndarray
    neighbour: np.ndarray
    t_junction: np.ndarray
    sigma: np.ndarray


def spurious(segments: Segments) -> np.ndarray:
    """(n,) bool: segments that are too short to mean anything, or only show the end of a longer one."""
    short = junction_kernels.spurious(line_table(segments), 16.0, 16.0, 2.5)
    return (segments.length < 3.0) | ((segments.arc < 0) & short)


def find_junctions(segments: Segments, gap: float = 18.0) -> Junctions:
    """Intersect each segment with the one its ends run into, at most ``gap`` pixels away (less at square corners)."""
    if len(segments) == 0:
        return Junctions(np.zeros((0, 2)), np.zeros((0, 2), np.int32), np.zeros((0, 2), bool), np.zeros((0, 2)))
    return Junctions(*junction_kernels.find_junctions(line_table(segments), gap))
