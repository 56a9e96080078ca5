"""Pairs of segments of the two images that show the same edge."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from msgs_py.numeric.typed import AnyArray, FloatArray, Int32Array, IntArray


@dataclass(frozen=True, eq=False)
class Matches:
    """k pairs of segments, best first.

    Attributes
    ----------
    left, right : (k,) int32
        Indices of segments of the left and the right image.
    disparity : (k, 3) float64, pixels
        At the left segment's start, middle and end.
    rows : (k, 2) float64, pixels
        First and last row that both segments cover.
    belief : (k,) float64, 0..1
        Share of the strength of the strongest competing pair; 1 when nothing is stronger.
    """

    left: Int32Array
    right: Int32Array
    disparity: FloatArray
    rows: FloatArray
    belief: FloatArray

    @classmethod
    def empty(cls) -> Matches:
        """No pairs."""
        return cls(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.left)

    @staticmethod
    def concatenate(parts: list[Matches]) -> Matches:
        """All of them, in their order."""
        return Matches(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Matches)))

    def select(self, index: AnyArray) -> Matches:
        """A subset or reordering: (m,) indices or (k,) bool."""
        return Matches(*(getattr(self, f.name)[index] for f in fields(self)))


def match_of(segment: Int32Array, count: int) -> IntArray:
    """The best pair that each segment of one image is in.

    Parameters
    ----------
    segment : (k,) int
        The segments of the pairs in that image, best pair first: ``matches.left`` or ``matches.right``.
    count : int
        How many segments that image has.

    Returns
    -------
    (count,) int64
        Index of the pair, or -1.

    Examples
    --------
    >>> match_of(np.array([2, 0, 2]), 4).tolist()
    [1, -1, 0, -1]
    """
    result = np.full(count, -1)
    result[segment[::-1]] = np.arange(len(segment))[::-1]
    return result
