"""Edges that noise breaks into fragments; closed form: upright steps of known contrast and length."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery.detection import edgels
from stereo_recovery.detection.low_contrast import track_low_contrast
from stereo_recovery.detection.segments import Segments, fit_segments

SIGMA = 0.8
NOISE = 2.0
GRADIENT_NOISE = NOISE / (np.sqrt(8.0 * np.pi) * SIGMA**2)


def picture(contrast: float, bottom: int = 150) -> np.ndarray:
    """(160, 96) float32: a step at column 47.5 from row 10 to this one, with noise."""
    image = np.full((160, 96), 100.0, np.float32)
    image[10:bottom, 48:] += contrast
    noise = np.random.default_rng(5).normal(0.0, NOISE, image.shape)
    return (cv2.GaussianBlur(image, (0, 0), 0.5) + noise).astype(np.float32)


def fragments(rows: list[tuple[int, int]]) -> tuple[edgels.Edgels, Segments]:
    """Segments on the step that cover these rows, the bright side on the right hand."""
    v = np.concatenate([np.arange(*run[::-1], -1, dtype=float) for run in rows])
    n = len(v)
    found = edgels.Edgels(
        np.column_stack([np.full(n, 47.5), v]),
        np.zeros(n),
        np.full(n, 3.0),
        np.full(n, 0.05),
        np.full(n, 0.1),
        np.ones(n),
        np.zeros(n),
    )
    last = np.cumsum([b - a for a, b in rows])
    bounds = np.column_stack([np.concatenate([[0], last[:-1]]), last])
    return found, fit_segments(found, bounds, np.zeros(len(rows), int), SIGMA)


def follow(image: np.ndarray, rows: list[tuple[int, int]]) -> Segments:
    return track_low_contrast(*fragments(rows), edgels.gradient(image, 'canny', SIGMA), GRADIENT_NOISE, SIGMA, 0.3)[1]


@pytest.mark.parametrize('contrast', [7.0, 10.0])
def test_fragments_of_a_faint_edge_become_one_edge_to_its_ends(contrast):
    found = follow(picture(contrast), [(40, 66), (100, 124)])
    assert len(found) == 1
    heights = np.sort([found.start[0, 1], found.end[0, 1]])
    np.testing.assert_allclose(heights, [10.0, 150.0], atol=6.0)


def test_fragments_with_nothing_between_them_stay_two():
    image = picture(8.0)
    image[66:100] = picture(0.0)[66:100]
    found = follow(image, [(30, 64), (102, 136)])
    assert len(found) == 2


def test_an_edge_that_ends_is_not_followed_into_noise():
    found = follow(picture(8.0, bottom=90), [(50, 84)])
    assert max(found.start[0, 1], found.end[0, 1]) < 98.0
