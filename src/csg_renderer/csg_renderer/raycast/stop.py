"""Ending a rendering from another thread: compiled loops look at a number in their memory, the others at an event."""

from __future__ import annotations

import threading

from msgs_py.numeric.typed import IntArray


class RenderStopped(RuntimeError):
    """A rendering was ended before it was done; the text says why."""


class Stop:
    """Ends the rendering that it was given to.

    Examples
    --------
    >>> stop = Stop()
    >>> stop.check()
    >>> stop.set('enough')
    >>> stop.check()
    Traceback (most recent call last):
        ...
    csg_renderer.raycast.stop.RenderStopped: enough
    """

    def __init__(self) -> None:
        self.reason = ''
        self._lock = threading.Lock()
        self._flags: list[IntArray] = []

    def set(self, reason: str) -> None:
        """End it, for this reason; the first one counts."""
        with self._lock:
            self.reason = self.reason or reason
            for flag in self._flags:
                flag[...] = 1

    def share(self, flag: IntArray) -> None:
        """A number, (1,) int64, that is set to 1 in the end."""
        with self._lock:
            self._flags.append(flag)
            if self.reason:
                flag[...] = 1

    def check(self) -> None:
        """Raise RenderStopped once the end was asked for."""
        if self.reason:
            raise RenderStopped(self.reason)
