"""Libraries of any size: how long a scene takes, how much memory, and whether the right model is among the answers.

    python test/benchmarks/bench_catalogue.py [--models 1000,10000,100000] [--scenes 200] [--rebuild] [--workers 2]

The library is that of parts_generator.py, indexed once and kept in --out; a part of it stands in each scene, three
quarters of its features in view, beside as much that is no part of it (--clutter). Right: an answer has the part's
name; at its pose: within 3 degrees and 3 % of its size, or one of the poses that its symmetry makes equal. --absent N
asks as often for what is not there: a part from the same generator that the library does not have, and what surrounds
it alone. A run that was stopped goes on where it was; --fresh begins it anew, and --rebuild the index, too.
"""

from __future__ import annotations

import argparse
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ambiguity import is_pose
from batches import importable
from parts_generator import FAMILIES, part, parts
from results import add_record_option, keep

from model_matcher.batches.jobs import Store, add_worker_options, run_jobs, workers_of
from model_matcher.catalogue.build import indexed_model, write_catalogue
from model_matcher.catalogue.catalogue import Catalogue, open_catalogue
from model_matcher.closed_form.synthetic.scenes import make_scene
from model_matcher.params import MatchParams
from model_matcher.pipeline import survey

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / 'out' / 'catalogue'
QUANTILES = (50, 95)
# What stands in a scene: a part of the library, a part like those that it does not have, or neither.
PRESENT, ALIKE, NOTHING = 'present', 'alike', 'nothing'
# Seed of the parts that no library has.
OTHER_PARTS = 1000


class Scene(NamedTuple):
    """One scene of a library: its index, the scene's seed, the share of clutter, how long the search may take, and what
    stands in it."""

    index: str
    seed: int
    clutter: float
    time_limit_s: float
    shows: str = PRESENT


def build(path: str, count: int, seed: int) -> dict[str, float]:
    """Make the index of so many parts; seconds, of them writing, and the process' memory."""
    started = time.perf_counter()
    models = [indexed_model(features, name) for name, features in parts(count, seed)]
    made = time.perf_counter()
    write_catalogue(Path(path), models)
    return {
        'seconds': time.perf_counter() - started,
        'writing_s': time.perf_counter() - made,
        'memory_mb': peak_memory(),
        'file_mb': Path(path).stat().st_size / 1e6,
    }


def peak_memory() -> float:
    """Megabytes that this process had at most, mapped pages included."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


@cache
def opened(path: str) -> Catalogue:
    """An index, compiled for and warm: the first scene of a process is not counted."""
    catalogue = open_catalogue(path)
    for seed in (1, 2):
        survey(catalogue, make_scene(catalogue.feature_set(0), seed, clutter=0.5).data)
    return catalogue


def one_scene(job: Scene) -> dict[str, Any]:
    """What became of a scene."""
    catalogue = opened(job.index)
    which = int(np.random.default_rng([job.seed, 5]).integers(len(catalogue)))
    if job.shows != PRESENT:
        return absent_scene(catalogue, job, which)
    scene = make_scene(catalogue.feature_set(which), job.seed, clutter=job.clutter)
    started, used = time.perf_counter(), time.process_time()
    result = survey(catalogue, scene.data, MatchParams(time_limit_s=job.time_limit_s))
    seconds, processor = time.perf_counter() - started, time.process_time() - used
    answers = [one.model for one in result.interpretations]
    name = catalogue.names[which]
    index = catalogue.model(which)
    posed = any(one.model == name and is_pose(one.pose, scene.poses[0], index) for one in result.interpretations)
    return {
        'model': name,
        'features': len(scene.data),
        'seen': len(np.unique(scene.assignment[scene.instance == 0])),
        'answers': answers,
        'right': name in answers,
        'at_its_pose': posed,
        'searched': result.stats['searched'],
        'seconds': seconds,
        'processor_s': processor,
        'memory_mb': peak_memory(),
    }


def absent_scene(catalogue: Catalogue, job: Scene, which: int) -> dict[str, Any]:
    """What is answered where no part of the library is."""
    other = part(which, OTHER_PARTS).feature_set()
    scene = make_scene(other, job.seed, clutter=job.clutter, instances=int(job.shows == ALIKE))
    result = survey(catalogue, scene.data, MatchParams(time_limit_s=job.time_limit_s))
    return {'shows': job.shows, 'answers': [one.model for one in result.interpretations]}


def summary(results: list[dict[str, Any]]) -> dict[str, float]:
    """The figures of one library."""
    seconds = [one['seconds'] for one in results]
    return {
        'scenes': len(results),
        'right': sum(one['right'] for one in results),
        'at_its_pose': sum(one['at_its_pose'] for one in results),
        'others_answered': sum(any(name != one['model'] for name in one['answers']) for one in results),
        **{f'seconds_p{q}': float(np.percentile(seconds, q)) for q in QUANTILES},
        'processor_s_p50': float(np.median([one['processor_s'] for one in results])),
        'searched_p50': float(np.median([one['searched'] for one in results])),
        'memory_mb': max(one['memory_mb'] for one in results),
    }


def absent_figures(results: list[dict[str, Any]]) -> dict[str, float]:
    """How often something was answered where no part of the library is."""
    figures: dict[str, float] = {}
    for shows in (ALIKE, NOTHING):
        some = [bool(one['answers']) for one in results if one.get('shows') == shows]
        if some:
            figures |= {f'{shows}_scenes': len(some), f'{shows}_answered': sum(some)}
    return figures


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--models', default='1000,10000,100000', help='sizes of libraries (default: %(default)s)')
    parser.add_argument('--scenes', type=int, default=200, help='for each (default: %(default)s)')
    parser.add_argument('--absent', type=int, default=0, help='scenes of what is not there, of either kind, for each')
    parser.add_argument('--first-seed', type=int, default=0, help='of the scenes')
    parser.add_argument('--seed', type=int, default=0, help='of the parts')
    parser.add_argument('--clutter', type=float, default=0.5, help='share of the data (default: %(default)s)')
    parser.add_argument(
        '--time-limit',
        type=float,
        default=MatchParams().time_limit_s,
        help='seconds of a search; beside other work it needs more, or that decides what is found (%(default)s)',
    )
    parser.add_argument('--out', type=Path, default=OUT, help='folder of indexes and results (default: out/catalogue)')
    parser.add_argument('--fresh', action='store_true', help='measure what is measured already, too')
    parser.add_argument('--rebuild', action='store_true', help='make the indexes anew, and measure all')
    add_worker_options(parser)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Any] = {}
    # Small ones first: what a process had at most does not fall again.
    for count in sorted(int(text) for text in options.models.split(',')):
        index = options.out / f'parts_{options.seed}_{count}.index'
        made: dict[str, float] = {}
        rebuilt = options.rebuild or not index.exists()
        if rebuilt:
            with ProcessPoolExecutor(1, get_context('spawn')) as pool:
                made = pool.submit(build, str(index), count, options.seed).result()
            print(f'index of {count}: ' + ', '.join(f'{name} {value:.1f}' for name, value in made.items()), flush=True)
        seeds = range(options.first_seed, options.first_seed + options.scenes)
        jobs = {str(seed): Scene(str(index), seed, options.clutter, options.time_limit) for seed in seeds}
        for shows in (ALIKE, NOTHING):
            for seed in seeds[: options.absent]:
                jobs[f'{seed} {shows}'] = Scene(str(index), seed, options.clutter, options.time_limit, shows)
        store = Store(
            options.out / f'scenes_{options.seed}_{count}_{options.clutter:g}.jsonl',
            {'models': count, 'seed': options.seed, 'clutter': options.clutter, 'time_limit': options.time_limit},
            options.fresh or rebuilt,
        )
        every = list(run_jobs(importable(one_scene), jobs, workers_of(options), store, f'{count} models').values())
        results = [one for one in every if 'shows' not in one]
        figures[str(count)] = {
            **summary(results),
            **absent_figures(every),
            **{f'index_{name}': value for name, value in made.items()},
        }
        print_row(count, figures[str(count)], results)
    if options.record:
        keep(options.record, figures, timed=True)
    return 0


def print_row(count: int, row: dict[str, float], results: list[dict[str, Any]]) -> None:
    """What was measured of one library, and which scenes went wrong."""
    wrong = [f'{one["model"]} ({one["seen"]} seen: {",".join(one["answers"])})' for one in results if not one['right']]
    by_family = {family: [one['right'] for one in results if one['model'].startswith(family)] for family in FAMILIES}
    print(
        f'library {count}  {100 * row["right"] / row["scenes"]:5.1f} % of {row["scenes"]:.0f}  '
        f'at its pose {100 * row["at_its_pose"] / row["scenes"]:5.1f} %  median {row["seconds_p50"]:.2f} s  '
        f'p95 {row["seconds_p95"]:.2f} s  processor {row["processor_s_p50"]:.2f} s  {row["memory_mb"]:.0f} MB  '
        + ', '.join(f'{family} {sum(good)}/{len(good)}' for family, good in by_family.items())
        + ''.join(
            f'  {shows}: {row[f"{shows}_answered"]:.0f} of {row[f"{shows}_scenes"]:.0f} answered'
            for shows in (ALIKE, NOTHING)
            if f'{shows}_scenes' in row
        )
        + (f'  wrong: {wrong[:20]}' if wrong else ''),
        flush=True,
    )


if __name__ == '__main__':
    raise SystemExit(main())
