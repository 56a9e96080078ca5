"""Pieces of candidate curves that lie on a solid's boundary, and runs of them that are one crease.

A piece ends wherever another surface crosses its curve, so the neighbourhood is the same all along it and is classified
at one point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .conics import conic_cuts, positions
from .lines import line_cuts
from .neighbourhood import Branches, classify, faces_through
from .settings import INSIDE, ON_SURFACE, REAL_NAPPE, SHORTEST_ARC
from .surfaces import SurfaceTable


@dataclass(frozen=True, eq=False)
class Pieces:
    """n pieces of lines, conics or space curves, normalised frame, ordered along each curve.

    Parameters
    ----------
    curve : (n,) int
        Row of the line or curve.
    low, high : (n,) float64
        Its parameters: length on a line, else radians; high may pass 2 pi.
    middle, tangent : (n, 3) float64
        A point of the piece and the unit tangent there.
    shortest : float
        Parameters closer than this are one.
    branches : Branches
        The boundary's branches; ``branches.point`` is a row of the pieces.
    """

    curve: np.ndarray
    low: np.ndarray
    high: np.ndarray
    middle: np.ndarray
    tangent: np.ndarray
    shortest: float
    branches: Branches


@dataclass(frozen=True, eq=False)
class Runs:
    """Maximal creases: curve (r,) int; low, high (r,) parameters; piece (r,) int, the longest piece of each."""

    curve: np.ndarray
    low: np.ndarray
    high: np.ndarray
    piece: np.ndarray

    def __len__(self) -> int:
        return len(self.curve)


def line_pieces(table: SurfaceTable, point: np.ndarray, direction: np.ndarray, faces: int = 2) -> Pieces:
    """The pieces of lines that lie on a solid's boundary.

    Parameters
    ----------
    table : SurfaceTable
    point, direction : (n, 3) float64, normalised
        Of the lines; unit directions.
    faces : int
        How many surfaces of the boundary a piece lies on at least: 2 for creases, 1 for lines on a face.
    """
    cuts = line_cuts(table, point, direction)
    low, high = cuts[:, :-1], cuts[:, 1:]
    line, column = np.nonzero(high - low > ON_SURFACE)
    low, high = low[line, column], high[line, column]
    middle = point[line] + (low + INSIDE * (high - low))[:, None] * direction[line]
    return _kept(table, line, low, high, middle, direction[line], ON_SURFACE, faces)


def conic_pieces(table: SurfaceTable, conic: np.ndarray, extra: np.ndarray, faces: int = 2) -> Pieces:
    """The same for conics (c, 4, 3), which the extra planes (k, 4) cut as well."""
    curves, lows, highs = [np.zeros(0, int)], [np.zeros(0)], [np.zeros(0)]
    for k, cuts in enumerate(conic_cuts(table, conic, extra)):
        low = cuts if len(cuts) else np.zeros(1)
        high = np.append(low[1:], low[0] + 2.0 * np.pi)
        keep = high - low > SHORTEST_ARC
        curves.append(np.full(keep.sum(), k))
        lows.append(low[keep])
        highs.append(high[keep])
    curve, low, high = np.concatenate(curves), np.concatenate(lows), np.concatenate(highs)
    middle, tangent, nappe = positions(conic[curve], low + INSIDE * (high - low))
    real = (nappe > REAL_NAPPE) & np.isfinite(tangent).all(axis=1)
    return _kept(table, curve[real], low[real], high[real], middle[real], tangent[real], SHORTEST_ARC, faces)


def _kept(
    table: SurfaceTable,
    curve: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    middle: np.ndarray,
    tangent: np.ndarray,
    shortest: float,
    faces: int,
) -> Pieces:
    """The pieces that lie on at least this many surfaces of the boundary, classified."""
    keep = faces_through(table, middle).sum(axis=1) >= faces
    curve, low, high, middle, tangent = curve[keep], low[keep], high[keep], middle[keep], tangent[keep]
    return Pieces(curve, low, high, middle, tangent, shortest, classify(table, middle, tangent))


def creases(pieces: Pieces, period: float | None = None) -> Runs:
    """Runs of crease pieces that touch and where the same faces meet.

    A run ends at a vertex where the faces change, even if a crease goes straight on. On closed curves (period) a run
    may pass the end of the parameter's range; one that is the whole curve keeps a length of one period.
    """
    signature = pieces.branches.signature
    index = np.nonzero(pieces.branches.crease)[0]
    first, last = touching(
        pieces.curve[index], pieces.low[index], pieces.high[index], signature[index], 2.0 * pieces.shortest
    )
    first, last = index[first], index[last]
    curve, low, high = pieces.curve[first], pieces.low[first].copy(), pieces.high[last].copy()
    keep = np.ones(len(first), bool)
    if period is not None:
        for k in np.unique(curve):
            a, b = np.nonzero(curve == k)[0][[0, -1]]
            if (
                a != b
                and low[a] + period - high[b] <= 2.0 * pieces.shortest
                and signature[first[a]] == signature[last[b]]
            ):
                high[b], keep[a] = high[a] + period, False
    length = pieces.high - pieces.low
    longest = np.array([f + int(np.argmax(length[f : g + 1])) for f, g in zip(first, last)], int)
    return Runs(curve[keep], low[keep], high[keep], longest[keep])


def touching(
    curve: np.ndarray, low: np.ndarray, high: np.ndarray, signature: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """First and last member of each run of rows that continue each other; rows are ordered along each curve."""
    apart = (curve[1:] != curve[:-1]) | (low[1:] - high[:-1] > slack) | (signature[1:] != signature[:-1])
    edge = np.ones(min(len(curve), 1), bool)
    return np.nonzero(np.concatenate([edge, apart]))[0], np.nonzero(np.concatenate([apart, edge]))[0]
