"""Which segments may match, and what a flat edge learns from a parallel one: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.parallels import borrow
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.relaxation import match, relaxation_kernels


def segment(start, end):
    """A row as for matching_kernels.candidates()."""
    run = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
    return [*start, *end, *run, 50.0, 100.0, 20.0]


@pytest.mark.parametrize(
    ('second', 'both'),
    [
        (((100, 60), (100, 90)), True),  # one line, broken
        (((100, 50), (112, 90)), True),  # two edges that meet, both ends where the other image's segment ends
        (((112, 60), (112, 90)), False),  # another line
        (((100, 50), (112, 70)), False),  # they meet, but the other image's segment goes on
    ],
)
def test_two_segments_match_one_only_if_they_can_be_one_edge(second, both):
    left = np.array([segment((100.0, 10.0), (100.0, 50.0)), segment(*second)])
    right = np.array([segment((40.0, 10.0), (40.0, 90.0))])
    node = np.array([[0, 0], [1, 0]], np.int32)
    value = np.array([[60, 60, 60, 10, 50, 1.0], [60, 60, 60, second[0][1], second[1][1], 0.9]])
    chosen = relaxation_kernels.greedy(node, value, np.arange(2), left, right)
    assert list(chosen) == ([0, 1] if both else [0])


def two_edges(turn: float, rise: float = 0.1, slope_sigma: float = 0.1):
    """A well measured edge from (0, 0, 8) to (1, rise, 10), and one parallel to it, turned about y by ``turn``, of
    which one end is known; f = 100, baseline 1. Returns the arguments of borrow() and the latter's true a, b."""
    lines, disparity = [], []
    for origin, run in (
        ((0.0, 0.0, 8.0), (1.0, rise, 2.0)),
        ((1.0, 1e-3, 8.0), (np.cos(turn) + 2 * np.sin(turn), rise, 2 * np.cos(turn) - np.sin(turn))),
    ):
        points = np.array([origin, np.add(origin, run)])
        lines.append(100.0 * points[:, :2] / points[:, 2:])
        disparity.append(100.0 / points[:, 2])
    pixels, d = np.array(lines), np.array(disparity)
    run = pixels[:, 1] - pixels[:, 0]
    length = np.hypot(*run.T)
    zeros, whole = np.zeros(2), np.zeros(2, int)
    segments = Segments(
        np.zeros((2, 2), int),
        whole,
        pixels[:, 0],
        run / length[:, None],
        np.column_stack([zeros, length]),
        zeros,
        zeros,
        zeros + 50.0,
        np.full((2, 2), 1e-4),
        zeros + 20.0,
        np.full(2, -1, np.int32),
    )
    matches = Matches(
        np.arange(2, dtype=np.int32),
        np.arange(2, dtype=np.int32),
        np.column_stack([d[:, 0], d.mean(axis=1), d[:, 1]]),
        np.zeros((2, 2)),
        np.ones(2),
    )
    true = np.column_stack([d[:, 0], (d[:, 1] - d[:, 0]) / length])
    given = true.copy()
    given[1, 1] += 0.5 * slope_sigma
    covariance = np.stack([np.diag([1e-6, 1e-8]), np.diag([1e-4, slope_sigma**2])])
    return (matches, segments, given, covariance, np.full((2, 2), 4.0), np.zeros((0, 4))), true


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


def test_where_parallel_edges_contradict_one_end_the_edge_hangs_on_the_end_that_a_long_parallel_edge_knows():
    """Three edges along the rows at one depth, the last one with 7 px too much disparity at its right end, because a
    short edge there was matched wrongly. At its left end is a long edge, to which another is parallel."""
    ends = np.array(
        [
            [(0, 10), (100, 10)],
            [(0, 30), (100, 30)],
            [(0, 200), (100, 200)],
            [(0, 110), (0, 200)],
            [(150, 110), (150, 200)],
            [(100, 200), (103, 220)],
        ],
        float,
    )
    given = np.array([[50.0, 0.0], [50.0, 0.0], [50.0, 0.07], [50.0, 0.0], [50.0, 0.0], [57.0, 0.35]])
    run = ends[:, 1] - ends[:, 0]
    length, n = np.hypot(*run.T), len(ends)
    zeros = np.zeros(n)
    segments = Segments(
        np.zeros((n, 2), int),
        np.zeros(n, int),
        ends[:, 0],
        run / length[:, None],
        np.column_stack([zeros, length]),
        zeros,
        zeros,
        zeros + 50.0,
        np.full((n, 2), 1e-4),
        zeros + 20.0,
        np.full(n, -1, np.int32),
    )
    at_ends = given[:, :1] + given[:, 1:] * np.column_stack([zeros, 0.5 * length, length])
    index = np.arange(n, dtype=np.int32)
    matches = Matches(index, index, at_ends, np.zeros((n, 2)), np.ones(n))
    covariance = np.stack([np.diag([2.5e-3, 5e-3 / span**2]) for span in length])
    joints = np.array([[2, 0, 3, 90], [2, 100, 5, 0]], float)
    coefficient, _ = borrow(matches, segments, given, covariance, np.full((n, 2), 3.0), joints, offset=0.0)
    assert coefficient[2] == pytest.approx([50.0, 0.0], abs=0.02)
    # Without such a difference neither end is believed more than the other.
    coefficient, _ = borrow(matches, segments, given, covariance, np.full((n, 2), 3.0), joints[:0], offset=0.0)
    assert np.array_equal(coefficient[2], given[2])


def test_what_is_left_over_in_both_images_is_no_match_far_from_all_others():
    """A face with two edges that only one eye sees each: they are not one edge behind the face."""

    def edges(columns, greys):
        n = len(columns)
        ends = np.array([[(u, 20.0), (u, 80.0)] for u in columns])
        zeros = np.zeros(n)
        return (
            ends,
            greys,
            Segments(
                np.zeros((n, 2), int),
                np.arange(n),
                ends[:, 0],
                np.tile([0.0, 1.0], (n, 1)),
                np.column_stack([zeros, zeros + 60.0]),
                zeros,
                zeros,
                zeros + 50.0,
                np.full((n, 2), 1e-3),
                zeros + 20.0,
                np.full(n, -1, np.int32),
            ),
        )

    def picture(shown):
        image = np.full((100, 240), 20.0)
        for (u, _), level in zip(shown[0][:, 0], shown[1]):
            image[20:81, int(u) :] = level
        return image

    left = edges([100.0, 104.0, 130.0, 160.0, 190.0], [90.0, 120.0, 150.0, 180.0, 210.0])
    right = edges([60.0, 86.0, 90.0, 120.0, 150.0], [120.0, 135.0, 150.0, 180.0, 210.0])
    found = match(picture(left), picture(right), left[2], right[2], 1.0, 200.0, 100.0)
    assert not (left[2].start[found.left, 0] - right[2].start[found.right, 0] < 30.0).any()
