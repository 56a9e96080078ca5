"""The boundary of a solid, straight from its CSG tree: where its creases run and which faces meet there.

Candidate curves (``lines``) are cut wherever another surface crosses them, so that the solid looks the same along all
of a piece; one point of each piece is then classified by its neighbourhood, and pieces of crease that continue each
other are joined. In the manner of Requicha & Voelcker (Boolean operations in solid modeling, 1985); this is what thesis
4.12 and 7.4 leave as future work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet

from .lines import line_cuts, plane_pairs
from .neighbourhood import Branches, classify, faces_through
from .solid import Solid
from .surfaces import ON, SurfaceTable, compile_surfaces


@dataclass(frozen=True, eq=False)
class LinePieces:
    """Pieces of lines that lie on the boundary, normalised frame, ordered along each line.

    point, direction : (n, 3) of the line; low, high : (n,) its parameters; line : (n,) int
    branches : the boundary's branches, whose ``point`` indexes the pieces
    """

    line: np.ndarray
    point: np.ndarray
    direction: np.ndarray
    low: np.ndarray
    high: np.ndarray
    branches: Branches

    @property
    def start(self) -> np.ndarray:
        return self.point + self.low[:, None] * self.direction

    @property
    def end(self) -> np.ndarray:
        return self.point + self.high[:, None] * self.direction


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a solid, model frame, metres.

    edge_start, edge_end : (e, 3) float64: maximal straight creases
    notices : what could not be given, in words
    """

    edge_start: np.ndarray
    edge_end: np.ndarray
    table: SurfaceTable
    notices: tuple[str, ...] = ()

    @property
    def features(self) -> FeatureSet:
        """The matching features: edges, then curves, then axes."""
        return FeatureSet.from_edges(self.edge_start, self.edge_end)


def evaluate(solid: Solid) -> Boundary:
    """Evaluate the boundary of a solid."""
    table = compile_surfaces(solid)
    pieces = line_pieces(table, *plane_pairs(table))
    first, last = join(pieces.line, pieces.low, pieces.high, pieces.branches)
    return Boundary(table.metres(pieces.start[first]), table.metres(pieces.end[last]), table)


def line_pieces(table: SurfaceTable, point: np.ndarray, direction: np.ndarray) -> LinePieces:
    """Cut lines at the leaves and keep what lies on the boundary."""
    cuts = line_cuts(table, point, direction)
    low, high = cuts[:, :-1], cuts[:, 1:]
    line, column = np.nonzero(high - low > ON)
    low, high = low[line, column], high[line, column]
    middle = point[line] + (0.5 * (low + high))[:, None] * direction[line]
    keep = faces_through(table, middle).sum(axis=1) >= 2
    line, low, high, middle = line[keep], low[keep], high[keep], middle[keep]
    branches = classify(table, middle, direction[line])
    return LinePieces(line, point[line], direction[line], low, high, branches)


def join(curve: np.ndarray, low: np.ndarray, high: np.ndarray, branches: Branches) -> tuple[np.ndarray, np.ndarray]:
    """Runs of crease pieces that touch and where the same faces meet: first and last piece of each run.

    Pieces are ordered along each curve. A run ends at a vertex where the faces change, even if a crease goes straight on.
    """
    index = np.nonzero(branches.crease)[0]
    if not len(index):
        return index, index
    before, after = index[:-1], index[1:]
    apart = ((curve[after] != curve[before]) | (low[after] - high[before] > 2.0 * ON)
             | (branches.signature[after] != branches.signature[before]))
    return index[np.concatenate([[True], apart])], index[np.concatenate([apart, [True]])]
