"""Rows told by arcs: where an ellipse is highest and lowest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_recovery.detection import conic_kernels
from stereo_recovery.detection.conics import Ellipse, sampson, symmetric
from stereo_recovery.detection.edgels import Edgels
from stereo_recovery.detection.segments import Segments, laid_out
from stereo_recovery.matching.arc_rows import arc_rows, level_tangents, paired_arcs
from stereo_recovery.matching.matches import Matches
from stereo_recovery.matching.row_error import RowWitnesses, fitted_error

PARTS = 12
EACH = 10


def on_ellipse(centre, radii, turn: float, angle: np.ndarray) -> np.ndarray:
    """(n, 2) pixels of an ellipse."""
    c, s = np.cos(turn), np.sin(turn)
    along = np.stack([radii[0] * np.cos(angle), radii[1] * np.sin(angle)], axis=1)
    return np.asarray(centre) + along @ np.array([[c, s], [-s, c]])


def an_arc(points: np.ndarray) -> tuple[Edgels, Segments, list[Ellipse]]:
    """Edgels of one arc, as segments of EACH of them."""
    one = np.ones(len(points))
    edgels = Edgels(points, 0.0 * one, one, 0.1 * one, one, one, 0.0 * one, one)
    bounds = laid_out(np.full(len(points) // EACH, EACH))
    ends = points[np.stack([bounds[:, 0], bounds[:, 1] - 1], axis=1)]
    segments = replace(Segments.between(ends, 0.1), bounds=bounds, arc=np.zeros(len(ends), np.int32))
    conic, rms = conic_kernels.fit(points, 4)
    return edgels, segments, [Ellipse(symmetric(conic), rms)]


def a_pair(lower, part: float = 1.0, noise: float = 0.0, seed: int = 4):
    """Matches, segments, ellipses and edgels of an ellipse whose right picture is lower by ``lower(u, v)`` pixels."""
    angle = 2.0 * np.pi * part * (np.arange(PARTS * EACH) + 0.5) / (PARTS * EACH)
    rng = np.random.default_rng(seed)
    left = on_ellipse([300.0, 200.0], [40.0, 25.0], 0.4, angle)
    right = on_ellipse([270.0, 200.0], [38.0, 25.0], 0.45, angle)
    right[:, 1] *= np.ptp(left[:, 1]) / np.ptp(right[:, 1]) if part == 1.0 else 1.0
    right[:, 1] += left[:, 1].mean() - right[:, 1].mean()
    right[:, 1] += lower(*right.T)
    arcs = [an_arc(each + noise * rng.normal(size=each.shape)) for each in (left, right)]
    index = np.arange(PARTS, dtype=np.int32)
    disparity = np.full((PARTS, 3), 30.0)
    matches = Matches(index, index, disparity, np.zeros((PARTS, 2)), np.ones(PARTS))
    edgels, segments, ellipses = zip(*arcs)
    return matches, segments, ellipses, edgels


@given(
    st.floats(-300.0, 300.0),
    st.floats(-300.0, 300.0),
    st.floats(3.0, 200.0),
    st.floats(0.1, 1.0),
    st.floats(0.0, np.pi),
)
@settings(max_examples=100, deadline=None)
def test_level_tangents_are_the_highest_and_the_lowest_place(u, v, major, ratio, turn):
    points = on_ellipse([u, v], [major, ratio * major], turn, np.linspace(0.0, 2.0 * np.pi, 20001))
    conic, _ = conic_kernels.fit(points[::1000], 4)
    top, bottom = level_tangents(symmetric(conic))
    assert top[1] == pytest.approx(points[:, 1].min(), abs=1e-4 * major)
    assert bottom[1] == pytest.approx(points[:, 1].max(), abs=1e-4 * major)
    np.testing.assert_allclose(sampson(symmetric(conic), np.stack([top, bottom])), 0.0, atol=1e-5 * major)


def test_a_shift_of_the_rows_is_told_by_both_places():
    told = arc_rows(*a_pair(lambda u, v: 0.4 + 0.0 * u))
    np.testing.assert_allclose(told.off, 0.4, atol=0.01)
    assert np.ptp(told.point[:, 1]) == pytest.approx(2.0 * np.hypot(40.0 * np.sin(0.4), 25.0 * np.cos(0.4)), abs=0.5)


def test_noise_moves_it_by_no_more_than_is_stated():
    told = [arc_rows(*a_pair(lambda u, v: 0.0 * u, noise=0.2, seed=seed)) for seed in range(40)]
    ratio = np.concatenate([each.off / each.sigma for each in told])
    # Sigma is that of edgels whose errors are shared by their neighbours; these have each their own.
    assert 0.2 < np.sqrt((ratio**2).mean()) < 1.2
    assert all((each.sigma < 0.2).all() for each in told)


def test_a_place_that_no_edgel_shows_says_nothing():
    told = arc_rows(*a_pair(lambda u, v: 0.0 * u, part=0.45))
    assert len(told.off) == 1
    assert told.point[0, 1] > 200.0, 'the lowest place: the first half of an ellipse goes down the picture'


def test_without_a_match_arcs_are_no_pair():
    matches, segments, ellipses, edgels = a_pair(lambda u, v: 0.0 * u)
    assert paired_arcs(matches, segments) == [(0, 0)]
    none = Matches.empty()
    assert paired_arcs(none, segments) == []
    assert len(arc_rows(none, segments, ellipses, edgels).off) == 0


def test_few_places_leave_the_error_open_and_many_tell_it():
    rng = np.random.default_rng(2)

    def sigma_of(count: int) -> float:
        place = rng.uniform(0.0, 1.0, (count, 2)) * [640.0, 480.0]
        off, sigma = 0.5 + 0.05 * rng.normal(size=count), np.full(count, 0.05)
        found = fitted_error(RowWitnesses(place, off, sigma), (640, 480), 0.01)
        assert found.offset == pytest.approx(0.5, abs=0.15)
        return found.sigma

    assert sigma_of(6) > 2.0 * sigma_of(200)
