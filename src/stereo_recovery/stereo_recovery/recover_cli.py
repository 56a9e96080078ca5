"""``recover left.png right.png calibration.yaml -o out/``: features, picture and table of a stereo pair of files.

Of three images and more, the calibration says where each camera stands. For "match", which draws over it, the folder
also gets the (rectified) left or first image and its camera.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py import CameraRig, FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command
from msgs_py.numeric.covariances import UPPER, upper_triangles
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray

from .cameras.rig_files import load_camera_rig
from .diagnosis import doubts, remedies
from .drawing import draw_features
from .pair_files import read_image, read_pair
from .params import DETECTORS, RecoveryParams
from .pipeline import Recovery, recover

COLUMNS = (
    'kind',
    'start x',
    'start y',
    'start z',
    'end x',
    'end y',
    'end z',
    'radius',
    'minor',
    'err along',
    'err across',
)
# Coordinates of both ends, in the order of the covariance's rows.
ENDS = ('sx', 'sy', 'sz', 'ex', 'ey', 'ez')
COVARIANCE_COLUMNS = tuple(f'cov {ENDS[a]} {ENDS[b]}' for a, b in zip(*UPPER))


def parser() -> argparse.ArgumentParser:
    """The command line's arguments."""
    default = RecoveryParams()
    result = CommandParser(
        prog='recover',
        description='Recover 3D edges, curves and axes from image files of two cameras or more. '
        'Exit status 0: features were found, 1: none, 2: bad input.',
    )
    result.add_argument('images', type=Path, nargs='+', help='left and right image, or one of each camera')
    result.add_argument(
        'calibration',
        type=Path,
        help='OpenCV YAML; ROS camera_info YAML of the left camera with the right one beside it; the JSON that "render '
        '--stereo --camera" writes; of more cameras also Kalibr\'s camchain, or "cameras", a list with K, R, t of each',
    )
    result.add_argument('-o', '--out', type=Path, default=Path('out'), help='folder for the results (default: out)')
    result.add_argument('--raw', action='store_true', help='the images are raw: undistort and rectify them first')
    result.add_argument(
        '--baseline', type=float, metavar='M', help='in metres, for a calibration in other units, or without one'
    )
    result.add_argument('--detector', choices=DETECTORS, default=default.detector)
    result.add_argument('--sigma', type=float, default=default.sigma, help='smoothing, pixels')
    result.add_argument('--time-limit', type=float, metavar='S', help='seconds; what would begin too late is left out')
    result.add_argument('--profile', action='store_true', help='run twice, and say what each stage takes when warm')
    result.add_argument('--min-length', type=float, default=default.min_length, help='shortest edge, pixels')
    add_json(result)
    return result


def table(features: FeatureSet) -> list[list[str]]:
    """The features as rows of text.

    Parameters
    ----------
    features : FeatureSet
        Left optical frame, metres.

    Returns
    -------
    list of list of str
        One cell for each of COLUMNS, lengths in millimetres. A curve's start is its centre, its end the unit normal,
        which
        is no length.
    """
    rows = []
    for i, kind in enumerate(features.kind):
        curve = kind == FeatureKind.CURVE
        end = features.directions[i] if curve else 1e3 * features.end[i]
        numbers = [*(1e3 * features.start[i]), *end]
        text = [f'{x:.3f}' for x in numbers]
        text += [f'{1e3 * r:.3f}' if np.isfinite(r) else '' for r in features.radii[i]]
        rows.append(
            [FeatureKind(kind).name, *text, f'{1e3 * features.err_par[i]:.3f}', f'{1e3 * features.err_per[i]:.3f}']
        )
    return rows


def covariance_table(features: FeatureSet) -> list[list[str]]:
    """Their covariances as rows of text: the upper triangles, empty where one is not known.

    Parameters
    ----------
    features : FeatureSet
        Left optical frame, metres.

    Returns
    -------
    list of list of str
        One cell for each of COVARIANCE_COLUMNS, in square millimetres; a curve's normal has no unit.
    """
    values = upper_triangles(features.transformed(Pose(scale=1e3)).covariance)
    return [[f'{x:.6g}' if np.isfinite(x) else '' for x in row] for row in values]


def profile(result: Recovery) -> list[str]:
    """What each stage took, what it made, and what was left out, a line each.

    Parameters
    ----------
    result : Recovery

    Returns
    -------
    list of str
    """
    total = sum(result.milliseconds.values())
    lines = [f'{name:<10} {ms:8.1f} ms {ms / max(total, NOT_ZERO):5.0%}' for name, ms in result.milliseconds.items()]
    lines += [f'{"all":<10} {total:8.1f} ms', *(f'{count} {name}' for name, count in result.counts.items())]
    return lines + [f'left out: {what}' for what in result.left_out]


def camera_record(rig: StereoRig | CameraRig) -> dict[str, object]:
    """The camera of left.png in the form of the renderer's files, which "match --camera" reads.

    Parameters
    ----------
    rig : StereoRig or CameraRig

    Returns
    -------
    dict
        width, height, K and, of a pair, baseline.
    """
    left = _first(rig)
    record = {
        'width': left.width,
        'height': left.height,
        'K': [[left.fx, 0.0, left.cx], [0.0, left.fy, left.cy], [0.0, 0.0, 1.0]],
    }
    return record | {'baseline': rig.baseline} if isinstance(rig, StereoRig) else record


def _first(rig: StereoRig | CameraRig) -> PinholeCamera:
    """The left or first camera."""
    return rig.left if isinstance(rig, StereoRig) else rig.cameras[0]


def run(arguments: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Recover features of the files and write the results.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of :func:`parser`.

    Returns
    -------
    int
        DONE when features were found, else NOTHING.
    dict
        What --json prints.

    Raises
    ------
    ValueError, OSError
        For unusable files.
    """
    params = RecoveryParams(
        detector=arguments.detector,
        sigma=arguments.sigma,
        min_length=arguments.min_length,
        time_limit=arguments.time_limit,
    )
    paths: list[Path] = arguments.images
    if len(paths) > 2:
        images = [read_image(path) for path in paths]
        cameras = _cameras(arguments, images)
        return _written(_found(arguments, images, cameras, params), images[0], cameras, arguments.out, [])
    if len(paths) < 2:
        raise ValueError(
            f'{paths[0]} {arguments.calibration}: expected a left and a right image, or one of each camera, before '
            'the calibration'
        )
    pair = read_pair((paths[0], paths[1]), arguments.calibration, arguments.raw, arguments.baseline)
    print(f'pair: {pair}')
    result = _found(arguments, pair.left, pair.right, pair.rig, params)
    hints = doubts(pair, params) + ([] if len(result.features) else remedies(pair, result, params))
    return _written(result, pair.left, pair.rig, arguments.out, hints)


def _found(arguments: argparse.Namespace, *given: Any) -> Recovery:
    """What :func:`recover` finds; with a profile, of its second run, printed."""
    result: Recovery = recover(*given)
    if arguments.profile:
        result = recover(*given)
        print('\n'.join(profile(result)))
    return result


def _cameras(arguments: argparse.Namespace, images: list[AnyArray]) -> CameraRig:
    """The cameras of three images and more."""
    for name, given in (('--raw', arguments.raw), ('--baseline', arguments.baseline is not None)):
        if given:
            raise ValueError(f'{name}: goes with two images; of more the calibration has to say all')
    cameras = load_camera_rig(arguments.calibration, (images[0].shape[1], images[0].shape[0]))
    if len(cameras) != len(images):
        raise ValueError(f'{arguments.calibration}: has {len(cameras)} cameras, for {len(images)} images')
    return cameras


def _written(
    result: Recovery, left: AnyArray, rig: StereoRig | CameraRig, out: Path, hints: list[str]
) -> tuple[int, dict[str, Any]]:
    """Write and print what was found; the exit code, and what --json prints."""
    if out.exists() and not out.is_dir():
        raise ValueError(f'{out}: a file; --out expects a folder, which may be a new one')
    out.mkdir(parents=True, exist_ok=True)
    result.features.save(out / 'features.npz')
    picture = draw_features(left, result.features, _first(rig))
    cv2.imwrite(str(out / 'features.png'), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    cv2.imwrite(str(out / 'left.png'), left)
    (out / 'camera.json').write_text(json.dumps(camera_record(rig), indent=2) + '\n', encoding='utf-8')
    rows = table(result.features)
    wide = [row + more for row, more in zip(rows, covariance_table(result.features))]
    with open(out / 'features.csv', 'w', encoding='utf-8') as file:
        file.writelines(','.join(row) + '\n' for row in [[*COLUMNS, *COVARIANCE_COLUMNS], *wide])
    for row in [list(COLUMNS), *rows]:
        print(' '.join(f'{cell:>10}' for cell in row))
    print(f'{result.features!r} in {sum(result.milliseconds.values()):.0f} ms; lengths in mm; written to {out}')
    for hint in hints:
        print(f'recover: {hint}', file=sys.stderr)
    if result.reason:
        print(f'nothing found: {result.reason}', file=sys.stderr)
    record = {
        'features': [dict(zip(_keys(), row)) for row in _numbers(result.features)],
        'reason': result.reason or None,
        'hints': hints,
        'milliseconds': result.milliseconds,
        'out': out,
    }
    return (NOTHING if result.reason else DONE), record


def _keys() -> tuple[str, ...]:
    """Names of what --json says of a feature; lengths in metres."""
    return ('kind', 'start', 'end', 'radii', 'err_along', 'err_across')


def _numbers(features: FeatureSet) -> list[tuple[Any, ...]]:
    """What --json says of each feature: kind, ends (of a curve, centre and normal), radii and errors, metres."""
    ends = np.where((features.kind == FeatureKind.CURVE)[:, None], features.directions, features.end)
    rows = zip(features.kind, features.start, ends, features.radii, features.err_par, features.err_per)
    return [(FeatureKind(int(kind)).name, *others) for kind, *others in rows]


def main(args: list[str] | None = None) -> int:
    """Console script. Exit code 0 when features were found, 1 when none, 2 for unusable arguments or files."""
    return run_command('recover', run, parser().parse_args(args))


if __name__ == '__main__':
    sys.exit(main())
