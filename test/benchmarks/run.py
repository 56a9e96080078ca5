"""Every benchmark of the project: ``make bench`` or ``python test/benchmarks/run.py [--quick] [--only NAME ...]``.

Runs each bench_*.py beside this file, prints its figures with their ratio to peers that are installed and to the last
saved run, and saves everything with the machine and the versions in out/bench/.
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

from measure import OURS, Absent, Measurement, read_rows
from tqdm import tqdm

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIBRARIES = ('numpy', 'scipy', 'numba', 'opencv-python-headless', 'open3d', 'embreex', 'trimesh', 'igraph',
             'ros-jazzy-rclpy')
# Arguments for benchmarks that are plain scripts: short, and everything.
SCRIPT_ARGUMENTS = {'bench_matcher': (['--seeds', '20', '--models', 'l_shape,chair,plug'], ['--seeds', '100'])}
SCRIPT_LIMIT_S = 900
# A figure that differs from the last run's by less is noise on a shared machine.
NOISE = 0.25


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', nargs='+', default=[], metavar='NAME', help='benchmarks to run, e.g. codecs latency')
    parser.add_argument('--quick', action='store_true', help='a minute instead of several')
    parser.add_argument('--out', type=Path, default=ROOT / 'out' / 'bench', help='folder of the saved runs')
    parser.add_argument('--against', type=Path, help='saved run to compare with (default: the last one)')
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
    before = last_run(options.out, options.against)
    document: dict[str, Any] = {'machine': machine(), 'versions': versions(), 'commit': commit(),
                                'when': time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime()), 'quick': options.quick,
                                'load_before': os.getloadavg()[0], 'benchmarks': {}}
    failed = []
    for name in tqdm(chosen, desc='benchmarks', unit='', file=sys.stdout, disable=not sys.stdout.isatty()):
        try:
            rows, absent = collect(modules[name], options.quick)
        except Exception as error:  # one broken benchmark must not cost the others
            failed.append(name)
            tqdm.write(f'{name}: failed: {type(error).__name__}: {error}', file=sys.stderr)
            continue
        document['benchmarks'][name] = [row.as_dict() for row in rows]
        tqdm.write('\n' + table(name, rows, absent, before.get('benchmarks', {}).get(name, [])))
    path = save(options.out, document)
    print(f'\nsaved {path}' + (f'; compared with {before["when"]} ({before["commit"]})' if before else
                               '; the next run is compared with this one'))
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
    done = subprocess.run([sys.executable, str(path), *(short if quick else full)], capture_output=True, text=True,
                          timeout=SCRIPT_LIMIT_S, check=False, cwd=ROOT)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else f'exit {done.returncode}')
    yield from read_rows(done.stdout)


def table(name: str, rows: list[Measurement], absent: list[Absent], before: list[dict[str, Any]]) -> str:
    """The figures as text, each with its ratio to ours (a peer) or to the last run (ours)."""
    old = {(row['what'], row['by']): row['value'] for row in before}
    ours = {row.what: row for row in rows if row.by == OURS}
    lines = [f'-- {name} ' + '-' * max(0, 100 - len(name))]
    for row in rows:
        remarks = []
        mine = ours.get(row.what)
        if row.by != OURS and mine is not None and mine.value > 0.0 and row.value > 0.0:
            factor = row.value / mine.value if row.lower_is_better else mine.value / row.value
            remarks.append(f'ours is {factor:.1f} times {"better" if factor >= 1 else "as good"}')
        last = old.get((row.what, row.by))
        if last:
            change = row.value / last - 1.0
            better = (change < 0.0) == row.lower_is_better
            remarks.append('as before' if abs(change) < NOISE else
                           f'{100 * change:+.0f} % ({"better" if better else "WORSE"})')
        remarks += [row.note] if row.note else []
        who = '' if row.by == OURS else f' [{row.by}]'
        lines.append(f'{row.what + who:<62} {row.value:>10.3g} {row.unit:<4} {"; ".join(remarks)}'.rstrip())
    lines += [f'{item.what:<62} {"-":>10} {"":<4} {item.why}' for item in absent]
    return '\n'.join(lines)


def machine() -> dict[str, Any]:
    name = platform.processor()
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
        name = next((line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')), name)
    except OSError:
        pass
    return {'cpu': name, 'cores': os.cpu_count(), 'system': platform.platform(), 'python': platform.python_version()}


def versions() -> dict[str, str]:
    found = {}
    for library in LIBRARIES:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str:
    done = subprocess.run(['git', 'describe', '--always', '--dirty'], capture_output=True, text=True, cwd=ROOT,
                          check=False)
    return done.stdout.strip() or 'unknown'


def last_run(folder: Path, given: Path | None) -> dict[str, Any]:
    """The run to compare with: the given one, the last in the folder, or the one kept beside this file."""
    if given is not None:
        return json.loads(given.read_text())
    runs = sorted(folder.glob('*.json')) or sorted(HERE.glob('reference.json'))
    return json.loads(runs[-1].read_text()) if runs else {}


def save(folder: Path, document: dict[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{document["when"].replace(":", "")}.json'
    path.write_text(json.dumps(document, indent=1) + '\n')
    return path


if __name__ == '__main__':
    sys.exit(main())
