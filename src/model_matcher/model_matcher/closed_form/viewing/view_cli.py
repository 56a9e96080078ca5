"""view: what was seen and found, in a browser: images with lines drawn over them, and a view in space that turns.

view part.csg left.png right.png calibration.yaml       # a pair, served on this machine
view part.csg recording/ -o page.html                   # a folder of pairs or a bag, as one file
view part.csg results.mcap                              # what replay or the nodes have recorded
view                                                    # live, from topics
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py import FeatureSet
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from ...match_cli import PAIR_FILES
from ...model.index import ModelIndex
from ...model.library import models_of
from ...viewing.moments import Moment
from ...viewing.page import check_page_name, page_of, plotly_script, write_page
from ...viewing.server import PageServer
from ...viewing.settings import PORT
from .view_files import moment_of, pair_moment, recorded_moments


def view_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='view',
        description='Show in a browser what is seen and found: live from topics without files; of a pair or a '
        'recording with them. Exit status 0: something was found, or the view was live; 1: nothing; 2: bad input.',
    )
    add = parser.add_argument
    add('model', nargs='?', help='.csg, .npz, mesh, a folder of them, or the name of a model of csg_renderer')
    add(
        'files',
        nargs='*',
        type=Path,
        metavar='FILE',
        help='left image, right image and calibration; or a folder of pairs, a bag (shown with the features and poses '
        'recorded in it, if there are any), or an .npz file of features',
    )
    add(
        '-o', '--out', type=Path, metavar='FILE', help='write the page, which needs nothing else, instead of serving it'
    )
    add('--port', type=int, default=PORT, help=f'to serve on, this machine only; 0: any (default: {PORT})')
    add('--raw', action='store_true', help='the images of a pair are raw: undistort and rectify them first')
    add('--baseline', type=float, metavar='M', help='in metres, for a calibration in other units, or without one')
    add('--mesh-units', choices=MESH_UNITS, default=GUESS, help='unit of a mesh file (default: guessed)')
    add('--camera', type=Path, metavar='FILE', help='calibration of a folder (default: camera.json in it)')
    add('--rate', type=float, default=30.0, metavar='HZ', help='frames a second, where nothing says (default: 30)')
    add('--every', type=int, default=1, metavar='N', help='of so many frames of a recording show one (default: 1)')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    add('--ros-args', nargs=argparse.REMAINDER, help='of a live view: remaps and parameters, as nodes take them')
    add_json(parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit status: 0 something was found, or the view was live; 1 nothing, 2 bad input."""
    return run_command('view', _run, view_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    if options.model is None:
        return _live(options), {}
    if options.ros_args is not None:
        raise ValueError('--ros-args: goes with a live view, which takes no files')
    if not options.files:
        raise ValueError(
            f'{options.model}: expected files to look at after the model (a pair with its calibration, a recording, '
            'or features); without model and files the view is live'
        )
    if options.out is not None:
        check_page_name(options.out)
    if options.every < 1 or not options.rate > 0.0:
        raise ValueError('--every, --rate: expected numbers above 0')
    models = models_of(options.model, options.mesh_units)
    # What cannot be drawn or served is said before the seconds that recovery takes.
    plotly_script()
    title = f'{options.model} in {options.files[0]}'
    with contextlib.ExitStack() as stack:
        server = None if options.out is not None else stack.enter_context(PageServer('', options.port))
        moments = _moments(models, options)
        found = sum(bool(one.placed) for one in moments)
        print(f'{found} of {len(moments)} moments with something found')
        record: dict[str, Any] = {'moments': len(moments), 'found': found}
        features = {model.name: model.features for model in models}
        if server is None:
            write_page(options.out, title, features, moments)
            print(f'wrote {options.out}')
            record['out'] = options.out
        else:
            server.page = page_of(title, features, moments)
            record['url'] = server.url
            print(f'open {server.url} (Ctrl-C ends)', flush=True)
            with contextlib.suppress(KeyboardInterrupt):
                threading.Event().wait()
    return (DONE if found else NOTHING), record


def _moments(models: Sequence[ModelIndex], options: argparse.Namespace) -> list[Moment]:
    """What the files hold. Raises OSError or ValueError."""
    files = options.files
    if len(files) == PAIR_FILES:
        moment, hints = pair_moment(options.model, models, files, options.raw, options.baseline)
        for hint in hints:
            print(f'view: {hint}', file=sys.stderr)
        return [moment]
    if len(files) != 1:
        names = ' '.join(map(str, files))
        raise ValueError(
            f'{names}: expected left image, right image and calibration, or one recording, after the model'
        )
    if files[0].suffix.lower() == '.npz':
        return [moment_of(models, FeatureSet.load(files[0]))]
    moments = recorded_moments(models, files[0], options.camera, options.rate, options.every)
    shown = list(tqdm(moments, desc=files[0].name, unit='', disable=options.quiet, file=sys.stdout))
    if not shown:
        raise ValueError(f'{files[0]}: holds no pair')
    return shown


def _live(options: argparse.Namespace) -> int:
    """Run the node; its exit status."""
    # Whoever looks at files needs no ROS.
    try:
        from ...viewer_node import main as run_viewer
    except ImportError as error:
        raise ValueError(f'a live view needs ROS ({error}); name a model and files to look at') from None
    return run_viewer(['--ros-args', '-p', f'port:={options.port}', *(options.ros_args or ())])


if __name__ == '__main__':
    raise SystemExit(main())
