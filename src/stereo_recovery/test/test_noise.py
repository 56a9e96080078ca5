"""Noise of the derivatives is measured where it is, whatever its kind, beside edges and slopes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection.edgels import gradient
from stereo_recovery.detection.noise import NoiseMap, measured_response, white_response

SIGMA = 0.8


def response(image: np.ndarray) -> NoiseMap:
    return measured_response(*gradient(image.astype(np.float32), 'canny', SIGMA), SIGMA)


def noise(sigma: float, blur: float = 0.0, seed: int = 0) -> np.ndarray:
    picture = np.random.default_rng(seed).normal(0.0, sigma, (256, 256)).astype(np.float32)
    return cv2.GaussianBlur(picture, (0, 0), blur) if blur else picture


@pytest.mark.parametrize('sigma', [1.0, 3.0, 8.0])
def test_white_noise_has_the_response_that_follows_from_it(sigma):
    found = response(100.0 + noise(sigma)).sigma
    assert np.median(found) == pytest.approx(white_response(sigma, SIGMA), rel=0.05)
    assert found.std() < 0.2 * found.mean()


@pytest.mark.parametrize('blur', [0.4, 0.7, 1.0])
def test_noise_that_neighbouring_pixels_share_is_measured_as_the_filter_sees_it(blur):
    """A second difference of single pixels, the usual measure, would see a half to a hundredth of it."""
    picture = 100.0 + noise(6.0, blur)
    gx, gy = gradient(picture, 'canny', SIGMA)
    actual = np.sqrt(0.5 * (gx.var() + gy.var()))
    assert np.median(response(picture).sigma) == pytest.approx(actual, rel=0.12)


def test_each_place_has_its_own():
    picture = 100.0 + noise(1.0)
    picture[:, 128:] += noise(5.0, seed=1)[:, 128:]
    found = response(picture)
    assert np.median(found.sigma[:, :7]) == pytest.approx(white_response(1.0, SIGMA), rel=0.1)
    assert np.median(found.sigma[:, -7:]) == pytest.approx(white_response(np.hypot(1.0, 5.0), SIGMA), rel=0.1)
    points = np.array([[20.0, 30.0], [250.0, 255.0]])
    np.testing.assert_allclose(found.at(points), [found.sigma[1, 1], found.sigma[-1, -1]])


@pytest.mark.parametrize('angle', [0.0, 0.4, 1.1])
def test_slopes_and_bars_are_no_noise(angle):
    """A slope of 2 levels a pixel, and bars of 12 pixels with a contrast of fifty times the noise."""
    v, u = np.mgrid[0:256, 0:256]
    along = u * np.cos(angle) + v * np.sin(angle)
    usual = white_response(2.0, SIGMA)
    assert np.median(response(2.0 * along + noise(2.0)).sigma) == pytest.approx(usual, rel=0.15)
    bars = cv2.GaussianBlur(100.0 * (np.floor(along / 12.0) % 2.0), (0, 0), 0.6)
    assert np.median(response(bars + noise(2.0)).sigma) < 1.8 * usual


def test_a_picture_without_noise_has_that_of_rounding():
    assert response(np.full((40, 40), 7.0)).sigma.min() == pytest.approx(white_response(0.3, SIGMA))
    assert response(np.full((7, 9), 7.0)).sigma.shape == (1, 1)
