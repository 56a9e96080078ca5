"""Corners that edges know in space: what joins two of them is an edge, though one image alone shows it."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.detection.junctions import find_junctions
from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.straight_edges import Beside, edges
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.stereo_segments import StereoSegments

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
# Pictures that show nothing beyond the segments.
GREYS = (np.zeros((512, 512), np.float32),) * 2

# A quadrangle of known edges and, below its lower left corner, an edge that leads to the corner of another face.
TOP_LEFT, TOP_RIGHT, LOW_RIGHT, LOW_LEFT, DEEP, DEEP_RIGHT = (
    (100.0, 100.0, 50.0),
    (200.0, 104.0, 51.0),
    (204.0, 200.0, 54.0),
    (103.0, 196.0, 53.0),
    (99.0, 230.0, 40.0),
    (194.0, 234.0, 41.0),
)
KNOWN = (
    (TOP_LEFT, TOP_RIGHT),
    (TOP_RIGHT, LOW_RIGHT),
    (LOW_RIGHT, LOW_LEFT),
    (LOW_LEFT, TOP_LEFT),
    (DEEP, DEEP_RIGHT),
    (DEEP_RIGHT, LOW_RIGHT),
)


def pair(lines: list) -> tuple[Matches, Segments, Segments]:
    """Matched segments of lines between (column, row, disparity); lines of four points have their own right one."""
    left = np.array([[end[:2] for end in line[:2]] for line in lines])
    right = np.array([[(u - d, v) for u, v, d in line[-2:]] for line in lines])
    disparity = left[..., 0] - right[..., 0]
    n = len(lines)
    matches = Matches(
        np.arange(n, dtype=np.int32),
        np.arange(n, dtype=np.int32),
        np.column_stack([disparity[:, 0], disparity.mean(axis=1), disparity[:, 1]]),
        np.sort(left[..., 1], axis=1),
        np.ones(n),
    )
    return matches, Segments.between(left, 0.02), Segments.between(right, 0.02)


def found(matches: Matches, left: Segments, right: Segments) -> list[tuple[np.ndarray, np.ndarray]]:
    """Left ends (2, 2) of the edges, and their disparities (2,)."""
    seen = StereoSegments.of(matches, (left, right))
    lines, (shown, _) = edges(seen, Beside(RIG, GREYS, 0.05))
    return [
        (shown.centre[i] + extent[:, None] * shown.direction[i], a + b * extent)
        for i, extent, (a, b) in zip(lines.left, lines.extent, lines.coefficient)
    ]


def of_ends(first: tuple, last: tuple, among: list) -> list[np.ndarray]:
    """Disparities at these ends (column, row, disparity) of the edges between them, in their order."""
    wanted = np.array([first[:2], last[:2]])
    result = []
    for ends, disparity in among:
        for order in (slice(None), slice(None, None, -1)):
            if np.abs(ends[order] - wanted).max() < 1.5:
                result.append(disparity[order])
    return result


def test_a_true_pair_stays_as_it_is():
    matches, left, right = pair([*KNOWN, (LOW_LEFT, DEEP)])
    result = found(matches, left, right)
    (between,) = of_ends(LOW_LEFT, DEEP, result)
    np.testing.assert_allclose(between, [53.0, 40.0], atol=0.2)
    assert len(result) == len(KNOWN) + 1


@pytest.mark.parametrize('side', [0, 1])
def test_an_edge_between_two_known_corners_needs_but_one_image(side):
    # Another steep edge knows the deep corner.
    matches, left, right = pair([*KNOWN, (DEEP, (103.0, 260.0, 39.0))])
    shift = np.array([[LOW_LEFT[2], 0.0], [DEEP[2], 0.0]])
    segment = np.array([[LOW_LEFT[:2], DEEP[:2]]]) - side * shift
    sides = [left, right]
    ends = np.stack([sides[side].start, sides[side].end], axis=1)
    sides[side] = Segments.between(np.concatenate([ends, segment]), 0.02)
    (between,) = of_ends(LOW_LEFT, DEEP, found(matches, *sides))
    np.testing.assert_allclose(between, [53.0, 40.0], atol=0.3)


def test_a_line_into_whose_middle_another_runs_is_no_edge_between_corners():
    matches, left, right = pair(list(KNOWN))
    ends = np.stack([left.start, left.end], axis=1)
    middle = 0.5 * (np.array(LOW_LEFT[:2]) + DEEP[:2])
    more = np.array([[LOW_LEFT[:2], DEEP[:2]], [middle + [2.0, 0.0], middle + [40.0, 2.0]]])
    assert not of_ends(LOW_LEFT, DEEP, found(matches, Segments.between(np.concatenate([ends, more]), 0.02), right))


def test_edges_that_leave_a_corner_for_different_heights_are_no_pair():
    matches, left, right = pair([*KNOWN, (LOW_LEFT, (110.0, 240.0, 50.0), LOW_LEFT, (110.0, 225.0, 50.0))])
    alone = np.arange(len(KNOWN))
    matches = Matches(
        matches.left[alone], matches.right[alone], matches.disparity[alone], matches.rows[alone], matches.belief[alone]
    )
    assert len(found(matches, left, right)) == len(KNOWN)


def test_a_chain_that_is_lost_beside_another_edge_reaches_their_common_corner():
    # A thin face: its edges meet at (150, 40), and are less than five pixels apart over the last third.
    corner = np.array([150.0, 40.0])
    ends = np.array(
        [
            [[80.0, 140.0], corner],
            [[92.0, 145.0], corner + 0.35 * (np.array([92.0, 145.0]) - corner)],
            [corner, [230.0, 50.0]],
        ]
    )
    segments = Segments.between(ends, 0.02)
    junctions = find_junctions(segments)
    reached = segments.centre[1] + junctions.abscissa[1, 1] * segments.direction[1]
    np.testing.assert_allclose(reached, corner, atol=0.5)
