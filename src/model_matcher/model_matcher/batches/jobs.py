"""Many jobs: in this process, in several, or on a dask cluster, with a progress bar; a run that was stopped goes on.

What jobs give is kept line by line as it comes, in a file that begins with what was asked for: the same command takes
up where it was stopped, and another one does not mix with it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import as_completed as completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from .numbers import whole

NO_DASK = 'dask: dask.distributed is not installed (pip install distributed)'
# Takes a function and jobs; yields each job with what the function gives for it, in the order in which they are done.
Run = Callable[[Callable[[Any], Any], Sequence[Any]], Iterator[tuple[Any, Any]]]


def nothing() -> None:
    """Where nothing has to be made ready."""


@dataclass(frozen=True)
class Workers:
    """Who does the jobs.

    Attributes
    ----------
    count : int
        Processes on this machine.
    dask : str, optional
        Address of a dask scheduler to do them instead; 'local' starts one here, with ``count`` workers. Those of
        another machine need this software, too.
    quiet : bool
        Show no progress bar.
    """

    count: int = 1
    dask: str | None = None
    quiet: bool = False


def add_worker_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup, default: int = 1) -> None:
    """Give a command the options ``--workers`` and ``--dask``."""
    parser.add_argument(
        '--workers', type=whole(1), default=default, metavar='N', help=f'processes on this machine (default: {default})'
    )
    parser.add_argument('--dask', metavar='ADDRESS', help='dask scheduler to run on instead; "local" starts one here')


def workers_of(options: argparse.Namespace) -> Workers:
    """What the options of :func:`add_worker_options`, and ``--quiet`` where there is one, ask for."""
    return Workers(options.workers, options.dask, getattr(options, 'quiet', False))


@contextmanager
def runner(workers: Workers, ready: Callable[[], None] = nothing) -> Iterator[Run]:
    """A function that does jobs.

    Parameters
    ----------
    workers : Workers
    ready : callable
        Of a module; compiles what the jobs need. Called before there are several processes, each of which would compile
        for itself, and then in each.

    Yields
    ------
    Run

    Raises
    ------
    ValueError
        When dask is asked for and not installed, here or, as the jobs show, what they need on the cluster.
    """
    if workers.dask is not None:
        # dask.distributed is optional and takes half a second to import.
        try:
            from distributed import Client, LocalCluster
        except ImportError:
            raise ValueError(NO_DASK) from None
        if workers.dask == 'local':
            ready()
            with LocalCluster(n_workers=max(workers.count, 1), threads_per_worker=1, dashboard_address=None) as cluster:
                with Client(cluster) as client:
                    yield _on_cluster(client)
            return
        with Client(workers.dask) as client:
            yield _on_cluster(client)
    elif workers.count > 1:
        ready()
        # Fresh processes: a forked one would inherit threads of numba and of the middleware.
        context = multiprocessing.get_context('spawn')
        with ProcessPoolExecutor(workers.count, context, _begin, (workers.count, ready)) as pool:

            def in_processes(function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
                asked = {pool.submit(function, job): job for job in jobs}
                try:
                    for future in completed(asked):
                        yield asked[future], future.result()
                finally:
                    for future in asked:
                        future.cancel()

            yield in_processes
    else:
        yield lambda function, jobs: ((job, function(job)) for job in jobs)


def _on_cluster(client: Any) -> Run:
    """What does jobs on the cluster of a dask client."""
    from distributed import as_completed
    from distributed.protocol.pickle import dumps

    def perform(packed: bytes) -> Any:
        """A job, unpacked where it is done: what cannot be imported there fails as the job, and not as the worker.

        As a function within one it travels whole, to workers that lack this module, too.
        """
        import pickle

        function, job = pickle.loads(packed)
        return function(job)

    def run(function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        asked = {client.submit(perform, dumps((function, job)), pure=False): job for job in jobs}
        for future in as_completed(list(asked)):
            try:
                yield asked[future], future.result()
            except ImportError as error:
                raise ValueError(f'dask: a worker lacks software that this machine has: {error}') from error

    return run


def run_jobs(
    function: Callable[[Any], Any],
    jobs: Mapping[str, Any],
    workers: Workers = Workers(),
    store: Store | None = None,
    title: str = 'jobs',
    ready: Callable[[], None] = nothing,
) -> dict[str, Any]:
    """Do jobs, those that the store does not hold already.

    Parameters
    ----------
    function : callable
        Of a module, so that other processes find it; takes a job, gives what JSON can hold.
    jobs : mapping of str to object
        By a name that stays the same from run to run.
    workers : Workers
    store : Store, optional
        Where results are kept.
    title : str
        Of the progress bar.
    ready : callable
        As of :func:`runner`.

    Returns
    -------
    dict of str to object
        What each gave, in the order of the jobs, as JSON has it: the same when it is read again.
    """
    done = {} if store is None else {name: store.results[name] for name in jobs if name in store.results}
    left = [_Named(function, name, job) for name, job in jobs.items() if name not in done]
    # To stderr: what a command prints is its result.
    with tqdm(
        total=len(jobs), initial=len(done), desc=title, unit='', disable=workers.quiet or None, file=sys.stderr
    ) as bar:
        if left:
            with runner(workers, ready) as run:
                for named, result in run(_do, left):
                    done[named.name] = _as_read(result)
                    if store is not None:
                        store.add(named.name, done[named.name])
                    bar.update()
    return {name: done[name] for name in jobs}


class Store:
    """Results of jobs in a file, a line each, the first line what was asked for.

    Parameters
    ----------
    path : Path
        Made when it is not there, with its folder.
    arguments : mapping
        What was asked for, all that results depend on; values that JSON can hold.
    fresh : bool
        Begin anew, whatever is there.

    Attributes
    ----------
    results : dict of str to object
        By the names of jobs.

    Raises
    ------
    ValueError
        The file holds results of other arguments, or is none of this kind.
    """

    def __init__(self, path: Path, arguments: Mapping[str, Any], fresh: bool = False) -> None:
        self.path = path
        self.results: dict[str, Any] = {}
        asked = _as_read(arguments)
        path.parent.mkdir(parents=True, exist_ok=True)
        if fresh or not path.exists() or path.stat().st_size == 0:
            path.write_text(json.dumps({'arguments': asked}) + '\n', encoding='utf-8')
            return
        text = path.read_text(encoding='utf-8')
        whole, _, rest = text.rpartition('\n')
        if rest:  # a run was killed while it wrote this line
            path.write_text(whole + '\n', encoding='utf-8')
        try:
            first, *lines = [json.loads(line) for line in whole.split('\n')]
            before = first['arguments']
            self.results = {line['job']: line['result'] for line in lines}
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ValueError(f'{path}: not a file of results; name another folder, or remove it') from None
        if before != asked:
            other = sorted(name for name in {*before, *asked} if before.get(name) != asked.get(name))
            raise ValueError(
                f'{path}: holds results of other arguments ({", ".join(other)}); give the same ones to go on, or '
                'another folder'
            )

    def add(self, name: str, result: Any) -> None:
        """Keep one result."""
        self.results[name] = result
        with open(self.path, 'a', encoding='utf-8') as file:
            file.write(json.dumps({'job': name, 'result': result}) + '\n')


def digest(data: bytes) -> str:
    """What names the contents of a file among the arguments of a store."""
    return hashlib.sha256(data).hexdigest()[:16]


def _as_read(value: Any) -> Any:
    """A value as it is after it was written and read again; numpy's become Python's, numbers that are none stay so."""
    return json.loads(json.dumps(value, default=lambda one: one.tolist()))


@dataclass(frozen=True)
class _Named:
    """A job with its name and what does it."""

    function: Callable[[Any], Any]
    name: str
    job: Any


def _do(named: _Named) -> Any:
    return named.function(named.job)


def _begin(workers: int, ready: Callable[[], None]) -> None:
    """In a process of several: leave the others their cores, and load what was compiled before the first job."""
    import cv2

    cv2.setNumThreads(max(1, (os.cpu_count() or 1) // workers))
    ready()
