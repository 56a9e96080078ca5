"""The straight edges of a terrain of facets: its rim, and the creases between facets, as long as they run straight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from msgs_py import FeatureSet
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..mesh.settings import COLLINEAR, CREASE_ANGLE
from ..scene.terrain import Terrain


def facet_edges(terrain: Terrain, crease_angle: float = CREASE_ANGLE) -> FeatureSet:
    """The straight edges of a terrain of facets.

    Parameters
    ----------
    terrain : Terrain
        Of interpolation 'triangles'.
    crease_angle : float
        Radians. Neighbouring facets that turn by more meet in a crease.

    Returns
    -------
    FeatureSet
        Edges; scene frame, metres, uncertainty zero.

    Raises
    ------
    ValueError
        The terrain is bilinear: its cells meet in creases of no one angle.

    Examples
    --------
    >>> valley = Terrain([[1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])  # the rim of two slopes, and the crease between them
    >>> facet_edges(valley).lengths.round(3).tolist()
    [1.414, 1.414, 1.414, 1.414, 1.0, 1.0, 1.0]
    """
    if terrain.bilinear:
        raise ValueError('terrain: bilinear cells have no straight edges that are features, FACETED ones have')
    rows, columns = terrain.heights.shape
    y, x = np.mgrid[0.0:rows, 0.0:columns]
    points = np.stack([x, y, terrain.relief], axis=-1) @ terrain.matrix[:3, :3].T + terrain.matrix[:3, 3]
    segments = [
        piece
        for line, crease in _lines(points, *_creases(terrain, points, crease_angle))
        for piece in _runs(line, crease)
    ]
    ends = np.array(segments).reshape(-1, 2, 3)
    return FeatureSet.from_edges(ends[:, 0], ends[:, 1])


def _creases(terrain: Terrain, points: FloatArray, angle: float) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which sides of cells along x (rows, columns - 1), along y (rows - 1, columns), and diagonals are edges."""
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    first, second = np.cross(b - a, c - a), np.cross(c - d, b - d)
    for normals in (first, second):
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        normals[~terrain.cells] = np.nan
    nowhere_x, nowhere_y = np.full((1, *first.shape[1:]), np.nan), np.full((first.shape[0], 1, 3), np.nan)
    along = _turns(np.concatenate([first, nowhere_x]), np.concatenate([nowhere_x, second]), angle)
    across = _turns(np.concatenate([first, nowhere_y], axis=1), np.concatenate([nowhere_y, second], axis=1), angle)
    return along, across, _turns(first, second, angle)


def _turns(one: FloatArray, other: FloatArray, angle: float) -> BoolArray:
    """Whether facets of these unit normals (..., 3) meet in an edge: they turn by more, or one of them is not there."""
    there, too = ~np.isnan(one[..., 0]), ~np.isnan(other[..., 0])
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=-1), (one * other).sum(axis=-1)
    edges: BoolArray = (there != too) | (there & too & (np.arctan2(sine, cosine) > angle))
    return edges


def _lines(
    points: FloatArray, along: BoolArray, across: BoolArray, diagonal: BoolArray
) -> Iterator[tuple[FloatArray, BoolArray]]:
    """Every line of the grid: its points (k, 3), and which of its k - 1 segments are edges."""
    rows, columns = points.shape[:2]
    for j in range(rows):
        yield points[j], along[j]
    for i in range(columns):
        yield points[:, i], across[:, i]
    # The diagonal of a cell runs from its (column + 1, row) to its (column, row + 1) corner.
    turned, cells = points[:, ::-1], diagonal[:, ::-1]
    for offset in range(-rows + 2, columns - 1):
        yield np.diagonal(turned, offset).T, np.diagonal(cells, offset)


def _runs(line: FloatArray, crease: BoolArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Start and end of the edges on a line, each as long as it runs straight."""
    step = np.diff(line, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    turn = np.linalg.norm(np.cross(step[1:], step[:-1]), axis=1)
    goes_on = crease[1:] & crease[:-1] & (turn < np.sin(COLLINEAR)) & ((step[1:] * step[:-1]).sum(axis=1) > 0.0)
    begins, ends = crease.copy(), crease.copy()
    begins[1:] &= ~goes_on
    ends[:-1] &= ~goes_on
    yield from zip(line[:-1][begins], line[1:][ends])
