"""Arc consistency: which pairings can be part of a large interpretation at all (thesis 7.4).

A node is a pairing of a data with a model feature. In an interpretation of K data features every node is consistent
with K - 1 others, each of another data feature. Consistency is tested by the exact pair test, and nothing is tabulated:
a node is tested against one data feature after the other, those with the fewest nodes first, until too many have no
consistent node; a node that is removed supports no other from then on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..geometry.constraints import consistent_signs, entry, pair_ranges, ranges_of_pairs
from ..geometry.pair_bounds import ANGLE, MIDS, RELATION, margins_of, model_relations, pair_fits, relation
from ..geometry.settings import RIGHT_ANGLE, ROUNDING
from .feasibility import Sample
from .settings import ANGLES
from .spares import Groups, left_out, spare_features

# Column of pair_ranges: whether direction3 is defined.
NORMAL = 10


class PairTest(NamedTuple):
    """What the tests of pairs of nodes need.

    Attributes
    ----------
    sample : Sample
        The data and the model.
    margins : (n, 8)
        Of geometry.pair_bounds.margins_of.
    halves : (e,)
        Metres, half lengths of the model features.
    relations : (e, e, 10)
        Of model_relations.
    mids, angles : (e, e)
        Two columns of the relations: metres, radians.
    span
        Metres, the farthest apart that points of two model features are.
    below : (ANGLES + 1,)
        How many pairs of model features, both orders, have an angle below k / ANGLES of pi/2.
    model_ranges : (e, e, 11)
        Of pair_ranges, filled where model_known is set.
    model_known : (e, e) bool
    use : (2, 5) bool
        The constraints that are tested: all but direction3 where model lines have no common normal, otherwise all.
    """

    sample: Sample
    margins: FloatArray
    halves: FloatArray
    relations: FloatArray
    mids: FloatArray
    angles: FloatArray
    span: float
    below: IntArray
    model_ranges: FloatArray
    model_known: BoolArray
    use: BoolArray


class Nodes(NamedTuple):
    """The pairings that are left.

    Attributes
    ----------
    a, i : (m,) int64
        Data feature and model feature of each node.
    """

    a: IntArray
    i: IntArray


class DataRanges(NamedTuple):
    """Ranges of one data feature with each other one.

    Attributes
    ----------
    ranges : (n, 11)
        As of pair_ranges, filled where known is set.
    known : (n,) bool
    """

    ranges: FloatArray
    known: BoolArray


def pair_test(sample: Sample) -> PairTest:
    """The tests of pairs of nodes for the data and the model of a sample."""
    e = len(sample.model)
    relations = model_relations(sample.model)
    halves = sample.model[:, 6].copy()
    span, below = _extent(halves, relations)
    return PairTest(
        sample,
        margins_of(sample.data, sample.tolerances),
        halves,
        relations,
        np.ascontiguousarray(relations[:, :, MIDS]),
        np.ascontiguousarray(relations[:, :, ANGLE]),
        span,
        below,
        ranges_of_pairs(e, e),
        np.zeros((e, e), bool),
        np.array([[True, True, True, True, False], [True] * 5]),
    )


def no_ranges(n: int) -> DataRanges:
    """Ranges of a data feature with n others, none of them known."""
    return DataRanges(ranges_of_pairs(n), np.zeros(n, bool))


def listed(possible: BoolArray) -> tuple[IntArray, IntArray]:
    """Lists (n, e) int64 of the true columns of each row of possible (n, e), and how many they are, (n,) int64.

    Examples
    --------
    >>> lists, counts = listed(np.array([[False, True, True], [True, False, False]]))
    >>> lists[0, :2].tolist(), counts.tolist()
    ([1, 2], [2, 1])
    """
    return np.argsort(~possible, axis=1, kind='stable'), possible.sum(axis=1)


@njit
def _extent(halves: FloatArray, relations: FloatArray) -> tuple[float, IntArray]:
    """PairTest's span and below; a model feature with itself has angle 0."""
    span = 0.0
    below = np.zeros(ANGLES + 1, np.int64)
    for i in range(len(halves)):
        for j in range(len(halves)):
            span = max(span, relations[i, j, MIDS] + halves[i] + halves[j])
            angle = relations[i, j, ANGLE] if i != j else 0.0
            below[min(int(angle / RIGHT_ANGLE * ANGLES), ANGLES - 1) + 1] += 1
    for k in range(ANGLES):
        below[k + 1] += below[k]
    return span, below


@njit
def _some_pair_may_fit(rel: FloatArray, cone: float, room: float, span: float, below: IntArray) -> bool:
    """Whether any two model features are near enough to each other and at the angle for a data pair's relation."""
    low = rel[ANGLE] - cone
    high = min(rel[ANGLE] + cone, RIGHT_ANGLE)
    if rel[ANGLE] + cone > RIGHT_ANGLE:
        low = min(low, np.pi - rel[ANGLE] - cone)
    first = min(max(int((low - ROUNDING) / RIGHT_ANGLE * ANGLES), 0), ANGLES - 1)
    last = min(int((high + ROUNDING) / RIGHT_ANGLE * ANGLES), ANGLES - 1)
    may_fit: bool = rel[MIDS] <= span + room + ROUNDING and below[last + 1] > below[first]
    return may_fit


@njit
def revise(a: int, others: IntArray, test: PairTest, lists: IntArray, counts: IntArray, supporters: int) -> None:
    """Remove from data feature a's list the nodes that are consistent with too few of the data features ``others``.

    A node stays when at least ``supporters`` of them have a node that is consistent with it. lists : (n, e) int64, the
    model features that a data feature may be on, the first counts (n,) of a row; both in place.
    """
    data, margins, halves, mids = test.sample.data, test.margins, test.halves, test.mids
    m = 0
    rels = np.empty((len(others), RELATION))
    rooms = np.empty(len(others))
    near = np.empty(len(others), np.int64)
    for b in others:
        relation(data[a], data[b], rels[m])
        room = margins[b, 2] + margins[b, 3] - margins[b, 1]
        cone = margins[a, 4] + margins[b, 4]
        if _some_pair_may_fit(
            rels[m], cone, room - margins[a, 1] + margins[a, 2] + margins[a, 3], test.span, test.below
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
                    rels, k, margins, a, b, halves, test.relations, i, j
                ):
                    agrees = True
                    break
            if not agrees:
                spare -= 1
                if spare < 0:
                    break
        if spare >= 0:
            lists[a, left] = i
            left += 1
    counts[a] = left


@njit
def revise_each(
    some: IntArray, test: PairTest, lists: IntArray, counts: IntArray, supporters: int, seen: IntArray
) -> None:
    """Revise the lists of data features ``some`` against all others, those with the shortest lists first.

    seen : (n,) how many nodes there were when a feature was revised last; where nothing has been removed since, its
    list stays as it is. In place.
    """
    nodes = counts.sum()
    for a in some:
        if counts[a] == 0 or seen[a] == nodes:
            continue
        order = np.argsort(counts, kind='mergesort')
        others = np.empty(len(order), np.int64)
        m = 0
        for b in order:
            if counts[b] > 0 and b != a:
                others[m] = b
                m += 1
        nodes -= counts[a]
        revise(a, others[:m], test, lists, counts, supporters)
        nodes += counts[a]
        seen[a] = nodes


@njit
def forward_check(
    node: int,
    free: IntArray,
    forced: IntArray,
    least: int,
    nodes: Nodes,
    groups: Groups,
    test: PairTest,
    own: DataRanges,
) -> IntArray:
    """Those of the nodes ``free`` that a node is consistent with, by the exact test and the five constraints.

    None at all when interpretations have fewer than ``least`` of their data features; of each group, one feature at
    least is left out. free : (m,) numbers of nodes, those of one data feature together, none of the node's own; forced
    : (f,) nodes that are taken already; own : DataRanges of the node's data feature
    """
    a, i = nodes.a[node], nodes.i[node]
    data, margins = test.sample.data, test.margins
    left = np.empty(len(free), np.int64)
    rel = np.empty((1, RELATION))
    missing = np.empty(len(groups.sizes), np.int64)
    spare = spare_features(np.append(nodes.a[forced], a), nodes.a[free], least, groups, missing)
    room_a = test.halves[i] - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
    count = at = 0
    while at < len(free) and spare >= 0:
        b = nodes.a[free[at]]
        relation(data[a], data[b], rel[0])
        mid, room = rel[0, MIDS], room_a + margins[b, 2] + margins[b, 3] - margins[b, 1]
        low = rel[0, ANGLE] - margins[a, 4] - margins[b, 4] - ROUNDING
        high = rel[0, ANGLE] + margins[a, 4] + margins[b, 4] + ROUNDING
        if high > RIGHT_ANGLE:
            low, high = min(low, np.pi - high), RIGHT_ANGLE
        before = count
        while at < len(free) and nodes.a[free[at]] == b:
            other = free[at]
            at += 1
            j = nodes.i[other]
            if i != j and (abs(mid - test.mids[i, j]) > room + test.halves[j] or not low <= test.angles[i, j] <= high):
                continue
            if not pair_fits(rel, 0, margins, a, b, test.halves, test.relations, i, j):
                continue
            if _constraints_agree(a, b, i, j, test, own):
                left[count] = other
                count += 1
        if count == before:
            spare -= left_out(b, groups, missing)
    return left[:count] if spare >= 0 else left[:0]


@njit
def _constraints_agree(a: int, b: int, i: int, j: int, test: PairTest, own: DataRanges) -> bool:
    """Whether the five constraints let data features a and b be on model features i and j; fills ranges as needed."""
    data, tols, model = test.sample.data, test.sample.tolerances, test.sample.model
    error_a = np.hypot(tols[a, 0], tols[a, 1]) + ROUNDING
    error_b = np.hypot(tols[b, 0], tols[b, 1]) + ROUNDING
    cone_a, cone_b = tols[a, 2] + ROUNDING, tols[b, 2] + ROUNDING
    if not own.known[b]:
        own.known[b] = True
        pair_ranges(data[a], data[b], error_a, error_b, cone_a, cone_b, own.ranges[b])
    if not test.model_known[i, j]:
        test.model_known[i, j] = True
        test.model_ranges[i, j] = 0.0
        if i != j:
            pair_ranges(model[i], model[j], 0.0, 0.0, 0.0, 0.0, test.model_ranges[i, j])
    use = test.use[1 if test.model_ranges[i, j, NORMAL] > 0.0 else 0]
    bits = entry(own.ranges[b], test.model_ranges[i, j], i == j, 2.0 * model[i, 6], error_a + error_b, use)
    agree: bool = bits != 0 and consistent_signs(bits)
    return agree
