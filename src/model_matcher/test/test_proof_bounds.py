"""How residuals bend when a set turns, and what bounds say of its steps, in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model_matcher.proof import feasibility
from model_matcher.proof.feasibility import ALONG, BLOCKS, FIRST_END, SECOND_END, TILT, Sample
from msgs_py import Pose

UNIT = st.floats(-1.0, 1.0)
VECTOR = st.tuples(UNIT, UNIT, UNIT).map(np.array)
STILL = np.r_[np.eye(3).ravel(), np.zeros(3)]
# Metres across, metres along, radians.
TOLERANCES = np.array([0.1, 0.3, 0.2])


def rotation(vector):
    return Pose.from_rotation_vector(np.asarray(vector, float), np.zeros(3)).rotation


def edge(mid, direction, half):
    return np.r_[mid, np.asarray(direction, float) / np.linalg.norm(direction), half, 0.0, 0.0]


def one_pairing(mid, direction, half):
    """A data feature, and a model edge along z from -2 to 2."""
    data, model = edge(mid, direction, half)[None], edge((0, 0, 0), (0, 0, 1), 2.0)[None]
    return Sample(data, np.zeros(1, np.uint8), TOLERANCES[None].copy(), model)


def linearised(sample, turn, centre):
    residuals = feasibility._room_for(BLOCKS)
    feasibility._linearise(STILL, turn, np.array(centre, float), 0, 0, sample, residuals, 0)
    return residuals


# -- residuals ---------------------------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(VECTOR, VECTOR, VECTOR, VECTOR, st.floats(0.0, 0.5))
def test_after_a_step_residuals_are_their_series_up_to_the_stated_rest(mid, tilt, turning, shift, size):
    turning = size * turning / max(np.linalg.norm(turning), 1e-9)
    sample = one_pairing(mid, np.r_[0.3 * tilt[:2], 1.0], half=0.5)
    centre = np.array([0.2, -0.1, 0.3])
    here = linearised(sample, 2.0, centre)
    step = np.r_[turning, 0.1 * shift]
    moved = STILL.copy()
    feasibility._follow(moved, centre, step)
    turn = float(np.linalg.norm(turning))
    d = sample.data[0]
    back = rotation(turning).T
    axis, (first, second) = np.array([0.0, 0.0, 1.0]), across()
    points = {FIRST_END: d[:3] + d[6] * d[3:6], SECOND_END: d[:3] - d[6] * d[3:6], ALONG: d[:3]}
    for block in range(BLOCKS):
        for row, normal in enumerate((axis,) if block == ALONG else (first, second)):
            if block == TILT:
                exact, widest = normal @ (back @ d[3:6]), np.sin(0.2)
            else:
                # What the moved model's frame shows of the point, and where that lies when the model has not turned.
                seen = moved[:9].reshape(3, 3).T @ (points[block] - moved[9:])
                exact, widest = normal @ seen, 0.1 if block != ALONG else 2.3 - 0.5 * np.cos(0.2)
            linear = here.values[block, row] - here.jacobian[block, row] @ step
            bend = here.bends[block, row]
            square = np.array([[bend[0], bend[1], bend[3]], [bend[1], bend[2], bend[4]], [bend[3], bend[4], bend[5]]])
            once = 0.5 * here.levers[block] * turn**2 + 1e-6
            twice = here.levers[block] * turn**3 / 6.0 + 1e-6
            assert abs(exact / widest - linear) <= once
            assert abs(exact / widest - linear - 0.5 * turning @ square @ turning) <= twice


def across():
    """Two unit vectors across the model edge, in the order of the rows of a block."""
    return np.array(feasibility.perpendiculars(0.0, 0.0, 1.0)).reshape(2, 3)


@settings(max_examples=60, deadline=None)
@given(VECTOR, VECTOR, VECTOR, st.floats(0.0, 1.5))
def test_the_second_order_of_a_turn(normal, arm, turning, size):
    turning = size * turning / max(np.linalg.norm(turning), 1e-9)
    row, bend = np.empty(3), np.empty(6)
    feasibility._turned(*normal, *arm, row, bend)
    assert row @ turning == pytest.approx(normal @ np.cross(turning, arm), abs=1e-12)
    square = np.array([[bend[0], bend[1], bend[3]], [bend[1], bend[2], bend[4]], [bend[3], bend[4], bend[5]]])
    assert 0.5 * turning @ square @ turning == pytest.approx(
        0.5 * normal @ np.cross(turning, np.cross(turning, arm)), abs=1e-12
    )
    rest = normal @ (rotation(-turning) @ arm - arm + np.cross(turning, arm)) - 0.5 * turning @ square @ turning
    bound = np.linalg.norm(turning) ** 3 * np.linalg.norm(normal) * np.linalg.norm(arm) / 6.0
    assert abs(rest) <= bound + 1e-12


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6).map(np.array))
def test_the_least_eigenvalue_is_not_less(lower):
    matrix = np.array([[lower[0], lower[1], lower[3]], [lower[1], lower[2], lower[4]], [lower[3], lower[4], lower[5]]])
    values = np.linalg.eigvalsh(matrix)
    found = feasibility._least_eigenvalue(lower)
    assert found <= values[0] + 1e-9
    assert found >= values.mean() - np.sqrt(2.0 / 3.0) * np.linalg.norm(values - values.mean()) - 1e-6


def test_rounding_makes_the_least_eigenvalue_no_larger():
    for one in (2.0, -3.0):
        assert feasibility._least_eigenvalue(one * np.array([1.0, 0, 1, 0, 0, 1])) == one - 1e-9 * abs(one)
    # Eigenvalues 1, 1, -2: each is the root of 1.5 from their mean, 0, or that of 6 times that of 2 / 3.
    below = feasibility._least_eigenvalue(np.array([1.0, 0.0, 1.0, 0.0, 0.0, -2.0]))
    assert below == pytest.approx(-2.0 * (1.0 + 1e-9), abs=1e-12)


def test_the_least_eigenvalue_is_exact_where_the_others_are_equal():
    assert feasibility._least_eigenvalue(np.array([3.0, 0.0, 3.0, 0.0, 0.0, -1.0])) == pytest.approx(-1.0, abs=1e-6)
    # Eigenvalues 3, 3, -1 along (1, 1, 1).
    turned = 3.0 * np.eye(3) - 4.0 / 3.0 * np.ones((3, 3))
    assert feasibility._least_eigenvalue(turned[np.tril_indices(3)]) == pytest.approx(-1.0, abs=1e-6)


# -- what weights say of steps -----------------------------------------------------------------------------------------


def springs(offsets, stiffness=1.0, lever=0.0):
    """Residuals that are stiffness x (offset - component of the step), for each component: twelve blocks of one row.

    offsets : (6, 2) each component twice, so that what is asked of it may differ
    """
    residuals = feasibility._room_for(12)
    residuals.jacobian[:], residuals.values[:], residuals.bends[:] = 0.0, 0.0, 0.0
    residuals.levers[:], residuals.own[:] = lever, 1.0
    for p in range(6):
        for k in range(2):
            residuals.jacobian[2 * p + k, 0, p] = stiffness
            residuals.values[2 * p + k, 0] = stiffness * offsets[p][k]
    return residuals


def bound_of(residuals, turn, shift=1.0):
    return feasibility._bound(residuals, np.ones(len(residuals.own)), turn, shift)


def test_springs_that_pull_apart_have_no_step():
    apart = np.zeros((6, 2))
    apart[0] = 1.0, -1.0
    # Twelve weights allow a sum of 12: two springs pulled by s each cost 2 s^2.
    assert bound_of(springs(apart, 2.4), 0.5).reach > 0.0
    assert bound_of(springs(apart, 2.5), 0.5).reach < 0.0


@pytest.mark.parametrize('stiffness', [10.0, 20.0, 40.0])
def test_a_stiff_set_turns_by_what_its_weights_allow(stiffness):
    bound = bound_of(springs(np.zeros((6, 2)), stiffness), 0.8)
    # 2 stiffness^2 t^2 <= 12, the region being looked at in 16 slices.
    most = np.sqrt(6.0) / stiffness
    assert most <= bound.reach <= most + 0.8 / 16 + 1e-6
    assert bound.room == pytest.approx(12.0, rel=1e-6)
    assert bound.radius == pytest.approx(most, rel=1e-6)
    np.testing.assert_allclose(bound.lowest, 0.0, atol=1e-12)
    np.testing.assert_allclose(bound.normal, 2.0 * stiffness**2 * np.eye(6))
    np.testing.assert_allclose(bound.normal @ bound.inverse, np.eye(6), atol=1e-6)


def test_steps_lie_about_where_the_sum_is_least():
    offsets = np.zeros((6, 2))
    offsets[1], offsets[5] = 0.3, -0.2
    bound = bound_of(springs(offsets, 30.0), 0.8, 1.0)
    np.testing.assert_allclose(bound.lowest, [0.0, 0.3, 0.0, 0.0, 0.0, -0.2], atol=1e-9)
    assert bound.turn == pytest.approx(0.8 + 0.3) and bound.shift == pytest.approx(1.0 + 0.2)
    most = np.sqrt(6.0) / 30.0
    assert bound.radius == pytest.approx(most, rel=1e-6)
    assert 0.3 + most <= bound.reach <= 0.3 + most + 0.8 / 16 + 1e-6


@pytest.mark.parametrize('lever', [0.0, 2.0, 6.0])
def test_a_set_that_does_not_bend_is_widened_by_the_third_order_only(lever):
    """Pulled so that it is infeasible by 10 %, and free to turn, with a bend that is known to be none."""
    residuals = springs(np.zeros((6, 2)), 0.0, lever)
    residuals.values[:, 0] = 1.1
    turn = 0.5
    bound = bound_of(residuals, turn)
    cost = 12.0 * 1.1**2
    assert bound.reach < 0.0 or lever > 0.0
    if bound.reach >= 0.0:
        high = np.arange(1, 17) * turn / 16
        first = 12.0 * (1.0 + 0.5 * lever * high**2) ** 2 < cost
        second = 12.0 * (1.0 + lever * high**3 / 6.0) ** 2 < cost
        out = first | second
        assert bound.reach == pytest.approx(high[~out].max())
        assert second.sum() > first.sum(), 'the second order says more'
    else:
        assert (1.0 + lever * turn**3 / 6.0) < 1.1


def test_what_bends_towards_the_tolerances_is_not_refuted():
    """All residuals fall by t^2 when the set turns by t: 1.1 - t^2 is one at sqrt(0.1)."""
    for sign, possible in ((-1.0, True), (1.0, False)):
        residuals = springs(np.zeros((6, 2)), 0.0, 4.0)
        residuals.values[:, 0] = 1.1
        residuals.bends[:, 0, [0, 2, 5]] = 2.0 * sign
        assert (bound_of(residuals, 0.4).reach >= np.sqrt(0.1)) == possible


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_a_step_within_all_tolerances_is_within_the_bound(seed):
    """Residuals with a second order of their own, which a step in the region keeps below one."""
    rng = np.random.default_rng(seed)
    blocks, turn, shift = 14, float(rng.uniform(0.05, 0.8)), 1.0
    residuals = feasibility._room_for(blocks)
    residuals.jacobian[:] = rng.normal(size=(blocks, 2, 6)) * 4.0
    residuals.own[:] = 1.0
    step = rng.normal(size=6)
    step[:3] *= turn * rng.uniform(0.0, 1.0) / np.linalg.norm(step[:3])
    step[3:] *= 0.3 / np.linalg.norm(step[3:])
    for b in range(blocks):
        arm, directions = rng.normal(size=3), np.linalg.qr(rng.normal(size=(3, 3)))[0]
        arm *= rng.uniform(0.0, 6.0) / np.linalg.norm(arm)
        residuals.levers[b] = np.linalg.norm(arm)
        exact = rng.normal(size=2)
        exact *= rng.uniform(0.9, 1.0) / np.linalg.norm(exact)
        for k in range(2):
            feasibility._turned(*directions[k], *arm, np.empty(3), residuals.bends[b, k])
            moved = rotation(-step[:3]) @ arm - arm + np.cross(step[:3], arm)
            residuals.values[b, k] = exact[k] + residuals.jacobian[b, k] @ step - directions[k] @ moved
    bound = feasibility._bound(residuals, rng.uniform(0.0, 1.0, blocks), turn, shift)
    size = np.linalg.norm(step[:3])
    assert bound.reach >= size - 1e-9
    assert np.linalg.norm(step[:3] - bound.lowest[:3]) <= bound.radius + 1e-9
    assert (step - bound.lowest) @ bound.normal @ (step - bound.lowest) <= bound.room + 1e-9
    row = rng.normal(size=6)
    assert abs(row @ (step - bound.lowest)) <= feasibility._extent(bound, row) + 1e-9


def test_a_region_is_a_residual_of_its_own():
    residuals = feasibility._room_for(2)
    feasibility._confine(0.5, residuals, 0)
    squares = np.empty(2)
    feasibility._squared_norms(residuals, np.array([0.3, 0.4, 0.5, 9.0, 9.0, 9.0]), squares)
    np.testing.assert_allclose(squares, 1.0, rtol=1e-6)
    assert (residuals.levers == 0.0).all() and (residuals.own == 1.0).all() and (residuals.bends == 0.0).all()
