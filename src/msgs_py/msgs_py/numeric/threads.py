"""Work on several things at once: compiled loops release the interpreter lock.

The threads are kept. To begin and end some for each image costs time, and memory: OpenCV gives a thread that resizes an
image some 900 bytes which it does not take back, 20 MB in 10,000 pairs of images.
"""

from __future__ import annotations

import _thread
import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from queue import SimpleQueue
from typing import TypeVar

from .deadline import Deadline
from .settings import THREADS

Item = TypeVar('Item')
Result = TypeVar('Result')
First = TypeVar('First')
Second = TypeVar('Second')


# Of each thread that :func:`begin` keeps and that has nothing to do, where it waits for more.
_idle: deque[SimpleQueue[Callable[[], object]]] = deque()


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    # Who spreads work does a share of it.
    return ThreadPoolExecutor(max(1, cores() - 1), thread_name_prefix='beside')


# A forked child has none of these threads.
if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)
    os.register_at_fork(after_in_child=_idle.clear)


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


def begin(work: Callable[[], object]) -> None:
    """Begin work in a thread that does nothing else, and return at once.

    A process that is told to end does not wait for it; nor does who begins it until it runs, as with threading.Thread.
    """
    try:
        waiting = _idle.pop()
    except IndexError:
        waiting = SimpleQueue()
        _thread.start_new_thread(_serve, (waiting,))
    waiting.put(work)


def _serve(waiting: SimpleQueue[Callable[[], object]]) -> None:
    while True:
        waiting.get()()
        _idle.append(waiting)


def spread(work: Callable[[Item], Result], items: Sequence[Item], most: int | None = None) -> list[Result]:
    """Do work on several items at once.

    Parameters
    ----------
    work : callable
        It should release the interpreter lock for most of its time.
    items : sequence
    most : int, optional
        Threads, at most; without it so many as are of use. There are never more than :func:`cores`.

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
    workers = _workers(len(items), most)
    if workers < 2:
        return [work(item) for item in items]
    results: list[Result | None] = [None] * len(items)
    waiting = iter(range(len(items)))

    def share() -> None:
        # Whoever is free takes the next: some take much longer than others.
        try:
            for number in waiting:
                results[number] = work(items[number])
        finally:
            # After an error nobody begins another.
            deque(waiting, maxlen=0)

    others = [_pool().submit(share) for _ in range(1, workers)]
    errors = [_raised_by(share)]
    # One that no thread has begun is not waited for: work may spread further.
    errors += [other.exception() for other in reversed(others) if not other.cancel()]
    for error in errors:
        if error is not None:
            raise error
    return results  # type: ignore[return-value]


def parts_of(count: int, least: int) -> list[tuple[int, int]]:
    """Cut many small items into parts for :func:`spread`: as many as threads are of use.

    Parameters
    ----------
    count : int
        Items.
    least : int
        That a part has; fewer are done sooner than they are handed over.

    Returns
    -------
    list of (int, int)
        First and end of each part.

    Examples
    --------
    >>> parts_of(10, 20)
    [(0, 10)]
    """
    parts = _workers(max(1, count // least))
    return [(count * part // parts, count * (part + 1) // parts) for part in range(parts)]


def _raised_by(work: Callable[[], None]) -> BaseException | None:
    try:
        work()
    except Exception as error:
        return error
    return None


def together(first: Callable[[], First], second: Callable[[], Second]) -> tuple[First, Second]:
    """Do two things at once, as :func:`spread` does; return what each returns."""
    return tuple(spread(lambda call: call(), (first, second)))  # type: ignore[return-value]


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


def _workers(items: int, most: int | None = None) -> int:
    return min(most or THREADS, cores(), items)
