"""Recovery on our pictures of the path traced scenes, beside recovery on the path tracer's own.

Each scene is built again from the script that made it (traced_scenes.py), rendered by the native engine with textures,
GGX metal, an environment and lights with a size, and developed by the same camera. Recovery is scored on both pictures
against the same truth. The table has, for each family and for all, recall, the share that is right (precision) and the
errors of ends, on theirs and on ours, and the difference in per cent of theirs.

    python test/benchmarks/bench_effects.py --quick
    python test/benchmarks/bench_effects.py --draw out/effects
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from batches import add_batch_options, one_process, run_batch
from measure import OURS, Absent, Measurement
from pair_scoring import score, summary
from results import add_record_option, keep
from traced_scenes import Unbuilt, build, pictures
from true_pairs import PHOTOREAL_KINDS, TruePair, data_folder, load_pair, pair_names

from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up

HERE = Path(__file__).resolve().parent
Row = dict[str, Any]
# One of each kind, small pictures, quickly built.
QUICK = ('table0002', 'metal0004', 'rims0003', 'print0002')
# Poses of the parts may differ so much from the truth's, which is written with nine digits, metres.
SAME_POSE = 1e-6
# Column of the table, key of the summary, digits.
FIGURES = (
    ('recall', 'recall', 3),
    ('right', 'right', 3),
    ('mm across', 'across_mm', 3),
    ('mm along', 'end_mm', 2),
    ('deg', 'angle_deg', 3),
)


def run(
    data: Path | None = None,
    quick: bool = False,
    scenes: list[str] | None = None,
    draw: Path | None = None,
    options: argparse.Namespace | None = None,
) -> tuple[list[tuple[Row, Row]], list[str]]:
    """Scores on theirs and on ours, and what could not be built.

    options : of :func:`batches.add_batch_options`

    Returns
    -------
    list of (dict, dict)
        A pair each: scores on the path tracer's pictures and on ours, with family and pair.
    list of str
        Names of the scenes that were left out, each with the reason.
    """
    folder = data_folder(data)
    wanted = list(QUICK) if quick else scenes
    jobs = {
        name: (str(folder), family, name, None if draw is None else str(draw))
        for family in PHOTOREAL_KINDS
        for name in pair_names(folder, family, held=False)
        if not wanted or any(name.startswith(begin) for begin in wanted)
    }
    done = run_batch(_both, jobs, options or one_process(), 'pairs', warm_up)
    rows = [(found[0], found[1]) for found in done.values() if not isinstance(found, str)]
    return rows, [f'{name}: {why}' for name, why in done.items() if isinstance(why, str)]


def _both(job: tuple[str, str, str, str | None]) -> list[Row] | str:
    """Scores on both pictures of a pair, or why its scene could not be built."""
    data, family, name, draw = job
    pair = load_pair(Path(data), family, name)
    try:
        ours = rendered_pair(Path(data) / 'photoreal', pair)
    except Unbuilt as error:
        return str(error)
    if draw is not None:
        Path(draw).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(Path(draw) / f'{name}.png'), np.hstack([pair.left, ours.left]))
    return [
        {'family': family, 'pair': name, **score(pair, recover(seen.left, seen.right, seen.rig).features)}
        for seen in (pair, ours)
    ]


def rendered_pair(folder: Path, pair: TruePair) -> TruePair:
    """A pair with our pictures. Raises Unbuilt where its scene does not come out as its truth says."""
    truth = json.loads((folder / 'truth' / f'{pair.name}.json').read_text())
    built = build(folder, truth['family'], truth['seed'])
    said = [np.array(instance['left_T_part']) for instance in truth['instances']]
    if len(said) != len(built.instances) or any(np.abs(a - b).max() > SAME_POSE for a, b in zip(said, built.instances)):
        raise Unbuilt('its parts lie elsewhere than in the pictures')
    left, right = pictures(built)
    return replace(pair, left=left, right=right)


def compared(rows: list[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, dict[str, tuple[float, float]]]:
    """For each family, and for all together as 'photoreal': figures on theirs and on ours."""
    result = {}
    families = ['photoreal', *dict.fromkeys(theirs['family'] for theirs, _ in rows)]
    for family in families:
        own = [row for row in rows if family in ('photoreal', row[0]['family'])]
        theirs, ours = (summary([row[side] for row in own]) for side in (0, 1))
        result[family] = {key: (theirs[key], ours[key]) for _, key, _ in FIGURES}
    return result


def table(figures: dict[str, dict[str, tuple[float, float]]]) -> str:
    """A line a family: theirs, ours, and the difference in per cent of theirs."""
    lines = [f'{"":<12}' + ''.join(f'{name + ": traced, ours, %":>30}' for name, _, _ in FIGURES)]
    for family, values in figures.items():
        cells = ''.join(
            f'{_cell(values[key][0], digits):>12}{_cell(values[key][1], digits):>9}{_cell(percent(values[key]), 0):>9}'
            for _, key, digits in FIGURES
        )
        lines.append(f'{family:<12}{cells}')
    return '\n'.join(lines)


def percent(values: tuple[float | None, float | None]) -> float:
    """By how much ours differs from theirs, per cent of theirs."""
    theirs, ours = (np.nan if value is None else value for value in values)
    return 100.0 * (ours - theirs) / theirs if theirs else float('nan')


def _cell(value: float | None, digits: int) -> str:
    return '-' if value is None or not np.isfinite(value) else f'{value:.{digits}f}'


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py: by how much recovery on ours differs from recovery on theirs, all families together."""
    try:
        rows, left_out = run(quick=quick)
    except FileNotFoundError as error:
        yield Absent('effects', str(error))
        return
    if not rows:
        yield Absent('effects', '; '.join(left_out[:1]))
        return
    for name, key, _ in FIGURES:
        off = percent(compared(rows)['photoreal'][key])
        yield Measurement(f'our pictures of traced scenes: {name} differs by', abs(off), '%', OURS, True)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, help='folder with photoreal/ (default: STEREO_DATA, ../shared)')
    parser.add_argument('--scenes', nargs='+', help='pairs whose names begin so')
    parser.add_argument('--quick', action='store_true', help=f'{len(QUICK)} pairs')
    parser.add_argument('--draw', type=Path, metavar='FOLDER', help="left pictures: the path tracer's beside ours")
    add_batch_options(parser)
    add_record_option(parser)
    parser.add_argument('--out', type=Path, default=HERE.parents[1] / 'out' / 'effects.json', help='the JSON file')
    options = parser.parse_args(arguments)
    try:
        rows, left_out = run(options.data, options.quick, options.scenes, options.draw, options)
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    for line in left_out:
        print(f'left out: {line}')
    if not rows:
        return 1
    figures = compared(rows)
    print(f'{len(rows)} pairs')
    print(table(figures))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps({'families': figures, 'pairs': rows}, indent=1))
    if options.record:
        keep(options.record, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
