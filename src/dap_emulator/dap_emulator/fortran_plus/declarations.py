"""Declarations: the names of a unit, their types and dimensions.

Undeclared scalars follow Fortran's rule (I to N are INTEGER, others REAL) unless the unit says IMPLICIT NONE.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..machine.kinds import CHARACTER, LOGICAL, Kind, integer, real
from .errors import FortranError
from .functions import combined
from .parser import located
from .scalars import scalar_operation
from .syntax import Binary, Constant, DataTarget, Dimension, Entity, Node, Reference, Type, Unary, Unit, Whole


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
    initial : list or dict, optional
        Values of a DATA statement: of all elements, or by place, counted from 0 with the first index running fastest.
    alias : (str, int), optional
        Name of the storage that EQUIVALENCE makes it share, and its first place there.
    procedure : bool
        Whether it is a dummy argument that stands for a subroutine or function.
    """

    name: str
    type: Type
    dimensions: list[Dimension]
    slot: int = 0
    argument: int | None = None
    common: tuple[str, int] | None = None
    constant: Any = None
    initial: list[Any] | dict[int, Any] | None = None
    alias: tuple[str, int] | None = None
    procedure: bool = False


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
    externals : dict of str to (Node, Type or None)
        Subroutines and functions that an EXTERNAL statement names, and the type it gives.
    implicit : bool
        Whether undeclared scalars take their type from their first letter.
    """

    unit: Unit
    symbols: dict[str, Symbol] = field(default_factory=dict)
    body: list[Node] = field(default_factory=list)
    changed: set[str] = field(default_factory=set)
    geometry: tuple[bool, bool] = (False, False)
    result: Type | None = None
    externals: dict[str, tuple[Node, Type | None]] = field(default_factory=dict)
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
        self.initials: dict[str, list[Any] | dict[int, Any]] = {}
        self.shares: list[tuple[Node, list[Reference]]] = []
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
            shared = {member.name for _, members in self.shares for member in members}
            unit.arguments = [name for name in self.declared if name not in self.item.symbols and name not in shared]
        if unit.is_function:
            self._function_result(unit)
        for name in unit.arguments:
            if name not in self.declared:
                self._untyped(name, 0)
                self.declared.append(name)
        for name in self.declared:
            self._untyped(name, 0)
            if name not in self.item.externals or name in unit.arguments:
                self._symbol(name)
        self._share_storage()
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
            procedure=name in self.item.externals,
        )
        if symbol.procedure:
            declared = self.item.externals[name][1]
            symbol.type = declared if declared is not None else symbol.type
            if dimensions:
                raise self.fail(0, f'{name} is EXTERNAL and has dimensions')
            if self.item.unit.entry:
                raise self.fail(0, f'{name}: the host cannot hand a procedure to an ENTRY SUBROUTINE')
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

    def _external(self, node: Node) -> None:
        for name, at in node.names:
            if name in self.item.externals:
                raise self.fail(at, f'{name} is EXTERNAL twice')
            result = None
            if node.type is not None or node.rank is not None:
                kind = implicit_kind(name) if node.type is None else declared_kind(node.type, None)
                result = Type(kind, node.rank or 0)
            self.item.externals[name] = node, result

    def _data(self, node: Node) -> None:
        for targets, values in node.sets:
            for target in targets:
                if target.name not in self.declared:
                    self._untyped(target.name, target.at)
                    self.declared.append(target.name)
            if len(targets) == 1 and targets[0].items is None:
                # The number of elements may depend on an argument; it is checked when the array is made.
                self.initials[targets[0].name] = values
            else:
                self._spread(targets, list(values))

    def _spread(self, targets: list[DataTarget], values: list[Any]) -> None:
        """Give the values of a DATA statement to its targets, one after the other."""
        places = [(target, place) for target in targets for place in self._places(target)]
        if len(places) != len(values):
            raise self.fail(targets[0].at, f'DATA: {len(places)} element(s), {len(values)} value(s)')
        for (target, place), value in zip(places, values):
            found = self.initials.setdefault(target.name, {})
            if not isinstance(found, dict):
                raise self.fail(target.at, f'DATA: {target.name} has its values already')
            found[place] = value

    def _places(self, target: DataTarget) -> list[int]:
        """Places of a DATA target among the elements of its array."""
        extents = self._serial_extents(target.name, target.at)
        if target.items is None:
            return list(range(math.prod(extents)))
        if target.loop is None:
            return [self._place(target, extents)]
        variable, *bounds = target.loop
        first, last, step = (1 if bound is None else self._whole(bound) for bound in bounds)
        if step == 0:
            raise self.fail(target.at, 'DATA: the step of the implied DO is zero')
        found = []
        hidden = self.item.symbols.get(variable)
        for value in range(first, last + (1 if step > 0 else -1), step):
            self.item.symbols[variable] = Symbol(variable, Type(integer(4)), [], constant=value)
            found.append(self._place(target, extents))
        self.item.symbols.pop(variable, None)
        if hidden is not None:
            self.item.symbols[variable] = hidden
        return found

    def _serial_extents(self, name: str, at: int) -> list[int]:
        """Extents of the serial dimensions, which must be constants; [] of a scalar."""
        serial = [dimension for dimension in self.dimensions.get(name, []) if not dimension.parallel]
        return [self._whole(dimension.extent) for dimension in serial]

    def _whole(self, expression: Any) -> int:
        """A constant INTEGER expression."""
        value, kind = self._fold(expression)
        if kind.name != 'INTEGER':
            raise self.fail(getattr(expression, 'at', 0), f'expected an INTEGER constant, got {kind}')
        return int(value)

    def _place(self, target: DataTarget | Reference, extents: list[int]) -> int:
        """Place of an element, from 0, the first index running fastest."""
        items = [item for item in target.items or [] if not isinstance(item, Whole)]
        if len(items) != len(extents):
            raise self.fail(target.at, f'{target.name} takes {len(extents)} serial index(es), {len(items)} given')
        place, size = 0, 1
        for item, extent in zip(items, extents):
            index = self._whole(item)
            if not 1 <= index <= extent:
                raise self.fail(target.at, f'{target.name}: index {index} is outside 1 to {extent}')
            place += (index - 1) * size
            size *= extent
        return place

    def _equivalence(self, node: Node) -> None:
        self.shares += [(node, members) for members in node.shares]

    def _share_storage(self) -> None:
        """Make the storages that EQUIVALENCE joins, and tell the names where they lie in them. Raises FortranError."""
        groups: list[dict[str, int]] = []  # where each name begins, relative to the others
        for node, members in self.shares:
            self.node = node
            joined: dict[str, int] = {}
            for member in members:
                self._check_member(member)
                begins = -self._place(member, self._serial_extents(member.name, member.at) if member.items else [])
                old = next((group for group in groups if member.name in group), {member.name: begins})
                groups = [group for group in groups if group is not old]
                for name, place in old.items():
                    where = place + begins - old[member.name]
                    if joined.setdefault(name, where) != where:
                        raise self.fail(member.at, f'EQUIVALENCE: {name} would begin at two places')
            groups.append(joined)
        for number, group in enumerate(groups, 1):
            self._storage(f'(shared {number})', group)

    def _check_member(self, member: Reference) -> None:
        """Refuse what cannot share its storage."""
        symbol = self.item.symbols.get(member.name)
        if symbol is None:
            self._untyped(member.name, member.at)
            self._symbol(member.name)
            symbol = self.item.symbols[member.name]
        kinds = {'an argument': symbol.argument is not None, 'in COMMON': symbol.common is not None}
        kinds |= {'a constant': symbol.slot == 0, "the function's value": member.name == self.item.unit.name}
        for what, holds in kinds.items():
            if holds:
                raise self.fail(member.at, f'EQUIVALENCE: {member.name} is {what}, and its storage its own')

    def _storage(self, name: str, group: dict[str, int]) -> None:
        """A serial array that holds the members of a group, which must be alike but for their serial extents."""
        symbols = [self.item.symbols[member] for member in group]
        first = symbols[0]
        for symbol in symbols[1:]:
            if (symbol.type.kind, symbol.type.rank) != (first.type.kind, first.type.rank):
                raise self.fail(
                    0, f'EQUIVALENCE: {first.name} is {first.type}, {symbol.name} is {symbol.type}; they must be alike'
                )
        start = min(group.values())
        sizes = {member: math.prod(self._serial_extents(member, 0)) for member in group}
        total = max(place - start + sizes[member] for member, place in group.items())
        dimensions = [dimension for dimension in first.dimensions if dimension.parallel]
        dimensions.append(Dimension(False, Constant(total, integer(4), 0, Type(integer(4)))))
        storage = Symbol(name, Type(first.type.kind, first.type.rank, 1), dimensions)
        storage.slot = 1 + sum(other.slot > 0 for other in self.item.symbols.values())
        self.item.symbols[name] = storage
        for member, place in group.items():
            self.item.symbols[member].alias = name, place - start

    def _geometry(self, node: Node) -> None:
        known = {'PLANE': False, 'PLANAR': False, 'CYCLIC': True, 'CYCLE': True}
        for name in node.names:
            if name not in known:
                raise self.fail(node.at, f'GEOMETRY: expected PLANE or CYCLIC, got {name}')
        self.item.geometry = (known[node.names[0]], known[node.names[1]])

    def _implicit(self, node: Node) -> None:
        self.implicit_none = True
