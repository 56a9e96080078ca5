"""Compiled functions whose cache several processes may share: the one way numba is used here.

numba keeps machine code beside the source. Two things go wrong with it in a graph of nodes:

* Two processes that compile the same function at the same time may exchange each other's files: the index is written
  first and the code after it, so that an index may name code of another signature. Nodes started together after an
  installation, or tests in parallel, then crash, and keep crashing. Here reading and writing take a file lock.
* A function's code contains that of the functions it calls, but is kept as long as its own file is unchanged. Here it
  is kept as long as no compiled module of its package has changed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile

try:
    import fcntl
except ImportError:  # no such locks on this system: as numba alone
    fcntl = None  # type: ignore[assignment]

LOCK_FILE = 'compiled.lock'


class SharedCacheFile(IndexDataCacheFile):
    """numba's cache of one function, read and written by one process at a time."""

    def save(self, key: Any, data: Any) -> None:
        with self._locked(exclusive=True):
            super().save(key, data)

    def load(self, key: Any) -> Any:
        with self._locked(exclusive=False):
            return super().load(key)

    @contextlib.contextmanager
    def _locked(self, exclusive: bool) -> Iterator[None]:
        if fcntl is None:
            yield
            return
        try:
            lock = open(Path(self._cache_path) / LOCK_FILE, 'a')  # noqa: SIM115  closed below, which frees the lock
        except OSError:  # nobody can write here, so nobody disturbs the reader
            yield
            return
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH)
            yield


@lru_cache
def package_stamp(folder: str) -> tuple[tuple[str, int, int], ...]:
    """Name, time of change (ns) and size of every module in a folder that has compiled functions."""
    found = []
    for path in sorted(Path(folder).glob('*.py')):
        with contextlib.suppress(OSError):
            if 'njit' in path.read_text(encoding='utf-8'):
                status = path.stat()
                found.append((path.name, status.st_mtime_ns, status.st_size))
    return tuple(found)


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with a cache that processes may share; options as there, ``cache`` is always on."""
    if function is None:
        return lambda decorated: njit(decorated, **options)
    options['cache'] = True
    dispatcher = numba.njit(**options)(function)
    file = getattr(getattr(dispatcher, '_cache', None), '_cache_file', None)
    if type(file) is IndexDataCacheFile:  # with compilation switched off there is none
        file.__class__ = SharedCacheFile
        file._source_stamp = (file._source_stamp, package_stamp(str(Path(function.__code__.co_filename).parent)))
    return dispatcher
