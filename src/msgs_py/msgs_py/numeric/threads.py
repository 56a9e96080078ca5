"""Work on several things at once: compiled loops release the interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from .deadline import Deadline
from .settings import THREADS

Item = TypeVar('Item')
Result = TypeVar('Result')


def spread(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Do work on several items at once.

    Parameters
    ----------
    work : callable
        It should release the interpreter lock for most of its time.
    items : sequence

    Returns
    -------
    list
        What ``work`` returns of every item, in their order, whatever thread does it.

    Raises
    ------
    Exception
        What ``work`` raises of any item.

    Examples
    --------
    >>> spread(lambda number: number * number, [1, 2, 3])
    [1, 4, 9]

    """
    workers = _workers(len(items))
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        # Every thread takes each so many-th item: handing out single ones would cost more than a small one takes.
        parts = pool.map(lambda first: [work(item) for item in items[first::workers]], range(workers))
        results: list[Result | None] = [None] * len(items)
        for first, part in enumerate(parts):
            results[first::workers] = part
    return results  # type: ignore[return-value]


def spread_until(work: Callable[[Item, float], Result], items: Sequence[Item], deadline: Deadline) -> list[Result]:
    """As :func:`spread`, in time: what one item leaves of its time goes to those after it.

    Parameters
    ----------
    work : callable
        Takes an item, and the seconds that it may take: an even share of what is left for those that one thread has
        not begun; 0 when there is none.
    items : sequence
    deadline : Deadline

    Returns
    -------
    list
        As :func:`spread`.
    """
    workers = max(_workers(len(items)), 1)

    def in_time(number: int) -> Result:
        waiting = -(-(len(items) - number) // workers)  # itself, and what its thread does after it
        return work(items[number], deadline.left / waiting)

    return spread(in_time, range(len(items)))


def _workers(items: int) -> int:
    return min(THREADS, os.cpu_count() or 1, items)
