"""Accuracy of recovered straight edges on random scenes, beside the bars they must reach:

python test/benchmarks/bench_lines.py --seeds 100..139 [--kinds any flat aliased] [--cameras 3] [--each] [--workers 2]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from batches import add_batch_options, one_process, run_batch
from line_scoring import LineScore, pose_errors
from measure import Measurement, milliseconds, seed_range
from results import add_record_option, keep
from stereo_scenes import USUAL, Imaging, StereoScene, random_scene

from msgs_py import FeatureKind, FeatureSet
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up

KINDS = ('any', 'flat', 'aliased')
# floor, aim
BARS: dict[str, tuple[float, float]] = {
    'recall': (0.92, 0.97),
    'recall of flat edges': (0.85, 0.95),
    'precision': (0.97, 1.0),
    'direction median': (0.15, 0.09),
    'direction p90': (0.8, 0.5),
    'across median': (0.06, 0.03),
    'across p90': (0.25, 0.15),
    'end median': (0.25, 0.10),
    'end p90': (1.0, 0.5),
    'inside err_per': (0.95, 0.95),
    'inside err_par': (0.95, 0.95),
    'inside cone': (0.95, 0.95),
    'err_per too wide': (2.0, 1.5),
    'err_par too wide': (2.0, 1.5),
    'cone too wide': (2.0, 1.5),
    'pose rotation': (0.07, 0.03),
    'pose translation': (0.06, 0.02),
}
ALIASED_BARS = {'direction median': (0.40, 0.30)}
UNITS = {'direction': 'deg', 'across': 'mm', 'end': 'mm', 'pose rotation': 'deg', 'pose translation': 'mm'}


class _SceneJob(NamedTuple):
    """A scene, and how it is seen."""

    kind: str
    seed: int
    imaging: Imaging


def _of_scene(job: _SceneJob) -> dict[str, Any]:
    """The name of a scene, and the score of its recovery against the truth."""
    scene = scene_of(job.kind, job.seed, job.imaging)
    found = edges_of(scene)
    one = LineScore()
    paired = one.add(found, scene.edges, scene.faint, scene.left_sees)
    error = pose_errors(found, paired, scene)
    one.poses = [error] if error else []
    return {'scene': scene.name, **vars(one)}


def score(
    kind: str,
    seeds: Sequence[int],
    each: bool = False,
    imaging: Imaging = USUAL,
    options: argparse.Namespace | None = None,
) -> LineScore:
    """Recovery of one scene a seed against its truth; options: of :func:`batches.add_batch_options`."""
    total = LineScore()
    jobs = {f'{kind} {seed}': _SceneJob(kind, seed, imaging) for seed in seeds}
    for one in run_batch(_of_scene, jobs, options or one_process(), kind, warm_up).values():
        name = one.pop('scene')
        total.include(one)
        if each:
            alone = LineScore()
            alone.include(one)
            line = ' '.join(
                f'{what.replace(" ", "_")} {value:.3g}'
                for what, value in alone.figures().items()
                if what in ('recall', 'recall of flat edges', 'precision', 'direction p90', 'end p90')
            )
            error = one['poses'][0] if one['poses'] else None
            print(f'{name:<18} {line}' + (f' pose {error[0]:.3f} deg {error[1]:.3f} mm' if error else ''))
    return total


def scene_of(kind: str, seed: int, imaging: Imaging = USUAL) -> StereoScene:
    """kind : one of KINDS."""
    return random_scene(seed, 'any', 0, imaging) if kind == 'aliased' else random_scene(seed, kind, imaging=imaging)


def edges_of(scene: StereoScene) -> FeatureSet:
    if len(scene.cameras) > 2:
        return recover(scene.images, scene.cameras).features.of_kind(FeatureKind.EDGE)
    return recover(scene.left, scene.right, scene.rig).features.of_kind(FeatureKind.EDGE)


def measurements(quick: bool) -> Iterator[Measurement]:
    """For run.py: the same seeds at every run, so that runs can be compared."""
    seeds = range(5 if quick else 40)
    for kind in KINDS:
        bars = ALIASED_BARS if kind == 'aliased' else BARS
        for name, value in score(kind, seeds).figures().items():
            if name in bars:
                floor, aim = bars[name]
                higher = floor <= aim and 'wide' not in name and name not in UNITS
                yield Measurement(
                    f'{kind}: {name}',
                    value,
                    _unit(name),
                    lower_is_better=not higher,
                    note=f'floor {floor:g}, aim {aim:g}',
                )
    scenes = [random_scene(seed) for seed in range(5)]
    yield Measurement(
        'a 512 x 512 pair',
        float(np.median([milliseconds(partial(edges_of, s), 0.1, 3, 10) for s in scenes])),
        'ms',
        note='floor 60, aim 25 in a node',
    )


def _unit(name: str) -> str:
    return next((unit for start, unit in UNITS.items() if name.startswith(start)), '')


def _verdict(name: str, value: float, bars: dict[str, tuple[float, float]]) -> str:
    if name not in bars:
        return ''
    floor, aim = bars[name]
    sign = 1.0 if floor > aim else -1.0
    word = 'aim met' if sign * value <= sign * aim else 'floor met' if sign * value <= sign * floor else 'MISSED'
    return f'floor {floor:<5g} aim {aim:<5g} {word}'


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=seed_range, default='0..19', metavar='A..B', help='scenes, both ends included')
    parser.add_argument(
        '--kinds',
        nargs='+',
        choices=KINDS,
        default=list(KINDS),
        help='any pose, many edges along the rows, or any pose with one ray a pixel',
    )
    parser.add_argument('--cameras', type=int, choices=(2, 3), default=2, help='3: one more above the pair')
    parser.add_argument('--each', action='store_true', help='a line for every scene')
    add_batch_options(parser)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    measured: dict[str, dict[str, float]] = {}
    for kind in options.kinds:
        imaging = replace(USUAL, cameras=options.cameras)
        figures = score(kind, options.seeds, options.each, imaging, options).figures()
        measured[kind] = figures
        print(f'-- {kind}, seeds {options.seeds[0]}..{options.seeds[-1]}')
        for name, value in figures.items():
            bars = ALIASED_BARS if kind == 'aliased' else BARS
            print(f'{name:<24} {value:>8.3f} {_unit(name):<4} {_verdict(name, value, bars)}'.rstrip())
    if options.record:
        keep(options.record, measured)
    return 0


if __name__ == '__main__':
    sys.exit(main())
