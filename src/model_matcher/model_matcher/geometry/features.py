"""Records of features as compiled functions take them.

A feature is a row of nine numbers: mid point (3), unit direction (3), half length, major and minor radius. A curve's
mid point is its centre, its direction the normal of its plane and its half length 0. Lengths in metres.
A tolerance is a row of three: across the line (metres), along it (metres), half cone angle of the direction (radians).
A rigid motion is a row of twelve: rotation row by row (9), translation (3, metres), taking model to camera.

Columns are written as numbers in compiled loops: rows are taken apart there number by number, for speed.
"""

from __future__ import annotations

from typing import NamedTuple

from msgs_py import FeatureKind
from msgs_py.numeric.typed import ByteArray, FloatArray, Int32Array

CURVE = int(FeatureKind.CURVE)


class FeatureRows(NamedTuple):
    """Features without more: rows (e, 9) and their kind (e,), a FeatureKind each."""

    rows: FloatArray
    kind: ByteArray


class VoxelGrid(NamedTuple):
    """Which model features pass near each cell of a grid.

    Attributes
    ----------
    low : (3,)
        Metres, corner of the first cell.
    cell, inverse_cell
        Metres, the edge of a cell, and one over it.
    shape
        Cells along each axis.
    per_metre
        Layers of a cell in a metre: features are listed in layers (NEAR_LAYERS) of their distance from the cell.
    starts : (cells * NEAR_LAYERS + 1,)
        Where each layer of each cell begins in items.
    items : (m,)
        The features near each cell, one cell after the other, the nearest layer first.
    """

    low: FloatArray
    cell: float
    inverse_cell: float
    shape: tuple[int, int, int]
    per_metre: float
    starts: Int32Array
    items: Int32Array


class ModelFeatures(NamedTuple):
    """A model made ready for back-projection.

    Attributes
    ----------
    rows : (e, 9)
        Model frame.
    kind : (e,)
    middle : (3,)
        Metres, centre of its bounding box.
    size
        Metres, the largest distance between two of its points.
    voxels
        Which features pass where.
    """

    rows: FloatArray
    kind: ByteArray
    middle: FloatArray
    size: float
    voxels: VoxelGrid


class DataFeatures(NamedTuple):
    """Recovered features with what they may be off when compared with one model.

    Attributes
    ----------
    rows : (n, 9)
        Camera frame.
    kind : (n,)
    tolerances : (n, 3)
    radius_tolerance
        Metres, of curves, added to the tolerance across.
    """

    rows: FloatArray
    kind: ByteArray
    tolerances: FloatArray
    radius_tolerance: float


class PairTable(NamedTuple):
    """All ordered pairs of a model's features that are not parallel, in cells of angle and signed distance.

    Attributes
    ----------
    reach
        Metres, largest signed distance.
    starts : (cells + 1,)
    members : (p, 2)
    values : (p, 6)
        Angle, signed distance, foot on the first, foot on the second, flip of the second, half length of the shorter.
    """

    reach: float
    starts: Int32Array
    members: Int32Array
    values: FloatArray
