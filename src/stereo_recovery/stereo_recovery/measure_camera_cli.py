"""``measure_camera first.png second.png``: noise and blur of a camera, from two pictures of one still scene."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from .camera_measurement import CameraMeasurement, measure_camera
from .pair_files import read_image
from .settings import GREEN_PIXELS


def measure_camera_parser() -> argparse.ArgumentParser:
    """The command line's arguments."""
    result = CommandParser(
        prog='measure_camera',
        description='Measure the noise and the blur of a camera from two pictures of one still scene, taken one after '
        'the other by a camera that nobody touches. Show surfaces of several shades of grey, and straight edges in '
        'focus that are a little slanted: a printed board, boxes. Grey levels are of 255, whatever the bits. '
        'Exit status 0: both are measured, 1: the pictures do not tell one of them, 2: bad input.',
    )
    result.add_argument('first', type=Path, help='a picture as the camera gives it: no JPEG, which smooths')
    result.add_argument('second', type=Path, help='the next one')
    result.add_argument('--bits', type=int, metavar='N', help='of the numbers of a picture of 16 bits (16)')
    result.add_argument(
        '--black-level', type=float, default=0.0, metavar='GREY', help='grey level where no light falls (0)'
    )
    result.add_argument(
        '--gamma', type=float, default=1.0, metavar='G', help='curve of the pictures; sRGB is nearly 2.2 (1: linear)'
    )
    result.add_argument('--bayer', choices=sorted(GREEN_PIXELS), default='', help='the pictures are mosaics of colours')
    result.add_argument(
        '-o', '--out', type=Path, metavar='FILE', help='write noise, read_noise, gain and psf as JSON, for plan_rig'
    )
    add_json(result)
    return result


def run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Measure; the exit code, and what --json prints. Raises OSError or ValueError for unusable files or options."""
    first, second = (read_image(path) for path in (options.first, options.second))
    try:
        found = measure_camera(first, second, options.bits, options.black_level, options.gamma, options.bayer)
    except ValueError as error:
        name, _, rest = str(error).partition(':')
        raise ValueError(f'{options.second if name == "second" else "--" + name.replace("_", "-")}:{rest}') from None
    for line in _lines(found, options):
        print(line)
    for reason in found.reasons:
        print(reason, file=sys.stderr)
    if options.out:
        options.out.write_text(json.dumps(found.record, indent=2) + '\n', encoding='utf-8')
        print(f'written: {options.out}')
    return (NOTHING if found.noise is None or found.psf is None else DONE), found.record


def _lines(found: CameraMeasurement, options: argparse.Namespace) -> list[str]:
    """What is printed."""
    lines, render = [], []
    if found.noise is not None and found.noise_error is not None:
        lines.append(f'noise: {found.noise:.2f} +- {found.noise_error:.2f} grey levels at mid grey')
    if found.gain is not None and found.read_noise is not None:
        electrons = ''
        if found.gain > 0.0:
            electrons = f'; white is {255.0 / found.gain:.0f} electrons, read noise {found.read_noise / found.gain:.1f}'
            render += [f'--full-well {255.0 / found.gain:.0f} --read-noise {found.read_noise / found.gain:.1f}']
        else:
            render += [f'--noise {found.read_noise:.2f}']
        lines.append(
            f'gain: {found.gain:.4f} grey levels an electron; read noise: {found.read_noise:.2f} grey levels{electrons}'
        )
    if found.psf is not None and found.psf_error is not None:
        lines.append(f'psf: {found.psf:.3f} +- {found.psf_error:.3f} pixels, from {found.edges} edges')
        render.insert(0, f'--psf {found.psf:.2f}')
    if render:
        render += [f'--black-level {options.black_level:g}'] if options.black_level else []
        render += [f'--gamma {options.gamma:g}'] if options.gamma != 1.0 else []
        lines.append('as options of "render": ' + ' '.join(render))
    return lines


def main(args: list[str] | None = None) -> int:
    """Console script. Exit code 0 when noise and blur are measured, 1 when one of them is not, 2 for bad input."""
    return run_command('measure_camera', run, measure_camera_parser().parse_args(args))


if __name__ == '__main__':
    sys.exit(main())
