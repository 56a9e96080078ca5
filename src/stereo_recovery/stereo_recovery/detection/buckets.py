"""Points in square cells, so that what is near is found without looking at all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray


class Buckets(NamedTuple):
    """n points by cell.

    Attributes
    ----------
    low : (2,) float64, pixels
        Corner of the first cell.
    size : float
        Pixels. Side of a cell.
    columns, rows : int
        Of cells.
    first : (columns * rows + 1,) int64
        Cell c has ``item[first[c]:first[c + 1]]``.
    item : (n,) int64
        Points.
    """

    low: FloatArray
    size: float
    columns: int
    rows: int
    first: IntArray
    item: IntArray


@njit
def bucketed(points: FloatArray, size: float) -> Buckets:
    """Points (n, 2), n > 0, pixels, in cells of this side, pixels."""
    low = np.array([points[:, 0].min(), points[:, 1].min()])
    columns, rows = int((points[:, 0].max() - low[0]) / size) + 1, int((points[:, 1].max() - low[1]) / size) + 1
    cell = np.empty(len(points), np.int64)
    first = np.zeros(columns * rows + 1, np.int64)
    for i in range(len(points)):
        cell[i] = int((points[i, 1] - low[1]) / size) * columns + int((points[i, 0] - low[0]) / size)
        first[cell[i] + 1] += 1
    first = np.cumsum(first)
    item, used = np.empty(len(points), np.int64), first[:-1].copy()
    for i in range(len(points)):
        item[used[cell[i]]] = i
        used[cell[i]] += 1
    return Buckets(low, size, columns, rows, first, item)


@njit
def near(buckets: Buckets, x: float, y: float) -> IntArray:
    """(k,) int64: points in the cell of x, y, pixels, and the eight around it, in rising order."""
    column, row = int(np.floor((x - buckets.low[0]) / buckets.size)), int(np.floor((y - buckets.low[1]) / buckets.size))
    first_column, last_column = max(column - 1, 0), min(column + 2, buckets.columns)
    first_row, last_row = max(row - 1, 0), min(row + 2, buckets.rows)
    count = 0
    if first_column < last_column:
        for r in range(first_row, last_row):
            start, end = r * buckets.columns + first_column, r * buckets.columns + last_column
            count += buckets.first[end] - buckets.first[start]
    found = np.empty(count, np.int64)
    n = 0
    if count > 0:
        for r in range(first_row, last_row):
            start, end = r * buckets.columns + first_column, r * buckets.columns + last_column
            for k in range(buckets.first[start], buckets.first[end]):
                found[n] = buckets.item[k]
                n += 1
    return np.sort(found)
