"""The functions of Fortran-Plus, as Python functions on parallel arrays.

ELN, MINP, MERGE, SUM, MATR, MAX and FLOAT are in the thesis (appendices, 3.2). The others are recalled from the DAP
literature; where a definition had to be chosen its docstring states it. Positions count from 1, and 0 means "none".
Elements of a matrix are ordered down the columns, as Fortran arrays are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from msgs_py.numeric.typed import BoolArray

from ..bit_planes.processors import Field
from . import reductions, serial
from .arrangement import (
    SHIFTS,
    alt,
    altc,
    altr,
    checked_array,
    col,
    cols,
    column_order,
    el,
    els,
    filled,
    index_vector,
    lower_triangle,
    mat,
    matc,
    matr,
    rev,
    revc,
    revr,
    row,
    rows_,
    tran,
    unit_diagonal,
    upper_triangle,
    vec,
)
from .arrays import DapArray, Operand, Scalar
from .kinds import LOGICAL, Kind, common_kind, integer, real
from .operands import checked_scalar, scalar_kind

# Element by element.


def _elementwise(
    name: str, function: Callable[..., Any], scalar: Callable[[Any], float], cost: str = 'function'
) -> Callable[[Operand], Any]:
    """A REAL function of one argument, from numpy's function of arrays and math's of scalars."""

    def apply(x: Operand) -> Any:
        if not isinstance(x, DapArray):
            try:
                return float(scalar(x))
            except (ValueError, OverflowError):
                return math.inf if name == 'EXP' else math.nan
        source = checked_array(x, name, logical=False)
        if source.kind.name == 'INTEGER':
            source = source.astype(real(4))
        source.charge(cost, source.kind)
        if source.dap.in_bits:
            with source.arithmetic(source.kind) as work:
                return source.like_field(source.kind, work.function(name, source.field))
        with np.errstate(all='ignore'):
            return source.like(source.kind, source.kind.fit(function(source.values)))

    apply.__name__ = name.lower()
    apply.__doc__ = f'{name}(x): element by element, REAL; an INTEGER is first converted. Out of its domain: NaN.'
    return apply


exp = _elementwise('EXP', np.exp, math.exp)
log = _elementwise('LOG', np.log, math.log)
sin = _elementwise('SIN', np.sin, math.sin)
cos = _elementwise('COS', np.cos, math.cos)
tan = _elementwise('TAN', np.tan, math.tan)
atan = _elementwise('ATAN', np.arctan, math.atan)
asin = _elementwise('ASIN', np.arcsin, math.asin)
acos = _elementwise('ACOS', np.arccos, math.acos)
sqrt = _elementwise('SQRT', np.sqrt, math.sqrt, 'sqrt')


def absolute(x: Operand) -> Any:
    """ABS(x): magnitude, element by element. The most negative INTEGER wraps to itself, as its word does."""
    return abs(x)


def fix(x: Operand) -> Any:
    """FIX(x): REAL to INTEGER*4, toward zero; NaN gives 0."""
    return x.astype(integer(4)) if isinstance(x, DapArray) else integer(4).scalar(float(x))


def float_(x: Operand) -> Any:
    """FLOAT(x): INTEGER to REAL*4."""
    return x.astype(real(4)) if isinstance(x, DapArray) else real(4).scalar(float(x))


def length(x: Operand, n: int) -> Any:
    """LENGTH(x, n): the same class of number in a word of n bytes; integers wrap, reals round."""
    if isinstance(x, DapArray):
        source = checked_array(x, 'LENGTH', logical=False)
        return source.astype(real(n) if source.kind.name == 'REAL' else integer(n))
    kind = real(n) if isinstance(x, float) else integer(n)
    return kind.scalar(x)


def atan2(y: Operand, x: Operand) -> Any:
    """ATAN2(y, x): the angle of (x, y), element by element, radians in -pi..pi."""
    if not isinstance(y, DapArray) and not isinstance(x, DapArray):
        return math.atan2(y, x)
    first = y if isinstance(y, DapArray) else x
    assert isinstance(first, DapArray)
    if first.dap.in_bits:
        return _atan2_on_planes(first, y, x)
    a, b, kind = _pair('ATAN2', y, x)
    if kind.name == 'INTEGER':
        kind = real(4)
    first.charge('divide', kind)
    first.charge('function', kind)
    return first.like(kind, kind.fit(np.arctan2(kind.convert(np.asarray(a)), kind.convert(np.asarray(b)))))


def _atan2_on_planes(first: DapArray, y: Operand, x: Operand) -> DapArray:
    """ATAN2 on bit-planes; ``first`` is one of the two that is an array."""
    above, right, kind = _fields('ATAN2', y, x)
    with first.processors() as pe:
        if kind.name == 'INTEGER':
            above, right = (serial.convert(pe, kind, real(4), first.dap.nearest, side) for side in (above, right))
            kind = real(4)
    first.charge('divide', kind)
    first.charge('function', kind)
    with first.arithmetic(kind) as work:
        return first.like_field(kind, work.function('ATAN2', above, right))


def _fields(name: str, a: Operand, b: Operand) -> tuple[Field, Field, Kind]:
    """Bit-planes of two operands in their common kind, at least one of them an array."""
    if isinstance(a, DapArray):
        return a.common_fields(b, name)
    assert isinstance(b, DapArray)
    right, left, kind = b.common_fields(a, name)
    return left, right, kind


def _pair(name: str, a: Operand, b: Operand) -> tuple[Any, Any, Kind]:
    """Values of two operands in their common kind, at least one of them an array."""
    if isinstance(a, DapArray):
        return a.common_values(b, name)
    assert isinstance(b, DapArray)
    right, left, kind = b.common_values(a, name)
    return left, right, kind


def _extreme_of_two(name: str, function: Callable[..., Any], scalar: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """MAX or MIN, from numpy's function of two arrays and Python's of two scalars."""

    def apply(a: Operand, *rest: Operand) -> Any:
        result: Any = a
        for b in rest:
            array = result if isinstance(result, DapArray) else b
            if isinstance(array, DapArray) and array.dap.in_bits:
                p, q, kind = _fields(name, result, b)
                array.charge('minmax', kind)
                with array.arithmetic(kind) as work:
                    result = array.like_field(kind, work.extreme(p, q, name == 'MAX'))
            elif isinstance(array, DapArray):
                x, y, kind = _pair(name, result, b)
                array.charge('minmax', kind)
                result = array.like(kind, function(x, y))
            else:
                result = scalar(result, b)
        return result if rest else _extreme_value(name, result)

    apply.__name__ = name.lower()
    apply.__doc__ = (
        f'{name}(a, b, ...): element by element. {name}(array) of one array is its {name.lower()}imum as a scalar.'
    )
    return apply


def _extreme_value(name: str, x: Any, mask: Any = None) -> Any:
    """The largest or smallest element where the mask is true; for an empty mask the worst value of the kind."""
    source = checked_array(x, name, logical=False)
    source.charge('extreme_value', source.kind)
    if source.dap.in_bits:
        # The control unit has learnt the bits of the value while the candidates were narrowed.
        reductions.extreme_places(source, None if mask is None else _mask_array(source, mask), name.startswith('MAX'))
    values = source.values if mask is None else source.values[_masked(source, mask)]
    highest = name.startswith('MAX')
    if not values.size:
        low, high = source.kind.range if source.kind.name == 'INTEGER' else (-math.inf, math.inf)
        return low if highest else high
    return (values.max() if highest else values.min()).item()


def _masked(source: DapArray, mask: Any) -> BoolArray:
    """Values of a mask, which must have the array's shape."""
    return _mask_array(source, mask).values


def _mask_array(source: DapArray, mask: Any) -> DapArray:
    """A mask, which must have the array's shape."""
    flags = checked_array(mask, 'mask', logical=True)
    if flags.shape != source.shape:
        raise ValueError(f'mask: shape {flags.shape} differs from {source.shape}')
    return flags


maximum = _extreme_of_two('MAX', np.maximum, max)
minimum = _extreme_of_two('MIN', np.minimum, min)


def mod(a: Operand, b: Operand) -> Any:
    """MOD(a, b): remainder with the sign of a. A zero divisor gives 0 for INTEGER, NaN for REAL."""
    if isinstance(a, DapArray):
        return a.binary('remainder', b)
    if isinstance(b, DapArray):
        return b.binary('remainder', a, swapped=True)
    if b == 0:
        return math.nan if isinstance(a, float) or isinstance(b, float) else 0
    if isinstance(a, float) or isinstance(b, float):
        return math.fmod(a, b)
    return abs(a) % abs(b) * (1 if a >= 0 else -1)


def sign(a: Operand, b: Operand) -> Any:
    """SIGN(a, b): the magnitude of a with the sign of b."""
    if not isinstance(a, DapArray) and not isinstance(b, DapArray):
        return abs(a) if b >= 0 else -abs(a)
    array = a if isinstance(a, DapArray) else b
    assert isinstance(array, DapArray)
    if array.dap.in_bits:
        p, q, kind = _fields('SIGN', a, b)
        array.charge('merge', kind)
        with array.arithmetic(kind) as work:
            return array.like_field(kind, work.with_sign(p, q))
    x, y, kind = _pair('SIGN', a, b)
    array.charge('merge', kind)
    size = np.broadcast_to(np.abs(x), array.shape)
    signed = np.where(np.broadcast_to(y, array.shape) >= 0, size, -size)
    return array.like(kind, kind.fit(signed.astype(kind.dtype)))


def merge(a: Operand, b: Operand, mask: Any, kind: Kind | None = None) -> Any:
    """MERGE(a, b, mask): a where the mask is true, b elsewhere."""
    if not isinstance(mask, DapArray):
        if not isinstance(mask, (bool, np.bool_)):
            raise ValueError('MERGE: expected a LOGICAL mask')
        return a if mask else b
    flags = checked_array(mask, 'MERGE mask', logical=True)
    arrays = [x for x in (a, b) if isinstance(x, DapArray)]
    for x in arrays:
        if x.shape != flags.shape:
            raise ValueError(f'MERGE: shapes {x.shape} and {flags.shape} differ')
    # Of two scalars the caller knows the word length; Python's numbers have none.
    kind = kind if kind is not None and not arrays else _merged_kind(a, b)
    if flags.dap.in_bits:
        return _merge_on_planes(flags, a, b, kind)
    for x in arrays:
        if x.kind.name == 'INTEGER' and kind.name == 'REAL':
            x.charge('convert', kind)
    sides = [
        kind.convert(x.values)
        if isinstance(x, DapArray)
        else kind.dtype.type(kind.scalar(checked_scalar(kind, x, 'MERGE')))
        for x in (a, b)
    ]
    flags.charge('merge', kind)
    return flags.like(kind, np.where(flags.values, sides[0], sides[1]))


def _merge_on_planes(flags: DapArray, a: Operand, b: Operand, kind: Kind) -> DapArray:
    """MERGE on bit-planes."""
    sides = [
        x.field_as(kind) if isinstance(x, DapArray) else flags.constant(kind, checked_scalar(kind, x, 'MERGE'))
        for x in (a, b)
    ]
    flags.charge('merge', kind)
    with flags.processors() as pe:
        return flags.like_field(kind, pe.select(flags.field[0], *sides))


def _merged_kind(a: Operand, b: Operand) -> Kind:
    """The kind that holds either operand of a MERGE."""
    if isinstance(a, DapArray) and isinstance(b, DapArray):
        if (a.kind.name == 'LOGICAL') != (b.kind.name == 'LOGICAL'):
            raise ValueError(f'MERGE: {a.kind} and {b.kind} do not mix')
        return common_kind(a.kind, b.kind)
    if isinstance(a, DapArray):
        return scalar_kind(a.kind, b, 'MERGE')
    if isinstance(b, DapArray):
        return scalar_kind(b.kind, a, 'MERGE')
    if isinstance(a, bool) or isinstance(b, bool):
        return LOGICAL
    return real(4) if isinstance(a, float) or isinstance(b, float) else integer(4)


# Whole arrays to scalars.


def all_(mask: Any) -> bool:
    """ALL(l): whether every element is true."""
    flags = checked_array(mask, 'ALL', logical=True)
    flags.charge_move('any_all')
    return flags.count_true() == flags.size


def any_(mask: Any) -> bool:
    """ANY(l): whether some element is true."""
    flags = checked_array(mask, 'ANY', logical=True)
    flags.charge_move('any_all')
    return flags.any_true()


def maxv(x: Any, mask: Any = None) -> Scalar:
    """MAXV(x) or MAXV(x, mask): the largest element. No element chosen: the kind's lowest value."""
    value: Scalar = _extreme_value('MAXV', x, mask)
    return value


def minv(x: Any, mask: Any = None) -> Scalar:
    """MINV(x) or MINV(x, mask): the smallest element. No element chosen: the kind's highest value."""
    value: Scalar = _extreme_value('MINV', x, mask)
    return value


def _positions(name: str, x: Any, mask: Any) -> DapArray:
    """Every place of the largest or smallest element where the mask is true."""
    source = checked_array(x, name, logical=False)
    source.charge('extreme', source.kind)
    if source.dap.in_bits:
        return reductions.extreme_places(source, None if mask is None else _mask_array(source, mask), name == 'MAXP')
    values = source.values
    if mask is None:
        return source.like(LOGICAL, values == (values.max() if name == 'MAXP' else values.min()))
    chosen = _masked(source, mask)
    if not chosen.any():
        return source.like(LOGICAL, chosen.copy())
    best = values[chosen].max() if name == 'MAXP' else values[chosen].min()
    return source.like(LOGICAL, (values == best) & chosen)


def maxp(x: Any, mask: Any = None) -> DapArray:
    """MAXP(x) or MAXP(x, mask): true at every place of the largest element; all false when none is chosen."""
    return _positions('MAXP', x, mask)


def minp(x: Any, mask: Any = None) -> DapArray:
    """MINP(x) or MINP(x, mask): true at every place of the smallest element; all false when none is chosen."""
    return _positions('MINP', x, mask)


def sum_(x: Any, mask: Any = None) -> Scalar:
    """SUM(x): the number of trues of a LOGICAL; the sum of numbers, INTEGER in a word of at least 4 bytes."""
    source = checked_array(x, 'SUM')
    source.charge('sum', source.kind)
    if source.dap.in_bits:
        return reductions.total(source, None if mask is None else _mask_array(source, mask), _sum_kind(source.kind))
    if source.kind.name == 'LOGICAL':
        return source.count_true()
    values = source.values if mask is None else source.values[_masked(source, mask)]
    kind = _sum_kind(source.kind)
    return kind.scalar(values.sum(dtype=kind.dtype).item())


def _sum_kind(kind: Kind) -> Kind:
    """The kind of a sum of numbers: an INTEGER has at least 4 bytes."""
    if kind.name == 'REAL':
        return kind
    return integer(4) if kind.name == 'LOGICAL' else integer(max(4, kind.length))


def eln(mask: Any) -> int:
    """ELN(l): position of the first true element, from 1, down the columns of a matrix; 0 when there is none."""
    flags = checked_array(mask, 'ELN', logical=True)
    flags.charge_move('first_true')
    order = column_order(flags.values)
    first = int(order.argmax())
    return first + 1 if order[first] else 0


def rown(mask: Any) -> int:
    """ROWN(l): row, from 1, of the element ELN finds; 0 when there is none."""
    flags = checked_array(mask, 'ROWN', rank=2, logical=True)
    where = eln(flags)
    return (where - 1) % flags.shape[0] + 1 if where else 0


def coln(mask: Any) -> int:
    """COLN(l): column, from 1, of the element ELN finds; 0 when there is none."""
    flags = checked_array(mask, 'COLN', rank=2, logical=True)
    where = eln(flags)
    return (where - 1) // flags.shape[0] + 1 if where else 0


def frst(mask: Any) -> DapArray:
    """FRST(l): only the first true element stays true (in the order of ELN)."""
    flags = checked_array(mask, 'FRST', logical=True)
    flags.charge_move('first_true')
    order = column_order(flags.values)
    out = np.zeros(flags.shape, dtype=bool)
    if order.any():
        first = int(order.argmax())
        out[(first % flags.shape[0], first // flags.shape[0]) if flags.rank == 2 else first] = True
    return flags.like(LOGICAL, out)


# Along one dimension.


def _sum_axis(name: str, x: Any, axis: int) -> DapArray:
    """Sums of a matrix along one axis; of a LOGICAL, counts of its trues."""
    source = checked_array(x, name, rank=2)
    source.charge('sum_axis', source.kind, axis=axis)
    kind = _sum_kind(source.kind)
    if source.dap.in_bits:
        return reductions.totals_along(source, axis, kind)
    return source.like(kind, kind.fit(source.values.sum(axis=axis, dtype=kind.dtype)))


def sumr(x: Any) -> DapArray:
    """SUMR(m): add the rows together: a vector with one element a column."""
    return _sum_axis('SUMR', x, 0)


def sumc(x: Any) -> DapArray:
    """SUMC(m): add the columns together: a vector with one element a row."""
    return _sum_axis('SUMC', x, 1)


__all__ = [
    'SHIFTS',
    'absolute',
    'acos',
    'all_',
    'alt',
    'altc',
    'altr',
    'any_',
    'asin',
    'atan',
    'atan2',
    'col',
    'coln',
    'cols',
    'cos',
    'el',
    'eln',
    'els',
    'exp',
    'filled',
    'fix',
    'float_',
    'frst',
    'index_vector',
    'length',
    'log',
    'lower_triangle',
    'mat',
    'matc',
    'matr',
    'maximum',
    'maxp',
    'maxv',
    'merge',
    'minimum',
    'minp',
    'minv',
    'mod',
    'rev',
    'revc',
    'revr',
    'row',
    'rown',
    'rows_',
    'sign',
    'sin',
    'sqrt',
    'sum_',
    'sumc',
    'sumr',
    'tan',
    'tran',
    'unit_diagonal',
    'upper_triangle',
    'vec',
]
