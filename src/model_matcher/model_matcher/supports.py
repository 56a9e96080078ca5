"""What can be part of a large interpretation at all: pairings with too few supporters are taken away (thesis 7.4).

A node is a pairing of a data with a model feature. In an interpretation of K data features every node agrees with
K - 1 others, each of another data feature. Nothing is tabulated: a node is tested against one data feature after the
other, those with the fewest nodes first, until too many have failed it; what is refused no longer supports anything.
"""

from __future__ import annotations

import numpy as np

from msgs_py.compiled import njit

from .constraints import consistent_signs, entry, pair_ranges
from .pair_test import MIDS, RELATION, ROUNDING, pair_fits, relation


@njit
def thin(a, others, data, margins, lists, counts, halves, model_rel, mids, supporters, wide):
    """Take from data feature a's list the nodes that fewer than ``supporters`` of the data features ``others`` support.

    wide : of a longer list only one node is looked for that stays: such a feature fits almost anywhere

    lists : (n, e) int, the model features that a data feature may be on, the first counts (n,) of a row; in place
    margins, halves, model_rel : as pair_test.pair_fits wants them; mids : (e, e) metres, model_rel[:, :, MIDS]
    """
    m = len(others)
    rels = np.empty((m, RELATION))
    rooms = np.empty(m)
    for k in range(m):
        b = others[k]
        relation(data[a], data[b], rels[k])
        rooms[k] = margins[b, 2] + margins[b, 3] - margins[b, 1]
    left = 0
    for at in range(counts[a]):
        i = lists[a, at]
        room_a = halves[i] - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
        spare = m - supporters
        for k in range(m):
            b = others[k]
            mid, room = rels[k, MIDS], room_a + rooms[k]
            agrees = False
            for other in range(counts[b]):
                j = lists[b, other]
                if (i == j or abs(mid - mids[i, j]) <= room + halves[j]) and \
                        pair_fits(rels, k, margins, a, b, halves, model_rel, i, j):
                    agrees = True
                    break
            if not agrees:
                spare -= 1
                if spare < 0:
                    break
        if spare >= 0:
            if counts[a] > wide:
                return
            lists[a, left] = i
            left += 1
    counts[a] = left


@njit
def agree(a, i, others_a, others_i, data, tols, model, margins, halves, model_rel):
    """Whether node (a, i) is consistent with every one of some nodes: by the exact test and the five constraints."""
    rel, mine, ranges = np.empty((1, RELATION)), np.zeros(11), np.zeros(11)
    use = np.ones(5, np.bool_)
    for k in range(len(others_a)):
        b, j = others_a[k], others_i[k]
        relation(data[a], data[b], rel[0])
        if not pair_fits(rel, 0, margins, a, b, halves, model_rel, i, j):
            return False
        error_a, error_b = np.hypot(tols[a, 0], tols[a, 1]), np.hypot(tols[b, 0], tols[b, 1])
        pair_ranges(data[a], data[b], error_a, error_b, tols[a, 2], tols[b, 2], mine)
        if i != j:
            pair_ranges(model[i], model[j], 0.0, 0.0, 0.0, 0.0, ranges)
        bits = entry(mine, ranges, i == j, 2.0 * model[i, 6], error_a + error_b, use)
        if bits == 0 or not consistent_signs(bits):
            return False
    return True


def listed(possible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lists (n, e) int64 of the true columns of each row of possible (n, e), and how many they are, (n,) int64."""
    return np.argsort(~possible, axis=1, kind='stable'), possible.sum(axis=1)
