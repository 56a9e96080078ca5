"""What a benchmark reports, and how times are taken.

A benchmark module ``bench_*.py`` offers ``measurements(quick) -> iterable of Measurement``; run.py collects them. One
that is a plain script instead is run as such and its printed rows are read by :func:`read_rows`.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

OURS = 'ours'


@dataclass(frozen=True)
class Measurement:
    """One figure.

    what : the task, the same text for everyone who does it; value, unit : median unless the note says otherwise
    by : OURS or the name of a peer, whose figures are compared with ours for the same task
    lower_is_better : False for rates and shares; note : how it was taken
    """

    what: str
    value: float
    unit: str = 'ms'
    by: str = OURS
    lower_is_better: bool = True
    note: str = ''

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Absent:
    """A peer or a part that is not installed, and why."""

    what: str
    why: str


def seed_range(text: str) -> range:
    """For argparse: A..B, both ends included."""
    try:
        first, last = (int(part) for part in text.split('..'))
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected A..B, e.g. 100..139, got {text!r}') from None
    return range(first, last + 1)


def milliseconds(function: Callable[[], Any], budget_s: float = 1.0, least: int = 3, most: int = 200) -> float:
    """Median time of a call, after one call that is not counted."""
    function()
    times: list[float] = []
    end = time.perf_counter() + budget_s
    while len(times) < least or (time.perf_counter() < end and len(times) < most):
        started = time.perf_counter()
        function()
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)


def interleaved(functions: Sequence[Callable[[], Any]], budget_s: float = 1.0, least: int = 5) -> list[float]:
    """Median time of each of several calls, taken in turns: what else the machine does falls on all alike."""
    times: list[list[float]] = [[] for _ in functions]
    end = time.perf_counter() + budget_s
    while len(times[0]) <= least or time.perf_counter() < end:
        for function, taken in zip(functions, times):
            started = time.perf_counter()
            function()
            taken.append(1e3 * (time.perf_counter() - started))
    return [statistics.median(taken[1:]) for taken in times]


def yardstick(repeats: int = 15) -> float:
    """Median time, ms, of work that never changes: sorting on every core at once, then a plain loop."""
    cores = os.cpu_count() or 1
    numbers = [np.random.default_rng(k).random(100_000) for k in range(cores)]
    times = []
    with ThreadPoolExecutor(cores) as pool:
        for _ in range(repeats):
            started = time.perf_counter()
            list(pool.map(np.sort, numbers))
            sum(k * k for k in range(50_000))
            times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)


_TIME = re.compile(r'(?:(\w+)\s+)?(\d+(?:\.\d+)?)\s*(ms|us|s|Hz)\b')
_SHARE = re.compile(r'(\d+(?:\.\d+)?) % of')
_GAP = re.compile(r'\s{2,}|\t|\s*\|\s*')


def read_rows(text: str) -> Iterator[Measurement]:
    """Figures in printed rows: the words before the first figure name the row; "median 1.2 ms" and "98.0 % of 50" are
    understood, other lines are left out."""
    for line in text.splitlines():
        found = list(_TIME.finditer(line))
        share = _SHARE.search(line)
        if not found and not share:
            continue
        fields = [field for field in _GAP.split(line.strip()) if field]
        name: list[str] = []
        for field in fields:
            if '=' in field or (name and re.match(r'[\d.]+($|\s)', field)) or field in ('median', 'p50', 'best'):
                break
            name.append(field)
        head = ' '.join(name[:3]) or line.strip()[:40]
        if share:
            yield Measurement(f'{head}: success', float(share[1]), '%', lower_is_better=False)
        for match in found:
            label = f' {match[1]}' if match[1] and match[1] not in ('median', *head.split()) else ''
            factor = {'ms': 1.0, 'us': 1e-3, 's': 1e3, 'Hz': 1.0}[match[3]]
            unit = 'Hz' if match[3] == 'Hz' else 'ms'
            yield Measurement(f'{head}{label}', factor * float(match[2]), unit, lower_is_better=unit == 'ms')
