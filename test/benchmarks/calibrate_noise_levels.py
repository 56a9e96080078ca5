#!/usr/bin/env python3
"""How noise says that a picture codes light: its numbers, fitted by maximum likelihood, and how often it says so.

Path-traced pictures are coded; those of the chessboards and of the machined parts are not.

    python test/benchmarks/calibrate_noise_levels.py
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
from true_pairs import data_folder, families_of, load_pair, pair_names

from stereo_recovery.detection.edgels import as_grey
from stereo_recovery.noise_levels import NoiseByLevel, NoiseSpread, log_likelihood, nats_of_code, noise_by_level
from stereo_recovery.settings import CODED_LOG_ODDS

CODED = {'photoreal': True, 'openvgr': False, 'chessboards': False}
GRID = ((0.04, 0.05, 0.06, 0.07, 0.08, 0.1), (0.1, 0.15, 0.2, 0.3, 0.4), (0.1, 0.15, 0.2, 0.25, 0.3, 0.5))


def noise_of_pairs(data: Path, group: str) -> list[list[NoiseByLevel]]:
    """Of the pictures of every pair of a group's families."""
    pairs = (load_pair(data, family, name) for family in families_of([group]) for name in pair_names(data, family))
    return [[noise_by_level(as_grey(image, 'image')) for image in (pair.left, pair.right)] for pair in pairs]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path, default=data_folder(), help='folder with real/ and photoreal/')
    found = {group: noise_of_pairs(parser.parse_args().data, group) for group in CODED}
    every = [(one, coded) for group, coded in CODED.items() for both in found[group] for one in both]
    likelihoods = {
        spread: sum(log_likelihood(one, coded, spread) for one, coded in every)
        for spread in itertools.starmap(NoiseSpread, itertools.product(*GRID))
    }
    best = max(likelihoods, key=lambda spread: likelihoods[spread])
    in_use = sum(log_likelihood(one, coded) for one, coded in every)
    print(f'likeliest: {best}, {likelihoods[best]:.1f} nats; in use: {NoiseSpread()}, {in_use:.1f}')
    for group in CODED:
        nats = np.array([sum(nats_of_code(one) for one in both) for both in found[group]])
        said, denied = (nats > CODED_LOG_ODDS).sum(), (nats < -CODED_LOG_ODDS).sum()
        print(f'{group}: of {len(nats)} pairs {said} said to be coded, {denied} not')


if __name__ == '__main__':
    main()
