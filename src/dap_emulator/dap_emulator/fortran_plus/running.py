"""One execution of a program: its limits and what it shares between subroutines."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np

from ..machine.machine import Machine
from .errors import Stopped

# One call of a subroutine or function: [the Run, symbol 1, symbol 2, ..., loop counters].
Frame: TypeAlias = list[Any]
Evaluate: TypeAlias = Callable[[Frame], Any]

MAX_DEPTH = 2000
MAX_DISPLAYS = 500
# Python frames that one call of a Fortran unit may take: a closure for every level of its expressions.
_FRAMES_PER_CALL = 8

_deep = threading.Lock()
_deep_runs: list[int] = []


@contextmanager
def deep_recursion() -> Iterator[None]:
    """Python's recursion limit raised to what MAX_DEPTH needs, for as long as any run goes on."""
    with _deep:
        _deep_runs.append(sys.getrecursionlimit())
        sys.setrecursionlimit(max(_FRAMES_PER_CALL * MAX_DEPTH + 1000, _deep_runs[0]))
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
    """What a run may use. None: no limit. cancelled : set it from another thread to stop the run."""

    seconds: float | None = None
    cycles: int | None = None
    cancelled: threading.Event | None = None


class CallableUnit(Protocol):
    """A subroutine or function that can be called while a program runs."""

    def call(self, run: Run, arguments: list[Any]) -> Frame:
        """Run it with scalars and ArrayVariables in the order of its arguments; its frame afterwards."""


@dataclass
class Run:
    """One execution: its machine, COMMON blocks, limits and what it displayed."""

    dap: Machine
    units: Mapping[str, CallableUnit]
    limits: Limits
    commons: dict[tuple[str, int], Any] = field(default_factory=dict)
    displays: list[tuple[str, np.ndarray, str]] = field(default_factory=list)
    depth: int = 0
    ticks: int = 0
    started: float = 0.0
    first_cycle: int = 0

    def check(self) -> None:
        """Raises Stopped when a limit is reached."""
        limits = self.limits
        if limits.cancelled is not None and limits.cancelled.is_set():
            raise Stopped('cancelled')
        if limits.seconds is not None and time.monotonic() - self.started > limits.seconds:
            raise Stopped(f'run time limit of {limits.seconds:g} s reached')
        if limits.cycles is not None and self.dap.cycles - self.first_cycle > limits.cycles:
            raise Stopped(f'cycle limit of {limits.cycles} reached')


class StopProgram(Exception):
    """The STOP statement."""
