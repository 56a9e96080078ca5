"""Programs of clients in processes of their own: whatever a statement does, it ends in time, and only itself.

A program looks at its limits between operations. When it is inside one for longer, or takes this computer's memory, or
brings Python down, its process is ended and another is started for the next program.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from typing import Any

from ..fortran_plus import Stopped
from ..fortran_plus.running import cancelled_text, late_text
from .program_worker import CANCEL, READY, CompileJob, Failure, Interface, RunAnswer, RunJob
from .settings import CANCEL_GRACE_S, CANCEL_PERIOD_S, LATE_S, LATE_SHARE, PROCESS_START_S

# The path is handed on, so that the process finds this package wherever the service has found it.
_BOOTSTRAP = (
    'import sys; descriptor, sys.path[:] = int(sys.argv[1]), sys.argv[2:]; '
    'from dap_emulator.service.program_worker import main; main(descriptor)'
)


class ProgramFailed(ValueError):
    """A program cannot be compiled, or failed."""


class _Process:
    """One process; it does one job at a time."""

    def __init__(self) -> None:
        self._connection, theirs = Pipe()
        # One thread a process: numpy's libraries would reserve memory for each of theirs.
        environment = os.environ | {'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
        try:
            self._popen = subprocess.Popen(
                [sys.executable, '-c', _BOOTSTRAP, str(theirs.fileno()), *filter(None, sys.path)],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=environment,
                # Ctrl-C in a terminal ends the service, and with it this process; not both at once.
                start_new_session=True,
            )
        finally:
            theirs.close()
        self._ready = False

    def ask(self, job: CompileJob | RunJob, seconds: float, cancelled: threading.Event | None) -> Any:
        """Do a job.

        Raises
        ------
        Stopped
            When it was cancelled or took too long; the process may have been ended then.
        ProgramFailed
            When the process has ended by itself.
        """
        try:
            if not self._ready:
                self._await_ready()
            self._connection.send(job)
            self._await_answer(seconds, cancelled)
            return self._connection.recv()
        except (EOFError, OSError):
            self.end()
            raise ProgramFailed(
                f'the process of the program has ended (exit code {self._popen.returncode}); it may have used up memory'
            ) from None

    def _await_ready(self) -> None:
        if not self._connection.poll(PROCESS_START_S):
            self.end()
            raise ProgramFailed(f'the process for programs did not start within {PROCESS_START_S:g} s')
        self._ready = self._connection.recv() == READY

    def _await_answer(self, seconds: float, cancelled: threading.Event | None) -> None:
        """Wait until there is an answer. Raises Stopped after ending the process when there is none in time."""
        late = time.monotonic() + seconds + max(LATE_S, LATE_SHARE * seconds)
        reason = late_text(seconds)
        told = cancelled is None
        while not self._connection.poll(min(CANCEL_PERIOD_S, max(0.0, late - time.monotonic()))):
            if not told and cancelled is not None and cancelled.is_set():
                told = True
                self._connection.send(CANCEL)
                late, reason = time.monotonic() + CANCEL_GRACE_S, cancelled_text()
            elif time.monotonic() >= late:
                self.end()
                raise Stopped(reason)

    @property
    def number(self) -> int:
        return self._popen.pid

    @property
    def alive(self) -> bool:
        return self._popen.poll() is None

    def end(self) -> None:
        """End the process at once."""
        with contextlib.suppress(OSError):
            self._popen.kill()
        self._popen.wait()
        self._connection.close()


class Processes:
    r"""Processes for programs: one for each that runs at a time, kept for the next.

    Examples
    --------
    >>> sorted(PROCESSES.interface('ENTRY SUBROUTINE F(A)\nREAL A(,)\nA = A + 1.0\nEND', seconds=10.0).entries)
    ['F']
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[_Process] = []
        self._busy: list[_Process] = []

    @property
    def busy(self) -> list[int]:
        """Numbers of the processes that have a job in hand."""
        with self._lock:
            return [process.number for process in self._busy]

    def prepare(self) -> None:
        """Start a process when none is idle, without waiting for it."""
        with self._lock:
            if not self._idle:
                self._idle.append(_Process())

    def interface(self, source: str, seconds: float, cancelled: threading.Event | None = None) -> Interface:
        """Compile a program.

        Parameters
        ----------
        source : str
        seconds : float
            Longest time.
        cancelled : threading.Event, optional
            Stops it when another thread sets it.

        Raises
        ------
        ProgramFailed
            With the place of the first mistake, or when it takes too long or was cancelled.
        """
        try:
            found = self._answer(CompileJob(source), seconds, cancelled)
        except Stopped as error:
            raise ProgramFailed(f'compiling {len(source)} characters: {error}') from None
        assert isinstance(found, Interface)
        return found

    def run(self, job: RunJob, cancelled: threading.Event | None = None) -> RunAnswer:
        """Run a program.

        Parameters
        ----------
        job : RunJob
        cancelled : threading.Event, optional
            Stops the run when another thread sets it.

        Raises
        ------
        ProgramFailed
            When it cannot be compiled, or fails.
        Stopped
            At its limit, or when it was cancelled.
        """
        found = self._answer(job, job.seconds, cancelled)
        assert isinstance(found, RunAnswer)
        return found

    def _answer(self, job: CompileJob | RunJob, seconds: float, cancelled: threading.Event | None) -> Any:
        process = self._take()
        try:
            found = process.ask(job, seconds, cancelled)
        finally:
            self._give_back(process)
        if isinstance(found, Failure):
            raise Stopped(found.message) if found.stopped else ProgramFailed(found.message)
        return found

    def _take(self) -> _Process:
        """The process that was idle last, which has compiled what is compiled most; or a new one."""
        with self._lock:
            alive = [process for process in self._idle if process.alive]
            process = alive.pop() if alive else _Process()
            self._idle = alive
            self._busy.append(process)
            return process

    def _give_back(self, process: _Process) -> None:
        """Keep a process, or start another in place of one that was ended."""
        with self._lock:
            self._busy.remove(process)
            # Where none can be started, the next program says so.
            with contextlib.suppress(OSError):
                self._idle.append(process if process.alive else _Process())

    def forget(self) -> None:
        """Leave the processes to the process that this one was forked from."""
        self._lock = threading.Lock()
        self._idle, self._busy = [], []


PROCESSES = Processes()
os.register_at_fork(after_in_child=PROCESSES.forget)
