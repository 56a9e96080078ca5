"""The pose measured in images: steps, alignment, presence, and the whole on rendered pairs."""

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from csg_renderer import Light, Scene, SolidOutline, load_models, model_features, render_stereo
from csg_renderer.raycast.sensor import SensorModel
from model_matcher import MatchParams, index_model, match
from model_matcher.geometry.pose_rows import as_motion
from model_matcher.image_pose.alignment import Equations, Fit, ModelError, Placed, Prior
from model_matcher.image_pose.finding import find_steps
from model_matcher.image_pose.image_quality import look_of
from model_matcher.image_pose.measurement import (
    Laid,
    _log_odds_of_code,
    _of_other,
    drawn_in,
    measure_pose,
    polished,
    presence,
)
from model_matcher.image_pose.model_error import (
    FIRST_ERROR,
    _log_likelihood,
    _of_images,
    as_likely,
    fitted_model_error,
    sums_of_lines,
)
from model_matcher.image_pose.presence import Chance, behind_screens, bent, log_ratio
from model_matcher.image_pose.profiles import FITTED, Quality, Stretches, fit_profiles, fit_steps, profiles_of
from model_matcher.image_pose.settings import (
    BESIDE,
    CANDIDATES,
    FARTHEST_STEP,
    FIRST_SLOPE,
    FIRST_WALK,
    FLANK,
    IMAGE_TURNS,
    LEAST_SLOPE,
    WALKS,
)
from model_matcher.image_pose.shade import settle_slopes
from model_matcher.image_pose.sight import look, same_curves
from model_matcher.image_pose.views import Views
from model_matcher.model.equal_poses import apart
from model_matcher.model.problem import make_problem
from model_matcher.verification.image_evidence import accepted_by_images, weigh
from msgs_py import BIN, Interpretation, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.deadline import Deadline
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.settings import DECISIVE
from stereo_recovery import recover

CAMERA = PinholeCamera.centred(512, 512, 700.0)


def step_image(places, levels, angle, blur=0.6, noise=0.0, seed=0, shade=None):
    """(64, 64) uint8 with straight steps across its middle: places along the normal, pixels; levels, one more.

    blur : pixels, sigma, that of square pixels counted

    shade : (n,) what is added to the levels, at n places evenly from 40 pixels before the middle to 40 after it
    """
    v, u = np.mgrid[0:64, 0:64] - 31.5
    across = u * np.cos(angle) + v * np.sin(angle)
    lens = math.sqrt(blur**2 - 1.0 / 12.0)
    part = (np.arange(6) - 2.5) / 6.0
    within = (part[:, None] * np.cos(angle) + part * np.sin(angle)).ravel()
    image = np.full(across.shape, float(levels[0]))
    for place, before, after in zip(places, levels[:-1], levels[1:]):
        image += (after - before) * ndtr((across[..., None] + within - place) / lens).mean(axis=-1)
    if shade is not None:
        image += np.interp(across, np.linspace(-40.0, 40.0, len(shade)), shade)
    image += np.random.default_rng(seed).normal(scale=noise, size=image.shape) if noise else 0.0
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def stretches(angle, count=8, spacing=4.0):
    """Points along the middle line of a step image."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    along = (np.arange(count) - 0.5 * (count - 1)) * spacing
    pixel = 31.5 + along[:, None] * np.array([-normal[1], normal[0]])
    still = np.zeros(count)
    return Stretches(
        pixel,
        np.tile(normal, (count, 1)),
        np.full(count, spacing),
        still,
        still,
        np.full(count, FLANK, np.int32),
        np.ones(count),
    )


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(0.0, 2.0 * math.pi), st.floats(0.5, 1.2))
@example(0.25, 0.0, 0.5)
def test_a_step_is_fitted_where_it_is(place, angle, blur):
    """Also a step along rows or columns, all of whose pixels are as far from it."""
    out = fitted_step(place, angle, blur)
    assert np.abs(out[:, 0].mean() - place) < 0.02
    np.testing.assert_allclose(out[:, 2], 120.0, rtol=0.1)


def test_steps_are_fitted_without_bias():
    rng = np.random.default_rng(0)
    at = zip(rng.uniform(-1.0, 1.0, 60), rng.uniform(0.0, 2.0 * math.pi, 60), rng.uniform(0.5, 1.2, 60))
    off = [fitted_step(place, angle, blur)[:, 0].mean() - place for place, angle, blur in at]
    assert abs(np.mean(off)) < 0.002
    assert np.sqrt(np.mean(np.square(off))) < 0.006


def fitted_step(place, angle, blur):
    """What is fitted to a step image without noise, (8, FITTED)."""
    return fitted(step_image([place], [60, 180], angle, blur), angle, Quality(1.0, blur, 0.3, FIRST_WALK, LEAST_SLOPE))


def fitted(image, angle, quality, beside=math.nan, together=1.0):
    """What is fitted to an image of a step across its middle, and of another so many pixels beside it, (8, FITTED)."""
    outline = stretches(angle)
    outline = outline._replace(together=together * outline.together)
    out, further = np.empty((len(outline.spacing), FITTED)), np.full((len(outline.spacing), BESIDE, 2), np.nan)
    further[:, 0] = beside, 0.0
    fit_steps(image, outline, further, quality, out)
    return out


@settings(max_examples=30, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(0.0, 2.0 * math.pi), st.floats(0.5, 1.5), st.sampled_from([0.9, 1.05, 1.25]))
def test_a_fit_that_begins_at_one_of_another_blur_ends_where_it_would(place, angle, blur, times):
    """Within a tenth of its sigma; and what is left, by which blurs are compared, is as much, to a fiftieth."""
    image, outline = step_image([place], [60, 180], angle, blur, noise=1.0), stretches(angle)
    nothing = np.full((len(outline.spacing), BESIDE, 2), np.nan)
    profiles, ends = profiles_of(image, outline, 1.0), []
    for first in (blur, times * blur):
        out = np.full((len(outline.spacing), FITTED), np.nan)
        for one in (first, blur):
            fit_profiles(profiles, outline, nothing, Quality(1.0, one, 1.0, WALKS[0], FIRST_SLOPE), out)
        ends.append(out)
    same, other = ends
    np.testing.assert_array_less(np.abs(same[:, 0] - other[:, 0]), 0.1 * np.sqrt(same[:, 1]))
    np.testing.assert_allclose(same[:, 3], other[:, 3], rtol=0.02)


def test_steps_beside_one_another_are_told_apart():
    image = step_image([0.2, 2.0], [160, 60, 150], 0.4)
    out = fitted(image, 0.4, Quality(1.0, 0.6, 0.3, FIRST_WALK, LEAST_SLOPE), beside=1.7)
    assert np.abs(out[:, 0] - 0.2).max() < 0.06


@pytest.mark.parametrize('width', [1.2, 1.6, 2.5])
@pytest.mark.parametrize('levels', [(40, 160, 90), (30, 200, 60), (40, 120, 200)])
def test_the_edges_of_a_narrow_strip_are_where_they_are(width, levels):
    """As bells, square pixels would have them up to 0.02 pixels farther apart."""
    off = []
    for angle in np.linspace(0.1, 6.2, 12):
        image = step_image([0.1, 0.1 + width], levels, angle, 0.577)
        off.append(fitted(image, angle, Quality(1.0, 0.577, 1.0, WALKS[0], LEAST_SLOPE), beside=width)[:, 0] - 0.1)
    assert abs(np.mean(off)) < 0.006


def shaded_points(slope, group, rng, noise=1.0):
    """Steps of an image whose shade has a slope on one side, (8, FITTED), with a wide sigma of it and a small."""
    across = np.linspace(-40.0, 40.0, 81)
    shade = np.where(across < 0.0, 0.0, slope) * across
    image = step_image([0.0], [100, 160], 0.7, 0.8, noise, int(rng.integers(10**6)), shade)
    wide, flat = (
        fitted(image, 0.7, Quality(1.0, 0.8, noise, WALKS[0], sigma), together=8.0) for sigma in (2.0, LEAST_SLOPE)
    )
    return np.full(8, group, np.int32), wide, flat


def test_of_flat_faces_steps_are_as_if_no_shade_had_been_thought_of():
    """But for the little that a shaded face is still probable; of a shaded one they are as they were fitted."""
    rng = np.random.default_rng(3)
    group, wide, flat = (np.concatenate(part) for part in zip(*(shaded_points(0.0, k, rng) for k in range(20))))
    settled = wide.copy()
    settle_slopes(group, LEAST_SLOPE, 2.0, settled)
    assert np.sqrt(np.mean((settled[:, 0] - flat[:, 0]) ** 2 / flat[:, 1])) < 0.1
    assert settled[:, 1].mean() < 0.8 * flat[:, 1].mean() + 0.2 * wide[:, 1].mean()
    np.testing.assert_allclose(np.median(settled[:, 1] / flat[:, 1]), 1.0, atol=0.1)
    more, also, _ = shaded_points(6.0, 20, rng)
    group, both = np.concatenate([group, more]), np.concatenate([wide, also])
    settle_slopes(group, LEAST_SLOPE, 2.0, both)
    np.testing.assert_allclose(both[-8:], also, atol=1e-3)
    assert abs(both[-8:, 0].mean()) < 0.1 < np.abs(shaded_points(6.0, 20, rng)[2][:, 0].mean())


def test_the_stated_variance_is_that_of_noise_and_shade():
    angle, noise = 0.7, 3.0
    places, stated = [], []
    for seed in range(60):
        # In steps of a hundredth of a pixel.
        walk = np.cumsum(np.random.default_rng(1000 + seed).normal(scale=0.1 * FIRST_WALK, size=8001))
        image = step_image([0.3], [80, 140], angle, 0.7, noise, seed, walk - walk[4000])
        out = fitted(image, angle, Quality(1.0, 0.7, noise, FIRST_WALK, LEAST_SLOPE))
        places.append(out[:, 0])
        stated.append(out[:, 1])
    assert 0.8 < np.var(places) / np.mean(stated) < 1.25


@pytest.mark.parametrize('angle', [0.0, 0.3, 0.7854, 2.0])
def test_noise_leaves_what_it_is_said_to_in_any_direction(angle):
    noise = 4.0
    places, stated, left = [], [], []
    for seed in range(150):
        image = step_image([0.3], [80, 180], angle, 0.7, noise, seed)
        out = fitted(image, angle, Quality(1.0, 0.7, noise, WALKS[0], LEAST_SLOPE))
        places.append(out[:, 0])
        stated.append(out[:, 1])
        left.append(out[:, 3])
    assert 0.75 < np.mean(left) < 1.25
    assert 0.75 < np.var(places, axis=0).mean() / np.mean(stated) < 1.25


@settings(max_examples=20, deadline=None)
@given(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.0, 2.0 * math.pi))
def test_shade_on_either_side_of_a_step_hardly_moves_it(before, after, angle):
    # Grey levels a pixel, on either side: with levels that are the same all along a step of
    # 60 between slopes of 4 and -4 would be found 0.59 pixels off. What is odd about the step is left to the walk.
    across = np.linspace(-40.0, 40.0, 81)
    shade = np.where(across < 0.0, before, after) * across
    image = step_image([0.0], [100, 160], angle, 0.8, shade=shade)
    out = fitted(image, angle, Quality(1.0, 0.8, 0.3, FIRST_WALK, 10.0))
    assert np.abs(out[:, 0].mean()) < 0.1


@pytest.mark.parametrize(('levels', 'tone'), [([0, 60], 1.0), ([255, 200], 1.0), ([0, 40], 2.2), ([0, 255], 1.0)])
def test_a_step_at_black_or_white_is_where_it_is_in_noise_that_is_cut_off(levels, tone):
    """Cut off, the mean of a black pixel is 0.4 sigma above black, and an edge would be 0.05 pixels to its side."""
    angle, noise, place = 0.5, 6.0, 0.2
    light = step_image([place], levels, angle, 0.8).astype(float)
    coded = 255.0 * (light / 255.0) ** (1.0 / tone)
    rng, off = np.random.default_rng(8), []
    for _ in range(100):
        image = np.clip(np.rint(coded + rng.normal(scale=noise, size=coded.shape)), 0, 255).astype(np.uint8)
        off.append(fitted(image, angle, Quality(tone, 0.8, noise, WALKS[0], LEAST_SLOPE))[:, 0] - place)
    assert abs(np.nanmean(off)) < 0.01 + 2.0 * np.nanstd(off) / math.sqrt(np.size(off))


def test_a_tone_curve_does_not_move_a_step():
    angle = 0.9
    light = step_image([0.3], [20, 200], angle, 0.8).astype(float)
    coded = np.rint(255.0 * (light / 255.0) ** (1.0 / 2.2)).astype(np.uint8)
    out = fitted(coded, angle, Quality(2.2, 0.8, 0.3, FIRST_WALK, LEAST_SLOPE))
    assert np.abs(out[:, 0].mean() - 0.3) < 0.02
    out = fitted(coded, angle, Quality(1.0, 0.8, 0.3, FIRST_WALK, LEAST_SLOPE))
    assert np.abs(out[:, 0].mean() - 0.3) > 0.1


def test_the_tone_curve_is_told_from_the_outline():
    shape, _, pose, views, rig = rendered('plug', 1)
    assert views.tone[0] == 0.0
    measure_pose(shape, pose, views)
    assert views.tone[0] == 1.0
    coded = Views.of([np.rint(255.0 * (image / 255.0) ** (1.0 / 2.2)).astype(np.uint8) for image in views.images], rig)
    found = measure_pose(shape, pose, coded)
    assert coded.tone[0] == 2.2
    assert pose.error_to(found.pose).rotation_deg < 0.1


def test_tone_curves_are_not_told_apart_by_less_than_noise():
    shape, _, pose, views, _ = rendered('plug', 1)
    sight = look(shape, pose, views)
    weight = np.full(len(sight), 1.0 / 0.05**2)

    def laid(off):
        return Laid(as_motion(pose), np.zeros(len(sight)), weight, np.eye(6), ModelError(off, off, 0.0, 0.0))

    assert abs(_log_odds_of_code([laid(0.001), laid(0.00001)], sight)) < 1.0
    assert _log_odds_of_code([laid(0.3), laid(0.001)], sight) > DECISIVE
    assert _log_odds_of_code([laid(0.001), laid(0.3)], sight) < -DECISIVE


def test_a_pose_is_as_uncertain_as_its_tone_curve():
    """Where either curve may be the right one, half of the poses are where the other has them; else next to none."""
    pose, other = Pose.identity(), Pose.from_rotation_vector([0.0, 0.0, 0.01], [0.002, 0.0, 0.0])
    away = np.array([0.002, 0.0, 0.0, 0.0, 0.0, 0.01])
    np.testing.assert_allclose(_of_other(pose, other, 0.0), 0.5 * np.outer(away, away), atol=1e-12)
    assert np.abs(_of_other(pose, other, 20.0)).max() < 1e-12
    assert np.isfinite(_of_other(pose, other, 1e6)).all()


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
def test_what_pictures_are_like_does_not_depend_on_where_a_pose_was_drawn_in(seed):
    """A pixel and a half off, few steps are the edges they are taken for: levels seem to wander, and codes to fit."""
    shape, _, pose, views, rig = rendered('l_shape', seed)
    polished(shape, as_motion(pose), views)
    off = Views.of(views.images, rig)
    start = moved(pose, shape.centre, 0.0, 1500.0 * pose.translation[2] / CAMERA.fx, seed)
    found = polished(shape, as_motion(start), off)
    assert pose.error_to(found.pose).rotation_deg < 0.1
    assert off.tone[0] == views.tone[0] == 1.0
    np.testing.assert_allclose(off.look[:, 0], views.look[:, 0], rtol=0.02)
    assert off.look[:, 1].max() < 2.0 * max(views.look[:, 1].max(), 0.5)


def test_all_steps_of_a_profile_are_found_with_their_signs():
    angle = 0.0
    outline = stretches(angle, 5)
    n = len(outline.spacing)
    offset, strength, count = np.full((n, CANDIDATES), np.nan), np.zeros((n, CANDIDATES)), np.zeros(n, np.int32)
    image = step_image([-5.2, 1.4, 6.0], [50, 120, 70, 200], angle)
    find_steps(image, outline.pixel, outline.normal, outline.spacing, 8, 5.0, offset, strength, count)
    assert (count == 3).all()
    order = np.argsort(offset[:, :3], axis=1)
    np.testing.assert_allclose(np.take_along_axis(offset[:, :3], order, 1), [[-5.2, 1.4, 6.0]] * n, atol=0.15)
    assert (np.sign(np.take_along_axis(strength[:, :3], order, 1)) == [1, -1, 1]).all()


def test_the_errors_of_curves_in_all_views_and_in_one_are_told_from_those_of_points():
    rng = np.random.default_rng(4)
    curves, points = 60, 30
    group = np.repeat(np.arange(2 * curves), points).astype(np.int32)
    curve = group % np.int32(curves)  # in the first view, then in the second
    abscissa = np.tile((2.0 * np.arange(points) + 1.0) / points - 1.0, 2 * curves)
    shared, own = rng.normal(scale=0.3, size=(2, curves)), rng.normal(scale=0.15, size=(2, 2 * curves))
    offset, slope = shared[:, curve] + own[:, group]
    residual = offset + slope * abscissa + rng.normal(scale=math.hypot(0.1, 0.05), size=len(group))
    none = np.zeros((len(group), 2))
    placed = Placed(
        np.zeros((len(group), 3)), group // curves, none, none, group, curve, abscissa, np.zeros((len(group), 6))
    )
    error = FIRST_ERROR
    variance = np.full(len(group), 0.05**2)
    for _ in range(60):
        weight = 1.0 / (variance + error.point**2)
        error = fitted_model_error(placed, variance, fit_of(np.eye(6), residual, weight), error)
    assert error.curve == pytest.approx(0.3, rel=0.2)
    assert error.view == pytest.approx(0.15, rel=0.2)
    assert error.point == pytest.approx(0.1, rel=0.1)


def test_an_outline_that_is_nothing_off_is_found_to_be_so_at_once():
    rng = np.random.default_rng(5)
    curves, points = 40, 30
    group = np.repeat(np.arange(curves), points).astype(np.int32)
    abscissa = np.tile((2.0 * np.arange(points) + 1.0) / points - 1.0, curves)
    none = np.zeros((len(group), 2))
    # Every other residual is the same with the other sign, so that no line is in them.
    residual = np.abs(rng.normal(scale=0.05, size=len(group))) * np.where(np.arange(len(group)) % 2, 1.0, -1.0)
    placed = Placed(np.zeros((len(group), 3)), 0 * group, none, none, group, group, abscissa, np.zeros((len(group), 6)))
    variance = np.full(len(group), 0.05**2)
    error = fitted_model_error(placed, variance, fit_of(np.eye(6), residual, 1.0 / variance), FIRST_ERROR)
    assert max(error.curve, error.view) < 2e-3  # a line is known to 0.05 / sqrt(30) = 9e-3


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.floats(-12.0, 4.0))
def test_no_curve_is_farther_off_than_steps_are_looked_for(seed, points, known):
    """However few its points are and however little of the pose is known: 10^known is all that is."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(6), points).astype(np.int32)
    n = len(group)
    abscissa, slope = rng.uniform(-1.0, 1.0, n), rng.normal(scale=100.0, size=(n, 6))
    none = np.zeros((n, 2))
    placed = Placed(np.zeros((n, 3)), group // 3, none, none, group, group % np.int32(3), abscissa, slope)
    residual = rng.uniform(-FARTHEST_STEP, FARTHEST_STEP, n)
    variance = np.full(n, 0.05**2)
    fit = fit_of(10.0**known * np.eye(6), residual, 1.0 / variance)
    error = fitted_model_error(placed, variance, fit, FIRST_ERROR)
    assert 0.0 <= min(error) <= max(error.curve, error.view) < FARTHEST_STEP + 1e-9
    assert error.point <= FARTHEST_STEP / NORMAL_QUARTILE


@pytest.mark.parametrize('noise', [0.7, 2.0, 5.0])
def test_noise_is_told_in_pictures_that_are_mostly_black_or_white(noise):
    rng = np.random.default_rng(6)
    for behind in (0.0, 255.0):
        levels = np.full((240, 320), behind)
        levels[60:180, 80:240] = 120.0
        image = np.clip(np.rint(levels + rng.normal(scale=noise, size=levels.shape)), 0, 255).astype(np.uint8)
        views = Views.of([image], PinholeCamera.centred(320, 240, 300.0))
        assert views.noise[0] == pytest.approx(math.hypot(noise, 12.0**-0.5), rel=0.1)  # levels are rounded


def test_how_far_levels_wander_is_told_by_each_picture():
    """Plain faces let a step's flanks say where it is; beside print they say little."""
    shape, _, pose, views, rig = rendered('l_shape', 1, antialias=8)
    measure_pose(shape, pose, views)
    assert (views.look[:, 1] <= 0.75).all()
    rng = np.random.default_rng(7)
    print_ = cv2.GaussianBlur(rng.normal(scale=25.0, size=views.images[0].shape), (0, 0), 1.5)
    printed = [np.clip(image + print_, 0, 255).astype(np.uint8) for image in views.images]
    other = Views.of(printed, rig)
    measure_pose(shape, pose, other)
    # Neighbours of what is printed so differ by 2.2 levels, of means of four by 1.8; values are tried in steps of 1.4.
    assert (other.look[:, 1] >= 1.8 / 1.4).all() and (other.look[:, 1] <= 1.8 * 1.4).all()


def steps_in_noise(blur, places, levels, tone=1.0):
    """A dozen pictures of steps side by side, and the outline of the first step of each."""
    rng, outlines, pieces = np.random.default_rng(3), [], []
    for k in range(12):
        angle, first = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.5, 0.5)
        pieces.append(step_image([first + place for place in places], levels, angle, blur))
        normal = np.array([math.cos(angle), math.sin(angle)])
        outline = stretches(angle)
        outlines.append(outline._replace(pixel=outline.pixel + [64.0 * k, 0.0] + places[0] * normal))
    outline = Stretches(*(np.concatenate(values) for values in zip(*outlines)))
    coded = 255.0 * (np.hstack(pieces) / 255.0) ** (1.0 / tone)
    noisy = np.clip(np.rint(coded + rng.normal(scale=1.0, size=coded.shape)), 0, 255).astype(np.uint8)
    return noisy, outline, np.full((len(outline.spacing), BESIDE, 2), np.nan)


@pytest.mark.parametrize('blur', [0.45, 0.5, 0.8, 1.7, 2.8])
def test_the_blur_of_a_picture_is_told_by_its_steps(blur):
    noisy, outline, nothing = steps_in_noise(blur, [0.0], [60, 180])
    look = look_of(noisy, outline, nothing, 1.0, math.hypot(1.0, 12.0**-0.5))
    assert look.blur == pytest.approx(blur, rel=0.02)
    assert look.walk < 0.5


@pytest.mark.parametrize('blur', [0.45, 0.5, 0.8, 1.7])
def test_so_is_the_blur_of_a_dark_picture_with_a_tone_curve(blur):
    """In light, its steps are of a few levels, but noise is of less."""
    noisy, outline, nothing = steps_in_noise(blur, [0.0], [3, 10], 2.2)
    assert look_of(noisy, outline, nothing, 2.2, 1.0).blur == pytest.approx(blur, rel=0.15)


@pytest.mark.parametrize('blur', [0.5, 0.62, 0.9])
def test_where_no_step_stands_alone_the_blur_is_told_with_what_runs_beside_them(blur):
    noisy, outline, beside = steps_in_noise(blur, [0.0, 3.0], [60, 180, 90])
    beside[:, 0] = 3.0, 0.0
    look = look_of(noisy, outline, beside, 1.0, math.hypot(1.0, 12.0**-0.5))
    assert look.blur == pytest.approx(blur, rel=0.03)


def test_curves_count_for_presence_and_not_their_lengths():
    chance = Chance(0.2, 0.4, 0.25, 0.1, (0.2, 0.05))

    def of(curves, points, share):
        group = np.repeat(np.arange(curves), points).astype(np.int32)
        found = (np.arange(curves * points) % 100 < 100 * share).astype(np.int8)
        return log_ratio(found, group, group, np.zeros(curves, bool), chance)

    assert of(12, 20, 1.0) > 10.0
    assert of(12, 40, 1.0) < 1.5 * of(12, 20, 1.0)
    assert of(24, 20, 1.0) > 1.8 * of(12, 20, 1.0)
    ten = np.repeat(np.arange(10), 20).astype(np.int32)
    assert log_ratio(np.zeros(200, np.int8), ten, ten, np.zeros(10, bool), chance) < -4.5
    nothing = np.zeros(50, np.int32)
    assert log_ratio(np.full(50, -1, np.int8), nothing, nothing, np.zeros(1, bool), chance) == pytest.approx(
        0.0, abs=1e-9
    )


def test_an_edge_in_space_is_one_coincidence_in_however_many_images():
    chance = Chance(0.2, 0.4, 0.25, 0.1, (0.2, 0.05))
    group = np.repeat(np.arange(18), 20).astype(np.int32)
    found = np.ones(len(group), np.int8)
    straight = np.zeros(18, bool)
    once = log_ratio(found, group, group, straight, chance)
    twice = log_ratio(found, group, group % 9, straight[:9], chance)
    assert once > 1.3 * twice
    # But what lies on an edge in one image only is nothing in space.
    assert log_ratio((group < 9).astype(np.int8), group, group % 9, straight[:9], chance) < 0.0
    # And another circle at the place of a circle is rare.
    assert log_ratio(found, group, group % 9, ~straight[:9], chance) > 1.3 * twice


def parallels(curves=12, points=20, views=2):
    """Level lines below one another, in views one beside the other; points, curves and views of each."""
    view, line, k = (x.ravel() for x in np.meshgrid(*map(np.arange, (views, curves, points)), indexing='ij'))
    pixel = np.column_stack([4.0 * k + 300.0 * view, 10.0 * line]).astype(float)
    group = (view * curves + line).astype(np.int32)
    n = len(group)
    zeros = np.zeros
    placed = Placed(
        zeros((n, 3)),
        view.astype(np.int32),
        pixel,
        np.tile([0.0, 1.0], (n, 1)),
        group,
        line.astype(np.int32),
        zeros(n),
        zeros((n, 6)),
    )
    return placed, zeros(curves, bool)


@pytest.mark.parametrize('angle', [0.5 * np.pi, 0.4, 1.3, 2.2, 3.6, 5.0])
def test_what_is_hidden_together_speaks_less_against_an_outline(angle):
    """A screen's edge in any direction, two fifths of the outline in sight, against as much seen here and there."""
    chance = Chance(0.2, 0.4, 0.25, 0.1, (0.2, 0.05))
    placed, straight = parallels()
    across = placed.pixel @ [np.cos(angle), np.sin(angle)]
    found = np.zeros(len(across), np.int8)
    for eye in (0, 1):
        mine = placed.eye == eye
        found[mine] = across[mine] < np.quantile(across[mine], 0.4)
    alone = log_ratio(found, placed.group, placed.curve, straight, chance)
    assert behind_screens(placed, found, straight, chance) > alone + 1.0
    rng = np.random.default_rng(3)
    some = rng.permutation(12)[:5]
    scattered = np.isin(placed.curve, some).astype(np.int8)
    assert behind_screens(placed, scattered, straight, chance) < log_ratio(
        scattered, placed.group, placed.curve, straight, chance
    )


def test_chance_brings_no_evidence_of_an_outline_behind_a_screen():
    """A likelihood ratio has mean 1 where there is nothing, and exceeds t with chance 1 / t at most."""
    chance = Chance(0.2, 0.4, 0.25, 0.0, (0.0, 0.0))
    placed, straight = parallels(curves=6, points=10)
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(3000):
        found = np.empty(len(placed.group), np.int8)
        for k in range(len(found)):
            linked = k > 0 and placed.group[k] == placed.group[k - 1]
            by_chance = (chance.after_one if found[k - 1] else chance.after_none) if linked else chance.first
            found[k] = rng.random() < by_chance
        ratios.append(np.exp(behind_screens(placed, found, straight, chance)))
    assert np.mean(ratios) < 1.2
    assert np.mean(np.array(ratios) > 20.0) < 1.0 / 20.0


def test_straight_curves_are_told_from_others():
    t = np.linspace(0.0, 1.0, 6)
    line = np.stack([t, 2.0 * t, 1.0 - t], axis=1)
    circle = np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1)
    curve = np.repeat(np.array([0, 1, 3], np.int32), 6)
    limb = np.repeat([0.0, 0.0, 1.0], 6)
    assert bent(np.concatenate([line, circle, line]), curve, limb).tolist() == [False, True, False, True]


def test_a_curve_has_one_number_in_all_views():
    group = np.array([0, 0, 1, 2, 3, 3, 4], np.int32)
    eye = np.array([0, 0, 0, 0, 1, 1, 1], np.int32)
    feature = np.array([5, 5, -1, -1, 5, 5, -1], np.int32)
    curve = same_curves(group, eye, feature)
    assert curve[0] == curve[4]
    assert curve[2] == curve[6] != curve[3]
    assert len(set(curve.tolist())) == 3


def fit_of(normal, residual, weight):
    """A fit of a pose of which so much (6, 6) is known."""
    return Fit(Prior(np.zeros((6, 6)), np.zeros(6)), residual, weight, Equations(normal, np.zeros(6)))


def rendered(name, seed, noise=2.0, turn=None, antialias=2):
    """Shape, features, true pose and the views of an object of a scene file in a random pose, or at a turn (3, 3)."""
    solid = next(iter(load_models(name).values()))
    shape = SolidOutline(solid)
    rng = np.random.default_rng([seed, 7])
    distance = 4.0 * shape.size
    rig = StereoRig.symmetric(CAMERA, 0.2 * distance)
    turn = Rotation.random(random_state=rng).as_matrix() if turn is None else turn
    pose = Pose(turn, np.array([0.5 * rig.baseline, 0.0, distance]) - turn @ shape.centre)
    lights = [Light((0.3, -0.5, 0.2), (0.8,) * 3), Light((-0.5, -0.2, -0.3), (0.3,) * 3)]
    scene = Scene([solid.transformed(pose)], lights, (0.2,) * 3, (0.4,) * 3)
    frames = render_stereo(scene, rig, antialias=antialias, psf=0.5)
    images = [SensorModel(0.5, noise, (seed, eye)).picture(frame, monochrome=True) for eye, frame in enumerate(frames)]
    return shape, solid, pose, Views.of(images, rig), rig


def moved(pose, about, degrees, millimetres, seed):
    rng = np.random.default_rng(seed)
    turn, shift = rng.normal(size=(2, 3))
    turn *= np.radians(degrees) / np.linalg.norm(turn)
    shift *= 1e-3 * millimetres / np.linalg.norm(shift)
    rotation = Rotation.from_rotvec(turn).as_matrix()
    middle = pose.apply(about)
    return Pose(rotation @ pose.rotation, middle + shift + rotation @ (pose.translation - middle))


@pytest.mark.parametrize(('name', 'seed'), [('plug', 1), ('cylinder_box', 5), ('wedge', 1)])
def test_a_rendered_pose_is_measured_within_its_covariance(name, seed):
    shape, _, pose, views, _ = rendered(name, seed)
    found = measure_pose(shape, moved(pose, shape.centre, 2.0, 10.0 * shape.size, seed), views)
    assert found.reason is None
    assert pose.error_to(found.pose).rotation_deg < 0.1
    turn = Rotation.from_matrix(found.pose.rotation @ pose.rotation.T).as_rotvec()
    off = np.concatenate([found.pose.translation - pose.translation, turn])
    assert off @ np.linalg.solve(found.covariance, off) < 30.0  # one of 25,000 has more
    assert found.presence.log_ratio > 10.0
    assert found.presence.support > 0.7


def test_a_pose_far_off_is_drawn_in_at_half_resolution():
    shape, _, pose, views, _ = rendered('plug', 1)
    start = moved(pose, shape.centre, 4.0, 30.0 * shape.size, 3)
    found = measure_pose(shape, start, views, search_px=32)
    assert pose.error_to(found.pose).rotation_deg < 0.1


@pytest.mark.parametrize(('name', 'seed'), [('plug', 1), ('cylinder_box', 5), ('wedge', 1)])
def test_a_camera_that_is_not_quite_where_it_is_said_to_be_is_found_out(name, seed):
    """What all curves of an image are off is one error, not one of each."""
    shape, _, pose, views, rig = rendered(name, seed)
    right = rig.right
    moved_a_little = replace(right, cx=right.cx - 0.3, cy=right.cy + 0.4)
    off_views = Views(views.images, (rig.left, moved_a_little), views.poses)
    exact, found = measure_pose(shape, pose, views), measure_pose(shape, pose, off_views)
    assert exact.error.image < 0.02
    assert 0.2 < found.error.image < 0.6
    # Where each curve had its own error, these had to be 0.4 pixels.
    assert found.error.view < exact.error.view + 0.05
    turn = Rotation.from_matrix(found.pose.rotation @ pose.rotation.T).as_rotvec()
    off = np.concatenate([found.pose.translation - pose.translation, turn])
    assert off @ np.linalg.solve(found.covariance, off) < 30.0
    # Disparities tell no more than columns are known to; how large the part looks still does.
    sigma, least = (np.sqrt(one.covariance[2, 2]) for one in (found, exact))
    assert 1.5 * least < sigma
    by_columns = 0.4 * pose.translation[2] ** 2 / (rig.left.fx * rig.baseline)
    assert sigma < by_columns


@settings(deadline=None)
@given(st.floats(1.0, 1e6), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(1, 4))
def test_the_likeliest_sigma_of_images_in_closed_form(told, u, v, further):
    """Of unknowns that are known alike: their mean square less their variance, times the chance that they are not 0."""
    off = np.resize([u, v], 2 * further)
    normal = np.zeros((6 + len(off), 6 + len(off)))
    normal[:6, :6] = 1e3 * np.eye(6)
    normal[6:, 6:] = told * np.eye(len(off))
    right = np.concatenate([np.zeros(6), told * off])
    sigma = _of_images(Equations(normal, right), Prior(np.zeros((6, 6)), np.zeros(len(right))))
    likeliest = max((off**2).mean() - 1.0 / told, 0.0)
    spread = 1.0 + told * likeliest
    gain = 0.5 * len(off) * (told * (off**2).mean() * (1.0 - 1.0 / spread) - math.log(spread))
    expected = math.sqrt(likeliest / (1.0 + math.exp(DECISIVE - gain)))
    assert sigma == pytest.approx(expected, rel=1e-3, abs=FARTHEST_STEP * 2.0 ** (-IMAGE_TURNS / 2) + 1e-12)


def lines_off(curve, view, seed, curves=30, points=20):
    """A fit's points on lines of two views, residuals with noise of 0.05 pixels, and weights."""
    rng = np.random.default_rng(seed)
    group = np.repeat(np.arange(2 * curves), points).astype(np.int32)
    of = group % np.int32(curves)
    abscissa = np.tile((2.0 * np.arange(points) + 1.0) / points - 1.0, 2 * curves)
    offset, slope = (
        rng.normal(scale=curve, size=(2, curves))[:, of] + rng.normal(scale=view, size=(2, 2 * curves))[:, group]
    )
    residual = offset + slope * abscissa + rng.normal(scale=0.05, size=len(group))
    none = np.zeros((len(group), 2))
    placed = Placed(
        np.zeros((len(group), 3)), group // curves, none, none, group, of, abscissa, np.zeros((len(group), 6))
    )
    return placed, residual, np.full(len(group), 0.05**-2)


@pytest.mark.parametrize(('curve', 'view'), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1), (0.1, 0.1)])
def test_errors_that_there_are_stay_and_others_go(curve, view):
    # Noise moves a curve in a view by 0.05 / sqrt(20) = 0.011: that is what is estimated where there is less.
    believed = ModelError(max(curve, 0.004), max(view, 0.004), 0.0, 0.0)
    likely = [as_likely(*lines_off(curve, view, seed), believed) for seed in range(10)]
    for true, found in ((curve, [one.curve for one in likely]), (view, [one.view for one in likely])):
        if true:
            assert found == pytest.approx([true] * len(found), rel=0.1)
        else:
            assert np.sqrt(np.mean(np.square(found))) < 0.75 * 0.004
    log_likelihood = [_likelihood_of_lines(*lines_off(curve, view, 3), *sigmas) for sigmas in ((0.0, 0.0), (0.1, 0.05))]
    placed, residual, weight = lines_off(curve, view, 3)
    expected = []
    for shared, own in ((0.0, 0.0), (0.1, 0.05)):
        total = 0.0
        for of in range(30):
            rows = placed.curve == of
            design = np.stack([np.ones(rows.sum()), placed.abscissa[rows]], axis=1)
            in_view = (placed.eye[rows][:, None] == placed.eye[rows]) * own**2 + shared**2
            spread = np.diag(1.0 / weight[rows]) + in_view * (design @ design.T)
            total += multivariate_normal(cov=spread).logpdf(residual[rows])
        expected.append(total)
    assert log_likelihood[1] - log_likelihood[0] == pytest.approx(expected[1] - expected[0], rel=1e-6)


def _likelihood_of_lines(placed, residual, weight, curve, view):
    sums, of_curve = sums_of_lines(placed, residual, weight, 0)
    return _log_likelihood(sums, of_curve, curve, view)


def test_one_camera_is_enough():
    shape, _, pose, views, rig = rendered('plug', 1)
    found = measure_pose(
        shape, moved(pose, shape.centre, 1.0, 4.0 * shape.size, 2), Views.of(views.images[:1], rig.left)
    )
    assert pose.error_to(found.pose).rotation_deg < 0.5


def test_what_is_not_there_is_not_confirmed():
    shape, _, pose, views, _ = rendered('plug', 1)
    other = SolidOutline(next(iter(load_models('chair').values())))
    at = Pose(pose.rotation, pose.apply(shape.centre) - pose.rotation @ other.centre)
    motion = drawn_in(other, np.append(at.rotation.ravel(), at.translation), views)
    assert presence(other, Pose(motion[:9].reshape(3, 3), motion[9:]), views).log_ratio < 10.0


def test_a_shape_out_of_view_is_a_reason():
    shape, _, _, views, _ = rendered('plug', 1)
    found = measure_pose(shape, Pose(np.eye(3), np.array([0.0, 0.0, -1.0])), views)
    assert found.reason == 'too little of the model is in view'


def test_a_ball_leaves_its_turn_free():
    from csg_renderer import Solid

    solid = Solid.sphere(0.03)
    pose = Pose(np.eye(3), np.array([0.04, 0.0, 0.4]))
    rig = StereoRig.symmetric(CAMERA, 0.08)
    scene = Scene([solid.transformed(pose)], [Light((0.3, -0.5, 0.2), (0.8,) * 3)], (0.2,) * 3, (0.7,) * 3)
    images = [
        SensorModel(0.5, 2.0, (3, eye)).picture(frame, monochrome=True)
        for eye, frame in enumerate(render_stereo(scene, rig, antialias=2, psf=0.5))
    ]
    shape = SolidOutline(solid)
    found = measure_pose(shape, Pose(np.eye(3), pose.translation + [0.001, 0.0, 0.002]), Views.of(images, rig))
    assert np.linalg.norm(found.pose.translation - pose.translation) < 3e-4
    assert np.linalg.eigvalsh(found.covariance[3:, 3:]).min() > 1.0


def test_points_say_which_curve_and_view_they_are_of():
    shape, _, pose, views, _ = rendered('cylinder_box', 5)
    sight = look(shape, pose, views)
    assert (np.diff(sight.placed.group) >= 0).all()
    assert set(sight.placed.eye.tolist()) == {0, 1}
    assert np.abs(sight.placed.abscissa).max() < 1.0
    np.testing.assert_allclose(np.linalg.norm(sight.placed.normal, axis=1), 1.0)
    assert (sight.limb[sight.feature >= 0] == 0.0).all()


def test_images_of_another_size_than_the_camera_are_refused():
    with pytest.raises(ValueError, match=r'images: image 0 is uint8 of shape \(4, 4\)'):
        Views.of([np.zeros((4, 4), np.uint8)], CAMERA)


@pytest.mark.parametrize('size', [1, 2, 3, 4])
def test_images_of_a_few_pixels_have_the_noise_of_rounding(size):
    views = Views.of([np.full((size, size), 90, np.uint8)], PinholeCamera.centred(size, size, 600.0))
    for level in (views, views.halved, views.halved.halved):
        assert level.noise == pytest.approx([math.sqrt(1.0 / 12.0)])


class TestMatching:
    def test_the_images_give_the_accepted_pose_and_its_support(self):
        shape, solid, pose, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        index = index_model(model_features(solid), 'plug', shape)
        by_features, by_images = match(index, data), match(index, data, views=views)
        assert by_images.best is not None
        assert by_images.best.support > 0.7
        assert len(by_images.outlines) == len(by_images.interpretations)
        assert pose.error_to(by_images.best.pose).rotation_deg < 0.1
        assert by_features.best is None or np.isnan(by_features.best.support)

    def test_an_answer_has_the_evidence_of_the_pose_that_it_names(self):
        shape, solid, _, views, rig = rendered('plug', 1)
        result = match(
            index_model(model_features(solid), 'plug', shape), recover(*views.images, rig).features, views=views
        )
        told = presence(shape, result.best.pose, views)
        assert result.outlines[0].log_ratio == pytest.approx(told.log_ratio, abs=1.0)
        assert result.best.support == result.outlines[0].support == pytest.approx(told.support, abs=0.05)

    def test_a_pose_that_explains_no_data_is_no_answer(self):
        """The images show all of it; but what it was thought of for lies elsewhere."""
        shape, solid, pose, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        index = index_model(model_features(solid), 'plug', shape)
        far = data.transformed(Pose(np.eye(3), [0.0, 0.0, 3.0 * shape.size]))
        nothing = np.full(len(data), BIN, np.int32), np.zeros(len(data), np.int8)
        for seen, accepted in ((data, 1), (far, 0)):
            problem = make_problem(index, seen, MatchParams())
            hypothesis = Interpretation('plug', *nothing, pose, evidence=20.0)
            found = accepted_by_images(problem, shape, [hypothesis], views, 0.0, Deadline())
            assert len(found.accepted) == accepted
        assert 'explains none of the data' in found.rejected[0].rejected_reason

    # The chip cuts a corner of the far side off; the near one is a rectangle either way round.
    @pytest.mark.parametrize(('turns', 'poses'), [((25.0, 4.0, 185.0), 2), ((25.0, 30.0, 20.0), 1)])
    def test_a_pose_that_the_images_do_not_tell_from_another_comes_with_it(self, turns, poses):
        turn = Rotation.from_euler('zyx', turns, degrees=True).as_matrix()
        shape, solid, pose, views, rig = rendered('chipped_block', 5, turn=turn)
        index = index_model(model_features(solid), 'chipped_block', shape)
        best = match(index, recover(*views.images, rig).features, views=views).best
        named = (best.pose, *best.ambiguous_poses)
        assert len(named) == poses and all(one in best.symmetric_poses for one in best.ambiguous_poses)
        assert min(pose.error_to(one).rotation_deg for one in named) < 0.2
        assert all(apart(index, one, other) > 0.5 for one, other in itertools.combinations(named, 2))

    def test_an_absent_model_is_refused_with_what_the_images_say(self):
        _, _, _, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        solid = next(iter(load_models('chair').values()))
        result = match(index_model(model_features(solid), 'chair', SolidOutline(solid)), data, views=views)
        assert result.best is None
        assert all(one.rejected_reason for one in result.rejected)

    def test_what_the_images_speak_against_from_afar_is_not_drawn_in(self):
        shape, solid, pose, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        problem = make_problem(index_model(model_features(solid), 'plug', shape), data, MatchParams())
        nothing = np.full(len(data), BIN, np.int32), np.zeros(len(data), np.int8)
        empty = Pose(pose.rotation, pose.translation + [0.0, 1.3 * shape.size, 0.0])
        near = moved(pose, shape.centre, 1.0, 4.0 * shape.size, 2)
        for start, stays in ((empty, True), (near, False)):
            hypothesis = Interpretation('plug', *nothing, start, evidence=0.0)
            seen = [weigh(problem, shape, hypothesis, views, needed=needed).motion for needed in (30.0, -np.inf)]
            at_start = [bool((motion == as_motion(start)).all()) for motion in seen]
            assert at_start == [stays, False]

    @pytest.mark.parametrize('name', ['plug', 'chair'])
    def test_threads_do_not_change_what_is_found(self, name, monkeypatch):
        _, _, _, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        solid = next(iter(load_models(name).values()))
        index = index_model(model_features(solid), name, SolidOutline(solid))
        told = []
        for threads in (1, 4):
            monkeypatch.setattr('msgs_py.numeric.threads.THREADS', threads)
            result = match(index, data, views=Views.of(views.images, rig))
            ones = (*result.interpretations, *result.rejected)
            told.append([(one.evidence, one.support, one.rejected_reason, *one.pose.translation) for one in ones])
        np.testing.assert_equal(told[1], told[0])

    def test_the_time_limit_holds_while_images_are_looked_at(self):
        shape, solid, _, views, rig = rendered('plug', 1)
        data = recover(*views.images, rig).features
        index = index_model(model_features(solid), 'plug', shape)
        match(index, data, views=views)
        result = match(index, data, MatchParams(time_limit_s=1e-6), views=views)
        assert result.stats['seconds'] < 1.0
