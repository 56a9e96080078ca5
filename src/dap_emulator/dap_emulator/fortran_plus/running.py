"""One execution of a program: its limits and what it shares between subroutines."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

from msgs_py.numeric.typed import AnyArray, BoolArray

from ..machine.machine import Machine
from .declarations import CheckedUnit
from .errors import Stopped
from .settings import FRAMES_PER_CALL, MAX_DEPTH, MAX_PRINTED, MAX_PRINTED_CHARACTERS, SPARE_FRAMES

# What CALL DISPLAY shows: a name, the values, a title.
Display: TypeAlias = tuple[str, AnyArray, str]
# One call of a subroutine or function: [the Run, symbol 1, symbol 2, ..., loop counters].
Frame: TypeAlias = list[Any]
# An expression's value.
Evaluate: TypeAlias = Callable[[Frame], Any]
# A statement: the position of the next step, or None for the following one.
Execute: TypeAlias = Callable[[Frame], 'int | None']
# Where a value is stored.
Store: TypeAlias = Callable[[Frame, Any], None]

_deep = threading.Lock()
_deep_runs: list[int] = []


@contextmanager
def deep_recursion() -> Iterator[None]:
    """Raise Python's recursion limit to what MAX_DEPTH needs, for as long as any run goes on."""
    with _deep:
        _deep_runs.append(sys.getrecursionlimit())
        sys.setrecursionlimit(max(FRAMES_PER_CALL * MAX_DEPTH + SPARE_FRAMES, _deep_runs[0]))
    try:
        yield
    finally:
        with _deep:
            before = _deep_runs[0]
            _deep_runs.pop()
            if not _deep_runs:
                sys.setrecursionlimit(before)


@dataclass
class Limits:
    """What a run may use; None is no limit.

    They are looked at between statements and between operations on arrays, so a run ends after the operation in which
    it reaches one: on the largest arrays that a store holds a tenth of a second later. The service ends a run inside an
    operation, too (service/processes.py).

    Parameters
    ----------
    seconds : float, optional
        Time on this computer.
    cycles : int, optional
        Cycles of the emulated machine.
    cancelled : threading.Event, optional
        Stops the run when another thread sets it.
    """

    seconds: float | None = None
    cycles: int | None = None
    cancelled: threading.Event | None = None


def late_text(seconds: float) -> str:
    """Why a run was stopped that has reached its limit of time."""
    return f'run time limit of {seconds:.3g} s reached'


def cancelled_text() -> str:
    """Why a run was stopped from outside."""
    return 'cancelled'


class Observer(Protocol):
    """Told of every statement while a program runs, and of the PEs that an assignment leaves alone."""

    def entered(self, unit: CheckedUnit, frame: Frame) -> None:
        """A unit was called; its variables are made."""

    def began(self, line: int, whole: bool) -> None:
        """A statement of the unit entered last begins; not ``whole`` is what follows the condition of its IF."""

    def assigned(self, name: str, active: BoolArray) -> None:
        """The statement stores into a variable where this is true, of the shape of its parallel extents."""

    def finished(self) -> None:
        """The statement that began last, of those that have not finished, has; or it has failed."""

    def left(self) -> None:
        """The unit entered last returns."""


class CallableUnit(Protocol):
    """A subroutine or function that can be called while a program runs."""

    def call(self, run: Run, arguments: list[Any]) -> Frame:
        """Run it with scalars and ArrayVariables in the order of its arguments; its frame afterwards."""


@dataclass
class Run:
    """One execution of a program.

    Parameters
    ----------
    dap : Machine
    units : mapping of str to CallableUnit
        Subroutines and functions by name.
    limits : Limits
    commons : dict
        Values of COMMON variables, by block and position.
    observer : Observer, optional
    displays : list of (name, values, title)
        What CALL DISPLAY has shown.
    display_bytes : int
        Their size.
    printed : list of str
        Lines of PRINT.
    depth, ticks : int
        Calls that are open, and steps done.
    started : float
        Time of the start, seconds of a steady clock.
    first_cycle : int
        The machine's counter at the start.
    """

    dap: Machine
    units: Mapping[str, CallableUnit]
    limits: Limits
    observer: Observer | None = None
    commons: dict[tuple[str, int], Any] = field(default_factory=dict)
    displays: list[Display] = field(default_factory=list)
    display_bytes: int = 0
    printed: list[str] = field(default_factory=list)
    printed_characters: int = 0
    depth: int = 0
    ticks: int = 0
    started: float = 0.0
    first_cycle: int = 0

    def print(self, text: str) -> None:
        """Keep what PRINT shows, while there is room."""
        if len(self.printed) > MAX_PRINTED or self.printed_characters > MAX_PRINTED_CHARACTERS:
            return
        self.printed += text[:MAX_PRINTED_CHARACTERS].split('\n')
        self.printed_characters += len(text)
        if len(self.printed) > MAX_PRINTED or self.printed_characters > MAX_PRINTED_CHARACTERS:
            self.printed[MAX_PRINTED:] = ['(more was printed, and is left out)']

    def check(self) -> None:
        """Raise Stopped when a limit is reached."""
        limits = self.limits
        if limits.cancelled is not None and limits.cancelled.is_set():
            raise Stopped(cancelled_text())
        if limits.seconds is not None and time.monotonic() - self.started > limits.seconds:
            raise Stopped(late_text(limits.seconds))
        if limits.cycles is not None and self.dap.cycles - self.first_cycle > limits.cycles:
            raise Stopped(f'cycle limit of {limits.cycles} reached')


class StopProgram(Exception):
    """The STOP statement."""
