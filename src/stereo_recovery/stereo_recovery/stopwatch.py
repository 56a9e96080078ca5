"""How long each stage of a recovery takes, and what is left out when the time is up."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

from msgs_py.numeric.deadline import Deadline

# Whether it is too late for what comes next.
Late: TypeAlias = Callable[[], bool]


def never() -> bool:
    """It is never too late where no time limit was set."""
    return False


class Stopwatch:
    """Time of the stages that have ended, and what was left out to keep to a limit.

    No step is broken off: what would begin too late is left out, so that a limit is exceeded by one step at most.

    Parameters
    ----------
    limit : float, seconds, optional
        From now; none by default.
    clock : callable
        Seconds since some moment.
    deadline : Deadline, optional
        After which it is too late in any case.

    Attributes
    ----------
    milliseconds : dict of str to float
        Of each stage.
    left_out : list of str
        What was not done, in the order in which it would have been.

    Examples
    --------
    >>> seconds = iter((0.0, 0.2, 0.7))
    >>> watch = Stopwatch(1.0, lambda: next(seconds))
    >>> late = watch.late_after(0.5, 'curves')
    >>> late(), late(), watch.left_out
    (False, True, ['curves'])
    """

    def __init__(
        self,
        limit: float | None = None,
        clock: Callable[[], float] = time.perf_counter,
        deadline: Deadline | None = None,
    ) -> None:
        self.milliseconds: dict[str, float] = {}
        self.left_out: list[str] = []
        self._limit, self._clock, self._deadline = limit, clock, deadline
        self._start = self._since = clock()

    def stage(self, name: str) -> None:
        """A stage ends now; the next begins."""
        now = self._clock()
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + 1e3 * (now - self._since)
        self._since = now

    def late_after(self, share: float, what: str) -> Late:
        """Whether more than this share of the limit has passed, so that ``what`` is left out; it is noted then."""
        if self._limit is None and self._deadline is None:
            return never
        return partial(self._is_late, math.inf if self._limit is None else share * self._limit, what)

    def _is_late(self, seconds: float, what: str) -> bool:
        late = self._clock() - self._start > seconds or (self._deadline is not None and self._deadline.passed)
        if late and what not in self.left_out:
            self.left_out.append(what)
        return late
