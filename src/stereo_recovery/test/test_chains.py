"""Long chains of weak edgels, and joined segments that bend."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection import edgels
from stereo_recovery.detection.chains import link, with_weak
from stereo_recovery.detection.splitting import split

SIGMA, NOISE = 0.8, 2.0
GRADIENT_NOISE = NOISE / (np.sqrt(8.0 * np.pi) * SIGMA**2)


def found(image: np.ndarray, low: float, high: float):
    every = edgels.detect(image, 'canny', SIGMA, low, NOISE)
    return every, link(every.select(every.magnitude > high), image.shape, high)


@pytest.mark.parametrize('contrast', [0.0, 7.0])
def test_a_long_weak_edge_is_found_and_noise_is_not(contrast):
    """Contrast of 3.5 times the noise, along 128 pixels, below both thresholds; three pictures of noise."""
    for seed in range(3):
        image = np.random.default_rng(seed).normal(80.0, NOISE, (128, 128)).astype(np.float32)
        image[:, 60:] += contrast
        every, strong = found(image, 2.7 * GRADIENT_NOISE, 7.0 * GRADIENT_NOISE)
        chains = with_weak(strong, every, image.shape, 3.3 * GRADIENT_NOISE, 14)
        on_edge = np.abs(chains.edgels.position[:, 0] - 59.5) < 2.0
        assert np.count_nonzero(on_edge) >= (60 if contrast else 0)
        assert np.count_nonzero(~on_edge) <= 20
        assert chains.offsets[-1] == len(chains.edgels) and len(chains.closed) == len(chains)


def test_two_edges_that_meet_at_a_slight_angle_are_not_joined_through_a_scrap():
    """A face whose outline bends by 5 degrees in the middle."""
    v, u = np.mgrid[0 : 160 * 4, 0 : 160 * 4] / 4.0
    edge = np.where(v < 80, 70.0, 70.0 + np.tan(np.radians(5.0)) * (v - 80))
    image = np.where(u > edge, 150.0, 50.0).reshape(160, 4, 160, 4).mean(axis=(1, 3)).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), 0.5)
    for seed in range(3):
        noisy = (image + np.random.default_rng(seed).normal(0.0, 2.0, image.shape)).astype(np.float32)
        chains = link(edgels.detect(noisy, 'canny', SIGMA, 4.0, NOISE), image.shape, 6.0)
        _, segments, _ = split(chains, 0.2, SIGMA)
        lean = np.degrees(np.arctan2(segments.direction[:, 0], segments.direction[:, 1]))[segments.length > 40]
        lean = np.sort((lean + 90.0) % 180.0 - 90.0)
        assert lean == pytest.approx([0.0, 5.0], abs=0.3)
