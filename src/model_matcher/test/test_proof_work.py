"""Small proofs whose answers are known, and the work they take: a bound that slackens costs branches before truth."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, make_scene
from model_matcher.closed_form.synthetic.strained import strained_scene
from model_matcher.model.problem import make_problem
from model_matcher.proof.arc_consistency import Nodes
from model_matcher.proof.branch_and_bound import BranchAndBound, GivenUp, sample_of
from model_matcher.proof.certificate import prove
from model_matcher.proof.feasibility import all_fit, deviations
from msgs_py import BIN
from msgs_py.numeric.deadline import Deadline

# Seed of a strained scene, what is known, and the part of the stated errors that is left; then the size of the largest
# interpretation, or 0 where there is none larger than what is known, the branches, and the pairings that are left.
CASES = (
    (0, 6, 1.0, 7, 1, 7),
    (0, 6, 0.6, 0, 0, 0),
    (0, 5, 0.6, 0, 1, 6),
    (1, 5, 1.0, 6, 1, 6),
    (1, 3, 0.6, 4, 3, 11),
    (1, 3, 0.3, 0, 1, 5),
    (3, 3, 1.0, 4, 1, 4),
    (3, 2, 0.6, 0, 14, 13),
    (4, 3, 0.6, 4, 6, 5),
    (4, 2, 0.3, 4, 2, 16),
    (5, 5, 0.3, 6, 2, 7),
    (5, 4, 0.3, 6, 5, 24),
    (10, 6, 0.6, 0, 0, 7),
    (11, 4, 0.6, 0, 10, 12),
    (16, 4, 0.6, 5, 11, 28),
    (17, 3, 0.6, 0, 12, 28),
    (17, 2, 0.6, 3, 14, 28),
    (20, 2, 0.6, 0, 4, 6),
    (24, 2, 0.6, 0, 6, 14),
    (33, 3, 0.6, 4, 4, 19),
    (34, 4, 0.6, 0, 5, 25),
    (38, 2, 0.6, 3, 4, 14),
    (39, 2, 0.3, 0, 5, 10),
    (40, 2, 0.6, 3, 5, 28),
    (46, 4, 0.3, 0, 6, 11),
    (46, 3, 0.3, 4, 23, 26),
    (50, 3, 0.3, 5, 5, 6),
    (52, 2, 0.3, 0, 12, 17),
    (55, 3, 0.3, 0, 0, 17),
    (59, 4, 0.6, 0, 6, 22),
)


@pytest.mark.parametrize(('seed', 'known', 'scale', 'size', 'branches', 'pairings'), CASES)
def test_the_largest_is_found_and_proven_in_so_many_branches(seed, known, scale, size, branches, pairings):
    scene = strained_scene(seed, ('l_shape', 'wedge', 'cylinder_box'), most=7)
    params = scene.params.replace(err_scale=scale * scene.params.err_scale)
    proof = prove(scene.index, scene.data, known, params, Deadline(60.0))
    assert proof.proven and proof.reason is None and proof.seconds > 0.0
    assert (proof.nodes, proof.pairings) <= (branches, pairings) and proof.pairings <= pairings
    assert (proof.assignment is None) == (proof.motion is None) == (size == 0)
    if size:
        assert (proof.assignment != BIN).sum() == size
        problem = make_problem(scene.index, scene.data, params)
        a = np.flatnonzero(proof.assignment[problem.keep] != BIN)
        i = proof.assignment[problem.keep][a].astype(np.int64)
        assert all_fit(proof.motion, a, i, sample_of(problem), scene.index.kind, problem.radius_tol)
        assert deviations(proof.motion, a, i, sample_of(problem)).max() <= 1.0 + 1e-9


def test_what_is_too_near_is_left_open():
    scene = strained_scene(27, ('l_shape', 'wedge', 'cylinder_box'), most=7)
    proof = prove(scene.index, scene.data, 2, scene.params, Deadline(60.0))
    assert not proof.proven and proof.reason == 'some pairings are too near their tolerances to decide on'


@pytest.mark.compiled
def test_of_the_plug_hardly_more_pairings_are_left_than_features():
    """Its short edges fit nearly anywhere alone; those of every other feature together leave one or two."""
    model = MODELS['plug']()
    scene = make_scene(model, 0, clutter=0.5)
    proof = prove(index_model(model, 'plug'), scene.data, 43, MatchParams(), Deadline(60.0))
    assert proof.proven and proof.nodes <= 2 and proof.pairings <= 66


class TestTree:
    """Its parts, on an L-shape seen whole."""

    def tree(self, most=3):
        model = MODELS['l_shape']()
        return BranchAndBound(make_problem(index_model(model), model, MatchParams()), most, Deadline(60.0))

    def test_groups_are_disjoint_and_each_fixes_a_pose(self):
        tree, alike = self.tree(), np.ones(18, np.int64)
        groups = tree.groups(np.arange(18), alike, 4)
        assert [len(group) for group in groups] == [4, 4, 4, 3], 'in turns, while there are enough for all'
        every = [a for group in groups for a in group]
        assert len(set(every)) == len(every) == 15
        lines = tree.sample.data[:, 3:6]
        for group in groups:
            assert np.linalg.svd(lines[group])[1][1] > 0.9, 'not all of them parallel'
        assert tree.groups(np.array([4, 7]), alike[:2], 2) == [[4], [7]]
        assert tree.groups(np.array([0]), alike[:1], 1) == [[0]]

    def test_an_interpretation_is_kept_when_it_is_larger_and_fits(self):
        tree = self.tree(most=17)
        a = np.arange(18)
        still = np.r_[np.eye(3).ravel(), np.zeros(3)]
        assert not tree.keep_larger(a[:17], a[:17], still), 'no larger'
        assert not tree.keep_larger(a, np.roll(a, 1), still) and tree.assignment is None, 'does not fit'
        assert tree.keep_larger(a, a, still)
        assert tree.most == 18 and tree.assignment.tolist() == a.tolist() and tree.motion is still

    def test_a_known_pose_takes_in_what_fits_when_it_gives_way(self):
        tree = self.tree(most=10)
        shifted = np.r_[np.eye(3).ravel(), 1e-4, 0.0, 0.0]
        tree.enlarge(shifted)
        assert tree.most == 18 and tree.assignment.tolist() == list(range(18))
        far = self.tree(most=10)
        far.enlarge(np.r_[np.eye(3).ravel(), 10.0, 0.0, 0.0])
        assert far.most == 10 and far.assignment is None

    def test_a_known_pose_that_explains_as_many_as_are_known_gives_way_for_one_more(self):
        tree = self.tree(most=17)
        across = tree.sample.tolerances[0, 0]
        tree.sample.data[0, :3] += 1.3 * across * np.eye(3)[np.argmin(np.abs(tree.sample.data[0, 3:6]))]
        still = np.r_[np.eye(3).ravel(), np.zeros(3)]
        assert deviations(still, np.arange(1), np.arange(1), tree.sample)[0] == pytest.approx(1.3, rel=1e-3)
        tree.enlarge(still)
        assert tree.most == 18 and tree.assignment.tolist() == list(range(18))

    def test_two_lines_that_cross_fix_four_poses(self):
        tree = self.tree()
        lines = tree.sample.data[:, 3:6]
        other = int(np.flatnonzero(np.abs(lines @ lines[0]) < 1e-9)[0])
        pair = np.array([0, other])
        regions = tree.first_regions(pair, pair)
        assert len(regions) == 4 and all(0.0 < turn < 0.6 for _, turn in regions)
        turns = [np.arccos(np.clip((motion[:9].reshape(3, 3).trace() - 1) / 2, -1, 1)) for motion, _ in regions]
        assert min(turns) < 1e-6 and sum(turn < 1e-6 for turn in turns) == 1
        parallel = int(np.flatnonzero(np.abs(lines @ lines[0]) > 1 - 1e-9)[1])
        assert tree.first_regions(np.array([0, parallel]), np.array([0, parallel])) is None


class Recorded(BranchAndBound):
    """A tree that notes which nodes it takes, and has nothing beside them."""

    def joined(self, node, forced, free, region):
        self.taken.append(int(node))
        return []


def tree_of(counts, most):
    """A tree over data features with so many nodes each."""
    model = MODELS['l_shape']()
    tree = Recorded(make_problem(index_model(model), model, MatchParams()), most, Deadline(60.0))
    a = np.repeat(np.arange(len(counts)), counts)
    tree.nodes, tree.taken = Nodes(a, np.arange(len(a))), []
    return tree


class TestBranching:
    """Which nodes are taken, where none may stand beside another."""

    nothing = np.zeros(0, np.int64)

    def explored(self, counts, most, refuted=()):
        tree = tree_of(counts, most)
        tree.explore(self.nothing, np.arange(sum(counts)), None, [frozenset(one) for one in refuted])
        return [int(tree.nodes.a[node]) for node in tree.taken], tree

    def test_it_branches_on_the_feature_of_fewest_nodes_and_then_does_without_it(self):
        assert self.explored([3, 2, 4], 0)[0] == [1] * 2 + [0] * 3 + [2] * 4
        assert self.explored([3, 2, 4], 1)[0] == [1] * 2 + [0] * 3, 'one alone is not larger than one'

    def test_a_feature_of_one_node_excludes_no_more_than_the_one_of_most(self):
        assert self.explored([1, 3, 2], 0)[0] == [2] * 2 + [0] + [1] * 3
        assert self.explored([3, 1, 2], 0)[0] == [2] * 2 + [0] * 3 + [1]
        assert self.explored([1, 1], 0)[0] == [0, 1]

    def test_too_few_features_are_not_looked_at(self):
        taken, tree = self.explored([3, 2, 4], 3)
        assert taken == [] and tree.branches == 1

    def test_each_branch_is_counted_and_looks_at_the_clock(self):
        assert self.explored([3, 2, 4], 0)[1].branches == 4
        tree = tree_of([3, 2], 0)
        tree.deadline = Deadline(0.0)
        with pytest.raises(GivenUp, match='time limit'):
            tree.explore(self.nothing, np.arange(5), None, [])

    def test_a_group_is_taken_feature_by_feature_the_one_of_fewest_nodes_first(self):
        tree = tree_of([3, 2, 4, 1], 0)
        tree.assign([0, 2, 1], self.nothing, np.arange(10), None)
        assert tree.nodes.a[tree.taken].tolist() == [1, 1]
        tree = tree_of([3, 2, 4, 1], 0)
        tree.joined = lambda node, forced, free, region: (
            tree.taken.append(int(tree.nodes.a[node])) or [(np.append(forced, node), free, None)]
        )
        seen = []
        tree.explore = lambda forced, free, region, refuted: seen.append((forced.tolist(), free.tolist()))
        tree.assign([0, 1], self.nothing, np.arange(10), None)
        # Each node of feature 1, 3 and 4, with each of feature 0, 0 to 2; what is free is of the others.
        assert [forced for forced, _ in seen] == [[one, other] for one in (3, 4) for other in (0, 1, 2)]
        assert all(free == [5, 6, 7, 8, 9] for _, free in seen)

    def test_the_groups_that_are_refuted_are_kept(self):
        tree = tree_of([3, 2, 4, 1, 2, 2], 3)
        tree.search()
        assert [len(group) for group in tree.disjoint] == [2, 2, 2]
        assert tree.refuted == [frozenset(group) for group in tree.disjoint]
        of, sizes = tree.groups_refuted
        assert sizes.tolist() == [2, 2, 2]
        for number, group in enumerate(tree.disjoint):
            assert (of[group] == number).all()
        assert (of[6:] == -1).all()
        before = len(tree.taken)
        tree.search()
        assert len(tree.taken) == before, 'and not refuted again'

    def test_members_are_left_out_in_turn_and_those_before_are_in(self):
        tree = tree_of([1, 1, 1, 2], 0)
        tree.joined = lambda node, forced, free, region: [(np.append(forced, node), free, 'smaller')]
        seen = []
        tree.explore = lambda forced, free, region, refuted, tested: seen.append(
            (forced.tolist(), free.tolist(), region, tested)
        )
        tree.leave_one_out(np.array([0, 2]), self.nothing, np.arange(5), 'whole', [])
        assert seen == [([], [1, 2, 3, 4], 'whole', True), ([0], [1, 3, 4], 'smaller', False)]

    def test_a_member_that_cannot_be_in_ends_it(self):
        tree, seen = tree_of([1, 1, 1, 2], 0), []
        tree.explore = lambda forced, free, region, refuted, tested: seen.append(free.tolist())
        tree.leave_one_out(np.array([0, 2]), self.nothing, np.arange(5), None, [])
        assert seen == [[1, 2, 3, 4]] and tree.taken == [0]
        tree.taken.clear()
        tree.leave_one_out(np.array([0, 2]), self.nothing, np.arange(1, 5), None, [])
        assert tree.taken == [], 'one that is not free any more is not asked for'
