"""What features and images count for as evidence, and what chance reaches: fitted to searches whose answer is known.

Parts are asked for in real and path-traced pairs, those that stand there and others. Every hypothesis that a search
looks for in the images is recorded: the nats of its features, those of its outline, how many patches of its surface
agree, and whether it is right. What a nat of each counts for is fitted on every second pair (training): so that the
best hypotheses of parts that are absent have more than t nats in exp(-t) of the searches, and with that the most right
ones are accepted at the default rate (Neyman and Pearson's test). How often curves of absent parts lie on edges in
space, and what share of the patches agrees, is fitted by maximum likelihood. On the other pairs (test) stated rates are
held against observed ones. Written are IMAGE_EVIDENCE (model_matcher/verification/settings.py), OTHERS_EDGES,
SURFACE_OF_OWN and SURFACE_OF_OTHERS (model_matcher/image_pose/settings.py), with intervals from bootstrapped pairs.

    python test/benchmarks/calibrate_evidence.py --draw out/evidence.png
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import cv2
import numpy as np
from batches import add_batch_options, run_batch
from bench_poses import NEGATIVES, recovered
from pose_scoring import WRONG_DEG, WRONG_M
from scipy.optimize import minimize, minimize_scalar
from scipy.special import betaln
from true_pairs import PHOTOREAL_KINDS, data_folder, load_pair
from true_poses import ALIKE, Part, PosedPair, difference, parts_of, posed_names, posed_pair

from model_matcher import MatchParams
from model_matcher.geometry.pose_rows import as_pose
from model_matcher.image_pose.measurement import Presence, searched
from model_matcher.image_pose.presence import bent, chance_beside, over_views
from model_matcher.image_pose.settings import OTHERS_EDGES, OTHERS_FACES, REACH, SURFACE_OF_OTHERS, SURFACE_OF_OWN
from model_matcher.image_pose.surface import Agreement, agreement, log_ratio
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
BOOTSTRAPS = 50
# Absent parts that a bootstrapped sample needs: two of them are then above the quantile.
LEAST_ABSENT = 20
RATES = (0.1, 0.01, 0.001)
# At which as many right poses as possible are accepted; what features, outline and surface count for at first.
DEFAULT_RATE = MatchParams().false_alarm_rate
STARTS = ((0.3, 0.6, 0.7), (0.25, 0.4, 1.0), (0.36, 0.6, 1.4))
# Of the numbers that are fitted.
NAMES = (
    'features',
    'outline',
    'surface',
    'straight, on others',
    'bent, on others',
    'own surface, a',
    'own surface, b',
    "others' surface, a",
    "others' surface, b",
)


@dataclass(frozen=True)
class Best:
    """The best hypothesis of one search that is right, or the best of one for a part that is absent.

    features, outline : nats; faces : patches of each that agree, and that could; train : whether its pair is one to fit
    to; curves : of each curve of its outline, whether it is bent, and the log-likelihoods of its confirmations when an
    edge in space lies there, and when none does
    """

    family: str
    pair: str
    part: str
    right: bool
    features: float
    outline: float
    faces: list[tuple[int, int]]
    train: bool
    curves: list[tuple[bool, float, float]]


class _PairJob(NamedTuple):
    """A pair by its place among all, and how many absent parts are asked for in it."""

    folder: Path
    family: str
    name: str
    number: int
    absent: int
    seed: int


def best_hypotheses(
    families: list[str], data: Path | None, absent: int, seed: int, options: argparse.Namespace
) -> list[Best]:
    """All searches; options: of :func:`batches.add_batch_options`."""
    folder = data_folder(data)
    jobs = {
        f'{family} {name}': _PairJob(folder, family, name, number, absent, seed)
        for number, (family, name) in enumerate(posed_names(folder, families))
    }
    return [Best(**one) for some in run_batch(_of_pair, jobs, options, 'evidence', _ready).values() for one in some]


def _of_pair(job: _PairJob) -> list[dict[str, Any]]:
    posed = posed_pair(job.folder, load_pair(job.folder, job.family, job.name))
    _, features = recovered(posed.pair)
    views = Views.of((posed.pair.left, posed.pair.right), posed.pair.rig)
    there = {one.part.name for one in posed.instances}
    # What is nearly the same as something that stands there is neither right nor chance.
    like = {name for name, other in ALIKE.items() if other in there}
    others = [part for part in parts_of(job.folder) if part.name not in there | like]
    rng = np.random.default_rng([job.seed, job.number])
    chosen = rng.choice(len(others), min(job.absent, len(others)), replace=False)
    parts = (*{one.part.name: one.part for one in posed.instances}.values(), *(others[k] for k in chosen))
    return [asdict(one) for part in parts for one in _best(posed, part, features, views, job.number % 2 == 0)]


def _ready() -> None:
    warm_up_recovery()
    warm_up(images=True)


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
    looked = [_with_surface(one, part, views) for one in looked if np.isfinite(one.evidence)]
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
        faces = [(face.agree, face.looked) for face in best.surface or ()]
        curves = _curves(best.shown, views)
        yield Best(posed.pair.family, posed.pair.name, part.name, bool(instances), *nats, faces, train, curves)


def _with_surface(one: image_evidence.Weighed, part: Part, views: Views) -> image_evidence.Weighed:
    """A hypothesis with what the images show of its surface, whether or not that can decide."""
    shape = part.index.shape
    return replace(one, surface=agreement(shape, as_pose(one.motion), one.shown.sight, views))


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
    """Nats (n, 3) of features, outline and surface, and whether right (n,)."""
    nats = [[one.features, one.outline, log_ratio([Agreement(*face) for face in one.faces])] for one in found]
    return np.array(nats).reshape(-1, 3), np.array([one.right for one in found], bool)


def fitted(found: list[Best]) -> np.ndarray:
    """(9,): the numbers of NAMES; NaN of those that nothing tells, as of curves where none of that kind was seen."""
    nats, right = _columns(found)
    shares = [_share(found, False), _share(found, True)]
    if right.all() or not right.any():
        return np.concatenate([np.full(3, np.nan), shares, _surface_shares(found)])

    def counts(logarithms: np.ndarray) -> np.ndarray:
        direction = np.exp(logarithms - logarithms.max())
        return direction * _scale(nats[~right] @ direction)

    def cost(logarithms: np.ndarray) -> float:
        missing = -np.log(DEFAULT_RATE) - nats[right] @ counts(logarithms)
        return float(np.logaddexp(0.0, missing).mean())

    # The scale goes in steps where absent parts change places at the quantile: several ways down.
    fits = [minimize(cost, np.log(start), method='Nelder-Mead') for start in STARTS]
    best = counts(min(fits, key=lambda fit: fit.fun).x)
    return np.concatenate([best, shares, _surface_shares(found)])


def _scale(evidence: np.ndarray) -> float:
    """By what evidence (n,) of absent parts is to be multiplied, so that t nats are reached in exp(-t) of the searches.

    The most likely one, of an exponential distribution of which only the tail was observed.
    """
    start = float(np.quantile(evidence, TAIL_FROM))
    tail = evidence[evidence > start]
    if len(tail) == 0:
        return np.nan

    def cost(scale: float) -> float:
        below = np.log1p(-np.exp(-scale * max(start, 1e-3)))
        return float(-(len(evidence) - len(tail)) * below - len(tail) * np.log(scale) + scale * tail.sum())

    return float(minimize_scalar(cost, bounds=(0.05, 20.0), method='bounded').x)


def _share(found: list[Best], is_bent: bool) -> float:
    """Share of the curves of absent parts that lie on edges in space: the most likely one."""
    likely = np.array([one[1:] for best in found if not best.right for one in best.curves if one[0] == is_bent])
    if len(likely) == 0:
        return np.nan

    def cost(share: float) -> float:
        return -float(np.logaddexp(np.log(share) + likely[:, 0], np.log1p(-share) + likely[:, 1]).sum())

    return float(minimize_scalar(cost, bounds=(1e-3, 0.9), method='bounded').x)


def _surface_shares(found: list[Best]) -> np.ndarray:
    """(4,): of the most likely beta distributions of the share of patches that agree, own surfaces and others'."""

    def fit(right: bool, own: np.ndarray | None) -> np.ndarray:
        faces = np.array([face for one in found if one.right == right for face in one.faces]).reshape(-1, 2)
        if len(faces) == 0 or (own is not None and np.isnan(own).any()):
            return np.full(2, np.nan)
        agree, looked = faces.T

        def likely(share: np.ndarray) -> np.ndarray:
            return betaln(agree + share[0], looked - agree + share[1]) - betaln(*share)

        def cost(logarithms: np.ndarray) -> float:
            here = likely(np.exp(logarithms))
            if own is not None:
                here = np.logaddexp(np.log1p(-OTHERS_FACES) + here, np.log(OTHERS_FACES) + likely(own))
            return -float(here.sum())

        return np.exp(minimize(cost, np.zeros(2), method='Nelder-Mead').x)

    own = fit(True, None)
    return np.concatenate([own, fit(False, own)])


def intervals(found: list[Best], rng: np.random.Generator) -> np.ndarray:
    """(2, 9): what 90 in 100 fits to bootstrapped pairs lie between; NaN of what they do not tell."""
    pairs = list(dict.fromkeys(one.pair for one in found))
    fits = []
    for _ in range(BOOTSTRAPS):
        drawn = rng.choice(len(pairs), len(pairs))
        some = [one for k in drawn for one in found if one.pair == pairs[k]]
        if sum(not one.right for one in some) >= LEAST_ABSENT:
            fits.append(fitted(some))
    told = [[fit[k] for fit in fits if np.isfinite(fit[k])] for k in range(len(NAMES))]
    return np.array([np.quantile(some, [0.05, 0.95]) if some else [np.nan, np.nan] for some in told]).T


# -- what is observed ------------------------------------------------------------------------------------------


def report(found: list[Best], counts: np.ndarray, title: str) -> list[str]:
    """Lines: false alarms and refusals where features, outline and surface count for so much (3,)."""
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
    parser.add_argument('--families', nargs='+', default=[*NEGATIVES, *PHOTOREAL_KINDS])
    parser.add_argument('--data', type=Path, help='folder with real and photoreal')
    parser.add_argument('--absent', type=int, default=ABSENT, help='parts that are not there, asked for in a pair')
    parser.add_argument('--seed', type=int, default=0, help='which of them')
    parser.add_argument('--all', action='store_true', help='fit to all pairs, not to every second one')
    parser.add_argument('--draw', type=Path, help='write a picture of the evidence')
    parser.add_argument('--json', type=Path, help='write every search')
    add_batch_options(parser)
    options = parser.parse_args(arguments)
    try:
        found = best_hypotheses(options.families, options.data, options.absent, options.seed, options)
    except FileNotFoundError as reason:
        print(reason)
        return 0
    train, test = [one for one in found if one.train], [one for one in found if not one.train]
    some = found if options.all else train
    numbers = fitted(some)
    low, high = intervals(some, np.random.default_rng(options.seed))
    in_use = np.array([*IMAGE_EVIDENCE, *OTHERS_EDGES, *SURFACE_OF_OWN, *SURFACE_OF_OTHERS])
    print(f'{"":<20}{"fitted":>8}{"90 % of bootstraps":>24}{"in use":>8}')
    for k, name in enumerate(NAMES):
        print(f'{name:<20}{numbers[k]:8.2f}{low[k]:16.2f} {high[k]:7.2f}{in_use[k]:8.2f}')
    for some, title in ((train, 'training'), (test, 'test')):
        print('\n'.join(report(some, in_use[:3], f'{title}, with the numbers in use')))
    if options.json:
        options.json.write_text(json.dumps([asdict(one) for one in found], indent=1) + '\n')
    if options.draw:
        options.draw.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(options.draw), drawing(found, in_use[:3]))
    return 0


if __name__ == '__main__':
    sys.exit(main())
