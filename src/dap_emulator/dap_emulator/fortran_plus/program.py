"""A compiled program: run it on a machine, read its results, list it with the cycles of every line."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..machine.arrays import DapArray
from ..machine.machine import Machine, Stats
from .checker import check
from .declarations import CheckedUnit, Symbol
from .errors import FortranError
from .interpreter import compile_units
from .parser import parse
from .running import Display, Limits, Observer, Run, deep_recursion
from .storage import ArrayVariable
from .syntax import Constant


class Result(Mapping[str, Any]):
    """The entry's arguments after a run, by upper-case name, and what the run cost.

    Parameters
    ----------
    values : dict of str to array or scalar
        In the language's order of dimensions.
    stats : Stats
        Of this run alone.
    displays : list of (name, values, title)
        What CALL DISPLAY has shown.
    source : str
        The program's text.
    printed : sequence of str
        Lines of PRINT.
    """

    def __init__(
        self, values: dict[str, Any], stats: Stats, displays: list[Display], source: str, printed: Sequence[str] = ()
    ) -> None:
        self._values, self.stats, self.displays, self.source = values, stats, displays, source
        self.printed = list(printed)

    @property
    def cycles(self) -> int:
        """Cycles of the machine: computed, not simulated."""
        return self.stats.cycles

    @property
    def seconds(self) -> float:
        """Predicted time on the machine, seconds."""
        return self.stats.seconds

    def __getitem__(self, name: str) -> Any:
        return self._values[name.upper()]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name.upper() in self._values

    def __len__(self) -> int:
        return len(self._values)

    def listing(self) -> str:
        """Return the source text, every line with the number of its operations, their cycles and share.

        What the program has printed follows.
        """
        total = max(1, self.cycles)
        rows = [f'{"charges":>9} {"cycles":>12} {"share":>6}  line']
        for number, text in enumerate(self.source.splitlines(), 1):
            count, cycles = self.stats.lines.get(number, (0, 0))
            figures = f'{count:>9} {cycles:>12} {100 * cycles / total:5.1f}%' if count else ' ' * 29
            rows.append(f'{figures} {number:>5}  {text}')
        rows += ['', *self.printed, ''] if self.printed else []
        rows.append(f'{self.cycles} cycles, {self.seconds:.6g} s (computed, not simulated)')
        return '\n'.join(rows)

    def __repr__(self) -> str:
        names = ', '.join(
            f'{name}{value.shape}' if isinstance(value, np.ndarray) else f'{name}={value}'
            for name, value in self._values.items()
        )
        return f'Result({names}; {self.cycles} cycles, {self.seconds:.6g} s, computed)'

    def _repr_html_(self) -> str:
        return f'<pre>{self!r}</pre>{self.stats._repr_html_()}'


class Program:
    """A compiled program.

    Parameters
    ----------
    source : str
    form : {'auto', 'free', 'fixed'}

    Attributes
    ----------
    units : dict of str to CheckedUnit
        Subroutines and functions by name.
    entries : list of str
        Names of those that the host may call.

    Raises
    ------
    FortranError
        With the place of the first mistake.
    """

    def __init__(self, source: str, form: str = 'auto') -> None:
        self.source = source
        try:
            self.units: dict[str, CheckedUnit] = check(parse(source, form))
            self._compiled = compile_units(self.units)
        except RecursionError:
            raise FortranError('an expression has too many operations one inside the other') from None
        self.entries = [name for name, item in self.units.items() if item.unit.entry]

    def entry(self, name: str | None = None) -> CheckedUnit:
        """Find the entry of this name, or the only one. Raises ValueError."""
        return self.units[chosen_entry(name, self.entries)]

    def run(
        self,
        dap: Machine,
        entry: str | None = None,
        *,
        limits: Limits | None = None,
        observer: Observer | None = None,
        **arguments: Any,
    ) -> Result:
        """Run an entry.

        Parameters
        ----------
        dap : Machine
        entry : str, optional
            Name of the ENTRY SUBROUTINE; may be left out when there is one only.
        limits : Limits, optional
        observer : Observer, optional
            Told of every statement: ``watch.Recorder`` keeps what it sees.
        **arguments
            By name, in any case: numbers, texts, and arrays in the language's order of dimensions. A DapArray is passed
            by reference and holds afterwards what the program left in it; numpy arrays are copied. An argument that is
            left out starts as zeros; its omitted extents are those of the given arrays with as many parallel
            dimensions, or ES.

        Returns
        -------
        Result

        Raises
        ------
        FortranError
            When the program fails; FortranStoreError when the store is exhausted.
        Stopped
            When a limit is reached or the run is cancelled.
        ValueError
            Naming an argument that does not fit.
        """
        unit = self.entry(entry)
        given = {name.upper(): value for name, value in arguments.items()}
        known = [symbol.name for symbol in unit.arguments]
        for name in given:
            if name not in known:
                raise ValueError(f'{name}: no such argument of {unit.unit.name}, expected {", ".join(known) or "none"}')
        run = Run(dap, self._compiled, limits or Limits(), observer)
        watch = dap.watch
        try:
            with dap.measured() as stats_so_far:
                values = _bind(dap, unit, given)
                run.started, run.first_cycle = time.monotonic(), dap.cycles
                dap.watch = run.check if limits is not None else watch
                with deep_recursion():
                    frame = self._compiled[unit.unit.name].call(run, [values[name] for name in known])
                dap.watch = watch
                results = {symbol.name: _host_value(frame[symbol.slot]) for symbol in unit.arguments}
                for name, value in given.items():
                    if isinstance(value, DapArray):
                        value.replace(results[name])
                stats = stats_so_far()
        finally:
            dap.line, dap.watch = 0, watch
        return Result(results, stats, run.displays, self.source, run.printed)

    def __repr__(self) -> str:
        signatures = [
            f'{name}({", ".join(symbol.name for symbol in self.units[name].arguments)})' for name in self.entries
        ]
        return f'Program({"; ".join(signatures) or "no entries"})'


def chosen_entry(name: str | None, entries: Sequence[str]) -> str:
    """The entry of this name, in any case, or the only one.

    Parameters
    ----------
    name : str, optional
    entries : sequence of str
        All that the program has.

    Raises
    ------
    ValueError
        When there is no such entry, or several and no name.
    """
    if name is None:
        if len(entries) != 1:
            raise ValueError(
                f'entry: the program has {len(entries)} entries ({", ".join(entries) or "none"}); name one'
            )
        return entries[0]
    if name.upper() not in entries:
        raise ValueError(
            f'entry: {name!r} is not an ENTRY SUBROUTINE, expected one of '
            f'{", ".join(entries) or "(the program has none)"}'
        )
    return name.upper()


def compile(source: str, form: str = 'auto') -> Program:
    """Compile a Fortran-Plus program.

    Parameters
    ----------
    source : str
    form : {'auto', 'free', 'fixed'}

    Returns
    -------
    Program

    Raises
    ------
    FortranError
        With the place of the first mistake.

    Examples
    --------
    >>> from dap_emulator import Dap
    >>> program = compile('''
    ...       ENTRY SUBROUTINE DOUBLE(A)
    ...       INTEGER A(*,)
    ...       A = 2 * A
    ...       END
    ... ''')
    >>> program.run(Dap.model('510'), a=[[1, 2], [3, 4]])['A'].tolist()
    [[2, 4], [6, 8]]
    """
    return Program(source, form)


def _host_value(value: Any) -> Any:
    """An argument as the host sees it: a numpy array or a scalar."""
    return value.to_numpy() if isinstance(value, ArrayVariable) else value


def _bind(dap: Machine, unit: CheckedUnit, given: dict[str, Any]) -> dict[str, Any]:
    """Turn the host's arguments into scalars and variables, by name."""
    values: dict[str, Any] = {}
    for symbol in unit.arguments:
        if not symbol.dimensions:
            values[symbol.name] = _scalar(symbol, given.get(symbol.name))
    shapes = {
        name: np.shape(value.values if isinstance(value, DapArray) else value)
        for name, value in given.items()
        if name not in values and not isinstance(value, str)
    }
    for symbol in unit.arguments:
        if symbol.name in values:
            continue
        extents = [_extent(dimension.extent, values, symbol) for dimension in symbol.dimensions]
        shape = _shape(dap, symbol, extents, given, shapes, unit)
        rank = symbol.type.rank
        variable = ArrayVariable(dap, symbol.type.kind, shape[:rank], shape[rank:], name=symbol.name)
        if symbol.name in given:
            value = given[symbol.name]
            variable.load(value.values if isinstance(value, DapArray) else value, symbol.name)
        values[symbol.name] = variable
    return values


def _scalar(symbol: Symbol, value: Any) -> Any:
    """A scalar argument in its kind; zero where none is given. Raises ValueError."""
    kind = symbol.type.kind
    if value is None:
        return {'LOGICAL': False, 'INTEGER': 0, 'REAL': 0.0, 'CHARACTER': ' '}[kind.name]
    if isinstance(value, (np.ndarray, np.generic)) and np.ndim(value) == 0:
        value = value.item()
    fits = {
        'LOGICAL': isinstance(value, bool),
        'CHARACTER': isinstance(value, str),
        'INTEGER': isinstance(value, int) and not isinstance(value, bool),
        'REAL': isinstance(value, (int, float)) and not isinstance(value, bool),
    }[kind.name]
    if not fits:
        raise ValueError(f'{symbol.name}: expected {symbol.type}, got {type(value).__name__}')
    if kind.name == 'INTEGER' and not kind.range[0] <= value <= kind.range[1]:
        raise ValueError(f'{symbol.name}: {value} does not fit {kind}')
    return value if isinstance(value, (str, bool)) else kind.scalar(value)


def _extent(extent: Any, values: dict[str, Any], symbol: Symbol) -> int | None:
    """A declared extent that is a constant or another argument; None when omitted."""
    if extent is None:
        return None
    if isinstance(extent, Constant):
        return int(extent.value)
    name = getattr(extent, 'name', None)
    if name in values:
        return int(values[name])
    return None


def _shape(
    dap: Machine,
    symbol: Symbol,
    extents: list[int | None],
    given: dict[str, Any],
    shapes: dict[str, tuple[int, ...]],
    unit: CheckedUnit,
) -> tuple[int, ...]:
    if symbol.name in given:
        if isinstance(given[symbol.name], str):
            return (len(given[symbol.name]),)
        shape = shapes[symbol.name]
        if len(shape) != len(extents):
            raise ValueError(f'{symbol.name}: expected {len(extents)} dimension(s), {symbol.type}; got shape {shape}')
        if 0 in shape or any(extent not in (None, found) for extent, found in zip(extents, shape)):
            wanted = ', '.join('any' if extent is None else str(extent) for extent in extents)
            raise ValueError(f'{symbol.name}: expected shape ({wanted}), got {shape}')
        return tuple(shape)
    alike = {
        shape[: symbol.type.rank] for name, shape in shapes.items() if unit.symbols[name].type.rank == symbol.type.rank
    }
    default = alike.pop() if len(alike) == 1 else (dap.es,) * symbol.type.rank
    filled = [
        extent if extent is not None else default[axis] if axis < symbol.type.rank else 1
        for axis, extent in enumerate(extents)
    ]
    if min(filled) < 1:
        raise ValueError(f'{symbol.name}: an extent is {min(filled)}, expected at least 1')
    return tuple(filled)
