"""Which models of an index a scene may show: votes of its pairs, poses of the models they agree on, and their evidence.

Pairs of the scene that are near each other, the rarest first, are looked up in the index. Those that share a feature
vote for the model feature that it lies on, and a model counts by how well they agree, each vote as much as it is rare.
Of the models that count most, poses are made, each tried on all data. What the best poses explain tells objects apart,
and for each object the best models are refined and weighed by their evidence, as in any other library.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from msgs_py import FeatureKind, FeatureSet
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.settings import THREADS
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray, Int64Array

from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..model.problem import usable
from ..model.settings import SEARCH_WIDTH
from ..params import MatchParams
from ..search.prefilter import shared_pairs, worth_searching
from ..verification.settings import CLAIMED
from .catalogue import Catalogue
from .lookup import (
    Hits,
    Scene,
    ScenePairs,
    Votes,
    agreement,
    by_model,
    count_postings,
    explained_data,
    gather,
    models_hit,
    vote,
)
from .pair_table import in_order, parallel_partners
from .settings import EACH, LOOKED_AT, OBJECTS, READ, ROUNDS, WEIGHED, Round


def candidates(
    catalogue: Catalogue, data: FeatureSet, params: MatchParams, deadline: Deadline | None = None
) -> list[ModelIndex]:
    """The models of an index that are worth a full search in a scene.

    Parameters
    ----------
    catalogue : Catalogue
    data : FeatureSet
        Camera frame, metres.
    params : MatchParams
        Its false_alarm_rate is that of a single model.
    deadline : Deadline, optional
        When it has passed, no more pairs are looked up, and no more models weighed.

    Returns
    -------
    list of ModelIndex
        Best first; none when the data has no pairs that the index knows.
    """
    deadline = deadline or Deadline()
    data = data.select(usable(data))
    if len(data) < 3 or catalogue.last == catalogue.first:
        return []
    scene = scene_of(catalogue, data, params)
    pairs = scene_pairs(catalogue, scene)
    hits = hits_of(catalogue, scene, pairs, deadline)
    if len(hits.hits) == 0:
        return []
    votes = poses_of(catalogue, scene, pairs, hits)
    chosen = by_object(catalogue, scene, votes)
    models = [catalogue.model(number) for number in chosen]
    motions = np.asarray(votes.motions[chosen], float)[:, None]
    kept = worth_searching(models, data, params, motions, np.full((len(models), 1), 1.0), deadline)
    return [models[k] for k in kept]


def scene_of(catalogue: Catalogue, data: FeatureSet, params: MatchParams) -> Scene:
    """A scene's features as compiled functions take them."""
    rows = feature_rows(data)
    tolerances = np.array([data_tolerances(data, rows, float(size), params) for size in catalogue.class_sizes])
    return Scene(rows, data.kind.copy(), tolerances, catalogue.classes, params.curvedev)


def scene_pairs(catalogue: Catalogue, scene: Scene) -> ScenePairs:
    """The pairs that are looked up, the rarest first."""
    rows, kind = scene.rows, scene.kind
    crossing, near = shared_pairs(rows, float(np.median(catalogue.features.sizes)))
    ordered = np.array([in_order(kind, a, b) for a, b in crossing], np.int32).reshape(-1, 2)
    parallel = parallel_partners(rows, kind, float(catalogue.class_sizes[-1]), EACH)
    around = cKDTree(rows[:, :3]).query(rows[:, :3], k=min(len(rows), near.shape[1] + 1))[1].reshape(len(rows), -1)
    beside = np.full((len(parallel), near.shape[1]), -1, np.int32)
    beside[:, : around.shape[1] - 1] = around[parallel[:, 0], 1:]
    pairs = ScenePairs(
        np.concatenate([ordered, parallel]),
        np.repeat(np.array([0, 1], np.uint8), [len(ordered), len(parallel)]),
        np.concatenate([near, beside]),
    )
    counts = np.zeros(len(pairs.members), np.int64)
    count_postings(scene, pairs, catalogue.postings.starts, catalogue.scale, counts)
    chosen = rarest(pairs.members, counts)
    return ScenePairs(pairs.members[chosen], pairs.parallel[chosen], pairs.near[chosen])


def rarest(members: AnyArray, counts: Int64Array) -> Int64Array:
    """Numbers of the pairs to look up: the rarest first, no feature in more than EACH, READ postings in all.

    Examples
    --------
    >>> rarest(np.array([[0, 1], [0, 2], [1, 2]]), np.array([7, 0, 5])).tolist()
    [2, 0]
    """
    used: dict[int, int] = {}
    chosen: list[int] = []
    read = 0
    for row in np.argsort(counts, kind='stable'):
        a, b = (int(k) for k in members[row])
        if counts[row] == 0 or max(used.get(a, 0), used.get(b, 0)) >= EACH:
            continue
        read += int(counts[row])
        if read > READ and chosen:
            break
        used[a], used[b] = used.get(a, 0) + 1, used.get(b, 0) + 1
        chosen.append(int(row))
    return np.array(chosen, np.int64)


def hits_of(catalogue: Catalogue, scene: Scene, pairs: ScenePairs, deadline: Deadline) -> Hits:
    """Look up all pairs."""
    postings = catalogue.postings
    counts = np.zeros(len(pairs.members), np.int64)
    count_postings(scene, pairs, postings.starts, catalogue.scale, counts)
    share = catalogue.first, catalogue.last

    def look_up(p: int) -> Int64Array:
        if deadline.passed:
            return np.zeros(0, np.int64)
        room = np.empty(int(counts[p]), np.int64)
        found = gather(scene, pairs, p, catalogue.features, postings, catalogue.scale, share, room)
        return room[:found].copy()

    parts = spread(look_up, range(len(counts)))
    limits = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    hits = Hits(np.zeros(len(catalogue) + 1, np.int64), np.empty(limits[-1], np.int64), np.empty(limits[-1], np.int32))
    by_model(np.concatenate([np.zeros(0, np.int64), *parts]), limits, postings.owner, hits)
    return hits


def poses_of(catalogue: Catalogue, scene: Scene, pairs: ScenePairs, hits: Hits) -> Votes:
    """Votes of the pairs, and the best poses of the models that they agree on best.

    The nats of a model are those of its best pose and of the pairs' agreement: a pose made of one pair alone is too
    vague to tell the right model from very many like it, and the pairs know nothing of what lies in no pair.
    """
    support, agreed = agreement_of(catalogue, pairs, hits)
    votes = no_votes(len(catalogue))
    gains = _gains(catalogue, scene)
    for round_ in ROUNDS:
        models = _highest(agreed, round_.models)

        def some(part: int, models: Int64Array = models, round_: Round = round_) -> None:
            """Poses of some of the models."""
            vote(
                scene,
                pairs,
                hits,
                support,
                models[part::THREADS],
                round_,
                catalogue.features,
                catalogue.postings,
                catalogue.scale.floor,
                gains,
                SEARCH_WIDTH,
                votes,
            )

        spread(some, range(THREADS))
    return votes._replace(nats=votes.nats + agreed)


def no_votes(models: int) -> Votes:
    """Of so many models none has a pose."""
    return Votes(np.full(models, -np.inf, np.float32), np.zeros((models, 12), np.float32))


def agreement_of(catalogue: Catalogue, pairs: ScenePairs, hits: Hits) -> tuple[Float32Array, Float32Array]:
    """Support of each hit, and how well the pairs agree on each model; see :func:`.lookup.agreement`."""
    counts = np.zeros(len(pairs.members), np.int64)
    models_hit(hits, counts)
    rarity = np.log((catalogue.last - catalogue.first) / np.maximum(counts, 1))
    support, nats = np.empty(len(hits.hits), np.float32), np.zeros(len(catalogue), np.float32)
    # As many hits for each thread.
    limits = np.searchsorted(hits.starts, np.linspace(0, len(hits.hits), THREADS + 1)[1:-1])
    parts = np.concatenate([[catalogue.first], np.clip(limits, catalogue.first, catalogue.last), [catalogue.last]])

    def some(part: int) -> None:
        first, last = int(parts[part]), int(parts[part + 1])
        agreement(pairs, hits, rarity, catalogue.features, catalogue.postings, first, last, support, nats)

    spread(some, range(THREADS))
    return support, nats


def _highest(values: Float32Array, most: int) -> Int64Array:
    """Numbers of the highest finite values above 0, highest first."""
    order = np.argpartition(-values, most - 1)[:most] if len(values) > most else np.arange(len(values))
    order = order[np.isfinite(values[order])]
    return order[np.argsort(-values[order], kind='stable')].astype(np.int64)


def _gains(catalogue: Catalogue, scene: Scene) -> FloatArray:
    """Nats of an explained feature of each kind, and what they lose by the square of its fit, (3, 2).

    By chance a line that runs like one of a model's three directions lies within its tolerance across in two dimensions
    of the model's size, a curve in three, and its radius within the tolerance of the model's. The square of a fit, in
    tolerances of three sigma, is half a chi squared of 9 / SEARCH_WIDTH squared at most; a pose of one pair adds to it.
    """
    middle = len(catalogue.class_sizes) // 2
    room = catalogue.class_sizes[middle] / (2.0 * SEARCH_WIDTH * float(np.median(scene.tolerances[middle, :, 0])))
    one = max(math.log(room), 0.5)
    gains = np.full((3, 2), 2.0)
    gains[:, 0] = 2.0 * one + math.log(3.0)
    gains[FeatureKind.CURVE, 0] = 4.0 * one
    return gains


def by_object(catalogue: Catalogue, scene: Scene, votes: Votes) -> list[int]:
    """The models to weigh: of each object, which is the data that a best pose explains, those that explain it best."""
    order = _highest(votes.nats, LOOKED_AT)
    on = np.empty(len(scene.rows), np.int32)
    heads: list[AnyArray] = []
    members: list[list[int]] = []
    for number in order.tolist():
        motion = votes.motions[number].astype(float)
        explained_data(scene, catalogue.features, number, motion, SEARCH_WIDTH, on)
        explained = on >= 0
        for head, group in zip(heads, members):
            if (explained & head).sum() > CLAIMED * explained.sum():
                if len(group) < WEIGHED:
                    group.append(number)
                break
        else:
            if len(heads) < OBJECTS:
                heads.append(explained)
                members.append([number])
    return [number for group in members for number in group]
