"""replay: find known objects in a recording, as fast as the machine goes, without ROS running.

replay recording/ part.csg -o poses.mcap
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from ...model.library import load_library
from .bag_reader import StereoBag, check_bag
from .mcap_file import McapFile


def replay_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='replay',
        description='Find known objects in every stereo pair of a bag, and write features and poses, each with the '
        'stamp of its images, as a file that ros2 bag and Foxglove open. Exit status 0: something was found, 1: '
        'nothing, 2: bad input.',
    )
    add = parser.add_argument
    add('bag', type=Path, help='folder of a rosbag2, a file .mcap or .db3, or a .bag of ROS 1')
    add('models', nargs='+', metavar='MODEL', help='.csg, .npz, mesh, or the name of a model of csg_renderer')
    add('-o', '--out', type=Path, metavar='FILE', help='a new file, .mcap (default: only say what was found)')
    add('--left', metavar='TOPIC', help='of left images (default: the topic that ends in left/image_rect)')
    add('--right', metavar='TOPIC', help='of right images; camera_info is taken from beside each')
    add('--raw', action='store_true', help='the images are raw: undistort and rectify them first')
    add('--inputs', action='store_true', help='copy images and camera_info into the file, too')
    add('--mesh-units', choices=MESH_UNITS, default=GUESS, help='unit of mesh files (default: guessed)')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    add_json(parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit status: 0 something was found, 1 nothing, 2 bad input."""
    return run_command('replay', _run, replay_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    from .replay import replay  # needs message classes, which the options do without

    if (options.left is None) != (options.right is None):
        raise ValueError('--left, --right: expected both, or none of them')
    images = () if options.left is None else (options.left, options.right)
    # Before the models are read, and before there is a progress bar.
    check_bag(options.bag)
    library = load_library(options.models, options.mesh_units)
    if library.problems or not library.models:
        raise ValueError('; '.join(library.problems) or f'{", ".join(options.models)}: no model')
    for name, unit in library.units.items():
        print(f'{name}: {unit}', file=sys.stderr)
    problems: dict[str, int] = {}

    def problem(text: str) -> None:
        problems[text] = problems.get(text, 0) + 1
        if problems[text] == 1:
            print(f'replay: {text}', file=sys.stderr)

    bag = StereoBag(options.bag, images, options.raw, problem)
    out = None if options.out is None else McapFile(options.out)
    try:
        replayed = replay(bag, library.models, out, options.inputs)
        results = list(tqdm(replayed, desc=options.bag.name, unit='', disable=options.quiet, file=sys.stderr))
    except BaseException:
        if out is not None:
            out.close()
            options.out.unlink()
        raise
    if out is not None:
        out.close()
    found = sum(bool(one.found) for one in results)
    spent = sum(one.milliseconds for one in results)
    print(
        f'{len(results)} pairs, something found in {found}, {spent / max(len(results), 1):.0f} ms a pair'
        + ('' if options.out is None else f'; wrote {options.out}')
    )
    if results and not found:
        print(f'nothing found: {results[-1].reason}', file=sys.stderr)
    record = {
        'pairs': [
            {
                'stamp_ns': one.pair.stamp_ns,
                'frame_id': one.pair.frame_id,
                'features': one.features,
                'found': [
                    {
                        'model': each.model,
                        'position': each.pose.translation,
                        'orientation_xyzw': each.pose.quaternion,
                        'covariance': each.covariance,
                    }
                    for each in one.found
                ],
            }
            for one in results
        ],
        'problems': problems,
        'out': options.out,
    }
    return (DONE if found else NOTHING), record


if __name__ == '__main__':
    raise SystemExit(main())
