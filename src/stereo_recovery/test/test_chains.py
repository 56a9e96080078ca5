"""Chains of edgels and their segments: which are edges and which noise; and joined segments that bend."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection import chain_kernels
from stereo_recovery.detection.chains import chains_of, completed
from stereo_recovery.detection.edgels import Edgels
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.settings import SEGMENT_EXCESS
from stereo_recovery.detection.splitting import split

SIGMA, NOISE = 0.8, 2.0
# Grey levels per pixel: no thresholds but those of the noise.
NONE = (0.01, 0.01)


def edges_of(image: np.ndarray) -> tuple[Edgels, Segments]:
    return split(chains_of(image.astype(np.float32), 'canny', SIGMA, NONE), 0.4, SIGMA)[:2]


@pytest.mark.parametrize('blur', [0.0, 0.5, 0.8, 1.2])
def test_noise_is_no_edge_even_where_neighbouring_pixels_agree(blur):
    """In three quarters of a megapixel, and with no thresholds but those of the noise."""
    segments = 0
    for seed in range(3):
        image = np.random.default_rng(seed).normal(100.0, 4.0, (512, 512)).astype(np.float32)
        if blur:
            image = cv2.GaussianBlur(image, (0, 0), blur)
        segments += len(edges_of(image)[1])
    assert segments <= 1


@pytest.mark.parametrize('contrast', [7.0, 9.0])
def test_a_long_faint_edge_is_found_beside_which_noise_is_not(contrast):
    """Of three and a half times the noise, along 128 pixels: no edgel of it stands out by itself."""
    for seed in range(3):
        image = np.random.default_rng(seed).normal(80.0, NOISE, (128, 128))
        image[:, 60:] += contrast
        edgels, segments = edges_of(image)
        on_edge = np.abs(edgels.position[:, 0] - 59.5) < 2.0
        assert np.count_nonzero(on_edge) >= 60
        assert np.count_nonzero(~on_edge) <= 6
        assert segments.bounds[-1, 1] == len(edgels)


def test_fragments_of_one_line_are_an_edge_together_and_one_of_them_is_hardly_any():
    """A step of three times the noise, along 150 px, and the same where it fades out after 4 px in either direction."""
    row = np.arange(160.0)[:, None]
    lengths, scraps = [], 0.0
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(80.0, NOISE, (160, 96))
        step = np.where(np.arange(96) >= 48, 6.5, 0.0)
        lengths.append(edges_of(noise + step)[1].length.sum())
        scraps += edges_of(noise + step * np.exp(-0.5 * ((row - 80.0) / 3.0) ** 2))[1].length.sum()
    assert np.median(lengths) > 60.0
    assert scraps < 10.0


def test_a_short_strong_edge_counts_as_much_as_a_long_faint_one():
    """Ten edgels of ten sigma on each side of a square: an excess far above what is asked for."""
    image = np.full((64, 64), 80.0)
    image[25:35, 30:40] += 40.0
    noise = np.random.default_rng(1).normal(0.0, 1.0, image.shape)
    edgels, segments = edges_of(cv2.GaussianBlur(image, (0, 0), 0.5) + noise)
    sides = np.argsort(segments.length)[-4:]
    assert chain_kernels.evidence(edgels.prominence, segments.bounds)[sides].min() > 3.0 * SEGMENT_EXCESS


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
