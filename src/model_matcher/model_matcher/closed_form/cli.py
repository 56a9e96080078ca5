"""Closed-form testing (thesis 4.12): render scenes whose answer is known, run the system on them, compare every stage.

``ros2 run model_matcher closed_form SCENE...`` or ``python -m model_matcher.closed_form SCENE...``. For each scene all
nodes run in one process on a real executor, over real topics; the result is a folder with ``report.html`` and
``result.json``. With ``--sweep`` many poses of each scene's object are tried, through the libraries (or, with
``--nodes``, the graph), in ``--workers`` processes or on a dask cluster; failing cases are saved, and ``--replay`` runs
one again. With ``--path`` the object moves: a folder of stereo pairs with their true poses is written and, with
``--nodes``, played to recovery_node and matcher_node. The exit status is 0 when enough cases were recognised within
the limits.

This module is the command line; :mod:`~model_matcher.closed_form.commands` does what the options ask for.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from msgs_py.commands import CommandParser, add_json, run_command

from ..batches.numbers import number, whole
from .case import Case, Limits
from .commands import run
from .sequences.motion import PATHS, Motion


def main(args: list[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    args : list of str, optional
        The arguments, ``sys.argv[1:]`` when not given.

    Returns
    -------
    int
        Exit status: 0 enough recognised, 1 too few, 2 bad input.
    """
    parser = closed_form_parser()
    options = parser.parse_args(args)
    if not (options.scenes or options.demo or options.replay):
        parser.error('name at least one scene, or use --demo DIR or --replay FOLDER')
    if options.path and (options.sweep or options.replay or options.demo):
        parser.error('--path: a sequence is made on its own, without --sweep, --replay and --demo')

    def command(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
        """Exit code and what --json prints."""
        out = Path(options.demo or options.out)
        return run(options, parser.error), {'out': out, 'results': sorted(out.glob('*/result.json'))}

    return run_command('closed_form', command, options)


def closed_form_parser() -> argparse.ArgumentParser:
    """Options in user's units: millimetres, degrees, pixels."""
    parser = CommandParser(
        prog='closed_form',
        description='Render, recover, match, and compare with the truth.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add('scenes', nargs='*', help='scene files, or names of scenes of csg_renderer (l_shape_v1, ...)')
    add('-o', '--out', default='closed_form_out', help='folder for the results')
    add('--demo', metavar='DIR', help='run the demonstration (two scenes, one real pair, a part that turns) into DIR')
    add('-q', '--quiet', action='store_true', help='no progress bar')

    add = parser.add_argument_group('images').add_argument
    add('--size', type=whole(1), nargs=2, metavar=('WIDTH', 'HEIGHT'), help='image size, pixels')
    add('--focal', type=number(0.0, above=True), help='focal length, pixels')
    add('--baseline', type=number(0.0, above=True), metavar='MM', help='distance of the eyes, mm')
    add('--antialias', type=whole(0), default=Case.antialias, help='samples along each side of a pixel')
    add('--psf', type=number(0.0, 20.0), default=Case.psf, help='blur of the sensor, pixels')
    add('--noise', type=number(0.0, 100.0), default=Case.noise, help='noise of the sensor, grey levels')
    add(
        '--camera',
        nargs='+',
        default=[],
        metavar='NAME=VALUE',
        help='what else the camera does: parameters of renderer_node, as full_well=9000 or distortion=-0.3,0.1,0,0,0',
    )
    add('--seed', type=whole(0), default=Case.seed, help='seed of noise, clutter and random poses')

    add = parser.add_argument_group('pose and surroundings').add_argument
    add(
        '--pose',
        type=float,
        nargs=6,
        metavar=('XROT', 'YROT', 'ZROT', 'X', 'Y', 'Z'),
        help='of the object: degrees, applied in this order, and mm',
    )
    add('--sweep', choices=('grid', 'random', 'turntable'), help='many poses of the object')
    add('--count', type=whole(1), default=36, help='poses of a sweep')
    add('--distance', type=number(0.0, above=True), metavar='MM', help='of the object in a sweep')
    add('--clutter', type=whole(0), default=Case.clutter, help='further solids beside and behind the object')

    add = parser.add_argument_group('sequences').add_argument
    add('--path', choices=PATHS, help='a sequence of the moving object: pictures and true poses, into a folder')
    add('--frames', type=whole(1), default=Motion.frames, help='of a sequence')
    add('--rate', type=number(0.0, above=True), default=Motion.rate_hz, help='frames a second')
    add('--turn', type=number(0.0), default=Motion.turn_deg_s, help='how fast the object turns, degrees a second')
    add('--shift', type=number(0.0), default=1e3 * Motion.shift_m_s, help='how fast it moves, mm a second')
    add('--exposure', type=number(0.0, 1.0), default=Motion.exposure, help='share of the time the shutter is open')
    add('--occluders', type=whole(0), default=Motion.occluders, help='bars that pass in front')
    add('--occlusion', type=number(0.0, 10.0), default=Motion.occlusion, help='width of a bar, in widths of the object')
    add('--jump', type=whole(0), default=Motion.jump, metavar='FRAME', help='a sudden move of 20 mm and 5 deg')

    add = parser.add_argument_group('running').add_argument
    add('--nodes', action='store_true', help='sweep, replay or sequence through the real nodes')
    add('--workers', type=whole(1), default=1, help='processes on this machine')
    add('--dask', metavar='ADDRESS', help='dask scheduler to run the cases on; "local" starts one here')
    add('--time-limit', type=number(0.0, above=True), default=Case.time_limit_s, help='of one search, seconds')
    add('--reports', action='store_true', help='a page for every case of a sweep, not only for failing ones')
    add('--replay', metavar='FOLDER', help='run a saved case again')

    add = parser.add_argument_group('judgement').add_argument
    add('--max-rotation-deg', type=number(0.0), default=Limits.rotation_deg, help='limit of a pass')
    add('--max-translation-mm', type=number(0.0), default=1e3 * Limits.translation_m, help='limit of a pass')
    add('--min-success', type=number(0.0, 1.0), default=1.0, help='share of passes for exit status 0')
    add_json(parser)
    return parser
