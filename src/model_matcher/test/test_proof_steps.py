"""The steps of the proof beside their formulas: lemma 6 in matrices, Newton's method, the line search."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime, linprog

from model_matcher.proof import feasibility
from model_matcher.proof.settings import MINIMAX, REGIONS


def symmetric(lower):
    """The matrix (3, 3) whose lower triangle is given row by row."""
    matrix = np.zeros((3, 3))
    matrix[np.tril_indices(3)] = lower
    return matrix + matrix.T - np.diag(np.diag(matrix))


def farthest_eigenvalue(matrix):
    """How far an eigenvalue of a symmetric matrix (3, 3) may be from their mean (Wolkowicz and Styan)."""
    return np.sqrt(2.0 / 3.0) * np.linalg.norm(matrix - np.trace(matrix) / 3.0 * np.eye(3))


def some_residuals(seed, blocks=9, stiffness=4.0, bending=1.0, size=1.0):
    """Residuals drawn at random: values of about ``size``, as if linearised where they are no smaller."""
    rng = np.random.default_rng(seed)
    residuals = feasibility._room_for(blocks)
    residuals.jacobian[:] = stiffness * rng.normal(size=(blocks, 2, 6))
    residuals.values[:] = size * rng.normal(size=(blocks, 2))
    residuals.bends[:] = bending * rng.normal(size=(blocks, 2, 6))
    residuals.levers[:], residuals.own[:] = bending * rng.uniform(0.5, 3.0, blocks), 1.0
    return residuals


def lemma_6(residuals, weights, turn, shift, lowest, inverse):
    """What docs/proof.md says that the weights allow, about any step and with any inverse: room, reach and radius."""
    rows = residuals.jacobian
    normal = np.einsum('b,bkp,bkq->pq', weights, rows, rows)
    left = residuals.values - rows @ lowest
    slope = 2.0 * np.einsum('b,bkp,bk->p', weights, rows, left)
    aside = np.linalg.norm(lowest[:3])
    farthest = np.repeat([turn + aside, shift + np.linalg.norm(lowest[3:])], 3)
    least = weights @ (left**2).sum(axis=1) - np.abs(slope) @ farthest
    bending = symmetric(np.einsum('b,bk,bkl->l', weights, left, residuals.bends))
    curved = np.trace(bending) / 3.0 - farthest_eigenvalue(bending)
    spread = inverse[:3] @ normal @ inverse[:3].T
    square = np.trace(spread) / 3.0 + farthest_eigenvalue(spread)
    rest = (np.abs(np.eye(3, 6) - inverse[:3] @ normal) @ farthest).sum()
    straight = np.sqrt(0.25 * weights @ residuals.levers**2)
    room, reach = 0.0, -1.0
    for k in range(REGIONS.slices):
        low, high = turn * k / REGIONS.slices, turn * (k + 1) / REGIONS.slices
        first = weights @ (1.0 + residuals.levers * high**2 / 2.0) ** 2 - least
        second = weights @ (1.0 + residuals.levers * high**3 / 6.0) ** 2 - least
        second -= min(curved * high**2, curved * low**2)
        here = min(first, (np.sqrt(max(second, 0.0)) + straight * high**2) ** 2)
        if second >= 0.0 and here >= 0.0 and max(low - aside - rest, 0.0) ** 2 / square <= here:
            reach, room = high, max(room, here)
    return room, reach, min(np.sqrt(square * room) + rest, reach + aside)


def is_lemma_6(bound, residuals, weights, turn, shift):
    """Whether a bound is that of the lemma about its own lowest step; returns its reach."""
    room, reach, radius = lemma_6(residuals, weights, turn, shift, bound.lowest, bound.inverse)
    np.testing.assert_allclose(
        bound.normal, np.einsum('b,bkp,bkq->pq', weights, residuals.jacobian, residuals.jacobian), rtol=1e-9
    )
    assert bound.turn == pytest.approx(turn + np.linalg.norm(bound.lowest[:3]), rel=1e-9)
    assert bound.shift == pytest.approx(shift + np.linalg.norm(bound.lowest[3:]), rel=1e-9)
    assert bound.reach == pytest.approx(reach)
    if reach >= 0.0:
        assert bound.room == pytest.approx(room, rel=1e-5) and bound.radius == pytest.approx(radius, rel=1e-4)
    return reach


# Stiff sets and loose ones, that bend much or little, near to what is feasible and far from it.
SETS = [
    (stiffness, bending, size)
    for stiffness in (1.0, 4.0, 20.0)
    for bending in (0.0, 1.0, 6.0)
    for size in (0.5, 1.0, 1.4)
]


@pytest.mark.parametrize(('stiffness', 'bending', 'size'), SETS)
@pytest.mark.parametrize('turn', [0.1, 0.9])
def test_a_bound_is_that_of_lemma_6(stiffness, bending, size, turn):
    for seed in range(3):
        residuals = some_residuals(seed, 9, stiffness, bending, size)
        weights = np.random.default_rng(seed).uniform(0.1, 2.0, 9)
        bound = feasibility._bound(residuals, weights, turn, 0.7)
        is_lemma_6(bound, residuals, weights, turn, 0.7)
        normal = np.einsum('b,bkp,bkq->pq', weights, residuals.jacobian, residuals.jacobian)
        right = np.einsum('b,bkp,bk->p', weights, residuals.jacobian, residuals.values)
        np.testing.assert_allclose(bound.lowest, np.linalg.solve(normal, right), rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(bound.normal @ bound.inverse, np.eye(6), atol=1e-5)


def test_the_sets_of_the_bound_are_of_all_kinds():
    reached = []
    for one in SETS:
        residuals = some_residuals(0, 9, *one)
        reached.append(is_lemma_6(feasibility._bound(residuals, np.ones(9), 0.9, 0.7), residuals, np.ones(9), 0.9, 0.7))
    assert min(reached) < 0.0 and max(reached) == pytest.approx(0.9)
    assert any(0.0 < one < 0.8 for one in reached)


@pytest.mark.parametrize('weak', range(6))
def test_a_bound_holds_about_a_step_that_is_not_the_lowest(weak):
    """One direction so much weaker than the others that the damped solution is off in it."""
    residuals, weights = some_residuals(4, 9, 1.0, 0.5, 0.1), np.ones(9)
    residuals.jacobian[:] *= np.where(np.arange(6) == weak, 0.3, 1e4)
    residuals.values[:] = residuals.jacobian @ (0.4 * np.eye(6)[weak]) + 0.3 * residuals.values
    bound = feasibility._bound(residuals, weights, 0.5, 0.7)
    assert bound.lowest[weak] < 0.35, 'it is off'
    assert is_lemma_6(bound, residuals, weights, 0.5, 0.7) >= 0.0


@pytest.mark.parametrize('share', [1.0, 0.01])
@pytest.mark.parametrize('way', [1.0, -1.0])
def test_what_bends_all_one_way_is_that_of_lemma_6_however_light_it_is(share, way):
    """The least eigenvalue of the bend is above one, between none and one, or below."""
    residuals, weights = some_residuals(5, 9, 1.0, 0.3, 1.0), np.full(9, share)
    residuals.values[:, 0] = 1.15
    residuals.values[:, 1] = 0.0
    residuals.jacobian[:, 0] = 0.0
    residuals.bends[:] = 0.0
    residuals.bends[:, 0, [0, 2, 5]] = way * np.array([0.2, 0.25, 0.3])
    bound = feasibility._bound(residuals, weights, 0.9, 0.7)
    is_lemma_6(bound, residuals, weights, 0.9, 0.7)


@pytest.mark.parametrize('lever', [1.0, 6.0])
@pytest.mark.parametrize('turn', [0.3, 0.9])
def test_a_set_that_is_known_not_to_bend_is_excluded_by_the_third_order(lever, turn):
    """Nothing holds the turn; residuals are just below and just above what a sixth of its cube can be."""
    for share, reach in ((0.9999, turn), (1.0001, -1.0)):
        residuals = some_residuals(7, 6, 0.0, 0.0)
        residuals.levers[:] = lever
        residuals.values[:, 0], residuals.values[:, 1] = share * (1.0 + lever * turn**3 / 6.0), 0.0
        assert feasibility._bound(residuals, np.ones(6), turn, 0.7).reach == pytest.approx(reach)


def test_rounding_widens_what_the_weights_allow():
    """Four blocks without a residual: the sum is at most four, and what rounding may add."""
    residuals = some_residuals(6, 6, 1.0, 0.0)
    residuals.values[:], residuals.levers[:] = 0.0, 0.0
    bound = feasibility._bound(residuals, np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0]), 0.9, 0.7)
    assert bound.room == pytest.approx(4.0 * (1.0 + 1e-9), rel=1e-13)


def test_what_no_residual_holds_back_turns_as_far_as_the_region():
    """Nothing tells the turn about the third axis: the ellipsoid has no bound there, the region has."""
    residuals = some_residuals(1, 9, 30.0, 0.0, 0.01)
    residuals.jacobian[:, :, 2] = 0.0
    bound = feasibility._bound(residuals, np.ones(9), 0.4, 0.7)
    assert bound.reach == pytest.approx(0.4)
    assert bound.radius == pytest.approx(0.4 + np.linalg.norm(bound.lowest[:3]), rel=1e-6)


def test_without_weights_nothing_is_bounded():
    bound = feasibility._bound(some_residuals(2), np.zeros(9), 0.4, 0.7)
    assert (bound.lowest == 0.0).all() and (bound.inverse == 0.0).all()
    assert bound.reach == pytest.approx(0.4) and bound.radius == pytest.approx(0.4)


# -- the extent of an ellipsoid ---------------------------------------------------------------------------------------


def a_bound(lowest, stiffness, room, turn=1.0, shift=1.0, reach=1.0):
    """An ellipsoid with the axes of the step: half axes are the root of room over the stiffnesses (6,)."""
    normal = np.diag(np.asarray(stiffness, float))
    return feasibility._Bound(np.asarray(lowest, float), normal, np.linalg.inv(normal), room, turn, shift, reach, 1.0)


def test_the_extent_of_a_row_is_the_half_width_of_the_ellipsoid_along_it():
    bound = a_bound(np.zeros(6), [1.0, 4.0, 9.0, 16.0, 25.0, 36.0], 2.0)
    for p in range(6):
        row = np.zeros(6)
        row[p] = 3.0
        assert feasibility._extent(bound, row) == pytest.approx(3.0 * np.sqrt(2.0) / (p + 1))
    assert feasibility._extent(bound, np.ones(6)) == pytest.approx(np.sqrt(2.0 * sum(1.0 / k**2 for k in range(1, 7))))


def test_of_an_inverse_that_is_off_the_extent_takes_the_rest_from_the_region():
    exact = a_bound(np.zeros(6), [4.0] * 6, 2.0, turn=0.3, shift=5.0)
    off = exact._replace(inverse=exact.inverse * 0.9)
    for p, most in ((0, 0.3), (2, 0.3), (3, 5.0), (5, 5.0)):
        row = np.eye(6)[p]
        # A tenth of the row is not explained; the rest is 0.9 times as long.
        assert feasibility._extent(off, row) == pytest.approx(0.1 * most + 0.9 * np.sqrt(2.0) / 2.0)


class TestMissing:
    """A block of one row is off by ``value``, less what a step along the first component, the turn, takes off."""

    def misses(self, value, lowest=0.0, room=0.0, lever=0.0, block=0, turn=0.5, reach=1.0, slope=1.0):
        residuals = feasibility._room_for(feasibility.BLOCKS)
        for part in residuals[:4]:
            part[:] = 0.0
        residuals.values[block, 0], residuals.jacobian[block, 0, 0] = value, slope
        residuals.levers[block] = lever
        bound = a_bound([lowest, 0, 0, 0, 0, 0], [1.0] * 6, room, reach=reach)
        return feasibility._misses_everywhere(residuals, bound, turn)

    @pytest.mark.parametrize('block', range(feasibility.BLOCKS))
    @pytest.mark.parametrize('way', [1.0, -1.0])
    def test_beyond_one_by_more_than_the_ellipsoid_gives_way(self, block, way):
        for beyond, expected in ((-1e-6, False), (1e-6, True)):
            assert self.misses(way * (1.0 + beyond), block=block) is expected
            assert self.misses(way * (1.0 + 0.3 + beyond), way * 0.3, block=block) is expected, 'at the lowest step'
            assert self.misses(way * (1.0 + 0.2 + beyond), room=0.04, block=block) is expected
            assert self.misses(way * (1.0 + 0.6 + beyond), room=0.04, slope=3.0, block=block) is expected

    def test_a_lever_lets_it_bend_by_half_the_square_of_the_turn(self):
        for beyond, expected in ((-1e-6, False), (1e-6, True)):
            assert self.misses(1.0 + 0.5 * 8.0 * 0.5**2 + beyond, lever=8.0) is expected
            assert self.misses(1.0 + 0.5 * 8.0 * 0.2**2 + beyond, lever=8.0, reach=0.2) is expected

    def test_two_rows_of_a_block_are_one_length(self):
        residuals = feasibility._room_for(feasibility.BLOCKS)
        for part in residuals[:4]:
            part[:] = 0.0
        residuals.jacobian[1] = np.eye(2, 6)
        still = a_bound(np.zeros(6), [1.0] * 6, 0.01)
        for beyond, expected in ((-1e-6, False), (1e-6, True)):
            # Each row gives way by 0.1, both together by the root of two of these.
            residuals.values[1] = np.array([0.6, 0.8]) * (1.0 + 0.1 * np.sqrt(2.0) + beyond)
            assert feasibility._misses_everywhere(residuals, still, 0.5) is expected


# -- towards the least largest residual --------------------------------------------------------------------------------


def powers_of(residuals, power):
    """The sum of the powers of squared residuals, as a function of a step (6,)."""
    return lambda step: (((residuals.values - residuals.jacobian @ step) ** 2).sum(axis=1) ** power).sum()


def a_fit(blocks):
    return feasibility._Fit(np.empty(blocks), np.empty(6), np.empty(6))


def newton(residuals, at, power):
    squares, fit = np.empty(len(residuals.own)), a_fit(len(residuals.own))
    worst = feasibility._squared_norms(residuals, at, squares)
    return feasibility._newton(residuals, squares, worst, power, at, fit), squares, fit


@pytest.mark.parametrize('power', [1.0, 2.0, 4.0])
@pytest.mark.parametrize('seed', range(3))
def test_a_newton_step_is_newtons(seed, power):
    residuals = some_residuals(seed, 7, 2.0)
    at = 0.1 * np.random.default_rng(seed).normal(size=6)
    bound, squares, fit = newton(residuals, at, power)
    weights = (squares / squares.max()) ** (power - 1.0)
    np.testing.assert_allclose(fit.weights, weights)
    rows, values = residuals.jacobian, residuals.values - residuals.jacobian @ at
    normal = np.einsum('b,bkp,bkq->pq', weights, rows, rows)
    expected = np.linalg.solve(normal, np.einsum('b,bkp,bk->p', weights, rows, values))
    np.testing.assert_allclose(fit.to_lowest, expected, rtol=1e-5, atol=1e-6)
    least = weights @ ((values - rows @ expected) ** 2).sum(axis=1)
    assert bound == pytest.approx(least / weights.sum(), rel=1e-4)
    # Where the gradient of the sum vanishes to first order.
    function = powers_of(residuals, power)

    def gradient(step):
        return approx_fprime(step, function, 1e-6)

    hessian = np.array([approx_fprime(at, lambda s, p=p: gradient(s)[p], 1e-4) for p in range(6)])
    left = gradient(at) + 0.5 * (hessian + hessian.T) @ fit.to_flattest
    assert np.abs(left).max() <= 2e-3 * np.abs(gradient(at)).max()


def test_blocks_that_a_curve_has_not_weigh_nothing():
    residuals = some_residuals(0, 7, 2.0)
    residuals.own[3], residuals.values[3], residuals.jacobian[3] = 0.0, 0.0, 0.0
    without = feasibility._Residuals(*(np.delete(part, 3, axis=0) for part in residuals))
    found, _, fit = newton(residuals, np.zeros(6), 1.0)
    expected, _, other = newton(without, np.zeros(6), 1.0)
    assert fit.weights[3] == 0.0 and found == pytest.approx(expected)
    np.testing.assert_allclose(fit.to_lowest, other.to_lowest)


def test_residuals_that_no_step_changes_have_no_newton_step():
    residuals = some_residuals(0, 7, 0.0)
    assert newton(residuals, np.zeros(6), 2.0)[0] == -1.0


def one_spring(offset, stiffness=1.0, blocks=2):
    """Two residuals on the first component of a step: one pulls it to ``offset``, one to its opposite."""
    residuals = feasibility._room_for(blocks)
    for part in residuals[:4]:
        part[:] = 0.0
    residuals.own[:] = 1.0
    residuals.jacobian[:, 0, 0] = stiffness
    residuals.values[:2, 0] = stiffness * offset, -stiffness * offset
    return residuals


def search(residuals, start, direction, power=2.0):
    step, squares = np.r_[float(start), np.zeros(5)], np.empty(len(residuals.own))
    worst = feasibility._squared_norms(residuals, step, squares)
    along = np.r_[float(direction), np.zeros(5)]
    found, gained = feasibility._line_search(residuals, squares, worst, power, step, along)
    return step[0], squares, found, gained


class TestLineSearch:
    """Springs that pull to 2 and to -2: from 1 the squares are 1 and 9."""

    def test_it_goes_the_whole_way_where_the_sum_falls(self):
        at, squares, worst, gained = search(one_spring(2.0), 1.0, -1.0)
        assert at == 0.0 and squares.tolist() == [4.0, 4.0] and worst == 4.0
        assert gained == pytest.approx(1.0 - (2 * 4.0**2) / (1.0 + 9.0**2))

    def test_it_goes_less_far_where_the_sum_would_rise(self):
        at, squares, worst, gained = search(one_spring(2.0), 1.0, -4.0)
        # The whole way leads to -3, 0.4 of it to -0.6.
        assert at == pytest.approx(1.0 - 4.0 * MINIMAX.shorter)
        np.testing.assert_allclose(squares, [2.6**2, 1.4**2])
        assert worst == pytest.approx(2.6**2)
        assert gained == pytest.approx(1.0 - (2.6**4 + 1.4**4) / 82.0)

    def test_it_stays_where_the_sum_only_rises(self):
        at, squares, worst, gained = search(one_spring(2.0), 1.0, 1.0)
        assert (at, worst, gained) == (1.0, 9.0, 0.0) and squares.tolist() == [1.0, 9.0]

    def test_a_step_that_is_too_short_is_not_taken(self):
        """The sum falls from 1 up to -1, and the shortest step that is tried leads a little less far, or farther."""
        lengths = MINIMAX.shorter ** np.arange(20)
        shortest = lengths[lengths > MINIMAX.shortest].min()
        assert search(one_spring(2.0), 1.0, -1.9 / shortest)[0] == pytest.approx(1.0 - 1.9)
        assert search(one_spring(2.0), 1.0, -2.1 / shortest)[0] == 1.0


def test_linear_residuals_may_exceed_one_by_what_the_longest_lever_bends():
    residuals = some_residuals(3)
    step = np.array([0.1, -0.2, 0.3, 5.0, 6.0, 7.0])
    expected = (1.0 + 0.5 * residuals.levers.max() * (0.1**2 + 0.2**2 + 0.3**2)) ** 2
    assert feasibility._bent(residuals, step) == pytest.approx(expected)


def approach(residuals, turn=-1.0, shift=1.0, start=None):
    step, fit = np.zeros(6) if start is None else start, a_fit(len(residuals.own))
    return feasibility._approach(residuals, step, turn, shift, fit), step, fit


class TestApproach:
    def test_two_springs_end_in_their_middle(self):
        residuals = one_spring(0.6)
        residuals.values[:, 0] += 5.0  # both pull to 5 as well
        none, step, _ = approach(residuals)
        assert not none and step[0] == pytest.approx(5.0, abs=0.4)
        squares = np.empty(2)
        assert feasibility._squared_norms(residuals, step, squares) <= MINIMAX.below_one

    def test_what_no_step_changes_is_left_open(self):
        residuals = some_residuals(0, 7, 0.0, 0.0, 9.0)
        assert not approach(residuals)[0] and not approach(residuals, turn=0.5)[0]

    def test_springs_that_pull_apart_by_more_than_two_have_no_common_step(self):
        for apart, none in ((0.99, False), (1.01, True)):
            residuals = one_spring(apart)
            residuals.values[:, 0] += 5.0
            assert approach(residuals)[0] is none
            for turn in (0.0, 0.5, 10.0):
                assert approach(residuals, turn=turn)[0] is none

    def test_what_misses_by_little_is_refuted_by_those_that_miss_alone(self):
        """With any weight on the four that are content the mean would be below one."""
        residuals = one_spring(1.01, blocks=6)
        residuals.values[2:, 0] = 0.1
        assert approach(residuals, turn=0.5)[0]

    def test_what_is_refuted_has_its_weights_in_the_fit(self):
        """Four that hardly pull, without which two do so by 1.5 each."""
        residuals = one_spring(1.5, blocks=6)
        residuals.values[2:, 0] = 0.1
        none, _, fit = approach(residuals, turn=1.0)
        weights = fit.weights / fit.weights.sum()
        assert none and weights[:2] == pytest.approx(0.5, abs=0.05) and weights[2:].max() < 0.02

    def test_what_may_bend_is_not_refuted(self):
        """1.2 times too far apart; that they do not bend is known to the third order, a sixth of the lever."""
        for lever, none in ((1.1, True), (1.3, False)):
            residuals = one_spring(1.2)
            residuals.levers[:] = lever
            assert approach(residuals, turn=1.0)[0] is none

    @pytest.mark.parametrize(('stiffness', 'none'), [(60.0, True), (0.0, False)])
    def test_what_is_refuted_only_as_far_as_it_turns_needs_what_holds_the_turn(self, stiffness, none):
        """Two are pulled 1.2 apart, and a turn would bend them. Others, that are content, leave the set no turn."""
        residuals = one_spring(1.2, blocks=14)
        residuals.jacobian[:2] = np.eye(6)[3]
        residuals.levers[:2] = 4.0
        for p in range(6):
            residuals.jacobian[2 + 2 * p, 0], residuals.jacobian[3 + 2 * p, 1] = np.eye(6)[[p, p]] * (
                stiffness if p < 3 else 0.01
            )
        assert approach(residuals, turn=1.0)[0] is none

    def test_the_largest_of_many_residuals_is_made_least(self):
        """Of random sets in which the minimax is known by linear programming, none is told wrong."""
        told = set()
        for seed in range(12):
            rng = np.random.default_rng(seed)
            residuals = some_residuals(seed, 9, 1.0, 0.0, 1.3)
            residuals.jacobian[:, 1], residuals.values[:, 1] = 0.0, 0.0
            rows, values = residuals.jacobian[:, 0], residuals.values[:, 0] * rng.uniform(0.9, 1.6)
            residuals.values[:, 0] = values
            ones = np.ones((9, 1))
            least = linprog(
                np.r_[np.zeros(6), 1.0],
                np.block([[rows, -ones], [-rows, -ones]]),
                np.r_[values, -values],
                bounds=[(None, None)] * 7,
            ).fun
            none, step, _ = approach(residuals, turn=10.0)
            told.add(none)
            if none:
                assert least > 1.0
            else:
                assert least < 1.01
                if least < 0.99:
                    assert np.abs(values - rows @ step).max() <= 1.0
        assert told == {True, False}
