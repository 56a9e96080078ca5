"""All of one image: what is detected under noise, texture and beside borders; closed form."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stereo_recovery import RecoveryParams
from stereo_recovery.detection.border import beside_border
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.view import detect_view


def segments_of(image: np.ndarray) -> Segments:
    params = RecoveryParams()
    view = detect_view(image.astype(np.float32), params.detector, params.sigma, params.low, params.high)
    return view.matchable


def covered(segments: Segments, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Share of a line between two points, columns and rows in pixels, that lies on a segment."""
    a, b = np.array(start), np.array(end)
    points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
    line = (b - a) / np.linalg.norm(b - a)
    found = np.zeros(len(points), bool)
    for centre, direction, extent in zip(segments.centre, segments.direction, segments.extent):
        away = points - centre
        s, d = away @ direction, away @ [-direction[1], direction[0]]
        found |= (np.abs(d) < 1.5) & (s > extent[0] - 1.0) & (s < extent[1] + 1.0) & (abs(direction @ line) > 0.99)
    return float(found.mean())


def square(contrast: float, noise: float, blur: float, seed: int = 0) -> np.ndarray:
    """(160, 200): a square of this contrast, columns 60 to 140 and rows 40 to 120, out of focus, under noise."""
    image = np.full((160, 200), 100.0, np.float32)
    image[40:120, 60:140] += contrast
    return cv2.GaussianBlur(image, (0, 0), blur) + np.random.default_rng(seed).normal(0.0, noise, image.shape)


SIDES = (((60, 44), (60, 116)), ((139, 44), (139, 116)), ((64, 40), (136, 40)), ((64, 119), (136, 119)))


@pytest.mark.parametrize(('contrast', 'noise', 'blur'), [(20.0, 7.0, 1.4), (12.0, 4.0, 1.4), (8.0, 3.0, 1.0)])
def test_dark_and_defocused_edges_are_found_at_the_coarser_scale(contrast, noise, blur):
    """The gradient of the picture itself is about twice its noise; halved, it is four times."""
    shares = []
    for seed in range(4):
        found = segments_of(square(contrast, noise, blur, seed))
        shares += [covered(found, *side) for side in SIDES]
        assert len(found) < 20
    assert np.mean(shares) > 0.8


def test_texture_takes_nothing_away_from_a_plain_part_beside_it():
    """A square before fine texture of its own contrast on half of the picture; what is found of it stays."""
    image = np.zeros((320, 400), np.float32)
    image[:160, :200] = square(30.0, 1.0, 0.6)
    image[:160, 200:] = square(30.0, 1.0, 0.6)
    image[160:] = np.kron(np.random.default_rng(1).uniform(60.0, 140.0, (80, 200)), np.ones((2, 2)))
    found = segments_of(image)
    assert min(covered(found, *side) for side in SIDES) > 0.9
    in_texture = found.centre[:, 1] > 170.0
    assert found.length[in_texture].sum() < 0.003 * image[170:].size


def test_the_empty_border_of_a_rectified_picture_has_no_edges():
    """Turned by two degrees, as a rectification does, with zeros around."""
    turn = cv2.getRotationMatrix2D((100.0, 80.0), 2.0, 0.9)
    image = cv2.warpAffine(square(40.0, 1.0, 0.6).astype(np.float32), turn, (200, 160))
    found = segments_of(image)
    ends = np.array(SIDES, float).reshape(-1, 2) @ turn[:, :2].T + turn[:, 2]
    assert min(covered(found, *pair) for pair in ends.reshape(-1, 2, 2)) > 0.9
    assert len(found) == 4
    assert beside_border(image, 4) is not None


def test_something_before_a_black_ground_keeps_its_outline():
    image = square(120.0, 0.0, 0.6) - 100.0
    found = segments_of(np.maximum(image, 0.0))
    assert beside_border(np.maximum(image, 0.0).astype(np.float32), 4) is None
    assert min(covered(found, *side) for side in SIDES) > 0.9


@pytest.mark.parametrize('shape', [(1, 1), (4, 9), (9, 9), (11, 31)])
def test_the_smallest_pictures_have_nothing(shape):
    assert len(segments_of(np.full(shape, 50.0))) == 0
