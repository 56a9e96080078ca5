"""Work on several models at once: the compiled loops release the interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

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
    workers = min(THREADS, os.cpu_count() or 1, len(items))
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        # Every thread takes each so many-th item: handing out single ones would cost more than a small one takes.
        parts = pool.map(lambda first: [work(item) for item in items[first::workers]], range(workers))
        results: list[Result | None] = [None] * len(items)
        for first, part in enumerate(parts):
            results[first::workers] = part
    return results  # type: ignore[return-value]
