"""bop: answer scenes of the BOP benchmark, and write the file of results that its programs score.

bop ipd/val/000000 ipd/models -o result.csv
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from .answer import answer_scene, load_models
from .results import write_results
from .scene_folder import read_scene, read_targets


def bop_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='bop',
        description='Find the objects of BOP scenes of several cameras, or of one that moved, and write a BOP result '
        'file. Exit status 0: something was found, 1: nothing, 2: bad input.',
    )
    add = parser.add_argument
    add('scenes', nargs='+', type=Path, metavar='SCENE', help="folders of scenes, and the models' as the last one")
    add('-o', '--out', type=Path, default=Path('bop_result.csv'), metavar='FILE', help='default: bop_result.csv')
    add('--objects', type=int, nargs='+', metavar='ID', help='look for these (default: those annotated, else all)')
    add('--targets', type=Path, metavar='FILE', help='answer what this file asks for (test_targets_bop19.json, ...)')
    add('--views', type=int, default=3, metavar='N', help='of one camera, images that go together (default: 3)')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    add_json(parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit status: 0 something was found, 1 nothing, 2 bad input."""
    return run_command('bop', _run, bop_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    *folders, model_folder = options.scenes
    if not folders:
        raise ValueError(f'{model_folder}: expected folders of scenes and then that of the models')
    scenes = [read_scene(folder) for folder in folders]
    models = load_models(model_folder)
    targets = None if options.targets is None else read_targets(options.targets)
    results, images = [], 0
    for scene in scenes:
        asked = None if targets is None else targets.get(scene.number, {})
        answers = answer_scene(scene, models, options.objects, options.views, asked)
        total = len(scene.images[scene.cameras[0]] if asked is None else asked)
        for answer in tqdm(answers, scene.folder.name, total, unit='', disable=options.quiet, file=sys.stdout):
            results += answer
            images += 1
    write_results(options.out, results)
    print(f'{len(results)} poses in {images} images; wrote {options.out}')
    return (DONE if results else NOTHING), {'images': images, 'poses': len(results), 'out': options.out}


if __name__ == '__main__':
    raise SystemExit(main())
