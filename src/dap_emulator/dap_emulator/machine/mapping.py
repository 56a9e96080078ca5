"""How an array of any shape lies on the ES x ES processing elements.

An array larger than the array of PEs is cut into blocks of ES x ES elements, one element to a PE in each. Sheet
mapping cuts it into adjoining sheets; crinkled mapping gives every PE a small tile of neighbouring elements; combined
mapping is crinkled down the rows and sheets along the columns (thesis 3.5.1, after Reddaway). Vectors are long
vectors: ES * ES consecutive elements to a block.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from msgs_py.numeric.typed import AnyArray, IntArray

from .settings import LAYOUTS_CACHED

MAPPINGS = ('sheet', 'crinkled', 'combined')


@dataclass(frozen=True)
class Layout:
    """Where the elements of one array lie.

    Parameters
    ----------
    shape : tuple of int
        Parallel extents: () of one scalar, (n,) of a vector, (rows, columns) of a matrix.
    es : int
        PEs along an edge of the array of PEs.
    mapping : {'sheet', 'crinkled', 'combined'}
        How a matrix is cut into blocks; a vector has one mapping only.

    Raises
    ------
    ValueError
        For an unknown mapping, more than two extents, or an extent below 1.

    References
    ----------
    Thesis 3.5.1.

    Examples
    --------
    >>> Layout((100, 40), es=32).grid
    (4, 2)
    >>> Layout((4, 4), es=2, mapping='sheet').places()[0].tolist()
    [[0, 0, 1, 1], [0, 0, 1, 1], [2, 2, 3, 3], [2, 2, 3, 3]]
    >>> Layout((4, 4), es=2, mapping='crinkled').places()[0].tolist()
    [[0, 1, 0, 1], [2, 3, 2, 3], [0, 1, 0, 1], [2, 3, 2, 3]]
    """

    shape: tuple[int, ...]
    es: int
    mapping: str = 'sheet'

    def __post_init__(self) -> None:
        if self.mapping not in MAPPINGS:
            raise ValueError(f'mapping: expected one of {", ".join(MAPPINGS)}, got {self.mapping!r}')
        if len(self.shape) > 2 or any(extent < 1 for extent in self.shape):
            raise ValueError(f'shape: expected one or two parallel extents of at least 1, got {self.shape}')

    @property
    def grid(self) -> tuple[int, int]:
        """Blocks down and across; their product is the number of blocks."""
        if len(self.shape) == 2:
            return -(-self.shape[0] // self.es), -(-self.shape[1] // self.es)
        return (-(-self.shape[0] // self.es**2) if self.shape else 1), 1

    @property
    def blocks(self) -> int:
        """Number of blocks: every parallel operation is repeated this many times."""
        down, across = self.grid
        return down * across

    def is_crinkled(self, axis: int) -> bool:
        """Whether neighbours along this axis of a matrix mostly share a PE."""
        return self.mapping == 'crinkled' or (self.mapping == 'combined' and axis == 0)

    def places(self) -> tuple[IntArray, IntArray, IntArray]:
        """Place of every element.

        Returns
        -------
        block, row, column : int64 arrays of the array's shape
            Number of the block, and row and column of the PE within the array of PEs, all from 0.
        """
        es = self.es
        if len(self.shape) != 2:
            index = np.arange(self.shape[0] if self.shape else 1)
            # Long vectors run down the columns of a block, as Fortran arrays do.
            return index // es**2, index % es, index % es**2 // es
        along: list[tuple[IntArray, IntArray]] = []
        for axis, extent in enumerate(self.shape):
            index = np.arange(extent)
            tile = self.grid[axis]
            along.append((index % tile, index // tile) if self.is_crinkled(axis) else (index // es, index % es))
        (block_row, pe_row), (block_column, pe_column) = along
        block = block_row[:, None] * self.grid[1] + block_column[None, :]
        return (
            block,
            np.broadcast_to(pe_row[:, None], self.shape).copy(),
            np.broadcast_to(pe_column[None, :], self.shape).copy(),
        )

    def to_blocks(self, values: AnyArray) -> AnyArray:
        """Values as the PEs hold them.

        Parameters
        ----------
        values : array of the layout's shape

        Returns
        -------
        (blocks, es, es) array of the same type
            Zero where no element lies.
        """
        out = np.zeros((self.blocks, self.es, self.es), dtype=values.dtype)
        out[self.places()] = values
        return out


@lru_cache(maxsize=LAYOUTS_CACHED)
def layout(shape: tuple[int, ...], es: int, mapping: str = 'sheet') -> Layout:
    """``Layout(shape, es, mapping)``, made once for each set of arguments."""
    return Layout(shape, es, mapping)
