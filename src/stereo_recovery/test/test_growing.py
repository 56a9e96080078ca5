"""Segments followed beyond the ends of their chains, as far as the picture goes on with their contrast."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.edgels import Edgels, slopes_of
from stereo_recovery.detection.growing import grown
from stereo_recovery.detection.segments import fit_segments
from stereo_recovery.detection.view import detect_view

SIGMA, TOLERANCE, NOISE = 1.0, 0.3, 4.0
SHAPE = (80, 200)


def half(first, last, contrast, lean=0.1, seed=0, noise=NOISE):
    """Noise, with a step between two columns along a line that gains ``lean`` rows a column, brighter above it."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    away = (v - line(u, lean)) / np.hypot(1.0, lean)
    step = contrast * np.clip(0.5 - away, 0.0, 1.0) * ((u >= first) & (u <= last))
    picture = 80.0 + step + np.random.default_rng(seed).normal(0.0, noise, SHAPE)
    return picture.astype(np.float32)


def line(u, lean):
    """Row of the step in a column."""
    return 40.0 + lean * (u - 100.0)


def known(first, last, lean=0.1):
    """A segment on that line, as if its chain had been followed between two columns only."""
    u = np.arange(float(last), float(first) - 1.0, -1.0)
    n = len(u)
    edgels = Edgels(
        np.stack([u, line(u, lean)], axis=1),
        np.full(n, np.arctan2(-1.0, lean)),
        np.full(n, 4.0),
        np.full(n, 0.1),
        np.full(n, 0.1),
        np.full(n, 1.2),
        np.zeros(n),
        np.full(n, 3.0),
    )
    bounds = np.array([[0, n]])
    return edgels, fit_segments(edgels, bounds, np.zeros(1, np.int64), SIGMA)


def columns(segments):
    """Least and largest column that the segments reach."""
    u = np.concatenate([segments.start[:, 0], segments.end[:, 0]])
    return u.min(), u.max()


@pytest.mark.parametrize('lean', [-0.4, 0.0, 0.1])
def test_a_faint_step_is_followed_to_its_ends(lean):
    beyond = []
    for seed in range(20):
        picture = half(30, 160, 8.0, lean, seed)
        edgels, segments = grown(*known(80, 120, lean), slopes_of(picture, 'canny', SIGMA), SIGMA, TOLERANCE)
        assert segments.bounds.tolist() == [[0, len(edgels)]]
        first, last = columns(segments)
        beyond += [30.0 - first, last - 160.0]
        # It is the same line, now known better, and its edgels follow each other.
        within = np.clip([first, last], 30.0, 160.0)
        slope = segments.direction[0, 1] / segments.direction[0, 0]
        rows = segments.centre[0, 1] + slope * (within - segments.centre[0, 0])
        assert np.abs(rows - line(within, lean)).max() < 1.0
        assert (np.diff((edgels.position - segments.centre[0]) @ segments.direction[0]) > -1.5).all()
    assert abs(np.median(beyond)) < 4.0
    assert np.mean(np.abs(beyond) < 15.0) > 0.85


def test_noise_alone_seldom_lets_a_segment_grow():
    grew = 0
    for seed in range(100):
        picture = half(80, 120, 8.0, seed=seed)
        _, segments = grown(*known(80, 120), slopes_of(picture, 'canny', SIGMA), SIGMA, TOLERANCE)
        first, last = columns(segments)
        grew += (first < 72.0) + (last > 128.0)
    assert grew <= 20


def test_an_edge_that_chains_do_not_lose_stays_as_it_is():
    picture = half(30, 160, 120.0)
    edgels, segments = known(80, 120)
    found = grown(edgels, segments, slopes_of(picture, 'canny', SIGMA), SIGMA, TOLERANCE)
    assert found == (edgels, segments)


def test_what_lies_in_the_border_is_not_followed():
    picture = half(30, 160, 8.0)
    border = np.zeros(SHAPE, bool)
    border[:, :60] = True
    _, segments = grown(*known(80, 120), slopes_of(picture, 'canny', SIGMA), SIGMA, TOLERANCE, border)
    assert columns(segments)[0] >= 60.0
    assert columns(segments)[1] > 140.0


def test_two_parts_of_a_faint_edge_become_one():
    picture = half(20, 180, 9.0, seed=3)
    left, right = known(40, 70)[0], known(120, 160)[0]
    edgels = Edgels.concatenate([left, right])
    bounds = np.array([[0, len(left)], [len(left), len(edgels)]])
    segments = fit_segments(edgels, bounds, np.arange(2), SIGMA)
    _, found = grown(edgels, segments, slopes_of(picture, 'canny', SIGMA), SIGMA, TOLERANCE)
    assert len(found) == 1
    assert found.length[0] > 120.0


@pytest.mark.parametrize('shape', [(5, 5), (9, 40), (17, 6)])
def test_small_pictures_are_looked_at_whole(shape):
    picture = np.random.default_rng(1).normal(80.0, 20.0, shape).astype(np.float32)
    picture[:, shape[1] // 2 :] += 20.0
    view = detect_view(picture, 'canny', SIGMA, 1.0, 3.0)
    assert view.segments.bounds.max(initial=0) <= len(view.edgels)
