"""Cycles of moving whole planes about, counted from where the elements lie on the PEs.

Neighbours: for every plane, each block of the result takes what it needs from each block that holds some of it: a load,
a step for every place over the connections to the four neighbours, a store where the elements belong to that block.
Lines: the control unit and the highways move a row or a column of ES bits of one plane in a cycle.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from msgs_py.numeric.typed import IntArray

from .mapping import Layout
from .operands import moved
from .settings import LAYOUTS_CACHED

# Instructions for each plane of each block, and those for the operation in each block.
_PER_PLANE: dict[str, tuple[int, int]] = {
    'copy': (2, 0),  # load, store
    'masked_copy': (2, 1),  # the same where A is true
    'logic': (3, 0),  # load, combine, store
    'not': (2, 0),
    'broadcast': (3, 0),  # a line onto the highway, from the highway, store
    'fetch': (1, 0),  # an element onto the highway
    'store_element': (2, 2),  # A from two registers of the control unit, then a bit for each plane
    'pattern': (0, 3),  # from two registers, store
    'any_all': (0, 2),  # load, test
    'first_true': (0, 5),  # load, columns to the control unit, the first one, its rows to the control unit, the first
}
# Moves by lines: each of ES lines of a plane is read onto the highway and stored from it.
_BY_LINES = frozenset({'transpose', 'remap'})


def cycles(operation: str, planes: int, layout: Layout) -> int:
    """Cycles of a move that does not depend on distances.

    Parameters
    ----------
    operation : str
        As in the cost model.
    planes : int
        Word length.
    layout : Layout

    Returns
    -------
    int

    Examples
    --------
    >>> cycles('copy', 16, Layout((32, 32), 32))
    32
    """
    if operation in _BY_LINES:
        return 2 * planes * layout.es * layout.blocks
    each, once = _PER_PLANE[operation]
    return (each * planes + once) * layout.blocks


def neighbour(planes: int, layout: Layout, distance: int, axis: int, cyclic: bool) -> int:
    """Cycles of reading every element's neighbour so many places further along an axis, and storing it."""
    each, once = _routes(layout, distance, axis, cyclic)
    return each * planes + once


@lru_cache(maxsize=LAYOUTS_CACHED)
def _routes(layout: Layout, distance: int, axis: int, cyclic: bool) -> tuple[int, int]:
    """Instructions for each plane of all blocks, and those once for the operation (loading A)."""
    block, row, column, kept = _places_along(layout, axis)
    # Places from 1, so that 0 is what no element comes from: zeros come in over the edge of the array of PEs.
    source = moved(np.arange(1, block.size + 1), distance, 0, cyclic)
    held = source > 0
    at = source[held] - 1
    half = layout.es // 2
    steps = [(place[at] - place[held] + half) % layout.es - half for place in (row, column)]
    routes = np.unique(np.stack([block[held], block[at], *steps]), axis=1)
    news = int(np.abs(routes[2:]).sum())
    passes = np.bincount(routes[0], minlength=int(block.max()) + 1)
    # A block that all comes to one way needs no A; one that nothing comes to is cleared.
    alone, cleared = passes == 1, int((passes == 0).sum())
    return kept * (2 * int(passes.sum()) + news + cleared), kept * int(passes[~alone].sum())


def _places_along(layout: Layout, axis: int) -> tuple[IntArray, IntArray, IntArray, int]:
    """Block, row and column of the PE along one axis, and how many blocks there are across."""
    if len(layout.shape) == 2:
        extent: tuple[int, int] = (layout.shape[0], 1) if axis == 0 else (1, layout.shape[1])
        block, row, column = Layout(extent, layout.es, layout.mapping).places()
        return block.ravel(), row.ravel(), column.ravel(), layout.grid[1 - axis]
    return *layout.places(), 1
