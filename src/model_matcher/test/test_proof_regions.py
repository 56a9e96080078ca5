"""Where the tree looks for poses, and what it says of sets of pairings there: small cases that are known by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model_matcher import MatchParams, index_model
from model_matcher.geometry.settings import ROUNDING
from model_matcher.model.problem import make_problem
from model_matcher.proof.arc_consistency import Nodes
from model_matcher.proof.branch_and_bound import BranchAndBound, GivenUp, Larger, Region
from model_matcher.proof.feasibility import Sample
from model_matcher.proof.settings import STEEP, WIDEST_TURN
from msgs_py import BIN, FeatureSet
from msgs_py.numeric.deadline import Deadline

STILL = np.r_[np.eye(3).ravel(), np.zeros(3)]
ACROSS, ALONG = 1e-3, 2e-3
# Middle, direction and half length of edges, no two of them parallel.
LINES = (
    ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 0.10),
    ([0.1, 0.2, 1.0], [0.0, 1.0, 0.0], 0.12),
    ([-0.1, 0.1, 1.1], [0.0, 0.0, 1.0], 0.09),
    ([0.2, -0.1, 0.9], [0.0, 0.6, 0.8], 0.11),
    ([-0.2, -0.1, 1.1], [0.8, 0.0, 0.6], 0.13),
    ([0.1, -0.2, 1.2], [0.6, 0.8, 0.0], 0.08),
)
NONE = np.zeros(0, np.int64)


def edges(lines):
    middle, direction, half = (np.array(part, float) for part in zip(*lines))
    return FeatureSet.from_edges(middle - half[:, None] * direction, middle + half[:, None] * direction)


def tree_of(lines=LINES, nodes=None, most=3, cones=0.05, seen=None):
    """A tree of edges that are their own model.

    nodes : pairs of data and model features, each with itself if not given; seen : the lines of the data, if others
    """
    problem = make_problem(index_model(edges(lines)), edges(seen or lines), MatchParams())
    tree = BranchAndBound(problem, most, Deadline(60.0))
    n = len(seen or lines)
    tolerances = np.tile([ACROSS, ALONG, 0.0], (n, 1))
    tolerances[:, 2] = cones
    tree.sample = Sample(tree.sample.data, tree.sample.kinds, tolerances, tree.sample.model)
    tree.nodes = Nodes(*np.array(nodes or [(a, a) for a in range(n)], np.int64).T.copy())
    return tree


def moved(lines, vector, shift=(0.0, 0.0, 0.0)):
    turn = Rotation.from_rotvec(vector)
    return [(turn.apply(middle) + shift, turn.apply(direction), half) for middle, direction, half in lines]


def crossing(angle):
    """Two lines at an angle, and half lengths and distance that no symmetry has."""
    return [([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 0.1), ([0.1, 0.05, 1.1], [np.cos(angle), np.sin(angle), 0.0], 0.07)]


def angle_of(motion):
    return Rotation.from_matrix(motion[:9].reshape(3, 3)).magnitude()


TWO = np.arange(2)


class TestFirstRegions:
    @pytest.mark.parametrize(('angle', 'count'), [(np.pi / 2, 4), (1.0, 2), (np.pi - 1.0, 2)])
    def test_directions_may_be_the_other_way_round_where_the_angle_stays(self, angle, count):
        assert len(tree_of(crossing(angle)).first_regions(TWO, TWO)) == count

    @pytest.mark.parametrize('angle', [0.6, 1.3, np.pi / 2])
    @pytest.mark.parametrize('off', [0.0, 0.05, -0.05])
    def test_they_reach_as_far_as_both_cones_and_the_angle_that_is_off(self, angle, off):
        """Lemma 9."""
        cones = np.array([0.04, 0.07])
        tree = tree_of(crossing(angle), cones=cones, seen=crossing(angle + off))
        chords = np.sin((cones + 0.5 * abs(off) + ROUNDING) / 2.0)
        expected = 2.0 * np.arcsin(np.sqrt((chords**2).sum() / (1.0 - np.cos(angle)))) + ROUNDING
        assert min(turn for _, turn in tree.first_regions(TWO, TWO)) == pytest.approx(expected, abs=1e-12)

    def test_an_angle_off_by_more_than_both_cones_has_none(self):
        for share, count in ((0.999, 2), (1.001, 0)):
            tree = tree_of(crossing(1.0), cones=np.array([0.04, 0.07]), seen=crossing(1.0 + share * 0.11))
            assert len(tree.first_regions(TWO, TWO)) == count

    @pytest.mark.parametrize('vector', [[0.3, -0.2, 0.5], [0.0, 3.0, 0.0], [-1.0, 2.0, 1.0]])
    def test_one_of_them_is_about_the_pose(self, vector):
        tree = tree_of(seen=moved(LINES, vector))
        for pair in ([0, 1], [3, 4], [5, 2]):
            regions = tree.first_regions(np.array(pair), np.array(pair))
            turn = Rotation.from_rotvec(vector).as_matrix()
            assert min(angle_of(motion[:9].reshape(3, 3) @ turn.T) for motion, _ in regions) < 1e-6

    def test_the_steepest_pair_of_narrow_cones_is_taken(self):
        slanted = crossing(0.5) + [([0.3, 0.1, 1.2], [0.0, 0.0, 1.0], 0.1)]
        every = np.arange(3)
        by_angle = tree_of(slanted).first_regions(every, every)
        assert by_angle[0].turn == pytest.approx(tree_of(slanted).first_regions(every[[0, 2]], every[[0, 2]])[0].turn)
        cones = np.array([0.02, 0.02, 0.3])
        narrow = tree_of(slanted, cones=cones)
        assert narrow.first_regions(every, every)[0].turn == pytest.approx(narrow.first_regions(TWO, TWO)[0].turn)

    def test_of_lines_that_hardly_cross_there_are_none_to_begin_with(self):
        for sine, some in ((1.001 * STEEP, True), (0.999 * STEEP, False)):
            assert (tree_of(crossing(np.arcsin(sine))).first_regions(TWO, TWO) is not None) is some
        # It is the flatter of both pairs that counts, the data's or the model's.
        assert tree_of(crossing(1.0), cones=2.0, seen=crossing(0.2)).first_regions(TWO, TWO) is None
        assert tree_of(crossing(0.2), cones=2.0, seen=crossing(1.0)).first_regions(TWO, TWO) is None


class TestRegions:
    def test_what_is_too_parallel_has_no_region_yet(self):
        assert tree_of(crossing(0.1)).regions(TWO, None) == [None]

    def test_what_leaves_a_wide_region_has_none_yet(self):
        assert tree_of(crossing(1.2), cones=0.6).regions(TWO, None) == [None]
        some = tree_of(crossing(1.2), cones=0.05).regions(TWO, None)
        assert len(some) >= 1 and all(0.0 < turn < WIDEST_TURN for _, turn in some)

    def test_a_region_is_made_smaller_by_what_joins(self):
        tree, true = tree_of(), Region(STILL, 0.2)
        (smaller,) = tree.regions(np.arange(4), true)
        assert 0.0 < smaller.turn < 0.1 and angle_of(smaller.motion) < smaller.turn
        assert true.motion is STILL and (STILL[:9].reshape(3, 3) == np.eye(3)).all(), 'the one it began with stays'

    def test_without_a_pose_there_is_none(self):
        seen = moved(LINES, [0.0, 0.0, 0.0])
        seen[3] = (seen[3][0] + np.array([0.05, 0.0, 0.0]), *seen[3][1:])
        assert tree_of(seen=seen).regions(np.arange(4), Region(STILL, 0.2)) == []
        assert len(tree_of(seen=seen).regions(np.arange(3), Region(STILL, 0.2))) == 1


def with_one_off(off, number=4, **more):
    """The data of one edge is off, across it, by so many tolerances."""
    lines = list(LINES)
    middle, direction, half = lines[number]
    aside = np.cross(direction, [0.3, 0.5, 0.8])
    lines[number] = (middle + off * ACROSS * aside / np.linalg.norm(aside), direction, half)
    return tree_of(seen=lines, **more)


NEAR = Region(STILL, 0.01)


class TestInfeasibleSets:
    """Six edges of which one, the fourth, has no pose together with the others."""

    def sets(self, forced, singles, spare, refuted=(), tree=None):
        tree = tree or with_one_off(9.0)
        packed, found = tree.infeasible_sets(
            np.array(forced, np.int64),
            np.array(singles, np.int64),
            np.array(singles, np.int64),
            NEAR,
            [frozenset(one) for one in refuted],
            spare,
        )
        return packed, [sorted(members.tolist()) for members in found]

    def test_the_one_that_fits_with_none_is_a_set_of_its_own(self):
        assert self.sets([0, 1, 2], [3, 4, 5], 2) == (1, [[4]])
        assert self.sets([0, 1, 2], [3, 5], 2) == (0, [])

    def test_no_more_sets_are_looked_for_than_end_the_branch(self):
        assert self.sets([0, 1, 2], [3, 4, 5], 0) == (1, [[4]])
        assert self.sets([0, 1, 2], [3, 4, 5], 0, [[3, 5]]) == (1, [])

    def test_taken_ones_without_a_pose_end_the_branch(self):
        assert self.sets([0, 1, 2, 4], [3, 5], 2) == (3, [])

    def test_known_sets_count_where_all_that_is_open_of_them_is_free(self):
        assert self.sets([0, 1, 2], [3, 5], 2, [[3, 5]]) == (1, [])
        assert self.sets([0, 1, 2], [3, 5], 2, [[0, 3], [1, 5]]) == (2, []), 'what is taken is in'
        assert self.sets([0, 1, 2], [3, 5], 2, [[3, 5], [0, 3]]) == (1, []), 'disjoint ones only'
        assert self.sets([0, 1, 2], [3, 5], 2, [[3, 4]]) == (0, []), 'one of them is out already'
        assert self.sets([0, 1, 2], [3, 5], 2, [[0, 1]]) == (3, []), 'one whole is taken'

    def test_what_known_sets_use_is_not_used_again(self):
        assert self.sets([0, 1, 2], [3, 4, 5], 3, [[4, 5]]) == (1, [])


class TestDecide:
    def decide(self, tree, forced, singles, region):
        tree.decide(np.array(forced, np.int64), np.array(singles, np.int64), np.arange(6), region, [])

    def test_without_a_region_nothing_can_be_said(self):
        with pytest.raises(GivenUp, match='too near their tolerances'):
            self.decide(tree_of(), [0, 1], [2, 3], None)

    def test_a_pose_that_is_found_is_a_larger_interpretation(self):
        tree = tree_of(most=3)
        with pytest.raises(Larger):
            self.decide(tree, [0, 1], [2, 3], Region(STILL, 0.1))
        assert tree.most == 4 and tree.assignment.tolist() == [0, 1, 2, 3, BIN, BIN]

    def test_one_that_is_no_larger_decides_nothing(self):
        with pytest.raises(GivenUp):
            self.decide(tree_of(most=4), [0, 1], [2, 3], Region(STILL, 0.1))

    def test_where_there_is_no_pose_one_of_the_single_ones_is_left_out(self):
        tree, asked = with_one_off(9.0), []
        tree.leave_one_out = lambda members, forced, *rest: asked.append((members.tolist(), forced.tolist()))
        self.decide(tree, [0, 1, 2], [3, 4], NEAR)
        assert asked == [([3, 4], [0, 1, 2])]
        asked.clear()
        self.decide(tree, [0, 1, 2, 3, 4], [], NEAR)
        assert asked == [], 'none is to be left out: the branch ends'


class TestNearest:
    # Data features 0 to 5 on themselves, and before it each of the last three on another.
    NODES = [(0, 0), (1, 1), (2, 2), (3, 4), (3, 3), (4, 4), (4, 5), (5, 0), (5, 5)]

    def test_the_nearest_node_of_each_feature_is_taken(self):
        tree = tree_of(nodes=self.NODES)
        with pytest.raises(Larger):
            tree.try_nearest(np.arange(3), np.arange(3, 9), STILL)
        assert tree.most == 6 and tree.assignment.tolist() == list(range(6))

    def test_nothing_is_kept_that_is_no_larger_or_has_no_pose(self):
        tree = tree_of(nodes=self.NODES, most=6)
        tree.try_nearest(np.arange(3), np.arange(3, 9), STILL)
        assert tree.assignment is None and tree.most == 6
        without = with_one_off(9.0, nodes=self.NODES)
        without.try_nearest(np.arange(3), np.arange(3, 9), STILL)
        assert without.assignment is None


class TestExplore:
    """From three forced edges on, in a region about the true pose."""

    def explore(self, tree, forced, free, region=NEAR, refuted=(), tested=False):
        tree.explore(
            np.array(forced, np.int64), np.array(free, np.int64), region, [frozenset(one) for one in refuted], tested
        )

    def test_a_larger_interpretation_is_found(self):
        tree = tree_of(most=5)
        with pytest.raises(Larger):
            self.explore(tree, [0, 1, 2], [3, 4, 5])
        assert tree.most == 6 and tree.assignment.tolist() == list(range(6))

    def test_one_that_misses_is_left_out_and_the_rest_is_found(self):
        tree = with_one_off(9.0, most=4)
        with pytest.raises(Larger):
            self.explore(tree, [0, 1, 2], [3, 4, 5])
        assert tree.most == 5 and tree.assignment.tolist() == [0, 1, 2, 3, BIN, 5]

    @pytest.mark.parametrize('tested', [True, False])
    def test_where_one_misses_no_more_than_the_others_are_found(self, tested):
        tree = with_one_off(9.0, most=5)
        self.explore(tree, [0, 1, 2], [3, 4, 5], tested=tested)
        assert tree.assignment is None and tree.branches == 1, 'it ends at once'

    def test_what_a_known_set_leaves_out_is_counted(self):
        tree = tree_of(most=5)
        self.explore(tree, [0, 1, 2], [3, 4, 5], refuted=[[3, 5]])
        assert tree.assignment is None and tree.branches == 1
        with pytest.raises(Larger):
            self.explore(tree_of(most=4), [0, 1, 2], [3, 4, 5], refuted=[[3, 5]])
