"""Declarations: the names of a unit, their types and dimensions.

Undeclared scalars follow Fortran's rule (I to N are INTEGER, others REAL) unless the unit says IMPLICIT NONE.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..machine.kinds import CHARACTER, LOGICAL, Kind, integer, real
from .errors import FortranError
from .functions import combined
from .parser import located
from .scalars import scalar_operation
from .syntax import Binary, Constant, Dimension, Entity, Node, Reference, Type, Unary, Unit


@dataclass
class Symbol:
    """A name of a unit.

    Parameters
    ----------
    name : str
    type : Type
    dimensions : list of Dimension
    slot : int
        Its place in a frame; 0 for a constant.
    argument : int, optional
        Its position among the arguments.
    common : (str, int), optional
        COMMON block, and position in it.
    constant : optional
        Value of a PARAMETER.
    initial : list, optional
        Values of a DATA statement.
    """

    name: str
    type: Type
    dimensions: list[Dimension]
    slot: int = 0
    argument: int | None = None
    common: tuple[str, int] | None = None
    constant: Any = None
    initial: list[Any] | None = None


@dataclass
class CheckedUnit:
    """A unit whose tree is complete.

    Parameters
    ----------
    unit : Unit
    symbols : dict of str to Symbol
    body : list of Node
        Executable statements.
    changed : set of str
        Names that the unit may assign to.
    geometry : (bool, bool)
        Whether neighbours wrap around, along the rows and along the columns.
    result : Type, optional
        Of a function.
    implicit : bool
        Whether undeclared scalars take their type from their first letter.
    """

    unit: Unit
    symbols: dict[str, Symbol] = field(default_factory=dict)
    body: list[Node] = field(default_factory=list)
    changed: set[str] = field(default_factory=set)
    geometry: tuple[bool, bool] = (False, False)
    result: Type | None = None
    implicit: bool = True

    @property
    def arguments(self) -> list[Symbol]:
        """Arguments, in order."""
        return [self.symbols[name] for name in self.unit.arguments]


def implicit_kind(name: str) -> Kind:
    """The kind of an undeclared name: INTEGER for I to N, otherwise REAL."""
    return integer(4) if 'I' <= name[0] <= 'N' else real(4)


def declared_kind(text: str, length: int | None) -> Kind:
    """The kind of a declaration.

    Parameters
    ----------
    text : str
        For example 'REAL*4'.
    length : int, optional
        Word length that stands behind the name and replaces that of the type.

    Raises
    ------
    ValueError
        For a word length that the type does not have.
    """
    found = re.fullmatch(r'([A-Z]+)(?:\*(\d+))?', text)
    assert found is not None
    name, number = found[1], length if length is not None else int(found[2] or 0)
    if name == 'LOGICAL':
        if number not in (0, 1):
            raise ValueError('LOGICAL is one bit: it takes no length')
        return LOGICAL
    if name == 'CHARACTER':
        return CHARACTER
    return integer(number or 4) if name == 'INTEGER' else real(number or 4)


class Declarations:
    """Turns the declarations at the head of a unit into its symbols; each statement has a method of its name."""

    def __init__(self, item: CheckedUnit) -> None:
        self.item, self.node = item, item.unit.header
        self.kinds: dict[str, Kind] = {}
        self.dimensions: dict[str, list[Dimension]] = {}
        self.commons: dict[str, tuple[str, int]] = {}
        self.sizes: dict[str, int] = {}
        self.initials: dict[str, list[Any]] = {}
        self.implicit_none = False
        self.declared: list[str] = []

    def fail(self, at: int, reason: str) -> FortranError:
        """An error at an offset of the statement that is being read."""
        return located(self.node.source, at, reason)

    def run(self) -> None:
        """Read the declarations, and hand the executable statements on. Raises FortranError."""
        unit = self.item.unit
        executable = False
        for node in unit.body:
            self.node = node
            handler: Callable[[Node], None] | None = getattr(self, '_' + self.node.what, None)
            if handler is None:
                executable = True
                self.item.body.append(self.node)
                continue
            if executable and self.node.what != 'data':
                raise self.fail(self.node.at, 'declarations come before the first executable statement')
            handler(self.node)
        self.node = unit.header
        if unit.header.parts['name'] == 'MAIN' and not unit.arguments:
            unit.arguments = [name for name in self.declared if name not in self.item.symbols]
        if unit.is_function:
            self._function_result(unit)
        for name in unit.arguments:
            if name not in self.declared:
                self._untyped(name, 0)
                self.declared.append(name)
        for name in self.declared:
            self._untyped(name, 0)
            self._symbol(name)
        self.item.implicit = not self.implicit_none

    def _untyped(self, name: str, at: int) -> None:
        """Give a name without a type the type of its first letter."""
        if name not in self.kinds:
            if self.implicit_none:
                raise self.fail(at, f'{name} is not declared')
            self.kinds[name] = implicit_kind(name)

    def _function_result(self, unit: Unit) -> None:
        name = unit.name
        if unit.result_type is not None:
            self.kinds[name] = declared_kind(unit.result_type, None)
        self._untyped(name, unit.header.at)
        if name not in self.dimensions:
            self.dimensions[name] = [Dimension(True, None)] * unit.result_rank
        if name not in self.declared:
            self.declared.append(name)
        self.item.result = Type(self.kinds[name], len(self.dimensions[name]))

    def _symbol(self, name: str) -> None:
        """Make the symbol of a name from all that was declared of it."""
        if name in self.item.symbols:
            return
        dimensions = self.dimensions.get(name, [])
        rank = sum(dimension.parallel for dimension in dimensions)
        arguments = self.item.unit.arguments
        symbol = Symbol(
            name,
            Type(self.kinds[name], rank, len(dimensions) - rank),
            dimensions,
            argument=arguments.index(name) if name in arguments else None,
            common=self.commons.get(name),
            initial=self.initials.get(name),
        )
        if symbol.common and symbol.argument is not None:
            raise self.fail(0, f'{name} is both an argument and in COMMON')
        symbol.slot = 1 + sum(other.slot > 0 for other in self.item.symbols.values())
        self.item.symbols[name] = symbol

    def _note(self, entity: Entity) -> None:
        """Note a declared name and its dimensions."""
        if entity.name not in self.declared:
            self.declared.append(entity.name)
        if entity.dimensions is None:
            return
        if entity.name in self.dimensions:
            raise self.fail(entity.at, f'{entity.name} has dimensions twice')
        parallel = [dimension.parallel for dimension in entity.dimensions]
        if parallel != sorted(parallel, reverse=True):
            raise self.fail(entity.at, f'{entity.name}: parallel dimensions come before serial ones')
        if sum(parallel) > 2:
            raise self.fail(entity.at, f'{entity.name}: at most two parallel dimensions')
        self.dimensions[entity.name] = entity.dimensions

    def _declare(self, node: Node) -> None:
        for entity in node.entities:
            if entity.name in self.kinds:
                raise self.fail(entity.at, f'{entity.name} is declared twice')
            try:
                self.kinds[entity.name] = declared_kind(node.type, entity.length)
            except ValueError as error:
                raise self.fail(entity.at, str(error)) from None
            self._note(entity)
            if self.kinds[entity.name] == CHARACTER and any(d.parallel for d in entity.dimensions or []):
                raise self.fail(entity.at, f'{entity.name}: CHARACTER arrays are serial')

    def _dimension(self, node: Node) -> None:
        for entity in node.entities:
            self._note(entity)

    def _common(self, node: Node) -> None:
        for entity in node.entities:
            self._note(entity)
            position = self.sizes.get(node.block, 0)
            self.commons[entity.name] = (node.block, position)
            self.sizes[node.block] = position + 1

    def _parameter(self, node: Node) -> None:
        for name, expression, at in node.constants:
            value, kind = self._fold(expression)
            self._untyped(name, at)
            declared = self.kinds.get(name, kind)
            if name in self.declared:
                self.declared.remove(name)
            if (declared.name == 'LOGICAL') != isinstance(value, bool) or (declared.name == 'CHARACTER') != isinstance(
                value, str
            ):
                raise self.fail(at, f'{name} is {declared}, its value is not')
            self.item.symbols[name] = Symbol(
                name, Type(declared), [], constant=value if isinstance(value, str) else declared.scalar(value)
            )

    def _fold(self, node: Any) -> tuple[Any, Kind]:
        """Compute a constant expression; return its value and kind. Raises FortranError."""
        if isinstance(node, Constant):
            return node.value, node.kind
        if isinstance(node, Reference) and node.items is None and node.name in self.item.symbols:
            symbol = self.item.symbols[node.name]
            return symbol.constant, symbol.type.kind
        if isinstance(node, Unary) and node.operator in '+-':
            value, kind = self._fold(node.operand)
            return (-value if node.operator == '-' else value), kind
        if isinstance(node, Binary) and node.operator in ('+', '-', '*', '/', '**'):
            (a, kind_a), (b, kind_b) = self._fold(node.left), self._fold(node.right)
            try:
                kind = combined(Type(kind_a), Type(kind_b)).kind
                return scalar_operation(node.operator, kind)(a, b), kind
            except (ValueError, ArithmeticError, TypeError) as error:
                raise self.fail(node.at, f'constant expression: {error}') from None
        raise self.fail(getattr(node, 'at', 0), 'expected a constant expression')

    def _data(self, node: Node) -> None:
        for name, at, values in node.sets:
            if name not in self.declared:
                self._untyped(name, at)
                self.declared.append(name)
            self.initials[name] = values

    def _geometry(self, node: Node) -> None:
        known = {'PLANE': False, 'PLANAR': False, 'CYCLIC': True, 'CYCLE': True}
        for name in node.names:
            if name not in known:
                raise self.fail(node.at, f'GEOMETRY: expected PLANE or CYCLIC, got {name}')
        self.item.geometry = (known[node.names[0]], known[node.names[1]])

    def _implicit(self, node: Node) -> None:
        self.implicit_none = True
