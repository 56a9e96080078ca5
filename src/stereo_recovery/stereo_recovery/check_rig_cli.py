"""``check_rig left.png right.png calibration.yaml``: whether a stereo camera is still as it was calibrated."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from .matching.settings import CALIBRATION_ROW_SIGMA
from .pair_files import read_pair
from .rig_check import check_rig


def check_rig_parser() -> argparse.ArgumentParser:
    """The command line's arguments."""
    result = CommandParser(
        prog='check_rig',
        description='Tell from one pair of any scene whether the right camera has turned since the calibration, and by '
        'how much. Exit status 0: it has not, 1: it has, or the pair does not tell, 2: bad input.',
    )
    result.add_argument('left', type=Path, help='left image; the more edges and texture all over it, the better')
    result.add_argument('right', type=Path, help='right image')
    result.add_argument('calibration', type=Path, help='as of "recover"')
    result.add_argument('--raw', action='store_true', help='the images are raw: undistort and rectify them first')
    result.add_argument(
        '--baseline', type=float, metavar='M', help='in metres, for a calibration in other units, or without one'
    )
    result.add_argument(
        '--calibration-sigma',
        type=float,
        default=CALIBRATION_ROW_SIGMA,
        metavar='PX',
        help='what the calibration left the rows off by, as its program reported (default: %(default)s)',
    )
    add_json(result)
    return result


def run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Check a rig; the exit code, and what --json prints (radians). Raises OSError or ValueError for unusable files."""
    if not options.calibration_sigma >= 0.0:
        raise ValueError(f'--calibration-sigma: expected pixels, 0 or more, got {options.calibration_sigma:g}')
    pair = read_pair((options.left, options.right), options.calibration, options.raw, options.baseline)
    print(f'pair: {pair}')
    error, reason = check_rig(pair.left, pair.right, pair.rig)
    if error is None:
        print(f'the pair does not tell: {reason}', file=sys.stderr)
        return NOTHING, {'drifted': None, 'reason': reason}
    drifted = error.has_drifted(options.calibration_sigma) if error.tells else None
    print(error.verdict(options.calibration_sigma))
    if drifted:
        print('calibrate the pair again, and see that its cameras are fixed to each other')
    record = {
        'drifted': drifted,
        'rotation': error.rotation,
        'sigma': error.sigma,
        'distance': error.distance(options.calibration_sigma),
        'rows_off_middle_px': error.offset_px,
        'rows_off_most_px': error.most_px,
        'row_sigma_px': error.row_sigma,
        'seen': error.count,
        'reason': None if error.tells else error.verdict(),
    }
    return (DONE if drifted is False else NOTHING), record


def main(args: list[str] | None = None) -> int:
    """Console script. Exit code 0 for a rig in order, 1 when it has drifted or nothing tells, 2 for bad input."""
    return run_command('check_rig', run, check_rig_parser().parse_args(args))


if __name__ == '__main__':
    sys.exit(main())
