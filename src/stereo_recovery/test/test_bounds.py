"""Stated errors are true: sigma of fitted lines against their real errors, and bounds of ends in space."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.detection.chains import chains_of
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.splitting import split
from stereo_recovery.edges.lines3d import Lines3D, to_space

SIZE = 96


def step_image(angle, offset, contrast, noise, rng):
    """A straight edge, blurred by half a pixel; angle of its normal, distance from the picture's middle, pixels."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] - 0.5 * (SIZE - 1)
    away = u * np.cos(angle) + v * np.sin(angle) - offset
    return (60.0 + contrast * norm.cdf(away, scale=0.6) + rng.normal(0.0, noise, away.shape)).astype(np.float32)


@pytest.mark.parametrize(('contrast', 'noise'), [(40.0, 2.0), (120.0, 2.0), (120.0, 6.0)])
def test_a_straight_edge_is_as_uncertain_as_it_says(contrast, noise):
    rng = np.random.default_rng(3)
    offsets, slopes = [], []
    for angle in np.linspace(0.05, 3.0, 40):
        offset = rng.uniform(-3.0, 3.0)
        picture = step_image(angle, offset, contrast, noise, rng)
        segments = split(chains_of(picture, 'canny', 0.8, (4.0, 6.0), noise), 0.2, 0.8)[1]
        k = int(np.argmax(segments.length))
        normal = np.array([np.cos(angle), np.sin(angle)])
        miss = (segments.centre[k] - 0.5 * (SIZE - 1)) @ normal - offset
        offsets.append(miss / segments.sigma[k, 0])
        slopes.append(segments.direction[k] @ normal / segments.sigma[k, 1])
    for deviations in (offsets, slopes):
        assert 0.5 < np.median(np.abs(deviations)) / norm.ppf(0.75) < 1.4
        assert np.mean(np.abs(deviations) < 3.0) >= 0.95


def test_noise_alone_is_no_sagitta():
    rng = np.random.default_rng(5)
    sagittas = []
    for angle in np.linspace(0.05, 3.0, 40):
        picture = step_image(angle, 0.3, 80.0, 3.0, rng)
        segments = split(chains_of(picture, 'canny', 0.8, (4.0, 6.0), 3.0), 0.2, 0.8)[1]
        sagittas.append(abs(segments.sagitta[np.argmax(segments.length)]))
    assert np.mean(np.array(sagittas) > 1e-6) < 0.4


@pytest.mark.parametrize('slope', [0.0, 0.1, -0.1])
def test_ends_of_an_edge_that_recedes_are_uncertain_along_it_as_its_depth_is(slope):
    """Ends moved as disparity and place vary: their spread along the edge is what err_par states."""
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 700.0), 0.05)
    left = Segments(
        np.zeros((1, 2), int),
        np.zeros(1, int),
        np.array([[200.0, 250.0]]),
        np.array([[0.8, 0.6]]),
        np.array([[0.0, 50.0]]),
        np.zeros(1),
        np.zeros(1),
        np.full(1, 50.0),
        np.full((1, 2), 1e-4),
        np.full(1, 20.0),
        np.full(1, -1, np.int32),
    )
    sigma_d, sigma_s = 0.2, 0.1

    def lines(a, b, extent):
        return Lines3D(
            np.array([0], np.int32),
            np.array([0], np.int32),
            np.array([extent]),
            np.array([[a, b]]),
            np.diag([sigma_d**2, 1e-12])[None],
            np.full((1, 2), sigma_s),
            np.ones((1, 2), bool),
            np.zeros(1, bool),
            np.ones(1),
        )

    stated = to_space(lines(100.0, slope, left.extent[0]), left, rig)
    run = stated.ends[0, 1] - stated.ends[0, 0]
    rng = np.random.default_rng(1)
    moved = [
        to_space(
            lines(100.0 + rng.normal(0.0, sigma_d), slope, left.extent[0] + rng.normal(0.0, sigma_s, 2)), left, rig
        ).ends[0]
        - stated.ends[0]
        for _ in range(2000)
    ]
    spread = np.sqrt((np.array(moved) @ (run / np.linalg.norm(run))).var(axis=0).mean())
    assert stated.err_par[0] == pytest.approx(3.0 * spread, rel=0.1)
