"""The compiled inner loop of the prefilter: all pairs of a scene against one model.

As pair_search.search_pairs, but with few pairs, the same for all models. Rows, tolerances and motions as in
geometry/features.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import Int32Array, IntArray

from ..geometry.back_projection import count_matches
from ..geometry.features import DataFeatures, ModelFeatures, PairTable
from ..geometry.pair_pose import fits_a_third, into_frame, matching_pairs, pair_frame, pair_pose, pair_window, room_for
from .pair_search import Candidates, keep_candidate
from .settings import NEEDED


@njit(nogil=True)
def count_hypotheses(
    pairs: Int32Array, model: ModelFeatures, table: PairTable, data: DataFeatures, counts: IntArray
) -> None:
    """How many hypotheses each data pair makes for a model.

    Parameters
    ----------
    pairs : (p, 2) int32
    model : ModelFeatures
    table : PairTable
        Of the model.
    data : DataFeatures
    counts : (p,) int64
        The numbers are added to it.

    """
    found = np.empty(2 * table.members.shape[0], np.int32)
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        counts[p] += matching_pairs(data, model, table, a, b, pair_window(data, a, b), found)


@njit(nogil=True)
def best_poses(
    pairs: Int32Array,
    neighbours: Int32Array,
    model: ModelFeatures,
    table: PairTable,
    data: DataFeatures,
    widen: float,
    candidates: Candidates,
) -> None:
    """The best of the poses that the data pairs make for a model.

    Parameters
    ----------
    pairs : (p, 2) int32
    neighbours : (p, m) int32
        Data features near each pair, -1 at the end; a pose must explain one of them besides the pair itself.
    model : ModelFeatures
    table : PairTable
        Of the model.
    data : DataFeatures
    widen : float
        Tolerances count this many times.
    candidates : Candidates
        Changed in place.

    """
    scores, values = candidates.scores, table.values
    stamp = np.zeros(model.rows.shape[0], np.int64)
    data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
    m = neighbours.shape[1]
    near = room_for(m)
    found = np.empty(2 * table.members.shape[0], np.int32)
    tried = 0
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        window = pair_window(data, a, b)
        hypotheses = matching_pairs(data, model, table, a, b, window, found)
        if hypotheses == 0:
            continue
        pair_frame(data.rows, a, window.foot_a, b, window.flip, window.foot_b, data_pair)
        count = into_frame(a, b, data_pair, data, neighbours[p], widen, model.voxels.per_metre, near)
        placed = -1
        for hypothesis in range(hypotheses):
            at, turn = found[hypothesis] // 2, 1.0 - 2.0 * (found[hypothesis] % 2)
            i, j = table.members[at, 0], table.members[at, 1]
            if placed != at:
                pair_frame(model.rows, i, values[at, 2], j, values[at, 4], values[at, 3], model_pair)
                placed = at
            tried += 1
            if not fits_a_third(model_pair, turn, i, j, count, near, model, data):
                continue
            pair_pose(data_pair, model_pair, turn, motion)
            needed = max(scores[len(scores) - 1], NEEDED)
            score = count_matches(motion, model, data, widen, stamp, tried, needed)
            if score >= NEEDED:
                keep_candidate(motion, score, model, candidates)
