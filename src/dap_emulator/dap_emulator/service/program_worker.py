"""What runs in a program's own process: it compiles and runs what the service sends, and answers.

The service starts it (processes.py) and ends it when a program does not stop in time.
"""

from __future__ import annotations

import os
import queue
import resource
import threading
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ..fortran_plus import FortranError, Limits, Stopped
from ..fortran_plus.library import compiled
from ..fortran_plus.program import Result, chosen_entry
from ..fortran_plus.running import Display
from ..machine.dap import Dap
from ..machine.machine import OutOfStore, Stats
from .settings import PROCESS_BYTES, TRACE_KEPT

# First message of a process, and the message that cancels what it runs.
READY = 'ready'
CANCEL = 'cancel'


@dataclass(frozen=True)
class Interface:
    """What a host needs to know of a compiled program.

    Parameters
    ----------
    source : str
        Its text.
    entries : dict of str to dict of str to str
        Entries by name; of each its arguments, in order, and their class: LOGICAL, INTEGER, REAL or CHARACTER.
    """

    source: str
    entries: dict[str, dict[str, str]]

    def entry(self, name: str | None = None) -> str:
        """The entry of this name, or the only one. Raises ValueError."""
        return chosen_entry(name, list(self.entries))


@dataclass(frozen=True)
class CompileJob:
    """A text to be compiled; the answer is an Interface."""

    source: str


@dataclass(frozen=True)
class RunJob:
    """A run; the answer is a RunAnswer.

    Parameters
    ----------
    source : str
    entry : str, optional
    model : str
        Model of the machine.
    arguments : dict of str to value
    seconds : float
        Its limit, which includes compiling.
    most_bytes : int
        Largest result.
    """

    source: str
    entry: str | None
    model: str
    arguments: dict[str, Any]
    seconds: float
    most_bytes: int


@dataclass(frozen=True)
class RunAnswer:
    """A run that has reached its end.

    Parameters
    ----------
    values : dict of str to value
        The entry's arguments.
    stats : Stats
    trace : list of str
        The last operations.
    printed : list of str
        Lines of PRINT.
    """

    values: dict[str, Any]
    stats: Stats
    trace: list[str] = field(default_factory=list)
    printed: list[str] = field(default_factory=list)

    def result(self, source: str) -> Result:
        """As a result of ``Program.run``, but for what CALL DISPLAY has shown."""
        shown: list[Display] = []
        return Result(self.values, self.stats, shown, source, self.printed)


@dataclass(frozen=True)
class Failure:
    """An answer that is none: what failed, and whether it was a limit or a cancellation that ended it."""

    message: str
    stopped: bool = False


def size_of(value: Any) -> int:
    """Size of a stored value, bytes."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    return len(value.encode()) if isinstance(value, str) else 8


def answer(job: CompileJob | RunJob, cancelled: threading.Event) -> Interface | RunAnswer | Failure:
    """Do a job. Raises nothing.

    Parameters
    ----------
    job : CompileJob or RunJob
    cancelled : threading.Event
        Stops a run when another thread sets it.
    """
    try:
        return _interface(job.source) if isinstance(job, CompileJob) else _run(job, cancelled)
    except Stopped as error:
        return Failure(str(error), stopped=True)
    except (FortranError, ValueError, OutOfStore) as error:
        return Failure(str(error))
    except MemoryError:
        return Failure(f'the program needs more than {PROCESS_BYTES >> 20} MB of this computer')
    except Exception as error:  # a fault of ours must not end the process, which others use after this job
        return Failure(f'{type(error).__name__}: {error}')


def _interface(source: str) -> Interface:
    program = compiled(source)
    return Interface(
        source,
        {
            name: {symbol.name: symbol.type.kind.name for symbol in program.units[name].arguments}
            for name in program.entries
        },
    )


def _run(job: RunJob, cancelled: threading.Event) -> RunAnswer:
    """Run a program. Raises what compiling and running it raise."""
    dap = Dap.model(job.model)
    # Should the text have to be compiled again, the service's own look at the time comes first.
    limits = Limits(seconds=job.seconds, cancelled=cancelled)
    result = compiled(job.source).run(dap, job.entry, limits=limits, **job.arguments)
    values = dict(result)
    size = sum(size_of(value) for value in values.values())
    if size > job.most_bytes:
        raise ValueError(f'the result has {size} bytes, at most {job.most_bytes} are kept')
    return RunAnswer(values, result.stats, [str(entry) for entry in list(dap.trace)[-TRACE_KEPT:]], result.printed)


def bound_memory(most: int = PROCESS_BYTES) -> None:
    """Let this process take at most so many bytes more than it has; beyond it Python raises MemoryError."""
    try:
        with open('/proc/self/statm', encoding='ascii') as file:
            pages = int(file.read().split()[0])
    except FileNotFoundError:
        return  # Linux alone says what a process has; elsewhere the machine's store is the only bound
    limit = pages * resource.getpagesize() + most
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def serve(connection: Connection) -> None:
    """Answer jobs until the service hangs up.

    Parameters
    ----------
    connection : Connection
        To the service: jobs and CANCEL come in, READY and answers go out.
    """
    jobs: queue.SimpleQueue[CompileJob | RunJob] = queue.SimpleQueue()
    cancelled = threading.Event()

    def listen() -> None:
        while True:
            try:
                message = connection.recv()
            except (EOFError, OSError):
                # The service is gone, and what runs has nobody to answer.
                os._exit(0)
            if message == CANCEL:
                cancelled.set()
            else:
                # A job comes after the answer to the one before, which a cancellation until now was for.
                cancelled.clear()
                jobs.put(message)

    threading.Thread(target=listen, daemon=True).start()
    connection.send(READY)
    while True:
        connection.send(answer(jobs.get(), cancelled))


def main(descriptor: int) -> None:
    """Serve on an open socket.

    Parameters
    ----------
    descriptor : int
        The socket's file descriptor, inherited from the service.
    """
    bound_memory()
    serve(Connection(descriptor))
