"""Parts of one edge: what makes them one, what keeps them apart, and what of their covariance remains."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.edges.joining import join_parts

RIG = StereoRig.symmetric(PinholeCamera.centred(640, 480, 600.0), 0.1)
# Metres: the edge's line, a metre before the rig.
START, END = np.array([-0.2, 0.05, 1.0]), np.array([0.25, 0.06, 1.05])


def parts(cuts: list[tuple[float, float]], moved: dict | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Edges (n, 2, 3) between shares of the line, some of them moved, and their covariances (n, 6, 6)."""
    share = np.array(cuts)[..., None]
    ends = (1.0 - share) * START + share * END
    for index, by in (moved or {}).items():
        ends[index] += by
    sigma = np.tile([2e-4, 2e-4, 1e-3], 2)
    return ends, np.tile(np.diag(sigma**2), (len(ends), 1, 1))


def picture(gap: tuple[float, float] | None = None, inverted: bool = False) -> np.ndarray:
    """The left image: dark above the line and bright below it; in a gap plain, or the other way round."""
    a, b = (RIG.left.project(point[None])[0] for point in (START, END))
    v, u = np.mgrid[0:480, 0:640].astype(float)
    below = (b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0]) > 0.0
    grey = np.where(below, 160.0, 80.0)
    if gap is not None:
        along = (u - a[0]) / (b[0] - a[0])
        within = (along > gap[0]) & (along < gap[1])
        grey = np.where(within, 240.0 - grey if inverted else 120.0, grey)
    return grey.astype(np.float32)


def test_two_parts_with_a_small_gap_are_one_edge():
    ends, covariance = parts([(0.0, 0.45), (0.55, 1.0)])
    whole, spread = join_parts(ends, covariance, RIG, picture())
    np.testing.assert_allclose(whole, [[START, END]], atol=1e-6)
    assert spread.shape == (1, 6, 6)
    assert np.linalg.eigvalsh(spread[0]).min() > 0.0


def test_what_parts_share_is_not_counted_twice():
    """Parts hang on the same neighbours: the ends of the whole are known no better than theirs."""
    ends, covariance = parts([(0.0, 0.5), (0.5, 1.0)])
    _, spread = join_parts(ends, covariance, RIG, picture())
    assert len(spread) == 1
    assert (np.diag(spread[0]) > 0.99 * np.diag(covariance[0])).all()
    assert (np.diag(spread[0]) < 3.0 * np.diag(covariance[0])).all()


@pytest.mark.parametrize(
    ('cuts', 'moved'),
    [
        ([(0.0, 0.3), (0.7, 1.0)], None),
        ([(0.0, 0.45), (0.55, 1.0)], {1: np.array([0.0, 0.01, 0.0])}),
        ([(0.0, 0.45), (0.55, 1.0)], {1: np.array([0.0, 0.0, 0.05])}),
    ],
    ids=['a wide gap', 'another line', 'another depth'],
)
def test_what_is_apart_stays_apart(cuts, moved):
    ends, covariance = parts(cuts, moved)
    assert len(join_parts(ends, covariance, RIG, picture())[0]) == 2


@pytest.mark.parametrize('inverted', [False, True])
def test_a_gap_in_which_the_picture_does_not_go_on_keeps_them_apart(inverted):
    ends, covariance = parts([(0.0, 0.45), (0.55, 1.0)])
    assert len(join_parts(ends, covariance, RIG, picture((0.45, 0.55), inverted))[0]) == 2


def test_parts_whose_contrast_changes_sides_are_two_edges():
    ends, covariance = parts([(0.0, 0.45), (0.55, 1.0)])
    ends[1] = ends[1, ::-1].copy()
    assert len(join_parts(ends, covariance, RIG, picture())[0]) == 2


def test_three_parts_are_one_and_the_rest_is_as_it_was():
    ends, covariance = parts([(0.0, 0.3), (0.34, 0.6), (0.64, 1.0)])
    other = np.array([[[-0.1, -0.2, 1.2], [0.2, -0.15, 1.1]]])
    whole, _ = join_parts(np.concatenate([ends, other]), np.concatenate([covariance, covariance[:1]]), RIG, picture())
    assert len(whole) == 2
    np.testing.assert_allclose(whole[0], [START, END], atol=1e-6)
    np.testing.assert_array_equal(whole[1], other[0])


def test_no_edges_are_no_edges():
    whole, spread = join_parts(np.zeros((0, 2, 3)), np.zeros((0, 6, 6)), RIG, picture())
    assert (len(whole), len(spread)) == (0, 0)
