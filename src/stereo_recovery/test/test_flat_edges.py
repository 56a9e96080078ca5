"""Where flat edges get their depth from: closed forms with two straight edges and known disparity."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.junctions import Junctions
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges import flat_edges
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.relaxation import SAMPLES, relaxation_kernels


def segments(*lines) -> Segments:
    """Straight segments between given ends ((u, v), (u, v))."""
    ends = np.array(lines, float)
    run = ends[:, 1] - ends[:, 0]
    length = np.hypot(*run.T)
    n = len(ends)
    zeros = np.zeros(n)
    return Segments(
        np.zeros((n, 2), int),
        np.arange(n),
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


def no_corners(found: Segments) -> Junctions:
    n = len(found)
    return Junctions(found.extent.copy(), np.full((n, 2), -1, np.int32), np.zeros((n, 2), bool), np.full((n, 2), 1.5))


def all_matched(n: int) -> Matches:
    index = np.arange(n, dtype=np.int32)
    return Matches(index, index, np.zeros((n, 3)), np.zeros((n, 2)), np.ones(n))


FLAT, STEEP = ((50.0, 100.0), (130.0, 100.0)), ((150.0, 100.0), (160.0, 160.0))


def shifted(line, disparity: float):
    return tuple((u - disparity, v) for u, v in line)


def test_a_flat_edge_whose_chain_ends_early_in_both_images_reaches_the_end_of_the_same_edge():
    left, right = segments(FLAT, STEEP), segments(shifted(FLAT, 30.0), shifted(STEEP, 30.0))
    joints, ends = flat_edges.far_corners(all_matched(2), left, right, no_corners(left))
    assert np.allclose(joints, [[0, 100.0, 1, 0.0]], atol=1e-6)
    assert list(ends) == [1]


def test_it_does_not_when_its_line_misses_that_end_in_one_image():
    left, right = segments(FLAT, STEEP), segments(shifted(FLAT, 30.0), ((118.0, 80.0), (130.0, 160.0)))
    joints, _ = flat_edges.far_corners(all_matched(2), left, right, no_corners(left))
    assert len(joints) == 0


@pytest.mark.parametrize(('disparity', 'allowed'), [(30.0, True), (45.0, False), (5.0, False)])
def test_a_corner_counts_when_the_right_image_ends_there_too(disparity, allowed):
    """The steep edge's disparity puts the corner at u = 150 - disparity; the flat one's chain ends at 118 there."""
    flat = ((50.0, 100.0), (150.0, 100.0))
    left, right = segments(flat, STEEP), segments(((20.0, 100.0), (118.0, 100.0)), shifted(STEEP, disparity))
    known = np.array([False, True])
    coefficient = np.array([[0.0, 0.0], [disparity, 0.0]])
    kept = flat_edges.confirmed(
        np.array([[0, 100.0, 1, 0.0]]), known, coefficient, all_matched(2), left, right, no_corners(right)
    )
    assert list(kept) == [allowed]


def test_rough_ends_are_corners_where_both_images_have_them_and_nothing_where_something_hides_them():
    left, right = segments(FLAT, STEEP), segments(shifted(FLAT, 30.0), shifted(STEEP, 30.0))
    junctions, right_junctions = no_corners(left), no_corners(right)
    junctions.neighbour[0], right_junctions.neighbour[0] = 1, 1
    junctions.abscissa[0, 0] -= 5.0
    right_junctions.abscissa[0, 0] -= 3.0
    junctions.t_junction[0, 1] = True
    disparity, sigma = flat_edges.rough_ends(all_matched(1), left, right, junctions, right_junctions)
    assert disparity[0, 0] == pytest.approx(28.0)
    assert sigma.tolist() == [[flat_edges.MATCH_SIGMA, flat_edges.HIDDEN_SIGMA]]


def test_a_corner_with_one_edge_in_the_left_image_and_with_another_in_the_right_one_tells_no_depth():
    """A face ends where a nearer one hides it; each eye sees another part of it, and another neighbour."""
    left = segments(FLAT, STEEP, ((170.0, 20.0), (175.0, 80.0)))
    right = segments(shifted(FLAT, 30.0), shifted(STEEP, 30.0), ((140.0, 20.0), (145.0, 80.0)))
    junctions, right_junctions = no_corners(left), no_corners(right)
    junctions.neighbour[0, 1], right_junctions.neighbour[0, 1] = 1, 2
    _, sigma = flat_edges.rough_ends(all_matched(3), left, right, junctions, right_junctions)
    assert sigma[0].tolist() == [flat_edges.STRAY_SIGMA, flat_edges.HIDDEN_SIGMA]


@pytest.mark.parametrize(('slope', 'found'), [(0.0, True), (1.4, True), (4.0, True), (8.0, False)])
def test_an_edge_may_recede_steeply_but_hardly_turn_around(slope, found):
    """Upright in the left image; in the right one it leans by this slope: disparity gradients 0, 1.1, 1.8 and 1.94."""
    left = np.array([[100.0, 10.0, 100.0, 50.0, 0.0, 1.0, 50.0, 100.0, 20.0]])
    run = np.array([slope, 1.0]) / np.hypot(slope, 1.0)
    right = np.array([[40.0, 10.0, 40.0 + 40.0 * slope, 50.0, *run, 50.0, 100.0, 20.0]])
    beside = np.tile([50.0, 100.0], (1, SAMPLES, 1))
    node, _ = relaxation_kernels.candidates(left, right, beside, beside, -1000.0, 1000.0, 0.1, -1000.0, 12.0)
    assert bool(len(node)) == found


def test_a_segment_that_matches_part_of_a_longer_one_is_compared_with_that_part():
    """The long segment has another surface beside its upper half; the short one shows only the lower half."""
    left = np.array([[100.0, 50.0, 100.0, 90.0, 0.0, 1.0, 50.0, 100.0, 20.0]])
    right = np.array([[40.0, 10.0, 40.0, 90.0, 0.0, 1.0, 90.0, 180.0, 20.0]])
    beside = np.tile([50.0, 100.0], (1, SAMPLES, 1))
    right_beside = beside.copy()
    right_beside[0, : SAMPLES // 2] = 90.0, 180.0
    _, value = relaxation_kernels.candidates(left, right, beside, right_beside, 0.0, 1000.0, 0.1, -1000.0, 12.0)
    assert value[0, 5] > 0.5


def test_the_nearer_of_two_edges_side_by_side_goes_first_when_it_is_nearly_as_strong():
    """One left edge, two right ones a few pixels apart (an eye sees past the object's side); the nearer has the larger
    disparity."""
    node = np.array([[0, 0], [0, 1]], np.int32)
    value = np.array([[30.0, 30.0, 30.0, 10.0, 50.0, 1.0], [33.0, 33.0, 33.0, 10.0, 50.0, 0.8]])
    first, right_first, right_of = np.array([0, 2]), np.array([0, 1, 2]), np.array([0, 1])
    for strength, order in (((1.0, 0.8), [1, 0]), ((1.0, 0.4), [0, 1])):
        standing = relaxation_kernels.standing(
            node, value, np.array(strength), np.ones(2), first, right_of, right_first
        )
        assert list(np.argsort(-standing)) == order


@pytest.mark.parametrize(('bottom', 'found'), [(50.0, True), (40.0, False)])
def test_an_outline_before_the_backdrop_is_a_candidate_when_both_images_show_it_from_end_to_end(bottom, found):
    """Its own side differs: each eye sees another part of a narrow face."""
    left = np.array([[100.0, 10.0, 100.0, 50.0, 0.0, 1.0, 90.0, 170.0, 20.0]])
    right = np.array([[40.0, 10.0, 40.0, bottom, 0.0, 1.0, 130.0, 169.0, 20.0]])
    beside = [np.tile(table[0, 6:8], (1, SAMPLES, 1)) for table in (left, right)]
    node, _ = relaxation_kernels.candidates(left, right, *beside, 0.0, 1000.0, 0.1, 170.0, 6.0)
    assert bool(len(node)) == found
