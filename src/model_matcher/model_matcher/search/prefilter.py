"""Which models of a large library are worth a full search.

Every data feature is paired with the few features it pairs with best. One list of such pairs serves all models: each
pair is looked up in a model's pair table, turned into a pose, and the pose tried first on the neighbours of the pair,
then on all data, as in the full search, but with far fewer pairs. A model that is there is hit by many of the pairs; it
only has to be hit once to show a score above what chance gives. Of the models that score best, the best poses are
refined and judged by their evidence: where few edges are in view, chance scores as much, but fits worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from msgs_py import FeatureSet
from msgs_py.numeric.deadline import Deadline, blocks
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.threads import spread
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from ..geometry.features import DataFeatures, ModelFeatures, PairTable
from ..geometry.line_pairs import rank_pairs
from ..geometry.settings import SMALLEST_LENGTH
from ..model.index import ModelIndex, data_tolerances, feature_rows
from ..model.problem import make_problem
from ..model.settings import SEARCH_WIDTH
from ..params import MatchParams
from ..verification.false_alarms import needed_evidence
from ..verification.refinement import refine_all
from .pair_search import Candidates
from .prefilter_kernels import best_poses, count_hypotheses
from .settings import (
    BUDGET,
    EACH,
    JUDGED,
    LEAST_CANDIDATES,
    LEAST_PAIRS,
    MOST_CANDIDATES,
    NEAR,
    PARTNERS,
    POSES,
    SAMPLE,
)


def prefilter(
    models: Sequence[ModelIndex], data: FeatureSet, params: MatchParams, deadline: Deadline | None = None
) -> list[int]:
    """Which models of a library are worth a full search.

    Parameters
    ----------
    models : sequence of ModelIndex
    data : FeatureSet
        Camera frame, metres.
    params : MatchParams
    deadline : Deadline, optional
        When it has passed, no more pairs are counted, and no more models refined.

    Returns
    -------
    list of int
        Numbers of the models, best first; all of them when there is next to no data.

    """
    deadline = deadline or Deadline()
    keep = np.flatnonzero(data.lengths > SMALLEST_LENGTH)
    if len(keep) < 3:
        return list(range(len(models)))
    used = data.select(keep)
    scores, motions = library_scores(models, used, params, deadline)
    sizes = np.array([len(model) for model in models])
    # Chance explains more features of a large model, but a smaller share of them.
    order = np.argsort(-scores[:, 0] / np.sqrt(sizes), kind='stable')
    order = order[scores[order, 0] > 0.0][:JUDGED]

    kept = worth_searching([models[k] for k in order], used, params, motions[order], scores[order], deadline)
    return [int(order[k]) for k in kept]


def worth_searching(
    models: Sequence[ModelIndex],
    data: FeatureSet,
    params: MatchParams,
    motions: FloatArray,
    scores: FloatArray,
    deadline: Deadline,
) -> list[int]:
    """Which models are worth a full search, by the evidence of a few poses of each.

    Parameters
    ----------
    models : sequence of ModelIndex
    data : FeatureSet
        Features with length, camera frame, metres.
    params : MatchParams
    motions : (m, k, 12) float64
        Poses of each model.
    scores : (m, k) float64
        What they explain; 0 where there is no pose.
    deadline : Deadline
        When it has passed, no more models are weighed; those that no time is left for keep their order.

    Returns
    -------
    list of int
        Numbers of the models, best first.

    """

    def judged(k: int) -> float:
        return -np.inf if deadline.passed else _surplus(models[k], data, params, motions[k], scores[k])

    surplus = np.array(spread(judged, range(len(models))))
    ranked = np.argsort(-surplus, kind='stable')
    least = 1 if surplus.max(initial=-np.inf) > DECISIVE else LEAST_CANDIDATES
    return [
        int(k)
        for place, k in enumerate(ranked)
        if place < least or (place < MOST_CANDIDATES and surplus[k] > -DECISIVE)
    ]


def _surplus(
    model: ModelIndex, data: FeatureSet, params: MatchParams, motions: FloatArray, scores: FloatArray
) -> float:
    """Nats by which the best of a model's poses, refined, exceeds what an accepted interpretation needs."""
    problem = make_problem(model, data, params)
    refined = refine_all(problem, motions.copy(), scores, params, keep=0.0)
    needed = needed_evidence(problem, params)
    return float(refined.evidence.max() - max(needed, 0.0))


def library_scores(
    models: Sequence[ModelIndex], data: FeatureSet, params: MatchParams, deadline: Deadline | None = None
) -> tuple[FloatArray, FloatArray]:
    """What the best poses of the shared pairs explain of each model.

    Parameters
    ----------
    models : sequence of ModelIndex
    data : FeatureSet
        Features with length, camera frame, metres.
    params : MatchParams
    deadline : Deadline, optional
        When it has passed, no more pairs are counted, but the first.

    Returns
    -------
    scores : (models, POSES) float64
        As :func:`.back_projection.count_matches` gives them, best first, 0 where there is no pose.
    motions : (models, POSES, 12) float64
        The poses.

    """
    deadline = deadline or Deadline()
    rows = feature_rows(data)
    scores, motions = np.zeros((len(models), POSES)), np.zeros((len(models), POSES, 12))

    def against(number: int) -> tuple[ModelFeatures, PairTable, DataFeatures]:
        model = models[number]
        tolerances = data_tolerances(data, rows, model.size, params)
        features = DataFeatures(rows, data.kind, tolerances, params.curvedev * model.max_radius)
        return model.prepared(SEARCH_WIDTH * float(tolerances[:, 0].max())), model.pair_table, features

    pairs, near = shared_pairs(rows, float(np.median([model.size for model in models])))
    # How often a pair fits a model by chance is the same for all of a library, more or less: a few models tell.
    counts = np.zeros(len(pairs), np.int64)
    sample = range(0, len(models), max(1, len(models) // SAMPLE))
    told = [against(number) for number in sample]
    for first, last in blocks(len(pairs), deadline):
        for model in told:
            count_hypotheses(pairs[first:last], *model, counts[first:last])
    chosen = choose_pairs(pairs, counts / len(sample))
    pairs, near = pairs[chosen], near[chosen]

    def work(number: int) -> None:
        best_poses(pairs, near, *against(number), SEARCH_WIDTH, Candidates(motions[number], scores[number]))

    spread(work, range(len(models)))
    return scores, motions


def choose_pairs(pairs: Int32Array, counts: FloatArray) -> IntArray:
    """Rows of the pairs to use: those that fit least often by chance, up to BUDGET hypotheses for a model.

    A feature is in at most EACH of them, so that many of the features, and with them every object, have their turn.

    Parameters
    ----------
    pairs : (p, 2) int32
    counts : (p,) float64
        Mean number of hypotheses of each pair in a model.

    Returns
    -------
    (c,) int64

    Examples
    --------
    >>> choose_pairs(np.array([[0, 1], [0, 2], [1, 2]], np.int32), np.array([30.0, 10.0, 0.0])).tolist()
    [1, 0]

    """
    used: dict[int, int] = {}
    chosen: list[int] = []
    spent = 0.0
    for row in np.argsort(counts, kind='stable'):
        a, b = int(pairs[row, 0]), int(pairs[row, 1])
        if counts[row] <= 0.0 or max(used.get(a, 0), used.get(b, 0)) >= EACH:
            continue
        if spent + counts[row] > BUDGET and len(chosen) >= LEAST_PAIRS:
            break
        spent += counts[row]
        used[a], used[b] = used.get(a, 0) + 1, used.get(b, 0) + 1
        chosen.append(int(row))
    return np.array(chosen, np.int64)


def shared_pairs(rows: FloatArray, reach: float) -> tuple[Int32Array, Int32Array]:
    """Pairs in which every feature occurs with its best partners.

    Parameters
    ----------
    rows : (n, 9) float64
        The data's features, see geometry/features.py.
    reach : float
        Metres, a usual size of a model.

    Returns
    -------
    pairs : (p, 2) int32
    neighbours : (p, m) int32
        Data features near each pair, -1 at the end.

    """
    n = len(rows)
    count = min(n, 4 * NEAR + 1)
    _, around = cKDTree(rows[:, :3]).query(rows[:, :3], k=count)
    candidates = around.astype(np.int32) if n > 200 else np.zeros((0, 0), np.int32)
    ranked, _ = rank_pairs(rows, candidates, reach, min(NEAR // 2, n - 1))
    partners: list[list[int]] = [[] for _ in range(n)]
    for a, b in ranked.tolist():
        partners[a].append(b)
        partners[b].append(a)
    chosen = {(min(a, b), max(a, b)) for a in range(n) for b in partners[a][:PARTNERS]}
    pairs = np.array(sorted(chosen), np.int32).reshape(-1, 2)
    near = np.full((len(pairs), NEAR + 2), -1, np.int32)
    for row, (a, b) in zip(near, pairs.tolist()):
        members = list(
            dict.fromkeys([a, b, *(k for pair in zip_longest(partners[a], partners[b]) for k in pair if k is not None)])
        )[: NEAR + 2]
        row[: len(members)] = members
    return pairs, near
