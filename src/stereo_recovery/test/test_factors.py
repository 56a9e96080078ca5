"""What ties edges to each other: lines between points (column, row, disparity) as both images show them."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.segments import Segments
from stereo_recovery.estimation.factors import (
    Factors,
    collinear_factors,
    end_factors,
    junction_factors,
    rounded_corner_factors,
)
from stereo_recovery.estimation.settings import DOUBTFUL_PRIOR, JUNCTION_PRIOR, T_PRIOR
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.settings import SEEN_AS_ONE
from stereo_recovery.matching.stereo_segments import StereoSegments


def seen(lines: list, shown_right: list | None = None) -> tuple[StereoSegments, np.ndarray]:
    """Matched segments of lines, and their true a, b along the left one; ``shown_right`` : what the right image shows
    of them, if other than that."""
    ends = np.array(lines, float)
    other = ends if shown_right is None else np.array(shown_right, float)
    left = Segments.between(ends[..., :2], 0.02)
    right = Segments.between(np.stack([other[..., 0] - other[..., 2], other[..., 1]], axis=-1), 0.02)
    index = np.arange(len(ends), dtype=np.int32)
    d = ends[..., 2]
    matches = Matches(index, index, np.column_stack([d[:, 0], d.mean(axis=1), d[:, 1]]), ends[..., 1], np.ones(len(d)))
    slope = (d[:, 1] - d[:, 0]) / left.length
    x = np.stack([d.mean(axis=1), slope], axis=1)
    return StereoSegments.of(matches, (left, right)), x


def roughly(x: np.ndarray, sigma: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns with a covariance: disparity to a sigma, its slope to a hundredth of that."""
    return x, np.tile(np.diag([sigma, 0.01 * sigma]) ** 2, (len(x), 1, 1))


def residuals(factors: Factors, x: np.ndarray) -> np.ndarray:
    """What true unknowns leave of each statement."""
    other = np.where(factors.other[:, None] >= 0, factors.other_row * x[factors.other], 0.0)
    return factors.value - (factors.row * x[factors.edge]).sum(axis=1) + other.sum(axis=1)


CORNER = (100.0, 100.0, 40.0)


def test_two_edges_that_meet_in_both_images_have_one_disparity_there():
    pair, x = seen([(CORNER, (180.0, 104.0, 44.0)), (CORNER, (95.0, 170.0, 43.0))])
    factors = junction_factors(pair, roughly(x))
    assert factors.prior.tolist() == [JUNCTION_PRIOR]
    assert {int(factors.edge[0]), int(factors.other[0])} == {0, 1}
    assert residuals(factors, x) == pytest.approx(0.0, abs=1e-6)


def test_how_likely_a_junction_is_one_follows_from_what_the_other_image_shows_there():
    across, down = (CORNER, (180.0, 104.0, 44.0)), (CORNER, (95.0, 170.0, 43.0))
    far = ((95.0, 130.0, 41.0), (91.0, 190.0, 44.0))
    pair, x = seen([across, down], [across, far])
    assert junction_factors(pair, roughly(x)).prior.tolist() == [SEEN_AS_ONE]
    # In the right image the first edge ends at another one.
    third = ((60.0, 80.0, 0.0), (62.0, 130.0, 0.0))
    pair, x = seen([across, down, ((300.0, 80.0, 240.0), (302.0, 130.0, 240.0))], [across, far, third])
    assert (
        DOUBTFUL_PRIOR in junction_factors(pair, roughly(x)).prior
        or T_PRIOR in junction_factors(pair, roughly(x)).prior
    )
    # The other one goes on: it may hide the first.
    through = ((100.0, 60.0, 40.0), (100.0, 140.0, 40.0))
    pair, x = seen([across, through])
    assert set(junction_factors(pair, roughly(x)).prior.tolist()) == {T_PRIOR}


def test_where_the_right_image_alone_shows_a_corner_the_better_known_edge_tells_where_the_left_one_has_it():
    """The other one may slope as it will: it is asked where the corner is, and not where its slope puts it."""
    across, down = ((100.0, 100.0, 60.0), (180.0, 102.0, 64.0)), ((100.0, 100.0, 60.0), (95.0, 170.0, 63.0))
    # The left chains end before the corner.
    pair, x = seen([((108.0, 100.2, 60.4), across[1]), ((99.3, 110.0, 60.43), down[1])], [across, down])
    off = x + [[8.0, 0.3], [0.0, 0.0]]
    covariance = roughly(x)[1] * np.array([10000.0, 1.0])[:, None, None]
    factors = junction_factors(pair, (off, covariance))
    assert len(factors) == 1
    assert residuals(factors, x) == pytest.approx(0.0, abs=0.02)


def test_the_ends_of_a_level_edge_give_its_disparity_unless_its_neighbours_do():
    pair, x = seen([((100.0, 100.0, 40.0), (180.0, 102.0, 44.0))])
    factors = end_factors(pair)
    assert len(factors) == 2
    assert np.abs(residuals(factors, x)).max() < 1e-6
    pair, _ = seen([(CORNER, (180.0, 102.0, 44.0)), (CORNER, (95.0, 170.0, 43.0))])
    factors = end_factors(pair)
    # At the corner the junction tells, and the steep edge needs no ends.
    assert factors.edge.tolist() == [0]


def test_ends_at_different_heights_are_hardly_one_point():
    level, shorter = ((100.0, 100.0, 40.0), (180.0, 116.0, 44.0)), ((130.0, 106.0, 41.5), (180.0, 116.0, 44.0))
    pair, _ = seen([level], [shorter])
    first, last = end_factors(pair).prior
    assert first < 0.5 < last


def test_lines_that_cross_beyond_their_chains_in_both_images_meet_there():
    across = ((112.0, 100.6, 40.6), (180.0, 104.0, 44.0))
    down = ((99.2, 112.0, 40.5), (95.0, 170.0, 43.0))
    pair, x = seen([across, down])
    factors = rounded_corner_factors(pair)
    assert len(factors) == 1
    assert np.abs(residuals(factors, x)).max() < 0.05
    # Those that meet in an image are told to meet there.
    pair, x = seen([(CORNER, (180.0, 104.0, 44.0)), (CORNER, (95.0, 170.0, 43.0))], [across, down])
    assert len(junction_factors(pair, roughly(x))) == 1
    assert len(rounded_corner_factors(pair)) == 0
    # Too far from the crossing of the lines that is no corner.
    pair, x = seen([((150.0, 102.5, 42.5), (180.0, 104.0, 44.0)), down])
    assert len(rounded_corner_factors(pair)) == 0


def test_parts_of_a_level_line_have_one_line_of_disparity():
    first, second = ((100.0, 100.0, 40.0), (150.0, 102.0, 42.0)), ((160.0, 102.4, 42.4), (200.0, 104.0, 44.0))
    pair, x = seen([first, second])
    factors = collinear_factors(pair)
    assert len(factors) == 2
    assert factors.with_next.tolist() == [True, False], 'they are one line or not'
    assert np.abs(residuals(factors, x)).max() < 1e-6
    beside = ((160.0, 108.0, 42.4), (200.0, 109.6, 44.0))
    assert len(collinear_factors(seen([first, beside])[0])) == 0
    # Steep parts know their own disparity.
    steep = [((100.0, 100.0, 40.0), (102.0, 150.0, 42.0)), ((102.4, 160.0, 42.4), (104.0, 200.0, 44.0))]
    assert len(collinear_factors(seen(steep)[0])) == 0
