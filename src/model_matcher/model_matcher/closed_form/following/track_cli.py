"""track: follow a known object through a folder of pictures or a bag; poses, a film and a plot.

track sequence/ part.csg -o followed
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py import Pose
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command

from ...model.index import ModelIndex
from ...model.library import models_of
from ..bop.results import BopResult, write_results
from ..poses import pose_from_angles
from .follow import FollowedFrame, follow
from .picture_frames import picture_frames
from .track_film import draw_followed, plot_followed, write_film

COLUMNS = (
    *('frame', 'stamp_s', 'state', 'x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw'),
    *('sigma_m', 'sigma_deg', 'support', 'evidence', 'milliseconds'),
)


def track_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = CommandParser(
        prog='track',
        description='Find an object and follow it from frame to frame. '
        'Exit status 0: it was followed in half of the frames or more, 1: in fewer, 2: bad input.',
    )
    add = parser.add_argument
    add('frames', type=Path, help='folder of pictures (pairs named left and right, or of one camera), or a rosbag2')
    add('model', help='.csg file, mesh, or the name of a model of csg_renderer')
    add('--mesh-units', choices=MESH_UNITS, default=GUESS, help='unit of a mesh file (default: guessed)')
    add('-o', '--out', type=Path, default=Path('followed'), metavar='DIR', help='folder for the results')
    add('--camera', type=Path, metavar='FILE', help='calibration of the pictures (default: camera.json beside them)')
    add('--rate', type=float, default=30.0, metavar='HZ', help='frames a second, where nothing says (default: 30)')
    add(
        '--start',
        type=float,
        nargs=6,
        metavar=('XROT', 'YROT', 'ZROT', 'X', 'Y', 'Z'),
        help='pose in the first frame: degrees, applied in this order, and mm; needed for one camera',
    )
    add('--film', default='film.mp4', metavar='NAME', help='.mp4, .avi, or .png, animated (default: film.mp4)')
    add('--scale', type=float, default=1.0, help='size of the film')
    add('-q', '--quiet', action='store_true', help='no progress bar')
    add_json(parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit status: 0 followed, 1 hardly ever, 2 bad input."""
    return run_command('track', _run, track_parser().parse_args(arguments))


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints. Raises OSError or ValueError."""
    frames = _followed(options)
    write_followed(options.out, frames, options.film, options.scale)
    print(f'{summary(frames)}; wrote {options.out}/')
    poses = [
        {'stamp': one.frame.stamp_s}
        | ({} if one.pose is None else {'position': one.pose.translation, 'orientation_xyzw': one.pose.quaternion})
        for one in frames
    ]
    followed = sum(one.pose is not None for one in frames)
    return (DONE if 2 * followed >= len(frames) else NOTHING), {
        'frames': poses,
        'followed': followed,
        'out': options.out,
    }


def _followed(options: argparse.Namespace) -> list[FollowedFrame]:
    model = load_solid(options.model, options.mesh_units)
    if not (options.rate > 0.0 and options.scale > 0.0):
        raise ValueError('--rate, --scale: expected numbers above 0')
    start = None
    if options.start is not None:
        start = Pose.from_matrix(np.reshape(pose_from_angles(options.start), (4, 4)))
    source = picture_frames(options.frames, options.camera, options.rate)
    return list(tqdm(follow(model, source, start), desc=model.name, unit='', disable=options.quiet, file=sys.stdout))


def load_solid(given: str, mesh_units: str = GUESS) -> ModelIndex:
    """The first model of a file; raises ValueError when there is none."""
    return models_of(given, mesh_units)[0]


def summary(frames: Sequence[FollowedFrame]) -> str:
    """One line: how many frames, in how many it was followed, and how long one took."""
    held = sum(one.pose is not None for one in frames)
    times = [one.milliseconds for one in frames if not one.found_anew and one.pose is not None]
    spent = f', {np.median(times):.1f} ms a frame' if times else ''
    return f'{len(frames)} frames, followed in {held}{spent}'


def write_followed(folder: Path, frames: Sequence[FollowedFrame], film: str = 'film.mp4', scale: float = 1.0) -> None:
    """Write poses.csv, poses.tum (stamp x y z qx qy qz qw), poses_bop.csv, the film and plot.png.

    In BOP's file frames are images of scene 1 and the model is object 1; a score is the share of the outline that is
    seen.

    Raises
    ------
    ValueError
        There are no frames, or the film cannot be written.
    """
    if not frames:
        raise ValueError('there are no frames')
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    with (folder / 'poses.csv').open('w', newline='', encoding='utf-8') as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for number, one in enumerate(frames):
            table.writerow([number, f'{one.frame.stamp_s:.6f}', *_cells(one), f'{one.milliseconds:.3f}'])
            if one.pose is not None:
                numbers = (*one.pose.translation, *one.pose.quaternion)
                lines.append(f'{one.frame.stamp_s:.6f} {" ".join(f"{value:.9f}" for value in numbers)}\n')
    (folder / 'poses.tum').write_text(''.join(lines), encoding='utf-8')
    write_results(
        folder / 'poses_bop.csv',
        (
            BopResult(1, number, 1, one.tracked.presence.support, one.pose, 1e-3 * one.milliseconds)
            for number, one in enumerate(frames)
            if one.tracked is not None and one.pose is not None
        ),
    )
    stamps = [one.frame.stamp_s for one in frames]
    rate = (len(stamps) - 1) / (stamps[-1] - stamps[0]) if stamps[-1] > stamps[0] else 30.0
    write_film(folder / film, [draw_followed(one, scale) for one in frames], rate)
    plot_followed(folder / 'plot.png', frames)


def _cells(one: FollowedFrame) -> list[str]:
    """State, pose, sigmas, support and evidence of a frame."""
    if one.tracked is None or one.pose is None:
        return ['lost', *[''] * 11]
    shift, turn = np.split(np.sqrt(np.maximum(np.diag(one.tracked.covariance), 0.0)), 2)
    return [
        'found' if one.found_anew else 'followed',
        *(f'{value:.9f}' for value in (*one.pose.translation, *one.pose.quaternion)),
        f'{np.linalg.norm(shift):.3e}',
        f'{np.degrees(np.linalg.norm(turn)):.3e}',
        f'{one.tracked.presence.support:.4f}',
        f'{one.tracked.presence.log_ratio:.2f}',
    ]
