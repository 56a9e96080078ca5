"""One execution of a program: its limits and what it shares between subroutines."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..machine import Dap
from .errors import Stopped

if TYPE_CHECKING:
    from .interpreter import CompiledUnit

Frame = list  # [run, symbol 1, symbol 2, ..., loop counters]
Evaluate = Callable[[Frame], Any]

MAX_DEPTH = 2000
MAX_DISPLAYS = 500


@dataclass
class Limits:
    """What a run may use. None: no limit. cancelled : set it from another thread to stop the run."""

    seconds: float | None = None
    cycles: int | None = None
    cancelled: threading.Event | None = None


@dataclass
class Run:
    """One execution: its machine, COMMON blocks, limits and what it displayed."""

    dap: Dap
    units: dict[str, CompiledUnit]
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
