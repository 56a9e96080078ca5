"""From images to poses beyond the thesis: sampling, baseline, depth, stated covariance, real pairs."""

from __future__ import annotations

import json
import os
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from lab import (
    ANTIALIAS,
    NOISE,
    PSF,
    Experiment,
    Line,
    NotAvailable,
    Outcome,
    Plot,
    Setting,
    Table,
    average,
    geometric_mean,
    stereo_images,
    view,
    within,
)
from scipy import stats
from scipy.spatial.transform import Rotation

from csg_renderer import Scene, render_stereo
from csg_renderer.raycast.sensor import grey
from model_matcher import MatchParams, index_model, match
from model_matcher.closed_form.comparison import squared_deviation
from model_matcher.closed_form.synthetic.scenes import MODELS, make_scene, measured, random_pose
from msgs_py import FeatureSet, Interpretation, PinholeCamera, Pose, StereoRig
from stereo_recovery import recover

VIEWS = ('l_shape_v1', 'chipped_block_v1')
# The limit is computed from images sampled finely, so that sampling adds nothing to it.
FINE = 8
ROUNDING_VARIANCE = 1.0 / 12.0


def moved(pose: Pose, about: np.ndarray, step: np.ndarray) -> Pose:
    """pose followed by a shift step[:3] and a rotation vector step[3:] about the point ``about``, camera frame."""
    turn = Pose.from_rotation_vector(step[3:])
    return Pose(turn.rotation, about - turn.rotation @ about + step[:3]).compose(pose)


def physical_limit(
    scene: Scene,
    rig: StereoRig,
    left_T_scene: Pose,
    origin: np.ndarray,
    noise: float = NOISE,
    psf: float = PSF,
    fine: int = FINE,
) -> np.ndarray:
    """(6, 6) Cramer-Rao bound of (x, y, z, rx, ry, rz), metres and radians: no unbiased estimator that knows the whole
    appearance of the scene can do better from these two images with this noise.

    origin : (3,) the model's origin, camera frame, about which the rotation turns. Derivatives are central differences
    of about half a pixel.
    """
    depth = max(float(origin[2]), 1e-3)
    pixel = depth / rig.left.fx
    steps = np.array([0.5 * pixel] * 2 + [0.1 * depth * pixel / rig.baseline] + [0.5 * pixel / (0.2 * depth)] * 3)
    columns = []
    for k in range(6):
        sides = []
        for sign in (1.0, -1.0):
            step = np.zeros(6)
            step[k] = sign * steps[k]
            frames = render_stereo(scene, rig, moved(left_T_scene, origin, step), antialias=fine)
            sides.append(np.concatenate([cv2.GaussianBlur(grey(f.image), (0, 0), psf).ravel() for f in frames]))
        columns.append((sides[0] - sides[1]) / (2.0 * steps[k]))
    jacobian = np.stack(columns)
    return np.linalg.inv(jacobian @ jacobian.T / (noise**2 + ROUNDING_VARIANCE))


def trial(
    name: str,
    seed: int,
    rig: StereoRig | None = None,
    depth: float = 1.0,
    antialias: int = ANTIALIAS,
    noise: float = NOISE,
) -> tuple[Pose, Interpretation | None, StereoRig, Pose]:
    """One pair of a view, at a pose jittered by the seed: true pose, answer, rig, left_T_scene."""
    this = view(name)
    rig = rig or this.rig
    rng = np.random.default_rng([seed, 41])
    origin = this.pose.translation
    step = np.concatenate([rng.uniform(-1.5e-3, 1.5e-3, 3), np.radians(rng.uniform(-2.0, 2.0, 3))])
    step[:3] += (depth - 1.0) * origin
    left_T_scene = moved(this.scene.camera_T_scene, origin, step)
    truth = moved(this.pose, origin, step)
    data = recover(*stereo_images(this.scene, rig, seed, antialias, PSF, noise, left_T_scene), rig).features
    result = match(index_model(this.features, this.model), data)
    return truth, result.best, rig, left_T_scene


def error_vector(found: Interpretation, truth: Pose) -> np.ndarray:
    """(6,) of the pose nearest to the truth among equals: metres, radians, camera frame."""
    pose = min((found.pose, *found.symmetric_poses), key=lambda p: p.error_to(truth).rotation)
    turn = Rotation.from_matrix(pose.rotation @ truth.rotation.T).as_rotvec()
    return np.concatenate([pose.translation - truth.translation, turn])


def sweep(setting: Setting, what: str, values: list, title: str, **of_value: Any) -> tuple[list[Table], list[Plot]]:
    """Median errors and their physical limit over one varied quantity; of_value maps a value to trial arguments."""
    seeds = setting.pick(16, 1)
    tables = {
        name: Table(
            f'{title}, {name}',
            [
                what,
                'recognised ours, %',
                'rotation deg ours',
                'limit of rotation',
                'z mm ours',
                'limit of z',
                'across mm ours',
                'limit across',
            ],
        )
        for name in VIEWS
    }
    lines: dict[str, list[Line]] = {'rotation': [], 'z': []}
    cells: dict[tuple[str, Any], list[float]] = {}
    for value in values:
        for name in VIEWS:
            setting.advance(f'{what} {value}: {name}')
            arguments = {key: function(value, name) for key, function in of_value.items()}
            errors = []
            limit = np.full((6, 6), np.nan)
            for seed in range(seeds):
                truth, best, rig, left_T_scene = trial(name, seed, **arguments)
                if seed == 0:
                    limit = physical_limit(
                        view(name).scene,
                        rig,
                        left_T_scene,
                        truth.translation,
                        arguments.get('noise', NOISE),
                        fine=setting.pick(FINE, 2),
                    )
                if best is not None:
                    error = error_vector(best, truth)
                    if np.linalg.norm(error[3:]) < np.radians(5.0):
                        errors.append(error)
            recognised = 100.0 * len(errors) / seeds
            found = np.array(errors) if errors else np.full((1, 6), np.nan)
            sigma = np.sqrt(np.diag(limit))
            # Medians of |error| beside medians of the limit's own distribution: drawn from its covariance.
            draws = np.random.default_rng(0).multivariate_normal(np.zeros(6), _symmetric(limit), 4000)
            cell = [recognised, *_medians(found), *_medians(draws)]
            order = [cell[0], cell[1], cell[4], cell[2], cell[5], cell[3], cell[6]]
            cells[name, value] = order + [float(sigma[2])]
            tables[name].rows.append([value, round(order[0]), *order[1:]])
    for name in VIEWS:
        for kind, column in (('rotation', 1), ('z', 3)):
            lines[kind] += [
                Line(name, values, [cells[name, v][column] for v in values]),
                Line(f'{name}, physical limit', values, [cells[name, v][column + 1] for v in values], '--'),
            ]
    plots = [
        Plot(f'{title}: rotation', what, 'degrees, median', lines['rotation'], log_y=True),
        Plot(f'{title}: depth', what, 'mm, median', lines['z'], log_y=True),
    ]
    return list(tables.values()), plots


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _medians(errors: np.ndarray) -> list[float]:
    return [
        float(np.degrees(np.median(np.linalg.norm(errors[:, 3:], axis=1)))),
        1e3 * float(np.median(np.abs(errors[:, 2]))),
        1e3 * float(np.median(np.hypot(errors[:, 0], errors[:, 1]))),
    ]


# Columns of a sweep's tables: our medians, each with its limit behind it.
RECOGNISED, ROTATION, DEPTH = 1, 2, 4


def _row(table: Table, value: float) -> list[Any]:
    return next(row for row in table.body if row[0] == value)


def _growth(tables: list[Table], first: float, last: float, column: int) -> tuple[float, float]:
    """How many times as large our error, and its limit, are at the last value as at the first: means of the views."""
    rows = [(_row(table, last), _row(table, first)) for table in tables]
    ours, limit = (geometric_mean([b[k] / a[k] for b, a in rows]) for k in (column, column + 1))
    return ours, limit


def _beside_limit(tables: list[Table], value: float, column: int) -> float:
    return average([row[column] / row[column + 1] for row in (_row(table, value) for table in tables)])


def _recognised(tables: list[Table]) -> str:
    """What counts of every row: its share, and how far the errors are from their limits."""
    shares = [row[RECOGNISED] for table in tables for row in table.body]
    above = [row[ROTATION] / row[ROTATION + 1] for table in tables for row in table.body]
    return (
        f'{average(shares):.0f} % are recognised over all rows, with rotation errors of {geometric_mean(above):.1f} '
        'times the limit'
    )


NOTE = (
    'The limit is the Cramer-Rao bound of an estimator that knows the whole appearance of the object and uses every '
    'pixel; ours uses edges only and knows no appearance.'
)


def antialias(setting: Setting) -> Outcome:
    values = setting.pick([0, 2, 4, 8], [4])
    tables, plots = sweep(
        setting,
        'samples along a pixel (0: one ray)',
        values,
        'Error against anti-aliasing',
        antialias=lambda value, name: value,
    )
    return Outcome(
        lambda tables: (
            f'One ray a pixel costs {1.0 / _growth(tables, values[0], values[-1], ROTATION)[0]:.1f} times the '
            f'rotation error of {values[-1]} x {values[-1]} samples; {_recognised(tables)}. The thesis found '
            'anti-aliasing unnecessary for recovery.'
        ),
        tables,
        plots,
        [NOTE],
        spoken=tuple(range(len(tables))),
    )


def baseline(setting: Setting) -> Outcome:
    values = setting.pick([20.0, 12.0, 8.0, 5.0, 3.5], [5.0])

    def rig_of(value: float, name: str) -> StereoRig:
        this = view(name)
        return StereoRig(this.rig.left, this.rig.right, float(this.pose.translation[2]) / value)

    tables, plots = sweep(
        setting,
        'distance : baseline',
        values,
        'Error against baseline',
        rig=rig_of,
        antialias=lambda value, name: setting.pick(FINE, 2),
    )
    return Outcome(
        lambda tables: (
            f'From {values[0]:g} : 1 to {values[-1]:g} : 1 the errors of depth become '
            f'{_growth(tables, values[0], values[-1], DEPTH)[0]:.2f} of what they were and their physical limit '
            f"{_growth(tables, values[0], values[-1], DEPTH)[1]:.2f}; at the thesis' 5 : 1 ours are "
            f'{_beside_limit(tables, 5.0, DEPTH):.0f} times the limit; {_recognised(tables)}.'
        ),
        tables,
        plots,
        [NOTE],
        spoken=tuple(range(len(tables))),
    )


def depth(setting: Setting) -> Outcome:
    values = setting.pick([0.9, 1.0, 1.5, 2.0, 3.0, 4.0], [1.0])
    tables, plots = sweep(
        setting,
        "distance, times the view's own",
        values,
        'Error against depth',
        depth=lambda value, name: value,
        antialias=lambda value, name: setting.pick(FINE, 2),
    )
    return Outcome(
        lambda tables: (
            f"From the views' own distance to {values[-1]:g} times that, at a fixed baseline, errors of depth grow "
            f'{_growth(tables, 1.0, values[-1], DEPTH)[0]:.0f} times and those of rotation '
            f'{_growth(tables, 1.0, values[-1], ROTATION)[0]:.0f} times, their physical limits '
            f'{_growth(tables, 1.0, values[-1], DEPTH)[1]:.0f} and '
            f'{_growth(tables, 1.0, values[-1], ROTATION)[1]:.0f} times; {_recognised(tables)}.'
        ),
        tables,
        plots,
        [NOTE],
        spoken=tuple(range(len(tables))),
    )


def covariance(setting: Setting) -> Outcome:
    """Is the stated covariance true? Squared Mahalanobis distances of the errors follow chi squared of six degrees."""
    table = Table(
        'Squared distance of the pose error in units of the stated covariance',
        [
            'data',
            'poses',
            'mean expected',
            'mean ours',
            'median expected',
            'median ours',
            'inside 95 % expected',
            'inside ours',
            'Kolmogorov-Smirnov p ours',
        ],
    )
    plots = [Line('expected', *_quantiles(stats.chi2(6).ppf(np.linspace(0.02, 0.98, 40))), '--')]
    for title, distances in _distances(setting):
        setting.advance(title)
        if not len(distances):
            table.rows.append([title, 0, 6.0, None, 5.35, None, 95.0, None, None])
            continue
        inside = 100.0 * float((distances < stats.chi2(6).ppf(0.95)).mean())
        table.rows.append(
            [
                title,
                len(distances),
                6.0,
                float(distances.mean()),
                5.35,
                float(np.median(distances)),
                95.0,
                inside,
                float(stats.kstest(distances, stats.chi2(6).cdf).pvalue),
            ]
        )
        plots.append(Line(title, *_quantiles(np.quantile(distances, np.linspace(0.02, 0.98, 40))), '-'))
    if not table.numbers('inside ours'):
        raise NotAvailable('the matcher states no covariance')
    return Outcome(
        say_covariance,
        [table],
        [Plot('Actual errors in units of the stated covariance', 'probability', 'squared distance', plots, log_y=True)],
    )


def say_covariance(tables: list[Table]) -> str:
    (table,) = tables
    shares = table.numbers('inside ours')
    off = [row for row in table.body if row[1] and row[8] < 0.01]
    parts = []
    for word, rows in (('small', [r for r in off if r[3] > 6.0]), ('large', [r for r in off if r[3] <= 6.0])):
        if rows:
            parts.append(f'too {word} for {", ".join(row[0] for row in rows)}')
    verdict = 'agree with the actual errors'
    if parts:
        verdict = f'are {" and ".join(parts)}, and {verdict} elsewhere'
    return (
        f'Between {min(shares):.0f} and {max(shares):.0f} % of the errors lie inside the stated 95 % ellipsoid, '
        f'squared distances have means of {within(table.numbers("mean ours"), ".1f")} (expected 6): the stated '
        f'covariances {verdict} (Kolmogorov-Smirnov, tested at 1 %).'
    )


def _quantiles(values: np.ndarray) -> tuple[list, list]:
    return np.linspace(0.02, 0.98, 40).round(4).tolist(), [float(v) for v in values]


def _distances(setting: Setting):
    count = setting.pick(60, 2)
    for name in VIEWS:
        found = []
        for seed in range(count):
            truth, best, _, _ = trial(name, 1000 + seed)
            found.append(_distance(best, truth))
        yield f'rendered pairs, {name}', np.array([d for d in found if d is not None])
    for name in MODELS:
        model = MODELS[name]()
        index, found = index_model(model, name), []
        for seed in range(setting.pick(500, 2)):
            rng = np.random.default_rng([seed, 5000])
            truth = random_pose(rng, 0.03)
            found.append(_distance(match(index, measured(model, truth, rng)).best, truth))
        yield f'features with covariances, {name}', np.array([d for d in found if d is not None])
    for name in ('l_shape', 'chair'):
        model = MODELS[name]()
        index = index_model(model, name)
        for sigma in (1e-4, 5e-4):
            found = []
            for seed in range(setting.pick(150, 2)):
                scene = make_scene(model, 5000 + seed, clutter=0.3, sigma=sigma)
                found.append(_distance(match(index, scene.data).best, scene.poses[0]))
            yield f'features with bounds, {name}, {1e3 * sigma:g} mm', np.array([d for d in found if d is not None])


def _distance(found: Interpretation | None, truth: Pose) -> float | None:
    """None for what was not recognised; a wrong answer is no sample of the noise."""
    if found is None or found.covariance is None or np.linalg.norm(error_vector(found, truth)[3:]) > np.radians(5.0):
        return None
    return squared_deviation(found, truth)


def real_folder() -> Path | None:
    """The folder with chessboard/ and teabox/, which are not shipped: STEREO_REAL_DATA names it, or "
    "../shared/real."""
    named = os.environ.get('STEREO_REAL_DATA')
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / 'shared' / 'real'
    return folder if folder.is_dir() else None


def real_pairs(setting: Setting) -> Outcome:
    """Chessboard pairs with reference poses (one is shipped); more of them and a tea box where their pictures are."""
    from model_matcher.closed_form.comparison import best_pose_error, compare_edges
    from model_matcher.closed_form.real_pair import SQUARE_M, board_symmetries, chessboard_model, reference_pose
    from stereo_recovery.cameras.calibration import load_rig

    more = real_folder()
    folder = Path(str(resources.files('stereo_recovery') / 'data' / 'chessboard'))
    if more is not None and (more / 'chessboard').is_dir():
        folder = more / 'chessboard'
    pairs = sorted(path.name[4:6] for path in folder.glob('left*_rect.png'))
    table = Table(
        'Chessboard pairs',
        [
            'pair',
            'features ours',
            'recall of grid lines ours, %',
            'direction deg ours',
            'pose deg from the reference ours',
            'mm from the reference ours',
            'matched ours',
            'equal poses listed ours',
        ],
    )
    model = chessboard_model()
    for pair in setting.pick(pairs, pairs[:1]):
        setting.advance(f'chessboard {pair}')
        left, right = (_grey(folder / f'{side}{pair}_rect.png') for side in ('left', 'right'))
        rig = load_rig(folder / 'calibration.yaml', (left.shape[1], left.shape[0]))
        rig = StereoRig(rig.left, rig.right, rig.baseline * SQUARE_M)
        data: FeatureSet = recover(left, right, rig).features
        truth = reference_pose(folder, pair)
        edges = compare_edges(model.transformed(truth), data, same_place_m=0.2 * SQUARE_M)
        best = match(model, data, MatchParams(time_limit_s=10.0)).best
        row: list = [
            pair,
            len(data),
            100.0 * edges.recall,
            edges.summary()['direction_error_deg_median'],
            None,
            None,
            None,
            None,
        ]
        if best is not None:
            error = best_pose_error(best, truth, board_symmetries(truth))
            row[4:] = error.rotation_deg, 1e3 * error.translation, best.matched, len(best.symmetric_poses)
        table.rows.append(row)
    tables = [table]
    notes = [
        f'Squares are taken to be {1e3 * SQUARE_M:g} mm; the reference poses come from the corners in both pictures. '
        'Of equal poses the one nearest to the reference is judged.'
    ]
    if more is not None and (more / 'teabox').is_dir():
        tables.append(_teabox(more / 'teabox', setting))
        notes.append(
            'The references of the tea box are good to about 1 mm and 0.5 degrees; its cardboard edges are round, '
            'and three of the seven visible ones run along the image rows.'
        )
    else:
        notes.append(
            'The pictures of the tea box (from ViSP, GPL) and six more chessboard pairs are not shipped; '
            'STEREO_REAL_DATA names the folder that holds teabox/ and chessboard/.'
        )
    return Outcome(say_real_pairs, tables, notes=notes, spoken=(0,))


def _placed(table: Table, degrees: float, mm: float) -> int:
    """Rows whose pose is near enough to its reference."""
    errors = table.paired('pose deg from the reference ours', 'mm from the reference ours')
    return sum(turn < degrees and shift < mm for turn, shift in errors)


def say_real_pairs(tables: list[Table]) -> str:
    from model_matcher.closed_form.real_pair import SQUARE_M

    boards, *boxes = tables
    box = (
        f'the tea box in {_placed(boxes[0], 2.0, 5.0)} of {len(boxes[0].body)} pairs within 2 degrees and 5 mm'
        if boxes
        else 'the tea box: its pictures are not on this machine'
    )
    return (
        f'{_placed(boards, 1.0, 200.0 * SQUARE_M)} of {len(boards.body)} real chessboard pairs are placed within 1 '
        'degree and a fifth of a square of their reference pose, up to the half turn that grid lines alone cannot '
        f'tell; {box}.'
    )


def _grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise NotAvailable(f'{path.name} is not a readable picture')
    return image


def _teabox(folder: Path, setting: Setting) -> Table:
    """The box's pairs. folder : left000_rect.png, ..., calibration.json, box_poses.json."""
    from model_matcher.closed_form.comparison import best_pose_error, compare_edges

    given = json.loads((folder / 'calibration.json').read_text())['rectified']
    document = json.loads((folder / 'box_poses.json').read_text())
    table = Table(
        'Tea box',
        [
            'pair',
            'features ours',
            'edges found of 7 ours',
            'direction deg ours',
            'pose deg from the reference ours',
            'mm from the reference ours',
            'matched ours',
            'equal poses listed ours',
        ],
    )
    corners = np.array(document['vertices_m'])
    size = corners.max(axis=0)
    vertices = np.concatenate([corners, [[size[0], size[1], size[2]], [0.0, size[1], size[2]]]])
    visible = document['visible_edges']
    pairs = [*visible, [5, 6], [2, 6], [6, 7], [3, 7], [4, 7]]
    model = FeatureSet.from_edges(vertices[[a for a, _ in pairs]], vertices[[b for _, b in pairs]])
    camera = PinholeCamera(*given['size'], given['f'], given['f'], given['cx'], given['cy'])
    rig = StereoRig.symmetric(camera, given['baseline_m_corrected'])
    for name, pose in document['poses'].items():
        setting.advance(f'tea box {name}')
        left, right = (_grey(folder / f'{side}{name}_rect.png') for side in ('left', 'right'))
        data = recover(left, right, rig).features
        truth = Pose.from_rotation_vector(pose['rvec'], np.array(pose['tvec_m']))
        seen = model.select(np.arange(len(visible))).transformed(truth)
        edges = compare_edges(seen, data, same_place_m=0.008)
        best = match(model, data, MatchParams(time_limit_s=10.0)).best
        row: list = [
            name,
            len(data),
            edges.edges_found,
            edges.summary()['direction_error_deg_median'],
            None,
            None,
            None,
            None,
        ]
        if best is not None:
            # A plain box laid on itself by half turns: no edge can tell them apart.
            error = best_pose_error(best, truth, [truth.compose(turn) for turn in _half_turns(size)])
            row[4:] = error.rotation_deg, 1e3 * error.translation, best.matched, len(best.symmetric_poses)
        table.rows.append(row)
    return table


def _half_turns(size: np.ndarray) -> list[Pose]:
    """About each axis through the middle of a box from the origin to ``size``."""
    turns = [np.diag([1.0 if k == axis else -1.0 for k in range(3)]) for axis in range(3)]
    return [Pose(turn, size / 2.0 - turn @ (size / 2.0)) for turn in turns]


EXPERIMENTS = [
    Experiment('antialias', 'Error against anti-aliasing', '', antialias),
    Experiment('baseline', 'Error against baseline', '', baseline),
    Experiment('depth', 'Error against depth', '', depth),
    Experiment('covariance', 'Stated against actual covariance', '', covariance),
    Experiment('real_pairs', 'Real stereo pairs', '', real_pairs),
]
