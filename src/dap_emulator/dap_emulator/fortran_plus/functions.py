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
    """least, most : number of arguments; result : type from the arguments' types; run(dap, *values)"""

    least: int
    most: int
    result: Rule
    run: Callable[..., Any]
    is_real_work: bool = False
    description: str = ''

    @property
    def doc(self) -> str:
        """What it does, in one paragraph."""
        return ' '.join((self.description or self.run.__doc__ or '').split())


def combined(a: Type, b: Type) -> Type:
    """The type of an operation on two numbers: a scalar takes the word length of the array it meets.

    Raises ValueError.
    """
    if not (a.kind.is_numeric and b.kind.is_numeric):
        raise ValueError(f'expected numbers, got {a} and {b}')
    return Type(combined_kind(a, b), combined_rank(a, b))


def combined_kind(a: Type, b: Type) -> Kind:
    if bool(a.rank) == bool(b.rank):
        return common_kind(a.kind, b.kind)
    array, scalar = (a, b) if a.rank else (b, a)
    if array.kind.name == 'INTEGER' and scalar.kind.name == 'REAL':
        return real(4) if array.kind.bits <= 32 else real(8)
    return array.kind


def combined_rank(a: Type, b: Type) -> int:
    if a.rank and b.rank and a.rank != b.rank:
        raise ValueError(f'a {("vector", "matrix")[a.rank - 1]} meets a {("vector", "matrix")[b.rank - 1]}')
    return max(a.rank, b.rank)


def _number(t: Type) -> Type:
    if not t.kind.is_numeric:
        raise ValueError(f'expected numbers, got {t}')
    return t


def _parallel(t: Type, rank: int | None = None, logical: bool | None = None) -> Type:
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
    source = _parallel(types[0])
    if len(types) > 1 and (types[1].kind.name != 'LOGICAL' or types[1].rank != source.rank):
        raise ValueError(f'the mask is {types[1]}, expected LOGICAL of the same rank')
    return result(source)


def _summed(t: Type) -> Kind:
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
    raise ValueError('the word length must be a constant')  # the checker sees to the constant case


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
    return lambda dap, *values: function(*values)


def _plain(least: int, most: int, rule: Rule, function: Callable[..., Any], is_real_work: bool = False) -> Function:
    return Function(least, most, rule, _without_dap(function), is_real_work, function.__doc__ or '')


FUNCTIONS: dict[str, Function] = {
    'ABS': _plain(1, 1, lambda t: Type(_number(t[0]).kind, t[0].rank), f.absolute),
    'FIX': _plain(1, 1, _convert(integer(4)), f.fix),
    'INT': _plain(1, 1, _convert(integer(4)), f.fix),
    'FLOAT': _plain(1, 1, _convert(real(4)), f.float_),
    'LENGTH': _plain(2, 2, _length, f.length),
    'MAX': _plain(1, 9, _all_combined, f.maximum),
    'MIN': _plain(1, 9, _all_combined, f.minimum),
    'MOD': _plain(2, 2, _int_of_two, f.mod),
    'SIGN': _plain(2, 2, _int_of_two, f.sign),
    'MERGE': _plain(3, 3, _merge, f.merge),
    'ALL': _plain(1, 1, _logical_to(LOGICAL), f.all_),
    'ANY': _plain(1, 1, _logical_to(LOGICAL), f.any_),
    'MAXV': _plain(1, 2, _extreme, f.maxv),
    'MINV': _plain(1, 2, _extreme, f.minv),
    'MAXP': _plain(1, 2, _places, f.maxp),
    'MINP': _plain(1, 2, _places, f.minp),
    'SUM': _plain(1, 2, _sum, f.sum_),
    'SUMR': _plain(1, 1, _axis_sum, f.sumr),
    'SUMC': _plain(1, 1, _axis_sum, f.sumc),
    'ELN': _plain(1, 1, _logical_to(integer(4)), f.eln),
    'ROWN': _plain(1, 1, _logical_to(integer(4), 2), f.rown),
    'COLN': _plain(1, 1, _logical_to(integer(4), 2), f.coln),
    'FRST': _plain(1, 1, _logical_to(LOGICAL, keep=True), f.frst),
    'MATR': _plain(1, 2, _reshape(1, 2), f.matr),
    'MATC': _plain(1, 2, _reshape(1, 2), f.matc),
    'MAT': Function(1, 3, _spread(2), f.mat),
    'VEC': Function(1, 2, _spread(1), f.vec),
    'TRAN': _plain(1, 1, _reshape(2, 2), f.tran),
    'REV': _plain(1, 1, _reshape(1, 1), f.rev),
    'REVR': _plain(1, 1, _reshape(2, 2), f.revr),
    'REVC': _plain(1, 1, _reshape(2, 2), f.revc),
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
    FUNCTIONS[_name] = _plain(1, 1, _as_real, getattr(f, _name.lower()), is_real_work=True)
FUNCTIONS['ATAN2'] = _plain(2, 2, _combined_real, f.atan2, is_real_work=True)
for _name, _shift in f.SHIFTS.items():
    _rank = 1 if _name[2] in 'LR' else 2
    FUNCTIONS[_name] = _plain(1, 2, _reshape(_rank, _rank), _shift)
