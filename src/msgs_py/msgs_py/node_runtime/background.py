"""One piece of work in a thread of its own, so that a node answers meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from ..numeric.threads import begin

T = TypeVar('T')


class Background(Generic[T]):
    """Work that has begun in a thread.

    Parameters
    ----------
    work : callable
        Its value is the result.
    on_end : callable
        Called in that thread when it is done, whatever came of it.

    Examples
    --------
    >>> job = Background(lambda: 6 * 7)
    >>> job.wait()
    True
    >>> job.result()
    42
    """

    def __init__(self, work: Callable[[], T], on_end: Callable[[], None] = lambda: None) -> None:
        self._work, self._on_end = work, on_end
        self._values: list[T] = []
        self._error: BaseException | None = None
        self._ended = threading.Event()
        begin(self._run)

    @property
    def done(self) -> bool:
        """Whether there is a result, or a failure."""
        return self._ended.is_set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; returns whether it has come."""
        return self._ended.wait(timeout_s)

    def result(self) -> T:
        """What the work gave, when it is done; raises what it raised."""
        if self._error is not None:
            raise self._error
        return self._values[0]

    def _run(self) -> None:
        try:
            self._values.append(self._work())
        except BaseException as error:  # whatever it is, who waits must hear of it
            self._error = error
        self._ended.set()
        self._on_end()
