"""Edgels lie where the edge is, with the error they state."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.edgels import as_grey, detect, noise_level
from stereo_recovery.params import DETECTORS


def step_edge(angle: float, offset: float, size: int = 64, contrast: float = 100.0, blur: float = 1.0) -> np.ndarray:
    """A blurred straight step, brighter in the direction of the angle; exact area sampling by an error function."""
    from scipy.special import erf

    v, u = np.mgrid[0:size, 0:size] - (size - 1) / 2
    distance = u * np.cos(angle) + v * np.sin(angle) - offset
    return (80.0 + contrast * 0.5 * (1.0 + erf(distance / (blur * np.sqrt(2.0))))).astype(np.float32)


@pytest.mark.parametrize('angle', [0.0, 0.3, 0.8, np.pi / 2, 2.1, -2.7])
@pytest.mark.parametrize('offset', [0.0, 0.37, -0.21])
def test_edgels_of_a_step_are_exact_without_noise(angle, offset):
    edgels = detect(step_edge(angle, offset), sigma=1.0)
    centred = edgels.position - 31.5
    inside = np.abs(centred).max(axis=1) < 25
    distance = centred @ [np.cos(angle), np.sin(angle)] - offset
    assert inside.sum() > 40
    assert np.abs(distance[inside]).max() < 0.01
    turn = np.angle(np.exp(1j * (edgels.direction[inside] - angle)))
    assert np.abs(turn).max() < np.radians(0.5)


def test_stated_position_error_is_the_real_one():
    rng = np.random.default_rng(1)
    errors, stated = [], []
    for _ in range(20):
        angle = rng.uniform(0, 2 * np.pi)
        image = step_edge(angle, 0.1, contrast=40.0, blur=0.58) + rng.normal(0, 2.0, (64, 64)).astype(np.float32)
        edgels = detect(image, sigma=1.0, threshold=2.0, noise=2.0)
        centred = edgels.position - 31.5
        distance = centred @ [np.cos(angle), np.sin(angle)] - 0.1
        mine = (np.abs(centred).max(axis=1) < 25) & (np.abs(distance) < 1)
        errors.append(distance[mine])
        stated.append(edgels.sigma_position[mine])
    actual = np.std(np.concatenate(errors))
    assert actual == pytest.approx(np.median(np.concatenate(stated)), rel=0.35)


def test_sigma_is_below_a_thirtieth_of_a_pixel_at_two_grey_levels_of_noise():
    rng = np.random.default_rng(2)
    image = step_edge(0.4, 0.0, contrast=80.0, blur=0.58) + rng.normal(0, 2.0, (64, 64)).astype(np.float32)
    edgels = detect(image, sigma=1.0, threshold=4.0)
    distance = (edgels.position - 31.5) @ [np.cos(0.4), np.sin(0.4)]
    assert np.std(distance[np.abs(distance) < 1]) < 0.035


@pytest.mark.parametrize('detector', DETECTORS)
def test_every_detector_finds_the_edge(detector):
    edgels = detect(step_edge(0.5, 0.2), detector=detector, threshold=3.0)
    distance = (edgels.position - 31.5) @ [np.cos(0.5), np.sin(0.5)] - 0.2
    assert len(edgels) > 40
    assert np.median(np.abs(distance)) < 0.1


def test_unknown_detector_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match='canny, sobel'):
        detect(np.zeros((20, 20), np.float32), detector='hough')


@pytest.mark.parametrize('sigma', [1.0, 3.0, 8.0])
def test_noise_is_measured_not_guessed(sigma):
    image = step_edge(0.7, 0.0, size=256) + np.random.default_rng(3).normal(0, sigma, (256, 256)).astype(np.float32)
    assert noise_level(image) == pytest.approx(sigma, rel=0.1)


def test_grey_of_colour_does_not_depend_on_channel_order():
    image = np.random.default_rng(4).integers(0, 255, (9, 7, 3), dtype=np.uint8)
    assert np.array_equal(as_grey(image), as_grey(image[..., ::-1]))
