"""How many hypotheses there are: pairs of model features that the data's pairs may lie on, each of which fixes a pose.

Chance has so many tries. The number says what the data is like, better than how much of it there is: edges of regular
objects fit a model's pairs by the thousand, as many loose ones by the dozen. It is read off a sample of the pairs, and
does not depend on how far a search went. Rows, tolerances and motions as in features.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, IntArray

from .features import CURVE, DataFeatures, ModelFeatures, PairTable
from .pair_pose import matching_pairs, pair_window
from .parallel_pairs import ParallelPairs, lever, matching_parallel, offsets
from .settings import COUNTED_PAIRS, PARALLEL_SINE, TRIED_PAIRS


@njit(nogil=True)
def count_hypotheses(
    model: ModelFeatures, table: PairTable, parallel: ParallelPairs, may: BoolArray, data: DataFeatures, some: IntArray
) -> float:
    """How many pairs of model features the pairs of data features may lie on.

    Parameters
    ----------
    model : ModelFeatures
    table : PairTable
        Of the model.
    parallel : ParallelPairs
        Of the model. Parallel edges alone are left out: they fix a pose only where both are seen whole.
    may : (n, e) bool
        Which model features a data feature may be on by itself.
    data : DataFeatures
    some : (k,) int
        The data features that count.

    Returns
    -------
    float
        Of all pairs, estimated from a sample of those that are near enough to be of one object.

    """
    rows, kind = data.rows, data.kind
    n = len(some)
    found = np.empty(2 * max(table.members.shape[0], parallel.members.shape[0]), np.int32)
    place, tried, counted, hits = 0.5, 0, 0, 0
    every = n * (n - 1) / 2.0
    # Steps of the golden section of a circle leave no large gap, wherever they end (Weyl's sequence).
    step = 0.5 * (np.sqrt(5.0) - 1.0)
    while tried < min(every, TRIED_PAIRS) and counted < COUNTED_PAIRS:
        tried += 1
        place = (place + step) % 1.0
        # The number of a pair among all: b (b - 1) / 2 + a, a < b.
        number = int(place * every)
        b = int(0.5 + np.sqrt(0.25 + 2.0 * number))
        a = number - b * (b - 1) // 2
        if a < 0 or a >= b or b >= n:
            continue
        a, b = some[a], some[b]
        apart, along, sine = offsets(rows[a], rows[b])
        reach = model.size + lever(rows[a], kind[a] == CURVE) + lever(rows[b], kind[b] == CURVE)
        if apart * apart + along * along > reach * reach:
            continue
        counted += 1
        if sine >= PARALLEL_SINE:
            hits += matching_pairs(data, model, table, a, b, pair_window(data, a, b), found)
        elif kind[a] + kind[b] > 0:
            hits += matching_parallel(data, model, parallel, a, b, may, found)
    return hits * every / max(tried, 1)
