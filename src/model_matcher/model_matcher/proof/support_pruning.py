"""What can be part of a large interpretation at all: pairings with too few supporters are taken away (thesis 7.4).

A node is a pairing of a data with a model feature. In an interpretation of K data features every node agrees with
K - 1 others, each of another data feature. Nothing is tabulated: a node is tested against one data feature after the
other, those with the fewest nodes first, until too many have failed it; what is refused no longer supports anything.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.constraints import consistent_signs, entry, pair_ranges
from ..geometry.pair_bounds import ANGLE, MIDS, RELATION, ROUNDING, pair_fits, relation

ANGLES = 180  # bins of pi/2


@njit
def extremes(halves, model_rel):
    """What any two model features have: the farthest apart that points of them are (metres), and how many pairs, both
    orders, have an angle below k / ANGLES of pi/2 (ANGLES + 1,); a feature with itself has angle 0."""
    span = 0.0
    below = np.zeros(ANGLES + 1, np.int64)
    for i in range(len(halves)):
        for j in range(len(halves)):
            span = max(span, model_rel[i, j, MIDS] + halves[i] + halves[j])
            angle = model_rel[i, j, ANGLE] if i != j else 0.0
            below[min(int(angle / (0.5 * np.pi) * ANGLES), ANGLES - 1) + 1] += 1
    for k in range(ANGLES):
        below[k + 1] += below[k]
    return span, below


@njit
def _conceivable(rel, cone, room, span, below):
    """Whether any two model features are near enough to each other and at the angle for a data pair's relation."""
    low = rel[ANGLE] - cone
    high = min(rel[ANGLE] + cone, 0.5 * np.pi)
    if rel[ANGLE] + cone > 0.5 * np.pi:
        low = min(low, np.pi - rel[ANGLE] - cone)
    first = min(max(int((low - ROUNDING) / (0.5 * np.pi) * ANGLES), 0), ANGLES - 1)
    last = min(int((high + ROUNDING) / (0.5 * np.pi) * ANGLES), ANGLES - 1)
    return rel[MIDS] <= span + room + ROUNDING and below[last + 1] > below[first]


@njit
def thin(a, others, data, margins, lists, counts, halves, model_rel, mids, span, below, supporters, wide):
    """Take from data feature a's list the nodes that fewer than ``supporters`` of the data features ``others`` support.

    wide : of a longer list only one node is looked for that stays: such a feature fits almost anywhere

    lists : (n, e) int, the model features that a data feature may be on, the first counts (n,) of a row; in place
    margins, halves, model_rel : as pair_test.pair_fits wants them; mids : (e, e) metres, model_rel[:, :, MIDS];
    span, below : as extremes gives them
    """
    m = 0
    rels = np.empty((len(others), RELATION))
    rooms = np.empty(len(others))
    near = np.empty(len(others), np.int64)
    for b in others:
        relation(data[a], data[b], rels[m])
        room = margins[b, 2] + margins[b, 3] - margins[b, 1]
        if _conceivable(
            rels[m], margins[a, 4] + margins[b, 4], room - margins[a, 1] + margins[a, 2] + margins[a, 3], span, below
        ):
            near[m], rooms[m] = b, room
            m += 1
    if m < supporters:
        counts[a] = 0
        return
    left = 0
    for at in range(counts[a]):
        i = lists[a, at]
        room_a = halves[i] - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
        spare = m - supporters
        for k in range(m):
            b = near[k]
            mid, room = rels[k, MIDS], room_a + rooms[k]
            agrees = False
            for other in range(counts[b]):
                j = lists[b, other]
                if (i == j or abs(mid - mids[i, j]) <= room + halves[j]) and pair_fits(
                    rels, k, margins, a, b, halves, model_rel, i, j
                ):
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
def narrowed(
    a,
    i,
    free,
    nodes_a,
    nodes_i,
    least,
    forced,
    group_of,
    sizes,
    data,
    tols,
    model,
    margins,
    halves,
    model_rel,
    mids,
    angles,
    model_ranges,
    model_known,
    ranges,
    known,
):
    """Those of the nodes ``free`` that node (a, i) is consistent with: by the exact test and the five constraints.

    None at all when interpretations have fewer than ``least`` of their data features: of a refuted group, one at least
    is left out. free : (m,) numbers of nodes, those of one data feature together, none of a's; group_of : (n,) the
    refuted group that a data feature is in, or -1; sizes : of those groups; forced : (f,) nodes that are taken already

    ranges : (n, 11) of a's pairs, model_ranges : (e, e, 11) of the model's, both filled in here where known (n,),
    model_known (e, e) are not set
    """
    left = np.empty(len(free), np.int64)
    rel, use = np.empty((1, RELATION)), np.ones(5, np.bool_)
    spare = -least
    whole = sizes.copy()
    if group_of[a] >= 0:
        whole[group_of[a]] -= 1
    for k in range(len(forced)):
        if group_of[nodes_a[forced[k]]] >= 0:
            whole[group_of[nodes_a[forced[k]]]] -= 1
    for k in range(len(free)):
        b = nodes_a[free[k]]
        if k == 0 or b != nodes_a[free[k - 1]]:
            spare += 1
            if group_of[b] >= 0:
                whole[group_of[b]] -= 1
    for g in range(len(whole)):
        spare -= whole[g] == 0
    error_a = np.hypot(tols[a, 0], tols[a, 1])
    room_a = halves[i] - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
    count = at = 0
    while at < len(free) and spare >= 0:
        b = nodes_a[free[at]]
        error_b = np.hypot(tols[b, 0], tols[b, 1])
        relation(data[a], data[b], rel[0])
        mid, room = rel[0, MIDS], room_a + margins[b, 2] + margins[b, 3] - margins[b, 1]
        low = rel[0, ANGLE] - margins[a, 4] - margins[b, 4] - ROUNDING
        high = rel[0, ANGLE] + margins[a, 4] + margins[b, 4] + ROUNDING
        if high > 0.5 * np.pi:
            low, high = min(low, np.pi - high), 0.5 * np.pi
        before = count
        while at < len(free) and nodes_a[free[at]] == b:
            node = free[at]
            at += 1
            j = nodes_i[node]
            if i != j and (abs(mid - mids[i, j]) > room + halves[j] or not low <= angles[i, j] <= high):
                continue
            if not pair_fits(rel, 0, margins, a, b, halves, model_rel, i, j):
                continue
            if not known[b]:
                known[b] = True
                pair_ranges(data[a], data[b], error_a, error_b, tols[a, 2], tols[b, 2], ranges[b])
            if not model_known[i, j]:
                model_known[i, j] = True
                model_ranges[i, j] = 0.0
                if i != j:
                    pair_ranges(model[i], model[j], 0.0, 0.0, 0.0, 0.0, model_ranges[i, j])
            bits = entry(ranges[b], model_ranges[i, j], i == j, 2.0 * model[i, 6], error_a + error_b, use)
            if bits != 0 and consistent_signs(bits):
                left[count] = node
                count += 1
        if count == before:
            g = group_of[b]
            if g >= 0 and whole[g] == 0:
                whole[g] = 1
            else:
                spare -= 1
    return left[:count] if spare >= 0 else left[:0]


def agreement(
    data: np.ndarray, tols: np.ndarray, model: np.ndarray, margins: np.ndarray, model_rel: np.ndarray
) -> tuple[np.ndarray, ...]:
    """What :func:`narrowed` takes of data and model, from data to model_known."""
    e = len(model)
    return (
        data,
        tols,
        model,
        margins,
        model[:, 6].copy(),
        model_rel,
        np.ascontiguousarray(model_rel[:, :, MIDS]),
        np.ascontiguousarray(model_rel[:, :, ANGLE]),
        np.empty((e, e, 11)),
        np.zeros((e, e), bool),
    )


def listed(possible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lists (n, e) int64 of the true columns of each row of possible (n, e), and how many they are, (n,) int64."""
    return np.argsort(~possible, axis=1, kind='stable'), possible.sum(axis=1)
