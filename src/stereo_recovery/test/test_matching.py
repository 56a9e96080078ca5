"""Which pieces may match, and what a flat edge learns from a parallel one: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery import matching_kernels
from stereo_recovery.matching import Matches
from stereo_recovery.parallels import borrow
from stereo_recovery.segmentation import Pieces


def piece(start, end):
    """A row as for matching_kernels.candidates()."""
    run = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
    return [*start, *end, *run, 50.0, 100.0, 20.0]


@pytest.mark.parametrize('second, both', [
    (((100, 60), (100, 90)), True),      # one line, broken
    (((100, 50), (112, 90)), True),      # two edges that meet, both ends where the other image's piece ends
    (((112, 60), (112, 90)), False),     # another line
    (((100, 50), (112, 70)), False),     # they meet, but the other image's piece goes on
])
def test_two_pieces_match_one_only_if_they_can_be_one_edge(second, both):
    left = np.array([piece((100.0, 10.0), (100.0, 50.0)), piece(*second)])
    right = np.array([piece((40.0, 10.0), (40.0, 90.0))])
    node = np.array([[0, 0], [1, 0]], np.int32)
    value = np.array([[60, 60, 60, 10, 50, 1.0], [60, 60, 60, second[0][1], second[1][1], 0.9]])
    chosen = matching_kernels.greedy(node, value, np.arange(2), left, right)
    assert list(chosen) == ([0, 1] if both else [0])


def two_edges(turn: float, rise: float = 0.1, slope_sigma: float = 0.1):
    """A well measured edge from (0, 0, 8) to (1, rise, 10), and one parallel to it, turned about y by ``turn``, of
    which one end is known; f = 100, baseline 1. Returns the arguments of borrow() and the latter's true a, b."""
    lines, disparity = [], []
    for origin, run in (((0.0, 0.0, 8.0), (1.0, rise, 2.0)),
                        ((1.0, 1e-3, 8.0), (np.cos(turn) + 2 * np.sin(turn), rise, 2 * np.cos(turn) - np.sin(turn)))):
        points = np.array([origin, np.add(origin, run)])
        lines.append(100.0 * points[:, :2] / points[:, 2:])
        disparity.append(100.0 / points[:, 2])
    pixels, d = np.array(lines), np.array(disparity)
    run = pixels[:, 1] - pixels[:, 0]
    length = np.hypot(*run.T)
    zeros, whole = np.zeros(2), np.zeros(2, int)
    pieces = Pieces(np.zeros((2, 2), int), whole, pixels[:, 0], run / length[:, None],
                    np.column_stack([zeros, length]), zeros, zeros, zeros + 50.0, np.full((2, 2), 1e-4), zeros + 20.0,
                    np.full(2, -1, np.int32))
    matches = Matches(np.arange(2, dtype=np.int32), np.arange(2, dtype=np.int32),
                      np.column_stack([d[:, 0], d.mean(axis=1), d[:, 1]]), np.zeros((2, 2)), np.ones(2))
    true = np.column_stack([d[:, 0], (d[:, 1] - d[:, 0]) / length])
    given = true.copy()
    given[1, 1] += 0.5 * slope_sigma
    covariance = np.stack([np.diag([1e-6, 1e-8]), np.diag([1e-4, slope_sigma ** 2])])
    return (matches, pieces, given, covariance, np.full((2, 2), 4.0)), true


def test_a_flat_edge_with_one_known_end_takes_the_direction_of_a_parallel_one():
    arguments, true = two_edges(0.0)
    coefficient, covariance = borrow(*arguments, offset=0.0)
    assert coefficient[1] == pytest.approx(true[1], abs=1e-3)
    assert covariance[1, 1, 1] < 1e-4
    assert np.array_equal(coefficient[0], arguments[2][0])


def test_edges_that_do_not_share_a_vanishing_point_lend_nothing():
    arguments, _ = two_edges(0.3)
    coefficient, _ = borrow(*arguments, offset=0.0)
    assert np.array_equal(coefficient, arguments[2])


def test_a_short_steep_edge_takes_its_slope_from_a_parallel_one_known_better():
    arguments, true = two_edges(0.0, rise=3.0, slope_sigma=0.01)
    coefficient, covariance = borrow(*arguments, offset=0.0)
    assert coefficient[1] == pytest.approx(true[1], abs=1e-3)
    assert covariance[1, 1, 1] < 1e-6
    assert np.array_equal(coefficient[0], arguments[2][0])


def test_a_steep_edge_that_is_known_as_well_as_its_parallel_keeps_its_slope():
    arguments, _ = two_edges(0.0, rise=3.0, slope_sigma=1.5e-4)
    coefficient, _ = borrow(*arguments, offset=0.0)
    assert np.array_equal(coefficient, arguments[2])
