"""Line segments of single images: what of the true edges they cover, how near they are, how many, how fast; beside LSD.

A sample of a true edge (true_pairs.py; the left and the right image of each pair) is covered when a segment passes
within ACROSS_PX of it and within SAME_DEG of its direction. ``--quick`` takes a dozen pairs. Middlebury's edges to find
are LSD's own.

    python test/benchmarks/bench_detection.py --quick
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from bench_photoreal import function_named
from measure import OURS, Absent, Measurement
from true_pairs import (
    PHOTOREAL_KINDS,
    QUICK,
    TruePair,
    _image_slope,
    data_folder,
    families_of,
    line_segments,
    load_pairs,
)

from stereo_recovery import RecoveryParams
from stereo_recovery.detection.edgels import as_grey
from stereo_recovery.detection.view import detect_view
from stereo_recovery.pipeline import warm_up

PEER = 'LSD'
ACROSS_PX, SAME_DEG = 1.5, 5.0
# What is known to be all there is to see: the squares of a board, machined parts before a plain ground.
COMPLETE = ('chessboards', 'openvgr')
CLASSES = (('>=40', 40.0, np.inf), ('20-40', 20.0, 40.0), ('6-20', 6.0, 20.0))
TIMES = 3


def ours(image: np.ndarray) -> np.ndarray:
    """(n, 4) float64, pixels: ends of the segments that are matched."""
    params = RecoveryParams()
    found = detect_view(as_grey(image), params.detector, params.sigma, params.low, params.high).matchable
    return np.hstack([found.start, found.end])


def true_samples(pair: TruePair) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Image, pixel (s, 2) and slope (s, 2) of the true samples, of both eyes; the left one alone where direction in
    space is not known."""
    yield pair.left, pair.pixel, pair.slope
    if len(pair.point) and np.isfinite(pair.direction).all():
        slope = _image_slope(pair.point, pair.direction, pair.rig, pair.rig.baseline)
        yield pair.right, pair.rig.project(pair.point)[1], slope


def cover(lines: np.ndarray, pixel: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The segment that covers each sample, -1: none, and its signed distance from the sample, pixels; the nearest."""
    best, off = np.full(len(pixel), -1), np.full(len(pixel), np.inf)
    if len(pixel) == 0:
        return best, off
    low, high = pixel.min(axis=0), pixel.max(axis=0)
    for number, (u, v, x, y) in enumerate(lines):
        length = float(np.hypot(x - u, y - v))
        if length < 1e-6 or max(u, x) < low[0] - 2.0 or min(u, x) > high[0] + 2.0:
            continue
        box = (
            np.abs(pixel - [(u + x) / 2, (v + y) / 2]) <= [abs(x - u) / 2 + ACROSS_PX, abs(y - v) / 2 + ACROSS_PX]
        ).all(1)
        index = np.flatnonzero(box)
        t = np.array([x - u, y - v]) / length
        away = pixel[index] - [u, v]
        along, across = away @ t, away @ [-t[1], t[0]]
        on = (along >= 0.0) & (along <= length) & (np.abs(across) < np.minimum(ACROSS_PX, np.abs(off[index])))
        on &= np.abs(slope[index] @ t) >= np.cos(np.radians(SAME_DEG))
        best[index[on]], off[index[on]] = number, across[on]
    return best, off


def score(lines: np.ndarray, pair: TruePair, image: np.ndarray, pixel: np.ndarray, slope: np.ndarray) -> dict[str, Any]:
    """A row of lengths and errors of one image; shares are made of the sums of several."""
    best, off = cover(lines, pixel, slope)
    asked, weight = pair.asked, pair.weight
    found = asked & (best >= 0)
    row: dict[str, Any] = {'segments': len(lines), 'asked': weight[asked].sum(), 'found': weight[found].sum()}
    for name, low, high in CLASSES:
        own = asked & (pair.contrast >= low) & (pair.contrast < high)
        row |= {f'asked {name}': weight[own].sum(), f'found {name}': weight[own & found].sum()}
    row['off'] = np.abs(off[found])
    # The longest piece of each true edge.
    for edge in np.unique(pair.edge[found]):
        own = found & (pair.edge == edge)
        row['whole'] = row.get('whole', 0.0) + np.bincount(best[own], weight[own]).max()
    if pair.family in COMPLETE and image is pair.left:
        length = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
        at = np.round(0.5 * (lines[:, :2] + lines[:, 2:])).astype(int)
        h, w = pair.parts.shape
        judged = pair.parts[np.clip(at[:, 1], 0, h - 1), np.clip(at[:, 0], 0, w - 1)]
        true = np.bincount(best[best >= 0], weight[best >= 0], minlength=len(lines))
        row |= {'judged': length[judged].sum(), 'true': np.minimum(true, length)[judged].sum()}
    return row


def measured(detect: Callable[[np.ndarray], np.ndarray], image: np.ndarray, times: int) -> tuple[np.ndarray, float]:
    """The segments, and the least milliseconds of so many calls."""
    least = np.inf
    for _ in range(times):
        since = time.perf_counter()
        lines = detect(image)
        least = min(least, 1e3 * (time.perf_counter() - since))
    return lines, least


def run(
    families: list[str],
    data: Path | None,
    scenes: list[str] | None,
    detectors: dict[str, Callable[[np.ndarray], np.ndarray]],
    times: int = TIMES,
) -> list[dict[str, Any]]:
    """A row an image and detector: by, family, pair, ms and what :func:`score` gives."""
    rows = []
    for pair in load_pairs(data_folder(data), families, scenes):
        for image, pixel, slope in true_samples(pair):
            for by, detect in detectors.items():
                lines, ms = measured(detect, image, times)
                rows.append(
                    {'by': by, 'family': pair.family, 'pair': pair.name, 'ms': ms}
                    | score(lines, pair, image, pixel, slope)
                )
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Shares by length over some rows, quantiles of the distances, mean number of segments and milliseconds."""

    def total(name: str) -> float:
        return float(sum(row.get(name, 0.0) for row in rows))

    def share(part: str, whole: str) -> float:
        return total(part) / total(whole) if total(whole) else float('nan')

    off = np.concatenate([row['off'] for row in rows])
    quantiles = np.quantile(off, [0.5, 0.9]) if len(off) else (np.nan, np.nan)
    return {
        'images': len(rows),
        'recall': share('found', 'asked'),
        **{name: share(f'found {name}', f'asked {name}') for name, _, _ in CLASSES},
        'whole': share('whole', 'asked'),
        'px': float(quantiles[0]),
        'p90': float(quantiles[1]),
        'true': share('true', 'judged'),
        'segments': total('segments') / len(rows),
        'ms': total('ms') / len(rows),
    }


LEGEND = """\
recall: share of the true length covered, then by contrast, grey levels; whole: by the longest piece of each edge alone
px, p90: distance from the true edge; true: share of the segments' length on true edges, where these are all there is"""


def table(rows: list[dict[str, Any]]) -> str:
    """A line a family and detector."""
    families = list(dict.fromkeys(row['family'] for row in rows))
    groups = {name: [row for row in rows if row['family'] == name] for name in families}
    photoreal = [row for row in rows if row['family'] in PHOTOREAL_KINDS]
    if photoreal:
        groups = {'photoreal': photoreal, **groups}
    groups['all'] = rows
    lines = []
    for name, group in groups.items():
        for by in dict.fromkeys(row['by'] for row in group):
            figures = summary([row for row in group if row['by'] == by])
            if not lines:
                lines.append(f'{"":<20}' + ''.join(f'{key:>9}' for key in figures))
            cells = ''.join(
                f'{value:>9.0f}'
                if key in ('images', 'segments')
                else f'{value:>9.3f}'
                if key != 'ms'
                else f'{value:>9.1f}'
                for key, value in figures.items()
            )
            lines.append(f'{name if by == OURS else "  " + by:<20}{cells}')
    return '\n'.join(lines)


def pair_table(rows: list[dict[str, Any]]) -> str:
    """A line a pair, ours beside the peer."""
    lines = [f'{"":<16}{"recall":>16}{"whole":>16}{"segments":>16}{"ms":>16}']
    for name in dict.fromkeys(row['pair'] for row in rows):
        own = [row for row in rows if row['pair'] == name]
        both = [summary([row for row in own if row['by'] == by]) for by in dict.fromkeys(row['by'] for row in own)]
        cells = ''
        for key, digits in (('recall', 3), ('whole', 3), ('segments', 0), ('ms', 1)):
            cells += ''.join(f'{figures[key]:>8.{digits}f}' for figures in both)
        lines.append(f'{name:<16}{cells}')
    return '\n'.join(lines)


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    """For run.py."""
    try:
        warm_up()
        rows = run(families_of(('all',)), None, list(QUICK), {OURS: ours, PEER: line_segments})
    except FileNotFoundError as error:
        yield Absent('segments of single images', str(error))
        return
    for by in (OURS, PEER):
        figures = summary([row for row in rows if row['by'] == by])
        for what, unit, lower in (
            ('recall', '%', False),
            ('whole', '%', False),
            ('px', 'px', True),
            ('ms', 'ms', True),
        ):
            value = 100.0 * figures[what] if unit == '%' else figures[what]
            yield Measurement(f'segments of single images: {what}', value, unit, by, lower)


def main() -> int:
    parser = argparse.ArgumentParser(description='Line segments of single images of pairs with truth.')
    parser.add_argument('--data', type=Path, help='folder with photoreal/ and real/ (default: STEREO_DATA, ../shared)')
    parser.add_argument('--families', nargs='+', default=['all'], help='names, photoreal, real or all')
    parser.add_argument('--scenes', nargs='+', help='pairs whose names begin so')
    parser.add_argument('--quick', action='store_true', help='a dozen pairs of all families')
    parser.add_argument('--no-peer', action='store_true', help='without LSD')
    parser.add_argument('--pairs', action='store_true', help='a line a pair too')
    parser.add_argument('--times', type=int, default=TIMES, help='the least time of so many calls')
    parser.add_argument(
        '--detect', type=function_named, default=ours, metavar='MODULE:FUNCTION', help='in place of ours'
    )
    options = parser.parse_args()
    warm_up()
    detectors = {OURS: options.detect} | ({} if options.no_peer else {PEER: line_segments})
    scenes = list(QUICK) if options.quick else options.scenes
    try:
        rows = run(families_of(options.families), options.data, scenes, detectors, options.times)
    except (FileNotFoundError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    if options.pairs:
        print(pair_table(rows))
    print(table(rows))
    print(LEGEND)
    return 0


if __name__ == '__main__':
    sys.exit(main())
