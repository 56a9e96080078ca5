"""plan_rig: whether a part will be found in a working volume by a rig, how exactly, from where, with which others.

plan_rig part.csg --distance 300 500 --size 1280 1024 --lens 8 --chip 6.6 --baseline 80 -o plan
plan_rig part.csg --distance 300 500 --tilt 0 60 --clutter 5 --calibration camera.yaml --size 640 480 --noise 3
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from msgs_py import StereoRig
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, as_text, run_command
from stereo_recovery.cameras.calibration import load_rig

from ...batches.jobs import add_worker_options, workers_of
from ...batches.numbers import number, whole
from ..case import Limits
from .page import plan_page
from .plan import YES, Aims, carry_out
from .rig import PlannedRig, Sensor, read_sensor, rig_of_numbers
from .task import Task, files_of_part
from .volume import Volume

TILT = "angle between the part's up and the line of sight to the camera, degrees; 0: seen from above"
TURN = 'about the line of sight, degrees'
OUTLINE = 'what edges of the part are off in an image besides noise: tolerances, lenses; of the prediction only'
CALIBRATION = 'what calibration leaves the cameras off, as of check_rig; of the prediction only'
WALK = 'by which levels wander beside edges in a root of a pixel (print, grain: 1 to 8); of the prediction only'


def plan_parser() -> argparse.ArgumentParser:
    """Options in user's units: millimetres, degrees, pixels."""
    parser = CommandParser(
        prog='plan_rig',
        description='Tell whether a part will be found in a working volume by a pair of cameras, how exactly, from '
        'where, and what other cameras would do: predicted from what is visible, and tried on rendered pictures. Exit '
        'status 0: it will, 1: it will not, or too few pictures were tried to tell, 2: bad input.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add('part', help='scene file that draws it, or the name of a scene of csg_renderer (l_shape, ...)')
    add('-o', '--out', default='plan_out', help='folder for the page and the results; the same command goes on there')
    add('-q', '--quiet', action='store_true', help='no progress bar')

    add = parser.add_argument_group('working volume').add_argument
    add(
        '--distance',
        type=number(0.0, above=True),
        nargs=2,
        required=True,
        metavar=('NEAR', 'FAR'),
        help="of the part's middle from the cameras, mm",
    )
    add('--tilt', type=number(0.0, 180.0), nargs=2, default=(0.0, 180.0), metavar=('LEAST', 'MOST'), help=TILT)
    add('--turn', type=number(-180.0, 180.0), nargs=2, default=(-180.0, 180.0), metavar=('LEAST', 'MOST'), help=TURN)
    add('--up', type=float, nargs=3, default=(0.0, 0.0, 1.0), metavar=('X', 'Y', 'Z'), help="in the part's own frame")
    add('--at-once', type=whole(1), default=Volume.at_once, metavar='N', help='parts in one picture')
    add('--clutter', type=whole(0), default=Volume.clutter, metavar='N', help='further solids beside and behind them')

    add = parser.add_argument_group('cameras').add_argument
    add('--calibration', type=Path, metavar='FILE', help='as of "recover"; needs none of the next five but --size')
    add('--size', type=whole(1), nargs=2, metavar=('WIDTH', 'HEIGHT'), help='of an image, pixels')
    add('--focal', type=number(0.0, above=True), metavar='PX', help='focal length, pixels')
    add('--lens', type=number(0.0, above=True), metavar='MM', help='or: focal length, mm, with --chip')
    add('--chip', type=number(0.0, above=True), metavar='MM', help='width of the chip, mm')
    add('--baseline', type=number(0.0, above=True), metavar='MM', help='distance of the two cameras, mm')
    add(
        '--third', type=float, nargs=3, metavar=('X', 'Y', 'Z'), help='a third camera here in the frame of the left, mm'
    )
    add('--noise', type=number(0.0, 100.0), default=Sensor.noise, metavar='LEVELS', help='of a pixel, grey levels')
    add('--psf', type=number(0.0, 20.0), default=Sensor.psf, metavar='PX', help='blur of the lens, pixels')
    add('--camera-noise', type=Path, metavar='FILE', help='both as measure_camera wrote them, in place of the two')
    add('--outline-error', type=number(0.0, 10.0), default=0.0, metavar='PX', help=OUTLINE)
    add('--calibration-sigma', type=number(0.0, 10.0), default=0.0, metavar='PX', help=CALIBRATION)
    add('--walk', type=number(0.0, 100.0), default=PlannedRig.walk, metavar='GREY', help=WALK)

    add = parser.add_argument_group('judgement').add_argument
    add('--max-rotation-deg', type=number(0.0, above=True), default=Limits.rotation_deg, help='of a good pose')
    add('--max-translation-mm', type=number(0.0, above=True), default=1e3 * Limits.translation_m, help='of a good pose')
    add('--min-success', type=number(0.0, 1.0), default=Aims.recognised, help='share of parts with a good pose')
    add('--max-false', type=number(0.0, 1.0), default=Aims.false, help='share of pictures with a false alarm')

    running = parser.add_argument_group('running')
    add = running.add_argument
    add('--views', type=whole(1), default=200, help='into how many the volume is divided')
    add('--trials', type=whole(0), default=200, help='rendered pictures with the part')
    add('--empty', type=whole(0), default=100, help='rendered pictures without it')
    add('--antialias', type=whole(0), default=Task.antialias, help='samples along each side of a pixel')
    add('--seed', type=whole(0), default=Task.seed, help='of noise, clutter and further parts')
    add('--time-limit', type=number(0.0, above=True), default=Task.time_limit_s, help='of one search, seconds')
    add('--fresh', action='store_true', help='forget what the folder holds')
    add_worker_options(running, os.cpu_count() or 1)
    add_json(parser)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    arguments : list of str, optional
        ``sys.argv[1:]`` when not given.

    Returns
    -------
    int
        Exit status: 0 the part will be found, 1 it will not or that is not decided, 2 bad input.
    """
    return run_command('plan_rig', _run, plan_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    task = task_of(options)
    out = Path(options.out)
    aims = Aims(options.min_success, options.max_false)
    name = task.part.name  # a part that cannot be used is told before anything is written
    findings = carry_out(task, options.trials, options.empty, out, workers_of(options), options.fresh)
    record = findings.record(aims)
    (out / 'plan.json').write_text(json.dumps(json.loads(as_text(record)), indent=1) + '\n', encoding='utf-8')
    page = out / 'index.html'
    page.write_text(plan_page(findings, aims), encoding='utf-8')
    print(record['verdict'])
    print(f'{name}: parts found {findings.recognised}, false alarms {findings.false_alarms}; open {page}')
    return DONE if record['answer'] == YES else NOTHING, {**record, 'page': page}


def task_of(options: argparse.Namespace) -> Task:
    """What the options ask for. Raises OSError or ValueError, which names the option or the file."""
    sensor = read_sensor(options.camera_noise) if options.camera_noise else Sensor(options.noise, options.psf)
    third = None if options.third is None else 1e-3 * np.array(options.third)
    near, far = (1e-3 * one for one in options.distance)
    volume = Volume(
        near, far, tuple(options.tilt), tuple(options.turn), tuple(options.up), options.at_once, options.clutter
    )
    limits = Limits(options.max_rotation_deg, 1e-3 * options.max_translation_mm)
    rig = PlannedRig(_pair(options), third, sensor, options.outline_error, options.calibration_sigma, options.walk)
    return Task(
        files_of_part(options.part),
        rig,
        volume,
        limits,
        options.views,
        options.antialias,
        options.seed,
        options.time_limit,
    )


def _pair(options: argparse.Namespace) -> StereoRig:
    """The pair of a calibration or of numbers."""
    if options.calibration is not None:
        size = tuple(options.size) if options.size else (0, 0)
        pair = load_rig(options.calibration, size)
        if not options.baseline:
            return pair
        return StereoRig(pair.left, pair.right, 1e-3 * options.baseline)
    if options.lens is not None and options.focal is None:
        if options.chip is None or options.size is None:
            raise ValueError('--lens: a focal length in mm needs --chip, the width of the chip in mm, and --size')
        options.focal = options.lens / options.chip * options.size[0]
    for name in ('size', 'focal', 'baseline'):
        if getattr(options, name) is None:
            raise ValueError(
                f'--{name}: name the cameras: --calibration, or --size, --focal (or --lens) and --baseline'
            )
    return rig_of_numbers(tuple(options.size), options.focal, 1e-3 * options.baseline)
