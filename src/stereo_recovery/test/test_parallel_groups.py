"""Parallel edges tell each other their direction: exact lines in both images, disparities with known noise."""

from __future__ import annotations

import numpy as np

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.curves.curve import Curve
from stereo_recovery.detection.segments import Segments
from stereo_recovery.estimation.estimate import Estimate, OwnLines, estimate
from stereo_recovery.estimation.factors import Factors
from stereo_recovery.estimation.parallel_groups import parallel_factors

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
UP = np.array([0.15, -0.9, 0.41]) / np.linalg.norm([0.15, -0.9, 0.41])
SLOPE_SIGMA = 0.004


def seen(
    middles: np.ndarray, directions: np.ndarray, seed: int | None, length: float = 0.008
) -> tuple[OwnLines, Segments]:
    """Edges in space as both images show them; the slope of the disparity is off by its sigma; exact without a seed."""
    n = len(middles)
    noise = 0.0 if seed is None else SLOPE_SIGMA * np.random.default_rng(seed).normal(size=n)
    ends = np.stack([middles - 0.5 * length * directions, middles + 0.5 * length * directions], axis=1)
    pixels = RIG.left.project(ends.reshape(-1, 3)).reshape(n, 2, 2)
    run = pixels[:, 1] - pixels[:, 0]
    span = np.linalg.norm(run, axis=1)
    extent = np.stack([-0.5 * span, 0.5 * span], axis=1)
    many = np.arange(n)
    left = Segments(
        np.tile([0, 20], (n, 1)),
        many,
        pixels.mean(axis=1),
        run / span[:, None],
        extent,
        np.full(n, 0.01),
        np.zeros(n),
        np.full(n, 20.0),
        np.tile([0.01, 0.002], (n, 1)),
        np.full(n, 40.0),
        np.full(n, -1, np.int32),
    )
    disparity = RIG.left.fx * RIG.baseline / ends[..., 2]
    slope = (disparity[:, 1] - disparity[:, 0]) / span
    noisy = np.stack([disparity.mean(axis=1), slope + noise], axis=1)
    information = np.tile(np.diag([0.01**-2.0, SLOPE_SIGMA**-2.0]), (n, 1, 1))
    return OwnLines(information, np.einsum('nij,nj->ni', information, noisy), extent), left


def told(lines: OwnLines, left: Segments, curves: list[Curve], rounds: int = 1) -> Estimate:
    """The edges, with what parallel groups say of them, looked for so often."""
    covariance = np.linalg.inv(lines.information)
    known = by_themselves = np.einsum('nij,nj->ni', covariance, lines.vector), covariance
    for _ in range(rounds):
        factors = parallel_factors(left, np.arange(len(left)), known, by_themselves, curves, RIG)
        found = estimate(lines, factors, np.zeros(len(factors), bool))
        known = found.x, found.covariance
    return found


def off(found: Estimate, middles: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """How far the slopes of the disparities are off, in what was sigma at first."""
    exact, _ = seen(middles, directions, None)
    return (found.x[:, 1] - exact.vector[:, 1] / exact.information[:, 1, 1]) / SLOPE_SIGMA


def alone(lines: OwnLines) -> Estimate:
    """The edges by themselves."""
    return estimate(lines, Factors.none(), np.zeros(0, bool))


def places(count: int) -> np.ndarray:
    return np.random.default_rng(7).uniform([-0.03, -0.03, 0.23], [0.06, 0.03, 0.28], (count, 3))


def circle(normal: np.ndarray) -> Curve:
    first = np.cross(normal, [0.0, 0.0, 1.0])
    spread = np.diag([1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-5]) ** 2
    none = np.zeros(0, bool)
    centre = np.array([0.0, 0.0, 0.25])
    return Curve(centre, normal, first / np.linalg.norm(first), np.full(2, 0.01), spread, 0.01, none, none)


def test_parallel_short_edges_know_their_direction_together():
    middles, directions = places(12), np.tile(UP, (12, 1))
    lines, left = seen(middles, directions, 1)
    found = told(lines, left, [])
    before, after = (np.sqrt(np.mean(off(some, middles, directions) ** 2)) for some in (alone(lines), found))
    assert after < 0.4 * before
    sigma = np.sqrt(found.covariance[:, 1, 1]) / SLOPE_SIGMA
    assert (np.abs(off(found, middles, directions)) < 3.0 * sigma).all()


def test_edges_that_were_told_do_not_tell_it_again_as_their_own():
    """However often groups are looked for, slopes are as far off as their covariances say: no evidence counts twice."""
    middles, directions = places(12), np.tile(UP, (12, 1))
    squares: dict[int, list[float]] = {1: [], 4: []}
    for seed in range(40):
        lines, left = seen(middles, directions, seed)
        for rounds, values in squares.items():
            found = told(lines, left, [], rounds)
            sigma = np.sqrt(found.covariance[:, 1, 1]) / SLOPE_SIGMA
            values.append(float(np.mean((off(found, middles, directions) / sigma) ** 2)))
    assert np.mean(squares[1]) < 1.2
    assert np.mean(squares[4]) < 1.2


def test_the_axis_of_a_circle_tells_an_edge_that_is_parallel_to_it():
    # Two edges, so that there is a share of edges that run along the axis.
    middles, directions = places(2), np.tile(UP, (2, 1))
    lines, left = seen(middles, directions, 2)
    before, after = alone(lines), told(lines, left, [circle(UP)])
    rms = [np.sqrt(np.mean(off(some, middles, directions) ** 2)) for some in (before, after)]
    assert rms[1] < 0.4 * rms[0]
    assert (after.covariance[:, 1, 1] < 0.2 * before.covariance[:, 1, 1]).all()


def test_edges_of_no_common_direction_stay_as_they_are():
    directions = np.random.default_rng(3).normal(size=(6, 3))
    directions[:, 2] *= 0.3
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lines, left = seen(places(6), directions, 4)
    np.testing.assert_allclose(told(lines, left, []).x, alone(lines).x, rtol=1e-12)


def test_an_edge_between_parallel_ones_whose_line_runs_elsewhere_is_not_turned():
    middles, directions = places(9), np.tile(UP, (9, 1))
    directions[4] = [0.8, -0.6, 0.0]
    lines, left = seen(middles, directions, 5)
    found, before = told(lines, left, []), alone(lines)
    np.testing.assert_allclose(found.x[4], before.x[4], rtol=1e-12)
    assert not np.allclose(found.x[0], before.x[0], rtol=1e-9)


def test_edges_with_wrong_slopes_make_no_edge_be_told_twice():
    """A slope that is off by ten sigma makes its edge seed the group of its neighbours again."""
    middles, directions = places(24), np.tile(UP, (24, 1))
    lines, left = seen(middles, directions, 8)
    lines.vector[::6, 1] += 10.0 / SLOPE_SIGMA
    covariance = np.linalg.inv(lines.information)
    known = np.einsum('nij,nj->ni', covariance, lines.vector), covariance
    factors = parallel_factors(left, np.arange(24), known, known, [], RIG)
    assert sorted(factors.edge) == list(range(24))
    exact, _ = seen(middles, directions, None)
    slope = exact.vector[:, 1] / exact.information[:, 1, 1]
    true = np.stack([exact.vector[:, 0] / exact.information[:, 0, 0], slope], axis=1)
    off = factors.value - np.einsum('ki,ki->k', factors.row, true[factors.edge])
    assert (np.abs(off) < 4.0 * factors.sigma).all()


def test_an_edge_between_two_directions_is_told_by_the_likelier_group_alone():
    """Directions that look alike in the image, and recede differently: an edge's own slope says which is its."""
    other = np.array([UP[0], UP[1], UP[2] - 0.5])
    directions = np.concatenate([np.tile(UP, (12, 1)), np.tile(other / np.linalg.norm(other), (12, 1))])
    middles = places(24)
    # Both vanishing points are on the picture of this plane, on which the lines of either run to the other as well.
    normal = np.cross(UP, other)
    middles -= np.outer((middles @ normal) / (normal @ normal), normal)
    lines, left = seen(middles, directions, 9)
    found = told(lines, left, [])
    assert len(np.unique(found.factors.edge)) == len(found.factors)
    assert np.sqrt(np.mean(off(found, middles, directions) ** 2)) < 0.5


def test_nothing_is_told_where_there_is_nothing():
    lines, left = seen(np.zeros((0, 3)), np.zeros((0, 3)), 6)
    assert len(told(lines, left, [circle(UP)]).x) == 0
