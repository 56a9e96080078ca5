"""What an index holds, as compiled functions take it, and the scales on which its invariants are counted.

An invariant is counted on a scale on which its error is the same everywhere. A length x is off by the root of
``floor``^2 + (``share`` x)^2: what data is off by, and what a model is, in parts of its size. On the scale

    q(x) = asinh(share x / floor) / share

one unit is one such error: metres at first, then parts of the length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import ByteArray, Float32Array, FloatArray, Int64Array, UInt16Array, UInt32Array

from .settings import ANGLES, APART_CELLS, APART_STEP, CURVE_STEP, LENGTH_CELLS, LENGTH_STEP

# Groups of pairs: lines that cross, by their kinds (the first not above the second: 6 of them), then parallel ones of
# which the first is a curve (3 of them, by the second's kind).
GROUPS = 9
CELLS = GROUPS * ANGLES * APART_CELLS * LENGTH_CELLS * LENGTH_CELLS


class Scale(NamedTuple):
    """On which lengths are counted.

    Attributes
    ----------
    floor
        Metres.
    share
        Without unit.
    """

    floor: float
    share: float


class Models(NamedTuple):
    """The features of all models, one model after the other.

    Attributes
    ----------
    starts : (m + 1,) int64
        Where each model's features begin.
    rows : (f, 9) float64
        Features, see geometry/features.py.
    kind : (f,) uint8
    sizes : (m,) float64
        Metres, the largest distance between two points of each.
    centres : (m, 3) float64
        Of each one's bounding box, metres.
    radii : (m,) float64
        Largest radius of each, metres; 0 without curves.
    """

    starts: Int64Array
    rows: FloatArray
    kind: ByteArray
    sizes: FloatArray
    centres: FloatArray
    radii: FloatArray


class Postings(NamedTuple):
    """The pairs of all models, by the cells of their invariants; in a cell by the model's number.

    Attributes
    ----------
    starts : (CELLS + 1,) int64
        Where each cell's pairs begin.
    owner : (p,) uint32
        The model of each pair.
    members : (p, 2) uint16
        Its features.
    spans : (p, 5) float32
        Metres: distance of the lines; and of each feature from where to where it runs along its line, counted from the
        foot of the common perpendicular (of parallel lines: from the second's mid point).
    """

    starts: Int64Array
    owner: UInt32Array
    members: UInt16Array
    spans: Float32Array


@njit
def on_scale(x: float, floor: float, share: float) -> float:
    """A length, metres, on the scale of its errors.

    Examples
    --------
    >>> round(on_scale(0.01, 0.001, 0.01), 2), round(on_scale(1.0, 0.001, 0.01), 1)
    (9.98, 299.8)

    """
    return float(np.arcsinh(share * max(x, 0.0) / floor) / share)


@njit
def angle_cell(angle: float) -> int:
    """Cell of an angle between two lines, radians from 0 to half pi."""
    return min(max(int(angle * (2.0 / np.pi) * ANGLES), 0), ANGLES - 1)


@njit
def apart_cell(x: float, floor: float, share: float) -> int:
    """Cell of a distance, metres."""
    return min(int(on_scale(x, floor, share) / APART_STEP), APART_CELLS - 1)


@njit
def size_cell(x: float, curve: bool, floor: float, share: float) -> int:
    """Cell of an edge's or axis' length, or of a curve's radius, metres."""
    return min(int(on_scale(x, floor, share) / (CURVE_STEP if curve else LENGTH_STEP)), LENGTH_CELLS - 1)


@njit
def along_cell(x: float, floor: float, share: float) -> int:
    """Cell of the place of one curve's centre along another's axis, metres; it takes the place of the angle."""
    return min(int(on_scale(abs(x), floor, share) / CURVE_STEP), ANGLES - 1)


@njit
def group_of(first: int, second: int, parallel: bool) -> int:
    """Group of two kinds, the first not above the second; of parallel features the first is a curve.

    Examples
    --------
    >>> [group_of(a, b, False) for a in range(3) for b in range(a, 3)], group_of(1, 2, True)
    ([0, 1, 2, 3, 4, 5], 8)

    """
    if parallel:
        return 6 + second
    return 3 * first - first * (first - 1) // 2 + second - first


@njit
def cell_of(group: int, angle: int, apart: int, first: int, second: int) -> int:
    """Number of a cell; neighbours in the size of the second feature stand side by side."""
    return (((group * ANGLES + angle) * APART_CELLS + apart) * LENGTH_CELLS + first) * LENGTH_CELLS + second
