"""What features and images count for as evidence, and what chance reaches: fitted to searches whose answer is known.

Parts are asked for in real and path-traced pairs, those that stand there and others. Every hypothesis that a search
looks for in the images is recorded: the nats of its features, those of its outline, and whether it is right. On every
second pair (training) a logistic regression says what a nat of the one counts for in nats of the other, and the best
hypotheses of parts that are absent say how much chance reaches: both are scaled so that it reaches t nats in exp(-t) of
the searches. How often curves of absent parts lie on edges in space is fitted by maximum likelihood. On the other pairs
(test) stated rates are held against observed ones. Written are IMAGE_EVIDENCE (model_matcher/verification/settings.py)
and OTHERS_EDGES (model_matcher/image_pose/settings.py), with intervals from bootstrapped pairs.

    python test/benchmarks/calibrate_evidence.py --draw out/evidence.png
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from bench_poses import REAL_POSED, recovered
from measure import Absent
from pose_scoring import WRONG_DEG, WRONG_M
from scipy.optimize import minimize, minimize_scalar
from tqdm import tqdm
from true_pairs import PHOTOREAL_KINDS, data_folder
from true_poses import ALIKE, Part, PosedPair, all_parts, difference, posed_pairs

from model_matcher.geometry.pose_rows import as_pose
from model_matcher.image_pose.measurement import Presence, searched
from model_matcher.image_pose.presence import bent, chance_beside, over_views
from model_matcher.image_pose.settings import OTHERS_EDGES, REACH
from model_matcher.image_pose.views import Views
from model_matcher.pipeline import match, warm_up
from model_matcher.verification import image_evidence
from model_matcher.verification.settings import IMAGE_EVIDENCE
from msgs_py import FeatureSet
from stereo_recovery.pipeline import warm_up as warm_up_recovery

# Parts that are not there and are asked for in a pair.
ABSENT = 12
# Of the best hypotheses of absent parts, those above this quantile tell the tail.
TAIL_FROM = 0.9
# Nats squared, one over: the prior of each weight, so weak that a dozen searches outweigh it.
RIDGE = 0.01
BOOTSTRAPS = 200
RATES = (0.1, 0.01, 0.001)


@dataclass(frozen=True)
class Best:
    """The best hypothesis of one search that is right, or the best of one for a part that is absent.

    features, outline : nats; train : whether its pair is one to fit to; curves : of each curve of its outline, whether
    it is bent, and the log-likelihoods of its confirmations when an edge in space lies there, and when none does
    """

    family: str
    pair: str
    part: str
    right: bool
    features: float
    outline: float
    train: bool
    curves: list[tuple[bool, float, float]]


def best_hypotheses(families: list[str], data: Path | None, absent: int, seed: int) -> list[Best]:
    """All searches."""
    folder = data_folder(data)
    parts = all_parts(folder)
    rng = np.random.default_rng(seed)
    found = []
    for number, posed in enumerate(tqdm(posed_pairs(folder, families), unit='pair', disable=not sys.stderr.isatty())):
        _, features = recovered(posed.pair)
        views = Views.of((posed.pair.left, posed.pair.right), posed.pair.rig)
        there = {one.part.name for one in posed.instances}
        # What is nearly the same as something that stands there is neither right nor chance.
        like = {name for name, other in ALIKE.items() if other in there}
        others = [part for part in parts if part.name not in there | like]
        chosen = rng.choice(len(others), min(absent, len(others)), replace=False)
        for part in (*{one.part.name: one.part for one in posed.instances}.values(), *(others[k] for k in chosen)):
            found += list(_best(posed, part, features, views, number % 2 == 0))
    return found


def _best(posed: PosedPair, part: Part, features: FeatureSet, views: Views, train: bool) -> Iterator[Best]:
    """The best right hypothesis, or of an absent part the best of all; none where nothing was thought of."""
    looked: list[image_evidence.Weighed] = []
    weigh: Callable[..., image_evidence.Weighed] = image_evidence.weigh

    def recording(*args: Any) -> image_evidence.Weighed:
        looked.append(weigh(*args))
        return looked[-1]

    with patch.object(image_evidence, 'weigh', recording):
        match(part.index, features, name=part.name, views=views)
    instances = [one for one in posed.instances if one.part.name == part.name]
    looked = [one for one in looked if np.isfinite(one.evidence)]
    if instances:
        poses = [as_pose(one.motion) for one in looked]
        looked = [
            one
            for one, pose in zip(looked, poses)
            if any(difference(instance, pose).within(WRONG_DEG, WRONG_M) for instance in instances)
        ]
    if looked:
        best = max(looked, key=lambda one: one.evidence)
        nats = float(best.hypothesis.evidence), float(best.shown.log_ratio)
        curves = _curves(best.shown, views)
        yield Best(posed.pair.family, posed.pair.name, part.name, bool(instances), *nats, train, curves)


def _curves(shown_there: Presence, views: Views) -> list[tuple[bool, float, float]]:
    """See :class:`Best`."""
    sight = shown_there.sight
    placed = sight.placed
    curve = placed.curve
    chance = chance_beside(searched(sight, views, REACH + 1), placed.group, OTHERS_EDGES)
    edge, apart = over_views(shown_there.found, placed.group, curve, chance)
    is_bent = bent(placed.point, curve, sight.limb)
    return [(bool(is_bent[c]), float(edge[c]), float(apart[c])) for c in np.unique(curve)]


# -- the fit ---------------------------------------------------------------------------------------------------


def _columns(found: list[Best]) -> tuple[np.ndarray, np.ndarray]:
    """Nats (n, 2) of features and outline, and whether right (n,)."""
    return np.array([[one.features, one.outline] for one in found]), np.array([one.right for one in found])


def fitted(found: list[Best]) -> np.ndarray:
    """(4,): what a nat of features and of outline counts for; shares of straight and of bent curves on other edges."""
    nats, right = _columns(found)
    # Present and absent parts count alike: how often a part is there is the user's to say.
    weight = np.where(right, 0.5 / max(right.sum(), 1), 0.5 / max((~right).sum(), 1)) * len(found)

    def cost(unknown: np.ndarray) -> float:
        odds = nats @ unknown[:2] - unknown[2]
        return float(weight @ (np.logaddexp(0.0, odds) - right * odds) + RIDGE * unknown[:2] @ unknown[:2])

    counts = minimize(cost, np.array([0.5, 1.0, 5.0])).x[:2]
    evidence = nats[~right] @ counts
    start = np.quantile(evidence, TAIL_FROM)
    counts /= np.mean(evidence[evidence > start] - start)
    return np.concatenate([counts, [_share(found, False), _share(found, True)]])


def _share(found: list[Best], is_bent: bool) -> float:
    """Share of the curves of absent parts that lie on edges in space: the most likely one."""
    likely = np.array([one[1:] for best in found if not best.right for one in best.curves if one[0] == is_bent])

    def cost(share: float) -> float:
        return -float(np.logaddexp(np.log(share) + likely[:, 0], np.log1p(-share) + likely[:, 1]).sum())

    return float(minimize_scalar(cost, bounds=(1e-3, 0.9), method='bounded').x)


def intervals(found: list[Best], rng: np.random.Generator) -> np.ndarray:
    """(2, 4): what 90 in 100 fits to bootstrapped pairs lie between."""
    pairs = list(dict.fromkeys(one.pair for one in found))
    fits = []
    for _ in range(BOOTSTRAPS):
        drawn = rng.choice(len(pairs), len(pairs))
        some = [one for k in drawn for one in found if one.pair == pairs[k]]
        if any(one.right for one in some) and sum(not one.right for one in some) > 20:
            fits.append(fitted(some))
    return np.quantile(fits, [0.05, 0.95], axis=0)


# -- what is observed ------------------------------------------------------------------------------------------


def report(found: list[Best], counts: np.ndarray, title: str) -> list[str]:
    """Lines: false alarms and refusals where features and outline count for so much (2,)."""
    nats, right = _columns(found)
    evidence = nats @ counts
    lines = [f'{title}: {int(right.sum())} right, {int((~right).sum())} absent']
    for rate in RATES:
        needed = -np.log(rate)
        alarms = 1e3 * (evidence[~right] >= needed).mean() if (~right).any() else np.nan
        refused = (evidence[right] < needed).mean() if right.any() else np.nan
        lines.append(
            f'  false_alarm_rate {rate:5.3f}: {needed:4.1f} nats, {alarms:5.1f} false alarms in 1000 searches, '
            f'{refused:5.3f} of the right ones refused'
        )
    families = sorted({one.family for one in found})
    for family in families:
        mine = np.array([one.family == family for one in found])
        best = np.sort(evidence[mine & ~right])[-2:].round(1).tolist()
        least = np.sort(evidence[mine & right])[:2].round(1).tolist()
        lines.append(
            f'  {family:<12} {int((mine & ~right).sum()):4d} absent, at most {best}; right ones, at least {least}'
        )
    return lines


def drawing(found: list[Best], counts: np.ndarray) -> np.ndarray:
    """Histograms of the evidence: right ones green, absent ones red; lines at the rates."""
    nats, right = _columns(found)
    evidence = np.clip(nats @ counts, -20.0, 60.0)
    image = np.full((420, 860, 3), 255, np.uint8)
    bins = np.linspace(-20.0, 60.0, 81)
    for some, colour, side in ((right, (60, 160, 60), -1), (~right, (60, 60, 220), 1)):
        count = np.histogram(evidence[some], bins)[0] / max(some.sum(), 1)
        for k, share in enumerate(count):
            x = 30 + 10 * k
            cv2.rectangle(image, (x, 210), (x + 8, 210 + side * round(600 * float(np.sqrt(share)) / 2)), colour, -1)
    for number, rate in enumerate(RATES):
        x = round(30 + 10 * (20.0 - float(np.log(rate))))
        cv2.line(image, (x, 10), (x, 410), (0, 0, 0), 1, cv2.LINE_AA)
        cv2.putText(
            image, f'{rate:g}', (x + 4, 22 + 14 * number), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA
        )
    for value in range(-20, 61, 10):
        cv2.putText(
            image, str(value), (22 + 10 * (value + 20), 226), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (0, 0, 0), 1, cv2.LINE_AA
        )
    cv2.putText(
        image, 'right (above), absent (below); nats; root of shares', (30, 405), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 0, 1
    )
    return image


def main(arguments: list[str] | None = None) -> int:
    """Record, fit, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--families', nargs='+', default=[*REAL_POSED, *PHOTOREAL_KINDS])
    parser.add_argument('--data', type=Path, help='folder with real and photoreal')
    parser.add_argument('--absent', type=int, default=ABSENT, help='parts that are not there, asked for in a pair')
    parser.add_argument('--seed', type=int, default=0, help='which of them')
    parser.add_argument('--draw', type=Path, help='write a picture of the evidence')
    parser.add_argument('--json', type=Path, help='write every search')
    options = parser.parse_args(arguments)
    warm_up_recovery()
    warm_up(images=True)
    try:
        found = best_hypotheses(options.families, options.data, options.absent, options.seed)
    except Absent as reason:
        print(reason)
        return 0
    train, test = [one for one in found if one.train], [one for one in found if not one.train]
    numbers = fitted(train)
    low, high = intervals(train, np.random.default_rng(options.seed))
    in_use = np.array([*IMAGE_EVIDENCE, *OTHERS_EDGES])
    print(f'{"":<20}{"fitted":>8}{"90 % of bootstraps":>24}{"in use":>8}')
    for k, name in enumerate(('features', 'outline', 'straight, on others', 'bent, on others')):
        print(f'{name:<20}{numbers[k]:8.2f}{low[k]:16.2f} {high[k]:7.2f}{in_use[k]:8.2f}')
    for some, title in ((train, 'training'), (test, 'test')):
        print('\n'.join(report(some, in_use[:2], f'{title}, with the numbers in use')))
    if options.json:
        options.json.write_text(json.dumps([asdict(one) for one in found], indent=1) + '\n')
    if options.draw:
        options.draw.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(options.draw), drawing(found, in_use[:2]))
    return 0


if __name__ == '__main__':
    sys.exit(main())
