"""Benchmarks in several processes or on a cluster: what every script that runs more than a minute does with its jobs.

Results are kept as they come, in out/batches, until all are there: a run that was stopped goes on when the same command
is given and no source file has changed since; otherwise it begins anew. Times measured beside other jobs are longer.
"""

from __future__ import annotations

import argparse
import pickle
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from model_matcher.batches.jobs import Store, add_worker_options, digest, run_jobs, workers_of
from model_matcher.closed_form.run_library import be_ready

ROOT = Path(__file__).resolve().parents[2]
STORE = ROOT / 'out' / 'batches'


def add_batch_options(parser: argparse.ArgumentParser) -> None:
    """Give a script ``--workers``, ``--dask`` and ``--fresh``."""
    add_worker_options(parser)
    parser.add_argument('--fresh', action='store_true', help='begin anew where the same command was stopped')


def one_process() -> argparse.Namespace:
    """The options of a run in this process, for those who call a script's functions."""
    parser = argparse.ArgumentParser()
    add_batch_options(parser)
    return parser.parse_args(['--fresh'])


def run_batch(
    function: Callable[[Any], Any],
    jobs: Mapping[str, Any],
    options: argparse.Namespace,
    title: str,
    ready: Callable[[], None] = be_ready,
) -> dict[str, Any]:
    """Do jobs, see :func:`model_matcher.batches.jobs.run_jobs`; options: of :func:`add_batch_options`.

    Everything that a job depends on is in it, its name, and the sources.
    """
    path = STORE / f'{Path(sys.argv[0]).stem}_{title.replace(" ", "_")}.jsonl'
    arguments = {'sources': sources(), 'jobs': digest(pickle.dumps(list(jobs.items())))}
    try:
        store = Store(path, arguments, options.fresh)
    except ValueError:
        store = Store(path, arguments, fresh=True)
    done = run_jobs(importable(function), jobs, workers_of(options), store, title, ready)
    path.unlink()
    return done


def importable(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of the script that runs, as other processes import it: of a module that has the script's name."""
    if function.__module__ != '__main__':
        return function
    found: Callable[[Any], Any] = getattr(import_module(Path(sys.argv[0]).stem), function.__qualname__)
    return found


@cache
def sources() -> str:
    """What the code is: a digest of all source files."""
    files = sorted([*(ROOT / 'src').rglob('*.py'), *(ROOT / 'test').rglob('*.py'), *(ROOT / 'src').rglob('*.csg')])
    return digest(b''.join(path.read_bytes() for path in files))
