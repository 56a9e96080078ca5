"""Digital terrain maps: a grid of heights as an object of a scene, beside CSG (thesis 4.11).

A terrain is a sheet, seen from both sides, over a grid of square or oblong cells. It casts and receives shadows,
mirrors and transmits like any surface, and belongs to a leaf of its own. It bounds no volume, so it takes no part in
set operators; draw it as an object, or unite it at the top of a tree. A cell with a corner without a height is open.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msgs_py import Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .height_files import check_heights, read_heights
from .settings import CELL_SLACK
from .solid import Operation, Solid, Surface, as_matrix
from .textures import Laid

INTERPOLATIONS = ('triangles', 'bilinear')


@dataclass(frozen=True)
class TerrainFile:
    """The file that a terrain is made of, as the modelling language names it.

    Attributes
    ----------
    path : str
        As it is written in a scene file.
    size : tuple of three floats, or None
        Extent along x and y, and what a height of 1 stands for, metres; None where the file itself says.
    """

    path: str
    size: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Terrain(Solid):
    """A height grid.

    Parameters
    ----------
    heights : (rows, columns) array_like of float64
        Metres, at least 2 x 2; height is the z of the terrain's own frame. NaN where there is none.
    spacing : tuple of two floats
        Metres between columns (x) and between rows (y).
    interpolation : str
        'triangles', each cell cut from its (column + 1, row) to its (column, row + 1) corner, or 'bilinear'.
    placement : (4, 4) array_like of float64
        Column form, scene from the terrain's own frame, any affine map.
    surface : Surface
        Of the whole sheet.
    tints : (k, 4) array_like of float64, optional
        Colours by height instead of the surface's: rising heights (metres, own frame), each with red, green, blue in
        0..1. Between two of them colours are interpolated, beyond the ends they stay.
    file : TerrainFile, optional
        Where it comes from, for scenes that are written as text.
    laid : Laid, optional
        A picture on it (:meth:`Solid.textured`).

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.

    Examples
    --------
    >>> slope = Terrain([[0.0, 0.1], [0.0, 0.1]], spacing=(0.5, 0.5))
    >>> slope.matrix[:3, :3].diagonal().tolist(), slope.bilinear
    ([0.5, 0.5, 1.0], False)
    """

    heights: np.ndarray
    spacing: tuple[float, float] = (1.0, 1.0)
    interpolation: str = 'triangles'
    placement: np.ndarray = field(default_factory=lambda: np.eye(4))
    surface: Surface = field(default_factory=Surface)
    tints: np.ndarray | None = None
    file: TerrainFile | None = None
    laid: Laid | None = None
    kind: str = field(default='TERRAIN', init=False)
    face_colours: None = field(default=None, init=False)

    def __post_init__(self) -> None:
        heights = self.heights
        # A grid that is placed or painted anew was copied and checked when it was first used.
        if not isinstance(heights, np.ndarray) or heights.flags.writeable or heights.dtype != np.float64:
            heights = np.array(heights, dtype=np.float64)
            heights.flags.writeable = False
        check_heights(heights)
        spacing = np.asarray(self.spacing, dtype=np.float64)
        if spacing.shape != (2,) or not (np.isfinite(spacing) & (spacing > 0)).all():
            raise ValueError(f'spacing: expected two distances > 0, got {self.spacing}')
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(f'interpolation: expected one of {", ".join(INTERPOLATIONS)}, got {self.interpolation!r}')
        placement = np.array(as_matrix(self.placement))
        if abs(np.linalg.det(placement[:3, :3])) == 0.0:
            raise ValueError('placement: flattens the terrain to nothing')
        object.__setattr__(self, 'heights', heights)
        object.__setattr__(self, 'spacing', (float(spacing[0]), float(spacing[1])))
        object.__setattr__(self, 'placement', placement)
        if self.tints is not None:
            object.__setattr__(self, 'tints', checked_tints(self.tints))

    @classmethod
    def load(
        cls,
        path: str | Path,
        spacing: tuple[float, float] | None = None,
        low: float = 0.0,
        high: float = 1.0,
        **options: Any,
    ) -> Terrain:
        """A terrain from a file.

        Parameters
        ----------
        path : str or Path
            A .npy file of heights in metres, a grey 16-bit PNG, or an ESRI ASCII grid (.asc) in metres. A picture and
            an ASCII grid are the right way round when looked at from above: their last row lies at y = 0.
        spacing : tuple of two floats, optional
            As in the constructor, metres. An ASCII grid's own by default, else 1.
        low, high : float
            Heights that 0 and 65535 of a PNG stand for, metres.
        **options
            Further arguments of the constructor.

        Returns
        -------
        Terrain

        Raises
        ------
        FileNotFoundError
            There is no such file.
        ValueError
            It holds no height grid; the message begins with its name.
        """
        path = Path(path)
        grid = read_heights(path)
        heights = grid.heights
        if path.suffix.lower() == '.png':
            heights = low + (high - low) * heights
        cell = grid.cell or 1.0
        try:
            return cls(heights, (cell, cell) if spacing is None else spacing, **options)
        except (TypeError, ValueError) as error:
            raise ValueError(f'{path}: {error}') from None

    @property
    def matrix(self) -> np.ndarray:
        """Scene from the grid frame, (4, 4): x counts columns, y counts rows, and z is the height in metres."""
        return self.placement @ np.diag([*self.spacing, 1.0, 1.0])

    @property
    def own_frame(self) -> np.ndarray:
        """Scene from the terrain's own frame, (4, 4), metres."""
        return self.placement

    @property
    def outline(self) -> np.ndarray:
        """Corners (8, 3) of the box about the terrain, grid frame."""
        rows, columns = self.heights.shape
        return np.array([[x, y, z] for x in (0.0, columns - 1.0) for y in (0.0, rows - 1.0) for z in self.range])

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest height, metres, own frame."""
        return float(np.nanmin(self.heights)), float(np.nanmax(self.heights))

    @property
    def bilinear(self) -> bool:
        """Whether each cell is one bilinear patch, not two triangles."""
        return self.interpolation == 'bilinear'

    def transformed(self, placement: Pose | ArrayLike) -> Terrain:
        """See :meth:`Solid.transformed`."""
        return replace(self, placement=as_matrix(placement) @ self.placement)

    def painted(self, surface: Surface) -> Terrain:
        """See :meth:`Solid.painted`; colours by height and a texture go."""
        return replace(self, surface=surface, tints=None, laid=None)

    @cached_property
    def cells(self) -> BoolArray:
        """Which cells are there, (rows - 1, columns - 1) bool: all four corners have a height."""
        there: BoolArray = ~np.isnan(self.heights)
        return there[:-1, :-1] & there[:-1, 1:] & there[1:, :-1] & there[1:, 1:]

    @cached_property
    def relief(self) -> FloatArray:
        """The heights, and beside them those of their neighbours where there is none, (rows, columns), metres.

        A point on the rim of an open cell may be rounded into it; its normal is a number all the same.
        """
        missing = np.isnan(self.heights)
        if not missing.any():
            return self.heights
        rows, columns = missing.shape
        known, value = np.pad(~missing, 1), np.pad(np.where(missing, 0.0, self.heights), 1)
        around = [(dv, du) for dv in range(3) for du in range(3)]
        count = sum(known[dv : dv + rows, du : du + columns].astype(np.float64) for dv, du in around)
        total = sum(value[dv : dv + rows, du : du + columns] for dv, du in around)
        return np.where(missing, total / np.maximum(count, 1.0), self.heights)

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """The sheet as triangles, two to a cell; of a bilinear terrain they are an approximation.

        Returns
        -------
        vertices : (n, 3) float64
            Every corner of the grid, row by row, metres, scene frame.
        triangles : (m, 3) int64
            Anticlockwise when looked at from above.
        """
        rows, columns = self.heights.shape
        y, x = np.mgrid[0.0:rows, 0.0:columns]
        grid = np.stack([x.ravel(), y.ravel(), self.relief.ravel()], axis=1)
        j, i = np.nonzero(self.cells)
        a = j * columns + i
        b, c, d = a + 1, a + columns, a + columns + 1
        triangles = np.stack([a, b, c, b, d, c], axis=1).reshape(-1, 3)
        return grid @ self.matrix[:3, :3].T + self.matrix[:3, 3], triangles

    def _leaves(self) -> Iterator[Any]:
        yield self

    def __repr__(self) -> str:
        rows, columns = self.heights.shape
        return f'Terrain({rows} x {columns} heights, {self.interpolation})'


def sheets(solid: Solid) -> list[Terrain]:
    """The terrains of a solid.

    Parameters
    ----------
    solid : Solid

    Returns
    -------
    list of Terrain
        Left to right.

    Raises
    ------
    ValueError
        One is part of an intersection or a difference; the message begins with "terrain".
    """
    found: list[Terrain] = []
    pending = [(solid, True)]
    while pending:
        node, united = pending.pop()
        if isinstance(node, Operation):
            united = united and node.operator == 'UNION'
            pending += [(node.right, united), (node.left, united)]
        elif isinstance(node, Terrain):
            if not united:
                raise ValueError('terrain: a sheet takes no part in INTERSECT or DIFFERENCE; draw it as an object')
            found.append(node)
    return found


def checked_tints(tints: ArrayLike) -> np.ndarray:
    """Colours by height.

    Parameters
    ----------
    tints : (k, 4) array_like of float64
        Rising heights, metres, each with red, green, blue in 0..1.

    Returns
    -------
    (k, 4) float64

    Raises
    ------
    ValueError
        They are none; the message begins with "tints".
    """
    table: FloatArray = np.array(tints, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 4 or not len(table) or not np.isfinite(table).all():
        raise ValueError(f'tints: expected rows of height, red, green, blue, got shape {table.shape}')
    if (np.diff(table[:, 0]) <= 0.0).any():
        raise ValueError('tints: expected rising heights')
    if not ((table[:, 1:] >= 0.0) & (table[:, 1:] <= 1.0)).all():
        raise ValueError('tints: expected red, green, blue in 0..1')
    table.flags.writeable = False
    return table


def tint(table: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Colours at some heights.

    Parameters
    ----------
    table : (k, 4) array of float64
        See Terrain.tints.
    heights : (n,) array of float64
        Metres, the terrain's own frame.

    Returns
    -------
    (n, 3) float64
        Linear RGB.

    Examples
    --------
    >>> tint(np.array([[0.0, 0.0, 0.0, 1.0], [2.0, 1.0, 0.0, 0.0]]), np.array([-1.0, 0.5, 3.0])).tolist()
    [[0.0, 0.0, 1.0], [0.25, 0.0, 0.75], [1.0, 0.0, 0.0]]
    """
    return np.stack([np.interp(heights, table[:, 0], table[:, channel]) for channel in (1, 2, 3)], axis=1)


def gradient(terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """Normals of a terrain.

    Parameters
    ----------
    terrain : Terrain
    points : (n, 3) array of float64
        Grid frame; x and y say where.

    Returns
    -------
    (n, 3) float64
        Upward, not unit, grid frame.
    """
    i, j, fx, fy = cell_of(terrain, points)
    a, b, c, d = corners(terrain, i, j)
    if terrain.bilinear:
        slope_x, slope_y = (b - a) + (a - b - c + d) * fy, (c - a) + (a - b - c + d) * fx
    else:
        low = fx + fy <= 1.0
        slope_x, slope_y = np.where(low, b - a, d - c), np.where(low, c - a, d - b)
    return np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=1)


def height_at(terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """Heights of a terrain above or below points.

    Parameters
    ----------
    terrain : Terrain
    points : (n, 3) array of float64
        Grid frame; x and y say where.

    Returns
    -------
    (n,) float64
        Metres.

    Examples
    --------
    >>> height_at(Terrain([[0.0, 1.0], [2.0, 3.0]]), np.array([[0.5, 0.25, 9.0]])).tolist()
    [1.0]
    """
    i, j, fx, fy = cell_of(terrain, points)
    a, b, c, d = corners(terrain, i, j)
    if terrain.bilinear:
        height: FloatArray = a + (b - a) * fx + (c - a) * fy + (a - b - c + d) * fx * fy
        return height
    return np.where(fx + fy <= 1.0, a + (b - a) * fx + (c - a) * fy, d + (c - d) * (1.0 - fx) + (b - d) * (1.0 - fy))


def cell_of(terrain: Terrain, points: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Cells of a terrain that points lie over.

    Parameters
    ----------
    terrain : Terrain
    points : (n, 3) array of float64
        Grid frame.

    Returns
    -------
    column, row : (n,) int64
    x, y : (n,) float64
        Place in the cell, 0..1.
    """
    rows, columns = terrain.heights.shape
    i = np.clip(np.floor(points[:, 0]), 0, columns - 2).astype(np.int64)
    j = np.clip(np.floor(points[:, 1]), 0, rows - 2).astype(np.int64)
    return i, j, points[:, 0] - i, points[:, 1] - j


def corners(terrain: Terrain, i: IntArray, j: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Heights of the corners of cells.

    Parameters
    ----------
    terrain : Terrain
    i, j : (n,) array of int64
        Column and row of each cell.

    Returns
    -------
    four (n,) float64
        At (i, j), (i + 1, j), (i, j + 1) and (i + 1, j + 1), metres; those of Terrain.relief.
    """
    h = terrain.relief
    return h[j, i], h[j, i + 1], h[j + 1, i], h[j + 1, i + 1]


def first_crossing(
    terrain: Terrain,
    origin: np.ndarray,
    direction: np.ndarray,
    nearest: np.ndarray | float,
    farthest: np.ndarray | float = np.inf,
) -> np.ndarray:
    """Where rays first meet a terrain; every cell is tried on every ray, for tests and the reference engine.

    Parameters
    ----------
    terrain : Terrain
    origin, direction : (n, 3) array of float64
        Grid frame.
    nearest, farthest : (n,) array of float64, or float
        Lengths along the rays that count.

    Returns
    -------
    (n,) float64
        Lengths along the rays, inf where there is no crossing.
    """
    best = np.full(len(direction), np.inf)
    rows, columns = terrain.heights.shape
    near, far = np.broadcast_to(nearest, best.shape), np.broadcast_to(farthest, best.shape)
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        # Python's numbers; those of numpy take longer to handle.
        for j, i in zip(*(places.tolist() for places in np.nonzero(terrain.cells))):
            for t in _roots_in_cell(terrain, i, j, origin, direction):
                x, y = origin[:, 0] + t * direction[:, 0] - i, origin[:, 1] + t * direction[:, 1] - j
                edge = CELL_SLACK * (1.0 + max(rows, columns))
                here = (x >= -edge) & (x <= 1 + edge) & (y >= -edge) & (y <= 1 + edge) & (t > near) & (t < far)
                best = np.where(here & (t < best), t, best)
    return best


def hidden_by_terrain(terrain: Terrain, viewpoint: np.ndarray, targets: np.ndarray, early: float = 0.0) -> np.ndarray:
    """Points that a terrain hides; only the cells under each ray are looked at.

    Parameters
    ----------
    terrain : Terrain
    viewpoint : (3,) array of float64
        Grid frame.
    targets : (n, 3) array of float64
        Grid frame.
    early : float
        Part of its length by which a ray ends before its target.

    Returns
    -------
    (n,) bool
        The sheet stands between the viewpoint and the target.
    """
    rays = targets - viewpoint
    hidden: BoolArray = np.array([_meets(terrain, viewpoint, ray, 1.0 - early) for ray in rays], dtype=bool)
    return hidden


def _meets(terrain: Terrain, origin: np.ndarray, direction: np.ndarray, farthest: float) -> bool:
    """Whether one ray (3,) meets a terrain between 0 and ``farthest``."""
    enter, leave = 0.0, farthest
    sizes = terrain.heights.shape[1] - 1, terrain.heights.shape[0] - 1
    for size, start, step in zip(sizes, origin.tolist(), direction.tolist()):
        if step == 0.0:
            if not 0.0 <= start <= size:
                return False
            continue
        first, last = sorted((-start / step, (size - start) / step))
        enter, leave = max(enter, first), min(leave, last)
    if not enter < leave:
        return False
    stops = [np.array([enter, leave])]
    for start, step in zip(origin[:2].tolist(), direction[:2].tolist()):
        if step != 0.0:
            low, high = sorted((start + enter * step, start + leave * step))
            stops.append((np.arange(np.ceil(low), np.floor(high) + 1.0) - start) / step)
    t = np.sort(np.concatenate(stops))
    middle = origin + 0.5 * (t[1:] + t[:-1])[:, None] * direction
    i, j, _, _ = cell_of(terrain, middle)
    there = terrain.cells[j, i]
    four = corners(terrain, i, j)
    slack = CELL_SLACK * (1.0 + max(sizes))
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        x, y, z = (np.broadcast_to(origin, middle.shape) - np.stack([i, j, np.zeros_like(i)], axis=1)).T
        for root in _roots(four, terrain.bilinear, (x, y, z), tuple(direction)):
            if (there & (root >= t[:-1] - slack) & (root <= t[1:] + slack) & (root > 0.0) & (root < farthest)).any():
                return True
    return False


def _roots_in_cell(terrain: Terrain, i: int, j: int, origin: np.ndarray, direction: np.ndarray) -> list[np.ndarray]:
    """Up to two t (n,) each where the rays meet the cell's surface, continued; of triangles only inside their half."""
    four = tuple(float(h) for h in corners(terrain, np.array(i), np.array(j)))
    return _roots(four, terrain.bilinear, (origin[:, 0] - i, origin[:, 1] - j, origin[:, 2]), tuple(direction.T))


def _roots(four: tuple[Any, ...], bilinear: bool, start: tuple[Any, ...], step: tuple[Any, ...]) -> list[np.ndarray]:
    """As _roots_in_cell, of rays in the frames of their cells, whose corners have these heights; all are broadcast."""
    (a, b, c, d), (x, y, z), (u, v, w) = four, start, step
    if bilinear:
        k = a - b - c + d
        square = -k * u * v
        linear = w - (b - a) * u - (c - a) * v - k * (x * v + y * u)
        constant = z - a - (b - a) * x - (c - a) * y - k * x * y
        root = np.sqrt(linear**2 - 4 * square * constant)
        q = -0.5 * (linear + np.copysign(root, linear))
        return [q / square, constant / q]
    roots = []
    for level, slope_x, slope_y, low in ((a, b - a, c - a, True), (b + c - d, d - c, d - b, False)):
        t = -(z - level - slope_x * x - slope_y * y) / (w - slope_x * u - slope_y * v)
        half = (x + t * u) + (y + t * v) <= 1.0
        roots.append(np.where(half == low, t, np.nan))
    return roots
