"""Points and segments in square cells, so that what is near is found without looking at all."""

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


@njit
def _stamped(start: FloatArray, end: FloatArray, width: float, cells: Buckets, used: IntArray) -> None:
    """Count, or put into ``cells.item``, the segments of every cell that has a place within ``width`` of them.

    used : (columns * rows,) where the next segment of each cell goes; without items it is counted from zero
    """
    last = np.full(len(used), -1, np.int64)
    # No place on a segment is farther than half a step from one of its points.
    reach = width + 0.5 * cells.size
    for i in range(len(start)):
        steps = int(np.hypot(end[i, 0] - start[i, 0], end[i, 1] - start[i, 1]) / cells.size) + 1
        for k in range(steps + 1):
            x = start[i, 0] + (end[i, 0] - start[i, 0]) * k / steps - cells.low[0]
            y = start[i, 1] + (end[i, 1] - start[i, 1]) * k / steps - cells.low[1]
            for row in range(int((y - reach) / cells.size), int((y + reach) / cells.size) + 1):
                for column in range(int((x - reach) / cells.size), int((x + reach) / cells.size) + 1):
                    cell = row * cells.columns + column
                    if last[cell] == i:
                        continue
                    last[cell] = i
                    if len(cells.item):
                        cells.item[used[cell]] = i
                    used[cell] += 1


@njit
def swept(start: FloatArray, end: FloatArray, width: float, size: float) -> Buckets:
    """Segments (n, 2), (n, 2), n > 0, pixels, by the cells of this side, pixels, that are within ``width`` of them."""
    margin = width + 0.5 * size
    low, high = np.empty(2), np.empty(2)
    for c in range(2):
        low[c] = min(start[:, c].min(), end[:, c].min()) - margin
        high[c] = max(start[:, c].max(), end[:, c].max()) + margin
    columns, rows = int((high[0] - low[0]) / size) + 2, int((high[1] - low[1]) / size) + 2
    first = np.zeros(columns * rows + 1, np.int64)
    _stamped(start, end, width, Buckets(low, size, columns, rows, first, np.empty(0, np.int64)), first[1:])
    first = np.cumsum(first)
    cells = Buckets(low, size, columns, rows, first, np.empty(first[-1], np.int64))
    _stamped(start, end, width, cells, first[:-1].copy())
    return cells


@njit
def in_cell(cells: Buckets, x: float, y: float) -> IntArray:
    """(k,) int64: what the cell of x, y, pixels, has, in rising order; of :func:`swept` all within its width."""
    column, row = int(np.floor((x - cells.low[0]) / cells.size)), int(np.floor((y - cells.low[1]) / cells.size))
    if column < 0 or row < 0 or column >= cells.columns or row >= cells.rows:
        return cells.item[:0]
    cell = row * cells.columns + column
    return cells.item[cells.first[cell] : cells.first[cell + 1]]
