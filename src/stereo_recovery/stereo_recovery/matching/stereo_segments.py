"""Matched segments of a pair, edge by edge, and where their ends are in both images."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.junctions import Junctions, find_junctions
from ..detection.segments import Segments, ends_exchanged, reversed_polarity
from .matches import Matches, match_of


@dataclass(frozen=True, eq=False)
class StereoSegments:
    """The matched segments of a pair, edge by edge, and where their ends are in both images.

    Attributes
    ----------
    matches : Matches
        n edges.
    segments : (Segments, Segments)
    junctions : (Junctions, Junctions)
    stand_ins : int
        So many of the right segments, the last ones, are none: they stand for what a further camera shows of an edge.
    """

    matches: Matches
    segments: tuple[Segments, Segments]
    junctions: tuple[Junctions, Junctions]
    stand_ins: int = 0

    @classmethod
    def of(cls, matches: Matches, segments: tuple[Segments, Segments]) -> StereoSegments:
        """Matched segments, with the junctions that each image shows."""
        return cls(matches, segments, (find_junctions(segments[0]), find_junctions(segments[1])))

    @property
    def index(self) -> tuple[AnyArray, AnyArray]:
        """(n,) each: the edges' left and right segments."""
        return self.matches.left, self.matches.right

    @cached_property
    def flip(self) -> BoolArray:
        """(n,) whether the right segment's last end is where the left one's first is."""
        return reversed_polarity(*self.segments, *self.index)

    @cached_property
    def straight(self) -> BoolArray:
        """(n,) whether neither image shows the edge as a part of an arc."""
        left, right = (side.arc[index] < 0 for side, index in zip(self.segments, self.index))
        return left & right

    @property
    def paired(self) -> BoolArray:
        """(n,) whether the right image itself shows the edge."""
        return np.asarray(self.matches.right < len(self.segments[1]) - self.stand_ins)

    @cached_property
    def ends(self) -> tuple[Junctions, Junctions]:
        """The junctions at the ends of the left and of the right segments, in the left segments' order."""
        here, there = self.junctions
        i, j = self.index
        return (
            Junctions(*(getattr(here, f.name)[i] for f in fields(Junctions))),
            Junctions(*(ends_exchanged(getattr(there, f.name)[j], self.flip) for f in fields(Junctions))),
        )

    @cached_property
    def points(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2, 2) each, pixels: the ends in the left and the right image."""
        left, right = (
            side.centre[index][:, None] + ends.abscissa[..., None] * side.direction[index][:, None]
            for side, index, ends in zip(self.segments, self.index, self.ends)
        )
        return left, right

    @cached_property
    def chain_ends(self) -> tuple[FloatArray, FloatArray]:
        """(n, 2, 2) each, pixels: where the chains end, whatever they meet."""
        left, right = (
            np.stack([side.start[index], side.end[index]], axis=1) for side, index in zip(self.segments, self.index)
        )
        return left, np.where(self.flip[:, None, None], right[:, ::-1], right)

    @cached_property
    def edge_of(self) -> tuple[IntArray, IntArray]:
        """The best edge that each left and each right segment shows, or -1."""
        return match_of(self.matches.left, len(self.segments[0])), match_of(self.matches.right, len(self.segments[1]))

    def neighbours(self, image: int) -> IntArray:
        """(n, 2) the edges whose segments are met at the ends in an image, or -1."""
        k = self.ends[image].neighbour
        return np.where(k >= 0, self.edge_of[image][k], -1)
