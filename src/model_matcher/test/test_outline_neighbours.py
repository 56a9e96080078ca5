"""What of an outline is near what: boxes of curves leave out nothing that a look at every pair would find."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from scipy.special import ndtr

from model_matcher.image_pose.alignment import Placed
from model_matcher.image_pose.finding import _straight_profile
from model_matcher.image_pose.neighbours import may_hide, neighbours, own_step
from model_matcher.image_pose.presence import crowded, overlap
from model_matcher.image_pose.profiles import _normal_integral, _step_rows, pixel_profile
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
    at, normal = rng.uniform(0.0, 50.0, 2), np.array([math.cos(angle), math.sin(angle)])
    quick = np.zeros(15)
    inside = _straight_profile(image, (*at.tolist(), *normal.tolist()), spacing, 7, quick)
    count = max(1, round(spacing))
    along = spacing * ((np.arange(count) + 0.5) / count - 0.5)
    places = at + np.arange(-7.0, 8.0)[:, None, None] * normal + along[:, None] * [normal[1], -normal[0]]
    ends = (
        at
        + np.array([-8.0, 8.0])[:, None, None] * normal
        + [[-0.5 * spacing], [0.5 * spacing]] * np.array([normal[1], -normal[0]])
    )
    assert inside == bool(((ends >= 0.0) & (ends < [59.0, 49.0])).all())
    if inside:
        exact = map_coordinates(image.astype(float), places[..., ::-1].reshape(-1, 2).T, order=1).reshape(15, count)
        # A weight's last digit is 1 / 65536, and a step of this picture up to 255.
        np.testing.assert_allclose(quick, exact.mean(axis=1), atol=0.02)


@settings(deadline=None)
@given(
    st.sampled_from([(3, 2), (2, 3), (-3, 1), (0, 2), (-1, -1), (1, -3), (4, 0)]),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(0.5, 9.0),
)
def test_levels_of_pixels_are_those_of_the_distances_they_are_said_to_have(slope, u, v, spacing):
    """Of a picture that rises evenly."""
    y, x = np.mgrid[0:41, 0:41]
    image = (slope[0] * (x - 20) + slope[1] * (y - 20) + 128).astype(np.uint8)
    steep = math.hypot(*slope)
    out = np.empty((4, 9))
    at = (20.0 + u, 20.0 + v, slope[0] / steep, slope[1] / steep)
    assert pixel_profile(image, np.arange(256.0), at, spacing, 0.0, 4, out) >= 1
    np.testing.assert_allclose(out[0], 128.0 + slope[0] * u + slope[1] * v + steep * out[1], atol=1e-9)
    assert (np.diff(out[1]) > 0.7).all() and abs(out[1, 4]) <= 0.75
    assert (out[2] <= 0.25 + 1e-9).all() and np.ptp(out[2]) < 1e-9 and np.ptp(out[3]) < 1e-9


@settings(deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(1.0, 7.0), st.integers(0, 10**6))
def test_stretches_that_follow_one_another_share_no_pixel(angle, spacing, seed):
    pixel, normal = np.array([40.3, 40.7]), np.array([math.cos(angle), math.sin(angle)])
    image = np.random.default_rng(seed).integers(0, 256, (81, 81)).astype(np.uint8)
    out, total, count = np.empty((4, 1)), 0.0, 0
    crossed_axis = 1 if abs(normal[0]) > abs(normal[1]) else 0
    for k in range(4):
        at = pixel + (k - 1.5) * spacing * np.array([normal[1], -normal[0]])
        # Where one ends on a pixel's very middle, rounding says whose it is.
        ends = at[crossed_axis] + 0.5 * spacing * max(abs(normal)) * np.array([-1.0, 1.0])
        assume((abs(ends - np.rint(ends)) > 1e-9).all())
        n = pixel_profile(image, np.arange(256.0), (*at.tolist(), *normal.tolist()), spacing, 0.0, 0, out)
        total, count = total + n * out[0, 0], count + n
    # As many as columns, or rows, that all of them cross; a stretch between two takes one of them.
    crossed = 4.0 * spacing * max(abs(normal))
    assert abs(count - crossed) <= 1.0 or spacing * max(abs(normal)) < 1.0


def test_of_a_curve_pixels_are_as_far_as_they_are():
    """Of a circle of 30 pixels, whose middle lies ahead."""
    y, x = np.mgrid[0:41, 0:41]
    for angle in np.linspace(0.0, 2.0 * math.pi, 17):
        normal = np.array([math.cos(angle), math.sin(angle)])
        middle = np.array([20.2, 19.7]) + 30.0 * normal
        inside = 30.0 - np.hypot(x - middle[0], y - middle[1])
        image = np.clip(np.rint(128.0 + 10.0 * inside), 0, 255).astype(np.uint8)
        levels = (np.arange(256.0) - 128.0) / 10.0
        out = np.empty((4, 7))
        assert pixel_profile(image, levels, (20.2, 19.7, *normal.tolist()), 4.0, 1.0 / 30.0, 3, out)
        np.testing.assert_allclose(out[1], out[0], atol=0.1)


def test_the_normal_integral_has_seven_digits():
    for t in np.linspace(-6.0, 6.0, 241):
        exact = 0.5 * math.erfc(-t / math.sqrt(2.0))
        assert abs(_normal_integral(t, math.exp(-0.5 * t * t)) - exact) < 1e-7


@settings(deadline=None)
@given(st.floats(-8.5, 16.5), st.floats(0.35, 3.0), st.floats(-200.0, 200.0))
def test_derivatives_of_a_step_are_those_of_its_integral(at, blur, contrast):
    rows, bell = np.empty((2, 9)), np.empty((2, 9))
    narrow = 1.0 / np.hypot(blur, np.linspace(0.0, 0.5, 9))
    _step_rows(at, contrast, np.array([np.arange(9.0), narrow, np.zeros(9), np.zeros(9)]), rows, bell)
    by_place, by_contrast = rows
    t = (np.arange(9.0) - at) * narrow
    density = np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi) * narrow
    np.testing.assert_allclose(by_place, -contrast * density, rtol=1e-10, atol=1e-200)
    np.testing.assert_allclose(by_contrast, [0.5 * math.erfc(-one / math.sqrt(2.0)) for one in t], atol=1e-7)


@settings(deadline=None)
@given(st.floats(0.0, 8.0), st.floats(0.5, 3.0), st.floats(0.0, 1.0), st.floats(1.0, 200.0))
def test_the_shape_of_a_step_in_pixels_at_two_distances(at, blur, share, contrast):
    """Against the mean of both, to terms of the next order; and its derivative is that of the shape."""
    sigma = math.sqrt(blur**2 + share * (1.0 - share))
    sixth = share * (1.0 - share) * (2.0 * share - 1.0) / sigma**3 / 6.0
    levels = np.stack([np.arange(9.0), np.full(9, 1.0 / sigma), np.full(9, sixth), np.zeros(9)])
    rows = np.empty((3, 2, 9))
    for row, shift in zip(rows, (0.0, -1e-4, 1e-4)):
        _step_rows(at + shift, contrast, levels, row, np.empty_like(row))
    t = np.arange(9.0) - at
    exact = (1.0 - share) * ndtr((t - share) / blur) + share * ndtr((t + 1.0 - share) / blur)
    spread = share * (1.0 - share) / sigma**2
    np.testing.assert_allclose(rows[0, 1], exact, atol=0.1 * spread / sigma**2 + 1e-6)
    np.testing.assert_allclose(rows[0, 0], contrast * (rows[2, 1] - rows[1, 1]) / 2e-4, atol=2e-5 * contrast + 2e-3)


@settings(deadline=None)
@given(st.floats(0.0, 8.0), st.floats(0.3, 1.5), st.floats(1.0, 200.0))
def test_the_shape_of_a_step_that_square_pixels_count(at, lens, contrast):
    """Of an upright edge a pixel is the mean of a bell over one pixel; the excess takes most of the difference off."""
    blur, where = math.sqrt(lens**2 + 1.0 / 12.0), np.linspace(-2.0, 10.0, 481)
    levels = np.stack([where, np.full(481, 1.0 / blur), np.zeros(481), np.full(481, -1.0 / 120.0 / blur**4 / 24.0)])
    rows = np.empty((3, 2, 481))
    for row, shift in zip(rows, (0.0, -1e-4, 1e-4)):
        _step_rows(at + shift, contrast, levels, row, np.empty_like(row))

    def integral(x):
        return x * ndtr(x) + np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)

    exact = lens * (integral((where - at + 0.5) / lens) - integral((where - at - 0.5) / lens))
    as_bells = np.abs(ndtr((where - at) / blur) - exact).max()
    assert np.abs(rows[0, 1] - exact).max() < max(0.35 * as_bells, 1e-6)
    np.testing.assert_allclose(rows[0, 0], contrast * (rows[2, 1] - rows[1, 1]) / 2e-4, atol=2e-5 * contrast + 2e-3)


@settings(deadline=None)
@given(st.floats(-0.2, 0.2), st.floats(1.0, 3.0), st.floats(0.0, 2.0 * math.pi))
def test_of_a_curve_beside_a_point_it_is_known_how_it_runs(turn, apart, angle):
    """Two straight curves of twelve points, the second turned about the place where it crosses the first's normal."""
    along = 4.0 * (np.arange(12) - 5.5)
    way = [np.array([math.cos(one), math.sin(one)]) for one in (angle, angle + turn)]
    normal = [np.array([-one[1], one[0]]) for one in way]
    pixel = np.concatenate([along[:, None] * way[0], apart * normal[0] + along[:, None] * way[1]])
    group = np.repeat(np.arange(2, dtype=np.int32), 12)
    placed = Placed(
        np.zeros((24, 3)),
        np.zeros(24, np.int32),
        pixel,
        np.repeat(normal, 12, axis=0),
        group,
        group,
        np.zeros(24),
        np.zeros((24, 6)),
    )
    beside = neighbours(placed, np.full(24, 4.0))[0]
    middle = beside[5:7, 0]
    np.testing.assert_allclose(middle[:, 1], abs(math.tan(turn)), atol=1e-7)
    np.testing.assert_allclose(middle[:, 0], apart + math.tan(turn) * along[5:7], atol=1e-9)
