"""The machine without its arrays: models, store, cost model, counters and trace.

The machine has ES x ES one-bit processing elements (PEs) with 32 Kbit to 1 Mbit of store each, a control unit (MCU) for
scalar work, and row and column highways (thesis 3.2). Cycles are computed from costs.py, not simulated; a machine that
computes on bit-planes counts them beside.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from .costs import CostTable
from .kinds import Kind, parse_kind
from .mapping import MAPPINGS, Layout, layout
from .settings import TRACE_LENGTH

ARITHMETICS = ('words', 'bits')
ROUNDINGS = ('nearest', 'chop')


class OutOfStore(MemoryError):
    """An array needs more bit-planes than are free."""


@dataclass(frozen=True)
class Model:
    """One model of the machine.

    Parameters
    ----------
    name : str
    es : int
        PEs along an edge of the array of PEs.
    clock_s : float
        Length of a cycle, seconds.
    coprocessor : bool
        Whether every PE has an 8-bit co-processor (the models whose names end in C).
    memory_bits_per_pe : int
        Store of one PE, bits: the number of bit-planes.

    References
    ----------
    Thesis 3.2.1 and 3.2.4.
    """

    name: str
    es: int
    clock_s: float = 100e-9
    coprocessor: bool = False
    memory_bits_per_pe: int = 131_072


# Thesis 3.2.1 and 3.2.4 (128 Kbit a PE is the thesis' own machine). ICL: the 64 x 64 ancestor, 200 ns, 4096 bits a PE.
MODELS: dict[str, Model] = {
    '510': Model('510', 32),
    '610': Model('610', 64),
    '510C': Model('510C', 32, coprocessor=True),
    '610C': Model('610C', 64, coprocessor=True),
    'ICL': Model('ICL', 64, clock_s=200e-9, memory_bits_per_pe=4096),
}


class Store:
    """Bit-planes of the array store, counted; safe to use from several threads.

    Parameters
    ----------
    planes : int
        Bit-planes that exist.

    Attributes
    ----------
    used, peak : int
        Bit-planes in use, and the most that were in use at one time.

    Examples
    --------
    >>> store = Store(100)
    >>> store.take(60)
    >>> store.free
    40
    >>> store.take(60, 'a matrix')
    Traceback (most recent call last):
    dap_emulator.machine.machine.OutOfStore: out of store: a matrix asks for 60 bit-planes, 40 of 100 are free
    """

    def __init__(self, planes: int) -> None:
        self.planes, self.used, self.peak = planes, 0, 0
        self._lock = threading.Lock()

    @property
    def free(self) -> int:
        """Bit-planes that are not in use."""
        return self.planes - self.used

    def take(self, planes: int, what: str = 'an array') -> None:
        """Take bit-planes into use.

        Parameters
        ----------
        planes : int
        what : str
            What they are for, named in the error.

        Raises
        ------
        OutOfStore
            When fewer are free.
        """
        with self._lock:
            if planes > self.planes - self.used:
                raise OutOfStore(
                    f'out of store: {what} asks for {planes} bit-planes, '
                    f'{self.planes - self.used} of {self.planes} are free'
                )
            self.used += planes
            self.peak = max(self.peak, self.used)

    def give_back(self, planes: int) -> None:
        """Return bit-planes that were taken."""
        with self._lock:
            self.used -= planes


class TraceEntry(NamedTuple):
    """One charged operation; ``line`` is that of the source program, 0 outside one."""

    operation: str
    kind: str
    shape: tuple[int, ...]
    blocks: int
    cycles: int
    line: int

    def __str__(self) -> str:
        return (
            f'line {self.line}: {self.operation} {self.kind} {self.shape}, {self.blocks} block(s), {self.cycles} cycles'
        )


def _check_arithmetic(model: Model, arithmetic: str, rounding: str) -> None:
    """Raise ValueError, naming the argument, for arithmetic that there is not."""
    if arithmetic not in ARITHMETICS:
        raise ValueError(f'arithmetic: expected one of {", ".join(ARITHMETICS)}, got {arithmetic!r}')
    if rounding not in ROUNDINGS:
        raise ValueError(f'rounding: expected one of {", ".join(ROUNDINGS)}, got {rounding!r}')
    if arithmetic == 'words' and rounding != 'nearest':
        raise ValueError(f"rounding: {rounding!r} is of arithmetic='bits'; words of this computer round to nearest")
    if arithmetic == 'bits' and model.coprocessor:
        raise ValueError(
            f"arithmetic: 'bits' is the work of one-bit PEs; model {model.name} computes on 8-bit co-processors"
        )


_Key = TypeVar('_Key')


def _accumulate(table: dict[_Key, tuple[int, int]], key: _Key, count: int, spent: int) -> None:
    """Add to the (count, cycles) of an entry."""
    before = table.get(key, (0, 0))
    table[key] = (before[0] + count, before[1] + spent)


class Stats:
    """What was computed, and what it cost.

    Attributes
    ----------
    cycles : int
    seconds : float
        Predicted by the cost model, not simulated.
    counted : dict of str to int
        On a machine that computes on bit-planes: cycles of the same operations, counted instruction by instruction.
    peak_planes, planes : int
        Most bit-planes in use at one time, and bit-planes that exist.
    operations : dict of str to (int, int)
        Operation and kind, for example 'add REAL*4', to how often it was done and its cycles; the most expensive first.
    lines : dict of int to (int, int)
        The same for the lines of the source program.
    """

    def __init__(
        self,
        counts: Mapping[tuple[int, str], list[int]],
        cycles: int,
        seconds: float,
        store: Store,
        counted: Mapping[str, int] | None = None,
    ) -> None:
        self.cycles, self.seconds = cycles, seconds
        self.counted = dict(counted or {})
        self.peak_planes, self.planes = store.peak, store.planes
        self.operations: dict[str, tuple[int, int]] = {}
        self.lines: dict[int, tuple[int, int]] = {}
        for (line, operation), (count, spent) in counts.items():
            _accumulate(self.operations, operation, count, spent)
            _accumulate(self.lines, line, count, spent)
        self.operations = dict(sorted(self.operations.items(), key=lambda item: -item[1][1]))
        # Line 0 is what belongs to no source line; free work there (a host transfer without a price) is not shown.
        self.lines = {line: entry for line, entry in sorted(self.lines.items()) if line or entry[1]}

    def __str__(self) -> str:
        rows = [
            f'{self.cycles} cycles, {self.seconds:.6g} s (computed, not simulated); '
            f'store: at most {self.peak_planes} of {self.planes} planes'
        ]
        rows += [
            f'  {name:28} {count:>9} times {spent:>12} cycles {100 * spent / max(1, self.cycles):5.1f} %'
            + (f' {self.counted.get(name, 0):>12} counted' if self.counted else '')
            for name, (count, spent) in self.operations.items()
        ]
        if self.counted:
            rows[0] += f'; {sum(self.counted.values())} cycles counted on the planes'
        return '\n'.join(rows)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        rows = ''.join(
            f'<tr><td>{name}</td><td>{count}</td><td>{spent}</td></tr>'
            for name, (count, spent) in self.operations.items()
        )
        return (
            f'<p>{self.cycles} cycles, {self.seconds:.6g} s (computed, not simulated)</p>'
            f'<table><tr><th>operation</th><th>times</th><th>cycles</th></tr>{rows}</table>'
        )


class Machine:
    """An array processor without its arrays: PEs, store, cost model, counters and trace. ``Dap`` adds the arrays.

    Parameters
    ----------
    model : Model
    memory_bits_per_pe : int, optional
        Store of one PE, bits; 32 Kbit to 1 Mbit on the AMT machines. The model's when not given.
    mapping : {'sheet', 'crinkled', 'combined'}
        How matrices lie on the PEs, unless an array has another mapping.
    level : {'fortran', 'apal'}
        Whose overhead for starting an operation is charged: compiled Fortran-Plus, or assembly.
    costs : mapping of str to float, optional
        Constants of the cost model that replace those of the table.
    clock_s : float, optional
        Length of a cycle, seconds. The model's when not given.
    tracing : bool
        Keep the last operations in ``trace``.
    arithmetic : {'words', 'bits'}
        Compute on words of this computer, or on bit-planes as the PEs do: slower; INTEGERs have the same values, REALs
        those of the machine's own form (``bit_planes.reals``), and every operation's instructions are counted.
    rounding : {'nearest', 'chop'}
        Of REALs on bit-planes: to the nearest number, or cut off toward zero.

    Attributes
    ----------
    cycles : int
        Everything charged so far.
    faults : int
        Divisions of integers by zero so far; on bit-planes also results that no REAL holds.
    in_bits : bool
        Whether arithmetic is that of bit-planes.
    counted : dict of str to int
        On bit-planes: cycles counted so far, by operation and kind.
    line : int
        Line of the source program that work is charged to, 0 outside one.
    trace : deque of TraceEntry
    store : Store
    costs : CostTable
    watch : callable, optional
        Called after every charge; what it raises ends the work.

    Raises
    ------
    ValueError
        Naming the argument that is not usable.
    """

    def __init__(
        self,
        model: Model,
        memory_bits_per_pe: int | None = None,
        *,
        mapping: str = 'sheet',
        level: str = 'fortran',
        costs: Mapping[str, float] | None = None,
        clock_s: float | None = None,
        tracing: bool = True,
        arithmetic: str = 'words',
        rounding: str = 'nearest',
    ) -> None:
        if mapping not in MAPPINGS:
            raise ValueError(f'mapping: expected one of {", ".join(MAPPINGS)}, got {mapping!r}')
        _check_arithmetic(model, arithmetic, rounding)
        memory = model.memory_bits_per_pe if memory_bits_per_pe is None else int(memory_bits_per_pe)
        if memory < 1:
            raise ValueError(f'memory_bits_per_pe: expected at least 1, got {memory}')
        self.spec, self.mapping = model, mapping
        self.clock_s = model.clock_s if clock_s is None else float(clock_s)
        self.es = model.es
        self.costs = CostTable(model.coprocessor, level, costs)
        self.store = Store(memory)
        self.in_bits, self.nearest = arithmetic == 'bits', rounding == 'nearest'
        self.counted: dict[str, int] = {}
        self._charged = ''
        self.line = 0
        self.cycles = 0
        self.faults = 0
        self.tracing = tracing
        self.trace: deque[TraceEntry] = deque(maxlen=TRACE_LENGTH)
        self.watch: Callable[[], None] | None = None
        self._counts: dict[tuple[int, str], list[int]] = {}

    # Figures of the machine itself.

    @property
    def pes(self) -> int:
        """Number of processing elements."""
        return self.es**2

    @property
    def boolean_rate(self) -> float:
        """Peak one-bit operations a second."""
        return self.pes / (self.clock_s * self.costs['plane_logic'])

    @property
    def store_rate(self) -> float:
        """Store to PE, bytes a second."""
        return self.pes / 8 / (self.clock_s * self.costs['plane_access'])

    @property
    def highway_rate(self) -> float:
        """Row or column highway, bytes a second: ES bits a cycle."""
        return self.es / 8 / self.clock_s

    @property
    def memory_bytes(self) -> int:
        """Array store, bytes."""
        return self.store.planes * self.pes // 8

    def rate(self, operation: str, kind: Kind | str) -> float:
        """Operations a second with every PE busy.

        Parameters
        ----------
        operation : str
            An operation of the cost model: 'add', 'multiply', 'sqrt', ...
        kind : Kind or str
            Type of its operands, for example 'REAL*4'.

        Returns
        -------
        float
        """
        cycles = self.costs.cycles(operation, parse_kind(kind), self.layout((self.es, self.es)))
        return self.pes / (cycles * self.clock_s)

    # Counters.

    @property
    def seconds(self) -> float:
        """Predicted time of everything charged so far: computed, not simulated."""
        return self.cycles * self.clock_s

    def charge(
        self,
        operation: str,
        kind: Kind,
        shape: tuple[int, ...],
        mapping: str | None = None,
        detail: int = 1,
        axis: int = 0,
        times: int = 1,
    ) -> None:
        """Charge a parallel operation to the counters.

        Parameters
        ----------
        operation : str
            A name of the cost model.
        kind : Kind
            Type of the operands.
        shape : tuple of int
            Extents of the array.
        mapping : str, optional
            How it lies on the PEs; the machine's mapping when not given.
        detail : int
            Distance of a shift, or exponent of a power.
        axis : int
            Axis of a shift or of a sum along one dimension.
        times : int
            How often the operation is done.
        """
        where = layout(shape, self.es, mapping or self.mapping)
        cycles = times * self.costs.cycles(operation, kind, where, detail, axis)
        self._add(f'{operation} {kind}', cycles, times)
        if self.tracing:
            self.trace.append(TraceEntry(operation, str(kind), shape, where.blocks, cycles, self.line))

    def charge_mcu(self, operation: str, cycles: int) -> None:
        """Charge scalar or control work to the counters."""
        self._add(operation, cycles)
        if self.tracing:
            self.trace.append(TraceEntry(operation, 'MCU', (), 0, cycles, self.line))

    def count(self, cycles: int) -> None:
        """Add cycles counted on bit-planes to the operation that was charged last."""
        self.counted[self._charged] = self.counted.get(self._charged, 0) + cycles

    @property
    def counted_cycles(self) -> int:
        """Everything counted on bit-planes so far, without the overhead of starting operations."""
        return sum(self.counted.values())

    def _add(self, operation: str, cycles: int, times: int = 1) -> None:
        self.cycles += cycles
        self._charged = operation
        entry = self._counts.get((self.line, operation))
        if entry is None:
            self._counts[self.line, operation] = [times, cycles]
        else:
            entry[0] += times
            entry[1] += cycles
        if self.watch is not None:
            self.watch()

    def stats(self) -> Stats:
        """Counts, cycles and seconds of everything charged so far."""
        return Stats(self._counts, self.cycles, self.seconds, self.store, self.counted)

    def reset(self) -> None:
        """Set counters to zero, empty the trace, and forget the store's peak; arrays stay."""
        self.cycles = self.faults = 0
        self._counts.clear()
        self.counted.clear()
        self.trace.clear()
        self.store.peak = self.store.used

    @contextmanager
    def measured(self) -> Iterator[Callable[[], Stats]]:
        """Count what happens inside by itself; afterwards it is added to what was counted before.

        Yields
        ------
        callable
            Returns the Stats of what has happened inside so far.
        """
        cycles, counts, counted, peak = self.cycles, self._counts, self.counted, self.store.peak
        self._counts, self.counted, self.store.peak = {}, {}, self.store.used

        def so_far() -> Stats:
            spent = self.cycles - cycles
            return Stats(self._counts, spent, spent * self.clock_s, self.store, self.counted)

        try:
            yield so_far
        finally:
            inside, self._counts = self._counts, counts
            for (line, operation), (count, spent) in inside.items():
                entry = counts.setdefault((line, operation), [0, 0])
                entry[0] += count
                entry[1] += spent
            added, self.counted = self.counted, counted
            for operation, spent in added.items():
                counted[operation] = counted.get(operation, 0) + spent
            self.store.peak = max(self.store.peak, peak)

    @contextmanager
    def at_line(self, line: int) -> Iterator[None]:
        """Charge what happens inside to this line of the source program."""
        before, self.line = self.line, line
        try:
            yield
        finally:
            self.line = before

    def layout(self, shape: tuple[int, ...], mapping: str | None = None) -> Layout:
        """How an array of this shape lies on this machine."""
        return layout(tuple(shape), self.es, mapping or self.mapping)

    def __repr__(self) -> str:
        return (
            f'{type(self).__name__}({self.spec.name}: {self.es} x {self.es} PEs, {self.memory_bytes / 2**20:g} MB, '
            f'{self.store.used} of {self.store.planes} planes used; {self.cycles} cycles = {self.seconds:.6g} s, '
            'computed)'
        )

    def _repr_html_(self) -> str:
        return f'<p><b>{self!r}</b></p>{self.stats()._repr_html_()}'
