"""Arrangement: arrays from scalars and patterns, spreading, transposing, reversing and shifting.

Definitions as for intrinsics.py, which offers these functions too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray

from .arrays import DapArray, Operand, Scalar
from .fields import form_of, real_cells
from .kinds import LOGICAL, Kind, integer, real
from .machine import Machine

_RANKS = ('vector', 'matrix')
_WAYS = {'N': 'up', 'S': 'down', 'W': 'to the left', 'E': 'to the right', 'L': 'to the left', 'R': 'to the right'}


def checked_array(value: Any, name: str, rank: int | None = None, logical: bool | None = None) -> DapArray:
    """Return a value that must be a parallel array.

    Parameters
    ----------
    value : object
    name : str
        Beginning of the error's text.
    rank : {1, 2}, optional
        Vector or matrix; either when not given.
    logical : bool, optional
        LOGICAL or numeric; either when not given.

    Raises
    ------
    ValueError
        When it is something else.
    """
    if not isinstance(value, DapArray):
        raise ValueError(f'{name}: expected a parallel array, got {value!r}')
    if rank is not None and value.rank != rank:
        raise ValueError(f'{name}: expected a {_RANKS[rank - 1]}, got a {_RANKS[value.rank - 1]}')
    if logical is not None and (value.kind.name == 'LOGICAL') != logical:
        raise ValueError(f'{name}: expected {"LOGICAL" if logical else "numbers"}, got {value.kind}')
    return value


def column_order(values: AnyArray) -> AnyArray:
    """Elements of a matrix in the order of a long vector, which is down its columns; a vector as it is."""
    return values.T.reshape(-1) if values.ndim == 2 else values


def matr(v: Any, rows: int | None = None) -> DapArray:
    """MATR(v) or MATR(v, rows): the matrix whose every row is v; by default as many rows as v has elements."""
    source = checked_array(v, 'MATR', rank=1)
    shape = _checked(source.dap, source.kind, (_extent('MATR', rows or source.shape[0]), source.shape[0]))
    out = source.like_cells(np.ascontiguousarray(np.broadcast_to(source.cells, shape)))
    out.charge_move('broadcast')
    return out


def matc(v: Any, columns: int | None = None) -> DapArray:
    """MATC(v) or MATC(v, columns): the matrix whose every column is v."""
    source = checked_array(v, 'MATC', rank=1)
    shape = _checked(source.dap, source.kind, (source.shape[0], _extent('MATC', columns or source.shape[0])))
    out = source.like_cells(np.ascontiguousarray(np.broadcast_to(source.cells[:, None], shape)))
    out.charge_move('broadcast')
    return out


def _extent(name: str, value: int) -> int:
    """An extent, checked. Raises ValueError starting with name."""
    if not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f'{name}: expected an extent of at least 1, got {value!r}')
    return int(value)


def _checked(dap: Machine, kind: Kind, shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape, when the store has room for it: extents from a program may be too large for this computer, too."""
    wanted = kind.bits * dap.layout(shape).blocks
    dap.store.take(wanted, f'a {kind} array of shape {shape}')
    dap.store.give_back(wanted)
    return shape


def mat(
    dap: Machine, x: Operand, rows: int | None = None, columns: int | None = None, kind: Kind | None = None
) -> DapArray:
    """MAT(s): a matrix full of a scalar. MAT(v, rows, columns): a long vector folded down the columns; zeros fill up.

    ES x ES when no extents are given.
    """
    shape = _extent('MAT', rows or dap.es), _extent('MAT', columns or dap.es)
    if isinstance(x, DapArray):
        source = checked_array(x, 'MAT', rank=1)
        _checked(dap, source.kind, shape)
        full = np.zeros(shape[0] * shape[1], dtype=source.cells.dtype)
        if source.size > full.size:
            raise ValueError(f'MAT: {source.size} elements do not fit a matrix of {shape[0]} x {shape[1]}')
        full[: source.size] = source.cells
        out = source.like_cells(np.ascontiguousarray(full.reshape(shape[::-1]).T))
    else:
        kind = kind or _kind_of_scalar(x)
        out = filled(dap, x, _checked(dap, kind, shape), kind)
    out.charge_move('copy')
    return out


def vec(dap: Machine, x: Operand, n: int | None = None, kind: Kind | None = None) -> DapArray:
    """VEC(s, n): a vector full of a scalar (ES long when n is not given). VEC(m): a matrix as a long vector."""
    if isinstance(x, DapArray):
        source = checked_array(x, 'VEC', rank=2)
        source.charge_move('copy')
        return source.like_cells(column_order(source.cells).copy(), source.dap.mapping)
    kind = kind or _kind_of_scalar(x)
    out = filled(dap, x, _checked(dap, kind, (_extent('VEC', n or dap.es),)), kind)
    out.charge_move('copy')
    return out


def filled(dap: Machine, value: Scalar, shape: tuple[int, ...], kind: Kind | None = None) -> DapArray:
    """An array whose every element is one scalar. Charges nothing.

    Parameters
    ----------
    dap : Machine
    value : bool, int or float
    shape : tuple of int
    kind : Kind, optional
        LOGICAL, INTEGER*4 or REAL*4 after the value's class when not given.
    """
    if kind is None:
        kind = _kind_of_scalar(value)
    if dap.in_bits and kind.name == 'REAL':
        cell = real_cells(float(value), form_of(kind, dap.nearest))
        return DapArray(dap, kind, None, cells=np.full(shape, cell))
    return DapArray(dap, kind, np.full(shape, kind.scalar(value), dtype=kind.dtype))


def _kind_of_scalar(value: Scalar) -> Kind:
    """The kind that an array takes from a scalar's class."""
    return LOGICAL if isinstance(value, (bool, np.bool_)) else real(4) if isinstance(value, float) else integer(4)


def tran(x: Any) -> DapArray:
    """TRAN(m): the transpose."""
    return checked_array(x, 'TRAN', rank=2).T


def _reversed(name: str, x: Any, rank: int, axis: int) -> DapArray:
    """The elements in reverse order along an axis."""
    source = checked_array(x, name, rank=rank)
    source.charge_move('transpose')
    return source.like_cells(np.ascontiguousarray(np.flip(source.cells, axis)))


def rev(x: Any) -> DapArray:
    """REV(v): the elements in reverse order."""
    return _reversed('REV', x, 1, 0)


def revr(x: Any) -> DapArray:
    """REVR(m): the rows in reverse order."""
    return _reversed('REVR', x, 2, 0)


def revc(x: Any) -> DapArray:
    """REVC(m): the columns in reverse order."""
    return _reversed('REVC', x, 2, 1)


# Logical patterns of so many rows, columns or elements; ES where no extent is given.


def _pattern(dap: Machine, values: BoolArray) -> DapArray:
    """A LOGICAL array that the control unit writes from its registers."""
    out = DapArray(dap, LOGICAL, values)
    out.charge_move('pattern')
    return out


def _shape(dap: Machine, rows: int | None, columns: int | None) -> tuple[int, int]:
    """Extents of a LOGICAL matrix; ES where none is given."""
    shape = _extent('extent', rows or dap.es), _extent('extent', columns or dap.es)
    _checked(dap, LOGICAL, shape)
    return shape


def _elements(dap: Machine, name: str, n: int | None, kind: Kind = LOGICAL) -> int:
    """Extent of a vector; ES where none is given."""
    return _checked(dap, kind, (_extent(name, n or dap.es),))[0]


def _within(extent: int, first: int, last: int) -> BoolArray:
    """(extent,) bool: true in the places first to last, counted from 1."""
    index = np.arange(1, extent + 1)
    return (index >= first) & (index <= last)


def row(dap: Machine, i: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """ROW(i): a matrix true in row i only (nowhere when i is outside)."""
    return rows_(dap, i, i, rows, columns)


def rows_(dap: Machine, first: int, last: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """ROWS(i, j): a matrix true in rows i to j."""
    shape = _shape(dap, rows, columns)
    return _pattern(dap, np.repeat(_within(shape[0], first, last)[:, None], shape[1], axis=1))


def col(dap: Machine, j: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """COL(j): a matrix true in column j only."""
    return cols(dap, j, j, rows, columns)


def cols(dap: Machine, first: int, last: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """COLS(i, j): a matrix true in columns i to j."""
    shape = _shape(dap, rows, columns)
    return _pattern(dap, np.repeat(_within(shape[1], first, last)[None, :], shape[0], axis=0))


def el(dap: Machine, i: int, n: int | None = None) -> DapArray:
    """EL(i): a vector true in element i only."""
    return els(dap, i, i, n)


def els(dap: Machine, first: int, last: int, n: int | None = None) -> DapArray:
    """ELS(i, j): a vector true in elements i to j."""
    return _pattern(dap, _within(_elements(dap, 'ELS', n), first, last))


def _alternate(extent: int, run: int) -> BoolArray:
    """(extent,) bool: runs of so many falses and trues in turn."""
    odd_runs: BoolArray = np.arange(extent) // _extent('ALT', run) % 2 == 1
    return odd_runs


def alt(dap: Machine, run: int, n: int | None = None) -> DapArray:
    """ALT(r): a vector of r falses, r trues, r falses, ..."""
    return _pattern(dap, _alternate(_elements(dap, 'ALT', n), run))


def altr(dap: Machine, run: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """ALTR(r): a matrix of r rows false, r rows true, ..."""
    shape = _shape(dap, rows, columns)
    return _pattern(dap, np.repeat(_alternate(shape[0], run)[:, None], shape[1], axis=1))


def altc(dap: Machine, run: int, rows: int | None = None, columns: int | None = None) -> DapArray:
    """ALTC(r): a matrix of r columns false, r columns true, ..."""
    shape = _shape(dap, rows, columns)
    return _pattern(dap, np.repeat(_alternate(shape[1], run)[None, :], shape[0], axis=0))


def unit_diagonal(dap: Machine, rows: int | None = None, columns: int | None = None) -> DapArray:
    """PATUNITDIAG(): a matrix true on its main diagonal."""
    return _pattern(dap, np.eye(*_shape(dap, rows, columns), dtype=bool))


def lower_triangle(dap: Machine, rows: int | None = None, columns: int | None = None) -> DapArray:
    """PATLOWERTRI(): a matrix true on and below its main diagonal."""
    return _pattern(dap, np.tri(*_shape(dap, rows, columns), dtype=bool))


def upper_triangle(dap: Machine, rows: int | None = None, columns: int | None = None) -> DapArray:
    """PATUPPERTRI(): a matrix true on and above its main diagonal."""
    return _pattern(dap, np.tri(*_shape(dap, rows, columns)[::-1], dtype=bool).T.copy())


def index_vector(dap: Machine, n: int | None = None) -> DapArray:
    """INDEX(n): the INTEGER*4 vector 1, 2, ..., n (our addition: the language builds it from patterns)."""
    out = DapArray(dap, integer(4), np.arange(1, _elements(dap, 'INDEX', n, integer(4)) + 1, dtype=np.int32))
    out.charge_move('broadcast')
    return out


# Shifts are named SH, the direction in which the data moves (north is to lower rows, west and left to lower columns),
# and P or C for planar or cyclic.


def _shift(name: str, rank: int, axis: int, step: int, cyclic: bool) -> Callable[..., DapArray]:
    """One of the shift functions: the data moves against ``step`` along the axis."""

    def apply(x: Any, distance: int = 1) -> DapArray:
        source = checked_array(x, name, rank=rank)
        if distance < 0:
            raise ValueError(f'{name}: expected a distance >= 0, got {distance}')
        return source.neighbour(step * distance, axis, cyclic)

    apply.__name__ = name.lower()
    apply.__doc__ = (
        f'{name}(x, d = 1): every element moves d places '
        f'{_WAYS[name[2]]}; '
        f'{"what leaves comes in at the other end" if cyclic else "zeros (false) come in"}.'
    )
    return apply


SHIFTS: dict[str, Callable[..., DapArray]] = {
    f'SH{way}{geometry}': _shift(f'SH{way}{geometry}', rank, axis, step, geometry == 'C')
    for way, rank, axis, step in (
        ('N', 2, 0, 1),
        ('S', 2, 0, -1),
        ('W', 2, 1, 1),
        ('E', 2, 1, -1),
        ('L', 1, 0, 1),
        ('R', 1, 0, -1),
    )
    for geometry in 'PC'
}
