"""Every number of the evidence, fitted to searches whose answer is known, and whether stated chances are true.

Two sets of searches are made: by features alone (evidence_of_features.py: synthetic scenes of every kind of clutter,
views recovered from rendered pairs, pictures of cameras) and with what images say (evidence_of_images.py: pictures of
cameras and path-traced ones). On every second seed or pair (training) the numbers are fitted; those in use are held
beside them, with intervals from bootstrapped scenes. On the others (test) stated chances are held against observed
ones, for every kind of scene: as a table, as a picture, with the shares of objects that are there and refused
(reliability.py). Searches for what is absent in which nothing was thought of count: their chance is 1.

Written are FALSE_ALARMS, VIEW, NEIGHBOURS and IMAGE_EVIDENCE (model_matcher/verification/settings.py), OTHERS_EDGES,
SURFACE_OF_OWN and SURFACE_OF_OTHERS, and ENDS_OF_OWN and ENDS_OF_OTHERS (model_matcher/image_pose/settings.py).

    python test/benchmarks/calibrate_evidence.py --seeds 60 --draw out/evidence
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import evidence_of_features
import evidence_of_images
import numpy as np
from batches import add_batch_options
from bench_poses import NEGATIVES
from reliability import Stated, drawing, figures, lines
from results import add_record_option, keep
from tqdm import tqdm
from true_pairs import PHOTOREAL_KINDS

BOOTSTRAPS = 40
# Searches for what is absent that a bootstrapped sample needs: two of them are then above the quantile.
LEAST_ABSENT = 20
WAYS = ('features', 'images')


def numbers(
    found: Sequence[Any], fit: Callable[[Sequence[Any]], np.ndarray], names: Sequence[str], in_use: np.ndarray
) -> dict[str, dict[str, float]]:
    """Each number as it is fitted, what 90 in 100 fits to bootstrapped scenes lie between, and the one in use."""
    rng = np.random.default_rng(0)
    scenes: dict[tuple[str, str], list[Any]] = defaultdict(list)
    for one in found:
        scenes[one.kind, one.scene].append(one)
    together = list(scenes.values())
    fits = []
    for _ in tqdm(range(BOOTSTRAPS), desc='intervals', disable=not sys.stdout.isatty()):
        some = [one for k in rng.choice(len(together), len(together)) for one in together[k]]
        if sum(one.absent for one in some) >= LEAST_ABSENT:
            fits.append(fit(some))
    told = {}
    for k, (name, value) in enumerate(zip(names, fit(found))):
        finite = [one[k] for one in fits if np.isfinite(one[k])]
        low, high = np.quantile(finite, [0.05, 0.95]) if finite else (np.nan, np.nan)
        told[name] = {'fitted': value, 'low': low, 'high': high, 'in use': in_use[k]}
    return told


def _told(fits: dict[str, dict[str, float]]) -> list[str]:
    """The numbers as lines."""
    text = [f'{"":<28}{"fitted":>8}{"90 % of bootstraps":>24}{"in use":>8}']
    text += [
        f'{name:<28}{one["fitted"]:8.3f}{one["low"]:16.3f} {one["high"]:7.3f}{one["in use"]:8.3f}'
        for name, one in fits.items()
    ]
    return text


def _of_features(options: argparse.Namespace) -> tuple[list[Any], dict[str, dict[str, float]], list[Stated]]:
    """The searches, the numbers fitted to the training half, and what the test half states."""
    found = evidence_of_features.all_searches(options.seeds, options.data, options)
    train = found if options.all else [one for one in found if one.train]
    fits = numbers(train, evidence_of_features.fitted, evidence_of_features.NAMES, evidence_of_features.IN_USE)
    return found, fits, [one.stated(evidence_of_features.IN_USE[:3]) for one in found if not one.train]


def _of_images(options: argparse.Namespace) -> tuple[list[Any], dict[str, dict[str, float]], list[Stated]]:
    """The same with images; none where there are no pictures."""
    try:
        found = evidence_of_images.best_hypotheses(
            options.families, options.data, options.absent, options.seed, options
        )
    except FileNotFoundError as reason:
        print(reason)
        return [], {}, []
    train = found if options.all else [one for one in found if one.train]
    fits = numbers(train, evidence_of_images.fitted, evidence_of_images.NAMES, evidence_of_images.IN_USE)
    return found, fits, [one.stated(evidence_of_images.IN_USE[:3]) for one in found if not one.train]


def main(arguments: list[str] | None = None) -> int:
    """Search, fit, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', choices=WAYS, help='by features alone, or with images (default: both)')
    parser.add_argument('--seeds', type=int, default=40, help='synthetic scenes of each kind and model')
    parser.add_argument('--families', nargs='+', default=[*NEGATIVES, *PHOTOREAL_KINDS], help='of pictures')
    parser.add_argument('--data', type=Path, help='folder with real and photoreal')
    parser.add_argument(
        '--absent', type=int, default=evidence_of_images.ABSENT, help='absent parts asked for in a pair'
    )
    parser.add_argument('--seed', type=int, default=0, help='which of them')
    parser.add_argument('--all', action='store_true', help='fit to all scenes, not to every second one')
    parser.add_argument('--draw', type=Path, metavar='FOLDER', help='write the reliability diagrams')
    parser.add_argument('--json', type=Path, help='write every search')
    add_batch_options(parser)
    add_record_option(parser)
    options = parser.parse_args(arguments)
    kept: dict[str, Any] = {}
    every: dict[str, Any] = {}
    for way, run in zip(WAYS, (_of_features, _of_images)):
        if options.only not in (way, None):
            continue
        found, fits, stated = run(options)
        if not found:
            continue
        rows = figures(stated)
        print('\n'.join([f'\n{way}, fitted to the training half', *_told(fits)]))
        print('\n'.join([f'\n{way}, false alarms of 1000 searches of the test half, numbers in use', *lines(rows)]))
        kept[way] = {'numbers': fits, 'reliability': rows}
        every[way] = [asdict(one) for one in found]
        if options.draw:
            options.draw.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(options.draw / f'reliability_{way}.png'), drawing(stated, way))
    if options.json:
        options.json.write_text(json.dumps(every, indent=1) + '\n')
    if options.record:
        keep(options.record, kept)
    return 0


if __name__ == '__main__':
    sys.exit(main())
