"""Every benchmark of the project: ``make bench`` or ``python test/benchmarks/run.py [--quick] [--only NAME ...]``.

Runs each bench_*.py beside this file, prints its figures with their ratio to peers that are installed and to the last
saved run, and saves everything with the machine and the versions in out/bench/. Beside each benchmark a yardstick is
timed, work that is always the same: when the machine itself is slower or faster than in the last run, a change is told
but not judged.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from measure import OURS, Absent, Measurement, read_rows, yardstick
from results import keep, machine_kind
from tqdm import tqdm

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIBRARIES = (
    'numpy',
    'scipy',
    'numba',
    'opencv-python-headless',
    'open3d',
    'embreex',
    'trimesh',
    'igraph',
    'ros-jazzy-rclpy',
)
# Arguments for benchmarks that are plain scripts: short, and everything.
SCRIPT_ARGUMENTS = {
    'bench_matcher': (['--seeds', '20', '--models', 'l_shape,chair,plug'], ['--seeds', '60']),
    'bench_catalogue': (['--fresh', '--models', '1000', '--scenes', '30'], ['--fresh', '--scenes', '60']),
}
SCRIPT_LIMIT_S = 900
# A figure that differs from the last run's by less is noise on a shared machine.
NOISE = 0.25
TIMES = ('ms', 'us', 's', 'Hz')


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', nargs='+', default=[], metavar='NAME', help='benchmarks to run, e.g. codecs latency')
    parser.add_argument('--quick', action='store_true', help='about two minutes instead of ten')
    parser.add_argument('--out', type=Path, default=ROOT / 'out' / 'bench', help='folder of the saved runs')
    parser.add_argument('--against', type=Path, help='saved run to compare with (default: the last one)')
    parser.add_argument('--record', action='store_true', help='keep each benchmark in results/, which pages quote')
    parser.add_argument('--list', action='store_true', help='name the benchmarks and stop')
    options = parser.parse_args(arguments)
    modules = {path.stem.removeprefix('bench_'): path for path in sorted(HERE.glob('bench_*.py'))}
    if options.list:
        print('\n'.join(modules))
        return 0
    unknown = [name for name in options.only if name.removeprefix('bench_') not in modules]
    if unknown:
        parser.error(f'--only: no benchmark {unknown[0]!r}; there are {", ".join(modules)}')
    chosen = [name.removeprefix('bench_') for name in options.only] or list(modules)

    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    earlier = earlier_runs(options.out, options.against, options.quick)
    document: dict[str, Any] = {
        'machine': machine(),
        'versions': versions(),
        'commit': commit(),
        'when': time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime()),
        'quick': options.quick,
        'load_before': os.getloadavg()[0],
        'yardstick_ms': {},
        'benchmarks': {},
    }
    failed = []
    compared: set[str] = set()
    for name in tqdm(chosen, desc='benchmarks', unit='', file=sys.stdout, disable=not sys.stdout.isatty()):
        measured = [yardstick()]
        try:
            rows, absent = collect(modules[name], options.quick)
        except Exception as error:  # one broken benchmark must not cost the others
            failed.append(name)
            tqdm.write(f'{name}: failed: {type(error).__name__}: {error}', file=sys.stderr)
            continue
        measured.append(yardstick())
        document['benchmarks'][name] = [row.as_dict() for row in rows]
        document['yardstick_ms'][name] = sum(measured) / len(measured)
        if options.record:
            keep(name, {row.what + ('' if row.by == OURS else f' [{row.by}]'): row.value for row in rows}, timed=True)
        last = next((run for run in earlier if name in run['benchmarks']), None)
        slower = 1.0
        if last is not None:
            compared.add(f'{last["when"]} ({last["commit"]})')
            slower = document['yardstick_ms'][name] / last.get('yardstick_ms', {}).get(name, float('inf')) or 1.0
        tqdm.write('\n' + table(name, rows, absent, last['benchmarks'][name] if last else [], slower))
    path = save(options.out, document)
    print(
        f'\nsaved {path}; '
        + (f'compared with {", ".join(sorted(compared))}' if compared else 'the next run is compared with this one')
    )
    return 1 if failed else 0


def collect(path: Path, quick: bool) -> tuple[list[Measurement], list[Absent]]:
    """Figures of one benchmark. Raises what the benchmark raises."""
    rows: list[Measurement] = []
    absent: list[Absent] = []
    for item in _items(path, quick):
        (absent if isinstance(item, Absent) else rows).append(item)
    return rows, absent


def _items(path: Path, quick: bool) -> Iterator[Measurement | Absent]:
    if 'def measurements(' in path.read_text():
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[path.stem] = module
        spec.loader.exec_module(module)
        yield from module.measurements(quick)
        return
    short, full = SCRIPT_ARGUMENTS.get(path.stem, ([], []))
    done = subprocess.run(
        [sys.executable, str(path), *(short if quick else full)],
        capture_output=True,
        text=True,
        timeout=SCRIPT_LIMIT_S,
        check=False,
        cwd=ROOT,
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f'exit {done.returncode}')
    yield from read_rows(done.stdout)


def table(
    name: str, rows: list[Measurement], absent: list[Absent], before: list[dict[str, Any]], machine_slower: float = 1.0
) -> str:
    """The figures as text, each with its ratio to ours (a peer) or to the last run.

    machine_slower : how many times as long the yardstick took as in the last run
    """
    old = {(row['what'], row['by']): row['value'] for row in before}
    ours = {row.what: row for row in rows if row.by == OURS}
    steady = abs(machine_slower - 1.0) < NOISE
    lines = [f'-- {name} ' + '-' * max(0, 100 - len(name))]
    if old and not steady:
        how = (
            f'{machine_slower:.1f} times as slow'
            if machine_slower > 1.0
            else f'{1.0 / machine_slower:.1f} times as fast'
        )
        lines.append(f'the machine itself is {how} as in the last run: changes of times are not judged')
    names = [row.what + ('' if row.by == OURS else f' [{row.by}]') for row in rows]
    width = min(100, max([62, *map(len, names)]))
    lines.append(f'{"figure [by whom, if not us]":<{width}} {"value":>10} {"":<4} to peers; to the last run; notes')
    for row, shown in zip(rows, names):
        remarks = []
        mine = ours.get(row.what)
        if row.by != OURS and mine is not None and mine.value > 0.0 and row.value > 0.0:
            factor = row.value / mine.value if row.lower_is_better else mine.value / row.value
            remarks.append(
                f'ours is {factor:.1f} times better'
                if factor >= 1.05
                else f'{row.by} is {1.0 / factor:.1f} times better'
                if factor <= 0.95
                else 'as good as ours'
            )
        last = old.get((row.what, row.by))
        if last:
            change = row.value / last - 1.0
            better = (change < 0.0) == row.lower_is_better
            judged = '' if row.unit in TIMES and not steady else ' (better)' if better else ' (WORSE)'
            remarks.append('as before' if abs(change) < NOISE else f'{100 * change:+.0f} %{judged}')
        remarks += [row.note] if row.note else []
        lines.append(f'{shown:<{width}} {row.value:>10.4g} {row.unit:<4} {"; ".join(remarks)}'.rstrip())
    lines += [f'{item.what:<{width}} {"-":>10} {"":<4} {item.why}' for item in absent]
    return '\n'.join(lines)


def machine() -> dict[str, Any]:
    return {'kind': machine_kind(), 'system': platform.platform(), 'python': platform.python_version()}


def versions() -> dict[str, str]:
    found = {}
    for library in LIBRARIES:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str:
    """The commit that is measured; 'unknown' without git, and in a source archive."""
    try:
        done = subprocess.run(
            ['git', 'describe', '--always', '--dirty'], capture_output=True, text=True, cwd=ROOT, check=False
        )
    except FileNotFoundError:
        return 'unknown'
    return done.stdout.strip() or 'unknown'


def earlier_runs(folder: Path, given: Path | None, quick: bool) -> list[dict[str, Any]]:
    """The runs to compare with, newest first: the given one, or those in the folder that were as quick as this one."""
    if given is not None:
        return [json.loads(given.read_text())]
    runs = [json.loads(path.read_text()) for path in sorted(folder.glob('*.json'), reverse=True)]
    return [run for run in runs if run.get('quick') == quick]


def save(folder: Path, document: dict[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{document["when"].replace(":", "")}.json'
    path.write_text(json.dumps(document, indent=1) + '\n')
    return path


if __name__ == '__main__':
    sys.exit(main())
