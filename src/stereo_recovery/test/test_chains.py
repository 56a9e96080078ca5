"""Chains of edgels: which are edges and which noise; and joined segments that bend."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection.chains import chains_of, completed
from stereo_recovery.detection.settings import CHAIN_EXCESS
from stereo_recovery.detection.splitting import split

SIGMA, NOISE = 0.8, 2.0
# Grey levels per pixel: no thresholds but those of the noise.
NONE = (0.01, 0.01)


@pytest.mark.parametrize('blur', [0.0, 0.5, 0.8, 1.2])
def test_noise_is_no_edge_even_where_neighbouring_pixels_agree(blur):
    """In three quarters of a megapixel at most two chains, short ones."""
    for seed in range(3):
        image = np.random.default_rng(seed).normal(100.0, 4.0, (512, 512)).astype(np.float32)
        if blur:
            image = cv2.GaussianBlur(image, (0, 0), blur)
        chains = chains_of(image, 'canny', SIGMA, NONE)
        assert len(chains) <= 2
        assert len(chains.edgels) < 40


@pytest.mark.parametrize('contrast', [7.0, 9.0])
def test_a_long_faint_edge_is_found_beside_which_noise_is_not(contrast):
    """Of three and a half times the noise, along 128 pixels: no edgel of it stands out by itself."""
    for seed in range(3):
        image = np.random.default_rng(seed).normal(80.0, NOISE, (128, 128)).astype(np.float32)
        image[:, 60:] += contrast
        chains = chains_of(image, 'canny', SIGMA, NONE)
        on_edge = np.abs(chains.edgels.position[:, 0] - 59.5) < 2.0
        assert np.count_nonzero(on_edge) >= 60
        assert np.count_nonzero(~on_edge) <= 20
        assert chains.offsets[-1] == len(chains.edgels) and len(chains.closed) == len(chains)


def test_a_short_strong_edge_counts_as_much_as_a_long_faint_one():
    """Ten edgels of ten sigma: an excess far above what is asked for."""
    image = np.random.default_rng(1).normal(80.0, NOISE, (64, 64)).astype(np.float32)
    image[25:35, 30:40] += 40.0
    chains = chains_of(image, 'canny', SIGMA, NONE)
    assert len(chains) == 1
    assert (1.0 / chains.edgels.sigma_direction - 1.0).sum() > 10.0 * CHAIN_EXCESS


def test_a_coarser_scale_adds_what_is_not_there_and_nothing_else():
    image = np.full((96, 96), 80.0, np.float32)
    image[:, 30:] = 140.0
    fine = chains_of(image, 'canny', SIGMA, NONE)
    image[:, 70:] = 160.0
    both = chains_of(image, 'canny', SIGMA, NONE)
    assert len(completed(fine, fine, image.shape, 1.0)) == len(fine)
    more = completed(fine, both, image.shape, 1.0)
    assert len(more) == len(fine) + 1
    added = more.edgels.position[more.offsets[-2] :]
    assert np.abs(added[:, 0] - 69.5).max() < 0.1


def test_two_edges_that_meet_at_a_slight_angle_are_not_joined_through_a_scrap():
    """A face whose outline bends by 5 degrees in the middle."""
    v, u = np.mgrid[0 : 160 * 4, 0 : 160 * 4] / 4.0
    edge = np.where(v < 80, 70.0, 70.0 + np.tan(np.radians(5.0)) * (v - 80))
    image = np.where(u > edge, 150.0, 50.0).reshape(160, 4, 160, 4).mean(axis=(1, 3)).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), 0.5)
    for seed in range(3):
        noisy = (image + np.random.default_rng(seed).normal(0.0, 2.0, image.shape)).astype(np.float32)
        chains = chains_of(noisy, 'canny', SIGMA, (4.0, 6.0), NOISE)
        _, segments, _ = split(chains, 0.2, SIGMA)
        lean = np.degrees(np.arctan2(segments.direction[:, 0], segments.direction[:, 1]))[segments.length > 40]
        lean = np.sort((lean + 90.0) % 180.0 - 90.0)
        assert lean == pytest.approx([0.0, 5.0], abs=0.3)
