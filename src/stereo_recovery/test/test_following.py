"""Edges are followed beyond the ends of their chains as far as the pictures go on, and no farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.extents import Extents, followed
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.stereo_segments import StereoSegments

DISPARITY, COLUMN = 30.0, 100.5
SURE = np.diag([1e-4, 1e-8])[None]


def picture(column: float, contrast: np.ndarray) -> np.ndarray:
    """(200, 200) float32: a step along a column, of so many grey levels (200,) in each row."""
    grey = np.full((200, 200), 100.0, np.float32)
    grey[:, int(np.ceil(column)) :] += contrast[:, None]
    return grey


def contrast(first: int, last: int, usual: float = 40.0) -> np.ndarray:
    """(200,) contrast in rows first to last, and none elsewhere."""
    rows = np.arange(200)
    return np.where((rows >= first) & (rows < last), usual, 0.0)


def seen(left: tuple[float, float], right: tuple[float, float]) -> StereoSegments:
    """One edge along a column, whose segments have these first and last rows in the two images."""

    def segment(column: float, rows: tuple[float, float]) -> Segments:
        return Segments.between(np.array([[[column, row] for row in rows]]), 0.02)

    matches = Matches(
        np.zeros(1, np.int32), np.zeros(1, np.int32), np.full((1, 3), DISPARITY), np.array([left]), np.ones(1)
    )
    return StereoSegments.of(matches, (segment(COLUMN, left), segment(COLUMN - DISPARITY, right)))


def rows(shown: StereoSegments, greys: tuple, covariance: np.ndarray = SURE) -> tuple[np.ndarray, Extents]:
    """First and last row of the edge, and its ends."""
    x = np.array([[DISPARITY, 0.0]])
    ends = followed(shown, (x, covariance), greys)
    left = shown.segments[0]
    return left.centre[0, 1] + ends.abscissa[0] * left.direction[0, 1], ends


def pictures(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return picture(COLUMN, left), picture(COLUMN - DISPARITY, right)


def test_an_edge_goes_on_where_one_chain_stops_and_its_picture_does_not():
    whole = contrast(20, 180)
    found, ends = rows(seen((40.0, 160.0), (40.0, 100.0)), pictures(whole, whole))
    assert found == pytest.approx([20.0, 180.0], abs=1.0)
    assert (ends.sigma > 4.0).all()


@pytest.mark.parametrize('share', [0.3, 0.6])
def test_contrast_that_fades_is_enough(share: float):
    fading = contrast(20, 100) + contrast(100, 180, share * 40.0)
    found, _ = rows(seen((40.0, 160.0), (40.0, 100.0)), pictures(contrast(20, 180), fading))
    assert found == pytest.approx([20.0, 180.0], abs=1.0)


def test_an_edge_ends_where_its_contrast_does():
    short = contrast(40, 100)
    found, ends = rows(seen((40.0, 160.0), (40.0, 100.0)), pictures(contrast(40, 160), short))
    assert found == pytest.approx([40.0, 100.0], abs=1.0)
    assert ends.sigma[0] == pytest.approx(4.0, abs=0.2)


def test_one_image_alone_takes_no_edge_beyond_both_chains():
    found, _ = rows(seen((40.0, 160.0), (40.0, 160.0)), pictures(contrast(20, 180), contrast(40, 160)))
    assert found == pytest.approx([40.0, 160.0], abs=1.0)


def test_the_picture_with_the_other_polarity_is_another_edge():
    turned = contrast(40, 100) + contrast(100, 160, -40.0)
    found, _ = rows(seen((40.0, 160.0), (40.0, 100.0)), pictures(contrast(40, 160), turned))
    assert found == pytest.approx([40.0, 100.0], abs=1.0)


def test_an_edge_goes_on_no_farther_than_its_depth_is_known():
    whole = contrast(0, 200)
    # The sigma of the disparity is half a pixel twenty rows beyond the ends.
    slope = 0.5 / 80.0
    found, _ = rows(seen((40.0, 160.0), (40.0, 160.0)), pictures(whole, whole), np.diag([1e-6, slope**2])[None])
    assert found == pytest.approx([20.0, 180.0], abs=1.0)


def test_edges_end_inside_the_pictures():
    whole = contrast(0, 200)
    found, _ = rows(seen((40.0, 160.0), (40.0, 160.0)), pictures(whole, whole))
    assert (found >= 0.0).all() and (found <= 199.0).all()


def test_a_plain_picture_takes_nothing_away():
    plain = np.zeros((200, 200), np.float32)
    found, ends = rows(seen((40.0, 160.0), (50.0, 150.0)), (plain, plain))
    assert found == pytest.approx([50.0, 150.0], abs=1e-9)
    assert ends.sigma == pytest.approx(np.full((1, 2), 4.0))


def test_what_hides_an_edge_from_the_left_eye_ends_it():
    whole = contrast(20, 180)
    shown = seen((40.0, 160.0), (40.0, 160.0))
    left = replace(shown.junctions[0], t_junction=np.ones((1, 2), bool))
    found, _ = rows(replace(shown, junctions=(left, shown.junctions[1])), pictures(whole, whole))
    assert found == pytest.approx([40.0, 160.0], abs=1e-9)
