"""What every statement of a run did: values of arrays and scalars after it, the active PEs, cycles and store."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray

from ..fortran_plus.declarations import CheckedUnit, Symbol
from ..fortran_plus.running import Frame
from ..fortran_plus.storage import ArrayVariable
from ..machine import planes
from ..machine.fields import real_values
from ..machine.machine import Machine
from .settings import LARGEST_SHOWN, MAX_BYTES, MAX_ELEMENTS, MAX_PLACES, MAX_PROFILE_DEPTH, MAX_STEPS


@dataclass
class Watched:
    """An array variable of one call.

    Parameters
    ----------
    name, kind : str
        Kind for example 'REAL*4'.
    dtype : str
        Of its recorded values: 'bit', or numpy's name; 'machine32', for example, of patterns of the machine's REALs.
    parallel, serial : tuple of int
    low, high : float
        Smallest and largest finite value recorded.
    changes : list of (step, place, blob)
        Which plane of its serial dimensions changed in which step, and the number of the blob with its values.
    """

    name: str
    kind: str
    dtype: str
    parallel: tuple[int, ...]
    serial: tuple[int, ...]
    low: float = np.inf
    high: float = -np.inf
    changes: list[tuple[int, int, int]] = field(default_factory=list)


@dataclass
class Call:
    """One call of a unit: its name, its arrays by name (numbers of Watched), and changes of its scalars.

    ``scalars`` has (step, name, value as text).
    """

    unit: str
    arrays: dict[str, int] = field(default_factory=dict)
    scalars: list[tuple[int, str, str]] = field(default_factory=list)


@dataclass
class StepDone:
    """One recorded statement.

    Parameters
    ----------
    call, line, depth : int
        Number of the call, line of the source, calls that are open.
    cycles, spent : int
        Counter of the machine afterwards, and what the statement took with all that it called.
    planes : int
        Bit-planes in use afterwards.
    mask : (str, int), optional
        Variable and blob of the active PEs, of an assignment under a mask.
    entry : bool
        Whether this is the entry of a unit and no statement.
    """

    call: int
    line: int
    depth: int
    cycles: int
    spent: int
    planes: int
    mask: tuple[str, int] | None = None
    entry: bool = False


@dataclass
class _Live:
    """A call that is open: its unit, frame, copies of its arrays, texts of its scalars, and the statement's start."""

    call: int
    unit: CheckedUnit
    frame: Frame
    arrays: list[tuple[int, Symbol, dict[int, bytes]]]
    texts: dict[str, str] = field(default_factory=dict)
    line: int = 0
    start: int = 0
    inside: int = 0


class Recorder:
    r"""Keeps what a run does, statement by statement; give it to ``Program.run`` as its observer.

    Parameters
    ----------
    dap : Machine
        On which the program will run.

    Attributes
    ----------
    calls : list of Call
    steps : list of StepDone
    arrays : list of Watched
    blobs : list of bytes
        Recorded values, compressed; arrays and masks refer to them by number.
    statements : int
        All that were run, and entries of units; more than are recorded when the run was long.
    times : dict of int to int
        How often a statement of each line was run.
    profile : dict
        Cycles by path: a tuple of (unit, line) from the entry inwards, without what the statement called.

    Examples
    --------
    >>> from dap_emulator import Dap
    >>> from dap_emulator.fortran_plus import compile
    >>> dap = Dap.model('510')
    >>> recorder = Recorder(dap)
    >>> _ = compile('REAL A(,)\nA = 1.0\nA(A .GT. 0.0) = 2.0').run(dap, observer=recorder)
    >>> [(step.line, step.mask is not None) for step in recorder.steps]
    [(1, False), (2, False), (3, True)]
    """

    def __init__(self, dap: Machine) -> None:
        self.dap = dap
        self.calls: list[Call] = []
        self.steps: list[StepDone] = []
        self.arrays: list[Watched] = []
        self.blobs: list[bytes] = []
        self.statements = 0
        self.times: dict[int, int] = {}
        self.profile: dict[tuple[tuple[str, int], ...], int] = {}
        self._first_cycle = dap.cycles
        self._live: list[_Live] = []
        self._numbers: dict[int, int] = {}  # of live arrays, by identity
        self._known: dict[bytes, int] = {}
        self._bytes = 0
        self._mask: tuple[str, int] | None = None

    @property
    def complete(self) -> bool:
        """Whether every statement that was run is recorded."""
        return len(self.steps) == self.statements

    # What a run tells.

    def entered(self, unit: CheckedUnit, frame: Frame) -> None:
        """A unit was called; its variables are made."""
        call = Call(unit.unit.name)
        live = _Live(len(self.calls), unit, frame, [])
        for symbol in unit.symbols.values():
            variable = frame[symbol.slot] if symbol.dimensions and symbol.slot else None
            # Storages that EQUIVALENCE makes are seen through the names that share them.
            if not isinstance(variable, ArrayVariable) or variable.data.size > MAX_ELEMENTS or symbol.name[0] == '(':
                continue
            number = self._numbers.get(id(variable))
            if number is None:
                number = self._numbers[id(variable)] = len(self.arrays)
                self.arrays.append(_watched(symbol.name, variable))
            call.arrays[symbol.name] = number
            live.arrays.append((number, symbol, self._copies_of(number)))
        self.calls.append(call)
        self._live.append(live)
        self.statements += 1
        self._record(live, unit.unit.header.source.line, 0, entry=True)

    def began(self, line: int, whole: bool) -> None:
        """A statement begins, or its next part."""
        live = self._live[-1]
        live.line, live.start, live.inside = line, self.dap.cycles, 0
        self._mask = None
        self.times[line] = self.times.get(line, 0) + whole

    def assigned(self, name: str, active: BoolArray) -> None:
        """The statement stores into a variable where this is true."""
        if self._has_room:
            self._mask = name, self._blob(np.packbits(active, bitorder='little').tobytes())

    def finished(self) -> None:
        """The statement that began last has finished."""
        live = self._live[-1]
        spent = self.dap.cycles - live.start
        path = tuple((each.unit.unit.name, each.line) for each in self._live[:MAX_PROFILE_DEPTH])
        self.profile[path] = self.profile.get(path, 0) + spent - live.inside
        if len(self._live) > 1:
            self._live[-2].inside += spent
        self.statements += 1
        self._record(live, live.line, spent)
        self._mask = None

    def left(self) -> None:
        """A unit returns: what was its own is gone, and its numbers may belong to others."""
        self._live.pop()
        kept = {number for live in self._live for number, _, _ in live.arrays}
        self._numbers = {key: number for key, number in self._numbers.items() if number in kept}

    # What is kept of it.

    @property
    def _has_room(self) -> bool:
        return len(self.steps) < MAX_STEPS and self._bytes < MAX_BYTES

    def _record(self, live: _Live, line: int, spent: int, entry: bool = False) -> None:
        if not self._has_room:
            return
        step = len(self.steps)
        cycles = self.dap.cycles - self._first_cycle
        used = self.dap.store.used
        self.steps.append(StepDone(live.call, line, len(self._live), cycles, spent, used, self._mask, entry))
        for number, symbol, copies in live.arrays:
            variable = live.frame[symbol.slot]
            if isinstance(variable, ArrayVariable):
                self._record_array(step, number, variable, copies)
        self._record_scalars(step, live)

    def _record_array(self, step: int, number: int, variable: ArrayVariable, copies: dict[int, bytes]) -> None:
        """The planes of a variable that have changed."""
        watched = self.arrays[number]
        for place, values in enumerate(_places(variable)[:MAX_PLACES]):
            raw = values.tobytes()
            if copies.get(place) == raw:
                continue
            copies[place] = raw
            decoded = _decoded(variable, values)
            _widen(watched, real_values(values, variable.kind) if variable.patterns else decoded)
            watched.changes.append((step, place, self._blob(_encoded(decoded))))

    def _record_scalars(self, step: int, live: _Live) -> None:
        """The scalars that have changed, and the texts of CHARACTER arrays."""
        for symbol in live.unit.symbols.values():
            if symbol.slot == 0 or symbol.procedure or (symbol.dimensions and symbol.type.kind.name != 'CHARACTER'):
                continue
            value = _scalar(symbol, live)
            text = _text(value)
            if value is not None and live.texts.get(symbol.name) != text:
                live.texts[symbol.name] = text
                self.calls[live.call].scalars.append((step, symbol.name, text))

    def _copies_of(self, number: int) -> dict[int, bytes]:
        """What was recorded last of an array that an outer call has, or nothing."""
        return next((copies for live in self._live for other, _, copies in live.arrays if other == number), {})

    def _blob(self, raw: bytes) -> int:
        """Number of these bytes among the blobs; what was there before is not kept twice."""
        number = self._known.get(raw)
        if number is None:
            number = self._known[raw] = len(self.blobs)
            self.blobs.append(zlib.compress(raw))
            self._bytes += len(raw)
        return number


def _watched(name: str, variable: ArrayVariable) -> Watched:
    kind = variable.kind
    dtype = 'bit' if kind.name == 'LOGICAL' else 'text' if kind.name == 'CHARACTER' else kind.dtype.name
    if variable.patterns:
        dtype = f'machine{kind.bits}'
    if variable.parallel:
        return Watched(name, str(kind), dtype, variable.parallel, variable.serial)
    # Scalars in an array are shown as a plane of the first two dimensions.
    return Watched(name, str(kind), dtype, variable.serial[:2], variable.serial[2:])


def _places(variable: ArrayVariable) -> AnyArray:
    """(planes, ...) array: stored values, one row for every place of the serial dimensions."""
    if variable.kind.name == 'CHARACTER':
        return np.empty((0, 0))
    data = variable.data
    if variable.parallel:
        return data.reshape((int(np.prod(variable.serial, dtype=np.int64)), -1))
    extents = variable.serial[:2]
    return (
        data.reshape(extents + (-1,))
        .transpose((len(extents), *range(len(extents))))
        .reshape((-1, int(np.prod(extents))))
    )


def _decoded(variable: ArrayVariable, values: AnyArray) -> AnyArray:
    """Values of one plane, or patterns of the machine's REALs, elements in row order."""
    if not variable.packed:
        return values
    return planes.unpack(values, int(np.prod(variable.parallel)))


def _encoded(values: AnyArray) -> bytes:
    """Bytes as the page reads them: little-endian numbers, or eight truths a byte."""
    if values.dtype == bool:
        return np.packbits(values, bitorder='little').tobytes()
    return values.astype(values.dtype.newbyteorder('<'), copy=False).tobytes()


def _widen(watched: Watched, values: AnyArray) -> None:
    """Let the range of an array hold these values."""
    finite = values[np.abs(values) < LARGEST_SHOWN] if values.dtype.kind == 'f' else values
    if finite.size:
        watched.low = min(watched.low, float(finite.min()))
        watched.high = max(watched.high, float(finite.max()))


def _scalar(symbol: Symbol, live: _Live) -> Any:
    """Value of a scalar, or a CHARACTER array; None when there is none yet."""
    if symbol.dimensions:
        return live.frame[symbol.slot]
    if symbol.common is not None:
        return live.frame[0].commons.get(symbol.common)
    if symbol.alias is not None:
        storage = live.frame[live.unit.symbols[symbol.alias[0]].slot]
        return storage.data[symbol.alias[1] : symbol.alias[1] + 1].tolist()[0]
    return live.frame[symbol.slot]


def _text(value: Any) -> str:
    """A scalar, or the text of a CHARACTER array, as the page shows it."""
    if isinstance(value, ArrayVariable):
        return str(value.to_numpy())
    if isinstance(value, bool):
        return '.TRUE.' if value else '.FALSE.'
    return f'{value:.9g}' if isinstance(value, float) else str(value)
