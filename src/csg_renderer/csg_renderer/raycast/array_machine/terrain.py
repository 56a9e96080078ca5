"""Array programs for terrains: where the rays of a tile first meet a grid of heights, its slope and colour there.

The heights stay with the control unit, which broadcasts the four corners of one cell after the other to all PEs; a PE
cannot address a table of its own. What makes that affordable is a pyramid of boxes about blocks of cells, made by the
host: a block that no ray of the tile passes is left out with all its cells, and so is one behind what all rays have
met. Formulas are those of scene.terrain, so that all engines give one answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from dap_emulator.machine import intrinsics as f
from dap_emulator.machine.arrays import DapArray
from msgs_py.numeric.typed import FloatArray

from ...scene.settings import CELL_SLACK
from ...scene.terrain import Terrain
from ..settings import HEIGHT_SLACK
from .caster import INFINITE, Caster, Rays

# A block of cells: level of the pyramid (0 is single cells), row and column in that level.
Block: TypeAlias = tuple[int, int, int]
# Components are planes, one number a PE, or one number for all.
Components: TypeAlias = list[Any]


@dataclass
class _Onward:
    """Rays in the grid frame with what every block needs of them: one over the direction, and where it rises."""

    origin: Components
    direction: Components
    inverse: list[DapArray]
    rising: list[DapArray]


class ArrayTerrain:
    """A terrain on the array machine.

    Parameters
    ----------
    caster : Caster
        Its machine, word length and smallest number are used.
    terrain : Terrain
    """

    def __init__(self, caster: Caster, terrain: Terrain) -> None:
        self.caster, self.terrain = caster, terrain
        self.rows, self.columns = terrain.heights.shape
        self.edge = max(CELL_SLACK, caster.rounding) * (1.0 + max(self.rows, self.columns))
        self.low, self.high = _pyramid(terrain)

    def first_crossing(
        self, rays: Rays, m: FloatArray, nearest: float, farthest: DapArray | None, active: DapArray | None
    ) -> DapArray:
        """Where rays first meet the terrain, infinity where they do not.

        Parameters
        ----------
        rays : Rays
        m : (3, 4) array of float64
            Grid frame from that of the rays.
        nearest : float
        farthest : DapArray, optional
            Lengths along the rays that count.
        active : DapArray, optional
            LOGICAL: the rays that matter; the others meet nothing.

        Returns
        -------
        DapArray
            REAL planes.
        """
        onward = self._localised(rays, m)
        best, limit = (self.caster.filled(INFINITE, rays.shape) for _ in range(2))
        if farthest is not None:
            limit.assign(farthest)
        if active is not None:
            limit.assign(-INFINITE, ~active)
        pending: list[Block] = [(len(self.low) - 1, 0, 0)]
        while pending:
            block = pending.pop()
            level, j, i = block
            if self.low[level][j, i] > self.high[level][j, i] or not self._passed(onward, block, nearest, limit):
                continue
            if level:
                # The nearest is looked at first, so that it hides what is behind it.
                pending += sorted(self._parts(block), key=lambda part: self._distance(part, onward), reverse=True)
                continue
            for t in self._roots(onward, j, i):
                across = [o + t * d - place for o, d, place in zip(onward.origin, onward.direction, (i, j))]
                here = (t > nearest) & (t < limit)
                for component in across:
                    here = here & (component >= -self.edge) & (component <= 1.0 + self.edge)
                best.assign(t, here)
                limit.assign(t, here)
        return best

    def _localised(self, rays: Rays, m: FloatArray) -> _Onward:
        origin, direction, inverse, rising = [], [], [], []
        for i in range(3):
            (ox, oy, oz), (dx, dy, dz) = rays.origin, rays.direction
            origin.append(m[i, 0] * ox + m[i, 1] * oy + m[i, 2] * oz + float(m[i, 3]))
            along: Any = m[i, 0] * dx + (m[i, 1] * dy + m[i, 2] * dz)
            direction.append(along)
            divisor = f.merge(self.caster.tiny, along, abs(along) < self.caster.tiny)
            inverse.append(1.0 / divisor)
            rising.append(divisor > 0.0)
        return _Onward(origin, direction, inverse, rising)

    def _passed(self, rays: _Onward, block: Block, nearest: float, limit: DapArray) -> bool:
        """Whether any ray passes the box about a block between nearest and its limit."""
        level, j, i = block
        low, high = float(self.low[level][j, i]), float(self.high[level][j, i])
        slack = max(HEIGHT_SLACK, self.caster.rounding) * (1.0 + abs(low) + abs(high))
        size = 1 << level
        first = (i * size - self.edge, j * size - self.edge, low - slack)
        last = (
            min((i + 1) * size, self.columns - 1) + self.edge,
            min((j + 1) * size, self.rows - 1) + self.edge,
            high + slack,
        )
        enter: Any = nearest
        leave: Any = limit
        for axis in range(3):
            o, inverse, rising = rays.origin[axis], rays.inverse[axis], rays.rising[axis]
            one, other = (first[axis] - o) * inverse, (last[axis] - o) * inverse
            enter = f.maximum(f.merge(one, other, rising), enter)
            leave = f.minimum(f.merge(other, one, rising), leave)
        return f.any_(enter <= leave)

    def _parts(self, block: Block) -> Iterator[Block]:
        """The up to four blocks of the next finer level."""
        level, j, i = block
        rows, columns = self.low[level - 1].shape
        for row in range(2 * j, min(2 * j + 2, rows)):
            for column in range(2 * i, min(2 * i + 2, columns)):
                yield level - 1, row, column

    def _distance(self, block: Block, rays: _Onward) -> float:
        """Square of the distance of a block from where the rays start, cells; 0 for rays that start everywhere."""
        level, j, i = block
        x, y = rays.origin[:2]
        if isinstance(x, DapArray) or isinstance(y, DapArray):
            return 0.0
        size = 1 << level
        return float(((i + 0.5) * size - x) ** 2 + ((j + 0.5) * size - y) ** 2)

    def _roots(self, rays: _Onward, j: int, i: int) -> list[DapArray]:
        """One or two t each where rays meet a cell's surface, continued; of triangles only inside their half."""
        a, b, c, d = _corners(self.terrain, j, i)
        x, y, z = rays.origin[0] - float(i), rays.origin[1] - float(j), rays.origin[2]
        u, v, w = rays.direction
        twist = a - b - c + d
        if self.terrain.bilinear and twist != 0.0:
            square = (-twist * u) * v
            linear = w - (b - a) * u - (c - a) * v - twist * (x * v + y * u)
            constant = z - a - (b - a) * x - (c - a) * y - twist * x * y
            discriminant = linear * linear - 4.0 * square * constant
            real = discriminant >= 0.0
            root = f.sqrt(f.merge(discriminant, 0.0, real))
            q = -0.5 * (linear + f.sign(root, linear))
            roots = [q / self._divisor(square), constant / self._divisor(q)]
            return [f.merge(t, INFINITE, real) for t in roots]
        halves = [(a, b - a, c - a, True), (b + c - d, d - c, d - b, False)]
        if twist == 0.0:  # one plane, in which the halves need not be told apart
            return [self._plane(rays, x, y, z, halves[0][:3])]
        roots = []
        for level, slope_x, slope_y, low in halves:
            t = self._plane(rays, x, y, z, (level, slope_x, slope_y))
            first = (x + t * u) + (y + t * v) <= 1.0
            roots.append(f.merge(t, INFINITE, first if low else ~first))
        return roots

    def _plane(self, rays: _Onward, x: Any, y: Any, z: Any, plane: tuple[float, float, float]) -> DapArray:
        """Where rays meet the plane of a height at (0, 0) and two slopes."""
        level, slope_x, slope_y = plane
        u, v, w = rays.direction
        t: DapArray = -(z - level - slope_x * x - slope_y * y) / self._divisor(w - slope_x * u - slope_y * v)
        return t

    def _divisor(self, value: DapArray) -> DapArray:
        """The value, and the smallest number in place of 0."""
        divisor: DapArray = f.merge(self.caster.tiny, value, value.compare('eq', 0.0))
        return divisor

    def slopes(self, x: DapArray, y: DapArray, here: DapArray) -> tuple[DapArray, DapArray]:
        """How a terrain rises along x and y.

        Parameters
        ----------
        x, y : DapArray
            Places, grid frame.
        here : DapArray
            LOGICAL: the places that count.

        Returns
        -------
        two DapArray
            Metres a cell.
        """
        column = self._whole(x, self.columns - 2)
        row = self._whole(y, self.rows - 2)
        fx, fy = x - column, y - row
        along, across, twist = (self.caster.filled(0.0, x.shape) for _ in range(3))
        below = fx + fy <= 1.0
        for j, i, mask in self._cells_under(row, column, here):
            a, b, c, d = _corners(self.terrain, j, i)
            if self.terrain.bilinear:
                along.assign(b - a, mask)
                across.assign(c - a, mask)
                twist.assign(a - b - c + d, mask)
                continue
            for half, slope_x, slope_y in ((mask & below, b - a, c - a), (mask & ~below, d - c, d - b)):
                along.assign(slope_x, half)
                across.assign(slope_y, half)
        if self.terrain.bilinear:
            return along + twist * fy, across + twist * fx
        return along, across

    def _whole(self, value: DapArray, most: int) -> DapArray:
        """The cell of a coordinate, 0 to most."""
        # FIX rounds towards zero; what is below zero belongs to the first cell all the same.
        inside = f.minimum(f.maximum(value, 0.0), float(most))
        whole: DapArray = f.fix(inside)
        return whole

    def _cells_under(self, row: DapArray, column: DapArray, here: DapArray) -> Iterator[tuple[int, int, DapArray]]:
        """Every cell that one of the places lies in, with the mask of those."""
        pending: list[tuple[Block, DapArray]] = [((len(self.low) - 1, 0, 0), here)]
        while pending:
            (level, j, i), mask = pending.pop()
            if not f.any_(mask):
                continue
            if not level:
                yield j, i, mask
                continue
            half = 1 << (level - 1)
            upper = mask & (row < (2 * j + 1) * half)
            lower = mask ^ upper
            left = column < (2 * i + 1) * half
            for part_j, part in ((2 * j, upper), (2 * j + 1, lower)):
                first = part & left
                pending += [((level - 1, part_j, 2 * i), first), ((level - 1, part_j, 2 * i + 1), part ^ first)]

    def tinted(self, z: DapArray) -> list[DapArray]:
        """Red, green and blue at heights z (metres, own frame) of a terrain that is coloured by height."""
        table = self.terrain.tints
        assert table is not None
        reached = [z >= float(height) for height in table[1:, 0]]
        colours = []
        for channel in (1, 2, 3):
            colour = self.caster.filled(float(table[0, channel]), z.shape)
            above = z >= float(table[0, 0])
            for k, mask in enumerate(reached):
                (low, start), (high, end) = table[k, [0, channel]], table[k + 1, [0, channel]]
                if start != end:
                    colour.assign(float((end - start) / (high - low)) * (z - float(low)) + float(start), above)
                else:
                    colour.assign(float(start), above)
                above = mask
            colour.assign(float(table[-1, channel]), above)
            colours.append(colour)
        return colours


def _corners(terrain: Terrain, j: int, i: int) -> tuple[float, float, float, float]:
    """Heights of a cell at (i, j), (i + 1, j), (i, j + 1) and (i + 1, j + 1), metres."""
    h = terrain.relief
    return float(h[j, i]), float(h[j, i + 1]), float(h[j + 1, i]), float(h[j + 1, i + 1])


def _pyramid(terrain: Terrain) -> tuple[list[FloatArray], list[FloatArray]]:
    """Least and greatest heights of cells, of blocks of 2 x 2 cells, and so on; open cells have the least above."""
    h, there = terrain.relief, terrain.cells
    four = np.stack([h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:]])
    low = [np.where(there, four.min(axis=0), np.inf)]
    high = [np.where(there, four.max(axis=0), -np.inf)]
    while low[-1].size > 1:
        for levels, empty, reduce in ((low, np.inf, np.minimum), (high, -np.inf, np.maximum)):
            rows, columns = levels[-1].shape
            even = np.pad(levels[-1], ((0, rows % 2), (0, columns % 2)), constant_values=empty)
            levels.append(reduce.reduce([even[0::2, 0::2], even[0::2, 1::2], even[1::2, 0::2], even[1::2, 1::2]]))
    return low, high
