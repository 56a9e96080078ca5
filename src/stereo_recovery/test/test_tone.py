"""Edges of pictures that code light: where light has them, and only where the picture shows that it codes."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from stereo_recovery import tone
from stereo_recovery.detection.edgels import Edgels
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.view import View, detect_views
from stereo_recovery.params import RecoveryParams

SIZE, TURN, SIGMA = 200, np.radians(11.0), RecoveryParams().sigma
# Through the picture's middle: the two lines of a board of four squares.
ALONG = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])


def board(dark: float, bright: float, exponent: float, blur: float = 0.8, squares: int = 4) -> np.ndarray:
    """Four squares, or one dark half, of two codes of light: blurred in light, then coded; grey levels with noise."""
    v, u = np.mgrid[:SIZE, :SIZE] - 0.5 * (SIZE - 1)
    first, second = (ndtr((u * -a[1] + v * a[0]) / blur) for a in ALONG)
    share = first * second + (1.0 - first) * (1.0 - second) if squares == 4 else first
    light = (dark / 255.0) ** exponent * (1.0 - share) + (bright / 255.0) ** exponent * share
    noise = np.random.default_rng(3).normal(0.0, 0.5, light.shape)
    return (255.0 * light ** (1.0 / exponent) + noise).astype(np.float32)


def all_seen(images: Sequence[np.ndarray]) -> list[View]:
    """What is detected in pictures, and where light has it."""
    params = RecoveryParams()
    return tone.in_light(detect_views(images, params.detector, params.sigma, params.low, params.high), params.sigma)


def seen(image: np.ndarray) -> View:
    """What is detected in it."""
    return all_seen([image])[0]


def off_lines(segments: Segments) -> np.ndarray:
    """Pixels by which the longest segments lie off the board's lines, towards their bright sides."""
    some = segments.select(segments.length > 50.0)
    away = some.centre - 0.5 * (SIZE - 1)
    own = np.abs(some.direction @ ALONG.T).argmax(axis=1)
    across = np.stack([-ALONG[own, 1], ALONG[own, 0]], axis=1)
    bright = np.stack([-some.direction[:, 1], some.direction[:, 0]], axis=1)
    return np.asarray((away * across).sum(axis=1) * np.sign((across * bright).sum(axis=1)))


@pytest.mark.parametrize('dark', [2.0, 20.0, 60.0])
def test_lines_of_a_coded_board_lie_where_light_has_them(dark: float) -> None:
    view = seen(board(dark, 200.0, 2.2))
    assert len(view.segments.select(view.segments.length > 50.0)) == 4
    assert np.abs(off_lines(view.segments)).max() < 0.04


def test_a_coded_board_shows_them_on_the_dark_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the test before would show nothing."""
    monkeypatch.setattr(tone, 'CODED_LOG_ODDS', np.inf)
    assert off_lines(seen(board(20.0, 200.0, 2.2)).segments).max() < -0.15


def test_edgels_move_with_their_lines() -> None:
    view = seen(board(20.0, 200.0, 2.2))
    for k in np.flatnonzero(view.segments.length > 50.0):
        first, last = view.segments.bounds[k]
        away = view.edgels.position[first:last] - view.segments.centre[k]
        across = away @ np.array([-view.segments.direction[k, 1], view.segments.direction[k, 0]])
        assert abs(np.median(across)) < 0.02


def test_a_board_that_is_not_coded_is_left_as_it_is() -> None:
    image = board(20.0, 200.0, 1.0)
    view = seen(image)
    assert np.abs(off_lines(view.segments)).max() < 0.02
    assert tone.in_light([view], SIGMA)[0] is view


def test_one_edge_says_nothing_of_the_code() -> None:
    image = board(20.0, 200.0, 2.2, squares=1)
    view = seen(image)
    assert len(tone.reversals(view.segments).offset) == 0
    assert off_lines(view.segments).max() < -0.1


def test_a_picture_that_tells_nothing_is_like_the_other_one() -> None:
    views = all_seen([board(20.0, 200.0, 2.2), board(20.0, 200.0, 2.2, squares=1)])
    assert all(np.abs(off_lines(view.segments)).max() < 0.04 for view in views)


def test_pictures_that_say_otherwise_have_a_share_each() -> None:
    views = all_seen([board(20.0, 200.0, 2.2), board(20.0, 200.0, 1.0)])
    assert all(np.abs(off_lines(view.segments)).max() < 0.05 for view in views)


def test_nothing_in_the_picture() -> None:
    segments = Segments.between(np.zeros((0, 2, 2)), 0.1)
    empty = View(np.zeros((9, 9), np.float32), Edgels.empty(), segments, [])
    assert tone.in_light([empty, empty], SIGMA)[1] is empty


@settings(deadline=None, max_examples=20)
@given(st.floats(0.0, 1.5), st.integers(6, 40), st.integers(0, 1000))
def test_the_share_that_pairs_of_edges_show_is_found(share: float, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shift = rng.uniform(0.1, 0.3, 2 * count)
    first, second = np.arange(count), np.arange(count, 2 * count)
    offset = share * (shift[first] + shift[second]) + rng.normal(0.0, 0.02, count)
    # Three of ten are on two lines.
    offset[: count * 3 // 10] = rng.uniform(-1.0, 1.0, count * 3 // 10)
    found = tone.shares_of_code([tone.Reversals(first, second, offset, np.full(count, 0.02**2))], [shift])[0]
    # Of little, nothing is believed; of the rest less by what is believed beforehand.
    assert abs(found - share) < (0.35 if found == 0.0 else 0.25 + 0.1 * share)
