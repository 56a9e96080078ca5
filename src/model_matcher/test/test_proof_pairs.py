"""Arc consistency and forward checking beside their definitions, by counting over all pairs of pairings."""

from functools import cache

import numpy as np
import pytest

from model_matcher.closed_form.synthetic.strained import strained_scene
from model_matcher.geometry.constraints import consistent_signs, entry, pair_ranges
from model_matcher.geometry.pair_bounds import RELATION, margins_of, model_relations, pair_fits, possible, relation
from model_matcher.geometry.settings import ROUNDING
from model_matcher.model.problem import make_problem
from model_matcher.proof.arc_consistency import Nodes, forward_check, no_ranges, pair_test, revise, revise_each
from model_matcher.proof.branch_and_bound import BranchAndBound, sample_of
from model_matcher.proof.spares import Groups
from msgs_py.numeric.deadline import Deadline


class Small:
    """A strained scene of few features, with everything that its pairs say, found the long way."""

    def __init__(self, seed):
        scene = strained_scene(seed, ('l_shape', 'wedge', 'cylinder_box'), most=6)
        self.problem = make_problem(scene.index, scene.data, scene.params)
        self.sample = sample = sample_of(self.problem)
        self.n, self.e = len(sample.data), len(sample.model)
        index = self.problem.index
        self.alone = possible(*sample, index.kind, self.problem.radius_tol)
        self.nodes = Nodes(*np.nonzero(self.alone))
        margins, halves = margins_of(sample.data, sample.tolerances), sample.model[:, 6].copy()
        of_model, rel = model_relations(sample.model), np.empty((1, RELATION))
        # By the exact test, of pairings in the order of the nodes.
        self.fits = np.zeros((len(self.nodes.a), len(self.nodes.a)), bool)
        for p, (a, i) in enumerate(zip(*self.nodes)):
            for q, (b, j) in enumerate(zip(*self.nodes)):
                if a != b:
                    relation(sample.data[a], sample.data[b], rel[0])
                    self.fits[p, q] = pair_fits(rel, 0, margins, a, b, halves, of_model, i, j)

    def agree(self, a, i, b, j):
        """The five constraints; without a normal of the model's lines, but for the one that needs it."""
        sample = self.sample
        errors = np.hypot(sample.tolerances[[a, b], 0], sample.tolerances[[a, b], 1]) + ROUNDING
        cones = sample.tolerances[[a, b], 2] + ROUNDING
        data, model = np.empty(11), np.zeros(11)
        pair_ranges(sample.data[a], sample.data[b], *errors, *cones, data)
        if i != j:
            pair_ranges(sample.model[i], sample.model[j], 0.0, 0.0, 0.0, 0.0, model)
        use = np.ones(5, bool)
        use[4] = model[10] > 0.0
        code = entry(data, model, i == j, 2.0 * sample.model[i, 6], errors.sum(), use)
        return code != 0 and consistent_signs(code)

    def supporters(self, left):
        """(n, e) of how many other data features a pairing in ``left`` is not refused beside each."""
        counts, stays = np.zeros((self.n, self.e), int), left[self.nodes.a, self.nodes.i]
        for p, (a, i) in enumerate(zip(*self.nodes)):
            counts[a, i] = len(set(self.nodes.a[self.fits[p] & stays].tolist()))
        return counts


small_scene = cache(Small)
SEEDS = (3, 7, 27, 33)


@pytest.mark.parametrize('seed', SEEDS)
def test_a_pairing_stays_while_enough_others_are_not_refused_beside_it(seed):
    small = small_scene(seed)
    test = pair_test(small.sample)
    for a in range(small.n):
        counts = small.supporters(small.alone)[a]
        others = np.delete(np.arange(small.n), a)
        for least in {0, 1, int(counts.max()), int(counts.max()) + 1}:
            left = small.alone.copy()
            revise(a, others, test, left, least)
            np.testing.assert_array_equal(left[a], small.alone[a] & (counts >= least))
            np.testing.assert_array_equal(np.delete(left, a, axis=0), np.delete(small.alone, a, axis=0))


def consistent(small, least, left):
    """What is left when pairings with too few supporters have been removed until nothing changes."""
    left = left.copy()
    while True:
        gone = left & (small.supporters(left) < least)
        if not gone.any():
            return left
        left &= ~gone


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('most', [2, 3, 4])
def test_what_is_left_before_the_tree_is_what_arc_consistency_leaves(seed, most):
    small = small_scene(seed)
    expected = consistent(small, most, small.alone)
    tree = BranchAndBound(small.problem, most, Deadline(60.0))
    tree.prune()
    found = np.zeros_like(expected)
    found[tree.nodes.a, tree.nodes.i] = True
    # Where too few features are left for a larger interpretation, there is no need for any node.
    if expected.any(axis=1).sum() > most:
        np.testing.assert_array_equal(found, expected)
        counts = expected.sum(axis=1)
        assert (np.diff(counts[tree.nodes.a]) >= 0).all(), 'features of few nodes first'
    else:
        assert len(tree.nodes.a) == 0


def test_of_no_more_data_than_what_is_known_nothing_is_asked():
    small = small_scene(SEEDS[0])
    tree = BranchAndBound(small.problem, small.n, Deadline(60.0))
    tree.prune()
    assert len(tree.nodes.a) == 0 and not hasattr(tree, 'test')


@pytest.mark.parametrize('seed', SEEDS)
def test_features_are_revised_again_only_when_something_has_changed(seed):
    small = small_scene(seed)
    test, left, seen = pair_test(small.sample), small.alone.copy(), np.full(small.n, -1)
    every = np.arange(small.n)
    revise_each(every, test, left, 2, seen)
    by_hand = small.alone.copy()
    for a in every:
        if by_hand[a].any():
            by_hand[a] &= small.supporters(by_hand)[a] >= 2
    np.testing.assert_array_equal(left, by_hand)
    last = left.sum()
    assert seen[-1] == last or not small.alone[-1].any()
    # Those that were revised when as many were left as now are not looked at: pairings that none supports stay.
    again, seen = np.ones_like(left), np.full(small.n, small.n * small.e)
    revise_each(every, test, again, small.n, seen)
    assert again.all()


@pytest.mark.parametrize('seed', SEEDS)
def test_beside_a_pairing_stays_what_the_exact_test_and_the_constraints_allow(seed):
    small = small_scene(seed)
    nodes, test = small.nodes, pair_test(small.sample)
    none = Groups(np.full(small.n, -1), np.zeros(0, np.int64))
    nothing = np.zeros(0, np.int64)
    rng = np.random.default_rng(seed)
    for node in rng.permutation(len(nodes.a))[:12]:
        a, i = nodes.a[node], nodes.i[node]
        free = np.flatnonzero(nodes.a != a)
        expected = [int(k) for k in free if small.fits[node, k] and small.agree(a, i, nodes.a[k], nodes.i[k])]
        features = len(set(nodes.a[expected].tolist()))
        for least in (0, features, features + 1):
            own = no_ranges(small.n)
            found = forward_check(node, free, nothing, least, nodes, none, test, own).tolist()
            assert found == (expected if least <= features else [])
        whole = Groups(np.zeros(small.n, np.int64), np.array([small.n]))
        # Of a group of all features, one is left out: it takes one off, unless one has dropped out anyway.
        whole_is_left = features == small.n - 1
        found = forward_check(node, free, nothing, features, nodes, whole, test, no_ranges(small.n)).tolist()
        assert found == ([] if whole_is_left else expected)


def test_what_was_asked_once_is_kept():
    small = small_scene(SEEDS[0])
    nodes, test = small.nodes, pair_test(small.sample)
    none = Groups(np.full(small.n, -1), np.zeros(0, np.int64))
    free, own = np.flatnonzero(nodes.a != 0), no_ranges(small.n)
    node = int(np.flatnonzero(nodes.a == 0)[0])
    first = forward_check(node, free, np.zeros(0, np.int64), 0, nodes, none, test, own)
    assert own.known.sum() > 0 and not own.known[0] and test.model_known.sum() > 0
    for b in np.flatnonzero(own.known):
        errors = np.hypot(small.sample.tolerances[[0, b], 0], small.sample.tolerances[[0, b], 1]) + ROUNDING
        expected = np.empty(11)
        cones = small.sample.tolerances[[0, b], 2] + ROUNDING
        pair_ranges(small.sample.data[0], small.sample.data[b], *errors, *cones, expected)
        np.testing.assert_array_equal(own.ranges[b], expected)
    # Ranges that are known are not looked up again: with those of another pair the answer is another.
    own.ranges[own.known] = 0.0
    again = forward_check(node, free, np.zeros(0, np.int64), 0, nodes, none, test, own)
    assert len(again) < len(first)
