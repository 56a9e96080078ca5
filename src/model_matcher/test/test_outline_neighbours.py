"""What of an outline is near what: boxes of curves leave out nothing that a look at every pair would find."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from model_matcher.image_pose.alignment import Placed
from model_matcher.image_pose.neighbours import may_hide, neighbours, own_step
from model_matcher.image_pose.presence import crowded, overlap
from model_matcher.image_pose.profiles import _normal_integral, _step_rows, _straight_profile, profile
from model_matcher.image_pose.settings import FLANK, SPACING


def strokes(rng: np.random.Generator, count: int) -> Placed:
    """Straight curves of 12 points, 4 px apart, in a small image, those of the second half in a second view."""
    angle, start = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, 60.0, (count, 2))
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pixel = (start[:, None] + 4.0 * np.arange(12)[:, None] * way[:, None]).reshape(-1, 2)
    normal = np.repeat(np.stack([-way[:, 1], way[:, 0]], axis=1), 12, axis=0)
    group = np.repeat(np.arange(count, dtype=np.int32), 12)
    eye = (group >= count // 2).astype(np.int32)
    n = len(group)
    return Placed(np.zeros((n, 3)), eye, pixel, normal, group, group, np.zeros(n), np.zeros((n, 6)))


def pairs_of(one: Placed, other: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all pairs of points of one view: (n, m) bool; shifts (n, m, 2); cosines between their normals (n, m)."""
    same_view = one.eye[:, None] == other.eye[None]
    return same_view, other.pixel[None] - one.pixel[:, None], one.normal @ other.normal.T


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 12))
def test_a_point_is_crowded_where_an_earlier_curve_is_near(seed, count):
    placed = strokes(np.random.default_rng(seed), count)
    same_view, shift, _ = pairs_of(placed, placed)
    near = same_view & ((shift**2).sum(axis=2) < own_step() ** 2) & (placed.group[:, None] > placed.group[None])
    np.testing.assert_array_equal(crowded(placed), near.any(axis=1))


# first_T_model, and two cameras with unit focal lengths: the second looks along x.
STILL = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
ALONG_Z_AND_X = np.array([[*STILL, 1.0, 1.0, 0.0, 0.0], [0, 0, -1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 1, 1, 0, 0]], float)


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 12))
def test_of_two_curves_on_one_step_the_farther_may_hide(seed, count):
    rng = np.random.default_rng(seed)
    placed = strokes(rng, count)
    placed = placed._replace(point=rng.uniform(1.0, 2.0, placed.point.shape))
    same_view, shift, _ = pairs_of(placed, placed)
    later = placed.group[:, None] > placed.group[None]
    near = same_view & later & ((shift**2).sum(axis=2) < own_step() ** 2)
    depth = np.where(placed.eye == 0, placed.point[:, 2], placed.point[:, 0])
    expected = ((near | near.T) & (depth[:, None] > depth[None])).any(axis=1)
    np.testing.assert_array_equal(may_hide(placed, STILL, ALONG_Z_AND_X), expected)


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 12))
def test_room_beside_a_point_ends_at_the_nearest_curve_across(seed, count):
    placed = strokes(np.random.default_rng(seed), count)
    flank = neighbours(placed, np.full(len(placed.group), 4.0))[1]
    same_view, shift, cosine = pairs_of(placed, placed)
    across = same_view & (placed.group[:, None] != placed.group[None]) & ((1.0 - cosine**2) * SPACING**2 > 1.0)
    gap = np.where(across & (np.abs(shift).max(axis=2) <= FLANK + 4.0), np.linalg.norm(shift, axis=2) - 2.0, np.inf)
    room = np.trunc(np.minimum(gap.min(axis=1), FLANK))
    np.testing.assert_array_equal(flank, np.where(room < 2, 0, room))


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 8))
def test_outlines_overlap_by_the_points_that_share_an_edge(seed, count):
    rng = np.random.default_rng(seed)
    one, other = strokes(rng, count), strokes(rng, count)
    mine, theirs = (rng.integers(-1, 2, len(some.group)).astype(np.int8) for some in (one, other))
    same_view, shift, cosine = pairs_of(one, other)
    near = same_view & (np.abs(shift).max(axis=2) < 4.0) & (cosine**2 > 0.5) & (theirs == 1)[None]
    expected = near.any(axis=1)[mine == 1].mean() if (mine == 1).any() else 0.0
    assert overlap(one, mine, other, theirs, 4.0) == expected


@settings(deadline=None)
@given(st.integers(0, 10**6), st.floats(1.0, 12.0))
def test_a_profile_in_whole_numbers_is_that_of_real_ones(seed, spacing):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (50, 60), dtype=np.uint8)
    angle = rng.uniform(0.0, 2.0 * math.pi)
    at = (*rng.uniform(0.0, 50.0, 2).tolist(), math.cos(angle), math.sin(angle))
    exact, quick = np.zeros(15), np.zeros(15)
    inside = profile(image, np.arange(256.0), at, spacing, 0.0, 7, exact, np.empty((3, 15)))
    assert _straight_profile(image, at, spacing, 7, quick) == inside
    # A weight's last digit is 1 / 65536, and a step of this picture up to 255.
    np.testing.assert_allclose(quick, exact, atol=0.02)


def test_the_normal_integral_has_seven_digits():
    for t in np.linspace(-6.0, 6.0, 241):
        exact = 0.5 * math.erfc(-t / math.sqrt(2.0))
        assert abs(_normal_integral(t, math.exp(-0.5 * t * t)) - exact) < 1e-7


@settings(deadline=None)
@given(st.floats(-8.5, 16.5), st.floats(0.35, 3.0), st.floats(-200.0, 200.0))
def test_derivatives_of_a_step_are_those_of_its_integral(at, blur, contrast):
    by_place, by_contrast = np.empty(9), np.empty(9)
    narrow = 1.0 / np.hypot(blur, np.linspace(0.0, 0.5, 9))
    _step_rows(at, contrast, np.array([narrow, np.zeros(9)]), by_place, by_contrast)
    t = (np.arange(9.0) - at) * narrow
    density = np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi) * narrow
    np.testing.assert_allclose(by_place, -contrast * density, rtol=1e-10, atol=1e-200)
    np.testing.assert_allclose(by_contrast, [0.5 * math.erfc(-one / math.sqrt(2.0)) for one in t], atol=1e-7)


@settings(deadline=None)
@given(st.floats(0.0, 8.0), st.floats(0.5, 3.0), st.floats(0.0, 1.0), st.floats(1.0, 200.0))
def test_the_shape_of_a_step_that_is_looked_up_between_two_pixels(at, blur, share, contrast):
    """Against the mean of both, to terms of the next order; and its derivative is that of the shape."""
    sigma = math.sqrt(blur**2 + share * (1.0 - share))
    sixth = share * (1.0 - share) * (2.0 * share - 1.0) / sigma**3 / 6.0
    blurs = np.tile([[1.0 / sigma], [sixth]], 9)
    rows = np.empty((3, 2, 9))
    for row, shift in zip(rows, (0.0, -1e-4, 1e-4)):
        _step_rows(at + shift, contrast, blurs, row[0], row[1])
    t = np.arange(9.0) - at
    exact = (1.0 - share) * ndtr((t - share) / blur) + share * ndtr((t + 1.0 - share) / blur)
    spread = share * (1.0 - share) / sigma**2
    np.testing.assert_allclose(rows[0, 1], exact, atol=0.1 * spread / sigma**2 + 1e-6)
    np.testing.assert_allclose(rows[0, 0], contrast * (rows[2, 1] - rows[1, 1]) / 2e-4, atol=2e-5 * contrast + 2e-3)
