"""Edges that blur into one chain, separated by a fit to their profile; closed form: bars of known width."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection import double_edge_kernels, edgels
from stereo_recovery.detection.chains import chains_of
from stereo_recovery.detection.double_edges import fit_double_steps
from stereo_recovery.detection.settings import PROFILE_HALF_LENGTH
from stereo_recovery.detection.splitting import split

SIGMA = 0.8


def picture(levels, edges, lean: float = 0.0):
    """(96, 96) float32: grey levels between upright edges at the columns given, which lean by this slope; 8 x 8 samples
    a pixel, blur 0.5 px."""
    fine = (np.arange(96 * 8) + 0.5) / 8 - 0.5
    u, v = np.meshgrid(fine, fine)
    image = np.full(u.shape, levels[0], np.float32)
    for level, edge in zip(levels[1:], edges):
        image[u > edge + lean * (v - 48)] = level
    image = image.reshape(96, 8, 96, 8).mean(axis=(1, 3))
    return cv2.GaussianBlur(image, (0, 0), 0.5)


def segments_of(image, noise: float = 0.0):
    grey = (image + np.random.default_rng(3).normal(0.0, noise, image.shape) if noise else image).astype(np.float32)
    chains = chains_of(grey, 'canny', SIGMA, (1.0, 1.6))
    ordered, segments, _ = split(chains, 0.2, SIGMA)
    return grey, ordered, segments


def places(segments, row: float = 48.0):
    """Columns where the upright segments cross a row."""
    return np.sort(
        [c[0] + (row - c[1]) * t[0] / t[1] for c, t in zip(segments.centre, segments.direction) if abs(t[1]) > 0.9]
    )


@pytest.mark.parametrize('thin', [1.5, 2.0, 3.0])
@pytest.mark.parametrize('levels', [(40, 160, 110), (110, 160, 40), (40, 90, 160)])
def test_both_edges_of_a_thin_face_are_found_where_they_are(thin, levels):
    """Among plain edges, that show how wide a step is in this picture."""
    image = picture((100, 170, *levels, levels[2] + 60), (20.4, 30.6, 45.2, 45.2 + thin, 62.3), lean=0.3)
    grey, ordered, before = segments_of(image, 1.0)
    after = fit_double_steps(edgels.gradient(grey, 'canny', SIGMA), ordered, before, SIGMA)
    found = places(after)
    for true in (20.4, 30.6, 45.2, 45.2 + thin, 62.3):
        assert np.abs(found - true).min() < 0.15
    assert max(np.abs(places(before) - true).min() for true in (45.2, 45.2 + thin)) > 0.15


def test_plain_edges_stay_as_they_are():
    grey, ordered, before = segments_of(picture((40, 160, 110, 30), (20.3, 45.1, 70.8), lean=0.05), 2.0)
    after = fit_double_steps(edgels.gradient(grey, 'canny', SIGMA), ordered, before, SIGMA)
    assert len(after) == len(before)
    assert np.array_equal(after.centre, before.centre)
    assert np.array_equal(after.sigma, before.sigma)


def test_an_unusual_edge_that_is_no_pair_of_steps_is_less_certain():
    """A soft edge among sharp ones: a shadow."""
    image = picture((40, 160, 110, 30), (10.3, 20.3, 70.8))
    soft = cv2.GaussianBlur(picture((0, 60), (45.0,)), (0, 0), 2.0)
    grey, ordered, before = segments_of(image + soft)
    after = fit_double_steps(edgels.gradient(grey, 'canny', SIGMA), ordered, before, SIGMA)
    at = [int(np.argmin(np.abs(found.centre[:, 0] - 45.0))) for found in (before, after)]
    assert len(after) == len(before)
    assert after.sigma[at[1], 0] > 0.2 > before.sigma[0, 0]


def test_two_steps_are_recovered_from_their_own_profile():
    x = np.linspace(-PROFILE_HALF_LENGTH, PROFILE_HALF_LENGTH, 17)
    place = np.array([-20.0, -7.0, 7.0, 20.0])

    def bell(at):
        return np.exp(-0.5 * ((x - at) / 1.0) ** 2) / np.sqrt(2 * np.pi)

    profile = np.array([80.0 * bell(0.3 + 0.01 * s) - 50.0 * bell(2.1 + 0.02 * s) for s in place])
    p, left, single, _ = double_edge_kernels.two_steps(profile, place, 1.0)
    if p[0] < 0:  # either may come first
        p = np.array([p[1], p[0], p[2] + p[4], p[3] + p[5], -p[4], -p[5]])
    assert left < 1e-3 * single
    assert p == pytest.approx([80.0, -50.0, 0.3, 0.01, 1.8, 0.01], abs=0.02, rel=0.02)
