"""The intrinsic functions a program can call: arity, the type of the result, and what runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..machine import intrinsics as f
from ..machine.arrays import DapArray
from ..machine.kinds import LOGICAL, Kind, common_kind, integer, real
from ..machine.machine import Machine
from .syntax import Type

Rule = Callable[[Sequence[Type]], Type]


@dataclass(frozen=True)
class Function:
    """An intrinsic function.

    Parameters
    ----------
    least, most : int
        Number of arguments.
    result : callable
        Type of the result, from the types of the arguments; raises ValueError when they are not accepted.
    run : callable
        ``run(dap, *values)`` computes it.
    is_real_work : bool
        Whether a scalar call costs the control unit as much as an elementary function of a REAL.
    description : str
        Its documentation, when not that of ``run``.
    makes_arrays_of_scalars : bool
        Whether ``run`` takes the result's kind, which scalars do not tell when it runs.
    """

    least: int
    most: int
    result: Rule
    run: Callable[..., Any]
    is_real_work: bool = False
    description: str = ''
    makes_arrays_of_scalars: bool = False

    @property
    def doc(self) -> str:
        """Documentation in one paragraph."""
        return ' '.join((self.description or self.run.__doc__ or '').split())


def combined(a: Type, b: Type) -> Type:
    """The type of an operation on two numbers.

    Parameters
    ----------
    a, b : Type
        A scalar takes the word length of the array it meets.

    Returns
    -------
    Type

    Raises
    ------
    ValueError
        For operands that are not numbers, or of different ranks.

    Examples
    --------
    >>> str(combined(Type(integer(2), rank=2), Type(integer(4))))
    'INTEGER*2 matrix'
    """
    if not (a.kind.is_numeric and b.kind.is_numeric):
        raise ValueError(f'expected numbers, got {a} and {b}')
    return Type(combined_kind(a, b), combined_rank(a, b))


def combined_kind(a: Type, b: Type) -> Kind:
    """The kind of an operation on two numbers."""
    if bool(a.rank) == bool(b.rank):
        return common_kind(a.kind, b.kind)
    array, scalar = (a, b) if a.rank else (b, a)
    if array.kind.name == 'INTEGER' and scalar.kind.name == 'REAL':
        return real(4) if array.kind.bits <= 32 else real(8)
    return array.kind


def combined_rank(a: Type, b: Type) -> int:
    """The rank of an operation on two values. Raises ValueError when a vector meets a matrix."""
    if a.rank and b.rank and a.rank != b.rank:
        raise ValueError(f'a {("vector", "matrix")[a.rank - 1]} meets a {("vector", "matrix")[b.rank - 1]}')
    return max(a.rank, b.rank)


def _number(t: Type) -> Type:
    """A type that must be numeric."""
    if not t.kind.is_numeric:
        raise ValueError(f'expected numbers, got {t}')
    return t


def _parallel(t: Type, rank: int | None = None, logical: bool | None = None) -> Type:
    """A type that must be an array, of this rank and class where they are given."""
    if not t.rank or (rank and t.rank != rank):
        raise ValueError(f'expected a {("vector", "matrix")[rank - 1] if rank else "vector or matrix"}, got {t}')
    if logical is not None and (t.kind.name == 'LOGICAL') != logical:
        raise ValueError(f'expected {"LOGICAL" if logical else "numbers"}, got {t}')
    return t


def _as_real(types: Sequence[Type]) -> Type:
    t = _number(types[0])
    return Type(t.kind if t.kind.name == 'REAL' else real(4), t.rank)


def _all_combined(types: Sequence[Type]) -> Type:
    if len(types) == 1:
        return Type(_parallel(types[0], logical=False).kind)
    total = _number(types[0])
    for t in types[1:]:
        total = combined(total, t)
    return total


def _combined_real(types: Sequence[Type]) -> Type:
    return _as_real([combined(types[0], types[1])])


def _merge(types: Sequence[Type]) -> Type:
    a, b, mask = types
    if mask.kind.name != 'LOGICAL':
        raise ValueError(f'the mask is {mask}, expected LOGICAL')
    for t in (a, b):
        if t.rank and t.rank != mask.rank:
            raise ValueError(f'{t} under a mask of another rank')
    if a.kind.name == b.kind.name == 'LOGICAL':
        return Type(LOGICAL, mask.rank)
    return Type(combined(a, b).kind, mask.rank)


def _mask_of(types: Sequence[Type], result: Callable[[Type], Type]) -> Type:
    """The result for an array with an optional mask of its rank."""
    source = _parallel(types[0])
    if len(types) > 1 and (types[1].kind.name != 'LOGICAL' or types[1].rank != source.rank):
        raise ValueError(f'the mask is {types[1]}, expected LOGICAL of the same rank')
    return result(source)


def _summed(t: Type) -> Kind:
    """The kind of a sum; of a LOGICAL it is a count."""
    if t.kind.name == 'REAL':
        return t.kind
    return integer(max(4, t.kind.length)) if t.kind.name == 'INTEGER' else integer(4)


def _sum(types: Sequence[Type]) -> Type:
    return _mask_of(types, lambda t: Type(_summed(t)))


def _extreme(types: Sequence[Type]) -> Type:
    return _mask_of(types, lambda t: Type(_parallel(t, logical=False).kind))


def _places(types: Sequence[Type]) -> Type:
    return _mask_of(types, lambda t: Type(LOGICAL, _parallel(t, logical=False).rank))


def _logical_to(kind: Kind, rank: int | None = None, keep: bool = False) -> Rule:
    return lambda types: Type(
        kind, _parallel(types[0], rank, True).rank if keep else 0 * _parallel(types[0], rank, True).rank
    )


def _integers(types: Sequence[Type], first: int = 0) -> None:
    """Arguments from this one on must be INTEGER scalars."""
    for t in types[first:]:
        if t.rank or t.kind.name != 'INTEGER':
            raise ValueError(f'expected an INTEGER scalar, got {t}')


def _pattern(rank: int, kind: Kind = LOGICAL) -> Rule:
    def rule(types: Sequence[Type]) -> Type:
        _integers(types)
        return Type(kind, rank)

    return rule


def _reshape(source_rank: int, result_rank: int) -> Rule:
    def rule(types: Sequence[Type]) -> Type:
        _integers(types, 1)
        return Type(_parallel(types[0], source_rank).kind, result_rank)

    return rule


def _spread(result_rank: int) -> Rule:
    """MAT and VEC: of a scalar, or of the other shape."""

    def rule(types: Sequence[Type]) -> Type:
        _integers(types, 1)
        if types[0].rank == result_rank or types[0].kind.name == 'CHARACTER':
            raise ValueError(f'cannot spread {types[0]}')
        return Type(types[0].kind, result_rank)

    return rule


def _axis_sum(types: Sequence[Type]) -> Type:
    return Type(_summed(_parallel(types[0], 2)), 1)


def _convert(kind: Kind) -> Rule:
    return lambda types: Type(kind, _number(types[0]).rank)


def _length(types: Sequence[Type]) -> Type:
    # The checker has the constant's value, and finds the type of LENGTH itself.
    raise ValueError('the word length must be a constant')


def _int_of_two(types: Sequence[Type]) -> Type:
    return combined(_number(types[0]), types[1])


def _sized(types: Sequence[Type]) -> Type:
    _parallel(types[0])
    _integers(types, 1)
    return Type(integer(4))


def _size(dap: Machine, x: DapArray, axis: int = 0) -> int:
    """SIZE(x): number of elements. SIZE(x, d): extent of parallel dimension d (our addition)."""
    if axis not in range(0, x.rank + 1):
        raise ValueError(f'SIZE: dimension {axis} of an array that has {x.rank}')
    return x.size if axis == 0 else x.shape[axis - 1]


def _without_dap(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of values as one of machine and values."""
    return lambda dap, *values: function(*values)


def _of_values(least: int, most: int, rule: Rule, function: Callable[..., Any], is_real_work: bool = False) -> Function:
    """An intrinsic function that needs no machine but that of its arguments."""
    return Function(least, most, rule, _without_dap(function), is_real_work, function.__doc__ or '')


FUNCTIONS: dict[str, Function] = {
    'ABS': _of_values(1, 1, lambda t: Type(_number(t[0]).kind, t[0].rank), f.absolute),
    'FIX': _of_values(1, 1, _convert(integer(4)), f.fix),
    'INT': _of_values(1, 1, _convert(integer(4)), f.fix),
    'FLOAT': _of_values(1, 1, _convert(real(4)), f.float_),
    'LENGTH': _of_values(2, 2, _length, f.length),
    'MAX': _of_values(1, 9, _all_combined, f.maximum),
    'MIN': _of_values(1, 9, _all_combined, f.minimum),
    'MOD': _of_values(2, 2, _int_of_two, f.mod),
    'SIGN': _of_values(2, 2, _int_of_two, f.sign),
    'MERGE': Function(
        3, 3, _merge, lambda dap, a, b, mask, kind: f.merge(a, b, mask, kind), False, f.merge.__doc__ or '', True
    ),
    'ALL': _of_values(1, 1, _logical_to(LOGICAL), f.all_),
    'ANY': _of_values(1, 1, _logical_to(LOGICAL), f.any_),
    'MAXV': _of_values(1, 2, _extreme, f.maxv),
    'MINV': _of_values(1, 2, _extreme, f.minv),
    'MAXP': _of_values(1, 2, _places, f.maxp),
    'MINP': _of_values(1, 2, _places, f.minp),
    'SUM': _of_values(1, 2, _sum, f.sum_),
    'SUMR': _of_values(1, 1, _axis_sum, f.sumr),
    'SUMC': _of_values(1, 1, _axis_sum, f.sumc),
    'ELN': _of_values(1, 1, _logical_to(integer(4)), f.eln),
    'ROWN': _of_values(1, 1, _logical_to(integer(4), 2), f.rown),
    'COLN': _of_values(1, 1, _logical_to(integer(4), 2), f.coln),
    'FRST': _of_values(1, 1, _logical_to(LOGICAL, keep=True), f.frst),
    'MATR': _of_values(1, 2, _reshape(1, 2), f.matr),
    'MATC': _of_values(1, 2, _reshape(1, 2), f.matc),
    'MAT': Function(1, 3, _spread(2), f.mat, makes_arrays_of_scalars=True),
    'VEC': Function(1, 2, _spread(1), f.vec, makes_arrays_of_scalars=True),
    'TRAN': _of_values(1, 1, _reshape(2, 2), f.tran),
    'REV': _of_values(1, 1, _reshape(1, 1), f.rev),
    'REVR': _of_values(1, 1, _reshape(2, 2), f.revr),
    'REVC': _of_values(1, 1, _reshape(2, 2), f.revc),
    'ROW': Function(1, 3, _pattern(2), f.row),
    'ROWS': Function(2, 4, _pattern(2), f.rows_),
    'COL': Function(1, 3, _pattern(2), f.col),
    'COLS': Function(2, 4, _pattern(2), f.cols),
    'EL': Function(1, 2, _pattern(1), f.el),
    'ELS': Function(2, 3, _pattern(1), f.els),
    'ALT': Function(1, 2, _pattern(1), f.alt),
    'ALTR': Function(1, 3, _pattern(2), f.altr),
    'ALTC': Function(1, 3, _pattern(2), f.altc),
    'PATUNITDIAG': Function(0, 2, _pattern(2), f.unit_diagonal),
    'PATLOWERTRI': Function(0, 2, _pattern(2), f.lower_triangle),
    'PATUPPERTRI': Function(0, 2, _pattern(2), f.upper_triangle),
    'INDEX': Function(0, 1, _pattern(1, integer(4)), f.index_vector),
    'SIZE': Function(1, 2, _sized, _size),
}
for _name in ('EXP', 'LOG', 'SIN', 'COS', 'TAN', 'ATAN', 'ASIN', 'ACOS', 'SQRT'):
    FUNCTIONS[_name] = _of_values(1, 1, _as_real, getattr(f, _name.lower()), is_real_work=True)
FUNCTIONS['ATAN2'] = _of_values(2, 2, _combined_real, f.atan2, is_real_work=True)
for _name, _shift in f.SHIFTS.items():
    _rank = 1 if _name[2] in 'LR' else 2
    FUNCTIONS[_name] = _of_values(1, 2, _reshape(_rank, _rank), _shift)
