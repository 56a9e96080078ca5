"""One estimate of edges that are tied to each other: closed forms, and dense algebra as the referee."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_recovery.estimation.equation_kernels import first_of_edges, probability_of_two
from stereo_recovery.estimation.estimate import OwnLines, estimate, told_prior, without_accidents
from stereo_recovery.estimation.factors import Factors
from stereo_recovery.estimation.normal_equations import NormalEquations


def tied(pairs: list[tuple[int, float, int, float]], prior: float = 0.98, sigma: float = 0.03) -> Factors:
    """Statements that edge e at place s has the disparity of edge f at place r: (e, s, f, r) each."""
    e, s, f, r = (np.array(column) for column in zip(*pairs))
    k = len(pairs)
    one = np.ones(k)
    return Factors(
        e,
        f,
        np.stack([one, s], axis=1),
        np.stack([one, r], axis=1),
        np.zeros(k),
        np.full(k, sigma),
        np.full(k, prior),
        np.full(k, 30.0),
        np.zeros(k, bool),
    )


def measured(disparities: list[tuple[float, float]], sigmas: list[float]) -> OwnLines:
    """Edges from place -50 to 50 whose own lines know the disparities at both ends to these sigmas."""
    ends = np.array([[1.0, -50.0], [1.0, 50.0]])
    information = np.array([ends.T @ ends / sigma**2 for sigma in sigmas])
    vector = np.array([ends.T @ np.array(d) / sigma**2 for d, sigma in zip(disparities, sigmas)])
    return OwnLines(information, vector, np.tile([-50.0, 50.0], (len(sigmas), 1)))


def solved(lines: OwnLines, factors: Factors):
    return estimate(lines, factors, np.zeros(len(factors), bool))


@st.composite
def problems(draw: st.DrawFn):
    """Random edges, and statements about one or two of them, of which some are used."""
    n, k = draw(st.integers(1, 12)), draw(st.integers(0, 20))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    root = rng.normal(size=(n, 2, 2))
    edge = rng.integers(0, n, k)
    other = rng.integers(-1, n, k)
    other[other == edge] = -1
    factors = Factors(
        edge,
        other,
        rng.normal(size=(k, 2)),
        rng.normal(size=(k, 2)),
        rng.normal(size=k),
        rng.uniform(0.1, 1.0, k),
        rng.uniform(0.1, 0.9, k),
        np.full(k, 30.0),
        np.zeros(k, bool),
    )
    return root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2), rng.normal(size=(n, 2)), factors, rng.uniform(size=k) < 0.7


@settings(deadline=None, max_examples=60)
@given(problems())
def test_sparse_normal_equations_are_the_dense_ones(problem):
    information, vector, factors, used = problem
    n, k = len(information), len(factors)
    rows = np.zeros((k, 2 * n))
    for q in range(k):
        rows[q, 2 * factors.edge[q] : 2 * factors.edge[q] + 2] += factors.row[q]
        if factors.other[q] >= 0:
            rows[q, 2 * factors.other[q] : 2 * factors.other[q] + 2] -= factors.other_row[q]
    matrix = np.zeros((2 * n, 2 * n))
    for e in range(n):
        matrix[2 * e : 2 * e + 2, 2 * e : 2 * e + 2] = information[e]
    weight = used / factors.sigma**2
    inverse = np.linalg.inv(matrix + (rows * weight[:, None]).T @ rows)
    x = inverse @ (vector.ravel() + rows.T @ (weight * factors.value))
    found = NormalEquations(information, vector, factors).solve(used)
    np.testing.assert_allclose(found.x.ravel(), x, atol=1e-9)
    blocks = np.stack([inverse[2 * e : 2 * e + 2, 2 * e : 2 * e + 2] for e in range(n)])
    np.testing.assert_allclose(found.covariance, blocks, atol=1e-9)
    np.testing.assert_allclose(found.residual, factors.value - rows @ x, atol=1e-9)
    np.testing.assert_allclose(found.variance, np.einsum('ki,ij,kj->k', rows, inverse, rows), atol=1e-9)


@pytest.mark.parametrize('side', [10, 40])
def test_a_grid_of_edges_stays_sparse(side):
    at = np.arange(side * side).reshape(side, side)
    links = np.concatenate([np.stack([at[:, 1:], at[:, :-1]], -1), np.stack([at[1:], at[:-1]], -1).swapaxes(0, 1)])
    factors = tied([(int(e), 50.0, int(f), -50.0) for e, f in links.reshape(-1, 2)])
    equations = NormalEquations(np.tile(np.eye(2), (side * side, 1, 1)), np.zeros((side * side, 2)), factors)
    # A band would be as wide as the grid.
    assert len(equations.pattern.row) < 15 * side * side


def test_two_edges_that_meet_share_what_they_know():
    lines = measured([(10.0, 10.2), (10.1, 12.0)], [0.1, 0.1])
    found = solved(lines, tied([(0, 50.0, 1, -50.0)]))
    at_corner = found.x[0] @ [1.0, 50.0], found.x[1] @ [1.0, -50.0]
    assert at_corner[0] == pytest.approx(at_corner[1], abs=0.02)
    assert np.mean(at_corner) == pytest.approx(10.15, abs=0.01)
    sigma = np.sqrt([1.0, 50.0] @ found.covariance[0] @ [1.0, 50.0])
    assert sigma == pytest.approx(0.1 / np.sqrt(2.0), rel=0.1)


def test_an_open_edge_is_where_its_corners_are_and_no_more_certain():
    lines = measured([(10.0, 10.0), (20.0, 20.0), (15.0, 15.0)], [0.1, 0.2, 50.0])
    found = solved(lines, tied([(2, -50.0, 0, 50.0), (2, 50.0, 1, -50.0)]))
    assert found.x[2] @ [1.0, -50.0] == pytest.approx(10.0, abs=1e-3)
    assert found.x[2] @ [1.0, 50.0] == pytest.approx(20.0, abs=1e-3)
    sigma = np.sqrt([1.0, 50.0] @ found.covariance[2] @ [1.0, 50.0])
    assert sigma == pytest.approx(np.hypot(0.2, 0.03), rel=0.01)


def test_edges_that_only_one_eye_sees_meet_are_not_bent_to_meet():
    lines = measured([(10.0, 10.0), (14.0, 14.0)], [0.1, 0.1])
    found = solved(lines, tied([(0, 50.0, 1, -50.0)]))
    np.testing.assert_allclose(found.x, [[10.0, 0.0], [14.0, 0.0]], atol=1e-6)
    assert not found.used.any()


def test_of_three_statements_the_one_that_two_contradict_goes():
    lines = measured([(10.0, 10.0), (10.0, 10.0), (16.0, 16.0), (12.0, 12.0)], [0.1, 0.1, 0.1, 50.0])
    factors = tied([(3, -50.0, 0, 50.0), (3, 0.0, 1, 50.0), (3, 50.0, 2, -50.0), (3, 45.0, 0, -50.0)])
    found = solved(lines, factors)
    assert found.used.tolist() == [True, True, False, True]
    np.testing.assert_allclose(found.x[3], [10.0, 0.0], atol=0.01)


def test_what_several_edges_say_together_moves_one_that_each_of_them_would_leave():
    """Each of three that know little agrees with one place; a strip of texture that is known better says another."""
    lines = measured([(0.0, 0.0), (10.0, 10.0)] + [(10.0, 10.0)] * 3, [50.0, 0.1, 2.0, 2.0, 2.0])
    row = np.array([[1.0, 40.0]])
    one = (np.array([25.0]), np.array([1.0]), np.array([0.9]), np.array([30.0]))
    strip = Factors.of_one(np.zeros(1, np.int64), row, *one)
    corners = tied([(0, -50.0, 1, 50.0), *((0, 50.0 - place, place, -50.0) for place in (2, 3, 4))])
    found = solved(lines, Factors.concatenate([corners, strip]))
    assert found.used.tolist() == [True] * 4 + [False]
    np.testing.assert_allclose(found.x[0], [10.0, 0.0], atol=0.02)


def test_a_statement_that_nothing_tests_holds_with_its_prior():
    """What an open edge meets it would meet anywhere: that it does proves nothing."""
    lines = measured([(10.0, 10.0), (15.0, 15.0)], [0.1, 8.0])
    for prior in (0.1, 0.4, 0.6, 0.9):
        factors = tied([(1, 50.0, 0, -50.0)], prior)
        for used in (False, True):
            equations = NormalEquations(lines.information, lines.vector, factors)
            assert equations.decided(np.array([used]))[2][0] == pytest.approx(prior, abs=0.15)


def test_the_clearest_of_neighbouring_statements_goes_first():
    factors = tied([(0, 0.0, 1, 0.0), (1, 0.0, 2, 0.0), (3, 0.0, 4, 0.0)])
    value, scratch = np.array([0.2, 0.1, 0.4]), np.empty(5, np.int64)
    assert first_of_edges(factors.edge, factors.other, np.arange(3), value, scratch).tolist() == [1, 2]


def test_stated_covariances_are_those_of_the_errors():
    """Rings of edges with normal errors: the mean square of normalised errors is that of two unknowns."""
    rng = np.random.default_rng(5)
    n = 40
    ends = np.array([[1.0, -50.0], [1.0, 50.0]])
    squares = []
    for _ in range(30):
        true = np.cumsum(rng.normal(size=n + 1))
        truth = np.stack([true[:-1], true[1:]], axis=1)
        sigmas = rng.uniform(0.05, 0.5, n)
        lines = measured([tuple(d + s * rng.normal(size=2)) for d, s in zip(truth, sigmas)], sigmas.tolist())
        factors = tied([(k, 50.0, k + 1, -50.0) for k in range(n - 1)])
        factors.value[:] = 0.03 * rng.normal(size=n - 1)
        found = solved(lines, factors)
        off = found.x @ ends.T - truth
        spread = ends @ found.covariance @ ends.T
        squares += np.einsum('ni,nij,nj->n', off, np.linalg.inv(spread), off).tolist()
    assert np.mean(squares) == pytest.approx(2.0, rel=0.15)


def test_parts_that_nothing_ties_are_decided_as_if_alone():
    """Two chains of edges with some wrong statements, together and each by itself."""
    rng = np.random.default_rng(8)
    n = 12
    links = [(k, 50.0, k + 1, -50.0) for k in range(n - 1)]
    disparity = np.cumsum(rng.normal(size=(n, 2)), axis=1)
    sigma = rng.choice([0.1, 5.0], n)
    alone = [
        solved(measured(disparity[k : k + 6].tolist(), sigma[k : k + 6].tolist()), tied(links[:5])) for k in (0, 6)
    ]
    together = solved(
        measured(disparity.tolist(), sigma.tolist()), tied([link for k, link in enumerate(links) if k != 5])
    )
    assert together.used.tolist() == [*alone[0].used, *alone[1].used]


def one_by_one(values: list[float], prior: float = 0.7, sigma: float = 0.2) -> Factors:
    """Statements that the disparity of edges 0, 1, ... at their middles has these values."""
    k = len(values)
    middles = np.tile([1.0, 0.0], (k, 1))
    numbers = np.array(values), *(np.full(k, of) for of in (sigma, prior, 30.0))
    return Factors.of_one(np.arange(k), middles, *numbers)


def test_statements_that_known_edges_contradict_are_believed_less_and_confirmed_ones_more():
    count = 40
    x, covariance = np.zeros((count, 2)), np.tile(0.01 * np.eye(2), (count, 1, 1))
    known = np.arange(count) < 30
    for held in (0, 15, 30):
        values = [0.1 if k < held else 12.0 for k in range(count)]
        prior = told_prior(one_by_one(values), known, x, covariance)
        # Ten that the stated prior is worth, and the thirty that are known.
        np.testing.assert_allclose(prior, (10.0 * 0.7 + held) / 40.0, atol=0.02)


def test_where_no_edge_is_known_a_prior_stays():
    prior = told_prior(one_by_one([0.0, 9.0]), np.zeros(2, bool), np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)))
    assert prior.tolist() == [0.7, 0.7]


def about_one(numbers: list[tuple[float, float, float]], prior: list[float], together: list[bool]) -> Factors:
    """(kind, value, sigma): the disparity of edge 0 at its middle, kind 0, or its change over 100 pixels, kind 1."""
    kind, value, sigma = np.array(numbers).T
    k = len(value)
    rows = np.where(kind[:, None] == 0.0, [1.0, 0.0], [0.0, 100.0])
    factors = Factors.of_one(np.zeros(k, np.int64), rows, value, sigma, np.array(prior), np.full(k, 30.0))
    return replace(factors, with_next=np.array(together))


def test_two_numbers_of_one_statement_hold_together_or_not_at_all():
    level = measured([(40.0, 40.0)], [2.0])
    # The place fits, the slope is 20 pixels off over the edge.
    numbers, prior = [(0.0, 40.2, 0.3), (1.0, 20.0, 0.5)], [0.8, 0.8]
    assert solved(level, about_one(numbers, prior, [False, False])).used.tolist() == [True, False]
    found = solved(level, about_one(numbers, prior, [True, False]))
    assert found.used.tolist() == [False, False]
    assert found.holds[0] == found.holds[1] < 0.01
    fitting = solved(level, about_one([numbers[0], (1.0, 0.5, 0.5)], prior, [True, False]))
    assert fitting.used.all()
    assert fitting.holds[0] == fitting.holds[1] > 0.95


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_how_likely_two_numbers_are_is_what_the_rest_predicts_of_both(seed, used, of_two):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(2, 2, 2))
    information, vector = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2), rng.normal(size=(2, 2))
    factors = about_one([(0.0, rng.normal(), 0.5), (1.0, rng.normal(), 0.7)], [0.6, 0.6], [True, False])
    if of_two:
        factors = replace(factors, other=np.ones(2, np.int64), other_row=rng.normal(size=(2, 2)))
    equations = NormalEquations(information, vector, factors)
    chance = probability_of_two(equations._system, equations.solve(np.full(2, used)), 0, used)
    # By the edges' own lines alone.
    own = np.linalg.inv(information)
    mean = np.einsum('nij,nj->ni', own, vector)
    off = factors.value - factors.row @ mean[0] + factors.other_row @ mean[1]
    variance = factors.row @ own[0] @ factors.row.T + factors.other_row @ own[1] @ factors.other_row.T
    total = variance + np.diag(factors.sigma**2)
    inlier = 0.6 * np.exp(-0.5 * off @ np.linalg.solve(total, off)) / (2.0 * np.pi * np.sqrt(np.linalg.det(total)))
    outlier = 0.4 / np.prod(np.sqrt(30.0**2 + 2.0 * np.pi * np.diag(variance)))
    assert chance == pytest.approx(inlier / (inlier + outlier), rel=1e-6, abs=1e-12)


def test_two_numbers_of_a_statement_tell_one_prior():
    count = 40
    x, covariance = np.zeros((count, 2)), np.tile(1e-6 * np.eye(2), (count, 1, 1))
    place = one_by_one([0.1] * count)
    # The places hold; the slopes of all but every third are far off.
    slope = replace(place, row=np.tile([0.0, 100.0], (count, 1)), value=np.where(np.arange(count) % 3 == 0, 0.1, 12.0))
    both = Factors.concatenate([replace(place, with_next=np.ones(count, bool)), slope])
    both = both.select(np.arange(2 * count).reshape(2, count).T.ravel())
    prior = told_prior(both, np.ones(count, bool), x, covariance)
    np.testing.assert_allclose(prior, (10.0 * 0.7 + 14.0) / 50.0, atol=0.02)


@pytest.mark.parametrize(('prior', 'known'), [(0.6, False), (0.98, True)])
def test_what_may_all_be_accident_makes_no_edge_known(prior, known):
    """Its own lines leave the edge open to 8 pixels; the statement by itself says its place to a half."""
    factors = about_one([(0.0, 40.0, 0.5), (1.0, 0.0, 0.5)], [prior, 0.98], [False, False])
    found = solved(measured([(40.0, 40.0)], [8.0]), factors)
    assert found.used.all()
    stated = found.covariance if known else np.linalg.inv(found.lines.information)
    np.testing.assert_allclose(without_accidents(found), stated)
    # Two that agree are not both accidents, and what an edge knows of itself needs no others.
    twice = Factors.concatenate([factors, factors.select(np.array([0]))])
    both = solved(measured([(40.0, 40.0)], [8.0]), twice)
    np.testing.assert_allclose(without_accidents(both), both.covariance)
    sharp = solved(measured([(40.0, 40.0)], [0.5]), factors)
    np.testing.assert_allclose(without_accidents(sharp), sharp.covariance)


def test_what_is_vague_and_likely_is_not_beaten_by_what_is_sharp_and_is_not():
    """A surface that the edge nearly always belongs to, against two ends that less often are one point."""
    factors = about_one(
        [(0.0, 40.0, 6.0), (1.0, 0.0, 12.0), (0.0, 65.0, 0.03)], [0.97, 0.97, 0.7], [True, False, False]
    )
    assert solved(measured([(50.0, 50.0)], [20.0]), factors).used.tolist() == [True, True, False]


@pytest.mark.parametrize('parallel', [0.96, 0.04])
def test_what_one_surface_behind_an_edge_explains_is_one_witness(parallel):
    """The ceiling of a channel: its far end is a corner of the wall behind it, whose strip and contour agree.

    Against these three stands the direction of the ceiling's other edges, whose slope is known to a hundredth.
    """
    lines = measured([(100.0, 100.0), (115.0, 115.0), (99.0, 99.0)], [20.0, 0.1, 0.1])
    meets = tied([(0, 50.0, 1, 0.0), (0, -50.0, 2, 0.0)], sigma=0.3)
    meets = replace(meets, prior=np.array([0.98, 0.4]))
    strip = about_one([(0.0, 107.2, 0.3), (1.0, 16.0, 0.5)], [0.9, 0.9], [True, False])
    strip = replace(strip, spread=np.array([30.0, 37.6]))
    direction = about_one([(1.0, -10.0, 0.02)], [parallel], [False])
    direction = replace(direction, spread=np.array([100.0]))
    found = solved(lines, Factors.concatenate([meets, strip, direction]))
    # A direction that hardly any edge has is no match for the wall.
    is_of_the_wall = parallel < 0.5
    assert found.used.tolist() == [True, *3 * [is_of_the_wall], not is_of_the_wall]
    np.testing.assert_allclose(found.x[0] @ [1.0, -50.0], 99.0 if is_of_the_wall else 125.0, atol=0.5)


def test_edges_of_one_corner_are_one_witness():
    """A shelf behind a pole: two edges of the pole's foot end at one point of the shelf's edge, not in it."""
    lines = measured([(45.0, 45.0), (53.0, 53.0), (53.0, 53.0)], [20.0, 0.1, 0.1])
    meets = tied([(0, 50.0, 1, 0.0), (0, 50.0, 2, 0.0)], prior=0.4)
    wood = about_one([(0.0, 36.0, 0.9), (1.0, 0.0, 3.0)], [0.9, 0.9], [True, False])
    found = solved(lines, Factors.concatenate([meets, replace(wood, spread=np.array([30.0, 37.6]))]))
    assert found.used.tolist() == [False, False, True, True]
