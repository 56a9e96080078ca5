"""The noise of one picture, level by level, and what it says of the picture's code."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from stereo_recovery import tone
from stereo_recovery.detection.view import detect_views
from stereo_recovery.noise_levels import NoiseByLevel, nats_of_code, noise_by_level
from stereo_recovery.params import RecoveryParams

LEVELS = np.linspace(20.0, 235.0, 12)


def steps(exponent: float, electrons: float, read: float, seed: int = 0) -> np.ndarray:
    """Plain fields of twelve grey levels, their light counted in electrons, read with noise and coded."""
    rng = np.random.default_rng(seed)
    light = np.kron((LEVELS.reshape(3, 4) / 255.0) ** exponent, np.ones((80, 80)))
    seen = (rng.poisson(light * electrons) + rng.normal(0.0, read, light.shape)) / electrons
    return np.rint(255.0 * np.clip(seen, 0.0, 1.0) ** (1.0 / exponent)).astype(np.float32)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.6, 12.0), st.integers(0, 1000))
def test_the_noise_of_plain_fields_is_found(sigma: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0.0, sigma, (240, 320))
    found = noise_by_level((np.kron(LEVELS.reshape(3, 4), np.ones((80, 80))) + noise).astype(np.float32))
    # Of tiles of 36 responses that agree with their neighbours in part, one in ten shows a quarter less.
    assert len(found.sigma) >= 8
    assert np.median(found.sigma) == pytest.approx(0.73 * sigma, rel=0.08)


@pytest.mark.parametrize('electrons', [2000.0, 10000.0])
def test_a_coded_picture_is_noisiest_where_it_is_dark(electrons: float) -> None:
    assert nats_of_code(noise_by_level(steps(2.2, electrons, 12.0))) > 5.0


@pytest.mark.parametrize('read', [0.0, 30.0])
def test_a_picture_of_light_is_not(read: float) -> None:
    assert nats_of_code(noise_by_level(steps(1.0, 2000.0, read))) < 1.0


def test_texture_in_the_dark_does_not_count_for_noise() -> None:
    image = steps(1.0, 2000.0, 10.0)
    image[:80, :80] += np.random.default_rng(1).normal(0.0, 9.0, (80, 80)).astype(np.float32)
    assert nats_of_code(noise_by_level(image)) < 3.0


def test_clipped_places_have_no_noise() -> None:
    image = np.zeros((80, 80), np.float32)
    image[:, 40:] = 255.0
    assert len(noise_by_level(image).level) == 0


@pytest.mark.parametrize('shape', [(1, 1), (7, 400), (9, 9)])
def test_small_pictures_say_nothing(shape: tuple[int, int]) -> None:
    found = noise_by_level(np.full(shape, 90.0, np.float32))
    assert nats_of_code(found) == 0.0


def test_one_level_says_nothing() -> None:
    assert nats_of_code(NoiseByLevel(np.array([100.0]), np.array([2.0]))) == pytest.approx(0.0, abs=0.1)


def test_a_picture_without_noise_says_nothing() -> None:
    image = np.kron(np.rint(LEVELS.reshape(3, 4)), np.ones((80, 80))).astype(np.float32)
    assert nats_of_code(noise_by_level(image)) < 1.0


@pytest.mark.parametrize('exponent', [1.0, 2.2])
def test_edges_lie_where_light_has_them_if_noise_says_so(exponent: float) -> None:
    """No two of these fields' edges have their bright sides on different hands of one line."""
    rng = np.random.default_rng(4)
    places = np.array([40.1, 100.3, 160.5, 220.7, 280.9])
    fields = (np.array([15.0, 60.0, 105.0, 150.0, 195.0, 235.0]) / 255.0) ** exponent
    light = fields[0] + ndtr((np.arange(320.0)[:, None] - places) / 0.7) @ np.diff(fields)
    electrons = rng.poisson(np.tile(light, (240, 1)) * 8000.0) + rng.normal(0.0, 30.0, (240, 320))
    image = (255.0 * np.clip(electrons / 8000.0, 0.0, 1.0) ** (1.0 / exponent)).astype(np.float32)
    params = RecoveryParams()
    views = detect_views([image], params.detector, params.sigma, params.low, params.high)
    found = tone.in_light(views, params.sigma)[0].segments
    long = found.select(found.length > 100.0)
    assert len(long) >= len(places)
    assert np.abs(long.centre[:, :1] - places).min(axis=1).max() < 0.05
    assert (found is views[0].segments) == (exponent == 1.0)
