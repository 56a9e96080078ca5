"""Stereo recovery on real pairs, beside the recipe of LSD, epipolar matching and triangulation: recall, errors, speed.

A row per pair. Pairs that are not on this machine are named as absent; real_scoring.py says where they are looked for.
Run alone it is bench_photoreal on all real families: machined parts, a printed cube, tags, rooms, boards, a box.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np
from bench_photoreal import main, measured
from measure import OURS, Absent, Measurement, milliseconds
from real_scoring import BoxScore, RealPair, chessboards, method_of, score_board, score_box, teaboxes
from stereo_scoring import peer
from true_pairs import REAL

from stereo_recovery import recover

PEER = 'LSD + epipolar'
SCALES = (0.5, 2.0)


def measurements(quick: bool) -> Iterator[Measurement | Absent]:
    boards, boxes = chessboards(), teaboxes()
    if quick:
        boards = boards[:2]
    names = [OURS]
    if hasattr(cv2, 'createLineSegmentDetector'):
        names.append(PEER)
    else:
        yield Absent(PEER, 'this OpenCV has no line segment detector')
    for by in names:
        yield from _boards(boards, by)
    if not boxes:
        yield Absent('tea box', 'no folder teabox in STEREO_REAL_DATA or ../shared/real')
    for by in names:
        yield from _boxes(boxes, by)
    for factor in SCALES:
        yield from _boards([pair.scaled(factor) for pair in boards[:1]], OURS)
        yield from _boxes([pair.scaled(factor) for pair in boxes[:1]], OURS)
    yield from measured(REAL, 1 if quick else None)


def _method(pair: RealPair, by: str):
    if by == OURS:
        return lambda left, right: recover(left, right, pair.rig).features
    return method_of(peer, pair)


def _boards(pairs: list[RealPair], by: str) -> Iterator[Measurement]:
    for pair in pairs:
        method = _method(pair, by)
        score = score_board(pair, method(pair.left, pair.right))
        yield Measurement(f'{pair.name}: recall of grid edges', 100 * score.recall, '%', by, False)
        yield Measurement(f'{pair.name}: wrong period', 100 * score.wrong, '%', by)
        yield Measurement(f'{pair.name}: normal of the board', score.normal_deg, 'deg', by)
        if len(score.angles):
            yield Measurement(
                f'{pair.name}: direction of grid edges',
                float(np.median(score.angles)),
                'deg',
                by,
                note=f'p90 {np.quantile(score.angles, 0.9):.2g}',
            )
            yield Measurement(
                f'{pair.name}: distance of ends from the line',
                float(np.median(score.offsets)),
                'squares',
                by,
                note=f'p90 {np.quantile(score.offsets, 0.9):.2g}',
            )
        yield Measurement(f'{pair.name}: time', _time(method, pair), 'ms', by)


def _boxes(pairs: list[RealPair], by: str) -> Iterator[Measurement]:
    for pair in pairs:
        method = _method(pair, by)
        score = score_box(pair, method(pair.left, pair.right))
        yield Measurement(f'{pair.name}: edges', score.edges, f'of {len(score.covered)}', by, False, _shares(score))
        found = score.covered > 0.0
        if found.any():
            yield Measurement(
                f'{pair.name}: direction',
                float(np.median(score.angle[found])),
                'deg',
                by,
                note=f'max {score.angle[found].max():.2g}',
            )
            across = 1e3 * score.across[found]
            yield Measurement(
                f'{pair.name}: distance of ends from the line',
                float(np.median(across)),
                'mm',
                by,
                note=f'max {across.max():.2g}',
            )
        yield Measurement(f'{pair.name}: time', _time(method, pair), 'ms', by)


def _time(method, pair: RealPair) -> float:
    return milliseconds(partial(method, pair.left, pair.right), 0.5, 3, 9)


def _shares(score: BoxScore) -> str:
    return 'covered ' + ' '.join(f'{share:.2f}' for share in score.covered)


if __name__ == '__main__':
    sys.exit(main(default=('real',)))
