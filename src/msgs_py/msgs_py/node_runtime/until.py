"""Waiting in a callback of rclpy's executor, which asks what waits again and again, without a pause of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator

# Seconds for which the executor leaves the processor to what is waited for, before it asks again.
PAUSE_S = 0.001


class Until:
    """Awaitable: until something holds.

    Parameters
    ----------
    holds : callable
        Asked before every wait.

    Examples
    --------
    >>> count = iter((False, False, True))
    >>> len(list(Until(lambda: next(count)).__await__()))
    2
    """

    # When one of them all last ended a pause: many that wait together do not add theirs up.
    _paused = 0.0

    def __init__(self, holds: Callable[[], bool]) -> None:
        self.holds = holds

    def __await__(self) -> Generator[None, None, None]:
        while not self.holds():
            if time.monotonic() - Until._paused > PAUSE_S:
                time.sleep(PAUSE_S)
                Until._paused = time.monotonic()
            yield
