"""Compiles all that the nodes need, on all cores: ``python -m model_matcher.closed_form.compile_all``.

``make setup`` runs it, so that no demo, node or test waits for a compiler. What was compiled before is only loaded.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue

from csg_renderer import load_scene, scene_path
from csg_renderer.raycast.render import compile_steps as renderer_steps
from csg_renderer.visibility.hidden_lines import compile_steps as hidden_line_steps
from msgs_py.numeric.steps import CompileStep
from stereo_recovery.pipeline import compile_steps as recovery_steps

from ..pipeline import compile_steps as matcher_steps
from ..tracking.compiling import compile_steps as tracker_steps

# The dearest first: with two cores the third is compiled by who is ready first.
PACKAGES = ('model_matcher', 'stereo_recovery', 'csg_renderer')


def steps_of(package: str) -> tuple[CompileStep, ...]:
    """What a package's node needs compiled."""
    if package == 'csg_renderer':
        return (*renderer_steps(load_scene(scene_path('l_shape_v1'))), *hidden_line_steps())
    return (
        recovery_steps()
        if package == 'stereo_recovery'
        else (*matcher_steps(images=True, catalogue=True), *tracker_steps())
    )


def compile_all(workers: int | None = None) -> float:
    """Compile everything, each package in a process; returns the seconds that it took.

    Parameters
    ----------
    workers : int, optional
        Processes at a time; as many as there are processors where it is left out.
    """
    started = time.perf_counter()
    context = get_context('spawn')
    reports: SimpleQueue[tuple[str, str]] = context.SimpleQueue()
    total = sum(len(steps_of(package)) for package in PACKAGES)
    with ProcessPoolExecutor(workers or len(os.sched_getaffinity(0)), context, _report_to, (reports,)) as pool:
        jobs = [pool.submit(_compile, package) for package in PACKAGES]
        for job in jobs:
            job.add_done_callback(lambda _: reports.put(('', '')))
        done, left = 0, len(jobs)
        while left:
            package, name = reports.get()
            if package:
                done += 1
                _show(f'compiled {done} of {total}: {package}, {name}')
            else:
                left -= 1
        for job in jobs:
            job.result()
    seconds = time.perf_counter() - started
    _show(f'compiled {total} of {total}, {seconds:.0f} s', last=True)
    return seconds


_reports: list[SimpleQueue[tuple[str, str]]] = []


def _report_to(reports: SimpleQueue[tuple[str, str]]) -> None:
    _reports.append(reports)


def _compile(package: str) -> None:
    for step in steps_of(package):
        step.run()
        _reports[0].put((package, step.name))


def _show(text: str, last: bool = False) -> None:
    """One line that is written over on a terminal; line by line elsewhere."""
    if sys.stdout.isatty():
        print(f'\r\033[K{text}', end='\n' if last else '', flush=True)
    else:
        print(text, flush=True)


def main() -> int:
    """Of the command."""
    compile_all()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
