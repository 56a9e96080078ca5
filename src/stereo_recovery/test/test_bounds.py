"""Stated errors are true: sigma of fitted lines against their real errors, and bounds of ends in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from msgs_py import FeatureSet, PinholeCamera, StereoRig
from stereo_recovery.detection.chains import chains_of
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.splitting import split
from stereo_recovery.edges.lines3d import Lines3D, line_covariance, to_space
from stereo_recovery.estimation.own_lines import own_lines
from stereo_recovery.matching.matches import Matches

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


def lines_of(points, sigma, noise):
    """n segments about a line between image points (2, 2), each turned and moved by noise (n, 2)."""
    count = len(noise)
    segments = Segments.between(np.tile(points, (count, 1, 1)), 0.1)
    t = segments.direction
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    direction = t + noise[:, 1:] * n
    return replace(
        segments,
        centre=segments.centre + noise[:, :1] * n,
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        sigma=np.tile(sigma, (count, 1)),
    )


@pytest.mark.parametrize('slope', [0.0, 0.15])
@pytest.mark.parametrize('turn', [1.5, 0.7, 2.6])
def test_the_covariance_of_both_ends_is_that_of_ends_between_noisy_lines(slope, turn):
    """Lines of both images moved as their sigmas say: d2 of both ends together is chi squared of six."""
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 700.0), 0.05)
    rng, count = np.random.default_rng(2), 4000
    middle, half = np.array([220.0, 260.0]), 30.0 * np.array([np.cos(turn), np.sin(turn)])
    left_points = np.stack([middle - half, middle + half])
    d = 90.0 + slope * np.array([-30.0, 30.0])
    right_points = left_points - np.stack([d, np.zeros(2)], axis=1)
    sigmas = np.array([[0.15, 0.006], [0.1, 0.004]])
    left, right = (
        lines_of(points, sigma, rng.normal(size=(count, 2)) * sigma)
        for points, sigma in zip((left_points, right_points), sigmas)
    )
    index = np.arange(count, dtype=np.int32)
    matches = Matches(index, index, np.tile([d[0], d.mean(), d[1]], (count, 1)), np.zeros((count, 2)), np.ones(count))
    own = own_lines(matches, (left, right), 0.0)
    covariance = np.linalg.inv(own.information)
    ends = left.extent + rng.normal(size=(count, 2)) * 0.2
    lines = Lines3D(
        index,
        index,
        ends,
        np.einsum('nij,nj->ni', covariance, own.vector),
        covariance,
        line_covariance(left, index),
        own.covariance_with_line(covariance),
        np.full((count, 2), 0.2),
    )
    found = to_space(lines, left, rig)
    off = found.ends - rig.triangulate(left_points, right_points[:, 0])
    d2 = np.einsum('ni,ni->n', off.reshape(-1, 6), np.linalg.solve(found.covariance, off.reshape(-1, 6, 1))[..., 0])
    assert d2.mean() == pytest.approx(6.0, rel=0.05)
    assert np.mean(d2 < chi2(6).ppf(0.95)) == pytest.approx(0.95, abs=0.012)
    # Without what the ends have in common the error of the direction would be another.
    features = FeatureSet.from_edges(found.ends[:, 0], found.ends[:, 1], covariance=found.covariance)
    true = off[:, 1] - off[:, 0]
    across = true - (true * features.directions).sum(axis=1, keepdims=True) * features.directions
    stated = np.trace(features.direction_covariance, axis1=1, axis2=2).mean()
    assert (across**2).sum(axis=1).mean() / features.lengths.mean() ** 2 == pytest.approx(stated, rel=0.07)


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
            np.full((1, 2, 2), 1e-12) * np.eye(2),
            np.zeros((1, 2, 2)),
            np.full((1, 2), sigma_s),
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
