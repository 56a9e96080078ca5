#!/usr/bin/env python3
"""How often what ties edges to each other holds: the probabilities that the estimate believes beforehand, counted.

Statements about edges whose disparity is true, path traced, by what the estimate knows of the other edge: a statement
holds if it misses the truth by less than three sigma, or a pixel. Those of one prior are counted together.

    python test/benchmarks/calibrate_factors.py
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lost_length import covering, watched
from true_pairs import TruePair, data_folder, families_of, load_pair, pair_names

from msgs_py.settings import BOUND_SIGMA
from stereo_recovery import recover
from stereo_recovery.edges import straight_edges
from stereo_recovery.estimation.estimate import Estimate
from stereo_recovery.estimation.settings import DOUBTFUL_PRIOR, JUNCTION_PRIOR, OPEN_SIGMA, T_PRIOR
from stereo_recovery.matching.settings import SEEN_AS_ONE
from stereo_recovery.matching.stereo_segments import StereoSegments

# A true edge is a segment's when its samples cover this share of it; so far off, px, its match is another edge.
COVERED, ANOTHER = 0.6, 25.0
PRIORS = {
    JUNCTION_PRIOR: 'JUNCTION_PRIOR',
    SEEN_AS_ONE: 'SEEN_AS_ONE',
    DOUBTFUL_PRIOR: 'DOUBTFUL_PRIOR',
    T_PRIOR: 'T_PRIOR',
}


class Told(NamedTuple):
    """A statement: its prior, whether it is about two edges, how far it is off the truth, its sigma, whether in use."""

    prior: float
    two: bool
    off: float
    sigma: float
    used: bool


def true_lines(pair: TruePair, seen: StereoSegments) -> dict[int, np.ndarray]:
    """Disparity a + b s, (2,), of the edges of a pair that lie on a true one."""
    left = seen.segments[0].select(seen.index[0])
    offset = pair.rig.left.cx - pair.rig.right.cx
    found = {}
    for number in np.unique(pair.edge[pair.edge >= 0]):
        samples = np.flatnonzero(pair.edge == number)
        on = covering(left, pair.pixel[samples], pair.slope[samples])
        for n in np.flatnonzero(on.any(axis=0)):
            s = (pair.pixel[samples[on[:, n]]] - left.centre[n]) @ left.direction[n]
            if np.ptp(s) < COVERED * left.length[n]:
                continue
            rows = np.stack([np.ones_like(s), s], axis=1)
            line = np.linalg.lstsq(rows, pair.near[samples[on[:, n]]] + offset, rcond=None)[0]
            if abs(seen.matches.disparity[n, 1] - line[0]) < ANOTHER:
                found[int(n)] = line
    return found


def told(found: Estimate, truth: dict[int, np.ndarray]) -> Iterator[Told]:
    """What statements say of the disparities of edges that are true; of two edges, twice."""
    f = found.factors
    for k in np.flatnonzero((np.abs(f.row[:, 0]) > 0.5) & f.first):
        sides = [(f.edge[k], f.row[k], f.other[k], f.other_row[k], 1.0)]
        if f.other[k] >= 0:
            sides.append((f.other[k], f.other_row[k], f.edge[k], f.row[k], -1.0))
        for edge, row, other, other_row, sign in sides:
            if int(edge) not in truth:
                continue
            value, variance = sign * f.value[k], f.sigma[k] ** 2
            if other >= 0:
                its = float(other_row @ found.covariance[other] @ other_row)
                if its > OPEN_SIGMA**2:
                    continue
                value, variance = value + other_row @ found.x[other], variance + its
            off = float(value - row @ truth[int(edge)])
            yield Told(float(f.prior[k]), bool(other >= 0), off, float(np.sqrt(variance)), bool(found.used[k]))


def told_of_pair(pair: TruePair) -> list[Told]:
    """What all statements say, of one pair."""
    seen: dict[str, list[tuple[StereoSegments, Estimate]]] = {}
    with watched(straight_edges, 'solved', seen, lambda given, out: (given[0], out)):
        recover(pair.left, pair.right, pair.rig)
    return [one for segments, found in seen.get('solved', ()) for one in told(found, true_lines(pair, segments))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path, default=data_folder(), help='folder with photoreal/')
    data = parser.parse_args().data
    groups: dict[tuple[str, bool], list[Told]] = defaultdict(list)
    for family in families_of(['photoreal']):
        for name in pair_names(data, family):
            for one in told_of_pair(load_pair(data, family, name)):
                if one.prior in PRIORS:
                    groups[PRIORS[one.prior], one.two].append(one)
    print(f'{"":<16}{"stated":>8}{"holds":>8}{"of":>7}{"in use, and holds":>20}')
    for (name, two), every in sorted(groups.items()):
        holds = np.array([abs(one.off) < max(1.0, BOUND_SIGMA * one.sigma) for one in every])
        used = np.array([one.used for one in every])
        right = f'{holds[used].mean():.2f}' if used.any() else '-'
        what = name if two else f'{name}, end'
        stated = every[0].prior
        print(f'{what:<22}{stated:>6.2f}{holds.mean():>8.2f}{len(every):>7}{right:>12}')


if __name__ == '__main__':
    main()
