"""Small proofs whose answers are known, and the work they take: a bound that slackens costs branches before truth."""

import numpy as np
import pytest

from model_matcher import MatchParams, index_model
from model_matcher.closed_form.synthetic.scenes import MODELS, make_scene
from model_matcher.closed_form.synthetic.strained import strained_scene
from model_matcher.model.problem import make_problem
from model_matcher.proof.branch_and_bound import BranchAndBound, sample_of
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
