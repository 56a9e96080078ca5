"""What features alone say: searches in scenes of every kind, and the numbers of the evidence fitted to them.

Models are asked for in synthetic scenes of every kind of clutter, in views that recovery has seen of rendered objects,
and in pictures of cameras, where they are and where they are not. calibrate_evidence.py runs this.

Chance tries h hypotheses, and the best has more than least + tail t nats in (h + alike) exp(-t) of the searches. Of
these three numbers are taken those under which the chances that searches state come true best: searches for what is
absent are counted in classes of stated chance, from 0.1 down, and their deviance (Poisson's, of observed and stated
counts) is least. The numbers of the view (VIEW) and of what lies about an object (NEIGHBOURS) are the most likely ones
of right poses and of chance's best. Every kind of scene counts alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from batches import run_batch
from bench_matcher import GENERATORS, MODELS, THESIS_SIZES, clutter_of, is_right
from bench_poses import NEGATIVES, recovered
from pose_scoring import WRONG_DEG, WRONG_M
from reliability import Stated
from rendered_views import load_object, rendered_view
from scipy.optimize import minimize
from scipy.special import expit, logit, xlogy
from scipy.stats import poisson
from true_pairs import data_folder, load_pair
from true_poses import difference, parts_of, posed_names, posed_pair

from model_matcher import MatchParams, MatchResult, index_model, match
from model_matcher.closed_form.synthetic.scenes import make_scene, scaled
from model_matcher.model.index import ModelIndex
from model_matcher.model.problem import make_problem
from model_matcher.model.regularity import regularity
from model_matcher.pipeline import warm_up
from model_matcher.verification.evidence import surroundings
from model_matcher.verification.settings import FALSE_ALARMS, NEIGHBOURS, VIEW
from model_matcher.verification.visibility_evidence import count_in_view
from msgs_py import FeatureSet, Interpretation
from stereo_recovery import recover
from stereo_recovery.pipeline import warm_up as warm_up_recovery

# Classes of stated chance in which searches are counted; where the fit begins: least, tail, alike.
CLASSES = (0.0, 0.001, 0.003, 0.01, 0.03, 0.1)
STARTS = ((-18.0, 2.1, 1000.0), (-12.0, 1.7, 500.0), (-22.0, 2.5, 2000.0), (-15.0, 2.0, 100.0))
RATE = MatchParams().false_alarm_rate
# Objects whose views models are asked for in that are not there.
SEEN = ('coverplate', 'table', 'widget', 'lamp', 'cylinder_box', *THESIS_SIZES)
# Parts that are not there, asked for in a picture.
ABSENT = 12
# Nats, less than any hypothesis has.
NONE = -50.0
FIRST_SEED = 60_000
# Of the numbers that are fitted.
NAMES = (
    *(f'chance: {name}' for name in FALSE_ALARMS._fields),
    *(f'view: {name}' for name in VIEW._fields),
    *(f'about: {name}' for name in NEIGHBOURS._fields),
)
IN_USE = np.array([*FALSE_ALARMS, *VIEW, *NEIGHBOURS])


@dataclass(frozen=True)
class Searched:
    """One search.

    kind : what the scene is made of; scene : its name; share : of the model's edges in view, 0 where it is not there;
    hypotheses : that there are; evidence : nats, the best, of a model that is there the best right one, minus infinity
    without; train : whether its scene is one to fit to; view, about : counts of that pose, see :class:`.InView` and
    :class:`.Surroundings`; None where there is none
    """

    kind: str
    scene: str
    share: float
    hypotheses: float
    evidence: float
    train: bool
    view: list[int] | None = None
    about: list[float] | None = None

    @property
    def absent(self) -> bool:
        """Whether what is looked for is not there."""
        return self.share == 0.0

    def stated(self, numbers: np.ndarray) -> Stated:
        """The chance that it states, with FALSE_ALARMS (3,)."""
        chance = float(_chances(numbers, np.array([self.hypotheses]), np.array([self.evidence]))[0])
        return Stated(self.kind, self.share, chance)


def _searched(
    kind: str,
    scene: str,
    share: float,
    index: ModelIndex,
    data: FeatureSet,
    is_its: Callable[[Interpretation], bool] | None,
    train: bool,
) -> list[dict[str, Any]]:
    """Look for a model, and keep what was found; nothing where it was not looked for, for lack of data.

    is_its : whether a pose is right, of a model that is there
    """
    result: MatchResult = match(index, data, MatchParams(false_alarm_rate=RATE))
    if 'evidence_needed' not in result.stats:
        return []
    hypotheses = make_problem(index, data, MatchParams()).hypotheses
    evidence = float(result.stats.get('evidence', -np.inf))
    first = next(iter((*result.interpretations, *result.rejected)), None)
    if is_its is not None and (first is None or not is_its(first)):
        first, evidence = None, -np.inf
    view = about = None
    if first is not None and np.isfinite(evidence):
        view, about = _counts(index, data, first)
    return [asdict(Searched(kind, scene, share, float(hypotheses), evidence, train, view, about))]


def _counts(index: ModelIndex, data: FeatureSet, found: Interpretation) -> tuple[list[int], list[float]]:
    """What a pose finds of the model, and what lies about it: see :class:`Searched`."""
    problem = make_problem(index, data, MatchParams())
    # In the numbers of the model's and the data's usable features.
    number = np.full(int(index.source.max()) + 2, -1, np.int32)
    number[index.source] = np.arange(len(index))
    assignment = number[found.assignment[problem.keep]]
    used = np.zeros(len(index), bool)
    used[assignment[assignment >= 0]] = True
    motion = np.r_[found.pose.rotation.ravel(), found.pose.translation]
    regular = regularity(index)
    view = count_in_view(motion, used, regular.faces, regular.lies)
    about = surroundings(motion, problem.model, problem.features, assignment)
    return [int(count) for count in view], [float(count) for count in about]


# -- the searches ----------------------------------------------------------------------------------------------


def in_synthetic_scene(kind: str, name: str, seed: int) -> list[dict[str, Any]]:
    """A model in scenes of which four fifths are clutter of a kind."""
    model, index = MODELS[name](), _of_scenes(name)
    rng = np.random.default_rng(seed)
    copies = tuple(scaled(model, f) for f in (rng.uniform(0.85, 0.92), rng.uniform(1.08, 1.15)))
    decoys = copies if kind == 'decoys' else ()
    found = []
    for share, count, visible in ((0.0, 0, 0.75), (0.75, 1, 0.75), (0.3, 1, 0.3)):
        scene = make_scene(model, seed, 0.8, visible, count, decoys=decoys, others=_clutter(kind, name))

        def is_its(one: Interpretation, scene: Any = scene) -> bool:
            return is_right(one, scene, index.size)

        found += _searched(kind, f'{name} {seed}', share, index, scene.data, is_its if count else None, seed % 2 == 0)
    return found


_clutter = cache(clutter_of)
_object = cache(load_object)


@cache
def _of_scenes(name: str) -> ModelIndex:
    return index_model(MODELS[name](), name)


@cache
def _of_views(name: str) -> ModelIndex:
    return index_model(_object(name)[1], name)


def in_recovered_view(seed: int, file: str) -> list[dict[str, Any]]:
    """Models in a view of an object, as recovery has seen it in a rendered pair."""
    view = rendered_view(*_object(file), 100 * seed + SEEN.index(file))
    data = recover(view.left, view.right, view.rig).features
    found = []
    for name in THESIS_SIZES:
        index = _of_views(name)

        def is_its(one: Interpretation, size: float = index.size) -> bool:
            errors = [pose.error_to(view.pose) for pose in (one.pose, *one.symmetric_poses)]
            return any(error.rotation_deg < 3.0 and error.translation < 0.03 * size for error in errors)

        own = name == file
        found += _searched(
            'recovered views', f'{file} {seed}', float(own), index, data, is_its if own else None, seed % 2 == 0
        )
    return found


def in_picture(folder: Path, family: str, name: str, number: int) -> list[dict[str, Any]]:
    """Parts that are there and others in a pair of cameras."""
    posed = posed_pair(folder, load_pair(folder, family, name))
    there = {one.part.name: one.part for one in posed.instances}
    others = [part for part in parts_of(folder) if part.name not in there]
    rng = np.random.default_rng([0, number])
    _, features = recovered(posed.pair)
    absent = [others[k] for k in rng.choice(len(others), min(ABSENT, len(others)), replace=False)]
    found = []
    for part in (*there.values(), *absent):
        instances = [one for one in posed.instances if one.part.name == part.name]

        def is_its(one: Interpretation, instances: Any = instances) -> bool:
            poses = (one.pose, *one.symmetric_poses)
            return any(difference(it, pose).within(WRONG_DEG, WRONG_M) for it in instances for pose in poses)

        share = float(bool(instances))
        found += _searched(
            'pictures', f'{family} {name}', share, part.index, features, is_its if instances else None, number % 2 == 0
        )
    return found


_SEARCHES: dict[str, Callable[..., list[dict[str, Any]]]] = {
    'scene': in_synthetic_scene,
    'view': in_recovered_view,
    'picture': in_picture,
}


def search(job: tuple[Any, ...]) -> list[dict[str, Any]]:
    """A job: the name of what is searched, and its arguments."""
    return _SEARCHES[job[0]](*job[1:])


def all_searches(count: int, data: Path | None, options: argparse.Namespace) -> list[Searched]:
    """So many scenes of each kind and model, views, and pictures where there are any."""
    try:
        folder = data_folder(data)
        pairs = posed_names(folder, list(NEGATIVES))
    except FileNotFoundError as reason:
        print(reason)
        folder, pairs = Path(), []
    jobs: dict[str, tuple[Any, ...]] = {
        f'{kind} {name} {seed}': ('scene', kind, name, seed)
        for kind in GENERATORS
        for name in THESIS_SIZES
        for seed in range(FIRST_SEED, FIRST_SEED + count)
    }
    jobs |= {f'view {file} {seed}': ('view', seed, file) for seed in range(max(2, count // 4)) for file in SEEN}
    jobs |= {
        f'{family} {name}': ('picture', folder, family, name, number) for number, (family, name) in enumerate(pairs)
    }
    return [Searched(**one) for some in run_batch(search, jobs, options, 'features', _ready).values() for one in some]


def _ready() -> None:
    warm_up_recovery()
    warm_up()


# -- the fit ---------------------------------------------------------------------------------------------------


def fitted(found: Sequence[Searched]) -> np.ndarray:
    """(11,): the numbers of NAMES; NaN of those that nothing tells."""
    absent = [one for one in found if one.absent]
    return np.concatenate([_tail(absent), _view(found), _about(found)])


def _weights(found: Sequence[Searched]) -> np.ndarray:
    """(n,), so that every kind of scene counts alike, and all together as many as there are."""
    kinds = [one.kind for one in found]
    weight = np.array([1.0 / kinds.count(kind) for kind in kinds])
    return weight * len(found) / max(weight.sum(), 1e-12)


def _chances(numbers: np.ndarray, hypotheses: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """(n,), the chances that searches state, with FALSE_ALARMS (3,)."""
    least, tail, alike = numbers
    return np.exp(np.minimum(0.0, np.log(hypotheses + alike) + (least - evidence) / tail))


def _tail(absent: Sequence[Searched]) -> np.ndarray:
    """(3,): least, tail, alike."""
    hypotheses = np.array([one.hypotheses for one in absent])
    # Where nothing was thought of, there is no evidence at all.
    evidence = np.array([max(one.evidence, NONE) for one in absent])
    kinds = np.array([one.kind for one in absent])
    of_kind = [kinds == kind for kind in dict.fromkeys(kinds)]
    shares = np.diff(CLASSES)

    def cost(numbers: np.ndarray) -> float:
        chances = _chances(np.array([numbers[0], *np.exp(numbers[1:])]), hypotheses, evidence)
        total = 0.0
        for mine in of_kind:
            seen, stated = np.histogram(chances[mine], CLASSES)[0], shares * mine.sum()
            total += float((xlogy(seen, seen / stated) - seen + stated).sum()) / mine.sum()
        return total * len(absent) / len(of_kind)

    starts = [np.array([least, np.log(tail), np.log(alike)]) for least, tail, alike in STARTS]
    # Counts go in steps: the simplex begins wide.
    steps = np.vstack([np.zeros(3), np.diag([2.0, 0.15, 1.0])])
    fits = [minimize(cost, start, method='Nelder-Mead', options={'initial_simplex': start + steps}) for start in starts]
    best = min(fits, key=lambda fit: float(fit.fun)).x
    return np.array([best[0], *np.exp(best[1:])])


def _view(found: Sequence[Searched]) -> np.ndarray:
    """(4,): by_chance, thinned, seen, hidden; of two ways in which a model's features are found, each as likely."""
    counted = [one for one in found if one.view is not None]
    view, weight = np.array([one.view for one in counted], float).reshape(-1, 6), _weights(counted)
    right = np.array([not one.absent for one in counted], bool)
    if right.all() or not right.any():
        return np.full(4, np.nan)
    features, hits, in_view, seen, out_of_view, hidden = view.T
    by_chance = float((weight * hits)[~right].sum() / (weight * features)[~right].sum())

    def cost(logits: np.ndarray) -> float:
        thinned, of_seen, of_hidden = expit(logits)

        def nats(count: np.ndarray, missed: np.ndarray, chance: float) -> np.ndarray:
            return count * np.log(chance / by_chance) + missed * np.log((1.0 - chance) / (1.0 - by_chance))

        ways = (
            nats(hits, features - hits, thinned),
            nats(seen, in_view - seen, of_seen) + nats(hidden, out_of_view - hidden, of_hidden),
        )
        return -float((weight * np.logaddexp(*ways))[right].sum())

    start = logit([0.4, 0.5, 0.1])
    return np.array([by_chance, *expit(minimize(cost, start, method='Nelder-Mead').x)])


def _about(found: Sequence[Searched]) -> np.ndarray:
    """(4,): of_chance, missed, at_ends, crowded; counts of what meets are as likely as Poisson says."""
    counted = [one for one in found if one.about is not None]
    about, weight = np.array([one.about for one in counted], float).reshape(-1, 3), _weights(counted)
    right = np.array([not one.absent for one in counted], bool)
    if right.all() or not right.any():
        return np.full(4, np.nan)
    matched, met, density = about.T

    def cost(logarithms: np.ndarray) -> float:
        of_chance, missed, at_ends = np.exp(logarithms[:3])
        crowded = expit(logarithms[3])
        expected = at_ends * density + missed * matched + 0.05
        alone, chance = poisson.logpmf(met, expected), poisson.logpmf(met, expected + of_chance)
        likely = np.where(right, np.logaddexp(np.log1p(-crowded) + alone, np.log(crowded) + chance), chance)
        return -float(weight @ likely)

    start = np.r_[np.log([2.0, 0.03, 0.3]), logit(0.05)]
    best = minimize(cost, start, method='Nelder-Mead', options={'maxiter': 2000}).x
    return np.array([*np.exp(best[:3]), expit(best[3])])
