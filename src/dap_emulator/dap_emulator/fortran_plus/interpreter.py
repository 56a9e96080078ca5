"""Interpreter: every statement becomes a Python closure once, and a run steps through them.

Parallel work is charged by the arrays themselves; scalar work of a statement is counted when it is compiled and charged
to the control unit each time the statement runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..machine.arrays import DapArray
from ..machine.machine import OutOfStore
from .control import Step, flatten
from .declarations import CheckedUnit, Symbol
from .errors import FortranError, FortranStoreError
from .expressions import Expressions, chosen_procedure, position_in, select_part
from .parser import located
from .running import Evaluate, Execute, Frame, Observer, Run, StopProgram, Store
from .settings import MAX_DEPTH, MAX_DISPLAY_BYTES, MAX_DISPLAYS, PRINTED_ELEMENTS, STEPS_PER_CHECK
from .storage import ArrayVariable
from .syntax import Constant, Node, Reference, Whole


class CompiledUnit:
    """A subroutine or function as closures.

    Parameters
    ----------
    item : CheckedUnit
    units : dict of str to CheckedUnit
        All units of the program, by name.
    """

    def __init__(self, item: CheckedUnit, units: dict[str, CheckedUnit]) -> None:
        self.item = item
        self.steps, loops = flatten(item.body)
        self.loop_base = 1 + sum(symbol.slot > 0 for symbol in item.symbols.values())
        self.frame_size = self.loop_base + loops
        self.lines = [step.node.source.line for step in self.steps]
        self.symbols = [symbol for symbol in item.symbols.values() if symbol.slot]
        compiler = _Compiler(self, units)
        # What others share is made before them.
        own = sorted((s for s in self.symbols if s.argument is None), key=lambda symbol: symbol.alias is not None)
        self.prepare = [compiler.preparation(symbol) for symbol in own]
        self.code = [compiler.step(step) for step in self.steps]

    def call(self, run: Run, arguments: list[Any]) -> Frame:
        """Run it with scalars and ArrayVariables in the order of its arguments; return its frame afterwards."""
        frame: Frame = [None] * self.frame_size
        frame[0] = run
        for symbol, value in zip(self.item.arguments, arguments):
            frame[symbol.slot] = value
        run.depth += 1
        if run.depth > MAX_DEPTH:
            raise located(self.item.unit.header.source, 0, f'calls nested deeper than {MAX_DEPTH}')
        run.check()
        caller_line = run.dap.line
        try:
            for prepare in self.prepare:
                prepare(frame)
            if run.observer is None:
                self._execute(run, frame)
            else:
                self._execute_observed(run, frame, run.observer)
        except StopProgram:
            if run.depth > 1:
                raise
        finally:
            run.depth -= 1
            run.dap.line = caller_line
        return frame

    def _execute(self, run: Run, frame: Frame) -> None:
        """Step through the code until its end or a RETURN."""
        dap, code, lines = run.dap, self.code, self.lines
        position, end = 0, len(code)
        try:
            while position < end:
                run.ticks += 1
                if not run.ticks & (STEPS_PER_CHECK - 1):
                    run.check()
                dap.line = lines[position]
                target = code[position](frame)
                position = position + 1 if target is None else target
        except (ValueError, IndexError, ArithmeticError, OutOfStore) as error:
            if isinstance(error, FortranError):
                raise
            raise self.failure(self.steps[position].node, error) from error

    def _execute_observed(self, run: Run, frame: Frame, observer: Observer) -> None:
        """As ``_execute``, step by step; the observer is told before and after each."""
        observer.entered(self.item, frame)
        position = 0
        try:
            while position < len(self.code):
                source = self.steps[position].node.source
                observer.began(
                    self.lines[position], position == 0 or source is not self.steps[position - 1].node.source
                )
                try:
                    target = self._observed_step(run, frame, position)
                finally:
                    observer.finished()
                position = position + 1 if target is None else target
        finally:
            observer.left()

    def _observed_step(self, run: Run, frame: Frame, position: int) -> int | None:
        run.check()
        run.dap.line = self.lines[position]
        try:
            return self.code[position](frame)
        except (ValueError, IndexError, ArithmeticError, OutOfStore) as error:
            if isinstance(error, FortranError):
                raise
            raise self.failure(self.steps[position].node, error) from error

    def failure(self, node: Node, error: Exception) -> FortranError:
        """The error that happened at a statement, with its place in the source."""
        where = located(node.source, node.at, str(error))
        kind = FortranStoreError if isinstance(error, OutOfStore) else FortranError
        return kind(where.reason, where.line, where.column, where.text)


class _Compiler(Expressions):
    """Closures for the statements of one unit."""

    def __init__(self, unit: CompiledUnit, units: dict[str, CheckedUnit]) -> None:
        super().__init__(unit.item, units)
        self.unit = unit

    # Variables.

    def preparation(self, symbol: Symbol) -> Callable[[Frame], None]:
        """Make a local or COMMON variable when its unit is called."""
        if symbol.alias is not None:
            return self._shared_preparation(symbol, *symbol.alias)
        return self._array_preparation(symbol) if symbol.dimensions else self._scalar_preparation(symbol)

    def _scalar_preparation(self, symbol: Symbol) -> Callable[[Frame], None]:
        slot, kind, initial, common = symbol.slot, symbol.type.kind, symbol.initial, symbol.common
        start: Any = {'LOGICAL': False, 'INTEGER': 0, 'REAL': 0.0, 'CHARACTER': ' '}[kind.name]
        if initial:
            start = initial[0] if kind.name == 'CHARACTER' else kind.scalar(initial[0])

        def prepare(frame: Frame) -> None:
            if common is None:
                frame[slot] = start
            else:
                frame[0].commons.setdefault(common, start)

        return prepare

    def _shared_preparation(self, symbol: Symbol, storage: str, place: int) -> Callable[[Frame], None]:
        """A variable whose values lie in a storage that it shares (EQUIVALENCE)."""
        shared, slot, kind = self.item.symbols[storage].slot, symbol.slot, symbol.type.kind
        shape, initial = self.extents(symbol), symbol.initial

        def prepare(frame: Frame) -> None:
            whole = frame[shared]
            parallel, serial = shape(frame)
            if parallel != whole.parallel:
                raise self.unit.failure(
                    self.item.unit.header,
                    ValueError(f'EQUIVALENCE: {symbol.name} has extents {parallel}, others {whole.parallel}'),
                )
            data = whole.data[place : place + math.prod(serial)]
            # The first serial index runs fastest, as in all of Fortran; numpy's last does.
            backwards = data.reshape(serial[::-1] + data.shape[1:])
            axes = (*reversed(range(len(serial))), *range(len(serial), backwards.ndim))
            variable = ArrayVariable(frame[0].dap, kind, parallel, serial, backwards.transpose(axes))
            _set_initial(variable, initial, symbol.name)
            if symbol.dimensions:
                frame[slot] = variable

        return prepare

    def _array_preparation(self, symbol: Symbol) -> Callable[[Frame], None]:
        slot, kind, initial = symbol.slot, symbol.type.kind, symbol.initial
        shape = self.extents(symbol)

        def new_array(frame: Frame) -> ArrayVariable:
            parallel, serial = shape(frame)
            variable = ArrayVariable(frame[0].dap, kind, parallel, serial, name=symbol.name)
            _set_initial(variable, initial, symbol.name)
            return variable

        def common_array(frame: Frame) -> ArrayVariable:
            commons = frame[0].commons
            if symbol.common not in commons:
                commons[symbol.common] = new_array(frame)
            variable: ArrayVariable = commons[symbol.common]
            if (variable.kind, variable.parallel, variable.serial) != (kind, *shape(frame)):
                assert symbol.common is not None
                raise ValueError(f'COMMON /{symbol.common[0]}/: {symbol.name} differs between subroutines')
            return variable

        make = new_array if symbol.common is None else common_array

        def prepare(frame: Frame) -> None:
            try:
                frame[slot] = make(frame)
            except (ValueError, OutOfStore) as error:
                if isinstance(error, FortranError):
                    raise
                raise self.unit.failure(self.item.unit.header, error) from error

        return prepare

    def extents(self, symbol: Symbol) -> Callable[[Frame], tuple[tuple[int, ...], tuple[int, ...]]]:
        """Find the parallel and serial extents of an array when it is made; an omitted parallel extent is ES."""
        parts = [
            (dimension.parallel, None if dimension.extent is None else self.expression(dimension.extent))
            for dimension in symbol.dimensions
        ]

        def shape(frame: Frame) -> tuple[tuple[int, ...], tuple[int, ...]]:
            found: tuple[list[int], list[int]] = ([], [])
            for parallel, extent in parts:
                value = frame[0].dap.es if extent is None else extent(frame)
                if value < 1:
                    raise ValueError(f'{symbol.name}: an extent is {value}, expected at least 1')
                found[0 if parallel else 1].append(value)
            return tuple(found[0]), tuple(found[1])

        return shape

    def store_scalar(self, symbol: Symbol) -> Store:
        """Assign to a scalar variable."""
        slot, common, kind = symbol.slot, symbol.common, symbol.type.kind
        convert: Callable[[Any], Any] = (lambda value: value) if kind.name in ('CHARACTER', 'LOGICAL') else kind.scalar

        if symbol.alias is not None:
            storage, place = self.item.symbols[symbol.alias[0]].slot, symbol.alias[1]

            def store_shared(frame: Frame, value: Any) -> None:
                frame[storage].data[place] = convert(value)

            return store_shared

        def store(frame: Frame, value: Any) -> None:
            if common is None:
                frame[slot] = convert(value)
            else:
                frame[0].commons[common] = convert(value)

        return store

    # Statements.

    def step(self, step: Step) -> Execute:
        """Make a step's closure, which charges the scalar work of its statement."""
        self.integers = self.reals = self.functions = 0
        run = getattr(self, '_step_' + step.what)(step)
        return self._with_scalar_work(run, branches=step.what != 'plain')

    def _with_scalar_work(self, run: Callable[[Frame], Any], branches: bool) -> Callable[[Frame], Any]:
        integers, reals, functions = self.integers, self.reals, self.functions
        if not (integers or reals or functions or branches):
            return run

        def charged(frame: Frame) -> Any:
            dap = frame[0].dap
            costs = dap.costs
            cycles = integers * costs.mcu() + reals * costs.mcu(real=True) + functions * costs.mcu(function=True)
            dap.charge_mcu('scalar', cycles + (round(costs['mcu_branch']) if branches else 0))
            return run(frame)

        return charged

    def _step_plain(self, step: Step) -> Execute:
        execute: Execute = getattr(self, '_' + step.node.what)(step.node)
        return execute

    def _step_jump(self, step: Step) -> Execute:
        target = step.target
        return lambda frame: target

    def _step_jump_unless(self, step: Step) -> Execute:
        condition, target = self.expression(step.condition), step.target
        return lambda frame: None if condition(frame) else target

    def _step_do_start(self, step: Step) -> Execute:
        node = step.node
        store = self.store_scalar(self.item.symbols[node.variable.name])
        first, last = self.expression(node.first), self.expression(node.last)
        by = self.expression(node.step) if node.step is not None else lambda frame: 1
        slot, target = self.unit.loop_base + step.loop, step.target

        def run(frame: Frame) -> int | None:
            start, stride = first(frame), by(frame)
            if stride == 0:
                raise ValueError('the step of a DO is zero')
            store(frame, start)
            trips = (last(frame) - start + stride) // stride
            frame[slot] = [trips, stride]
            return target if trips <= 0 else None

        return run

    def _step_do_next(self, step: Step) -> Execute:
        symbol = self.item.symbols[step.node.variable.name]
        load, store = self.load(symbol), self.store_scalar(symbol)
        slot, target = self.unit.loop_base + step.loop, step.target

        def run(frame: Frame) -> int | None:
            counter = frame[slot]
            counter[0] -= 1
            store(frame, load(frame) + counter[1])
            return target if counter[0] > 0 else None

        return run

    def _step_choose(self, step: Step) -> Execute:
        """An arithmetic IF or a computed GOTO."""
        targets = step.targets
        if step.node.what == 'arithmetic_if':
            self._count(step.node.value.type.kind)
            number = self.expression(step.node.value)

            def by_sign(frame: Frame) -> int:
                value = number(frame)
                # What is not a number is neither below nor above zero.
                return targets[0] if value < 0 else targets[2] if value > 0 else targets[1]

            return by_sign
        choice = self.expression(step.node.choice)

        def by_number(frame: Frame) -> int | None:
            chosen = choice(frame)
            return targets[chosen - 1] if 1 <= chosen <= len(targets) else None

        return by_number

    def _print(self, node: Node) -> Execute:
        values = [self.expression(value) for value in node.values]

        def run(frame: Frame) -> None:
            frame[0].print(' '.join(_printed(value(frame)) for value in values))

        return run

    def _return(self, node: Node) -> Execute:
        end = len(self.unit.steps)
        return lambda frame: end

    def _stop(self, node: Node) -> Execute:
        def run(frame: Frame) -> int | None:
            raise StopProgram

        return run

    def _call(self, node: Node) -> Execute:
        if node.name == 'DISPLAY' and node.name not in self.units:
            return self._display(node)
        if 'candidates' in node.parts:
            return self._call_procedure(node)
        bind = self.arguments(node.name, node.arguments)

        def run(frame: Frame) -> None:
            bind(frame)

        return run

    def _call_procedure(self, node: Node) -> Execute:
        """A call of the subroutine that a dummy argument stands for."""
        calls: dict[str, Evaluate] = {name: self.arguments(name, node.arguments) for name in node.candidates}
        slot, dummy = self.item.symbols[node.name].slot, node.name

        def run(frame: Frame) -> None:
            chosen_procedure(calls, frame[slot], dummy)(frame)

        return run

    def _display(self, node: Node) -> Execute:
        value = self.expression(node.arguments[0])
        title = self.expression(node.arguments[1]) if len(node.arguments) > 1 else None
        first = node.arguments[0]
        name = first.name if isinstance(first, Reference) else 'value'

        def run(frame: Frame) -> None:
            run = frame[0]
            if len(run.displays) < MAX_DISPLAYS and run.display_bytes < MAX_DISPLAY_BYTES:
                shown = value(frame)
                values = shown.values.copy() if isinstance(shown, DapArray) else np.asarray(shown)
                run.displays.append((name, values, str(title(frame)) if title else ''))
                run.display_bytes += values.nbytes

        return run

    def arguments(self, name: str, actuals: list[Any]) -> Callable[[Frame], Frame]:
        """Call a unit: arrays by reference, scalars copied in and back out."""
        dummies = self.units[name].arguments
        changed = self.units[name].changed
        makers = [self._actual(actual, dummy) for actual, dummy in zip(actuals, dummies)]
        backs: list[tuple[int, Store]] = []
        for dummy, actual in zip(dummies, actuals):
            if (
                not dummy.dimensions
                and dummy.name in changed
                and isinstance(actual, Reference)
                and actual.meaning == 'variable'
                and self.item.symbols[actual.name].slot
            ):
                backs.append((dummy.slot, self.target(actual)))

        def call(frame: Frame) -> Frame:
            run = frame[0]
            run.dap.charge_mcu('call', round(run.dap.costs['mcu_call']))
            inner: Frame = run.units[name].call(run, [make(frame) for make in makers])
            for slot, store in backs:
                store(frame, inner[slot])
            return inner

        return call

    def _actual(self, actual: Any, dummy: Symbol) -> Evaluate:
        """An argument as its unit receives it: arrays by reference, expressions as temporary variables."""
        if dummy.procedure:
            name = actual.name
            return self.load(self.item.symbols[name]) if name in self.item.symbols else lambda frame: name
        if not dummy.dimensions:
            value, kind = self.expression(actual), dummy.type.kind
            return value if kind.name in ('CHARACTER', 'LOGICAL') else lambda frame: kind.scalar(value(frame))
        if isinstance(actual, Reference) and actual.meaning == 'variable':
            symbol = self.item.symbols[actual.name]
            load = self.load(symbol)
            if actual.items is None:
                return self._same_shape(load, dummy)
            leading = len(actual.items) - symbol.type.serial
            if all(isinstance(item, Whole) for item in actual.items[:leading]):
                indices = [self.expression(item) for item in actual.items[leading:]]

                def part(frame: Frame) -> Any:
                    variable = load(frame)
                    return variable.part(variable.place(tuple(index(frame) for index in indices)))

                return self._same_shape(part, dummy)
        value = self.expression(actual)

        def temporary(frame: Frame) -> ArrayVariable:
            array = value(frame)
            variable = ArrayVariable(array.dap, dummy.type.kind, array.shape, ())
            variable.write((), array)
            return variable

        return self._same_shape(temporary, dummy)

    def _same_shape(self, make: Evaluate, dummy: Symbol) -> Evaluate:
        """Check the extents that the declaration of a dummy array gives as constants."""
        stated = [
            (axis, dimension.extent.value)
            for axis, dimension in enumerate(dummy.dimensions)
            if isinstance(dimension.extent, Constant)
        ]
        if not stated:
            return make

        def checked(frame: Frame) -> ArrayVariable:
            variable: ArrayVariable = make(frame)
            shape = variable.parallel + variable.serial
            for axis, extent in stated:
                if shape[axis] != extent:
                    raise ValueError(
                        f'argument {dummy.name} has shape {shape}, its declaration says {extent} '
                        f'in dimension {axis + 1}'
                    )
            return variable

        return checked

    def _assign(self, node: Node) -> Execute:
        value, store = self.expression(node.value), self.target(node.target)
        if not node.target.type.rank:
            self._count(node.target.type.kind)

        def run(frame: Frame) -> None:
            store(frame, value(frame))

        return run

    def target(self, node: Reference) -> Store:
        """Store into the target of an assignment."""
        symbol = self.item.symbols[node.name]
        rank, serial = symbol.type.rank, symbol.type.serial
        if not symbol.dimensions:
            return self.store_scalar(symbol)
        load = self.load(symbol)
        if node.items is None:
            return self._store_all(load, symbol)
        leading = len(node.items) - serial
        place = self._place(load, node.items[leading:])
        if not rank:

            def element(frame: Frame, value: Any) -> None:
                variable = load(frame)
                variable.data[place(frame, variable)] = (
                    value if variable.kind.name == 'CHARACTER' else variable.scalar(value)
                )

            return element
        items = node.items[:leading]
        if all(isinstance(item, Whole) for item in items):
            return lambda frame, value: load(frame).write(place(frame, load(frame)), value)
        masked = any(getattr(item, 'type', None) is not None and item.type.rank for item in items)
        if masked:
            return self._store_masked(symbol.name, load, place, items)
        return self._store_part(symbol.name, load, place, items)

    def _store_all(self, load: Evaluate, symbol: Symbol) -> Store:
        """X = ..., over the serial dimensions too."""
        if not symbol.type.serial:
            return lambda frame, value: load(frame).write((), value)

        def every(frame: Frame, value: Any) -> None:
            variable = load(frame)
            if variable.parallel:
                for place in np.ndindex(*variable.serial):
                    variable.write(place, value)
            else:
                variable.data[...] = value if variable.kind.name == 'CHARACTER' else variable.scalar(value)

        return every

    def _store_masked(self, name: str, load: Evaluate, place: Any, items: list[Any]) -> Store:
        """X(mask) = ..., X(rows,) = ... and X(,columns) = ..."""
        parts = [None if isinstance(item, Whole) else self.expression(item) for item in items]

        def store(frame: Frame, value: Any) -> None:
            variable = load(frame)
            masks: list[np.ndarray] = []
            for axis, part in enumerate(parts):
                if part is None:
                    continue
                chosen = part(frame)
                if isinstance(chosen, DapArray):
                    wanted = variable.parallel if chosen.rank == 2 else (variable.parallel[axis],)
                    if chosen.shape != wanted:
                        raise ValueError(f'a mask of shape {chosen.shape} for extents {wanted}')
                    mask = chosen.values
                else:
                    mask = np.zeros(variable.parallel[axis], dtype=bool)
                    mask[position_in(chosen, variable.parallel[axis])] = True
                if mask.ndim == 1 and len(variable.parallel) == 2:
                    mask = mask[:, None] if axis == 0 else mask[None, :]
                masks.append(mask)
            mask = masks[0]
            for other in masks[1:]:
                mask = mask & other
            if (
                isinstance(value, DapArray)
                and value.shape != variable.parallel
                and not (value.rank == 1 and mask.ndim == 2 and value.shape[0] == variable.parallel[mask.shape[0] != 1])
            ):
                raise ValueError(f'cannot assign shape {value.shape} to shape {variable.parallel}')
            observer = frame[0].observer
            if observer is not None:
                observer.assigned(name, np.broadcast_to(mask, variable.parallel))
            variable.write_where(place(frame, variable), value, mask)

        return store

    def _store_part(self, name: str, load: Evaluate, place: Any, items: list[Any]) -> Store:
        """X(i,j) = ..., X(i,) = ..., X(,j) = ..., X(k) = ..."""
        parts = [None if isinstance(item, Whole) else self.expression(item) for item in items]

        def store(frame: Frame, value: Any) -> None:
            variable = load(frame)
            where = select_part(variable.parallel, [part and part(frame) for part in parts])
            if isinstance(value, DapArray) and value.shape != tuple(
                extent for extent, index in zip(variable.parallel, where) if isinstance(index, slice)
            ):
                raise ValueError(f'cannot assign shape {value.shape} to a part of shape {variable.parallel}')
            observer = frame[0].observer
            if observer is not None:
                active = np.zeros(variable.parallel, dtype=bool)
                active[where] = True
                observer.assigned(name, active)
            variable.write_part(place(frame, variable), where, value)

        return store


def _set_initial(variable: ArrayVariable, initial: list[Any] | dict[int, Any] | None, name: str) -> None:
    """Give a serial array, or a scalar in a shared storage, the values of its DATA statement. Raises ValueError."""
    if initial is None:
        return
    if isinstance(initial, dict):
        for place, value in initial.items():
            variable.data[np.unravel_index(place, variable.data.shape, order='F')] = value
        return
    if len(initial) != variable.data.size:
        raise ValueError(f'DATA: {name} has {variable.data.size} elements, {len(initial)} given')
    variable.data[...] = np.asarray(initial, dtype=variable.data.dtype).reshape(variable.data.shape, order='F')


def _printed(value: Any) -> str:
    """A value in a line of PRINT: numbers as they are, truths T and F, arrays row by row."""
    if isinstance(value, (DapArray, ArrayVariable)):
        values = value.values if isinstance(value, DapArray) else value.to_numpy()
        if isinstance(values, str):
            return values
        shown = np.where(values, 'T', 'F') if values.dtype == bool else values
        return '\n' + np.array2string(shown, threshold=PRINTED_ELEMENTS, formatter={'str_kind': str})
    if isinstance(value, bool):
        return 'T' if value else 'F'
    return f'{value:.9g}' if isinstance(value, float) else str(value)


def compile_units(items: dict[str, CheckedUnit]) -> dict[str, CompiledUnit]:
    """Closures for all units."""
    return {name: CompiledUnit(item, items) for name, item in items.items()}
