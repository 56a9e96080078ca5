"""index_models: make or update the index of a folder of models, which match and matcher_node take in its place.

index_models parts/ && match parts/models.index left.png right.png calibration.yaml
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from .catalogue.folder import Progress, update_catalogue
from .catalogue.settings import FILE_NAME


def index_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='index_models',
        description='Make the index of a folder of models, or bring it up to date: what has not changed is not read '
        'again. Exit status 0: done, 1: the folder holds no model that can be used, 2: bad input.',
    )
    add = parser.add_argument
    add('folder', type=Path, help='models (.csg, .npz, .stl, .obj, .ply, .off) in it and in folders below')
    add('-o', '--out', type=Path, metavar='INDEX', help=f'file of the index (default: {FILE_NAME} in the folder)')
    add('--mesh-units', choices=MESH_UNITS, default=GUESS, help='unit of mesh files (default: guessed, and said)')
    add('--workers', type=int, default=1, metavar='N', help='processes on this machine that read files (default: 1)')
    add('--dask', metavar='ADDRESS', help='dask scheduler to read the files on; "local" starts one here')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    add_json(parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; an error of the input goes to stderr as one line.

    Parameters
    ----------
    arguments : sequence of str, optional
        ``sys.argv[1:]`` when not given.

    Returns
    -------
    int
        Exit status: 0 done, 1 no model that can be used, 2 bad input.
    """
    return run_command('index_models', _run, index_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints; raises OSError or ValueError for bad input."""
    if options.workers < 1:
        raise ValueError(f'--workers: expected a number from 1 on, got {options.workers}')
    if not options.folder.is_dir():
        raise ValueError(f'{options.folder}: no such folder')
    index = options.out or options.folder / FILE_NAME
    started = time.perf_counter()
    with tqdm(unit='', disable=options.quiet, file=sys.stderr) as bar:
        done = update_catalogue(
            options.folder, index, options.mesh_units, options.workers, options.dask, _progress(bar)
        )
    for note in done.notes:
        print(note)
    for problem in done.problems:
        print(f'index_models: {problem}', file=sys.stderr)
    seconds = time.perf_counter() - started
    size = index.stat().st_size
    print(
        f'{index}: {done.models} models of {done.files} files ({done.read} read, {done.kept} unchanged, '
        f'{done.removed} gone), {size / 1e6:.1f} MB, {seconds:.1f} s'
    )
    record = {'index': index, 'bytes': size, 'seconds': seconds, **done._asdict()}
    return (DONE if done.models else NOTHING), record


def _progress(bar: Any) -> Progress:
    """Progress on a bar, which begins anew with each thing that is done."""
    state: dict[str, Any] = {'what': '', 'done': 0}

    def report(what: str, done: int, total: int) -> None:
        if what != state['what']:
            bar.reset(total)
            bar.set_description(what)
            state.update(what=what, done=0)
        bar.update(done - state['done'])
        state['done'] = done

    return report


if __name__ == '__main__':
    raise SystemExit(main())
