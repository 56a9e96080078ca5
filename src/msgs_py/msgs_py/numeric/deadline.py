"""When work has to end: a time that can be brought forward while the work goes on, also from another thread."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from .settings import LOOK_S


class Deadline:
    """The end of a piece of work, which its loops look at; what it is made of ends with it.

    Parameters
    ----------
    seconds : float
        From now.
    within : Deadline, optional
        Of the whole, which counts for this part, too.

    Examples
    --------
    >>> whole = Deadline(60.0)
    >>> part = Deadline(10.0, within=whole)
    >>> part.passed
    False
    >>> whole.bring_forward(0.0)
    >>> part.passed, part.left
    (True, 0.0)
    """

    def __init__(self, seconds: float = math.inf, within: Deadline | None = None) -> None:
        self._begun = time.perf_counter()
        self._seconds = seconds
        self._end = self._begun + seconds
        self._within = within

    def bring_forward(self, seconds: float) -> None:
        """Let no more than so many seconds pass from now."""
        self._end = min(self._end, time.perf_counter() + seconds)

    def share(self, fraction: float) -> Deadline:
        """The end of the first part, which has this fraction of the seconds, from when the whole began."""
        part = Deadline(math.inf, within=self)
        part._end = self._begun + fraction * self._seconds
        return part

    @property
    def left(self) -> float:
        """Seconds that are left, not less than 0."""
        here = max(0.0, self._end - time.perf_counter())
        return here if self._within is None else min(here, self._within.left)

    @property
    def passed(self) -> bool:
        """Whether nothing is left."""
        return self.left <= 0.0

    @property
    def seconds(self) -> float:
        """Since it was made."""
        return time.perf_counter() - self._begun


def blocks(count: int, deadline: Deadline, first: int = 0) -> Iterator[tuple[int, int]]:
    """Stretches of a loop, so long that the clock is looked at about every LOOK_S; none begins after the end but one.

    What an item takes is not known beforehand: the first stretch is of one, each is sixteen times as long as the one
    before while that took less than a sixteenth of LOOK_S, and half as long when it took more than all of it.

    Parameters
    ----------
    count : int
        Of the items.
    deadline : Deadline
    first : int
        The item to begin with.

    Yields
    ------
    first, last : int
        The items of a stretch are first to last - 1.

    Examples
    --------
    >>> list(blocks(10, Deadline()))
    [(0, 1), (1, 10)]
    >>> list(blocks(10, Deadline(0.0)))
    [(0, 1)]
    """
    size, begun = 1, time.perf_counter()
    while first < count:
        yield first, min(count, first + size)
        first += size
        now = time.perf_counter()
        size = max(1, size // 2) if now - begun > LOOK_S else 16 * size if now - begun < LOOK_S / 16 else size
        begun = now
        if deadline.passed:
            break
