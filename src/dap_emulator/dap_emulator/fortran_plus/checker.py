"""Checker: types, ranks, labels and calls, before anything runs."""

from __future__ import annotations

from typing import Any

from ..machine.kinds import LOGICAL, integer, real
from .declarations import CheckedUnit, Declarations, Symbol, implicit_kind
from .errors import FortranError
from .functions import FUNCTIONS, combined, combined_rank
from .parser import located
from .syntax import Binary, Constant, Node, Reference, Step, Type, Unary, Unit, Whole

RELATIONS = ('.EQ.', '.NE.', '.LT.', '.LE.', '.GT.', '.GE.')
_BUILTIN_CALLS = {'DISPLAY': (1, 2)}


def check(units: list[Unit]) -> dict[str, CheckedUnit]:
    """Check all units of a program.

    Parameters
    ----------
    units : list of Unit

    Returns
    -------
    dict of str to CheckedUnit
        By name; their trees now carry types and meanings.

    Raises
    ------
    FortranError
        With the place of the first mistake.
    """
    checked: dict[str, CheckedUnit] = {}
    for unit in units:
        if unit.name in checked:
            raise located(unit.header.source, unit.header.at, f'{unit.name} is defined twice')
        checked[unit.name] = CheckedUnit(unit)
    for item in checked.values():
        Declarations(item).run()
    for item in checked.values():
        _Body(item, checked).run()
    return checked


def _labels(node: Node) -> list[int]:
    """Labels that a statement may jump to."""
    if node.what == 'goto':
        return [node.target]
    return list(node.targets) if node.what in ('computed_goto', 'arithmetic_if') else []


class _Body:
    """Types and meanings in the executable statements of a unit."""

    def __init__(self, item: CheckedUnit, units: dict[str, CheckedUnit]) -> None:
        self.item, self.units, self.node = item, units, item.unit.header

    def fail(self, at: int, reason: str) -> FortranError:
        """An error at an offset of the statement that is being checked."""
        return located(self.node.source, at, reason)

    def run(self) -> None:
        """Check the statements in order. Raises FortranError."""
        for symbol in list(self.item.symbols.values()):
            for dimension in symbol.dimensions:
                if dimension.extent is not None:
                    self._scalar_integer(dimension.extent, f'an extent of {symbol.name}')
        self._externals()
        labels = [node.label for node in self.item.body if node.label is not None]
        known = set(labels)
        seen: set[int] = set()
        for node in self.item.body:
            self.node = node
            if node.label in seen:
                raise self.fail(0, f'label {node.label} is used twice')
            if node.label is not None:
                seen.add(node.label)
            self._statement(node, known)
        for symbol in self.item.symbols.values():
            if symbol.initial is not None and (symbol.type.rank or symbol.argument is not None or symbol.common):
                raise self.fail(0, f'DATA: {symbol.name} must be a local scalar or serial array')

    def _externals(self) -> None:
        """What EXTERNAL names must be there, and of the type that is said."""
        for name, (node, result) in self.item.externals.items():
            if name in self.item.unit.arguments:
                continue
            self.node = node
            called = self.units.get(name)
            if called is None:
                raise self.fail(node.at, f'EXTERNAL: there is no subroutine or function {name}')
            if result is not None and called.result != result:
                found = 'a subroutine' if called.result is None else called.result
                raise self.fail(node.at, f'EXTERNAL: {name} is {found}, not {result}')

    def _statement(self, node: Node, labels: set[int]) -> None:
        """Check one statement by the method of its name."""
        handler = getattr(self, '_' + node.what, None)
        for label in _labels(node):
            if label not in labels:
                raise self.fail(node.at, f'label {label}: there is no such label in {self.item.unit.name}')
        if handler is not None:
            handler(node)
        if node.what == 'if':
            self._statement(node.then, labels)

    def _assign(self, node: Node) -> None:
        target: Reference = node.target
        symbol = self._variable(target)
        if symbol.constant is not None:
            raise self.fail(target.at, f'{target.name} is a constant')
        self.item.changed.add(target.name)
        place = self._indexed(target, symbol, target=True)
        value = self.type_of(node.value)
        if value.serial:
            raise self.fail(node.value.at, 'a whole array with serial dimensions cannot be a value')
        self._assignable(place, value, node.value.at)
        if place.rank == 2 and value.rank == 1 and not self._selects(target):
            raise self.fail(node.value.at, 'cannot assign a vector to a matrix')

    def _selects(self, target: Reference) -> bool:
        """Whether rows or columns of the target are selected by a mask."""
        return any(getattr(item, 'type', None) == Type(LOGICAL, 1) for item in target.items or [])

    def _assignable(self, place: Type, value: Type, at: int) -> None:
        group = {'INTEGER': 'number', 'REAL': 'number'}
        if group.get(place.kind.name, place.kind.name) != group.get(value.kind.name, value.kind.name):
            raise self.fail(at, f'cannot assign {value} to {place}')
        if value.rank and value.rank != place.rank and not (place.rank == 2 and value.rank == 1):
            raise self.fail(at, f'cannot assign {value} to {place}')
        if value.rank == 1 and place.rank == 2:
            return  # a vector into selected rows or columns; _assign has looked
        if place.rank == 0 and value.rank:
            raise self.fail(at, f'cannot assign {value} to {place}')

    def _call(self, node: Node) -> None:
        if node.name in _BUILTIN_CALLS and node.name not in self.units:
            least, most = _BUILTIN_CALLS[node.name]
            if not least <= len(node.arguments) <= most:
                raise self.fail(node.at, f'{node.name} takes {least} to {most} arguments')
            for argument in node.arguments:
                self.type_of(argument)
            return
        symbol = self.item.symbols.get(node.name)
        if symbol is not None and symbol.procedure:
            node.parts['candidates'] = self._candidates(node.name, node.arguments, node.at, None)
            return
        called = self.units.get(node.name)
        if called is None or called.unit.is_function:
            raise self.fail(node.at, f'there is no subroutine {node.name}')
        self._arguments(called, node.arguments, node.at)

    def _candidates(self, name: str, actuals: list[Any], at: int, result: Type | None) -> list[str]:
        """Units that a procedure with these arguments may stand for: functions of this result, or subroutines."""
        found = []
        for other, called in self.units.items():
            if called.result != result or called.unit.entry:
                continue
            try:
                self._arguments(called, actuals, at)
            except FortranError:
                continue
            found.append(other)
        if not found:
            what = 'subroutine' if result is None else f'function of {result}'
            raise self.fail(at, f'{name}: no {what} of the program takes these arguments')
        return found

    def _arguments(self, called: CheckedUnit, actuals: list[Any], at: int) -> None:
        dummies = called.arguments
        if len(actuals) != len(dummies):
            raise self.fail(at, f'{called.unit.name} takes {len(dummies)} argument(s), {len(actuals)} given')
        for dummy, actual in zip(dummies, actuals):
            if isinstance(actual, (Whole, Step)):
                raise self.fail(at, f'{called.unit.name}: an argument is missing')
            if dummy.procedure:
                self._procedure(actual, dummy, called.unit.name)
                continue
            given = self.type_of(actual)
            wanted = dummy.type
            where = f'{called.unit.name}: argument {dummy.name}'
            if (given.rank, given.serial) != (wanted.rank, wanted.serial):
                raise self.fail(actual.at, f'{where} is {wanted}, got {given}')
            exact = bool(wanted.rank or wanted.serial)
            numbers = given.kind.is_numeric and wanted.kind.is_numeric
            if given.kind != wanted.kind and (exact or not numbers):
                raise self.fail(actual.at, f'{where} is {wanted}, got {given}')
            if isinstance(actual, Reference) and actual.meaning == 'variable':
                self.item.changed.add(actual.name)

    def _procedure(self, actual: Any, dummy: Symbol, called: str) -> None:
        """An argument that must be a subroutine or function: the name of one, or a dummy that stands for one."""
        where = f'{called}: argument {dummy.name}'
        name = actual.name if isinstance(actual, Reference) and actual.items is None else None
        symbol = self.item.symbols.get(name or '')
        if symbol is not None and symbol.procedure:
            result: Type | None = symbol.type
        elif name in self.units and symbol is None:
            result = self.units[name].result
        else:
            raise self.fail(getattr(actual, 'at', 0), f'{where} is a subroutine or function')
        if result is not None and result != dummy.type:
            raise self.fail(actual.at, f'{where} is a function of {dummy.type}, {name} is one of {result}')
        actual.meaning, actual.type = 'procedure', dummy.type

    def _arithmetic_if(self, node: Node) -> None:
        found = self.type_of(node.value)
        if not found.kind.is_numeric or found.rank or found.serial:
            raise self.fail(node.value.at, f'an arithmetic IF takes a number, got {found}')

    def _computed_goto(self, node: Node) -> None:
        self._scalar_integer(node.choice, 'the choice of a GOTO')

    def _print(self, node: Node) -> None:
        for value in node.values:
            self.type_of(value)

    def _condition(self, node: Node) -> None:
        found = self.type_of(node.condition)
        if found.kind != LOGICAL or found.rank:
            hint = ' (use ANY or ALL)' if found.rank else ''
            raise self.fail(node.condition.at, f'a condition is a LOGICAL scalar, got {found}{hint}')

    _if = _block_if = _else_if = _do_while = _condition

    def _do(self, node: Node) -> None:
        symbol = self._variable(node.variable)
        if symbol.type != Type(symbol.type.kind) or symbol.type.kind.name != 'INTEGER' or symbol.constant is not None:
            raise self.fail(node.variable.at, f'a DO variable is an INTEGER scalar, {symbol.name} is {symbol.type}')
        node.variable.type, node.variable.meaning = symbol.type, 'variable'
        self.item.changed.add(symbol.name)
        for part in (node.first, node.last, node.step):
            if part is not None:
                self._scalar_integer(part, 'a DO bound')

    def _scalar_integer(self, expression: Any, what: str) -> None:
        found = self.type_of(expression)
        if found.kind.name != 'INTEGER' or found.rank or found.serial:
            raise self.fail(expression.at, f'{what} is an INTEGER scalar, got {found}')

    # Expressions.

    def type_of(self, node: Any) -> Type:
        """Find the type of an expression, and note it there. Raises FortranError."""
        if node.__class__ is Constant:
            node.type = Type(node.kind)
        elif isinstance(node, Reference):
            node.type = self._reference(node)
        elif isinstance(node, (Unary, Binary)):
            try:
                node.type = self._operation(node)
            except ValueError as error:
                if isinstance(error, FortranError):
                    raise
                raise self.fail(node.at, str(error)) from None
        else:
            raise self.fail(getattr(node, 'at', 0), 'expected a value')
        found: Type = node.type
        return found

    def _operation(self, node: Any) -> Type:
        """The type of an operation. Raises ValueError when its operands do not go together."""
        if isinstance(node, Unary):
            return self._unary(node)
        left, right = self._value(node.left), self._value(node.right)
        if node.operator in RELATIONS:
            return Type(LOGICAL, self._related(node.operator, left, right))
        if node.operator.startswith('.'):
            if left.kind != LOGICAL or right.kind != LOGICAL:
                raise ValueError(f'{node.operator} of {left} and {right}')
            return Type(LOGICAL, combined_rank(left, right))
        result = combined(left, right)
        if node.operator == '**':
            if right.kind.name == 'INTEGER' and not right.rank:
                return left
            if left.kind.name == 'INTEGER' and result.kind.name == 'INTEGER' and result.rank:
                return Type(real(4) if result.kind.bits <= 32 else real(8), result.rank)
        return result

    def _unary(self, node: Unary) -> Type:
        inner = self._value(node.operand)
        if node.operator == '.NOT.':
            if inner.kind != LOGICAL:
                raise ValueError(f'.NOT. of {inner}')
        elif not inner.kind.is_numeric:
            raise ValueError(f'sign of {inner}')
        return inner

    def _related(self, operator: str, left: Type, right: Type) -> int:
        if left.kind.name == right.kind.name == 'CHARACTER' and not left.rank and not right.rank:
            return 0
        if left.kind == right.kind == LOGICAL and operator in ('.EQ.', '.NE.'):
            return combined_rank(left, right)
        return combined(left, right).rank

    def _value(self, node: Any) -> Type:
        """The type of an expression that must not be an array with serial dimensions."""
        found = self.type_of(node)
        if found.serial:
            raise self.fail(node.at, f'{found} cannot be used as a whole in an expression')
        return found

    def _reference(self, node: Reference) -> Type:
        name = node.name
        is_own_result = self.item.unit.is_function and name == self.item.unit.name
        if name in self.item.symbols and not (
            is_own_result and node.items is not None and not self.item.symbols[name].dimensions
        ):
            symbol = self.item.symbols[name]
            if symbol.procedure:
                return self._procedure_value(node, symbol)
            node.meaning = 'variable'
            return self._indexed(node, symbol, target=False)
        if node.items is None and self._is_function_without_arguments(name):
            node.items = []
        if node.items is not None and name in self.units:
            called = self.units[name]
            if called.result is None:
                raise self.fail(node.at, f'{name} is a subroutine, not a function')
            node.meaning = 'function'
            actuals = [] if len(node.items) == 1 and isinstance(node.items[0], Whole) else node.items
            self._arguments(called, actuals, node.at)
            return called.result
        if node.items is not None and name in FUNCTIONS:
            return self._intrinsic(node)
        if node.items is not None:
            raise self.fail(node.at, f'{name} is neither an array nor a function')
        node.meaning = 'variable'
        return self._variable(node).type

    def _is_function_without_arguments(self, name: str) -> bool:
        called = self.units.get(name)
        return called is not None and called.result is not None and not called.arguments

    def _procedure_value(self, node: Reference, symbol: Symbol) -> Type:
        """The type of a call of a function that was handed over."""
        if node.items is None:
            raise self.fail(node.at, f'{node.name} is EXTERNAL: call it, or hand it on')
        node.meaning = 'procedure'
        if len(node.items) == 1 and isinstance(node.items[0], Whole):
            node.items = []
        node.candidates = self._candidates(node.name, node.items, node.at, symbol.type)
        return symbol.type

    def _intrinsic(self, node: Reference) -> Type:
        """The type of a call of an intrinsic function."""
        node.meaning = 'intrinsic'
        function = FUNCTIONS[node.name]
        items = node.items or []
        if len(items) == 1 and isinstance(items[0], Whole):
            items = node.items = []
        if not function.least <= len(items) <= function.most:
            wanted = str(function.least) if function.least == function.most else f'{function.least} to {function.most}'
            raise self.fail(node.at, f'{node.name} takes {wanted} argument(s), {len(items)} given')
        types = []
        for item in items:
            if isinstance(item, (Whole, Step)):
                raise self.fail(node.at, f'{node.name}: an argument is missing')
            types.append(self._value(item))
        try:
            if node.name == 'LENGTH':
                return self._length(items, types)
            return function.result(types)
        except ValueError as error:
            if isinstance(error, FortranError):
                raise
            raise self.fail(node.at, f'{node.name}: {error}') from None

    def _length(self, items: list[Any], types: list[Type]) -> Type:
        """The type of LENGTH(x, n), whose word length must be a constant."""
        if not isinstance(items[1], Constant) or not isinstance(items[1].value, int) or not types[0].kind.is_numeric:
            raise ValueError('expected a number and a constant word length')
        n = items[1].value
        return Type(real(n) if types[0].kind.name == 'REAL' else integer(n), types[0].rank)

    def _variable(self, node: Reference) -> Symbol:
        """Find the symbol of a name; an undeclared scalar is declared by its first letter."""
        symbol = self.item.symbols.get(node.name)
        if symbol is None:
            if node.items is not None:
                raise self.fail(node.at, f'{node.name} is not a declared array')
            if not self.item.implicit:
                raise self.fail(node.at, f'{node.name} is not declared')
            if node.name in self.units:
                raise self.fail(node.at, f'{node.name} is a subroutine or function, not a variable')
            symbol = Symbol(node.name, Type(implicit_kind(node.name)), [])
            symbol.slot = 1 + sum(other.slot > 0 for other in self.item.symbols.values())
            self.item.symbols[node.name] = symbol
        return symbol

    def _indexed(self, node: Reference, symbol: Symbol, target: bool) -> Type:
        """Find the type of a variable, alone or indexed, and note it there."""
        node.meaning = 'variable'
        full, items = symbol.type, node.items
        if items is None:
            node.type = full
            return full
        rank, serial = full.rank, full.serial
        if not rank and not serial:
            raise self.fail(node.at, f'{node.name} is a scalar and takes no index')
        single = rank == 2 and len(items) == 1 + serial
        if len(items) != rank + serial and not single:
            raise self.fail(node.at, f'{node.name} takes {rank + serial} indices, {len(items)} given')
        leading = 1 if single else rank
        for item in items[leading:]:
            if isinstance(item, (Whole, Step)):
                raise self.fail(node.at, f'{node.name}: a serial dimension needs an INTEGER index')
            self._scalar_integer(item, f'a serial index of {node.name}')
        if single:
            left = self._single(node, items[0], target)
        else:
            left = sum(self._keeps(node, item, target) for item in items[:rank])
        found = node.type = Type(full.kind, left)
        return found

    def _single(self, node: Reference, item: Any, target: bool) -> int:
        """Rank that is left of a matrix with one index, which is a mask or an element in long-vector order."""
        found = None if isinstance(item, (Whole, Step)) else self._value(item)
        if found is not None and found.kind == LOGICAL and found.rank == 2:
            return 2 if target else 0
        if found is not None and found.kind.name == 'INTEGER' and not found.rank:
            return 0
        raise self.fail(node.at, f'{node.name}: expected a LOGICAL matrix or an INTEGER scalar as the only index')

    def _keeps(self, node: Reference, item: Any, target: bool) -> int:
        """Rank that an index leaves: 1 when it keeps its parallel dimension, 0 when it selects within it."""
        if isinstance(item, Step) and target:
            raise self.fail(item.at, f'{node.name}: a neighbour cannot be assigned to')
        if isinstance(item, (Whole, Step)):
            return 1
        found = self._value(item)
        if found.kind.name == 'INTEGER' and not found.rank:
            return 0
        if found.kind == LOGICAL and found.rank == 1:
            return 1 if target else 0
        raise self.fail(item.at, f'{node.name}: expected an INTEGER scalar or a LOGICAL vector as index, got {found}')
