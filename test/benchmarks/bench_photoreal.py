"""Stereo recovery on path-traced and on real pairs with truth, beside LSD laid on semi-global disparity.

A table with a line a family, and one JSON file; ``--record pairs`` keeps the table in results/, which every later run
prints beside its own. ``--recover module:function`` runs another recover(left, right, rig) in place of today's.

    python test/benchmarks/bench_photoreal.py --quick
    python test/benchmarks/bench_photoreal.py --families real table --draw out/drawings
    python test/benchmarks/bench_real.py --cameras 3 --no-peer        (pairs whose third eye there is: openvgr)
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from batches import add_batch_options, one_process, run_batch
from lost_length import LEGEND as STAGES_LEGEND
from lost_length import lost_lengths, stage_table
from measure import OURS, Absent, Measurement
from pair_scoring import drawing, score, semi_global_edges, summary
from results import add_record_option, figures_of, keep
from third_eyes import WITH_THREE, with_third_eye
from true_pairs import (
    CACHE,
    FAMILIES,
    PHOTOREAL_KINDS,
    QUICK,
    TruePair,
    data_folder,
    families_of,
    line_segments,
    load_pair,
    pair_names,
)

from msgs_py import FeatureSet
from stereo_recovery import recover as todays_recover
from stereo_recovery.pipeline import warm_up

HERE = Path(__file__).resolve().parent
PEER = 'LSD + semi-global'
DEFAULT = ('photoreal',)
# Everything whose change changes a score: kept scores of the peer carry it.
_SOURCES = ''.join((HERE / name).read_text() for name in ('true_pairs.py', 'pair_scoring.py'))
LSD_RUNS = 3


def run(
    recover: Callable[..., Any] = todays_recover,
    families: list[str] | tuple[str, ...] = DEFAULT,
    limit: int | None = None,
    *,
    scenes: list[str] | None = None,
    held: bool = False,
    data: Path | None = None,
    peer: bool = False,
    draw: Path | None = None,
    quick: bool = False,
    repeat: int = 1,
    cameras: int = 2,
    options: argparse.Namespace | None = None,
) -> list[dict[str, Any]]:
    """A row a pair: family, pair, everything of :func:`pair_scoring.score`, ms, stages, lsd_ms, in_lsd, and the peer's
    row under ``peer``. limit: pairs of each family; quick: the dozen of true_pairs.QUICK, whatever the families.

    options: of :func:`batches.add_batch_options`; with ``stages`` a row has ``lost``, of
    :func:`lost_length.lost_lengths`. repeat: the time is the least of so many calls. cameras: 3 for the third eye of
    the pair beside it. An exception of ``recover`` becomes the row's ``error``, and nothing is found.
    """
    folder = data_folder(data)
    names = families_of(('all',) if quick else families)
    begin = list(QUICK) if quick else scenes
    stages = getattr(options, 'stages', False)
    jobs = {
        f'{family} {name}': _PairJob(folder, family, name, None if cameras > 2 else recover, peer, draw, repeat, stages)
        for family in names
        for name in [
            name
            for name in pair_names(folder, family, held)
            if not begin or any(name.startswith(scene) for scene in begin)
        ][:limit]
    }
    return list(run_batch(_row, jobs, options or one_process(), 'pairs', warm_up).values())


class _PairJob(NamedTuple):
    """A pair, and what is done with it; recover: None for three cameras."""

    folder: Path
    family: str
    name: str
    recover: Callable[..., Any] | None
    peer: bool
    draw: Path | None
    repeat: int
    stages: bool


def _row(job: _PairJob) -> dict[str, Any]:
    folder, family, name, recover, peer, draw, repeat, stages = job
    pair = load_pair(folder, family, name)

    def method(pair: TruePair) -> Any:
        return with_third_eye(folder)(pair) if recover is None else recover(pair.left, pair.right, pair.rig)

    row: dict[str, Any] = {'family': pair.family, 'pair': pair.name}
    lsd, lsd_cpu, _ = _least(lambda: (line_segments(pair.left), line_segments(pair.right)), LSD_RUNS)
    try:
        ms, cpu, found = _least(lambda: method(pair), repeat)
    except Exception as error:  # one pair that fails must not hide the others
        ms, cpu, found = float('nan'), float('nan'), FeatureSet.empty()
        row['error'] = f'{type(error).__name__}: {error}'
    features = getattr(found, 'features', found)
    scoring_ms, scores = _milliseconds(lambda: score(pair, features))
    row |= scores
    stages = {key: round(value, 2) for key, value in getattr(found, 'milliseconds', {}).items()}
    row |= {
        'ms': ms,
        'stages': stages,
        'lsd_ms': lsd,
        'in_lsd': ms / lsd,
        'cpu_in_lsd': cpu / lsd_cpu,
        'scoring_ms': scoring_ms,
    }
    if peer:
        row['peer'] = _peer_row(pair)
    if stages:
        row['lost'] = lost_lengths(pair, lambda: method(pair))
    if draw is not None:
        draw.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(draw / f'{pair.family}_{pair.name.replace(" ", "_")}.png'), drawing(pair, features))
    return row


def _milliseconds(work: Callable[[], Any]) -> tuple[float, Any]:
    since = time.perf_counter()
    result = work()
    return 1e3 * (time.perf_counter() - since), result


def _least(work: Callable[[], Any], count: int) -> tuple[float, float, Any]:
    """Least milliseconds of so many calls, least milliseconds of all processors, and the last result."""
    walls, processors = [], []
    for _ in range(count):
        since = time.process_time()
        wall, result = _milliseconds(work)
        walls.append(wall)
        processors.append(1e3 * (time.process_time() - since))
    return min(walls), max(min(processors), 1e-3), result


def _peer_row(pair: TruePair) -> dict[str, Any]:
    """The peer's score, from the cache when nothing has changed: it is the same in every run."""
    path = CACHE / f'peer-{pair.name.replace(" ", "_")}.json'
    state = f'{_hash(_SOURCES)}{cv2.__version__}{pair.left.sum()}{pair.right.sum()}'
    try:
        kept = json.loads(path.read_text())
        if kept['state'] == state:
            return kept['row']
    except (OSError, ValueError, KeyError):
        pass
    ms, features = _milliseconds(lambda: semi_global_edges(pair))
    row = {**score(pair, features), 'ms': ms}
    CACHE.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({'state': state, 'row': row}))
    return row


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


# -- tables ----------------------------------------------------------------------------------------------------

# Column, key of the summary, digits.
COLUMNS = (
    ('pairs', 'pairs', 0),
    ('recall', 'recall', 3),
    ('>=40', 'recall_40', 2),
    ('20-40', 'recall_20', 2),
    ('6-20', 'recall_6', 2),
    ('rows', 'recall_flat', 2),
    ('right', 'right', 3),
    ('gross', 'gross', 3),
    ('parts', 'right_parts', 3),
    ('deg', 'angle_deg', 2),
    ('mm', 'across_mm', 3),
    ('p90', 'across_mm_p90', 2),
    ('ends', 'end_mm', 2),
    ('in per', 'inside_per', 2),
    ('in par', 'inside_par', 2),
    ('period', 'wrong_period', 3),
    ('circ', 'circles', 0),
    ('found', 'circles_found', 0),
    ('twice', 'circles_twice', 0),
    ('nothing', 'curves_on_nothing', 0),
    ('r %', 'radius_percent', 2),
    ('~recall', 'pair_recall', 3),
    ('~right', 'pair_right', 3),
    ('~gross', 'pair_gross', 3),
    ('~ms', 'pair_ms', 0),
    ('~LSDs', 'pair_in_lsd', 1),
    ('~cpu', 'pair_cpu_in_lsd', 1),
)
LEGEND = """\
recall: share of the true length found, then by contrast of the edge and near the rows
right, gross: of the reported length, within 1 px and more than 3 px off; parts: right on the known objects only
deg, mm, p90, ends: errors of direction, of the ends across (squares / 1000 on chessboards) and along
in per, in par: ends inside the bounds; period: reported length a period off
circ, found, twice, nothing, r %: circles there, found, found twice, on nothing, error of radius; ~: median of pairs
~LSDs, ~cpu: time, and time of all processors, of a recovery over LSD's in both images"""


def summaries(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """By family, and for the photo-real ones together."""
    result: dict[str, dict[str, Any]] = {}
    photoreal = [row for row in rows if row['family'] in PHOTOREAL_KINDS]
    if photoreal:
        result['photoreal'] = summary(photoreal)
    for family in FAMILIES:
        own = [row for row in rows if row['family'] == family]
        if own:
            result[family] = summary(own)
    return result


def table(rows: list[dict[str, Any]], baseline: dict[str, Any] | None = None) -> str:
    """A line a family, under it the peer's and the baseline's."""
    lines = [f'{"":<22}' + ''.join(f'{name:>8}' for name, _, _ in COLUMNS)]

    def line(name: str, figures: dict[str, Any]) -> str:
        cells = ''.join(f'{_cell(figures.get(key), digits):>8}' for _, key, digits in COLUMNS)
        return f'{name:<22}{cells}'

    peers = summaries([{**row['peer'], 'family': row['family']} for row in rows if 'peer' in row])
    for family, figures in summaries(rows).items():
        lines.append(line(family, figures))
        if family in peers:
            lines.append(line('  LSD + semi-global', peers[family]))
        if baseline and family in baseline:
            lines.append(line('  baseline', baseline[family]))
    return '\n'.join(lines)


def _cell(value: float | None, digits: int) -> str:
    return '-' if value is None or not np.isfinite(value) else f'{value:.{digits}f}'


def pair_table(rows: list[dict[str, Any]]) -> str:
    """A line a pair."""
    lines = [f'{"":<16}{"recall":>8}{"rows":>8}{"right":>8}{"gross":>8}{"edges":>7}{"ms":>8}{"LSDs":>7}  stages']
    for row in rows:
        cells = ''.join(f'{_cell(row[key], 3):>8}' for key in ('recall', 'recall_flat', 'right', 'gross'))
        stages = ' '.join(f'{key} {value:.0f}' for key, value in row['stages'].items())
        lines.append(
            f'{row["pair"]:<16}{cells}{row["edges"]:>7}{_cell(row["ms"], 0):>8}{_cell(row["in_lsd"], 1):>7}  '
            f'{row.get("error", stages)}'
        )
    return '\n'.join(lines)


# -- commands --------------------------------------------------------------------------------------------------


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py: the figures of the photo-real families."""
    yield from measured(('photoreal',), 1 if quick else None)


def measured(families: tuple[str, ...], limit: int | None) -> Iterator[Measurement | Absent]:
    """Recall, right share and time of families, ours and the peer's."""
    try:
        warm_up()
        rows = run(families=families, limit=limit, peer=True)
    except FileNotFoundError as error:
        yield Absent(', '.join(families), str(error))
        return
    peers = summaries([{**row['peer'], 'family': row['family']} for row in rows])
    for family, figures in summaries(rows).items():
        for by, of in ((OURS, figures), (PEER, peers[family])):
            for what, key, unit, lower in (
                ('recall', 'recall', '%', False),
                ('right', 'right', '%', False),
                ('gross', 'gross', '%', True),
            ):
                if of[key] is not None:
                    yield Measurement(f'{family}: {what}', 100.0 * of[key], unit, by, lower)
            if of['pair_ms'] is not None:
                yield Measurement(f'{family}: time', of['pair_ms'], 'ms', by)


def function_named(text: str) -> Callable[..., Any]:
    """``module:function``, the module from the path or the working folder."""
    module, _, name = text.partition(':')
    if not name:
        raise argparse.ArgumentTypeError(f'expected module:function, got {text!r}')
    sys.path.insert(0, str(Path.cwd()))
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise argparse.ArgumentTypeError(f'{text}: {error}') from None


def main(arguments: list[str] | None = None, default: tuple[str, ...] = DEFAULT) -> int:
    parser = argparse.ArgumentParser(description='Stereo recovery on pairs with truth.')
    parser.add_argument('--data', type=Path, help='folder with photoreal/ and real/ (default: STEREO_DATA, ../shared)')
    parser.add_argument('--families', nargs='+', default=list(default), help='names, photoreal, real or all')
    parser.add_argument('--scenes', nargs='+', help='pairs whose names begin so')
    parser.add_argument('--quick', action='store_true', help='a dozen pairs of all families')
    parser.add_argument('--limit', type=int, metavar='N', help='pairs of each family')
    parser.add_argument('--held', action='store_true', help='with the pairs that are kept for the end')
    parser.add_argument(
        '--cameras', type=int, choices=(2, 3), default=2, help='3: with the third eye, where there is one'
    )
    parser.add_argument('--no-peer', action='store_true', help='without LSD on semi-global disparity')
    parser.add_argument(
        '--draw', type=Path, metavar='FOLDER', help='left images: found green, missed red, false magenta'
    )
    parser.add_argument('--stages', action='store_true', help='at which stage the length that is not found is lost')
    parser.add_argument('--recover', type=function_named, default=todays_recover, metavar='MODULE:FUNCTION')
    parser.add_argument('--repeat', type=int, default=1, metavar='N', help='times are the least of N calls')
    add_batch_options(parser)
    add_record_option(parser)
    parser.add_argument('--out', type=Path, default=HERE.parents[1] / 'out' / 'pairs.json', help='the JSON file')
    options = parser.parse_args(arguments)
    try:
        families = families_of(options.families if options.cameras == 2 else WITH_THREE)
    except ValueError as error:
        parser.error(str(error))
    warm_up()
    since = time.perf_counter()
    try:
        rows = run(
            options.recover,
            families,
            options.limit,
            scenes=options.scenes,
            held=options.held,
            data=options.data,
            peer=not options.no_peer,
            draw=options.draw,
            quick=options.quick,
            repeat=options.repeat,
            cameras=options.cameras,
            options=options,
        )
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    whole = options.cameras == 2 and not (options.scenes or options.limit or options.quick or options.held)
    kept = figures_of('pairs_quick' if options.quick else 'pairs')
    print(pair_table(rows))
    print()
    print(table(rows, kept if whole or options.quick else None))
    print(LEGEND)
    if options.stages:
        print()
        print(stage_table(rows))
        print(STAGES_LEGEND)
    recovery, scoring = (1e-3 * float(np.nansum([row[key] for row in rows])) for key in ('ms', 'scoring_ms'))
    took = time.perf_counter() - since
    print(f'{len(rows)} pairs in {took:.1f} s, of which recovery {recovery:.1f} s, scores {scoring:.1f} s')
    found = summaries(rows)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps({'families': found, 'pairs': rows}, indent=1))
    if options.record:
        keep(options.record, found)
    return 0


if __name__ == '__main__':
    sys.exit(main())
