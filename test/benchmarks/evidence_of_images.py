"""What features and images say together: searches in pictures, and the numbers of the evidence fitted to them.

Parts are asked for in real and path-traced pairs, those that stand there and others. Every hypothesis that a search
looks for in the images is recorded: the nats of its features, those of its outline, how many patches of its surface
agree, and whether it is right. What a nat of each counts for is fitted so that the best hypotheses of parts that are
absent have more than t nats in exp(-t) of the searches, and with that the most right ones are accepted at the default
rate (Neyman and Pearson's test). How often curves of absent parts lie on edges in space, and what share of the patches
agrees, is fitted by maximum likelihood. calibrate_evidence.py runs this.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from batches import run_batch
from bench_poses import recovered
from pose_scoring import WRONG_DEG, WRONG_M
from reliability import Stated
from scipy.optimize import minimize, minimize_scalar
from scipy.special import betaln
from true_pairs import data_folder, load_pair
from true_poses import ALIKE, Part, PosedPair, difference, parts_of, posed_names, posed_pair

from model_matcher import MatchParams
from model_matcher.geometry.pose_rows import as_pose
from model_matcher.image_pose.ends import ends_seen
from model_matcher.image_pose.measurement import Presence, searched
from model_matcher.image_pose.presence import bent, chance_beside, over_views
from model_matcher.image_pose.settings import (
    ENDS_OF_OTHERS,
    ENDS_OF_OWN,
    OTHERS_EDGES,
    OTHERS_FACES,
    REACH,
    SURFACE_OF_OTHERS,
    SURFACE_OF_OWN,
)
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
# Nats of the features where nothing was thought of, less than any hypothesis has.
NONE = -50.0
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
    'own ends, a',
    'own ends, b',
    "others' ends, a",
    "others' ends, b",
)
IN_USE = np.array([*IMAGE_EVIDENCE, *OTHERS_EDGES, *SURFACE_OF_OWN, *SURFACE_OF_OTHERS, *ENDS_OF_OWN, *ENDS_OF_OTHERS])
# Logarithms of the numbers of a beta distribution between which the likeliest is looked for: some hundred outlines do
# not tell a share that is the same for all from one that hardly differs.
BETA_BOUNDS = (-5.0, 5.0)


@dataclass(frozen=True)
class Best:
    """The best hypothesis of one search that is right, or the best of one for a part that is absent.

    right : whether the part is there; features, outline : nats; faces : patches of each that agree, and that could;
    train : whether its pair is one to fit to; curves : of each curve of its outline, whether it is bent, and the
    likelihoods of over_views; ends : past which an edge goes on, and all, see ends_seen
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
    ends: tuple[float, float]

    @property
    def kind(self) -> str:
        """What it was looked for in."""
        return f'images: {self.family}'

    @property
    def scene(self) -> str:
        """Its pair."""
        return self.pair

    @property
    def absent(self) -> bool:
        """Whether what is looked for is not there."""
        return not self.right

    def stated(self, counts: np.ndarray) -> Stated:
        """The chance that it states where features, outline and surface count for so much (3,)."""
        nats = float((_columns([self])[0] @ counts)[0])
        return Stated(self.kind, float(self.right), float(np.exp(min(0.0, -nats))))


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
    return [asdict(_best(posed, part, features, views, job.number % 2 == 0)) for part in parts]


def _ready() -> None:
    warm_up_recovery()
    warm_up(images=True)


def _best(posed: PosedPair, part: Part, features: FeatureSet, views: Views, train: bool) -> Best:
    """The best right hypothesis, or of an absent part the best of all; NONE where nothing was thought of."""
    looked: list[image_evidence.Weighed] = []

    def recorded(weigh: Callable[..., image_evidence.Weighed]) -> Callable[..., image_evidence.Weighed]:
        def recording(*args: Any) -> image_evidence.Weighed:
            looked.append(weigh(*args))
            return looked[-1]

        return recording

    with (
        patch.object(image_evidence, 'weigh', recorded(image_evidence.weigh)),
        patch.object(image_evidence, 'weigh_turned', recorded(image_evidence.weigh_turned)),
    ):
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
    about = posed.pair.family, posed.pair.name, part.name, bool(instances)
    if not looked:
        return Best(*about, NONE, 0.0, [], train, [], (0.0, 0.0))
    best = max(looked, key=lambda one: one.evidence)
    nats = float(best.hypothesis.evidence), float(best.shown.log_ratio)
    faces = [(face.agree, face.looked) for face in best.surface or ()]
    sight = best.shown.sight
    is_bent = bent(sight.placed.point, sight.placed.curve, sight.limb)
    ends = ends_seen(views.pictures, sight.placed, sight.spacing, sight.stretch, best.shown.found, is_bent)
    return Best(*about, *nats, faces, train, _curves(best.shown, views), ends)


def _with_surface(one: image_evidence.Weighed, part: Part, views: Views) -> image_evidence.Weighed:
    """A hypothesis with what the images show of its surface, whether or not that can decide."""
    shape = part.index.shape
    return replace(one, surface=agreement(shape, as_pose(one.motion), one.shown.sight, views))


def _curves(shown_there: Presence, views: Views) -> list[tuple[bool, float, float]]:
    """See :class:`Best`."""
    sight = shown_there.sight
    placed = sight.placed
    chance = chance_beside(searched(sight, views, REACH + 1), placed.group, OTHERS_EDGES)
    edge, apart = over_views(shown_there.found, placed.group, placed.curve, chance)
    is_bent = bent(placed.point, placed.curve, sight.limb)
    return [(bool(is_bent[c]), float(edge[c]), float(apart[c])) for c in np.unique(placed.curve)]


# -- the fit ---------------------------------------------------------------------------------------------------


def _columns(found: list[Best]) -> tuple[np.ndarray, np.ndarray]:
    """Nats (n, 3) of features, outline and surface, and whether right (n,)."""
    nats = [[one.features, one.outline, log_ratio([Agreement(*face) for face in one.faces])] for one in found]
    return np.array(nats).reshape(-1, 3), np.array([one.right for one in found], bool)


def fitted(every: Sequence[Best]) -> np.ndarray:
    """(13,): the numbers of NAMES; NaN of those that nothing tells, as of curves where none of that kind was seen."""
    # Of a right pose that was not thought of nothing is known; of an absent part it is what mostly happens.
    found = [one for one in every if one.absent or one.features > NONE]
    nats, right = _columns(found)
    shares = [_share(found, False), _share(found, True)]
    shares = [*shares, *_surface_shares(found), *_ends(found, True), *_ends(found, False)]
    if right.all() or not right.any():
        return np.array([*np.full(3, np.nan), *shares])

    def counts(logarithms: np.ndarray) -> np.ndarray:
        direction = np.exp(logarithms - logarithms.max())
        return direction * _scale(nats[~right] @ direction)

    def cost(logarithms: np.ndarray) -> float:
        missing = -np.log(DEFAULT_RATE) - nats[right] @ counts(logarithms)
        return float(np.logaddexp(0.0, missing).mean())

    # The scale goes in steps where absent parts change places at the quantile: several ways down.
    fits = [minimize(cost, np.log(start), method='Nelder-Mead') for start in STARTS]
    best = counts(min(fits, key=lambda fit: fit.fun).x)
    return np.array([*best, *shares])


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
    likely = np.array([one[1:3] for best in found if not best.right for one in best.curves if one[0] == is_bent])
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

        def likely(shape: np.ndarray) -> np.ndarray:
            here = _beta_binomial(faces, shape)
            if own is None:
                return here
            return np.logaddexp(np.log1p(-OTHERS_FACES) + here, np.log(OTHERS_FACES) + _beta_binomial(faces, own))

        return _likeliest_beta(likely)

    own = fit(True, None)
    return np.concatenate([own, fit(False, own)])


def _ends(found: list[Best], right: bool) -> np.ndarray:
    """(2,): of the most likely beta distribution of the share of ends past which an edge goes on: the object's own, or
    of the best of absent parts; only these can be answered."""
    some = [one for one in found if one.right == right]
    if some and not right:
        evidence = _columns(some)[0] @ IN_USE[:3]
        some = [one for one, nats in zip(some, evidence) if nats >= np.quantile(evidence, TAIL_FROM)]
    ends = np.array([one.ends for one in some if one.ends[1] > 0.0]).reshape(-1, 2)
    return _likeliest_beta(lambda shape: _beta_binomial(ends, shape)) if len(ends) else np.full(2, np.nan)


def _beta_binomial(counts: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """(n,): log-likelihoods of how many (n, 2) of how many, of a share that has a beta distribution."""
    some, every = counts.T
    return np.asarray(betaln(some + shape[0], every - some + shape[1]) - betaln(*shape))


def _likeliest_beta(likely: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(2,): the beta distribution with the greatest sum of log-likelihoods."""
    fit = minimize(
        lambda x: -float(likely(np.exp(x)).sum()), np.zeros(2), method='Nelder-Mead', bounds=[BETA_BOUNDS] * 2
    )
    return np.asarray(np.exp(fit.x))
