"""What must be compiled before the first result, as steps with a name, so that who waits is told how far it is."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class CompileStep:
    """A small computation that compiles, or loads from the cache, what a larger one of its kind needs.

    Parameters
    ----------
    name : str
        What is compiled, for a person who waits.
    run : callable
        Does it; later steps may rely on earlier ones.
    """

    name: str
    run: Callable[[], object]


def run_all(steps: Sequence[CompileStep]) -> None:
    """Run steps one after another, in this thread."""
    for step in steps:
        step.run()


class Preparation:
    """Steps that run in a thread of their own.

    Parameters
    ----------
    steps : sequence of CompileStep
        What to do, in this order.
    on_end : callable
        Called in that thread when all have run, unless they were cancelled.

    Notes
    -----
    A step that fails does not keep the others from running: what it should have compiled is compiled when it is used,
    where a failure is reported as any other.
    """

    def __init__(self, steps: Sequence[CompileStep], on_end: Callable[[], None] = lambda: None) -> None:
        self._steps, self._on_end = tuple(steps), on_end
        self._current = 0
        self._ended, self._cancelled = threading.Event(), threading.Event()
        self.errors: list[str] = []
        # A daemon: a process that is told to end does not wait for a compiler.
        self._thread = threading.Thread(target=self._work, name='compile', daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether all steps have run."""
        return self._ended.is_set()

    @property
    def running(self) -> bool:
        """Whether a step runs now, also one that was cancelled and cannot be interrupted."""
        return self._thread.is_alive()

    @property
    def progress(self) -> str:
        """The number and name of the running step: ``'2 of 5: curves'``; empty when all is done."""
        if self.done or not self._steps:
            return ''
        number = min(self._current, len(self._steps) - 1)
        return f'{number + 1} of {len(self._steps)}: {self._steps[number].name}'

    def cancel(self) -> None:
        """Begin no other step, and do not call ``on_end``."""
        self._cancelled.set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; returns whether it has come."""
        return self._ended.wait(timeout_s)

    def _work(self) -> None:
        for number, step in enumerate(self._steps):
            if self._cancelled.is_set():
                return
            self._current = number
            try:
                step.run()
            except Exception as error:
                self.errors.append(f'{step.name}: {type(error).__name__}: {error}')
        self._ended.set()
        if not self._cancelled.is_set():
            self._on_end()
