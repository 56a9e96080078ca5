"""Curves and axes against closed forms: exact pictures of known circles, ellipses, cylinders and cones."""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig
from stereo_recovery.curves import fit_kernels
from stereo_recovery.curves.axes import axis_features, find_axes
from stereo_recovery.curves.axis_constraint import held
from stereo_recovery.curves.curve import Curve, camera_views, curve_features, flipped, image_conic
from stereo_recovery.curves.curved_shapes import distinct
from stereo_recovery.curves.fit import refine
from stereo_recovery.curves.observations import StereoEdgels
from stereo_recovery.curves.occluding_contours import CurvedSurface, contours_of, on_contours, tangents
from stereo_recovery.curves.orientation import oriented_by_faces
from stereo_recovery.curves.start_kernels import back_projected, circles_of_ellipse, free_curve
from stereo_recovery.detection.chains import chains_of
from stereo_recovery.detection.edgels import Edgels, blur_variance, detect
from stereo_recovery.detection.junctions import find_junctions
from stereo_recovery.detection.segments import Segments
from stereo_recovery.detection.splitting import split
from stereo_recovery.edges.hiding import hidden_ends
from stereo_recovery.edges.tangency import joined_ends
from stereo_recovery.matching.matches import Matches

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
VIEWS = camera_views(RIG)
NONE = np.zeros(0, bool)
WHOLE = (0.0, 2.0 * np.pi)


def curve(centre, normal, major=0.015, minor=None, arc=WHOLE, spread=1e-5) -> Curve:
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    first = np.cross(normal, [0.3, 0.1, 0.9])
    return Curve(
        np.asarray(centre, float),
        normal,
        first / np.linalg.norm(first),
        np.array([major, minor or major]),
        np.diag([spread, spread, spread, 1e-3, 1e-3, spread]) ** 2,
        0.01,
        NONE,
        NONE,
        arc,
    )


def points_of(c: Curve, count: int, arc=WHOLE) -> np.ndarray:
    angle = arc[0] + arc[1] * (np.arange(count) + 0.5) / count
    return c.centre + np.cos(angle)[:, None] * c.radii[0] * c.first + np.sin(angle)[:, None] * c.radii[1] * c.second


def edgels_of(c: Curve, view, count=120, arc=WHOLE, noise=0.0, seed=0) -> Edgels:
    """Edgels exactly on the curve's picture, or off it by Gaussian noise."""
    at = view.camera.project(points_of(c, count, arc) - view.centre)
    conic = image_conic(c, view)
    h = at @ conic[:2, :2] + conic[:2, 2]
    across = h / np.linalg.norm(h, axis=1, keepdims=True)
    at = at + noise * np.random.default_rng(seed).normal(size=(count, 1)) * across
    sigma = np.full(count, max(noise, 0.01))
    return Edgels(
        at,
        np.arctan2(across[:, 1], across[:, 0]),
        np.full(count, 40.0),
        sigma,
        sigma,
        np.ones(count),
        np.zeros(count),
        1.0 / sigma,
    )


def both(c: Curve, **options) -> StereoEdgels:
    left, right = (edgels_of(c, view, seed=seed, **options) for seed, view in zip((2, 3), VIEWS))
    return StereoEdgels(left, right, RIG, 0.0)


def segments_of(drawn) -> Segments:
    """Straight segments between given pixels (n, 2, 2)."""
    ends = np.asarray(drawn, float).reshape(-1, 2, 2)
    n = len(ends)
    run = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(run, axis=1)
    extent = np.stack([-0.5 * length, 0.5 * length], axis=1)
    return Segments(
        np.tile([0, 20], (n, 1)),
        np.arange(n),
        ends.mean(axis=1),
        run / length[:, None],
        extent,
        np.full(n, 0.01),
        np.zeros(n),
        np.full(n, 20.0),
        np.tile([0.01, 0.001], (n, 1)),
        np.full(n, 40.0),
        np.full(n, -1, np.int32),
    )


def angle_between(a, b) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(np.asarray(a) @ b) / np.linalg.norm(a) / np.linalg.norm(b)))))


directions = st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8)).map(lambda xy: np.array([*xy, -1.0]))


@given(directions, st.floats(0.005, 0.025), st.floats(0.18, 0.9))
@settings(max_examples=25, deadline=None)
def test_an_exact_circle_is_recovered_exactly_from_a_rough_start(normal, radius, depth):
    true = curve([0.02, 0.01, depth], normal, radius)
    tilted = true.normal + [0.15, -0.1, 0.0]
    start = curve(true.centre * 1.03, tilted, 1.1 * radius)
    found = refine(start, both(true), circle=True)
    assert found is not None
    assert np.linalg.norm(found.centre - true.centre) < 1e-6
    assert angle_between(found.normal, true.normal) < 1e-3
    assert abs(found.radii[0] - radius) < 1e-7


@given(directions, st.floats(0.4, 0.9))
@settings(max_examples=15, deadline=None)
def test_an_exact_ellipse_in_space_is_recovered_with_its_axes(normal, ratio):
    true = curve([0.02, 0.0, 0.25], normal, 0.018, 0.018 * ratio)
    start = replace(true, centre=true.centre * 1.01, radii=true.radii * [1.05, 0.97])
    found = refine(start, both(true), circle=False)
    assert found is not None
    assert np.allclose(found.radii, true.radii, rtol=1e-4)
    assert angle_between(found.first, true.first) < 0.05
    assert angle_between(found.normal, true.normal) < 0.01


def joined(one: Edgels, other: Edgels) -> Edgels:
    return Edgels(*(np.concatenate([getattr(of, f.name) for of in (one, other)]) for f in fields(Edgels)))


@pytest.mark.parametrize('lure', [0, 120])
def test_a_plane_that_an_arc_speaks_against_is_not_taken_for_what_else_lies_on_it(lure):
    """An ellipse is the picture of two circles. Here the wrong one has the more edgels, but not those of the arc."""
    true = curve([0.05, 0.0, 0.25], [0.8, 0.3, -1.0])
    arcs = both(true, count=60, arc=(0.5, 3.5), noise=0.05)
    at = arcs.left.position
    samples = np.column_stack([at, RIG.left.fx * RIG.baseline / points_of(true, 60, (0.5, 3.5))[:, 2]])
    ellipse = image_conic(true, VIEWS[0])
    index = np.arange(120)
    starts = [
        fit_kernels.fit(start, True, arcs.seen, index, True).shape
        for start in circles_of_ellipse(ellipse, samples, arcs.seen, 0)
    ]
    wrong = max(starts, key=lambda start: angle_between(start.normal, true.normal))
    assert angle_between(wrong.normal, true.normal) > 10.0
    there = Curve.unfitted(wrong)
    left, right = (
        joined(arc, edgels_of(there, view, count=lure)) if lure else arc
        for arc, view in zip((arcs.left, arcs.right), VIEWS)
    )
    seen = StereoEdgels(left, right, RIG, 0.0).seen
    index = np.concatenate([np.arange(60), len(left) + np.arange(60)])
    found = free_curve(ellipse[None], np.zeros(1, int), samples, index, seen)
    assert found.fit.good
    assert angle_between(found.fit.shape.normal, true.normal) < 2.0


def test_a_circle_is_not_taken_for_an_ellipse():
    true = curve([0.02, 0.0, 0.25], [0.2, 0.5, -1.0])
    assert refine(true, both(true, noise=0.03), circle=False) is None


@given(st.integers(0, 10**6))
@example(1905)
@settings(max_examples=60, deadline=None)
def test_a_fit_to_noise_ends_without_a_curve_or_with_one_of_some_width(seed):
    rng = np.random.default_rng(seed)
    tilt, ratio = (rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0), -1.0), rng.uniform(0.02, 1.0)
    true = curve([0.02, 0.0, 0.25], tilt, 0.018, 0.018 * ratio)
    end, noise = 0.3 + rng.uniform(0.2, 2.0), rng.uniform(0.1, 2.0)
    mine = [edgels_of(true, view, arc=(0.3, end), noise=noise, seed=2 * seed + k) for k, view in enumerate(VIEWS)]
    start = replace(true, normal=curve([0, 0, 1], [rng.normal(), rng.normal(), -1.0]).normal)
    found = refine(start, StereoEdgels(*mine, RIG, 0.0), circle=False)
    assert found is None or found.radii.min() > 0.0


def test_stated_errors_of_a_fit_are_true():
    """Of 60 noisy arcs nearly all lie within three sigma, and the sigma is not more than twice too wide. The edgels'
    noise is independent here, while that of a picture is not: neighbours count as one, so bounds are wide by design."""
    true = curve([0.02, 0.0, 0.25], [0.2, 0.5, -1.0])
    ratio = []
    for seed in range(60):
        mine = [edgels_of(true, view, arc=(0.3, 3.5), noise=0.05, seed=2 * seed + k) for k, view in enumerate(VIEWS)]
        found = refine(true, StereoEdgels(*mine, RIG, 0.0), circle=True)
        assert found is not None
        ratio.append(np.radians(angle_between(found.normal, true.normal)) / found.tilt)
    assert np.mean(np.array(ratio) < 3.0) > 0.97
    assert np.median(ratio) > 0.2


@pytest.mark.parametrize('circle', [True, False])
def test_derivatives_of_residuals_are_those_of_differences(circle):
    true = curve([0.02, 0.01, 0.25], [0.1, 0.6, -1.0], 0.015, None if circle else 0.011)
    seen = both(true, noise=0.02, count=30).seen
    index = np.arange(60)
    size = 6 if circle else 8
    rows = np.empty((60, size))
    distance, bias, moved = np.empty(60), np.empty(60), np.empty(60)
    fit_kernels.residuals(true.shape, seen, index, distance, bias, rows)
    for k in range(size):
        step = np.zeros(8)
        step[k] = 1e-7
        other = fit_kernels.moved(true.shape, step, circle)
        fit_kernels.residuals(other, seen, index, moved, bias, np.empty((0, 0)))
        by_difference = (moved - distance) / 1e-7
        assert np.allclose(rows[:, k], by_difference, atol=0.02 * np.abs(by_difference).max())


@given(directions, st.floats(0.5, 1.0), st.floats(0.02, 0.05))
@settings(max_examples=25, deadline=None)
def test_an_ellipse_back_projected_onto_its_plane_is_the_curve(normal, ratio, x):
    true = curve([x, 0.01, 0.25], normal, 0.015, 0.015 * ratio)
    plane = true.normal / (true.normal @ true.centre)
    seen = both(true).seen
    for side, view in enumerate(VIEWS):
        good, found = back_projected(image_conic(true, view), plane, seen, side)
        assert good
        assert np.allclose(found.centre, true.centre, atol=1e-9)
        assert np.allclose(found.radii, true.radii, rtol=1e-6)


def test_an_arc_that_says_little_is_held_by_the_axis_of_a_known_rim():
    true = curve([0.02, 0.01, 0.25], [0.1, 0.6, -1.0])
    short = both(true, arc=(0.5, 0.6), noise=0.04, count=40)
    alone = refine(true, short, circle=True)
    assert alone is not None and np.degrees(alone.tilt) > 2.0
    rim = replace(true, centre=true.centre + 0.03 * true.normal, covariance=1e-12 * np.eye(6))
    on_axis = held(alone, [rim])
    assert np.degrees(on_axis.tilt) < 0.2
    assert angle_between(on_axis.normal, true.normal) < 3.0 * np.degrees(on_axis.tilt)
    assert np.linalg.norm(on_axis.centre - true.centre) < 0.5e-3
    # One beside it tells the normal only, and one in another plane nothing.
    beside = held(alone, [replace(rim, centre=rim.centre + 0.05 * rim.first)])
    assert np.degrees(beside.tilt) < 0.2
    assert beside.covariance[:3, :3].trace() > on_axis.covariance[:3, :3].trace()
    tilted = curve(rim.centre, rim.normal + 2.0 * rim.first)
    assert held(alone, [replace(tilted, covariance=rim.covariance)]) is alone


@given(directions, st.floats(0.02, 0.05))
@settings(max_examples=25, deadline=None)
def test_contours_touch_the_rim_and_pass_the_apex(normal, height):
    rim = curve([0.01, 0.02, 0.3], normal)
    conic = image_conic(rim, VIEWS[0])
    apex = RIG.left.matrix @ (rim.centre + height * np.cross(rim.normal, [1.0, 0.0, 0.2]))
    lines = tangents(conic, apex)
    assert len(lines) in (0, 2)
    for line in lines:
        assert abs(line @ apex) / apex[2] < 1e-6
        dual = np.linalg.inv(conic)
        assert abs(line @ dual @ line) < 1e-9 * abs(dual).max() * (line @ line)


def contours_of_cylinder(rim: Curve, length: float, view) -> list[np.ndarray]:
    """The two contour segments in an image: where the surface's normal is square to the line of sight."""
    towards = view.centre - rim.centre
    a, b = towards @ rim.first, towards @ rim.second
    middle, half = np.arctan2(b, a), np.arccos(rim.radii[0] / np.hypot(a, b))
    result = []
    for angle in (middle + half, middle - half):
        foot = rim.centre + rim.radii[0] * (np.cos(angle) * rim.first + np.sin(angle) * rim.second)
        result.append(view.camera.project(np.stack([foot, foot + length * rim.normal]) - view.centre))
    return result


@pytest.mark.parametrize(
    ('moved', 'is_contour'),
    [
        ((0.0, 0.0), True),
        ((0.0, 0.5), True),
        ((0.0, 2.5), False),  # what one eye alone shows is no contour
        ((2.5, 2.5), False),
        ((0.0, 9.0), False),
    ],
)
def test_contours_of_a_rims_surface_are_no_edges(moved, is_contour):
    rim = curve([0.02, 0.02, 0.25], [0.1, 1.0, -0.5])
    sides = [contours_of_cylinder(rim, 0.03, view)[0] + [off, 0.0] for view, off in zip(VIEWS, moved)]
    segments = []
    for side in (segments_of([line]) for line in sides):
        # Where most edgels are need not be the middle.
        shift = 0.4 * side.length[:, None]
        segments.append(replace(side, centre=side.centre + shift * side.direction, extent=side.extent - shift))
    first = np.zeros(1, np.int32)
    found = on_contours((first, first), contours_of([CurvedSurface.cylinder(rim)], (segments[0], segments[1]), RIG))
    assert list(found) == [is_contour]


def test_the_axis_of_a_cylinder_from_one_rim_and_its_contour():
    rim = curve([0.02, 0.02, 0.25], [0.1, 1.0, -0.5])
    # The rim's normal is known to a degree only; the contours know better.
    off = Pose.from_rotation_vector([0.01, 0.0, 0.008]).rotation
    seen = replace(
        rim,
        normal=off @ rim.normal,
        first=off @ rim.first,
        covariance=np.diag([1e-5, 1e-5, 1e-5, 0.01, 0.01, 1e-5]) ** 2,
    )
    segments = tuple(segments_of(contours_of_cylinder(rim, 0.03, view)) for view in VIEWS)
    axes, _ = find_axes([seen], segments, RIG)
    assert len(axes) == 1
    run = axes[0].end - axes[0].start
    assert angle_between(run, rim.normal) < 0.6 * angle_between(seen.normal, rim.normal)
    assert np.linalg.norm(run) == pytest.approx(0.03, rel=0.03)
    assert np.linalg.norm(np.cross(axes[0].end - rim.centre, rim.normal)) < axis_features(axes).err_per[0]


def test_the_apex_of_a_cone_from_its_base_and_contours():
    base = curve([0.02, 0.02, 0.25], [0.1, 1.0, -0.6], 0.018)
    apex = base.centre - 0.035 * base.normal
    drawn = []
    for view in VIEWS:
        lines = tangents(image_conic(base, view), view.matrix @ (apex - view.centre))
        touch = np.linalg.solve(image_conic(base, view), lines.T).T
        tip = view.camera.project((apex - view.centre)[None])[0]
        drawn.append([np.stack([t[:2] / t[2] + 0.02 * (tip - t[:2] / t[2]), tip]) for t in touch])
    axes, surfaces = find_axes([base], (segments_of(drawn[0]), segments_of(drawn[1])), RIG)
    assert len(axes) == 1
    assert np.linalg.norm(axes[0].start - apex) < 1e-5
    assert np.linalg.norm(axes[0].end - base.centre) < 1e-12
    assert any(np.allclose(where, [*apex, 1.0], atol=1e-5) for _, where in surfaces)


def test_rims_of_one_end_count_once_and_neighbouring_ends_have_an_axis_each():
    low = curve([0.0, 0.0, 0.3], [0.0, 1.0, 0.0], 0.02)
    rims = [
        low,
        replace(low, centre=low.centre + [0.0, 0.01, 0.0]),
        replace(low, centre=low.centre + [0.0, 0.01, 0.0], radii=np.full(2, 0.01)),
        replace(low, centre=low.centre + [0.0, 0.04, 0.0], radii=np.full(2, 0.01)),
        curve([0.05, 0.0, 0.3], [0.0, 1.0, 0.0], 0.01),
    ]
    nothing = (segments_of([]), segments_of([]))
    axes, _ = find_axes(rims, nothing, RIG)
    heights = sorted(tuple(sorted((round(a.start[1], 4), round(a.end[1], 4)))) for a in axes)
    assert heights == [(0.0, 0.01), (0.01, 0.04)]


def test_two_rims_of_a_frustum_tell_where_its_sides_meet():
    low = curve([0.0, 0.0, 0.3], [0.0, 1.0, 0.0], 0.02)
    high = replace(low, centre=low.centre + [0.0, 0.03, 0.0], radii=np.full(2, 0.01))
    _, surfaces = find_axes([low, high], (segments_of([]), segments_of([])), RIG)
    assert any(np.allclose(apex, [0.0, 0.06, 0.3, 1.0], atol=1e-9) for _, apex in surfaces)


def test_a_curve_feature_has_the_covariance_of_its_centre_and_normal():
    """Curves moved and tilted as their own six parameters vary."""
    rng = np.random.default_rng(4)
    mix = rng.normal(size=(6, 6)) * [1e-4, 2e-4, 3e-4, 2e-3, 1e-3, 1e-5]
    given = replace(curve([0.02, 0.02, 0.25], [0.1, 1.0, -0.5]), covariance=mix.T @ mix)
    feature = curve_features([given])
    steps = rng.multivariate_normal(np.zeros(6), given.covariance, 20000)
    moved = [fit_kernels.moved(given.shape, np.array([*step[:5], 0.0, 0.0, 0.0]), True) for step in steps]
    off = np.array([[*(m.centre - given.centre), *(m.normal - given.normal)] for m in moved])
    seen = off.T @ off / len(off)
    size = np.sqrt(np.diag(feature.covariance[0]))
    assert np.allclose(seen, feature.covariance[0], atol=0.05 * np.outer(size, size))
    across = np.linalg.eigvalsh(feature.direction_covariance[0])
    assert across == pytest.approx([0.0, *np.linalg.eigvalsh(given.covariance[3:5, 3:5])], abs=1e-12)


def near_half() -> Curve:
    """A rim in a level plane below us of which the near half is seen; as yet taken to face away."""
    level = curve([0.0, 0.05, 0.25], [0.0, 1.0, 0.0])
    nearest = np.array([0.0, 0.0, -1.0])
    middle = np.arctan2(nearest @ level.second, nearest @ level.first)
    return replace(level, arc=(middle - 1.5, 3.0))


@pytest.mark.parametrize(('behind', 'faces_us'), [(0.03, True), (-0.03, False)])
def test_a_foot_faces_us_when_its_plane_is_seen_behind_it(behind, faces_us):
    rim = near_half()
    edge = np.array([[[-0.03, 0.05, 0.25 + behind], [0.03, 0.05, 0.25 + behind]]])
    normal = oriented_by_faces([rim], edge, np.array([1e-4]))[0].normal
    assert (normal @ rim.centre < 0.0) == faces_us


def test_an_edge_in_another_plane_says_nothing_of_a_rims_face():
    rim = near_half()
    edge = np.array([[[-0.03, 0.06, 0.28], [0.03, 0.06, 0.28]]])
    assert oriented_by_faces([rim], edge, np.array([1e-4]))[0].normal @ rim.centre > 0.0


def test_turning_a_curve_over_keeps_its_points():
    true = curve([0.02, 0.0, 0.25], [0.2, 0.5, -1.0], 0.02, 0.01)
    part = replace(true, arc=(0.4, 1.2))
    other = flipped(part)
    assert np.allclose(other.normal, -part.normal)
    assert np.allclose(points_of(other, 30, other.arc), points_of(part, 30, part.arc)[::-1])
    assert np.allclose(flipped(other).covariance, part.covariance)


def test_noise_on_a_slope_makes_no_edges_but_a_step_on_it_does():
    noise = np.random.default_rng(1).normal(0, 2, (80, 80))
    slope = np.tile(5.0 * np.arange(80.0), (80, 1)) * 0.6
    grey = (slope + noise).astype(np.float32)
    stepped = grey + np.float32(30.0) * (np.arange(80)[None, :] >= 40)
    found, at_step = (split(chains_of(image, 'canny', 0.8, (1.0, 1.6)), 0.4, 0.8)[0] for image in (grey, stepped))
    assert len(found) < 20
    assert np.sum(np.abs(at_step.position[:, 0] - 39.5) < 0.5) > 60


def disc(middle, radius, blur):
    """(80, 80) float32: a bright disc, 8 x 8 samples a pixel, blurred."""
    at = (np.arange(640) + 0.5) / 8.0 - 0.5
    inside = (at[None, :] - middle[0]) ** 2 + (at[:, None] - middle[1]) ** 2 < radius**2
    grey = 60.0 + 120.0 * inside.reshape(80, 8, 80, 8).mean(axis=(1, 3))
    return cv2.GaussianBlur(grey.astype(np.float32), (0, 0), blur)


@pytest.mark.parametrize('radius', [8.0, 15.0, 25.0])
@pytest.mark.parametrize('blur', [0.4, 0.9])
def test_neither_blur_nor_the_edgels_fit_make_a_circle_smaller(radius, blur):
    rig = StereoRig.symmetric(PinholeCamera.centred(80, 80, 400.0), 0.0002)
    pair = [detect(disc(middle, radius, blur), sigma=0.8, threshold=5.0) for middle in ((40.3, 39.6), (40.1, 39.6))]
    depth = 400.0 * 0.0002 / 0.2
    start = curve([0.0, 0.0, depth], [0.0, 0.0, -1.0], radius * depth / 400.0)
    free = refine(start, StereoEdgels(*pair, rig, blur_variance(pair)), circle=True)
    assert free is not None
    # So near to each other, two eyes do not tell the plane; it is known here.
    found = held(free, [replace(start, covariance=1e-12 * np.eye(6))])
    assert abs(found.radii[0] / found.centre[2] * 400.0 - radius) < 0.012


@pytest.mark.parametrize('beyond', [-0.004, 0.0, 0.005])
def test_an_edge_that_runs_into_an_arc_ends_where_it_touches_the_circle(beyond):
    rim = curve([0.02, 0.01, 0.25], [0.0, 0.8, -0.6], 0.015, arc=(0.5, np.pi))
    touch = rim.centre + rim.radii[0] * (np.cos(0.5) * rim.first + np.sin(0.5) * rim.second)
    onward = -np.sin(0.5) * rim.first + np.cos(0.5) * rim.second
    edge = np.stack([touch - 0.03 * onward, touch + beyond * onward])[None]
    for ends in (edge, edge[:, ::-1]):
        found, covariance = joined_ends(ends, (2e-3 / 3.0) ** 2 * np.eye(6)[None], np.array([1e-4]), [rim])
        assert min(np.linalg.norm(end - touch) for end in found[0]) < 1e-9
        assert min(np.linalg.norm(end - edge[0, 0]) for end in found[0]) < 1e-9
        joined = FeatureSet.from_edges(found[:, 0], found[:, 1], covariance=covariance)
        assert joined.err_par[0] >= 2e-3 * (1.0 - 1e-12)


def test_an_end_put_to_a_circle_is_as_well_known_across_as_its_line_there():
    """The line is turned about its middle, and so is every place on it."""
    rim = curve([0.02, 0.01, 0.25], [0.0, 0.8, -0.6], 0.015, arc=(0.5, np.pi), spread=1e-6)
    touch = rim.centre + rim.radii[0] * (np.cos(0.5) * rim.first + np.sin(0.5) * rim.second)
    onward = -np.sin(0.5) * rim.first + np.cos(0.5) * rim.second
    ends = np.stack([touch - 0.03 * onward, touch - 0.002 * onward])[None]
    side = np.cross(onward, rim.normal)
    turned = np.concatenate([-side, side])
    covariance = 1e-8 * np.outer(turned, turned) + 1e-12 * np.eye(6)
    found, after = joined_ends(ends, covariance[None], np.array([3e-4]), [rim])
    share = 0.03 / 0.028
    assert np.linalg.norm(found[0, 1] - touch) < 1e-9
    assert side @ after[0, 3:, 3:] @ side == pytest.approx(1e-8 * (2.0 * share - 1.0) ** 2, rel=1e-3)
    assert side @ after[0, :3, 3:] @ side == pytest.approx(-1e-8 * (2.0 * share - 1.0), rel=1e-3)
    assert onward @ after[0, 3:, 3:] @ onward == pytest.approx(1e-12, rel=1e-3)


@pytest.mark.parametrize(('start', 'beyond'), [(0.5 + np.pi, 0.005), (0.5, 0.02)])
def test_an_edge_that_goes_on_or_meets_no_arc_keeps_its_ends(start, beyond):
    rim = curve([0.02, 0.01, 0.25], [0.0, 0.8, -0.6], 0.015, arc=(start, np.pi))
    touch = rim.centre + rim.radii[0] * (np.cos(0.5) * rim.first + np.sin(0.5) * rim.second)
    onward = -np.sin(0.5) * rim.first + np.cos(0.5) * rim.second
    edge = np.stack([touch - 0.03 * onward, touch + beyond * onward])[None]
    assert np.array_equal(joined_ends(edge, 4e-7 * np.eye(6)[None], np.array([1e-4]), [rim])[0], edge)


def test_one_rim_found_twice_is_one_and_two_rims_are_two():
    rim = replace(
        curve([0.02, 0.0, 0.25], [0.2, 0.5, -1.0]),
        left=np.array([1, 1, 1, 0, 0], bool),
        right=np.array([1, 1, 0, 0, 0], bool),
    )
    again = replace(rim, centre=rim.centre + 1e-4, left=np.array([0, 0, 0, 1, 0], bool), right=np.zeros(5, bool))
    none = np.zeros(5, bool)
    ring = replace(rim, radii=0.8 * rim.radii, left=none, right=none)
    end = replace(rim, centre=rim.centre + 0.002 * rim.normal, left=none, right=none)
    of_the_same_edgels = replace(rim, centre=rim.centre + 0.002 * rim.normal, right=none)
    found = distinct([again, rim, ring, end, of_the_same_edgels])
    assert len(found) == 3
    whole = next(c for c in found if c.left.sum() == 4)
    assert np.array_equal(whole.centre, rim.centre)


@pytest.mark.parametrize('is_right', [False, True])
@settings(max_examples=25, deadline=None)
@given(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4), st.floats(-0.03, 0.06), st.floats(-0.03, 0.03))
def test_one_of_the_two_circles_that_look_like_an_ellipse_is_the_true_one(is_right, tilt, turn, x, y):
    true = curve([x, y, 0.25], [np.sin(turn), np.cos(turn) * np.sin(tilt), np.cos(turn) * np.cos(tilt)])
    sine = abs(true.normal @ true.centre) / np.linalg.norm(true.centre)
    assume(sine >= 0.05)  # seen from within its plane it is a line
    points = points_of(true, 9, (0.3, 2.0))
    at = RIG.left.project(points)
    samples = np.column_stack([at, RIG.left.fx * RIG.baseline / points[:, 2]])
    found = circles_of_ellipse(image_conic(true, VIEWS[is_right]), samples, both(true).seen, int(is_right))
    best = min(found, key=lambda c: angle_between(c.normal, true.normal))
    assert angle_between(best.normal, true.normal) < 0.01
    assert np.linalg.norm(best.centre - true.centre) < 1e-6
    assert best.radii == pytest.approx(true.radii, rel=1e-4)


def _edge(low, high) -> tuple[Matches, tuple[Segments, Segments]]:
    """An edge between two points in space, as both eyes see it, and the matches: it alone."""
    ends = np.array([low, high])
    pixels = [view.camera.project(ends - view.centre) for view in VIEWS]
    d = RIG.left.fx * RIG.baseline / ends[:, 2]
    matches = Matches(
        np.array([0], np.int32),
        np.array([0], np.int32),
        np.array([[d[0], d.mean(), d[1]]]),
        np.sort(pixels[0][:, 1])[None],
        np.ones(1),
    )
    return matches, (segments_of([pixels[0]]), segments_of([pixels[1]]))


def _hidden(true: Curve, low, high) -> np.ndarray:
    matches, segments = _edge(low, high)
    contours = contours_of([CurvedSurface.cylinder(true)], segments, RIG)
    junctions = hidden_ends(
        matches, segments, (find_junctions(segments[0]), find_junctions(segments[1])), [true], contours, RIG
    )
    return junctions[0].t_junction[0]


def test_an_edge_that_stops_at_a_rim_in_front_of_it_has_no_corner_there():
    rim = curve([0.025, 0.0, 0.25], [0.0, -0.7, -0.7])
    on_rim = rim.centre + 0.015 * rim.first
    behind = on_rim * 1.2
    assert _hidden(rim, behind + 2.0 * (behind - 1.2 * rim.centre), behind).tolist() == [False, True]


def test_an_edge_that_ends_on_a_rim_of_its_own_face_has_a_corner_there():
    rim = curve([0.025, 0.0, 0.25], [0.0, -0.7, -0.7])
    on_rim = rim.centre + 0.015 * rim.first
    for away in (0.04 * rim.first, -0.015 * rim.first + 0.015 * rim.second, 0.03 * rim.normal):
        assert not _hidden(rim, on_rim + away, on_rim).any()


def test_an_edge_that_stops_at_an_contour_has_no_corner_there():
    rim = curve([0.0, 0.0, 0.25], [0.0, -1.0, -0.4])
    stem = [
        RIG.left.project(
            np.stack([rim.centre + s * 0.015 * rim.first, rim.centre + s * 0.015 * rim.first - 0.03 * rim.normal])
        )
        for s in (1.0, -1.0)
    ]
    conic = image_conic(rim, VIEWS[0])
    lines = tangents(conic, RIG.left.matrix @ rim.normal)
    # The contours themselves: from the touching point along the tangent.
    contour = []
    for line, (top, bottom) in zip(lines[np.argsort([abs(l @ np.append(stem[0][0], 1.0)) for l in lines])], stem):
        along = np.array([-line[1], line[0]])
        foot = [p - line[:2] * (line @ np.append(p, 1.0)) for p in (top, bottom)]
        contour.append(foot if (foot[1] - foot[0]) @ along != 0.0 else foot[::-1])
    middle = 0.5 * (contour[0][0] + contour[0][1])
    out = np.sign(middle - 0.5 * (contour[1][0] + contour[1][1]))
    segments = segments_of([*contour, [middle, middle + 60.0 * np.array([out[0], 0.05])]])
    none = Matches(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    both = segments, segments_of([])
    contours = contours_of([CurvedSurface.cylinder(rim)], both, RIG)
    junctions = hidden_ends(none, both, (find_junctions(both[0]), find_junctions(both[1])), [rim], contours, RIG)
    assert junctions[0].t_junction[2].tolist() == [True, False]


@pytest.mark.filterwarnings('error')
def test_a_rim_that_reaches_behind_the_camera_has_no_contours():
    """Its picture is a hyperbola."""
    rim = curve([0.01, 0.0, 0.01], [0.0, -1.0, -0.1])
    _, segments = _edge([0.0, 0.0, 0.2], [0.01, 0.02, 0.25])
    first = np.array([0])
    assert not on_contours((first, first), contours_of([CurvedSurface.cylinder(rim)], segments, RIG)).any()
