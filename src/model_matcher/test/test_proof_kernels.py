"""The bounds of the proof beside their formulas in docs/proof.md, and beside poses drawn at random."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model_matcher.geometry.pair_bounds import (
    ANGLE,
    FOOT_A,
    FOOT_B,
    OFFSET,
    RELATION,
    margins_of,
    model_relations,
    offset_slack,
    pair_fits,
    relation,
)
from model_matcher.proof.arc_consistency import _angle_bins, _by_angle, pair_test, revise
from model_matcher.proof.feasibility import (
    ALONG,
    BLOCKS,
    FEASIBLE,
    FIRST_END,
    INFEASIBLE,
    SECOND_END,
    TILT,
    Sample,
    _bound,
    _extent,
    _fits_here,
    _follow,
    _growth,
    _halved,
    _linearise,
    _linearise_all,
    _mean_bound,
    _misses_everywhere,
    _normal_of,
    _Residuals,
    _room_for,
    _squared_norms,
    _turn_between,
    _widest,
    add_steadiest,
    can_join,
    common_pose,
    deviations,
    first_variances,
    infeasible_subset,
    least_squares_pose,
    narrow,
    narrow_in_parts,
    refute,
    search_rotations,
)
from model_matcher.proof.settings import ANGLES
from model_matcher.proof.spares import Groups
from msgs_py import FeatureKind

STILL = np.r_[np.eye(3).ravel(), np.zeros(3)]
ACROSS, BESIDE, CONE = 4e-3, 9e-3, 0.12


def feature(middle, direction, half):
    direction = np.asarray(direction, float)
    return np.r_[middle, direction / np.linalg.norm(direction), half, np.nan, np.nan]


def sample_of(data, model, curve=False):
    n = len(data)
    kinds = np.full(n, FeatureKind.CURVE if curve else FeatureKind.EDGE, np.uint8)
    return Sample(np.array(data), kinds, np.tile([ACROSS, BESIDE, CONE], (n, 1)), np.array(model))


def corner(seed=0, shift=0.0):
    """Three edges about a corner, and the model they are of; the data are shifted along x."""
    rng = np.random.default_rng(seed)
    lines = [feature(p, d, 0.05 + 0.05 * rng.random()) for p, d in zip(rng.normal(size=(3, 3)) * 0.1, np.eye(3) + 0.2)]
    data = np.array(lines)
    data[:, 0] += shift
    data[:, 6] *= 0.9
    return sample_of(data, lines)


def residuals_at(sample, k, motion, turn=0.0, centre=(0.0, 0.0, 0.0)):
    out = _room_for(BLOCKS)
    shift = _linearise(motion, turn, np.array(centre), k, k, sample, out, 0)
    return out, shift


def exact(sample, k, motion):
    """Length of each block's residual under a pose, in metres and sines."""
    d, m = sample.data[k], sample.model[k]
    rotation = motion[:9].reshape(3, 3)
    line, middle = rotation @ m[3:6], rotation @ m[:3] + motion[9:]
    across = np.eye(3) - np.outer(line, line)
    curve = sample.kinds[k] == FeatureKind.CURVE
    ends = [d[:3] + way * (0.0 if curve else d[6]) * d[3:6] for way in (1.0, -1.0)]
    return np.array(
        [
            np.linalg.norm(across @ (ends[0] - middle)),
            0.0 if curve else np.linalg.norm(across @ (ends[1] - middle)),
            abs(line @ (d[:3] - middle)),
            np.linalg.norm(across @ d[3:6]),
        ]
    )


def some_motion(seed, turn=0.05, shift=0.01):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    rotation = Rotation.from_rotvec(turn * axis / np.linalg.norm(axis)).as_matrix()
    return np.r_[rotation.ravel(), shift * rng.normal(size=3)]


class TestLinearised:
    @pytest.mark.parametrize('curve', [False, True])
    @pytest.mark.parametrize('seed', range(4))
    def test_at_its_pose_it_is_exact(self, seed, curve):
        one = corner(seed)
        sample = sample_of(one.data, one.model, curve)
        motion = some_motion(seed)
        for k in range(3):
            found, shift = residuals_at(sample, k, motion, centre=(0.3, 0.1, -0.2))
            d, m = sample.data[k], sample.model[k]
            rotation = motion[:9].reshape(3, 3)
            c = abs(rotation @ m[3:6] @ d[3:6])
            room = m[6] + BESIDE - c * d[6]
            tolerances = np.array([ACROSS, ACROSS, room, np.sin(CONE)])
            lengths = np.linalg.norm(found.values, axis=1)
            np.testing.assert_allclose(lengths, exact(sample, k, motion) / tolerances, rtol=1e-5, atol=1e-8)
            arm = np.linalg.norm(d[:3] - [0.3, 0.1, -0.2])
            ends = [np.linalg.norm(d[:3] + way * d[6] * d[3:6] - [0.3, 0.1, -0.2]) for way in (1, -1)]
            levers = np.array([arm if curve else ends[0], 0.0 if curve else ends[1], arm, 1.0]) / tolerances
            np.testing.assert_allclose(found.levers, levers, rtol=1e-5)
            assert found.own == pytest.approx([1.0, 0.0 if curve else 1.0, 1.0, 1.0], rel=1e-5)
            away = np.linalg.norm(d[:3] - rotation @ m[:3] - motion[9:])
            assert shift == pytest.approx(away + room + ACROSS, rel=1e-6)

    def test_a_region_widens_the_room_along_and_the_shift(self):
        sample = corner()
        centre = np.array([0.4, -0.3, 0.6])
        narrow_one, shift = residuals_at(sample, 0, STILL, centre=centre)
        wide, far = residuals_at(sample, 0, STILL, turn=0.1, centre=centre)
        d, m = sample.data[0], sample.model[0]
        assert wide.own[ALONG] == pytest.approx((m[6] + BESIDE - np.cos(0.1) * d[6]) / (m[6] + BESIDE - d[6]), rel=1e-5)
        assert far - shift == pytest.approx(0.1 * np.linalg.norm(d[:3] - centre) + (1 - np.cos(0.1)) * d[6], rel=1e-5)
        for block in (FIRST_END, SECOND_END, TILT):
            np.testing.assert_array_equal(wide.values[block], narrow_one.values[block])
        # No feasible pose tilts beyond the cone, so the room is not wider than that leaves.
        widest, farthest = residuals_at(sample, 0, STILL, turn=3.0, centre=centre)
        assert farthest - shift == pytest.approx(
            2.0 * np.linalg.norm(d[:3] - centre) + (1 - np.cos(CONE)) * d[6], rel=1e-5
        ), 'no turn moves a point by more than twice its lever'
        assert widest.own[ALONG] == pytest.approx(
            (m[6] + BESIDE - np.cos(CONE) * d[6]) / (m[6] + BESIDE - d[6]), rel=1e-5
        )

    @pytest.mark.parametrize('curve', [False, True])
    def test_its_derivatives_are_those_of_a_step(self, curve):
        one = corner(3)
        sample = sample_of(one.data, one.model, curve)
        motion, centre = some_motion(5), np.array([0.1, -0.2, 0.3])
        rng = np.random.default_rng(1)
        for k in range(3):
            found, _ = residuals_at(sample, k, motion, centre=centre)
            d, m = sample.data[k], sample.model[k]
            c = abs(motion[:9].reshape(3, 3) @ m[3:6] @ d[3:6])
            tolerances = np.array([ACROSS, ACROSS, m[6] + BESIDE - c * d[6], np.sin(CONE)])
            for size in (1e-4, 1e-2):
                step = rng.normal(size=6) * size
                moved = motion.copy()
                _follow(moved, centre, step)
                linear = np.linalg.norm(found.values - found.jacobian @ step, axis=1)
                widened = tolerances * np.where(found.own > 0.0, found.own, 1.0)
                off = np.abs(linear - exact(sample, k, moved) / widened)
                assert (off <= 0.5 * found.levers * (step[:3] ** 2).sum() + 1e-9).all(), 'lemma 5'

    def test_all_at_once_have_their_blocks_in_order_and_the_least_shift(self):
        sample, together = corner(), _room_for(3 * BLOCKS)
        number = np.arange(3)
        shift = _linearise_all(STILL, 0.2, np.zeros(3), number, number, sample, together)
        alone = [residuals_at(sample, k, STILL, 0.2) for k in range(3)]
        assert shift == min(one for _, one in alone)
        np.testing.assert_array_equal(together.values, np.concatenate([one.values for one, _ in alone]))
        np.testing.assert_array_equal(together.levers, np.concatenate([one.levers for one, _ in alone]))

    def test_what_fits_is_within_its_own_tolerance(self):
        values, none = np.array([[0.6, 0.8], [0.0, 0.0]]), np.zeros((2, 2, 6))
        for own, fits in (((1.0, 1.0), True), ((1.0 + 1e-6, 1.0), False), ((0.9, 50.0), True)):
            assert _fits_here(_Residuals(none, values, none, np.zeros(2), np.array(own))) is fits

    def test_squared_norms_and_the_normal_matrix(self):
        rng = np.random.default_rng(0)
        rows, bends = rng.normal(size=(2, 5, 2, 6))
        some = _Residuals(rows, rng.normal(size=(5, 2)), bends, np.zeros(5), np.ones(5))
        step, out, weights, normal = rng.normal(size=6), np.empty(5), rng.random(5), np.empty((6, 6))
        worst = _squared_norms(some, step, out)
        np.testing.assert_allclose(out, ((some.values - some.jacobian @ step) ** 2).sum(axis=1))
        assert worst == out.max()
        _normal_of(some, weights, normal)
        np.testing.assert_allclose(normal, np.einsum('b,bkp,bkq->pq', weights, some.jacobian, some.jacobian))


class TestBounds:
    def test_growth_is_wolkowicz_and_styans_bound_of_the_largest_eigenvalue(self):
        rng = np.random.default_rng(4)
        root = rng.normal(size=(6, 6))
        normal = root @ root.T
        inverse = np.linalg.inv(normal)
        square, rest = _growth(normal, inverse, 0.3, 2.0)
        spread = inverse[:3, :3]
        mean = np.trace(spread) / 3
        assert square == pytest.approx(mean + np.sqrt(2 / 3) * np.linalg.norm(spread - mean * np.eye(3)))
        assert square >= np.linalg.eigvalsh(spread).max() and rest < 1e-9
        # A ball is bounded by its radius, and by what rounding may add to it.
        assert _growth(4.0 * np.eye(6), 0.25 * np.eye(6), 0.3, 2.0) == (0.25 * (1.0 + 1e-9), 0.0)
        # Of an inverse that is off, the rest says by how much.
        off = inverse.copy()
        off[:3] += 0.01 * rng.normal(size=(3, 6))
        left = np.eye(3, 6) - off[:3] @ normal
        _, rest = _growth(normal, off, 0.3, 2.0)
        assert rest == pytest.approx(np.abs(left[:, :3]).sum() * 0.3 + np.abs(left[:, 3:]).sum() * 2.0)

    @pytest.mark.parametrize('seed', range(5))
    def test_every_feasible_step_is_in_the_ellipsoid(self, seed):
        """Lemmas 6 and 7, with poses drawn about the one that fits."""
        sample, number, centre = corner(seed), np.arange(3), np.zeros(3)
        turn = 0.3
        residuals = _room_for(3 * BLOCKS)
        start = some_motion(seed, turn=0.02, shift=1e-3)
        shift = _linearise_all(start, turn, centre, number, number, sample, residuals)
        weights = np.random.default_rng(seed).random(3 * BLOCKS)
        bound = _bound(residuals, weights, turn, shift)
        np.testing.assert_allclose(bound.normal @ bound.inverse, np.eye(6), atol=1e-3)
        row = np.random.default_rng(seed + 1).normal(size=6)
        extent = _extent(bound, row)
        assert extent >= np.sqrt(row @ np.linalg.inv(bound.normal) @ row * bound.room) * (1 - 1e-6)
        rng, inside = np.random.default_rng(seed), 0
        for _ in range(400):
            step = np.r_[rng.normal(size=3) * 0.02, rng.normal(size=3) * 2e-3]
            moved = start.copy()
            _follow(moved, centre, step)
            if any(not _fits_here(residuals_at(sample, k, moved)[0]) for k in range(3)):
                continue
            inside += 1
            off = step - bound.lowest
            assert off @ bound.normal @ off <= bound.room
            assert np.linalg.norm(step[:3]) <= bound.reach and np.linalg.norm(off[:3]) <= bound.radius
            assert np.abs(off[:3]).max() <= bound.turn and np.abs(off[3:]).max() <= bound.shift
            assert abs(row @ off) <= extent
        assert inside > 5

    def test_the_mean_bound_weighs_what_a_curve_has_and_nothing_else(self):
        one, number = corner(), np.arange(3)
        sample = sample_of(one.data, one.model, curve=True)
        residuals = _room_for(3 * BLOCKS)
        shift = _linearise_all(STILL, 0.1, np.zeros(3), number, number, sample, residuals)
        mean = _mean_bound(residuals, 0.1, shift)
        bound = _bound(residuals, np.tile([1.0, 0.0, 1.0, 1.0], 3), 0.1, shift)
        for found, expected in zip(mean, bound):
            np.testing.assert_array_equal(found, expected)

    def test_a_shift_that_no_tolerance_allows_leaves_no_step(self):
        """Two collinear edges, one of which would have to be pulled along by more than its room."""
        line = [feature([-0.2, 0, 1], [1, 0, 0], 0.1), feature([0.2, 0, 1], [1, 0, 0], 0.1)]
        for gap, none in ((1.9 * BESIDE, False), (2.1 * BESIDE, True)):
            data = np.array(line)
            data[1, 0] += gap
            number, weights = np.arange(2), np.empty(2)
            state = refute(STILL.copy(), 1e-3, number, number, sample_of(data, line), weights)
            assert (state == INFEASIBLE) is none
            if none:
                assert weights == pytest.approx([0.5, 0.5], abs=0.05), 'both pull'
                assert narrow(STILL.copy(), 1e-3, number, number, sample_of(data, line)) >= -1.0

    def test_a_block_misses_everywhere_when_it_does_at_the_nearest_step(self):
        sample, number = corner(), np.arange(3)
        residuals = _room_for(3 * BLOCKS)
        shift = _linearise_all(STILL, 0.01, np.zeros(3), number, number, sample, residuals)
        bound = _mean_bound(residuals, 0.01, shift)
        for off, misses in ((0.0, False), (1e-3, False), (0.2, True)):
            data = sample.data.copy()
            data[0, 1] += off
            one, _ = residuals_at(Sample(data, *sample[1:]), 0, STILL, 0.01)
            assert _misses_everywhere(one, bound, 0.01) is misses

    def test_the_widest_tolerance_is_that_of_the_longest_lever(self):
        sample, number = corner(), np.arange(3)
        centre = sample.data[:, :3].mean(axis=0)
        levers = [np.linalg.norm(d[:3] + d[6] * d[3:6] - centre) / ACROSS for d in sample.data]
        assert _widest(STILL, 0.2, number, number, sample) == pytest.approx(1 + 0.5 * max(levers) * 0.04, rel=1e-5)


class TestPoses:
    @pytest.mark.parametrize('angle', [0.0, 1e-9, 0.3, 1.7, 3.1])
    def test_the_turn_between_two_poses(self, angle):
        first = some_motion(2, turn=0.9)
        axis = np.array([2.0, -1.0, 2.0]) / 3.0
        second = Rotation.from_rotvec(angle * axis).as_matrix() @ first[:9].reshape(3, 3)
        found = _turn_between(first, np.r_[second.ravel(), np.zeros(3)])
        np.testing.assert_allclose(found, angle * axis, atol=1e-9)

    def test_a_step_shifts_and_then_turns_about_the_centre(self):
        motion, centre = some_motion(1), np.array([0.3, 0.2, 0.1])
        moved = motion.copy()
        _follow(moved, centre, np.array([0.1, -0.2, 0.3, 0.01, 0.02, 0.03]))
        turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
        np.testing.assert_allclose(moved[:9].reshape(3, 3), turn @ motion[:9].reshape(3, 3), atol=1e-12)
        expected = turn @ (motion[9:] + [0.01, 0.02, 0.03] - centre) + centre
        np.testing.assert_allclose(moved[9:], expected, atol=1e-12)

    def test_a_common_pose_is_looked_for_to_the_last_linearisation(self):
        sample, number = corner(1), np.arange(3)
        far = some_motion(4, turn=0.25, shift=0.02)
        assert common_pose(far, number, number, sample)
        for k in range(3):
            assert _fits_here(residuals_at(sample, k, far)[0])
        apart = corner(1, shift=0.0)
        apart.data[0, :3] += 0.3
        assert not common_pose(some_motion(4), number, number, apart)

    def test_a_least_squares_pose_finds_the_motion_and_which_way_features_run(self):
        model = corner(2).model
        motion = some_motion(3, turn=0.4, shift=0.1)
        rotation, data = motion[:9].reshape(3, 3), model.copy()
        data[:, :3] = model[:, :3] @ rotation.T + motion[9:]
        data[:, 3:6] = model[:, 3:6] @ rotation.T * np.array([[1.0], [-1.0], [1.0]])
        found, sign = some_motion(3, turn=0.35, shift=0.1), np.full(3, 5, np.int8)
        least_squares_pose(found, np.arange(3, dtype=np.int32), sign, sample_of(data, model))
        np.testing.assert_allclose(found, motion, atol=1e-6)
        assert sign.tolist() == [1, -1, 1]
        least_squares_pose(found, np.array([0, -1, 2], np.int32), sign, sample_of(data, model))
        assert sign.tolist() == [1, 0, 1]

    def test_an_infeasible_subset_leaves_out_what_does_not_matter(self):
        line = [feature([-0.2, 0, 1], [1, 0, 0], 0.1), feature([0.2, 0, 1], [1, 0, 0], 0.1)]
        line += [feature([0, 0.1 * k, 1], [0, 0, 1], 0.05) for k in (-2, -1, 1, 2)]
        data = np.array(line)
        data[1, 0] += 4 * BESIDE
        data[2:, 0] += 2 * BESIDE
        number, weights = np.arange(6), np.array([0.4, 0.4, 0.05, 0.05, 0.05, 0.05])
        sample = sample_of(data, line)
        assert refute(STILL.copy(), 1e-3, number, number, sample, np.empty(6)) == INFEASIBLE
        assert sorted(infeasible_subset(STILL, 1e-3, number, number, weights, sample)) == [0, 1]


class TestJoining:
    """What may join two edges that fix a pose, within a small region."""

    def setup_method(self):
        model = [feature([0, 0, 1], [1, 0, 0], 0.2), feature([0, 0.3, 1], [0, 1, 0], 0.2)]
        model += [feature([0.3, 0, 1.2], [0, 0, 1], 0.2), feature([-0.3, 0.2, 1.2], [0, 1, 1], 0.2)]
        data = np.array(model)
        data[:, 6] *= 0.9
        self.sample = sample_of(data, model)
        self.few = np.array([0, 1])

    def joins(self, others_a, others_i, least=0, groups=None):
        none = Groups(np.full(4, -1), np.zeros(0, np.int64))
        a, i = np.array(others_a), np.array(others_i)
        return can_join(STILL, 0.01, self.few, self.few, a, i, least, groups or none, self.sample).tolist()

    def test_each_pairing_is_judged_by_itself(self):
        assert self.joins([2, 2, 3, 3], [2, 3, 2, 3]) == [True, False, False, True]

    def test_when_too_few_features_are_left_none_is(self):
        assert self.joins([2, 3], [2, 3], least=2) == [True, True]
        assert self.joins([2, 3], [2, 2], least=1) == [True, False]
        assert self.joins([2, 3], [2, 2], least=2) == [False, False]
        assert self.joins([2, 3], [2, 3], least=3) == [False, False]

    def test_a_whole_group_that_was_refuted_leaves_one_out(self):
        pair = Groups(np.array([-1, -1, 0, 0]), np.array([2]))
        assert self.joins([2, 3], [2, 3], 1, pair) == [True, True]
        assert self.joins([2, 3], [2, 3], 2, pair) == [False, False]
        assert self.joins([2, 3], [2, 2], 1, pair) == [True, False], 'the one that is out is that one'

    def test_what_misses_only_here_is_tried_with_the_set(self):
        for off, joins in ((1.5, True), (4.0, False)):
            self.sample.data[2, 0] = 0.3 + off * ACROSS
            assert self.joins([2], [2]) == [joins]

    def test_a_set_without_a_pose_is_joined_by_none(self):
        self.sample.data[1, 2] += 0.5
        assert self.joins([2, 3], [2, 3]) == [False, False]


def test_the_first_variance_of_a_turn_is_a_square_radian():
    sample = corner()
    (variance,) = first_variances(np.array([1]), 0.5, sample)
    line = sample.data[1, 3:6]
    assert line @ variance[:3, :3] @ line == pytest.approx(1.0)
    assert add_steadiest(variance, 1, np.array([2, 0]), np.array([10**6, 1]), sample) == 1


class TestAngles:
    """Model features in the order of their angle with each, and where in it those stand at a data pair's angle."""

    def test_features_stand_in_the_order_of_their_angles_in_bins_of_half_a_degree(self):
        angles = np.radians([[90.0, 60.2, 89.9, 0.1], [60.2, 0.0, 30.0, 30.2], [0.0] * 4, [0.0] * 4])
        order, below = _by_angle(angles)
        assert order[0].tolist() == [0, 3, 1, 2], 'itself has no angle'
        assert order[1].tolist() == [1, 2, 3, 0] and order[2].tolist() == [0, 1, 2, 3], 'equal ones as they come'
        assert below.shape == (4, ANGLES + 1) and (below[:, -1] == 4).all() and (below[:, 0] == 0).all()
        assert below[0, 1] == 2 and below[0, 120] == 2 and below[0, 121] == 3 and below[0, 179] == 3
        assert below[1, 60] == 1 and below[1, 61] == 3

    @pytest.mark.parametrize(
        ('angle', 'cone', 'bins'),
        [(45.2, 0, (90, 90)), (44.3, 1.2, (86, 91)), (0.2, 0.1, (0, 0)), (0.2, 1, (0, 2)), (89.8, 0.1, (179, 179))]
        + [(89.2, 3, (172, 179)), (80.2, 30, (100, 179)), (60.2, 44, (32, 179)), (80.2, 60, (40, 179))],
    )
    def test_the_bins_of_an_angle_reach_as_far_as_its_cone(self, angle, cone, bins):
        """What goes beyond 90 degrees comes back from there, and not as far as the cone reaches down."""
        assert _angle_bins(np.radians(angle), np.radians(cone)) == bins

    def test_rounding_takes_nothing_from_the_bins(self):
        half = np.pi / 2 / ANGLES
        assert _angle_bins(60 * half, 0.0) == (59, 60)
        assert _angle_bins(60 * half + 1e-8, 0.0) == (60, 60)


class TestRevising:
    """Two edges of a model at 45 degrees, 0.3 apart, and data that lie on them."""

    def setup_method(self):
        model = np.array([feature([0, 0, 0], d, 0.1) for d in ([1, 0, 0], [1, 1, 0], [0, 0, 1])])
        model[1, :3] = 0.3, 0.0, 0.0
        model[2, :3] = 0.1, 0.2, 0.05
        self.model = model

    def left(self, data, supporters=2, at=0):
        test = pair_test(sample_of(data, self.model))
        left = np.ones((len(data), 3), bool)
        others = np.delete(np.arange(len(data)), at)
        revise(at, others, test, left, supporters)
        return left[at].tolist()

    def test_only_the_true_pairing_has_both_others_for_it(self):
        for at in range(3):
            assert self.left(self.model.copy(), at=at) == [k == at for k in range(3)]

    def test_one_is_enough_where_one_is_asked_for(self):
        data = self.model.copy()
        data[2, :3] = 5.0, 5.0, 5.0
        assert self.left(data, 1) == [True, False, False] and self.left(data, 2) == [False] * 3
        assert self.left(data, 0) == [True] * 3

    @pytest.mark.parametrize('cone', [0.0, CONE])
    def test_the_farthest_pair_is_near_enough_up_to_its_room(self, cone):
        """Middles may be as far apart as the model's, and what both edges have room for: its own half length each."""
        room = 2 * (0.1 + BESIDE + ACROSS - 0.01 * np.cos(cone))
        for beyond, fits in ((-1e-6, True), (1e-6, False)):
            data = self.model[:2].copy()
            data[:, 6] = 0.01
            gap = 0.3 + room + beyond
            data[1, :3] = gap, 0.0, 0.0
            sample = sample_of(data, self.model[:2])
            sample.tolerances[:, 2] = cone
            test = pair_test(sample)
            assert test.span == pytest.approx(0.5)
            left = np.ones((2, 2), bool)
            revise(0, np.array([1]), test, left, 1)
            # The line of b still meets that of a, but only if both may be so far out.
            assert left[0].any() == (fits and self.slides(data, cone))

    def slides(self, data, cone):
        rel = np.empty((1, RELATION))
        relation(data[0], data[1], rel[0])
        margins = margins_of(data, np.tile([ACROSS, BESIDE, cone], (2, 1)))
        both = model_relations(self.model[:2])
        halves = self.model[:2, 6].copy()
        pairs = ((0, 1), (1, 0), (0, 0), (1, 1))
        return any(pair_fits(rel, 0, margins, 0, 1, halves, both, i, j) for i, j in pairs)

    @pytest.mark.parametrize('way', [1.0, -1.0])
    def test_an_angle_may_be_off_by_both_cones(self, way):
        """From 70 degrees by nearly one radian: down to 13 degrees, or over the right angle back to 53."""
        model = np.array(
            [feature([0, 0, 0], [1, 0, 0], 0.1), feature([0, 0.1, 0], [np.cos(1.22), np.sin(1.22), 0], 0.1)]
        )
        for share, fits in ((0.999, True), (1.001, False)):
            data = model.copy()
            angle = 1.22 + way * share * 1.0
            data[1, 3:6] = np.cos(angle), np.sin(angle), 0.0
            sample = sample_of(data, model)
            sample.tolerances[:, 2] = 0.5
            left = np.eye(2, dtype=bool)
            revise(0, np.array([1]), pair_test(sample), left, 1)
            assert left[0, 0] == (fits or way > 0.0 and abs(np.pi - angle - 1.22) <= 1.0)

    def test_the_slack_of_the_distance_is_that_of_lemma_4(self):
        data = self.model[[0, 2]].copy()
        rel, margins = np.empty(RELATION), margins_of(data, np.tile([ACROSS, BESIDE, CONE], (2, 1)))
        relation(data[0], data[1], rel)
        chord = 2 * np.sin(CONE / 2)
        tilt = 2 * chord / np.sin(rel[ANGLE])
        strays = sum(ACROSS + np.sin(CONE) * max(0, abs(foot) - 0.1) for foot in (rel[FOOT_A], rel[FOOT_B]))
        expected = strays + abs(rel[OFFSET]) * (1 - np.sqrt(1 - tilt**2)) + 1e-9
        assert offset_slack(rel, margins, 0, 1) == pytest.approx(expected, abs=1e-12)
        wide = margins_of(data, np.tile([ACROSS, BESIDE, 0.6], (2, 1)))
        assert offset_slack(rel, wide, 0, 1) == np.inf, 'they may be parallel'


def turned(sample, vector):
    """The same model, and data that lie on it when it is turned and shifted; and that pose."""
    true = np.r_[Rotation.from_rotvec(vector).as_matrix().ravel(), 0.02, -0.01, 0.5]
    data = sample.data.copy()
    data[:, :3] = sample.model[:, :3] @ true[:9].reshape(3, 3).T + true[9:]
    data[:, 3:6] = sample.model[:, 3:6] @ true[:9].reshape(3, 3).T
    return Sample(data, *sample[1:]), true


def between(first, second):
    """Radians, between the rotations of two poses (12,)."""
    return Rotation.from_matrix(first[:9].reshape(3, 3) @ second[:9].reshape(3, 3).T).magnitude()


@pytest.mark.parametrize('axis', [0, 1, 2])
@pytest.mark.parametrize(('angle', 'turn'), [(0.4, 0.6), (2.8, 2.9), (-2.8, 2.9)])
def test_a_pose_that_the_parts_of_a_region_hold_is_given_back(axis, angle, turn):
    """The data are the model turned about one axis: where the search begins, nothing fits."""
    sample, _ = turned(corner(2), angle * np.eye(3)[axis])
    all_three = np.arange(3)
    motion = STILL.copy()
    assert deviations(motion, all_three, all_three, sample).max() > 1.0
    assert search_rotations(motion, turn, all_three, all_three, sample) == FEASIBLE
    assert deviations(motion, all_three, all_three, sample).max() <= 1.0 + 1e-9


def test_the_halves_of_a_cube_are_eight_and_fill_it():
    out = np.zeros((8, 4))
    assert _halved(np.array([0.1, 0.2, -0.1, 0.4]), 10.0, out) == 8
    assert (out[:, 3] == 0.2).all() and len(np.unique(out, axis=0)) == 8
    np.testing.assert_allclose(np.abs(out[:, :3] - [0.1, 0.2, -0.1]), 0.2)


def test_the_cubes_that_hold_no_turn_of_the_region_are_left_out():
    """A ball of radius 1, and cubes of half side 0.5 about (k, 0, 0): the ball about a half cube reaches 0.866 / 2."""
    out, half = np.zeros((8, 4)), 0.5 * np.sqrt(3.0) * 0.5
    for place, count in ((0.0, 8), (1.0, 8), (1.4, 4), (1.63, 4), (1.65, 0)):
        assert _halved(np.array([place, 0.0, 0.0, 0.5]), 1.0, out) == count
        near, far = (np.linalg.norm([place + side * 0.25, 0.25, 0.25]) <= 1.0 + half for side in (-1, 1))
        assert count == 4 * near + 4 * far
        assert (out[:count, 0] < place + 0.3).all()


class TestInParts:
    """Three edges of a corner, turned from the middle of a region for which one bound says little."""

    number = np.arange(3)

    @pytest.mark.parametrize('axis', [[2, -1, 2], [-2, 2, 1], [1, 2, -2], [-2, -1, -2]])
    def test_it_is_shrunk_in_parts_to_what_a_near_one_would_be(self, axis):
        for seed in (0, 2):
            sample, true = turned(corner(seed), 0.5 * np.array(axis) / 3.0)
            whole, parts, near = STILL.copy(), STILL.copy(), true.copy()
            assert narrow(whole, 0.8, self.number, self.number, sample) > 0.7
            left = narrow_in_parts(parts, 0.8, self.number, self.number, sample)
            assert left == pytest.approx(narrow(near, 0.2, self.number, self.number, sample), rel=0.05)
            assert between(parts, true) < 1e-3 * left, 'and lies about the true pose'

    def test_a_region_of_more_than_a_radian_is_not_divided(self):
        sample, _ = turned(corner(2), [0.0, 0.7, 0.0])
        motion = STILL.copy()
        assert narrow_in_parts(motion, 1.1, self.number, self.number, sample) == pytest.approx(1.1)
        np.testing.assert_array_equal(motion, STILL)

    @pytest.mark.parametrize('askew', range(3))
    def test_a_region_without_a_pose_has_none_in_any_part(self, askew):
        sample, _ = turned(corner(3), [0.0, 0.4, 0.0])
        tilt = Rotation.from_rotvec([0.5, 0.0, 0.0] if askew else [0.0, 0.5, 0.0])
        sample.data[askew, 3:6] = tilt.apply(sample.data[askew, 3:6])
        assert narrow(STILL.copy(), 0.6, self.number, self.number, sample) == pytest.approx(0.6)
        assert narrow_in_parts(STILL.copy(), 0.6, self.number, self.number, sample) == -1.0

    def test_what_nothing_holds_stays(self):
        """Two edges of one line turn about it as they like."""
        line = [feature([0.0, 0, 1], [1, 0, 0], 0.1), feature([0.02, 0, 1], [1, 0, 0], 0.1)]
        number = np.arange(2)
        sample = sample_of(np.array(line), line)
        assert narrow_in_parts(STILL.copy(), 0.9, number, number, sample) >= 0.9 * 0.9

    def test_what_was_narrowed_gives_hardly_more_when_it_is_narrowed_again(self):
        sample, true = turned(corner(1), [0.3, 0.1, -0.2])
        motion = true.copy()
        _follow(motion, np.zeros(3), np.r_[0.1, 0.05, -0.1, 0.0, 0.0, 0.0])
        left = narrow(motion, 0.3, self.number, self.number, sample)
        assert left < 0.15 and between(motion, true) <= left
        assert 0.89 * left <= narrow(motion, left, self.number, self.number, sample) <= left


def test_no_part_of_a_region_holds_what_has_other_angles():
    """One of three edges stands 0.5 askew to what the model has, and cones are 0.12."""
    sample = corner(3)
    data = sample.data.copy()
    data[2, 3:6] = Rotation.from_rotvec([0.5, 0.0, 0.0]).apply(data[2, 3:6])
    askew = Sample(data, sample.kinds, sample.tolerances, sample.model)
    all_three = np.arange(3)
    assert search_rotations(STILL.copy(), 0.6, all_three, all_three, askew) == INFEASIBLE
