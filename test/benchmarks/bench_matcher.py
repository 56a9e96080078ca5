"""Success and speed of the matcher on synthetic scenes: prints one row a preset and model.

    python test/benchmarks/bench_matcher.py [--seeds 200] [--first-seed 50000] [--presets clutter,absent,...]
                                            [--models l_shape,...]

Without --seeds a minute's worth: good for times, while shares near 100 % need the 200 seeds. Scenes of seeds never used
before tell whether the matcher was fitted to its tests; false_alarms and prefilter start at 40000 by themselves.

Success: the best pose, or one listed as its equal, is within 3 degrees and 3 % of the model's size of a true instance,
or explains every true fragment (then occlusion has left several answers). Times are whole match() calls, warm.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ambiguity import is_listed, is_pose, judge
from batches import add_batch_options, run_batch
from matcher_shapes import SHAPES
from results import add_record_option, keep

from model_matcher import MatchParams, index_model, match, recognise
from model_matcher.closed_form.synthetic.scenes import (
    MODELS,
    SyntheticScene,
    box,
    make_scene,
    mirrored,
    random_polyhedron,
    random_pose,
    scaled,
)
from model_matcher.model.index import model_size
from model_matcher.model.symmetry import symmetries
from model_matcher.pipeline import warm_up
from model_matcher.search.prefilter import prefilter
from model_matcher.verification.false_alarms import false_alarm_evidence
from msgs_py import FeatureKind, FeatureSet, Interpretation, Pose

THESIS_SIZES = ('chipped_block', 'l_shape', 'wedge', 'chair', 'computer', 'plug')
CHIRAL = ('chipped_block',)


def is_right(found: Interpretation | None, scene: SyntheticScene, size: float, instance: int = 0) -> bool:
    if found is None:
        return False
    truth = scene.poses[instance]
    for pose in (found.pose, *found.symmetric_poses):
        error = pose.error_to(truth)
        if error.rotation_deg < 3.0 and error.translation < 0.03 * size:
            return True
    return bool((found.assignment[scene.instance == instance] >= 0).all())


def part(seeds: range, divisor: int, least: int = 1) -> range:
    """The first of the seeds: fewer for what takes long."""
    return range(seeds.start, seeds.start + max(least, len(seeds) // divisor))


def row(
    preset: str, model: str, n: list[int], good: list[bool], ms: list[float], note: str = '', seeds: Sequence[int] = ()
) -> None:
    failures = [seed for seed, ok in zip(seeds, good) if not ok]
    print(
        f'{preset:<14} {model:<14} n={int(np.median(n)):<5} {100 * np.mean(good):6.1f} % of {len(good):<5} '
        f'median {np.median(ms):8.2f} ms  p95 {np.percentile(ms, 95):8.2f} ms  {note}'
        + (f' failed: {failures[:8]}' if failures else ''),
        flush=True,
    )


def run(
    preset: str,
    name: str,
    seeds: range,
    scene_of: Callable[[FeatureSet, int], SyntheticScene],
    params: MatchParams | None = None,
    absent: bool = False,
) -> dict[str, float]:
    """Print a row; of how many scenes how many went well."""
    model = MODELS[name]()
    size = model_size(model)
    match(model, scene_of(model, seeds[0]).data, params)
    good, ms, n, notes = [], [], [], []
    for seed in seeds:
        scene = scene_of(model, seed)
        start = time.perf_counter()
        result = match(model, scene.data, params)
        ms.append(1e3 * (time.perf_counter() - start))
        n.append(len(scene.data))
        good.append(not result if absent else is_right(result.best, scene, size))
        notes.append(bool(result.best and result.best.proven))
    note = f'proven {100 * np.mean(notes):.0f} %' if params is not None and params.prove else ''
    row(preset, name, n, good, ms, note, seeds)
    return {'scenes': len(good), 'right': sum(good)}


def clutter(models: list[str], seeds: range) -> None:
    for share in (0.0, 0.3, 0.5, 0.8, 0.95):
        for name in models:
            run(
                f'clutter {100 * share:.0f} %',
                name,
                seeds if share < 0.9 else part(seeds, 2),
                lambda model, seed, share=share: make_scene(model, seed, clutter=share),
            )


def decoys(models: list[str], seeds: range) -> None:
    def scene_of(model: FeatureSet, seed: int, chiral: bool) -> SyntheticScene:
        rng = np.random.default_rng(seed)
        copies = tuple(scaled(model, f) for f in (rng.uniform(0.85, 0.95), rng.uniform(1.05, 1.15)))
        return make_scene(model, seed, clutter=0.8, decoys=copies + ((mirrored(model),) if chiral else ()))

    for name in models:
        run('decoys 80 %', name, seeds, lambda model, seed, name=name: scene_of(model, seed, name in CHIRAL))


def low_visible(models: list[str], seeds: range) -> dict[str, dict[str, float]]:
    """Each feature is in view with a chance of 30 %, so that of 15 there are often three or fewer. What is not right is
    looked into: undetermined (ambiguity.py), and then whether nothing wrong was claimed and the true pose listed among
    the rejected; else refused (the true pose listed, but chance explains as much as it does), missed, or wrong."""
    params = MatchParams()
    found = {}
    for name in models:
        index = index_model(MODELS[name](), name)
        match(index, make_scene(index.features, seeds[0], clutter=0.8, visible=0.3).data)
        good, ms, n, failed = [], [], [], []
        counts = dict.fromkeys(('undetermined', 'of these answered wrongly', 'listed', 'refused', 'missed', 'wrong'), 0)
        for seed in seeds:
            scene = make_scene(index.features, seed, clutter=0.8, visible=0.3)
            start = time.perf_counter()
            result = match(index, scene.data, params)
            ms.append(1e3 * (time.perf_counter() - start))
            n.append(len(scene.data))
            good.append(is_right(result.best, scene, index.size))
            if good[-1]:
                continue
            listed = is_listed(result, scene.poses[0], index)
            if not judge(index, scene, params).determined(params.min_matched):
                kinds = (
                    'undetermined',
                    *(['of these answered wrongly'] if result else []),
                    *(['listed'] if listed else []),
                )
            else:
                kinds = ('wrong' if result else 'refused' if listed else 'missed',)
                failed.append(seed)
            for kind in kinds:
                counts[kind] += 1
        determined = len(good) - counts['undetermined']
        row(
            '30 % visible',
            name,
            n,
            good,
            ms,
            f'of the {determined} determined: {100 * sum(good) / max(determined, 1):.1f} %; '
            + ', '.join(f'{kind} {count}' for kind, count in counts.items())
            + f'; failed {failed[:8]}',
        )
        found[name] = {'scenes': len(good), 'right': sum(good), 'determined': determined, **counts}
    return found


def unseen(models: list[str], seeds: range) -> None:
    """Other kinds of models, each scene another model: matcher_shapes.py."""
    for kind, make in SHAPES.items():
        for share in (0.0, 0.5, 0.8, 0.95):
            chosen = seeds if share < 0.9 else part(seeds, 3)
            good, ms, n = [], [], []
            for seed in chosen:
                index = index_model(make(np.random.default_rng([seed, 9])), kind)
                scene = make_scene(index.features, seed, share, 1.0 if len(index) < 8 else 0.75)
                symmetries(index)
                start = time.perf_counter()
                best = match(index, scene.data).best
                ms.append(1e3 * (time.perf_counter() - start))
                n.append(len(scene.data))
                good.append(
                    is_right(best, scene, index.size)
                    or (best is not None and is_pose(best.pose, scene.poses[0], index))
                )
            row(f'clutter {100 * share:.0f} %', kind, n, good, ms, '', chosen)


def absent(models: list[str], seeds: range) -> dict[str, dict[str, float]]:
    return {
        name: run(
            'absent 80 %',
            name,
            seeds,
            lambda model, seed: make_scene(model, seed, clutter=0.8, instances=0),
            absent=True,
        )
        for name in models
    }


def absent_decoys(models: list[str], seeds: range) -> None:
    """The model itself is absent; scaled copies of it are there."""

    def scene_of(model: FeatureSet, seed: int) -> SyntheticScene:
        rng = np.random.default_rng(seed)
        copies = tuple(scaled(model, f) for f in (rng.uniform(0.85, 0.92), rng.uniform(1.08, 1.15)))
        return make_scene(model, seed, clutter=0.8, instances=0, decoys=copies)

    for name in models:
        run('absent decoys', name, seeds, scene_of, absent=True)


def instances(models: list[str], seeds: range) -> None:
    for name in models:
        model = MODELS[name]()
        index = index_model(model, name)
        size = model_size(model)
        good, ms, n = [], [], []
        for seed in seeds:
            scene = make_scene(model, seed, clutter=0.5, instances=2)
            if seed == seeds[0]:
                recognise([index], scene.data)
            start = time.perf_counter()
            found = recognise([index], scene.data)
            ms.append(1e3 * (time.perf_counter() - start))
            n.append(len(scene.data))
            good.append(all(any(is_right(one, scene, size, k) for one in found) for k in range(2)))
        row('two instances', name, n, good, ms, '', seeds)


def prove(models: list[str], seeds: range) -> None:
    for share in (0.0, 0.5, 0.8):
        for name in models:
            run(
                f'prove {100 * share:.0f} %',
                name,
                seeds,
                lambda model, seed, share=share: make_scene(model, seed, clutter=share),
                MatchParams(prove=True),
            )


def large(models: list[str], seeds: range) -> None:
    for share, label in ((0.5, 'lattice 50 %'), (0.95, 'lattice 4 000')):
        run(
            label,
            'lattice',
            part(seeds, 40, 2),
            lambda model, seed, share=share: make_scene(model, seed, clutter=share, volume=0.4),
        )


def library(models: list[str], seeds: range) -> None:
    """Scenes of 100 edges at most: four fifths clutter of similar objects, half of it, and none."""
    for count in (100, 1000):
        shapes = [index_model(random_polyhedron(k), f'm{k}') for k in range(count)]
        for share in (0.8, 0.5, 0.0):
            good, ms, n, processor = [], [], [], []
            chosen = part(seeds, 10, 5)
            for seed in chosen:
                which = int(np.random.default_rng([seed, 5]).integers(count))
                scene = first_edges(make_scene(shapes[which].features, seed, clutter=share), 100)
                if seed == chosen[0]:
                    recognise(shapes, scene.data)
                start, used = time.perf_counter(), time.process_time()
                found = recognise(shapes, scene.data)
                ms.append(1e3 * (time.perf_counter() - start))
                processor.append(1e3 * (time.process_time() - used))
                n.append(len(scene.data))
                first = found[0] if found and found[0].model == shapes[which].name else None
                good.append(is_right(first, scene, shapes[which].size))
            row(
                f'library {count}',
                f'clutter {100 * share:.0f} %',
                n,
                good,
                ms,
                f'processor time, all threads: {np.median(processor):.0f} ms',
                chosen,
            )


def prefilter_kept(models: list[str], seeds: range) -> None:
    """Whether the prefilter keeps the right model, by the number of its edges in view; how many models it keeps."""
    for count in (100, 1000):
        shapes = [index_model(random_polyhedron(k), f'm{k}') for k in range(count)]
        for share in (0.0, 0.5, 0.8):
            kept: dict[str, list[bool]] = {'4-5': [], '6-8': [], '9-': []}
            ms, searched = [], []
            for seed in seeds:
                rng = np.random.default_rng([seed, 6])
                which = int(rng.integers(count))
                scene = first_edges(make_scene(shapes[which].features, seed, share, rng.uniform(0.25, 0.75)), 100)
                seen = len(np.unique(scene.assignment[scene.instance == 0]))
                if seen < 4:
                    continue
                start = time.perf_counter()
                passed = prefilter(shapes, scene.data, MatchParams())
                ms.append(1e3 * (time.perf_counter() - start))
                searched.append(len(passed))
                kept['4-5' if seen < 6 else '6-8' if seen < 9 else '9-'].append(which in passed)
            print(
                f'prefilter {count:<5} clutter {100 * share:3.0f} %  kept, by edges in view: '
                + ', '.join(f'{name} {sum(hits)}/{len(hits)}' for name, hits in kept.items())
                + f'  models searched: median {np.median(searched):.0f}, most {max(searched)}'
                + f'  median {np.median(ms):.1f} ms',
                flush=True,
            )


def first_edges(scene: SyntheticScene, count: int) -> SyntheticScene:
    """The scene with so many data features at most; their order is random."""
    few = np.arange(min(count, len(scene.data)))
    return SyntheticScene(
        scene.data.select(few), scene.assignment[few], scene.sign[few], scene.instance[few], scene.poses
    )


def limits(models: list[str], seeds: range) -> None:
    """Far too much data: 100,000 edges, the model among them, and a time limit. Right: within 1.3 times the limit."""
    for name in models[:2]:
        index = index_model(MODELS[name](), name)
        for options in (
            {'search': 'hypotheses'},
            {'prove': True},
            {'scale': 'free'},
            {'search': 'tree'},
            {'search': 'serial'},
            {'search': 'subgraph'},
        ):
            ms, good, found = [], [], 0
            for seed in part(seeds, 10, 3):
                rng = np.random.default_rng(seed)
                start = rng.uniform(-1.0, 1.0, (100_000, 3))
                end = start + random_directions(rng, len(start)) * rng.uniform(0.01, 0.1, (len(start), 1))
                scene = make_scene(index.features, seed, visible=1.0)
                data = FeatureSet.concatenate([scene.data, FeatureSet.from_edges(start, end, 1.5e-3, 1.5e-3)])
                params = MatchParams(time_limit_s=2.0, **options)
                if not ms:
                    match(index, scene.data, params)
                began = time.perf_counter()
                best = match(index, data, params).best
                ms.append(1e3 * (time.perf_counter() - began))
                good.append(ms[-1] <= 1.3 * 2000.0)
                found += best is not None and best.pose.error_to(scene.poses[0]).translation < 0.03 * index.size
            row('limit 2 s', name, [len(data)], good, ms, f'{options}, right pose {found} of {len(ms)}')


GENERATORS = ('polyhedra', 'boxes', 'models', 'segments', 'views', 'recovered', 'decoys')
RATES = (1e-1, 1e-2, 1e-3)


def clutter_of(kind: str, name: str) -> tuple[FeatureSet, ...] | None:
    """What scenes are filled with, the model ``name`` not among it; None: random polyhedra."""
    rng = np.random.default_rng(77)
    if kind == 'boxes':
        return tuple(box(rng.uniform(0.02, 0.1, 3)) for _ in range(60))
    if kind == 'models':
        return tuple(MODELS[other]() for other in THESIS_SIZES if other != name)
    if kind == 'segments':
        start, vector = np.zeros((300, 3)), random_directions(rng, 300) * rng.uniform(0.01, 0.1, (300, 1))
        return tuple(FeatureSet.from_edges(start[k : k + 1], vector[k : k + 1]) for k in range(300))
    if kind == 'views':
        return hidden_line_views(name)
    if kind == 'recovered':
        return recovered_parts()
    return None


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@functools.cache
def hidden_line_views(name: str) -> tuple[FeatureSet, ...]:
    """What a camera sees of the objects that come with csg_renderer, hidden parts removed; the model's own excepted."""
    from csg_renderer import load_models, scene_path, visible_features
    from msgs_py import PinholeCamera

    camera = PinholeCamera(640, 480, 700.0, 700.0, 319.5, 239.5)
    rng = np.random.default_rng(78)
    views = []
    for file in ('coverplate', 'table', 'widget', 'lamp', 'cylinder_box', *THESIS_SIZES):
        if file == name:
            continue
        solid = next(iter(load_models(scene_path(file)).values()))
        for _ in range(3):
            seen = visible_features(solid, random_pose(rng, 0.02), camera)
            seen = seen.select(np.flatnonzero(seen.kind == FeatureKind.EDGE))
            if len(seen):
                views.append(seen.transformed(Pose(np.eye(3), -seen.midpoints.mean(axis=0))))
    return tuple(views)


@functools.cache
def recovered_parts() -> tuple[FeatureSet, ...]:
    """Edges recovered from a real stereo pair (the chessboard that comes with stereo_recovery), by neighbourhoods."""
    import tempfile

    from model_matcher.closed_form.real_pair import run_chessboard

    with tempfile.TemporaryDirectory() as folder:
        run_chessboard(Path(folder))
        features = FeatureSet.load(Path(folder) / 'features.npz')
    features = features.select(np.flatnonzero(features.kind == FeatureKind.EDGE))
    rng = np.random.default_rng(79)
    parts = []
    for k in rng.permutation(len(features))[:30]:
        near = np.argsort(np.linalg.norm(features.midpoints - features.midpoints[k], axis=1))[
            : int(rng.integers(8, 25))
        ]
        parts.append(features.select(near).transformed(Pose(np.eye(3), -features.midpoints[k])))
    return tuple(parts)


def false_alarms(models: list[str], seeds: range) -> None:
    """Absent models answered, and present ones found, at several false_alarm_rates: the operating curve."""
    for kind in GENERATORS:
        margins: dict[str, list[float]] = {'absent': [], '75 %': [], '30 %': []}
        for name in models:
            model = MODELS[name]()
            index = index_model(model, name)
            others = clutter_of(kind, name)
            for seed in seeds:
                rng = np.random.default_rng(seed)
                copies = tuple(scaled(model, f) for f in (rng.uniform(0.85, 0.92), rng.uniform(1.08, 1.15)))
                decoys = copies if kind == 'decoys' else ()
                for case, count, visible in (('absent', 0, 0.75), ('75 %', 1, 0.75), ('30 %', 1, 0.3)):
                    if case != 'absent' and seed % 5:
                        continue
                    scene = make_scene(model, seed, 0.8, visible, count, decoys=decoys, others=others)
                    result = match(index, scene.data, MatchParams(false_alarm_rate=RATES[-1]))
                    margin = result.stats.get('evidence', -np.inf) - result.stats.get('evidence_needed', 0.0)
                    first = next(iter((*result.interpretations, *result.rejected)), None)
                    right = case == 'absent' or is_right(first, scene, index.size)
                    margins[case].append(margin if right else -np.inf)
        for rate in RATES:
            less = false_alarm_evidence(1, rate) - false_alarm_evidence(1, RATES[-1])
            above = {case: np.array(values) >= less for case, values in margins.items()}
            print(
                f'rate {rate:<8g} {kind:<10} absent answered {100 * above["absent"].mean():6.2f} % of '
                f'{len(above["absent"])}  found: 75 % visible {100 * above["75 %"].mean():5.1f} %, 30 % visible '
                f'{100 * above["30 %"].mean():5.1f} %',
                flush=True,
            )


def target_decoys(models: list[str], seeds: range) -> dict[str, float]:
    """Views of single objects recovered from rendered stereo pairs, each searched for every model: the object's own is
    the target, all others are decoys. Other objects of round dimensions share edges with the models, as boxes do."""
    from rendered_views import load_object, recovered_view

    files = ('coverplate', 'table', 'widget', 'lamp', 'cylinder_box', *THESIS_SIZES)
    objects = {file: load_object(file) for file in files}
    indexes = {name: index_model(objects[name][1], name) for name in models}
    answered: list[str] = []
    tried, found, targets = 0, 0, 0
    for seed in seeds:
        for number, file in enumerate(files):
            data = recovered_view(*objects[file], 100 * seed + number)
            for name, index in indexes.items():
                result = match(index, data)
                if name == file:
                    targets += 1
                    found += bool(result)
                    continue
                tried += 1
                if result:
                    surplus = result.stats['evidence'] - result.stats['evidence_needed']
                    answered.append(f'{name} in {file} {seed} (+{surplus:.1f} nats)')
    print(
        f'target_decoys  {len(answered)} of {tried} decoys answered: {100 * len(answered) / tried:.2f} %  '
        f'targets accepted {found} of {targets}  {answered[:12]}',
        flush=True,
    )
    return {'searches': tried, 'answered': len(answered), 'targets': targets, 'found': found}


# What a preset returns is what --record keeps; the others only print.
PRESETS: dict[str, Callable[[list[str], range], Any]] = {
    'clutter': clutter,
    'decoys': decoys,
    'low_visible': low_visible,
    'absent': absent,
    'absent_decoys': absent_decoys,
    'instances': instances,
    'prove': prove,
    'large': large,
    'library': library,
    'limits': limits,
    'prefilter': prefilter_kept,
    'false_alarms': false_alarms,
    'target_decoys': target_decoys,
    'unseen': unseen,
}
# Those that have rows of single models, and nothing that adds models up: a job for each model. A preset else is one.
BY_MODEL = ('clutter', 'decoys', 'low_visible', 'absent', 'absent_decoys', 'instances', 'prove')
FIRST_SEEDS = dict.fromkeys(('target_decoys', 'false_alarms', 'prefilter'), 40_000)  # constants: lower ones


class _Job(NamedTuple):
    """A preset of some models over some seeds."""

    preset: str
    models: list[str]
    seeds: range


def _rows(job: _Job) -> dict[str, Any]:
    """What a preset prints and returns."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        figures = PRESETS[job.preset](job.models, job.seeds)
    return {'text': printed.getvalue(), 'figures': figures}


def measured(presets: list[str], models: list[str], options: argparse.Namespace) -> dict[str, Any]:
    """Run presets, print their rows, and return what they return; options: of the command."""
    jobs = {}
    for preset in presets:
        first = FIRST_SEEDS.get(preset, 0) if options.first_seed is None else options.first_seed
        for some in [[name] for name in models] if preset in BY_MODEL else [models]:
            jobs[f'{preset} {",".join(some)}'] = _Job(preset, some, range(first, first + options.seeds))
    done = run_batch(_rows, jobs, options, 'presets', warm_up)
    found: dict[str, Any] = {}
    for name, one in done.items():
        print(one['text'], end='', flush=True)
        preset, figures = jobs[name].preset, one['figures']
        found[preset] = {**found[preset], **figures} if found.get(preset) and figures else figures
    return found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=10, help='scenes for each preset and model')
    parser.add_argument('--presets', default=','.join(PRESETS), help='default: %(default)s')
    parser.add_argument('--models', default=','.join(THESIS_SIZES), help='default: %(default)s')
    parser.add_argument('--first-seed', type=int, help='of every preset; default: 0, or as above')
    add_batch_options(parser)
    add_record_option(parser)
    chosen = parser.parse_args(arguments)
    found = measured(chosen.presets.split(','), chosen.models.split(','), chosen)
    if chosen.record:
        keep(chosen.record, found)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
