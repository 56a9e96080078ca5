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
from ..geometry.pair_bounds import (
    ANGLE,
    MIDS,
    OFFSET,
    RELATION,
    SINE,
    margins_of,
    model_relations,
    offset_slack,
    pair_fits,
    relation,
)
from ..geometry.settings import EXACTLY_PARALLEL_SINE, RIGHT_ANGLE, ROUNDING
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
    offsets : (e, e)
        Metres, distances of crossing lines; NaN of parallel ones.
    span
        Metres, the farthest apart that points of two model features are.
    by_angle : (e, e) int64
        Model features in the order of their angle with each one, in bins.
    below : (e, ANGLES + 1)
        How many of them have an angle below k / ANGLES of pi/2 with it.
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
    offsets: FloatArray
    span: float
    by_angle: IntArray
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
    halves, angles = sample.model[:, 6].copy(), np.ascontiguousarray(relations[:, :, ANGLE])
    by_angle, below = _by_angle(angles)
    span = float((relations[:, :, MIDS] + halves[:, None] + halves).max(initial=0.0))
    return PairTest(
        sample,
        margins_of(sample.data, sample.tolerances),
        halves,
        relations,
        np.ascontiguousarray(relations[:, :, MIDS]),
        angles,
        np.where(relations[:, :, SINE] < EXACTLY_PARALLEL_SINE, np.nan, np.abs(relations[:, :, OFFSET])),
        span,
        by_angle,
        below,
        ranges_of_pairs(e, e),
        np.zeros((e, e), bool),
        np.array([[True, True, True, True, False], [True] * 5]),
    )


def no_ranges(n: int) -> DataRanges:
    """Ranges of a data feature with n others, none of them known."""
    return DataRanges(ranges_of_pairs(n), np.zeros(n, bool))


@njit
def _by_angle(angles: FloatArray) -> tuple[IntArray, IntArray]:
    """PairTest's by_angle and below, of the angles (e, e); a model feature with itself has angle 0."""
    e = len(angles)
    order, below, bins = np.empty((e, e), np.int64), np.zeros((e, ANGLES + 1), np.int64), np.empty(e, np.int64)
    for i in range(e):
        for j in range(e):
            bins[j] = 0 if i == j else min(int(angles[i, j] / RIGHT_ANGLE * ANGLES), ANGLES - 1)
            below[i, bins[j] + 1] += 1
        for k in range(ANGLES):
            below[i, k + 1] += below[i, k]
        place = below[i].copy()
        for j in range(e):
            order[i, place[bins[j]]] = j
            place[bins[j]] += 1
    return order, below


@njit
def _angle_bins(angle: float, cone: float) -> tuple[int, int]:
    """The first bin of angles that the angle of a data pair, known to a cone, may be in on the model, and the last.

    An angle that would be beyond a right one comes back from there by less than the cone reaches down.
    """
    first = min(max(int((angle - cone - ROUNDING) / RIGHT_ANGLE * ANGLES), 0), ANGLES - 1)
    return first, min(int((angle + cone + ROUNDING) / RIGHT_ANGLE * ANGLES), ANGLES - 1)


@njit
def revise(a: int, others: IntArray, test: PairTest, left: BoolArray, supporters: int) -> None:
    """Remove the nodes of data feature a that are consistent with too few of the data features ``others``.

    A node stays when at least ``supporters`` of them have a node that is consistent with it. left : (n, e), the model
    features that each data feature may be on; in place.
    """
    data, margins, halves, mids, offsets = test.sample.data, test.margins, test.halves, test.mids, test.offsets
    m = 0
    rels = np.empty((len(others), RELATION))
    rooms, slacks = np.empty(len(others)), np.empty(len(others))
    near, bins = np.empty(len(others), np.int64), np.empty((len(others), 2), np.int64)
    reach = test.span - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
    for b in others:
        relation(data[a], data[b], rels[m])
        rooms[m] = margins[b, 2] + margins[b, 3] - margins[b, 1]
        if rels[m, MIDS] <= reach + rooms[m]:
            near[m], bins[m] = b, _angle_bins(rels[m, ANGLE], margins[a, 4] + margins[b, 4])
            slacks[m] = offset_slack(rels[m], margins, a, b)
            m += 1
    for i in range(len(halves)):
        if not left[a, i]:
            continue
        room_a = halves[i] - margins[a, 1] + margins[a, 2] + margins[a, 3] + ROUNDING
        needed, spare, k = supporters, m - supporters, 0
        while needed > 0 and spare >= 0:
            b, mid, room, offset = near[k], rels[k, MIDS], room_a + rooms[k], abs(rels[k, OFFSET])
            agrees = False
            for at in range(test.below[i, bins[k, 0]], test.below[i, bins[k, 1] + 1]):
                j = test.by_angle[i, at]
                if (
                    left[b, j]
                    and abs(mid - mids[i, j]) <= room + halves[j]
                    and not abs(offset - offsets[i, j]) > slacks[k]
                    and pair_fits(rels, k, margins, a, b, halves, test.relations, i, j)
                ):
                    agrees = True
                    break
            needed -= agrees
            spare -= not agrees
            k += 1
        left[a, i] = spare >= 0


@njit
def revise_each(some: IntArray, test: PairTest, left: BoolArray, supporters: int, seen: IntArray) -> None:
    """Revise the nodes of data features ``some`` against all others, those with the fewest nodes first.

    left : (n, e), see :func:`revise`; seen : (n,) how many nodes there were when a feature was revised last; where
    nothing has been removed since, its own stay as they are. In place.
    """
    counts = np.zeros(len(left), np.int64)
    for a in range(len(left)):
        counts[a] = left[a].sum()
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
        revise(a, others[:m], test, left, supporters)
        counts[a] = left[a].sum()
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
    count = at = 0
    while at < len(free) and spare >= 0:
        b = nodes.a[free[at]]
        relation(data[a], data[b], rel[0])
        before = count
        while at < len(free) and nodes.a[free[at]] == b:
            j = nodes.i[free[at]]
            fits = pair_fits(rel, 0, margins, a, b, test.halves, test.relations, i, j)
            if fits and _constraints_agree(a, b, i, j, test, own):
                left[count] = free[at]
                count += 1
            at += 1
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
