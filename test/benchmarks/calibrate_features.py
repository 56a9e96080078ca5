"""How much evidence of features chance reaches, without images: fitted to searches for models that are not there.

Models are asked for in synthetic scenes of every kind of clutter, in views of other objects that recovery has seen, and
in pictures of cameras. The best evidence e of a model that is not there has a tail: e > least + per_data ln(n) + tail t
in exp(-t) of the searches, n data features of its kinds. The line that one search in ten passes is fitted by quantile
regression (Koenker & Bassett 1978), the tail is the mean of what lies beyond it. Every second seed or pair is fitted to
(training); on the others stated rates are held against observed ones, for every kind, and so is the share of models
that are there and refused, three quarters or three tenths of their edges in view. Written is FALSE_ALARMS
(model_matcher/verification/settings.py), with intervals from bootstrapped searches.

    python test/benchmarks/calibrate_features.py --seeds 20
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from batches import add_batch_options, run_batch
from bench_matcher import GENERATORS, MODELS, THESIS_SIZES, clutter_of, is_right
from bench_poses import NEGATIVES, recovered
from rendered_views import load_object, recovered_view
from scipy.optimize import minimize
from true_pairs import data_folder, load_pair
from true_poses import parts_of, posed_names, posed_pair

from model_matcher import MatchParams, MatchResult, index_model, match
from model_matcher.closed_form.synthetic.scenes import make_scene, scaled
from model_matcher.model.index import ModelIndex
from model_matcher.pipeline import warm_up
from model_matcher.verification.settings import FALSE_ALARMS
from stereo_recovery.pipeline import warm_up as warm_up_recovery

# One search in so many passes the line that is fitted; the rates that are looked at.
TAIL_FROM = 10.0
RATES = (0.1, 0.01, 0.001)
# Objects whose views models are asked for in that are not there.
SEEN = ('coverplate', 'table', 'widget', 'lamp', 'cylinder_box', *THESIS_SIZES)
# Parts that are not there, asked for in a picture.
ABSENT = 12
BOOTSTRAPS = 50
# Nats, less than any hypothesis has.
NONE = -50.0


@dataclass(frozen=True)
class Searched:
    """One search.

    kind : what the scene is made of; share : of the model's edges in view, 0 where it is not there; logarithm : of the
    number of data features of its kinds; evidence : nats, the best, of a model that is there the best right one, minus
    infinity without; train : whether its scene is one to fit to
    """

    kind: str
    share: float
    logarithm: float
    evidence: float
    train: bool


def _searched(kind: str, share: float, result: MatchResult, right: bool, train: bool) -> Searched | None:
    """A search; None where the model was not looked for, for lack of data."""
    if 'evidence_needed' not in result.stats:
        return None
    at_one = result.stats['evidence_needed'] + FALSE_ALARMS.tail * np.log(RATES[-1])
    logarithm = (at_one - FALSE_ALARMS.least) / FALSE_ALARMS.per_data
    evidence = result.stats.get('evidence', -np.inf) if right else -np.inf
    return Searched(kind, share, float(logarithm), float(evidence), train)


def in_synthetic_scenes(job: tuple[str, str, range]) -> list[dict[str, Any]]:
    """A model in scenes of which four fifths are clutter of a kind."""
    kind, name, seeds = job
    params = MatchParams(false_alarm_rate=RATES[-1])
    model = MODELS[name]()
    index, others = index_model(model, name), clutter_of(kind, name)
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        copies = tuple(scaled(model, f) for f in (rng.uniform(0.85, 0.92), rng.uniform(1.08, 1.15)))
        decoys = copies if kind == 'decoys' else ()
        for share, count, visible in ((0.0, 0, 0.75), (0.75, 1, 0.75), (0.3, 1, 0.3)):
            scene = make_scene(model, seed, 0.8, visible, count, decoys=decoys, others=others)
            result = match(index, scene.data, params)
            first = next(iter((*result.interpretations, *result.rejected)), None)
            right = share == 0.0 or is_right(first, scene, index.size)
            found.append(_searched(kind, share, result, right, seed % 2 == 0))
    return _plain(found)


def in_recovered_views(job: tuple[int, str]) -> list[dict[str, Any]]:
    """Models in a view of another object, as recovery has seen it in a rendered pair."""
    seed, file = job
    params = MatchParams(false_alarm_rate=RATES[-1])
    data = recovered_view(*_object(file), 100 * seed + SEEN.index(file))
    return _plain(
        _searched('recovered views', 0.0, match(_indexed(name), data, params), True, seed % 2 == 0)
        for name in THESIS_SIZES
        if name != file
    )


_object = cache(load_object)


@cache
def _indexed(name: str) -> ModelIndex:
    return index_model(_object(name)[1], name)


def in_pictures(job: tuple[Path, str, str, int]) -> list[dict[str, Any]]:
    """Parts that are not there in a pair of cameras."""
    folder, family, name, number = job
    posed = posed_pair(folder, load_pair(folder, family, name))
    params = MatchParams(false_alarm_rate=RATES[-1])
    there = {one.part.name for one in posed.instances}
    others = [part for part in parts_of(folder) if part.name not in there]
    rng = np.random.default_rng([0, number])
    _, features = recovered(posed.pair)
    return _plain(
        _searched('pictures', 0.0, match(others[k].index, features, params), True, number % 2 == 0)
        for k in rng.choice(len(others), min(ABSENT, len(others)), replace=False)
    )


def _plain(found: Iterable[Searched | None]) -> list[dict[str, Any]]:
    """Searches as values that can be kept; those for which there was no data left out."""
    return [asdict(one) for one in found if one is not None]


def all_searches(count: int, data: Path | None, options: argparse.Namespace) -> list[Searched]:
    """So many scenes of each kind and model, views, and pictures where there are any."""
    seeds = range(50_000, 50_000 + count)
    try:
        folder = data_folder(data)
        pairs = posed_names(folder, list(NEGATIVES))
    except FileNotFoundError as reason:
        print(reason)
        folder, pairs = Path(), []
    jobs: tuple[tuple[Callable[[Any], list[dict[str, Any]]], str, dict[str, Any]], ...] = (
        (
            in_synthetic_scenes,
            'clutter',
            {f'{kind} {name}': (kind, name, seeds) for kind in GENERATORS for name in THESIS_SIZES},
        ),
        (
            in_recovered_views,
            'views',
            {f'{file} {seed}': (seed, file) for seed in range(max(2, count // 4)) for file in SEEN},
        ),
        (
            in_pictures,
            'pictures',
            {f'{family} {name}': (folder, family, name, number) for number, (family, name) in enumerate(pairs)},
        ),
    )
    return [
        Searched(**one)
        for function, title, some in jobs
        for found in run_batch(function, some, options, title, _ready).values()
        for one in found
    ]


def _ready() -> None:
    warm_up_recovery()
    warm_up()


def fitted(found: list[Searched]) -> np.ndarray:
    """(3,): least, per_data and tail, of searches for what is not there; every kind of scene counts alike."""
    # Where nothing was thought of, there is no evidence at all.
    logarithm, evidence = np.array([(one.logarithm, max(one.evidence, NONE)) for one in found]).T
    kinds = [one.kind for one in found]
    weight = np.array([1.0 / kinds.count(kind) for kind in kinds])
    quantile = 1.0 - 1.0 / TAIL_FROM

    def cost(line: np.ndarray) -> float:
        off = evidence - line[0] - line[1] * logarithm
        return float(weight @ np.maximum(quantile * off, (quantile - 1.0) * off))

    start = np.array([np.quantile(evidence, quantile) - logarithm.mean(), 1.0])
    line = minimize(cost, start, method='Nelder-Mead').x
    beyond = evidence - line[0] - line[1] * logarithm
    tail = float(np.average(beyond[beyond > 0.0], weights=weight[beyond > 0.0]))
    return np.array([line[0] - tail * np.log(TAIL_FROM), line[1], tail])


def intervals(found: list[Searched], rng: np.random.Generator) -> np.ndarray:
    """(2, 3): what 90 in 100 fits to bootstrapped searches lie between."""
    fits = [fitted([found[k] for k in rng.choice(len(found), len(found))]) for _ in range(BOOTSTRAPS)]
    return np.quantile(fits, [0.05, 0.95], axis=0)


def report(found: list[Searched], numbers: np.ndarray) -> Iterator[str]:
    """Lines, one a kind: false alarms of a thousand searches at each rate, and the shares of right poses refused."""
    heads = ''.join(f'{f"rate {rate:g}":>12}' for rate in RATES)
    yield f'{"":<18}{"absent":>8}{heads}   refused at {RATES[-1]:g}: 75 % in view, 30 %'
    for kind in (*dict.fromkeys(one.kind for one in found), None):
        some = [one for one in found if kind in (None, one.kind)]
        absent = [one for one in some if one.share == 0.0]
        cells = ''.join(f'{1e3 * _reached(absent, numbers, rate):12.1f}' for rate in RATES)
        refused = ''
        for share in (0.75, 0.3):
            there = [one for one in some if one.share == share]
            if there and kind is not None:
                refused += f'{100.0 * (1.0 - _reached(there, numbers, RATES[-1])):20.1f} %'
        yield f'{kind or "all":<18}{len(absent):8d}{cells}{refused}'


def _reached(found: list[Searched], numbers: np.ndarray, rate: float) -> float:
    """Share of searches with the evidence that a rate asks for."""
    least, per_data, tail = numbers
    needed = [least + per_data * one.logarithm - tail * np.log(rate) for one in found]
    return float(np.mean([one.evidence >= nats for one, nats in zip(found, needed)])) if found else np.nan


def main(arguments: list[str] | None = None) -> int:
    """Search, fit, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path, help='folder with real')
    parser.add_argument('--seeds', type=int, default=20, help='scenes of each kind and model')
    parser.add_argument('--json', type=Path, help='write every search')
    add_batch_options(parser)
    options = parser.parse_args(arguments)
    found = all_searches(options.seeds, options.data, options)
    train = [one for one in found if one.train and one.share == 0.0]
    numbers = fitted(train)
    low, high = intervals(train, np.random.default_rng(0))
    print(f'{"":<10}{"fitted":>8}{"90 % of bootstraps":>24}{"in use":>8}')
    for k, name in enumerate(FALSE_ALARMS._fields):
        print(f'{name:<10}{numbers[k]:8.2f}{low[k]:16.2f} {high[k]:7.2f}{FALSE_ALARMS[k]:8.2f}')
    test = [one for one in found if not one.train]
    for title, used in (('fitted to the training half', numbers), ('in use', np.array(FALSE_ALARMS))):
        print(f'\nfalse alarms in 1000 searches of the test half, numbers {title}')
        print('\n'.join(report(test, used)))
    if options.json:
        options.json.write_text(json.dumps([asdict(one) for one in found], indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
