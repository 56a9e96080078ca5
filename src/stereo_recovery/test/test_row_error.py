"""Rows that do not agree: what a pair's own corners say of them."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.conics import Ellipse, sampson
from stereo_recovery.detection.segments import Segments
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.row_error import RowError, RowWitnesses, row_error
from stereo_recovery.matching.stereo_segments import StereoSegments

SIZE = (640, 480)


def squares(shift, noise: float = 0.0) -> StereoSegments:
    """Twelve squares at random disparities, the right image's points lowered by shift(u, v) pixels, and noise."""
    rng = np.random.default_rng(3)
    left, right = [], []
    for row in range(3):
        for column in range(4):
            u, v, d = 60.0 + 140.0 * column, 40.0 + 150.0 * row, rng.uniform(20.0, 50.0)
            corner = np.array([[u, v], [u + 60.0, v + 7.0], [u + 55.0, v + 70.0], [u - 4.0, v + 62.0]])
            there = corner - [d, 0.0]
            there[:, 1] += shift(*there.T) + noise * rng.normal(size=4)
            left += [corner[[k, (k + 1) % 4]] for k in range(4)]
            right += [there[[k, (k + 1) % 4]] for k in range(4)]
    ends = np.array(left), np.array(right)
    index = np.arange(len(left), dtype=np.int32)
    disparity = ends[0][..., 0] - ends[1][..., 0]
    matches = Matches(
        index,
        index,
        np.column_stack([disparity[:, 0], disparity.mean(axis=1), disparity[:, 1]]),
        np.sort(ends[0][..., 1], axis=1),
        np.ones(len(index)),
    )
    segments = Segments.between(ends[0], 0.02), Segments.between(ends[1], 0.02)
    return StereoSegments.of(matches, segments)


def test_a_shift_and_a_turn_of_the_rows_are_found():
    found = row_error(squares(lambda u, v: 0.5 + 0.3 * (u - 319.5) / 320.0 - 0.2 * (v - 239.5) / 240.0), SIZE, 0.01)
    assert found.offset == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(found.turn, [0.3, -0.2], atol=0.05)
    assert found.sigma < 0.05
    assert found.count == 48, 'each of twelve squares has four corners, and two edges show each'


def test_an_exact_rig_has_no_error():
    found = row_error(squares(lambda u, v: 0.0 * u), SIZE, 0.01)
    assert found.offset == 0.0
    assert found.sigma == pytest.approx(0.01, abs=0.002)
    assert not found.turn.any()


def test_one_corner_at_two_heights_is_no_error_of_the_rows():
    """What looks like a corner where a contour passes before an edge is at two heights, however well it is seen."""
    seen = squares(lambda u, v: 0.58 + 0.0 * u)
    lonely = StereoSegments(seen.matches.select(np.arange(2)), seen.segments, seen.junctions)
    found = row_error(lonely, SIZE, 0.01)
    assert found.count == 1
    assert found.offset == 0.0
    assert not found.turn.any()


@pytest.mark.parametrize('shift', [-0.6, 0.3])
def test_a_few_wrong_corners_do_not_hide_or_make_an_error(shift):
    def lowered(u, v):
        return np.where(v < 120.0, 2.0, shift) if shift > 0.0 else np.where((u < 120.0) & (v < 120.0), shift, 0.0)

    found = row_error(squares(lowered), SIZE, 0.01)
    expected = shift if shift > 0.0 else 0.0
    assert found.offset == pytest.approx(expected, abs=0.1)


def test_what_single_rows_differ_by_is_their_sigma():
    found = row_error(squares(lambda u, v: 0.0 * u, noise=0.3), SIZE, 0.01)
    assert found.sigma == pytest.approx(0.3, rel=0.35)


def test_nothing_is_known_without_a_match():
    seen = squares(lambda u, v: 0.0 * u)
    none = StereoSegments(Matches.empty(), seen.segments, seen.junctions)
    found = row_error(none, SIZE, 0.2)
    assert (found.offset, found.count) == (0.0, 0)
    assert 0.2 <= found.sigma < 0.5, 'what rigs have that are no better than the least'


def test_further_witnesses_say_as_much_as_corners():
    seen = squares(lambda u, v: 0.0 * u)
    none = StereoSegments(Matches.empty(), seen.segments, seen.junctions)
    rng = np.random.default_rng(5)
    point = rng.uniform(0.0, 1.0, (200, 2)) * SIZE
    off = 0.4 + 0.3 * (point[:, 0] - 319.5) / 320.0 + 0.1 * rng.normal(size=200)
    found = row_error(none, SIZE, 0.01, RowWitnesses(point, off, np.full(200, 0.02)))
    assert found.offset == pytest.approx(0.4, abs=0.03)
    np.testing.assert_allclose(found.turn, [0.3, 0.0], atol=0.05)
    assert found.sigma == pytest.approx(0.1, rel=0.2)


def test_what_is_aligned_lies_at_the_left_rows():
    error = RowError(0.4, np.array([0.2, -0.3]), np.array([319.5, 239.5]), np.array([320.0, 240.0]), 0.1, 9)
    seen = squares(lambda u, v: error.at(np.stack([u, v], axis=-1)))
    right = error.aligned(seen).segments[1]
    np.testing.assert_allclose(right.start[:, 1], seen.segments[0].start[:, 1], atol=0.01)
    np.testing.assert_allclose(right.end[:, 1], seen.segments[0].end[:, 1], atol=0.01)
    circle = Ellipse(
        np.array([[1.0, 0.0, -300.0], [0.0, 1.0, -200.0], [-300.0, -200.0, 300.0**2 + 200.0**2 - 50.0**2]]), 0.1
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 20)
    points = np.stack([300.0 + 50.0 * np.cos(angle), 200.0 + 50.0 * np.sin(angle)], axis=1)
    (moved,) = error.aligned_ellipses([circle])
    np.testing.assert_allclose(sampson(moved.conic, error.without(points)), 0.0, atol=1e-6)
