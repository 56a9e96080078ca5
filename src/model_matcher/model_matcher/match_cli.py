"""match: find models in a stereo pair or in a file of recovered features, print what was found, draw it.

match part.csg left.png right.png calibration.yaml -o found.png
match part.csg features.npz -o found.png --image left.png --right right.png --camera left.json
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from csg_renderer.mesh.units import GUESS, MESH_UNITS
from msgs_py import FeatureSet, Interpretation, PinholeCamera, Pose, StereoRig
from msgs_py.commands import DONE, NOTHING, CommandParser, add_json, run_command
from msgs_py.files import check_image, read_json
from msgs_py.numeric.typed import ByteArray
from stereo_recovery.settings import PICTURES

from .catalogue.catalogue import Catalogue, open_catalogue
from .catalogue.store import is_index
from .drawing import draw_overlay, draw_views
from .geometry.settings import ROUNDING
from .image_pose.views import Views
from .model.library import Library, load_library, models_of, working_distance
from .pair_match import RecoveredPair, hints_of, recovered_pair
from .params import CONSTRAINTS, ENGINES, ORDERINGS, RANGES, REAL_BYTES, SCALES, SEARCHES, MatchParams, MatchResult
from .pipeline import survey

COLUMNS = ('model', 'matched', 'residual mm', 'x y z mm', 'turned deg about', 'signs', 'same', 'state')
# Left image, right image, calibration.
PAIR_FILES = 3
# Options that are fields of MatchParams, by type.
NUMBERS = {
    'fracdev': float,
    'curvedev': float,
    'max_cone_deg': float,
    'curve_cone_deg': float,
    'err_scale': float,
    'overhang': float,
    'min_matched': int,
    'max_bin': int,
    'quadrant': int,
    'max_interpretations': int,
    'false_alarm_rate': float,
}


def match_parser() -> argparse.ArgumentParser:
    """The options of the command; defaults are those of MatchParams."""
    parser = CommandParser(
        prog='match',
        description='Find models in a stereo pair, or among recovered features; print and draw the interpretations. '
        'Exit status 0: something was found, 1: nothing, 2: bad input.',
    )
    add = parser.add_argument
    add(
        'model',
        help='.csg, .npz, mesh, a folder of them, their index (of index_models), or the name of one of csg_renderer',
    )
    add(
        'files',
        nargs='+',
        type=Path,
        metavar='FILE',
        help='left image, right image and calibration, as "recover" takes them; or one .npz file of recovered features',
    )
    add('--raw', action='store_true', help='the images are raw: undistort and rectify them first')
    add('--baseline', type=float, metavar='M', help='in metres, for a calibration in other units, or without one')
    add('--mesh-units', choices=MESH_UNITS, default=GUESS, help='unit of a mesh file (default: guessed, and said)')
    add('-o', '--out', type=Path, metavar='FILE', help='draw data and found models into this picture')
    add('--rejected', type=int, default=3, metavar='N', help='rejected interpretations listed (default: 3)')
    add_json(parser)

    add = parser.add_argument_group(
        'camera of features from a file (drawn as two orthographic views without one)'
    ).add_argument
    add('--image', type=Path, help='left image, to draw over, and to look at with --right')
    add('--right', type=Path, help='right image: what both show of a model counts, and poses are measured in them')
    add('--camera', type=Path, metavar='JSON', help='camera file, as "render --camera" writes it')
    add('--focal', type=float, metavar='PX', help='focal length, principal point in the middle')
    add('--size', type=int, nargs=2, metavar=('WIDTH', 'HEIGHT'), help="pixels (default: the image's)")

    default = MatchParams()
    add = parser.add_argument_group('matching').add_argument
    for name, choices in (('search', SEARCHES), ('engine', ENGINES), ('ordering', ORDERINGS), ('scale', SCALES)):
        add(f'--{name}', choices=choices, default=getattr(default, name), help=f'default: {getattr(default, name)}')
    add('--constraints', nargs='+', choices=CONSTRAINTS, default=CONSTRAINTS, help='default: all')
    for name, kind in NUMBERS.items():
        value = getattr(default, name)
        add(
            '--' + name.replace('_', '-'),
            type=kind,
            default=value,
            help=f'default: {"any" if value is None else value}',
        )
    add('--seed', type=int, default=default.seed, help='deprecated: has no effect')
    add('--no-signs', action='store_true', help='leave direction signs out of the tree search')
    add('--no-eliminate', action='store_true', help='search the tree as the thesis does: leave nothing out beforehand')
    add(
        '--ranges', choices=RANGES, default=default.ranges, help=f"of the tree's constraints; default: {default.ranges}"
    )
    add('--real-bytes', type=int, choices=REAL_BYTES, default=default.real_bytes, help='word length, for --engine dap')
    add('--prove', action='store_true', help='certify that no larger interpretation exists, or none at all')
    seconds = default.time_limit_s
    add('--time-limit', type=float, default=seconds, metavar='S', help=f'of one search (default: {seconds:g})')
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit status: 0 something was found, 1 nothing, 2 bad input."""
    return run_command('match', _run, match_parser().parse_args(arguments))


class _Data(NamedTuple):
    """What is searched, what it is drawn over, and the pair that it was recovered from."""

    features: FeatureSet
    image: ByteArray | None
    camera: PinholeCamera | None
    views: Views | None
    recovered: RecoveredPair | None = None


def _run(options: argparse.Namespace) -> tuple[int, dict[str, Any]]:
    """Exit code and what --json prints; raises OSError or ValueError for bad input."""
    params = params_of(options)
    if options.out is not None and not options.out.suffix:
        raise ValueError(f'{options.out}: expected a file name of a picture, such as found.png')
    _check_files(options)
    # A model that cannot be read is said before the seconds that recovery takes.
    catalogue = _catalogue(options)
    if catalogue is None:
        models_of(options.model, options.mesh_units)
    data = _data(options)
    models = catalogue or _library(options, data.features).models
    result = survey(models, data.features, params, data.views)
    hints = [] if data.recovered is None else data.recovered.doubts()
    if not result and not isinstance(models, Catalogue):
        hints += hints_of(options.model, models, data.features, params, data.recovered)
    for hint in hints:
        print(f'match: {hint}', file=sys.stderr)
    print(table([*result.interpretations, *result.rejected[: max(options.rejected, 0)]]), end='')
    print(summary(result, len(data.features)))
    if options.out is not None:
        if isinstance(models, Catalogue):
            found = {one.model for one in result.interpretations}
            features = {name: models.feature_set(models.number(name)) for name in found}
        else:
            features = {model.name: model.features for model in models}
        if data.camera is not None:
            draw_overlay(options.out, data.features, features, result.interpretations, data.camera, data.image)
        else:
            draw_views(options.out, data.features, features, result.interpretations)
        print(f'wrote {options.out}')
    return (DONE if result else NOTHING), record(result, len(data.features), hints)


def _catalogue(options: argparse.Namespace) -> Catalogue | None:
    """The index of models, where one is given; raises OSError or ValueError."""
    if not is_index(options.model):
        return None
    catalogue = open_catalogue(options.model)
    if len(catalogue) == 0:
        raise ValueError(f'{options.model}: holds no model')
    return catalogue


def _library(options: argparse.Namespace, data: FeatureSet) -> Library:
    """The models, in the units that the distance of the data suggests; what is to be said of them is said."""
    library = load_library([options.model], options.mesh_units, working_distance(data))
    for name, unit in library.units.items():
        print(f'{name}: {unit}', file=sys.stderr if unit.guessed else sys.stdout)
    for problem in library.problems:
        print(f'match: {problem}', file=sys.stderr)
    return library


def _check_files(options: argparse.Namespace) -> None:
    """Refuse a wrong number of files, and options that go with others. Raises ValueError."""
    files = options.files
    names = ' '.join(map(str, files))
    if len(files) not in (1, PAIR_FILES) or (len(files) == 1 and files[0].suffix.lower() in PICTURES):
        raise ValueError(
            f'{names}: expected left image, right image and calibration, or one .npz file of features, after the model'
        )
    for name, given in (('--raw', options.raw), ('--baseline', options.baseline is not None)):
        if given and len(files) == 1:
            raise ValueError(f'{name}: goes with two images and a calibration; features from a file have theirs')
    for name in ('image', 'right', 'camera', 'focal', 'size'):
        if getattr(options, name) is not None and len(files) == PAIR_FILES:
            raise ValueError(f'--{name}: goes with a file of features; a pair of images has its own')


def _data(options: argparse.Namespace) -> _Data:
    """What the files hold. Raises OSError or ValueError."""
    if len(options.files) == PAIR_FILES:
        recovered = recovered_pair(options.files, options.raw, options.baseline)
        print(f'pair: {recovered.pair}; {len(recovered.features)} features recovered')
        camera = recovered.pair.rig.left
        return _Data(recovered.features, recovered.image, camera, recovered.views, recovered)
    features = FeatureSet.load(options.files[0])
    image = _image(options.image)
    return _Data(features, image, camera_of(options, image), views_of(options, image))


def record(result: MatchResult, n_data: int, hints: Sequence[str] = ()) -> dict[str, Any]:
    """What --json prints; lengths in metres, poses camera_T_model."""
    return {
        'found': [_record(one) for one in result.interpretations],
        'rejected': [_record(one) for one in result.rejected],
        'reason': result.reason,
        'hints': list(hints),
        'features': n_data,
        'seconds': result.stats.get('seconds'),
    }


def _place(pose: Pose) -> dict[str, Any]:
    return {'position': pose.translation, 'orientation_xyzw': pose.quaternion}


def _record(one: Interpretation) -> dict[str, Any]:
    return {
        'model': one.model,
        **_place(one.pose),
        'scale': one.pose.scale,
        'covariance': one.covariance,
        'matched': one.matched,
        'residual': one.residual_rms,
        'evidence': one.evidence,
        'support': one.support,
        'symmetric_poses': [_place(pose) for pose in one.symmetric_poses],
        'ambiguous_poses': [_place(pose) for pose in one.ambiguous_poses],
        'proven': one.proven,
        'rejected_reason': one.rejected_reason,
    }


def params_of(options: argparse.Namespace) -> MatchParams:
    """The match parameters that the options give. Raises ValueError naming the parameter."""
    values = {name: getattr(options, name) for name in NUMBERS}
    return MatchParams(
        search=options.search,
        engine=options.engine,
        ordering=options.ordering,
        scale=options.scale,
        constraints=tuple(options.constraints),
        signs=not options.no_signs,
        eliminate=not options.no_eliminate,
        ranges=options.ranges,
        real_bytes=options.real_bytes,
        prove=options.prove,
        time_limit_s=options.time_limit,
        seed=options.seed,
        **values,
    )


def camera_of(options: argparse.Namespace, image: ByteArray | None) -> PinholeCamera | None:
    """The camera of --camera, or of --focal and a size; None when neither is given. Raises ValueError."""
    if options.camera is not None and options.focal is not None:
        raise ValueError('--focal: not together with --camera')
    if options.camera is not None:
        return load_camera(options.camera)
    if options.focal is None:
        if image is not None:
            raise ValueError('--image: needs --camera or --focal to draw over it')
        return None
    size = options.size or (None if image is None else (image.shape[1], image.shape[0]))
    if size is None:
        raise ValueError('--focal: needs --size or --image')
    return PinholeCamera.centred(size[0], size[1], options.focal)


def views_of(options: argparse.Namespace, image: ByteArray | None) -> Views | None:
    """The pair of --image and --right with the rig of --camera; None without --right. Raises ValueError."""
    if options.right is None:
        return None
    if image is None or options.camera is None:
        raise ValueError('--right: needs --image and --camera')
    right = _image(options.right)
    assert right is not None
    camera = load_camera(options.camera)
    try:
        baseline = float(read_json(options.camera)['baseline'])
    except (KeyError, TypeError, ValueError):
        raise ValueError(f'{options.camera}: has no baseline, which --right needs') from None
    pair = [cv2.cvtColor(one, cv2.COLOR_BGR2GRAY) for one in (image, right)]
    return Views.of([np.asarray(one, np.uint8) for one in pair], StereoRig.symmetric(camera, baseline))


def load_camera(path: Path) -> PinholeCamera:
    """A camera file with K, width and height. Raises ValueError, naming file and field."""
    try:
        record = read_json(path)
        matrix = np.asarray(record['K'], dtype=float).reshape(3, 3)
        return PinholeCamera(record['width'], record['height'], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    except KeyError as error:
        raise ValueError(f'{path}: not a camera file: no field {error}') from None
    except (TypeError, ValueError) as error:
        raise ValueError(f'{path}: not a camera file: {error}') from None


def table(items: Sequence[Interpretation]) -> str:
    """One line an interpretation, columns aligned; nothing without interpretations."""
    if not items:
        return ''
    lines = [COLUMNS, *(_cells(item) for item in items)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(COLUMNS))]
    return ''.join('  '.join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() + '\n' for line in lines)


def _cells(item: Interpretation) -> tuple[str, ...]:
    """The cells of one line of the table, in the order of COLUMNS."""
    vector = item.pose.rotation_vector
    angle = float(np.linalg.norm(vector))
    # A turn of no more than rounding has no axis; z is printed.
    axis = vector / angle if angle > ROUNDING else np.array([0.0, 0.0, 1.0])
    signs = item.sign[item.data_indices]
    counts = f'+{int((signs > 0).sum())} -{int((signs < 0).sum())}'
    if (signs == 0).any():
        counts += f' ?{int((signs == 0).sum())}'
    state = f'rejected: {item.rejected_reason}' if item.rejected_reason else 'proven' if item.proven else 'accepted'
    return (
        item.model,
        f'{item.matched}/{len(item.assignment)}',
        f'{1e3 * item.residual_rms:.3f}',
        ' '.join(f'{1e3 * value:.2f}' for value in item.pose.translation),
        f'{np.degrees(angle):.2f} ({" ".join(f"{value:.3f}" for value in axis)})',
        counts,
        str(len(item.symmetric_poses)),
        state,
    )


def summary(result: MatchResult, n_data: int) -> str:
    """One line: how many were found, how much of n_data features they explain, and how long it took."""
    found = len(result.interpretations)
    head = f'{found} found' if found else f'nothing found: {result.reason}'
    explained = sum(item.matched for item in result.interpretations)
    seconds = float(result.stats.get('seconds', 0.0))
    best = result.best
    free = ''
    if best is not None and best.free_shift is not None:
        free = f'; all parallel: free to shift along ({" ".join(f"{value:.3f}" for value in best.free_shift)})'
    if best is not None and best.free_turn is not None:
        free += f'; {best.note}, ({" ".join(f"{value:.3f}" for value in best.free_turn)})'
    if best is not None and best.ambiguous_poses:
        free += f'; poses that what is seen does not tell apart: {1 + len(best.ambiguous_poses)}'
    return f'{head}; {explained} of {n_data} features explained{free}; {1e3 * seconds:.1f} ms'


def _image(path: Path | None) -> ByteArray | None:
    """The image of a file, (h, w, 3) uint8 blue, green, red. Raises ValueError for an unreadable file."""
    if path is None:
        return None
    image = cv2.imread(str(check_image(path)), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f'{path}: not a readable image')
    return np.asarray(image, np.uint8)
