"""From a pair to the poses of known parts, at default parameters: found, right, false, how near, how fast.

Every part of a pair's family that is asked for (those present, and those that are not) is a search of its own:
recovery of the pair, then model_matcher.pipeline.survey of the one part, or with ``--together`` of all at once. A table
with a line a family and one JSON file; ``--record poses`` keeps the table in results/, which later runs print beside
theirs. true_poses.py says what stands where, pose_scoring.py what counts as right.

    python test/benchmarks/bench_poses.py --quick
    python test/benchmarks/bench_poses.py --families openvgr table --draw out/poses
    python test/benchmarks/bench_poses.py --negatives --families openvgr      (parts that are not there: no answer)
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from batches import add_batch_options, one_process, run_batch
from hidden_poses import HIDDEN, hidden_names, hidden_pair
from measure import Absent, Measurement
from pose_scoring import Search, add_witness, drawing, row_of, score_search, summary
from rendered_poses import RENDERED, rendered_pair, view_names
from results import add_record_option, figures_of, keep
from true_pairs import PHOTOREAL_KINDS, QUICK, data_folder, families_of, load_pair
from true_poses import READERS, Part, Pictures, PosedPair, parts_of, posed_names, posed_pair, witness

from model_matcher import MatchResult
from model_matcher.image_pose.views import Views
from model_matcher.pipeline import survey, warm_up
from msgs_py import FeatureSet
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up as warm_up_recovery

HERE = Path(__file__).resolve().parent
REAL_POSED = ('openvgr', 'visp_cube', 'teabox')
DEFAULT = (*REAL_POSED, *PHOTOREAL_KINDS, RENDERED)
# Families that need no data.
MADE = (RENDERED, HIDDEN)
# Real families with pictures of their own: the tags stand in those of the cube.
NEGATIVES = ('openvgr', 'visp_cube', 'teabox', 'chessboards', 'middlebury')
# Pairs of each family that every part is asked for in.
LIMIT = 4


def asked(parts: list[Part], features: FeatureSet, pair: Pictures) -> MatchResult:
    """The search that is measured: by the features of a pair and its images."""
    return survey([part.index for part in parts], features, views=Views.of((pair.left, pair.right), pair.rig))


def asked_without_images(parts: list[Part], features: FeatureSet, pair: Pictures) -> MatchResult:
    """The search by the features alone."""
    return survey([part.index for part in parts], features)


def run(
    families: list[str],
    *,
    data: Path | None = None,
    scenes: list[str] | None = None,
    held: bool = False,
    together: bool = False,
    draw: Path | None = None,
    seeds: int = 2,
    search: Callable[[list[Part], FeatureSet, Pictures], MatchResult] = asked,
    options: argparse.Namespace | None = None,
) -> list[dict[str, Any]]:
    """A row a pair, see :func:`pose_scoring.row_of`. Families without known parts have none.

    seeds : of the noise of each rendered view, and scenes of each hidden model; options : of
    :func:`batches.add_batch_options`
    """
    stored = [family for family in families if family in READERS]
    # Rendered pairs need no data.
    folder = data_folder(data) if stored else Path()
    jobs = {
        f'{family} {name}': _PairJob(folder, family, name, together, draw, search, False)
        for family, name in posed_names(folder, stored, scenes, held)
    }
    if RENDERED in families:
        views = [f'{name} {seed}' for name in view_names() for seed in range(seeds)]
        jobs |= {name: _PairJob(folder, RENDERED, name, together, draw, search, False) for name in views}
    if HIDDEN in families:
        jobs |= {name: _PairJob(folder, HIDDEN, name, together, draw, search, False) for name in hidden_names(seeds)}
    return list(run_batch(_row, jobs, options or one_process(), 'pairs', _ready).values())


class _PairJob(NamedTuple):
    """A pair, and how it is searched; absent : for every part that it does not show, and no other."""

    folder: Path
    family: str
    name: str
    together: bool
    draw: Path | None
    search: Callable[[list[Part], FeatureSet, Pictures], MatchResult]
    absent: bool


def _row(job: _PairJob) -> dict[str, Any]:
    if job.family == RENDERED:
        name, seed = job.name.rsplit(' ', 1)
        posed = rendered_pair(name, int(seed))
    elif job.family == HIDDEN:
        posed = hidden_pair(job.name)
    else:
        posed = posed_pair(job.folder, load_pair(job.folder, job.family, job.name))
    if job.absent:
        present = {one.part.name for one in posed.instances}
        others = tuple(part for part in parts_of(job.folder) if part.name not in present)
        posed = PosedPair(posed.pair, posed.instances, others)
    recovery_ms, features = recovered(posed.pair)
    searches = searched(posed, features, job.together, job.search)
    eye = None if job.absent else witness(job.folder, posed.pair)
    if eye is not None:
        add_witness(posed, searches, eye)
    if job.draw is not None:
        job.draw.mkdir(parents=True, exist_ok=True)
        name = f'{posed.pair.family}_{posed.pair.name.replace(" ", "_")}.png'
        cv2.imwrite(str(job.draw / name), drawing(posed, searches))
    return row_of(posed, searches, recovery_ms, len(features))


def recovered(pair: Pictures) -> tuple[float, FeatureSet]:
    """Milliseconds and the features of a pair."""
    since = time.perf_counter()
    features = recover(pair.left, pair.right, pair.rig).features
    return 1e3 * (time.perf_counter() - since), features


def searched(
    posed: PosedPair,
    features: FeatureSet,
    together: bool,
    search: Callable[[list[Part], FeatureSet, Pictures], MatchResult] = asked,
) -> list[Search]:
    """Every part asked for, judged. Together, each part is told the time of the one search, shared among them."""
    groups = [list(posed.asked)] if together else [[part] for part in posed.asked]
    searches = []
    for group in groups:
        since = np.array([time.perf_counter(), time.process_time()])
        result = search(group, features, posed.pair)
        taken = 1e3 * (np.array([time.perf_counter(), time.process_time()]) - since) / max(len(group), 1)
        searches += [score_search(posed, part, _of_part(result, part), *taken.tolist()) for part in group]
    return searches


def _of_part(result: MatchResult, part: Part) -> MatchResult:
    """What a result says of one part."""
    mine = (tuple(one for one in ones if one.model == part.name) for ones in (result.interpretations, result.rejected))
    interpretations, rejected = mine
    return replace(result, interpretations=interpretations, rejected=rejected)


def run_negatives(
    families: list[str],
    data: Path | None = None,
    scenes: list[str] | None = None,
    limit: int = LIMIT,
    options: argparse.Namespace | None = None,
) -> list[dict[str, Any]]:
    """A row a pair, as of :func:`run`, of every part that there is a model of and that the pair does not show."""
    folder = data_folder(data)
    jobs = {
        f'{family} {name}': _PairJob(folder, family, name, False, None, asked, True)
        for family, name in _spread(posed_names(folder, families, scenes), limit)
    }
    return list(run_batch(_row, jobs, options or one_process(), 'absent', _ready).values())


def _spread(pairs: list[tuple[str, str]], limit: int) -> Iterator[tuple[str, str]]:
    """At most so many pairs of each family, evenly from all of it."""
    for _, group in groupby(pairs, lambda pair: pair[0]):
        all_of_it = list(group)
        chosen = np.unique(np.linspace(0, len(all_of_it) - 1, min(limit, len(all_of_it))).round().astype(int))
        yield from (all_of_it[k] for k in chosen)


# -- tables ----------------------------------------------------------------------------------------------------

# Column, key of the summary, digits.
COLUMNS = (
    ('pairs', 'pairs', 0),
    ('asked', 'searches', 0),
    ('there', 'to_find', 0),
    ('found', 'found', 0),
    ('share', 'found_share', 2),
    ('ref', 'refused_best', 0),
    ('ref any', 'refused_any', 0),
    ('right', 'right', 0),
    ('twice', 'twice', 0),
    ('ambig', 'ambiguous', 0),
    ('wrong', 'wrong', 0),
    ('absent', 'absent', 0),
    ('false', 'false', 0),
    ('like', 'like', 0),
    ('deg', 'deg', 3),
    ('p90', 'deg_p90', 2),
    ('mm', 'mm', 3),
    ('p90', 'mm_p90', 2),
    ('depth %', 'depth_percent', 3),
    ('stated', 'stated', 2),
    ('x bound', 'times_bound', 1),
    ('b deg', 'bound_deg', 4),
    ('b mm', 'bound_mm', 4),
    ('eye3 px', 'witness_px', 2),
    ('true px', 'witness_true_px', 2),
    ('ms', 'ms', 1),
    ('p99', 'ms_p99', 0),
    ('max', 'ms_max', 0),
    ('cpu ms', 'cpu_ms', 1),
    ('rec ms', 'recovery_ms', 0),
)
LEGEND = """\
asked: searches, a part each; there, found, share: instances that have to be found, and are
ref, ref any: of the others, those whose right pose is the best rejected hypothesis, or any rejected one
right, twice, wrong: answers by instance, about one that has a better answer, about none of a part that is there; ambig:
those that name another pose, or leave a turn open, which is right
absent, false: searches for parts that are not there, and their answers; like: wrong or false, on a part nearly the same
deg, mm, depth %: of right answers, medians and p90, at the part's middle, symmetric poses equal
stated: squared errors in units of the stated covariance and of what the truth may be off, over chi squared's median: 1
where covariances are true
x bound: errors in units of the Cramer-Rao bound of the visible edges, median; b deg, b mm: that bound, rms
eye3, true: rms of creases at the found and at the true pose in the eye that took no part, median of answers
ms: a search, median, p99 and greatest; cpu ms: its processor time, which other work does not lengthen, median
rec ms: recovery of a pair, median"""


def summaries(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Of all that is not rendered, of the photo-real ones together, and by family."""
    result = {}
    stored = [row for row in rows if row['family'] not in MADE]
    if len({row['family'] for row in stored}) > 1:
        result['all'] = summary(stored)
    photoreal = [row for row in rows if row['family'] in PHOTOREAL_KINDS]
    families = list(dict.fromkeys(row['family'] for row in rows))
    if len({row['family'] for row in photoreal}) > 1:
        result['photoreal'] = summary(photoreal)
    for family in families:
        result[family] = summary([row for row in rows if row['family'] == family])
    return result


def table(rows: list[dict[str, Any]], baseline: dict[str, Any] | None = None) -> str:
    """A line a family, under it the baseline's."""
    lines = [f'{"":<12}' + ''.join(f'{name:>8}' for name, _, _ in COLUMNS)]
    for family, figures in summaries(rows).items():
        lines.append(_line(family, figures))
        if baseline and family in baseline:
            lines.append(_line('  baseline', baseline[family]))
    return '\n'.join(lines)


def _line(name: str, figures: dict[str, Any]) -> str:
    return f'{name:<12}' + ''.join(f'{_cell(figures.get(key), digits):>8}' for _, key, digits in COLUMNS)


def _cell(value: float | None, digits: int) -> str:
    return '-' if value is None or not np.isfinite(value) else f'{value:.{digits}f}'


def search_table(rows: list[dict[str, Any]], whole: bool = True) -> str:
    """A line a search; not whole: of those only that were answered."""
    lines = []
    for row in rows:
        for search in row['searches']:
            if not whole and not search['answers']:
                continue
            told = [
                answer['verdict']
                + (' (like)' if answer['like'] else '')
                + ('' if answer['deg'] is None else f' {answer["deg"]:.3g} deg {answer["mm"]:.3g} mm')
                for answer in search['answers']
            ]
            state = f'{search["found"]} of {search["to_find"]}' if search['present'] else 'absent'
            refused = f'; {search["refused_any"]} right ones refused' if search['refused_any'] else ''
            why = f' [{search["why"]}]' if search['why'] else ''
            lines.append(
                f'{row["pair"]:<19}{search["part"]:<17}{state:<8}{search["ms"]:>9.1f} ms  '
                + (', '.join(told) or '-')
                + refused
                + why
            )
    return '\n'.join(lines)


# -- commands --------------------------------------------------------------------------------------------------


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py: what is found and what is wrong, by kind of pair."""
    try:
        _ready()
        rows = run(list(DEFAULT), scenes=list(QUICK) if quick else None, seeds=1 if quick else 2)
    except FileNotFoundError as error:
        yield Absent('poses', str(error))
        return
    for family, figures in summaries(rows).items():
        if figures['found_share'] is not None:
            yield Measurement(f'{family}: instances found', 100.0 * figures['found_share'], '%', lower_is_better=False)
        mistakes = figures['wrong'] + figures['false'] + figures['twice']
        yield Measurement(f'{family}: wrong, twice or absent', mistakes, 'of ' + str(figures['searches']))
        for key, what in (('deg', 'rotation'), ('mm', 'translation'), ('ms', 'a search')):
            if figures[key] is not None:
                yield Measurement(f'{family}: {what}', figures[key], key)


def _ready() -> None:
    warm_up_recovery()
    warm_up(images=True)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description='Poses of known parts from pairs with truth.')
    parser.add_argument('--data', type=Path, help='folder with photoreal/ and real/ (default: STEREO_DATA, ../shared)')
    parser.add_argument(
        '--families',
        nargs='+',
        help="names, photoreal, real, all, rendered (the thesis' views), hidden (three tenths of each, among clutter); "
        'default: all with poses but hidden',
    )
    parser.add_argument('--scenes', nargs='+', help='pairs whose names begin so')
    parser.add_argument('--quick', action='store_true', help='nine pairs of all families')
    parser.add_argument('--held', action='store_true', help='with the pairs that are kept for the end')
    parser.add_argument('--together', action='store_true', help='all parts of a pair in one search')
    parser.add_argument('--negatives', action='store_true', help='only parts that are not there, all there are')
    parser.add_argument('--seeds', type=int, default=2, metavar='N', help='of each rendered view, and hidden model')
    parser.add_argument('--limit', type=int, default=LIMIT, metavar='N', help='with --negatives: pairs of each family')
    parser.add_argument('--images', choices=('on', 'off'), default='on', help='whether the search looks at the images')
    parser.add_argument('--draw', type=Path, metavar='FOLDER', help='both images with the parts where they were found')
    add_batch_options(parser)
    add_record_option(parser)
    parser.add_argument('--json', type=Path, default=HERE.parents[1] / 'out' / 'poses.json', help='the JSON file')
    options = parser.parse_args(arguments)
    try:
        given = options.families or (NEGATIVES if options.negatives else DEFAULT)
        families = [*families_of([f for f in given if f not in MADE]), *(f for f in given if f in MADE)]
    except ValueError as error:
        parser.error(str(error))
    scenes = list(QUICK) if options.quick else options.scenes
    _ready()
    since = time.perf_counter()
    try:
        if options.negatives:
            rows = run_negatives(families, options.data, scenes, options.limit, options)
        else:
            rows = run(
                families,
                data=options.data,
                scenes=scenes,
                held=options.held,
                together=options.together,
                draw=options.draw,
                seeds=1 if options.quick else options.seeds,
                search=asked if options.images == 'on' else asked_without_images,
                options=options,
            )
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    whole = not (options.scenes or options.held or options.together or options.limit != LIMIT)
    kept = figures_of('poses_negatives' if options.negatives else 'poses_quick' if options.quick else 'poses')
    print(search_table(rows, not options.negatives))
    print()
    print(table(rows, kept if whole else None))
    print(LEGEND)
    print(f'{len(rows)} pairs in {time.perf_counter() - since:.1f} s')
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_text(json.dumps({'families': summaries(rows), 'pairs': rows}, indent=1))
    if options.record:
        keep(options.record, summaries(rows))
    return 0


if __name__ == '__main__':
    sys.exit(main())
