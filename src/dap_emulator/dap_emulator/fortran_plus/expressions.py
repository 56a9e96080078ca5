"""Expressions as Python closures: value = closure(frame).

Parallel work is charged by the arrays themselves; scalar operations are counted here, when the closure is made.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..machine import intrinsics
from ..machine.arrays import DapArray
from ..machine.kinds import Kind
from .checker import RELATIONS
from .declarations import CheckedUnit, Symbol
from .functions import FUNCTIONS
from .parser import located
from .running import Evaluate, Frame
from .scalars import scalar_operation
from .storage import ArrayVariable
from .syntax import Binary, Constant, Reference, Type, Unary, Whole
from .syntax import Step as NeighbourStep

_RELATE = {
    '.EQ.': operator.eq,
    '.NE.': operator.ne,
    '.LT.': operator.lt,
    '.LE.': operator.le,
    '.GT.': operator.gt,
    '.GE.': operator.ge,
}
_COMPARE = {'.EQ.': 'eq', '.NE.': 'ne', '.LT.': 'lt', '.LE.': 'le', '.GT.': 'gt', '.GE.': 'ge'}
_MIRRORED = {'.EQ.': 'eq', '.NE.': 'ne', '.LT.': 'gt', '.LE.': 'ge', '.GT.': 'lt', '.GE.': 'le'}
_LOGIC = {'.AND.': 'and', '.OR.': 'or', '.EQV.': 'eqv', '.NEQV.': 'neqv'}
_SCALAR_LOGIC = {'.AND.': operator.and_, '.OR.': operator.or_, '.EQV.': operator.eq, '.NEQV.': operator.ne}
_ARITHMETIC = {'+': 'add', '-': 'subtract', '*': 'multiply', '/': 'divide'}


class Expressions:
    """Closures for the expressions of one unit.

    Parameters
    ----------
    item : CheckedUnit
        The unit that the expressions stand in.
    units : dict of str to CheckedUnit
        All units of the program, by name.

    Attributes
    ----------
    integers, reals, functions : int
        Scalar operations of the statement that is being compiled.
    """

    def __init__(self, item: CheckedUnit, units: dict[str, CheckedUnit]) -> None:
        self.item, self.units = item, units
        self.integers = self.reals = self.functions = 0

    def arguments(self, name: str, actuals: list[Any]) -> Callable[[Frame], Frame]:
        """Make a call of a unit: a closure that returns its frame."""
        raise NotImplementedError

    def load(self, symbol: Symbol) -> Evaluate:
        """Read a variable or constant."""
        if symbol.slot == 0:
            value = symbol.constant
            return lambda frame: value
        slot, common = symbol.slot, symbol.common
        if common is not None and not symbol.dimensions:
            return lambda frame: frame[0].commons[common]
        if symbol.alias is not None and not symbol.dimensions:
            storage, place = self.item.symbols[symbol.alias[0]].slot, symbol.alias[1]
            return lambda frame: frame[storage].data[place : place + 1].tolist()[0]
        return lambda frame: frame[slot]

    def _place(self, load: Evaluate, items: list[Any]) -> Callable[[Frame, ArrayVariable], tuple[int, ...]]:
        indices = [self.expression(item) for item in items]
        if not indices:
            return lambda frame, variable: ()
        self.integers += len(indices)
        return lambda frame, variable: variable.place(tuple([index(frame) for index in indices]))

    def _count(self, kind: Kind) -> None:
        """Count one scalar operation."""
        if kind.name == 'REAL':
            self.reals += 1
        else:
            self.integers += 1

    def expression(self, node: Any) -> Evaluate:
        """Make the closure of an expression whose types have been checked."""
        if isinstance(node, Constant):
            value = node.value if node.kind.name in ('CHARACTER', 'LOGICAL') else node.kind.scalar(node.value)
            return lambda frame: value
        if isinstance(node, Unary):
            return self._unary(node)
        if isinstance(node, Binary):
            return self._binary(node)
        if node.meaning == 'intrinsic':
            return self._intrinsic(node)
        if node.meaning == 'procedure':
            return self._procedure(node)
        return self._function(node) if node.meaning == 'function' else self._variable(node)

    def _unary(self, node: Unary) -> Evaluate:
        inner = self.expression(node.operand)
        if node.operator == '.NOT.':
            if node.type.rank:
                return lambda frame: ~inner(frame)
            self.integers += 1
            return lambda frame: not inner(frame)
        if node.operator == '+':
            return inner
        if node.type.rank:
            return lambda frame: -inner(frame)
        self._count(node.type.kind)
        kind = node.type.kind
        return lambda frame: kind.scalar(-inner(frame))

    def _binary(self, node: Binary) -> Evaluate:
        left, right, symbol = self.expression(node.left), self.expression(node.right), node.operator
        if not node.left.type.rank and not node.right.type.rank:
            return self._scalar_binary(node, left, right)
        if symbol in RELATIONS:
            relation, mirrored = _COMPARE[symbol], _MIRRORED[symbol]
            if node.left.type.rank:
                return lambda frame: left(frame).compare(relation, right(frame))
            return lambda frame: right(frame).compare(mirrored, left(frame))
        if symbol in _LOGIC:
            name = _LOGIC[symbol]
            if node.left.type.rank:
                return lambda frame: left(frame).logic(name, right(frame))
            return lambda frame: right(frame).logic(name, left(frame))
        if symbol == '**':
            if node.left.type.rank:
                return lambda frame: left(frame).power(right(frame))
            return lambda frame: intrinsics.exp(right(frame) * intrinsics.log(left(frame)))
        name = _ARITHMETIC[symbol]
        if node.left.type.rank:
            return lambda frame: left(frame).binary(name, right(frame))
        return lambda frame: right(frame).binary(name, left(frame), True)

    def _scalar_binary(self, node: Binary, left: Evaluate, right: Evaluate) -> Evaluate:
        symbol = node.operator
        if symbol in _RELATE:
            relate = _RELATE[symbol]
            self._count(node.left.type.kind)
            return lambda frame: relate(left(frame), right(frame))
        if symbol in _SCALAR_LOGIC:
            combine = _SCALAR_LOGIC[symbol]
            self.integers += 1
            return lambda frame: combine(left(frame), right(frame))
        self._count(node.type.kind)
        operate = scalar_operation(symbol, node.type.kind)
        return lambda frame: operate(left(frame), right(frame))

    def _intrinsic(self, node: Reference) -> Evaluate:
        function = FUNCTIONS[node.name]
        run = function.run
        if function.makes_arrays_of_scalars:
            run = partial(run, kind=node.type.kind)
        values = [self.expression(item) for item in node.items or []]
        result: Type = node.type
        parallel = result.rank or any(item.type.rank for item in node.items or [])
        if not parallel:
            if function.is_real_work:
                self.functions += 1
            else:
                self._count(result.kind)
            kind = result.kind
            if kind.is_numeric:
                return lambda frame: kind.scalar(run(frame[0].dap, *[value(frame) for value in values]))
        return lambda frame: run(frame[0].dap, *[value(frame) for value in values])

    def _function(self, node: Reference) -> Evaluate:
        items = [] if len(node.items or []) == 1 and isinstance(node.items[0], Whole) else node.items  # type: ignore[index]
        call = self.arguments(node.name, items or [])
        name = node.name
        result = self.units[name].symbols[name]
        slot = result.slot
        if not result.dimensions:
            return lambda frame: call(frame)[slot]

        def parallel(frame: Frame) -> DapArray:
            value: DapArray = call(frame)[slot].read(())
            return value.like_cells(value.cells)

        return parallel

    def _procedure(self, node: Reference) -> Evaluate:
        """A call of the function that a dummy argument stands for."""
        calls = {
            name: self._function(Reference(name, node.items, node.at, node.type, 'function'))
            for name in node.candidates
        }
        slot, dummy = self.item.symbols[node.name].slot, node.name
        return lambda frame: chosen_procedure(calls, frame[slot], dummy)(frame)

    def _variable(self, node: Reference) -> Evaluate:
        symbol = self.item.symbols[node.name]
        load = self.load(symbol)
        rank, serial = symbol.type.rank, symbol.type.serial
        if not symbol.dimensions:
            return load
        if node.items is None:
            if serial:
                return load
            return lambda frame: load(frame).read(())
        leading = len(node.items) - serial
        place = self._place(load, node.items[leading:])
        if not rank:

            def element(frame: Frame) -> Any:
                variable = load(frame)
                found = variable.data[place(frame, variable)]
                return found.item() if isinstance(found, np.generic) else found

            return element
        items = node.items[:leading]
        if all(isinstance(item, Whole) for item in items):

            def whole(frame: Frame) -> DapArray:
                variable: ArrayVariable = load(frame)
                return variable.read(place(frame, variable))

            return whole
        if all(isinstance(item, (Whole, NeighbourStep)) for item in items):
            return self._neighbour(load, place, items)
        return self._selected(load, place, items)

    def _neighbour(self, load: Evaluate, place: Any, items: list[Any]) -> Evaluate:
        moves = [
            (item.step, axis, self.item.geometry[axis])
            for axis, item in enumerate(items)
            if isinstance(item, NeighbourStep)
        ]

        def neighbour(frame: Frame) -> DapArray:
            variable: ArrayVariable = load(frame)
            array = variable.read(place(frame, variable))
            for step, axis, cyclic in moves:
                array = array.neighbour(step, axis, cyclic)
            return array

        return neighbour

    def _selected(self, load: Evaluate, place: Any, items: list[Any]) -> Evaluate:
        """X(i,j), X(i,), X(,j), X(k), and selection of the first true of a mask."""
        if any(isinstance(item, NeighbourStep) for item in items):
            raise located(self.item.unit.header.source, 0, 'a neighbour and a selected index cannot be combined')
        parts = [None if isinstance(item, Whole) else self.expression(item) for item in items]

        def select(frame: Frame) -> Any:
            variable = load(frame)
            array = variable.read(place(frame, variable))
            chosen = [part and part(frame) for part in parts]
            chosen = [_first_true(item) if isinstance(item, DapArray) else item for item in chosen]
            where = select_part(variable.parallel, chosen)
            element = all(isinstance(index, int) for index in where)
            array.charge_move('fetch' if element else 'broadcast')
            if element:
                return array.values[where].item()
            return DapArray(array.dap, array.kind, None, cells=np.ascontiguousarray(array.cells[where]))

        return select


def chosen_procedure(calls: dict[str, Evaluate], name: str, dummy: str) -> Evaluate:
    """The call of the unit that a dummy argument stands for. Raises ValueError when its arguments are others."""
    if name not in calls:
        raise ValueError(f'{dummy} stands for {name}, which takes other arguments')
    return calls[name]


def position_in(index: int, extent: int) -> int:
    """An index of the language, from 1, as one of Python, from 0. Raises IndexError when it is outside."""
    if not 1 <= index <= extent:
        raise IndexError(f'index {index} is outside 1 to {extent}')
    return index - 1


def _first_true(mask: DapArray) -> int:
    """Position of the first true element, from 1. Raises ValueError when there is none."""
    where = intrinsics.eln(mask)
    if where == 0:
        raise ValueError('the selecting mask is false everywhere')
    return where


def select_part(shape: tuple[int, ...], chosen: list[Any]) -> tuple[Any, ...]:
    """Indices of the language as numpy indices.

    Parameters
    ----------
    shape : tuple of int
        Extents of the array.
    chosen : list of int or None
        From 1; None is a whole dimension. A single index of a matrix counts down its columns.

    Examples
    --------
    >>> select_part((3, 4), [2, None])
    (1, slice(None, None, None))
    >>> select_part((3, 4), [5])
    (1, 1)
    """
    if len(chosen) == 1 and len(shape) == 2:
        position = position_in(chosen[0], shape[0] * shape[1])
        return position % shape[0], position // shape[0]
    return tuple(slice(None) if index is None else position_in(index, extent) for index, extent in zip(chosen, shape))
