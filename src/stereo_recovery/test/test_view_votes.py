"""Which cameras agree on a segment, and which do not see the scene."""

from __future__ import annotations

import numpy as np
import pytest

from stereo_recovery.detection.segments import Segments
from stereo_recovery.edges.transfer import on_segments
from stereo_recovery.edges.view_votes import Hypotheses, agreement, elected, sighted

EXTENT = np.array([[-40.0, 40.0]])


def silent(count: int, n: int) -> np.ndarray:
    """No picture confirms or contradicts anything."""
    return np.zeros((count, count, n))


def says(x: list[list[float]], sigma: float = 0.1, odds: float = 4.0, known: list[bool] | None = None) -> Hypotheses:
    """A camera that knows each segment's disparity and slope as well as a line of 80 px knows them."""
    n = len(x)
    covariance = np.tile(np.diag([sigma**2, (sigma / 40.0) ** 2]), (n, 1, 1))
    there = np.ones(n, bool) if known is None else np.array(known)
    return Hypotheses(there, np.array(x), covariance, np.where(there, odds, 0.0))


def test_two_agree_when_their_errors_explain_what_they_differ_by():
    one = says([[50.0, 0.01]] * 3)
    other = says([[50.2, 0.01], [51.0, 0.01], [50.0, 0.05]])
    assert agreement([one, other])[0, 1].tolist() == [True, False, False]
    # Who knows nothing of the depth contradicts nobody.
    assert agreement([one, says([[80.0, 0.2]] * 3, sigma=30.0)])[0, 1].all()


def test_the_third_camera_decides_between_two():
    pair = says([[50.0, 0.0], [50.0, 0.0], [50.0, 0.0]], odds=6.0)
    second = says([[60.0, 0.0], [50.0, 0.0], [60.0, 0.0]], odds=4.0)
    third = says([[60.1, 0.0], [70.0, 0.0], [70.0, 0.0]], odds=4.0)
    # Outvoted; confirmed by one of two; alone, but the likeliest.
    assert elected([pair, second, third], silent(3, 3)).T.tolist() == [
        [False, True, True],
        [True, True, False],
        [True, False, False],
    ]


def test_of_two_that_differ_the_likelier_counts_and_what_one_alone_says():
    pair = says([[50.0, 0.0]] * 3, odds=1.0, known=[True, True, False])
    other = says([[60.0, 0.0]] * 3, odds=3.0, known=[True, False, True])
    assert elected([pair, other], silent(2, 3)).T.tolist() == [[False, True], [True, False], [False, True]]


@pytest.mark.parametrize(('right', 'wrong', 'sees'), [(20, 2, True), (2, 20, False), (0, 0, True), (0, 4, False)])
def test_a_camera_is_blind_when_it_agrees_on_hardly_anything(right, wrong, sees):
    n = max(right + wrong, 1)
    pair = says([[50.0, 0.0]] * n)
    x = np.array([[50.0, 0.0]] * right + [[63.0, 0.0]] * (n - right))
    other = says(x.tolist(), known=[True] * (right + wrong) + [False] * (n - right - wrong))
    assert sighted([pair, other], np.repeat(EXTENT, n, axis=0), silent(2, n)).tolist() == [True, sees]


def test_what_the_other_picture_confirms_wins_and_its_camera_sees():
    """The pair is a period off everywhere; what the third camera says is found in the pair's right picture."""
    pair = says([[50.0, 0.0]] * 9, odds=4.0)
    other = says([[60.0, 0.0]] * 9, odds=3.0)
    confirmed = silent(2, 9)
    extent = np.repeat(EXTENT, 9, axis=0)
    assert elected([pair, other], confirmed)[0].all()
    assert not sighted([pair, other], extent, confirmed)[1]
    confirmed[0, 1], confirmed[1, 0] = -1.0, 1.0
    assert elected([pair, other], confirmed)[1].all() and not elected([pair, other], confirmed)[0].any()
    assert sighted([pair, other], extent, confirmed)[1]


def test_a_prediction_is_confirmed_by_a_segment_under_it():
    picture = Segments.between(np.array([[[100.0, 20.0], [110.0, 120.0]]]), 0.05)
    right = [[102.0, 40.0], [108.0, 100.0]]
    places = np.array([right, np.add(right, [8.0, 0.0]), [[112.0, 140.0], [118.0, 200.0]], np.add(right, [3.0, 0.0])])
    sigma = np.array([[0.1, 0.1]] * 3 + [[2.0, 2.0]])
    # On it; beside it; on its line, but beyond; beside it, but no better known.
    assert on_segments(places, sigma, picture).tolist() == [True, False, False, True]
    assert not on_segments(places, sigma, picture.select(np.zeros(1, bool))).any()
