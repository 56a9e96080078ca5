"""What compiling costs on a machine that has compiled nothing: ``python test/benchmarks/compile_time.py``.

Each package's steps run in a process of their own with an empty cache, one after the other; then again, with what is
in the cache by then. For each step: processor time, and time on the clock, which is longer where other programs run.
Then the functions that took longest without those they call. What a function calls is compiled with it, as one unit,
so optimising it is part of the time of the function that Python calls.

--package : only this one. --dearest : so many functions. --save : a JSON file of the figures.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

from numba.core import event

from model_matcher.closed_form.compile_all import PACKAGES, steps_of
from msgs_py.numeric.compiled import FOLDER_VARIABLE, SUFFIX


class Stopwatch(event.Listener):
    """Processor time of each compiled function, without that of the functions it calls."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.specialisations: Counter[str] = Counter()
        self._open: list[list[float]] = []

    def on_start(self, what: Any) -> None:
        self._open.append([time.process_time(), 0.0])

    def on_end(self, what: Any) -> None:
        start, inner = self._open.pop()
        took = time.process_time() - start
        if self._open:
            self._open[-1][1] += took
        function = what.data['dispatcher'].py_func
        name = f'{function.__module__}.{function.__qualname__}'
        self.seconds[name] += took - inner
        self.specialisations[name] += 1


def measured(package: str) -> dict[str, Any]:
    """Figures of one package, in this process and with its cache."""
    watch = Stopwatch()
    event.register('numba:compile', watch)
    steps = []
    for step in steps_of(package):
        processor, clock = time.process_time(), time.perf_counter()
        before = sum(watch.specialisations.values())
        step.run()
        steps.append(
            {
                'step': step.name,
                'cpu_s': round(time.process_time() - processor, 2),
                'wall_s': round(time.perf_counter() - clock, 2),
                'specialisations': sum(watch.specialisations.values()) - before,
            }
        )
    dearest = sorted(watch.seconds, key=lambda name: -watch.seconds[name])
    return {
        'steps': steps,
        'functions': len(watch.seconds),
        'dearest': [[name, round(watch.seconds[name], 2), watch.specialisations[name]] for name in dearest],
    }


def in_a_process(package: str, cache: str) -> dict[str, Any]:
    command = [sys.executable, __file__, '--inside', package]
    done = subprocess.run(
        command, env={**os.environ, FOLDER_VARIABLE: cache}, check=True, stdout=subprocess.PIPE, text=True
    )
    return json.loads(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--package', choices=PACKAGES)
    parser.add_argument('--dearest', type=int, default=20)
    parser.add_argument('--save', type=Path)
    parser.add_argument('--inside', choices=PACKAGES, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inside:
        print(json.dumps(measured(arguments.inside)))
        return 0
    total = 0.0
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as cache:
        for package in [arguments.package] if arguments.package else PACKAGES:
            figures[package] = cold = in_a_process(package, cache)
            warm = in_a_process(package, cache)
            print(f'{package}: {"step":28} {"CPU s":>7} {"clock s":>8} {"specialisations":>16} {"CPU s again":>12}')
            for step, again in zip(cold['steps'], warm['steps']):
                print(
                    f'{"":{len(package)}}  {step["step"]:28} {step["cpu_s"]:7.2f} {step["wall_s"]:8.2f} '
                    f'{step["specialisations"]:16} {again["cpu_s"]:12.2f}'
                )
            seconds = sum(step['cpu_s'] for step in cold['steps'])
            total += seconds
            print(f'{"":{len(package)}}  {"all":28} {seconds:7.2f}; {cold["functions"]} functions, the dearest:')
            for name, cpu, count in cold['dearest'][: arguments.dearest]:
                print(f'    {cpu:6.2f} s  {count:3} x  {name}')
        entries = [path.stat().st_size for path in Path(cache).glob(f'*{SUFFIX}')]
        print(f'all packages: {total:.1f} s of CPU; {len(entries)} entries, {sum(entries) / 1e6:.1f} MB')
    if arguments.save:
        arguments.save.write_text(json.dumps({'total_cpu_s': round(total, 1), **figures}, indent=1))
    return 0


if __name__ == '__main__':
    sys.exit(main())
