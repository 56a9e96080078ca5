"""Parallel arrays: the vectors and matrices of Fortran-Plus as Python values.

Every operation is computed with numpy (or, for LOGICAL, on packed bit-planes), cut to the word length, and charged to
the machine's cost model. On a machine that computes on bit-planes the numbers are fields of planes (serial.py), values
are made of them when they are asked for, and the cycles of every operation are counted as well. Indices in Python start
at 0, those of the language at 1.
"""

from __future__ import annotations

from typing import Any, Union

import numpy as np

from msgs_py.numeric.typed import AnyArray, WordArray

from ..bit_planes.processors import Field
from . import moves, planes, serial
from .kinds import LOGICAL, Kind, common_kind, parse_kind, real
from .operands import checked_scalar, moved, scalar_kind
from .stored_array import StoredArray

Scalar = Union[bool, int, float]  # noqa: UP007  (evaluated at run time)
Operand = Union['DapArray', Scalar]

_COMPARE = {
    'lt': np.less,
    'le': np.less_equal,
    'gt': np.greater,
    'ge': np.greater_equal,
    'eq': np.equal,
    'ne': np.not_equal,
}
_ARITHMETIC = {'add': np.add, 'subtract': np.subtract, 'multiply': np.multiply}
_LOGIC = {'and': np.bitwise_and, 'or': np.bitwise_or, 'neqv': np.bitwise_xor}


class DapArray(StoredArray):
    """A parallel vector or matrix on one machine; ``Dap.vector`` and ``Dap.matrix`` make them.

    Operators + - * / % ** & | ^ ~ and comparisons work element by element. A scalar takes the word length of the array
    it meets, and must fit; mixing two machines, mappings or shapes raises ValueError.

    Parameters
    ----------
    dap : Machine
    kind : Kind
    values : array of ``kind.dtype``, or None
    shape : tuple of int, optional
        Extents of an array that is given as words.
    words : (words,) uint64 array, optional
        The packed bit-plane of a LOGICAL, instead of values.
    cells : array, optional
        Words of the elements as ``fields.cell_type`` has them, instead of values.
    field : list of int, optional
        Bit-planes of a number, instead of values.
    mapping : str, optional
        How it lies on the PEs; the machine's mapping when not given.
    owned : bool
        Whether the array takes store of its own; a view does not.

    Attributes
    ----------
    fresh : bool
        Whether the array is the result of an expression, which may be moved into a variable without a copy.

    Raises
    ------
    OutOfStore
        When too few bit-planes are free.

    Examples
    --------
    >>> from dap_emulator import Dap
    >>> a = Dap.model('510').vector([1, 2, 3])
    >>> (2 * a - 1).values.tolist()
    [1, 3, 5]
    >>> a[a > 1] = 0
    >>> a.values.tolist()
    [1, 0, 0]
    """

    __slots__ = ()
    __array_priority__ = 100

    def common_fields(self, other: Operand, what: str) -> tuple[Field, Field, Kind]:
        """Bit-planes of two numeric operands in their common kind.

        Parameters
        ----------
        other : DapArray, int or float
        what : str
            The operation, named in errors.

        Returns
        -------
        mine, theirs : lists of int
        kind : Kind

        Raises
        ------
        ValueError
            When they do not go together.
        """
        kind = self._number_kind(other, what)
        x = self.field_as(kind)
        return x, other.field_as(kind) if isinstance(other, DapArray) else self.constant(kind, other), kind

    def _other(self, other: Operand, what: str) -> tuple[Any, Kind]:
        """The other operand's values, checked, and the kind both become."""
        if isinstance(other, DapArray):
            if other.dap is not self.dap:
                raise ValueError(f'{what}: the arrays are on different machines')
            if other.shape != self.shape:
                raise ValueError(f'{what}: shapes {self.shape} and {other.shape} differ')
            if other.mapping != self.mapping and self.rank == 2:
                raise ValueError(f'{what}: mappings {self.mapping} and {other.mapping} differ; use remapped()')
            return other, common_kind(self.kind, other.kind)
        return other, scalar_kind(self.kind, other, what)

    def common_values(self, other: Operand, what: str) -> tuple[AnyArray, Any, Kind]:
        """Values of two numeric operands in their common kind.

        Parameters
        ----------
        other : DapArray, int or float
        what : str
            The operation, named in errors.

        Returns
        -------
        mine, theirs : arrays of ``kind.dtype``; theirs is a numpy scalar when ``other`` is a scalar
        kind : Kind

        Raises
        ------
        ValueError
            When they do not go together.
        """
        kind = self._number_kind(other, what)
        mine = self._widened(kind)
        if isinstance(other, DapArray):
            return mine, other._widened(kind), kind
        return mine, kind.dtype.type(kind.scalar(other)), kind

    def _number_kind(self, other: Operand, what: str) -> Kind:
        """The common kind of two operands, which must be numbers."""
        _, kind = self._other(other, what)
        if (
            not kind.is_numeric
            or self.kind.name == 'LOGICAL'
            or (isinstance(other, DapArray) and other.kind.name == 'LOGICAL')
        ):
            raise ValueError(
                f'{what}: expected numbers, got {self.kind} and '
                f'{other.kind if isinstance(other, DapArray) else type(other).__name__}'
            )
        return kind

    def _widened(self, kind: Kind) -> AnyArray:
        """The values in a longer word or as REAL; only the latter costs cycles."""
        if self.kind == kind:
            return self.values
        if kind.name == 'REAL' and self.kind.name == 'INTEGER':
            self.charge('convert', kind)
        return kind.convert(self.values)

    # Arithmetic.

    def binary(self, operation: str, other: Operand, swapped: bool = False, kind: Kind | None = None) -> DapArray:
        """Arithmetic on two operands.

        Parameters
        ----------
        operation : {'add', 'subtract', 'multiply', 'divide', 'remainder'}
        other : DapArray, int or float
        swapped : bool
            ``other`` is the first operand.
        kind : Kind, optional
            Of the result; the operands' common kind when not given.
        """
        charged = 'divide' if operation == 'remainder' else operation
        if self.dap.in_bits:
            return self._binary_on_planes(operation, charged, other, swapped, kind)
        a, b, common = self.common_values(other, operation)
        target = kind or common
        if target != common:
            a, b = target.convert(a), target.convert(np.asarray(b))
        if swapped:
            a, b = b, a
        self.charge(charged, target)
        with np.errstate(all='ignore'):
            if operation in _ARITHMETIC:
                result = _ARITHMETIC[operation](a, b)
            elif target.name == 'REAL':
                result = np.divide(a, b) if operation == 'divide' else np.fmod(a, b)
            else:
                result = self._integer_divide(operation, a, b)
        return self.like(target, target.fit(result))

    def _binary_on_planes(
        self, operation: str, charged: str, other: Operand, swapped: bool, kind: Kind | None
    ) -> DapArray:
        """``binary`` on bit-planes."""
        x, y, common = self.common_fields(other, operation)
        target = kind or common
        self.charge(charged, target)
        with self.arithmetic(target) as work:
            if target != common:
                x, y = (serial.convert(work.pe, common, target, self.dap.nearest, side) for side in (x, y))
            if swapped:
                x, y = y, x
            return self.like_field(target, work.binary(operation, x, y))

    def _integer_divide(self, operation: str, a: AnyArray, b: AnyArray) -> AnyArray:
        """Quotient toward zero, or remainder, as in Fortran. Division by zero gives 0 and is counted as a fault."""
        zero = b == 0
        faults = int(np.count_nonzero(np.broadcast_to(zero, self.shape)))
        if faults:
            self.dap.faults += faults
            b = np.where(zero, b.dtype.type(1), b)
        if operation == 'remainder':
            rest: AnyArray = np.fmod(a, b)
            return np.where(zero, b.dtype.type(0), rest) if faults else rest
        quotient: AnyArray
        if a.dtype.itemsize <= 4:  # exact: 32-bit quotients are far enough from the next whole number
            quotient = np.true_divide(a, b, dtype=np.float64).astype(np.int64).astype(a.dtype, copy=False)
        else:
            quotient = np.floor_divide(a - np.fmod(a, b), b)
        return np.where(zero, b.dtype.type(0), quotient) if faults else quotient

    def power(self, exponent: Operand) -> DapArray:
        """Raise to a power: whole powers by multiplication, others by exp and log.

        Of two INTEGER arrays the result is REAL.
        """
        if isinstance(exponent, (int, np.integer)) and not isinstance(exponent, bool) and exponent >= 0:
            self.charge('power', self._number(), detail=max(1, int(exponent)))
            if self.dap.in_bits:
                with self.arithmetic(self.kind) as work:
                    return self.like_field(self.kind, work.power(self.field, int(exponent)))
            with np.errstate(all='ignore'):
                # Not np.power: the operator knows squares and cubes.
                result = self.values ** (
                    self.values.dtype.type(exponent) if self.kind.name == 'INTEGER' else int(exponent)
                )
            return self.like(self.kind, self.kind.fit(result.astype(self.kind.dtype, copy=False)))
        if self.dap.in_bits:
            return self._power_on_planes(exponent)
        a, b, kind = self.common_values(exponent, 'power')
        if kind.name == 'INTEGER':
            kind = real(4) if kind.bits <= 32 else real(8)
            a, b = kind.convert(a), kind.convert(np.asarray(b))
        self.charge('function', kind, times=2)
        self.charge('multiply', kind)
        with np.errstate(all='ignore'):
            return self.like(kind, kind.fit(np.power(a, b).astype(kind.dtype, copy=False)))

    def _power_on_planes(self, exponent: Operand) -> DapArray:
        """A power that is no whole number, on bit-planes, by EXP and LOG."""
        kind = self._number_kind(exponent, 'power')
        if kind.name == 'INTEGER':
            kind = real(4) if kind.bits <= 32 else real(8)
        x = self.field_as(kind)
        y = exponent.field_as(kind) if isinstance(exponent, DapArray) else self.constant(kind, exponent)
        self.charge('multiply', kind)
        self.charge('function', kind, times=2)
        with self.arithmetic(kind) as work:
            return self.like_field(kind, work.function('POWER', x, y))

    def plus(self, other: Operand, kind: Kind) -> DapArray:
        """The sum in a word of another kind: in assembly it may grow by one plane at a time.

        Parameters
        ----------
        other : DapArray or number
        kind : Kind
            Of the sum.
        """
        return self.binary('add', other, kind=kind)

    def minus(self, other: Operand, kind: Kind) -> DapArray:
        """The difference in a word of another kind; the parameters are those of :meth:`plus`."""
        return self.binary('subtract', other, kind=kind)

    def __add__(self, other: Operand) -> DapArray:
        return self.binary('add', other)

    __radd__ = __add__

    def __sub__(self, other: Operand) -> DapArray:
        return self.binary('subtract', other)

    def __rsub__(self, other: Operand) -> DapArray:
        return self.binary('subtract', other, swapped=True)

    def __mul__(self, other: Operand) -> DapArray:
        return self.binary('multiply', other)

    __rmul__ = __mul__

    def __truediv__(self, other: Operand) -> DapArray:
        """Fortran's /: of integers it is an integer, toward zero."""
        return self.binary('divide', other)

    def __rtruediv__(self, other: Operand) -> DapArray:
        return self.binary('divide', other, swapped=True)

    def __mod__(self, other: Operand) -> DapArray:
        """Fortran's MOD: the sign of the first operand."""
        return self.binary('remainder', other)

    def __pow__(self, other: Operand) -> DapArray:
        return self.power(other)

    def __neg__(self) -> DapArray:
        self.charge('negate', self._number())
        if self.dap.in_bits:
            with self.arithmetic(self.kind) as work:
                return self.like_field(self.kind, work.negate(self.field))
        return self.like(self.kind, self.kind.fit(np.negative(self.values)))

    def __pos__(self) -> DapArray:
        return self

    def __abs__(self) -> DapArray:
        self.charge('absolute' if self._number().name == 'INTEGER' else 'negate', self.kind)
        if self.dap.in_bits:
            with self.arithmetic(self.kind) as work:
                return self.like_field(self.kind, work.absolute(self.field))
        return self.like(self.kind, self.kind.fit(np.abs(self.values)))

    def _number(self) -> Kind:
        """The kind, which must be numeric."""
        if not self.kind.is_numeric:
            raise ValueError(f'expected numbers, got {self.kind}')
        return self.kind

    # Comparison and logic.

    def compare(self, relation: str, other: Operand) -> DapArray:
        """Compare with an array or scalar.

        Parameters
        ----------
        relation : {'lt', 'le', 'gt', 'ge', 'eq', 'ne'}
        other : DapArray or scalar

        Returns
        -------
        DapArray
            LOGICAL.
        """
        if isinstance(other, DapArray) and other.kind.name == self.kind.name == 'LOGICAL' and relation in ('eq', 'ne'):
            return self.logic('eqv' if relation == 'eq' else 'neqv', other)
        if self.dap.in_bits:
            x, y, kind = self.common_fields(other, 'comparison')
            self.charge('compare', kind)
            with self.arithmetic(kind) as work:
                return self.like_field(LOGICAL, [work.compare(relation, x, y)])
        a, b, kind = self.common_values(other, 'comparison')
        self.charge('compare', kind)
        return self.like(LOGICAL, _COMPARE[relation](a, b))

    def logic(self, operation: str, other: Operand) -> DapArray:
        """Combine LOGICALs.

        Parameters
        ----------
        operation : {'and', 'or', 'eqv', 'neqv'}
        other : DapArray or bool

        Returns
        -------
        DapArray
            LOGICAL.
        """
        self._other(other, operation)
        self.charge_move('logic')
        mine = self._truth()
        if isinstance(other, DapArray):
            theirs = other._truth()
        else:
            theirs = planes.ones(self.size) if other else np.zeros_like(mine)
        if operation == 'eqv':
            return self._logical(planes.invert(mine ^ theirs, self.size))
        return self._logical(_LOGIC[operation](mine, theirs))

    def _truth(self) -> WordArray:
        """Packed words of an array, which must be LOGICAL."""
        if self.kind.name != 'LOGICAL':
            raise ValueError(f'expected LOGICAL, got {self.kind}')
        return self.words

    def __and__(self, other: Operand) -> DapArray:
        return self.logic('and', other)

    def __or__(self, other: Operand) -> DapArray:
        return self.logic('or', other)

    def __xor__(self, other: Operand) -> DapArray:
        return self.logic('neqv', other)

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__

    def __invert__(self) -> DapArray:
        self.charge_move('not')
        return self._logical(planes.invert(self._truth(), self.size))

    def __lt__(self, other: Operand) -> DapArray:
        return self.compare('lt', other)

    def __le__(self, other: Operand) -> DapArray:
        return self.compare('le', other)

    def __gt__(self, other: Operand) -> DapArray:
        return self.compare('gt', other)

    def __ge__(self, other: Operand) -> DapArray:
        return self.compare('ge', other)

    def __eq__(self, other: object) -> DapArray:  # type: ignore[override]
        return self.compare('eq', other)  # type: ignore[arg-type]

    def __ne__(self, other: object) -> DapArray:  # type: ignore[override]
        return self.compare('ne', other)  # type: ignore[arg-type]

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        raise ValueError('a parallel array has no single truth value: use any() or all() of dap_emulator.intrinsics')

    # Types, copies, masked assignment, elements.

    def astype(self, kind: Kind | str) -> DapArray:
        """Convert numbers to another kind, as FLOAT, FIX and LENGTH of the language do.

        Raises
        ------
        ValueError
            From or to LOGICAL.
        """
        target = parse_kind(kind)
        if target.name == 'LOGICAL' or self.kind.name == 'LOGICAL':
            if target == self.kind:
                return self
            raise ValueError(f'{self.kind} cannot become {target}: use MERGE or a comparison')
        self.charge('convert' if target.name != self.kind.name or target.name == 'REAL' else 'copy', target)
        if self.dap.in_bits:
            with self.processors() as pe:
                pe.cycles += 2 * target.bits if target.name == self.kind.name == 'INTEGER' else 0
                return self.like_field(target, serial.convert(pe, self.kind, target, self.dap.nearest, self.field))
        return self.like(target, target.convert(self.values))

    def copy(self) -> DapArray:
        """Copy the array within the store."""
        self.charge_move('copy')
        return self.like_cells(self.cells.copy())

    def remapped(self, mapping: str) -> DapArray:
        """Copy the array to another mapping onto the PEs: 'sheet', 'crinkled' or 'combined'."""
        result = self.like_cells(self.cells.copy(), mapping)
        if mapping != self.mapping:
            self.charge_move('remap')
        return result

    def assign(self, value: Operand, mask: DapArray | None = None) -> None:
        """Assign to every element, or where a mask is true; the cost is the same, because inactive PEs wait.

        Parameters
        ----------
        value : DapArray or scalar
        mask : DapArray, optional
            LOGICAL of the same shape.

        Raises
        ------
        ValueError
            When they do not go together.
        """
        if self.dap.in_bits:
            self._assign_planes(value, mask)
            return
        if isinstance(value, DapArray):
            self._other(value, 'assignment')
            source: Any = value.values if value.kind == self.kind else value.converted(self.kind)
            self.charge('copy' if mask is None else 'masked_copy', self.kind)
        else:
            source = self.kind.dtype.type(self.kind.scalar(self._assignable(value)))
            self.charge('copy' if mask is None else 'masked_copy', self.kind)
        target = self.values
        if not target.flags.writeable:
            target = target.copy()
        if mask is None:
            target[...] = source
        else:
            self._other(mask, 'mask')
            mask._truth()
            np.copyto(target, source, where=mask.values)
        self._values, self._words = target, None

    def _assignable(self, value: Scalar) -> Scalar:
        """A scalar that can be assigned, checked."""
        if (self.kind.name == 'LOGICAL') != isinstance(value, (bool, np.bool_)):
            raise ValueError(f'assignment: cannot put {value!r} into {self.kind}')
        return checked_scalar(self.kind, value, 'assignment')

    def _assign_planes(self, value: Operand, mask: DapArray | None) -> None:
        """``assign`` on bit-planes."""
        if isinstance(value, DapArray):
            self._other(value, 'assignment')
            source = (value if value.kind == self.kind else value.astype(self.kind)).field
        else:
            source = self.constant(self.kind, self._assignable(value))
        self.charge('copy' if mask is None else 'masked_copy', self.kind)
        with self.processors() as pe:
            if mask is None:
                stored = pe.copy(source)
            else:
                self._other(mask, 'mask')
                mask._truth()
                stored = pe.store_where(mask.field[0], source, self.field)
        self._change(self.like_field(self.kind, stored))

    def _change(self, other: DapArray) -> None:
        """Take what is in another array of the same kind and shape."""
        self._values, self._words, self._cells, self._field = other._values, other._words, other._cells, other._field

    def replace(self, values: AnyArray) -> None:
        """Replace the values by others of this shape, converted to this kind. Charges nothing."""
        self._change(self.like(self.kind, self.kind.convert(values)))

    def converted(self, kind: Kind) -> AnyArray:
        """Cells of another kind, at the cost of the conversion."""
        return self.astype(kind).cells

    def __setitem__(self, where: Any, value: Operand) -> None:
        if isinstance(where, DapArray):
            self.assign(value, where)
        elif isinstance(where, slice) and where == slice(None):
            self.assign(value)
        else:
            index = self._index(where)
            self.charge_move('store_element')
            cells = self.cells if self.cells.flags.writeable else self.cells.copy()
            cells[index] = self.cell(checked_scalar(self.kind, value, 'element'))
            self._change(self.like_cells(cells))

    def __getitem__(self, where: Any) -> Scalar:
        """Fetch one element into the control unit."""
        index = self._index(where)
        self.charge_move('fetch')
        element: Scalar = self.values[index].item()
        return element

    def _index(self, where: Any) -> tuple[int, ...]:
        """Whole numbers within the shape, as a numpy index."""
        index = where if isinstance(where, tuple) else (where,)
        if len(index) != self.rank or not all(isinstance(i, (int, np.integer)) for i in index):
            raise IndexError(f'index: expected {self.rank} whole numbers or a LOGICAL mask, got {where!r}')
        if not all(0 <= i < extent for i, extent in zip(index, self.shape)):
            raise IndexError(f'index: {where} is outside shape {self.shape}')
        return tuple(int(i) for i in index)

    def neighbour(self, distance: int, axis: int = 0, cyclic: bool = False) -> DapArray:
        """In every place the element ``distance`` places further along an axis: X(+,) is neighbour(1, axis=0).

        Parameters
        ----------
        distance : int
            May be negative.
        axis : int
        cyclic : bool
            Wrap around, instead of zero (false) beyond the edge.

        Raises
        ------
        ValueError
            For an axis that the array does not have.
        """
        if not 0 <= axis < self.rank:
            raise ValueError(f'axis: expected 0 to {self.rank - 1}, got {axis}')
        self.charge('neighbour', self.kind, detail=max(1, abs(distance)), axis=axis)
        if self.dap.in_bits:
            where = self.dap.layout(self.shape, self.mapping)
            self.dap.count(moves.neighbour(self.kind.bits, where, distance, axis, cyclic))
        return self.like_cells(moved(self.cells, distance, axis, cyclic))

    @property
    def T(self) -> DapArray:
        """Transpose of a matrix."""
        if self.rank != 2:
            raise ValueError('transpose: expected a matrix')
        self.charge_move('transpose')
        return self.like_cells(np.ascontiguousarray(self.cells.T))

    @property
    def title(self) -> str:
        """Kind, rank, extents and blocks in words."""
        extents = ' x '.join(str(extent) for extent in self.shape)
        return f'{self.kind} {"matrix" if self.rank == 2 else "vector"} {extents}, {self.blocks} block(s)'

    def __repr__(self) -> str:
        with np.printoptions(threshold=200, edgeitems=3, precision=5):
            return f'{self.title}\n{self.values}'

    def _repr_html_(self) -> str:
        # Importing matplotlib takes about a second, and only pictures need it.
        from .drawing import html_plane

        return html_plane(self.values, self.title, self.dap.es)
