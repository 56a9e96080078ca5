"""The figures that pages quote: a file for each command that measured them, with the day and the kind of machine.

    python test/benchmarks/results.py            # names, days and commands of all there are
    python test/benchmarks/results.py NAME ...   # measure these again (all: every one)

A command keeps what it measures with ``--record NAME``, as ``results/NAME.json``; what the pages say of it is written
from there by ``python test/docs/generate.py``, and a test compares. Times are worth recording on a quiet machine only.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STORE = Path(__file__).resolve().parent / 'results'
DIGITS = 4
# Scripts of this name run several and keep each under its own name: there --record takes none.
COLLECTOR = 'run.py'


@dataclass(frozen=True)
class Record:
    """What one command measured.

    Attributes
    ----------
    command : str
        From the project's root, without ``--record``.
    date : str
        The day, 2026-11-23.
    machine : str
        Its kind: cores and processor.
    timed : bool
        Whether figures are times, which depend on the machine and on what else it does.
    figures : dict
        Names to numbers, in groups where the command has several.
    note : str
        What else to know.
    """

    command: str
    date: str
    machine: str
    timed: bool
    figures: dict[str, Any]
    note: str = ''

    @property
    def source(self) -> str:
        """For the end of a paragraph: command, day, and of times the machine."""
        told = [f'`{self.command}`', self.date]
        told += [self.machine] if self.timed else []
        told += [self.note] if self.note else []
        return ', '.join(told)


def add_record_option(parser: argparse.ArgumentParser) -> None:
    """Give a command its option ``--record``."""
    parser.add_argument('--record', metavar='NAME', help='keep the figures as results/NAME.json, which pages quote')


def keep(name: str, figures: Mapping[str, Any], timed: bool = False) -> None:
    """Write what the running command has measured.

    Parameters
    ----------
    name : str
        Of the file, without its end.
    figures : mapping
        As :class:`Record` has them; what is not finite is kept as None.
    timed : bool
        As :class:`Record` has it.
    """
    record = Record(
        _command(), time.strftime('%Y-%m-%d', time.gmtime()), machine_kind(), timed, _rounded(dict(figures))
    )
    STORE.mkdir(exist_ok=True)
    text = json.dumps(asdict(record), indent=1, ensure_ascii=False) + '\n'
    (STORE / f'{name}.json').write_text(text, encoding='utf-8')


def read(name: str) -> Record:
    """What was measured last under a name.

    Raises
    ------
    FileNotFoundError
    """
    return Record(**json.loads((STORE / f'{name}.json').read_text(encoding='utf-8')))


def figures_of(name: str) -> dict[str, Any]:
    """The figures of a name; none where nothing was measured."""
    return read(name).figures if (STORE / f'{name}.json').exists() else {}


def machine_kind() -> str:
    """Cores and processor, e.g. '2 cores of AMD EPYC'."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
        name = next((line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')), name)
    except OSError:
        pass
    return f'{os.cpu_count()} cores of {name}'


def _command() -> str:
    """The running command as one types it in the project's root."""
    script = Path(sys.argv[0]).resolve()
    path = str(script.relative_to(ROOT)) if script.is_relative_to(ROOT) else script.name
    words = sys.argv[1:]
    if '--record' in words:
        at = words.index('--record')
        del words[at : at + 1 + (script.name != COLLECTOR)]
    return shlex.join(['python', path, *words])


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    if hasattr(value, 'item'):
        value = value.item()
    if isinstance(value, float):
        return round(value, DIGITS) if math.isfinite(value) else None
    return value


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', metavar='NAME', help='measure again; all: every one')
    chosen = parser.parse_args(arguments).names
    names = sorted(path.stem for path in STORE.glob('*.json'))
    unknown = set(chosen) - {*names, 'all'}
    if unknown:
        parser.error(f'no record {min(unknown)!r}; there are {", ".join(names)}')
    if not chosen:
        for name in names:
            record = read(name)
            print(f'{name:<20} {record.date}  {record.command}')
        return 0
    failed = 0
    for name in names if 'all' in chosen else chosen:
        words = shlex.split(read(name).command)
        words += ['--record'] if words[1].endswith(COLLECTOR) else ['--record', name]
        print(shlex.join(words), flush=True)
        failed |= subprocess.run([sys.executable, *words[1:]], cwd=ROOT, check=False).returncode
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
