"""Whether stated errors are true: of rendered edges, curves and axes, and of pairs of cameras and of a path tracer:

    python test/benchmarks/bounds.py --seeds 100..119 [--kinds any flat aliased] [--conditions usual noisy ...]
    python test/benchmarks/bounds.py --curves 1900..1901 --pairs photoreal real

Of rendered edges a row a group: how many, the share inside the stated bound (bar 95 %), and how many times too wide the
bound is in the median (bar 2), for err_per and the cone of directions of its edges, or err_par of its ends. Then, of
all, squared errors in units of their covariances over their degrees of freedom: the share that no noise makes, the mean
of the others (1 where covariances are true), the median over chi squared's, and the share of all inside the 95 %
region.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from batches import add_batch_options, run_batch
from bench_lines import KINDS, edges_of, scene_of
from curve_scenes import KINDS as CURVE_KINDS
from curve_scenes import Imaging as Rendering
from curve_scenes import curved_view
from curve_scoring import CurveScore
from line_scoring import HALF_NORMAL, LineScore
from measure import seed_range
from normalised_errors import NormalisedErrors, add_axis, add_circle, add_edges
from pair_scoring import matched_circles, true_lines
from stereo_scenes import USUAL, Imaging, StereoScene
from true_pairs import data_folder, families_of, load_pair, pair_names

from model_matcher import index_model, match
from model_matcher.closed_form.comparison import best_pose_error, squared_deviation
from msgs_py import FeatureKind, PinholeCamera, StereoRig
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up

CONDITIONS = {
    'usual': USUAL,
    'small, wide': Imaging(PinholeCamera.centred(640, 480, 500.0)),
    'small, long': Imaging(PinholeCamera.centred(640, 480, 1400.0)),
    'large, wide': Imaging(PinholeCamera.centred(1280, 960, 700.0)),
    'large, long': Imaging(PinholeCamera.centred(1280, 960, 1400.0)),
    'clean': Imaging(noise=1.0),
    'noisy': Imaging(noise=5.0),
    'sharp': Imaging(blur=0.3),
    'blurred': Imaging(blur=1.2),
    'near': Imaging(depth_ratio=3.0),
    'far': Imaging(depth_ratio=10.0),
}
FLAT, UPRIGHT = 0.15, 0.7
BESIDE, NEAR = 2.5, 6.0
SHORT = 30.0
# An end of a visible piece this near to one of the model's edge is a corner, metres; elsewhere something hides it.
CORNER = 0.2e-3
# Degrees: a pose farther off is a wrong one, and no sample of its covariance.
MOST_POSE_DEG = 5.0
Groups = dict[str, dict[str, list[float]]]


def add(groups: Groups, head: str, scene: StereoScene, normalised: NormalisedErrors) -> None:
    """The ratios of errors to stated bounds of one scene, by groups, and its errors in units of their covariances."""
    score = LineScore()
    found = edges_of(scene)
    paired = score.add(found, scene.edges, scene.faint)
    true = paired[paired >= 0]
    add_edges(normalised, found.select(paired >= 0), scene.edges[true], _pixels_per_metre(scene.rig, scene.edges[true]))
    best = match(index_model(scene.model), found).best
    if best is not None and best_pose_error(best, scene.pose).rotation_deg < MOST_POSE_DEG:
        normalised.squared.setdefault('poses', []).append(squared_deviation(best, scene.pose))
        normalised.freedom['poses'] = 6
    run = np.diff(scene.rig.left.project(scene.edges), axis=1)[:, 0]
    length = np.maximum(np.hypot(*run.T), 1e-9)
    sine = np.abs(run[:, 1]) / length
    wire = scene.pose.apply(np.stack([scene.model.start, scene.model.end], axis=1)[scene.model_index])
    corner = np.linalg.norm(scene.edges[:, :, None] - wire[:, None], axis=-1).min(axis=-1) < CORNER
    of_edges = {
        'all edges': true >= 0,
        'along the rows': sine[true] < FLAT,
        'leaning': (sine[true] >= FLAT) & (sine[true] < UPRIGHT),
        'upright': sine[true] >= UPRIGHT,
        'shorter than 30 px': length[true] < SHORT,
        'another within 2.5 px': scene.nearest[true] < BESIDE,
        'another within 6 px': (scene.nearest[true] >= BESIDE) & (scene.nearest[true] < NEAR),
        'no other near': scene.nearest[true] >= NEAR,
    }
    seen = np.unique(true)
    of_ends = {
        'all ends': corner[seen] >= 0,
        'corners': corner[seen],
        'hidden ends': ~corner[seen],
        'ends along the rows': np.repeat(sine[seen, None] < FLAT, 2, axis=1),
        'ends of others': np.repeat(sine[seen, None] >= FLAT, 2, axis=1),
    }
    for name, mask in of_edges.items():
        _extend(groups, head + name, 'err_per', np.array(score.ratios['err_per']).reshape(-1, 2)[mask])
        _extend(groups, head + name, 'cone', np.array(score.ratios['cone'])[mask])
    for name, mask in of_ends.items():
        _extend(groups, head + name, 'err_par', np.array(score.ratios['err_par']).reshape(-1, 2)[mask])


def _pixels_per_metre(rig: StereoRig, lines: np.ndarray) -> np.ndarray:
    """(n,): how long a metre along lines (n, 2, 3) is in the left picture, on average."""
    run = np.diff(rig.left.project(lines), axis=1)[:, 0]
    return np.linalg.norm(run, axis=1) / np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)


class _SceneJob(NamedTuple):
    """A rendered scene with straight edges."""

    condition: str
    kind: str
    seed: int


def _of_scene(job: _SceneJob) -> dict[str, Any]:
    """The groups of a scene, and its errors in units of their covariances."""
    groups: Groups = {}
    normalised = NormalisedErrors()
    head = f'{job.condition}, {job.kind}: '
    add(groups, head, scene_of(job.kind, job.seed, CONDITIONS[job.condition]), normalised)
    return {'groups': groups, **vars(normalised)}


def _of_curves(job: tuple[str, int]) -> dict[str, Any]:
    """Errors of circles, ellipses and axes of a rendered view: its kind and its seed."""
    kind, seed = job
    result = NormalisedErrors()
    view = curved_view(kind, seed, Rendering())
    score = CurveScore()
    recovery = recover(view.left, view.right, view.rig)
    score.add(recovery, view)
    for i, j in score.pairs:
        rim = view.rims[i]
        add_circle(result, recovery.curves[j], rim.centre, rim.normal, rim.radii[0])
    axes = recovery.features.of_kind(FeatureKind.AXIS)
    for k, ends in score.axis_pairs:
        add_axis(result, axes, k, ends)
    return vars(result)


def _of_pair(job: tuple[Path, str, str]) -> dict[str, Any]:
    """Errors of edges and circles of a pair with truth: the folder of data, its family and its name."""
    result = NormalisedErrors()
    pair = load_pair(*job)
    recovery = recover(pair.left, pair.right, pair.rig)
    edges = recovery.features.of_kind(FeatureKind.EDGE)
    own, lines = true_lines(pair, edges)
    add_edges(result, edges.select(own), lines, _pixels_per_metre(pair.rig, lines))
    if len(pair.circle) and recovery.curves:
        curves = recovery.features.of_kind(FeatureKind.CURVE)
        for i, j in matched_circles(pair, curves)[0].items():
            true = pair.circle[i]
            add_circle(result, recovery.curves[j], true[:3], true[3:6], true[6:8].max())
    return vars(result)


def _sum(results: Iterable[dict[str, Any]]) -> NormalisedErrors:
    total = NormalisedErrors()
    for one in results:
        total.include(one['squared'], one['freedom'])
    return total


def normalised_rows(head: str, normalised: NormalisedErrors) -> Iterator[str]:
    for name, count, mistaken, mean, median, inside in normalised.rows():
        figures = (
            f'mistakes {100 * mistaken:4.1f} %  mean {mean:5.2f}  median {median:5.2f}  inside {100 * inside:5.1f} %'
        )
        yield f'{head + name:<44} {count:>5}  {figures}'


def _extend(groups: Groups, group: str, what: str, ratios: np.ndarray) -> None:
    groups.setdefault(group, {}).setdefault(what, []).extend(ratios.ravel().tolist())


def rows(groups: Groups) -> Iterator[str]:
    for group, columns in groups.items():
        cells = [
            f'{what} {len(ratios):>5} {100 * np.mean(np.array(ratios) <= 1.0):6.1f} % '
            f'{HALF_NORMAL / 3.0 / max(float(np.median(ratios)), 1e-9):5.2f} x'
            for what, ratios in columns.items()
            if ratios
        ]
        if cells:
            yield f'{group:<44}' + ' | '.join(cells)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--seeds', type=seed_range, default='0..19', metavar='A..B', help='scenes, both ends included')
    parser.add_argument('--kinds', nargs='+', choices=KINDS, default=['any', 'flat'])
    parser.add_argument(
        '--conditions',
        nargs='*',
        choices=list(CONDITIONS),
        help='cameras, rigs and noise; without a name: all; only their sums are shown',
    )
    parser.add_argument('--curves', type=seed_range, metavar='A..B', help='seeds of views with circles and axes')
    parser.add_argument(
        '--pairs', nargs='*', metavar='FAMILY', help='pairs with truth: photoreal, real, or one of them'
    )
    add_batch_options(parser)
    options = parser.parse_args(arguments)
    if options.curves is not None or options.pairs is not None:
        if options.curves is not None:
            views = {f'{kind} {seed}': (kind, seed) for kind in CURVE_KINDS for seed in options.curves}
            done = run_batch(_of_curves, views, options, 'curves', warm_up)
            print('\n'.join(normalised_rows('rendered: ', _sum(done.values()))), flush=True)
        for family in families_of(options.pairs or []):
            folder = data_folder()
            pairs = {name: (folder, family, name) for name in pair_names(folder, family, False)}
            done = run_batch(_of_pair, pairs, options, family, warm_up)
            print('\n'.join(normalised_rows(f'{family}: ', _sum(done.values()))), flush=True)
        return 0
    names = ['usual'] if options.conditions is None else options.conditions or list(CONDITIONS)
    jobs = {
        f'{name}, {kind}: {seed}': _SceneJob(name, kind, seed)
        for name in names
        for kind in options.kinds
        for seed in options.seeds
    }
    groups: Groups = {}
    normalised: dict[str, NormalisedErrors] = {}
    for name, one in run_batch(_of_scene, jobs, options, 'scenes', warm_up).items():
        head = name[: name.index(': ') + 2]
        normalised.setdefault(head, NormalisedErrors()).include(one['squared'], one['freedom'])
        for group, columns in one['groups'].items():
            for what, ratios in columns.items():
                groups.setdefault(group, {}).setdefault(what, []).extend(ratios)
    if options.conditions is not None:
        groups = {name: columns for name, columns in groups.items() if ': all ' in name}
    print('\n'.join(rows(groups)))
    for head, of_kind in normalised.items():
        print('\n'.join(normalised_rows(head, of_kind)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
