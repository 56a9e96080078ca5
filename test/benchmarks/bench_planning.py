"""Whether plan_rig's predictions hold: pose errors in rendered and in real pictures over those that it expects.

Of each of the thesis' models views of a working volume are rendered, recovered and searched as plan_rig does it. The
sigmas that its predictions have of drawn pictures (planning/settings.py) were chosen on other views of the same models,
with other noise. Of real pairs noise and blur are those of the pair, and what edges and rows are off is what the other
pairs of its family show (leave one out): outlines measured at the true poses, rows by ``check_rig``. The light is that
of plan_rig, not that of the pictures. The errors of the real truths are in the errors found, and so what their folders
say of these counts in what is expected.

    python test/benchmarks/bench_planning.py --workers 2
    python test/benchmarks/bench_planning.py --models l_shape plug --real
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from batches import add_batch_options, one_process, run_batch
from measure import Absent, Measurement
from results import add_record_option, keep
from true_pairs import data_folder
from true_poses import posed_pairs

from csg_renderer import Scene
from model_matcher.closed_form.case import Limits
from model_matcher.closed_form.planning.judging import off_by
from model_matcher.closed_form.planning.part import PlannedPart
from model_matcher.closed_form.planning.prediction import predict
from model_matcher.closed_form.planning.rig import PlannedRig, Sensor, rig_of_numbers
from model_matcher.closed_form.planning.task import TRIAL, Job, Task, do_job, files_of_part
from model_matcher.closed_form.planning.volume import Volume
from model_matcher.geometry.settings import UNIFORM_VARIANCE
from model_matcher.image_pose.measurement import measure_pose
from model_matcher.image_pose.views import Views
from model_matcher.pipeline import survey
from stereo_recovery import recover

MODELS = ('chipped_block', 'l_shape', 'wedge', 'chair', 'computer', 'plug', 'cylinder_box', 'lamp', 'tubes')
# How far the truths of real pairs are to be trusted, as the README of each folder says: limits, metres and degrees.
REAL = {'openvgr': (0.5e-3, 0.1), 'visp_cube': (1.5e-3, 0.3), 'teabox': (1e-3, 0.5)}
VIEWS, SEED = 48, 500
# As the thesis has it: distances of the camera in sizes of the object, baseline as a share of the middle one.
DISTANCES, BASELINE = (3.2, 5.0), 0.2
# An answer farther off is wrong, and no error of a pose: metres, degrees.
WRONG = (0.01, 6.0)


@cache
def task_of(model: str, views: int) -> Task:
    """Views of a thesis' model."""
    files = files_of_part(model)
    rig = PlannedRig(rig_of_numbers((512, 512), 703.0, 1.0))
    size = 2.0 * Task(files, rig, Volume(1.0, 1.0), Limits(), 1).part.ball[1]
    near, far = (size * one for one in DISTANCES)
    rig = PlannedRig(rig_of_numbers((512, 512), 703.0, BASELINE * 0.5 * (near + far)))
    return Task(files, rig, Volume(near, far), Limits(), views, seed=SEED)


def rendered(models: list[str], views: int, options: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Figures of each model; options: of :func:`batches.add_batch_options`."""
    jobs = {f'{model} {k}': (model, views, k) for model in models for k in range(views)}
    done = run_batch(_trial, jobs, options, 'rendered')
    figures = {}
    for model in models:
        trials = [done[f'{model} {k}'] for k in range(views)]
        found = [(one['errors'][0], one['expected'][0]) for one in trials if one['errors'][0] is not None]
        figures[model] = figures_of(found, len(trials))
    return figures


def _trial(job: tuple[str, int, int]) -> dict[str, Any]:
    model, views, number = job
    return do_job(Job(task_of(model, views), TRIAL, number))


def figures_of(found: list[tuple[list[float], list[float]]], asked: int) -> dict[str, float]:
    """Errors [metres, degrees] found and expected: their medians, and the median of their ratios."""
    ratio = np.array([np.divide(*one) for one in found]).reshape(-1, 2)
    errors, expected = (np.array([one[k] for one in found]).reshape(-1, 2) for k in (0, 1))
    if not len(found):
        return {'asked': asked, 'found': 0}
    return {
        'asked': asked,
        'found': len(found),
        'mm': 1e3 * float(np.median(errors[:, 0])),
        'expected_mm': 1e3 * float(np.median(expected[:, 0])),
        'deg': float(np.median(errors[:, 1])),
        'expected_deg': float(np.median(expected[:, 1])),
        'position_ratio': float(np.median(ratio[:, 0])),
        'rotation_ratio': float(np.median(ratio[:, 1])),
    }


# -- real pictures -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Seen:
    """An instance in a real pair: its part, pose and rig, what the pair shows of its faults, and the error found.

    edges, rows : pixels; rows is None where the pair does not tell; walk : grey levels for a root of a pixel
    """

    pair: str
    part: PlannedPart
    pose: Any
    rig: Any
    sensor: Sensor
    edges: float
    rows: float | None
    walk: float
    error: list[float] | None


def real(families: list[str], folder: Path) -> dict[str, dict[str, float]]:
    """Figures of each family, and of all."""
    figures, everything = {}, []
    for family in families:
        seen = list(_seen(folder, family))
        # Sigmas of what lies anywhere within the limits.
        within = 2.0 * np.array(REAL[family]) * np.sqrt(UNIFORM_VARIANCE)
        found = [(one.error, np.hypot(_expected(one, seen), within).tolist()) for one in seen if one.error is not None]
        figures[family] = figures_of(found, len(seen))
        everything += found
    figures['all real'] = figures_of(everything, int(sum(one['asked'] for one in figures.values())))
    return figures


def _seen(folder: Path, family: str) -> Iterator[Seen]:
    for posed in posed_pairs(folder, [family]):
        pair = posed.pair
        recovery = recover(pair.left, pair.right, pair.rig)
        views = Views.of((pair.left, pair.right), pair.rig)
        rig_error = recovery.rig_error
        rows = rig_error.offset_px if rig_error is not None and rig_error.tells else None
        for one in posed.instances:
            if not one.to_find:
                continue
            part = PlannedPart(one.part.name, one.part.solid, one.part.index, Scene([]))
            answers = survey([one.part.index], recovery.features, views=views).interpretations
            offs = [off_by(part, one.pose, answer.pose) for answer in answers]
            near = min((off for off in offs if off.within(*WRONG)), key=lambda off: off.position, default=None)
            error = measure_pose(one.part.index.shape, one.pose, views).error
            psf = float(np.sqrt(max(float(views.look[:, 0].mean()) ** 2 - UNIFORM_VARIANCE, 0.0)))
            yield Seen(
                pair.name,
                part,
                one.pose,
                pair.rig,
                Sensor(float(views.noise.mean()), psf),
                float(np.sqrt(np.mean(np.square(error)))),
                rows,
                float(views.look[:, 1].mean()),
                None if near is None else [near.position, near.rotation],
            )


def _expected(one: Seen, family: list[Seen]) -> list[float]:
    """What plan_rig expects of an instance, metres and degrees, with faults as the family's other pairs have them."""
    others = [other for other in family if other.pair != one.pair] or [one]
    rows = [other.rows for other in others if other.rows is not None]
    rig = PlannedRig(
        one.rig,
        sensor=one.sensor,
        outline_px=float(np.median([other.edges for other in others])),
        calibration_px=float(np.sqrt(np.mean(np.square(rows)))) if rows else 0.0,
        walk=one.walk,
    )
    prediction = predict(one.part, one.pose, rig)
    return [float(prediction.position[0]), float(prediction.rotation[0])]


# -- tables ------------------------------------------------------------------------------------------------------------

COLUMNS = ('asked', 'found', 'mm', 'expected_mm', 'deg', 'expected_deg', 'position_ratio', 'rotation_ratio')


def table(figures: dict[str, dict[str, float]]) -> str:
    """A line a model or family; ratios are errors found over expected ones, medians."""
    head = f'{"":<16}' + ''.join(f'{name:>16}' for name in COLUMNS)
    lines = [
        f'{name:<16}' + ''.join(f'{one[c]:>16.4g}' if c in one else f'{"-":>16}' for c in COLUMNS)
        for name, one in figures.items()
    ]
    return '\n'.join([head, *lines])


def of_models(figures: dict[str, dict[str, float]]) -> dict[str, float]:
    """The median over the models."""
    ratios = ('position_ratio', 'rotation_ratio')
    return {name: float(np.median([one[name] for one in figures.values() if name in one])) for name in ratios}


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py: errors found over expected ones."""
    figures = rendered(list(MODELS[:3] if quick else MODELS), 12 if quick else VIEWS, one_process())
    for name, ratio in of_models(figures).items():
        yield Measurement(f'rendered over expected, {name.split("_")[0]}, median of models', ratio, 'times')
    try:
        families = real(['openvgr'] if quick else list(REAL), data_folder())
    except FileNotFoundError as error:
        yield Absent('planning on real pairs', str(error))
        return
    for name in ('position_ratio', 'rotation_ratio'):
        yield Measurement(f'real over expected, {name.split("_")[0]}', families['all real'][name], 'times')


def main(arguments: list[str] | None = None) -> int:
    """Render and search, or read real pairs; compare with what is expected."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--models', nargs='*', default=list(MODELS), help='of the thesis; none with --models alone')
    parser.add_argument('--views', type=int, default=VIEWS, help='of each model')
    parser.add_argument('--real', nargs='*', metavar='FAMILY', help='real pairs of these families, all without names')
    add_batch_options(parser)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    figures = rendered(options.models, options.views, options) if options.models else {}
    if figures:
        figures['median of models'] = of_models(figures)
    if options.real is not None:
        figures |= real(options.real or list(REAL), data_folder())
    print(table(figures))
    if options.record:
        keep(options.record, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
