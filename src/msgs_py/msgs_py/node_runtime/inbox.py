"""Calls that wait for a node: of what is handed over to it, and of work that was done beside it.

Only one thread at a time calls a node. That is the one of its executor; where a node's turns are shared, it is also
the thread that brings something while the node does nothing else, which saves the time until an executor wakes up.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable

from .managed import ManagedNode


class Inbox:
    """What is to be called in a node's turn, in the order of its coming.

    Parameters
    ----------
    node : ManagedNode
        Reports what a call raises.

    Attributes
    ----------
    turn : threading.Lock or None
        Held by whoever calls the node, its executor too: who brings a call makes it then, if nobody holds it. None:
        only the executor calls the node.
    """

    def __init__(self, node: ManagedNode) -> None:
        self.turn: threading.Lock | None = None
        self._node = node
        self._waiting: deque[Callable[[], None]] = deque()
        self._guard = node.create_guard_condition(self._take_all)

    def put(self, call: Callable[[], None]) -> None:
        """Call it in the node's turn: now, or as soon as the node's executor comes to it. From any thread."""
        self._waiting.append(call)
        turn = self.turn
        if turn is not None and turn.acquire(blocking=False):
            try:
                self._take_all()
            finally:
                turn.release()
        # What came while the turn was held is left to the executor.
        if self._waiting:
            with contextlib.suppress(Exception):  # the node may be gone by then
                self._guard.trigger()

    def close(self) -> None:
        """Nothing that waits is called any more, and nobody but the executor calls; who does now is waited for."""
        turn, self.turn = self.turn, None
        if turn is not None:
            with turn:
                pass
        self._waiting.clear()

    def _take_all(self) -> None:
        while self._waiting:
            call = self._waiting.popleft()
            try:
                call()
            except Exception as error:  # it must not go to who has only brought the call
                self._node.problem(f'{type(error).__name__}: {error}')
