"""Curves that better known ones tell of: on their axes, and in their planes."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_py import FeatureKind, PinholeCamera, StereoRig
from stereo_recovery import recover
from stereo_recovery.curves.axis_constraint import in_plane, off_axis_and_plane
from stereo_recovery.curves.coaxial_starts import coaxial_starts
from stereo_recovery.curves.curve import Curve, CurveShape, camera_views, image_conic, perpendicular
from stereo_recovery.curves.fit import has_size
from stereo_recovery.curves.observations import StereoEdgels
from stereo_recovery.curves.settings import INLIER_DISTANCE
from stereo_recovery.detection.edgels import Edgels
from stereo_recovery.detection.segments import Segments

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
NO_EDGELS = StereoEdgels(Edgels.empty(), Edgels.empty(), RIG, 0.0)
NOTHING_TAKEN = np.zeros(1, bool), np.zeros(1, bool)


def circle(centre, normal, radius, sigma=1e-5) -> Curve:
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    first = perpendicular(normal)
    shape = CurveShape(np.asarray(centre, float), normal, first / np.linalg.norm(first), np.full(2, radius))
    return replace(Curve.unfitted(shape), covariance=sigma**2 * np.eye(6))


def tangents_of(curve: Curve, view, angles) -> np.ndarray:
    """(n, 2, 2): pieces of tangents of a circle's picture, ten pixels long."""
    points = curve.centre + curve.radii[0] * (
        np.cos(angles)[:, None] * curve.first + np.sin(angles)[:, None] * curve.second
    )
    at = view.camera.project(points - view.centre)
    conic = image_conic(curve, view)
    across = at @ conic[:2, :2] + conic[:2, 2]
    along = np.stack([-across[:, 1], across[:, 0]], axis=1) / np.linalg.norm(across, axis=1)[:, None]
    return at[:, None] + 5.0 * np.array([-1.0, 1.0])[:, None] * along[:, None]


def random_segments(rng, count: int) -> np.ndarray:
    start = rng.uniform(0.0, 512.0, (count, 1, 2))
    return np.concatenate([start, start + rng.normal(size=(count, 1, 2)) * 15.0], axis=1)


def pixels_apart(one: CurveShape, other: CurveShape) -> float:
    """The most, over both images, between what two circles of one plane's direction draw."""
    around = np.linspace(0.0, 2.0 * np.pi, 60)[:, None]
    spokes = np.cos(around) * other.first + np.sin(around) * np.cross(other.normal, other.first)
    drawn = [
        [view.camera.project(of.centre + of.radii[0] * spokes - view.centre) for view in camera_views(RIG)]
        for of in (one, other)
    ]
    return float(np.linalg.norm(np.subtract(*drawn), axis=2).max())


def first_start(known: Curve, true: Curve, rng, others: int) -> CurveShape:
    """What eight pieces of a circle in either image tell, among others that are of nothing."""
    segments = [
        Segments.between(
            np.concatenate([random_segments(rng, others), tangents_of(true, view, rng.uniform(0.0, 2.0 * np.pi, 8))]),
            0.05,
        )
        for view in camera_views(RIG)
    ]
    (shape, near), *_ = coaxial_starts(known, (segments[0], segments[1]), NOTHING_TAKEN, NO_EDGELS)
    assert len(near) == 0
    return shape


def circles_on_an_axis(tilt: float, turn: float, height: float, ratio: float) -> tuple[Curve, Curve]:
    known = circle([0.02, -0.01, 0.4], [tilt, turn, -1.0], 0.03)
    return known, circle(known.centre + height * known.normal, known.normal, ratio * 0.03)


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(-0.03, 0.03), st.floats(0.4, 1.8), st.integers(0, 99))
@settings(deadline=None)
def test_segments_of_both_images_tell_height_and_radius(tilt, turn, height, ratio, seed):
    known, true = circles_on_an_axis(tilt, turn, height, ratio)
    shape = first_start(known, true, np.random.default_rng(seed), 0)
    # A fit takes the edgels about twice as far as an inlier is.
    assert pixels_apart(shape, true.shape) < 2.0 * INLIER_DISTANCE
    assert np.array_equal(shape.normal, known.normal)


def test_segments_that_tell_nothing_seldom_lead_astray():
    rng = np.random.default_rng(0)
    apart = []
    for _ in range(100):
        known, true = circles_on_an_axis(*rng.uniform([-0.7, -0.7, -0.03, 0.4], [0.7, 0.7, 0.03, 1.8]))
        apart.append(pixels_apart(first_start(known, true, rng, 40), true.shape))
    assert np.mean(np.array(apart) < 2.0 * INLIER_DISTANCE) >= 0.9
    assert np.median(apart) < 0.1 * INLIER_DISTANCE


def test_what_one_image_alone_shows_is_no_start():
    known = circle([0.02, -0.01, 0.4], [0.2, 0.1, -1.0], 0.03)
    drawn = tangents_of(known, camera_views(RIG)[0], np.linspace(0.0, 6.0, 8))
    segments = Segments.between(drawn, 0.05), Segments.between(np.zeros((0, 2, 2)), 0.05)
    assert coaxial_starts(known, segments, NOTHING_TAKEN, NO_EDGELS) == []


def dashed_target(shift: float) -> np.ndarray:
    """A disc of 90 pixels face on, and in it a dashed circle of 45, each dash too short for an ellipse."""
    v, u = (np.mgrid[0:1200, 0:1600] + 0.5) / 4.0
    x, y = u - 200.0 + shift, v - 150.0
    radius, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    picture = np.where(radius < 90.0, 190.0, 50.0)
    picture[(radius < 45.0) & (angle % 24.0 < 14.0)] = 110.0
    picture = picture.reshape(300, 4, 400, 4).mean(axis=(1, 3))
    return (picture + np.random.default_rng(int(shift)).normal(0.0, 1.0, picture.shape)).astype(np.uint8)


def test_a_circle_seen_in_pieces_is_found_on_the_axis_of_its_neighbour():
    rig = StereoRig.symmetric(PinholeCamera.centred(400, 300, 500.0), 0.06)
    found = recover(dashed_target(0.0), dashed_target(60.0), rig).features.of_kind(FeatureKind.CURVE)
    radii = np.sort(found.radii[:, 0]) * 500.0 / 0.5
    assert len(found) == 2
    np.testing.assert_allclose(radii, [45.0, 90.0], atol=0.5)


# Metres and radians: a small hole that is seen in part.
HOLE = circle([0.03, 0.0, 0.5], [0.0, 0.5, -1.0], 0.005)
VAGUE = replace(HOLE, covariance=np.diag([3e-4, 3e-4, 2e-3, 0.05, 0.05, 5e-4]) ** 2)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
@settings(deadline=None)
def test_a_curve_in_a_known_plane_takes_it(across, along):
    rim = circle(HOLE.centre + across * HOLE.first + along * HOLE.second, HOLE.normal, 0.04)
    off_plane = replace(VAGUE, centre=HOLE.centre + 1e-3 * HOLE.normal)
    found = in_plane(off_plane, [rim])
    assert abs((found.centre - HOLE.centre) @ HOLE.normal) < 1e-4
    assert found.tilt < 2e-3 < VAGUE.tilt
    assert has_size(found)


def test_a_curve_in_no_known_plane_stays():
    rim = circle(HOLE.centre + 0.02 * HOLE.first, HOLE.normal, 0.04)
    assert in_plane(VAGUE, [replace(rim, centre=rim.centre + 0.03 * rim.normal)]) is VAGUE
    assert in_plane(VAGUE, [circle(rim.centre, rim.normal + 0.5 * rim.first, 0.04)]) is VAGUE
    assert in_plane(VAGUE, []) is VAGUE
    # One that is no better known says nothing, and nothing is said of an ellipse.
    assert in_plane(VAGUE, [replace(rim, covariance=VAGUE.covariance)]) is VAGUE
    ellipse = replace(VAGUE, radii=np.array([0.005, 0.004]))
    assert in_plane(ellipse, [rim]) is ellipse


def test_what_says_nothing_places_no_curve():
    blank = replace(VAGUE, covariance=np.diag([0.1, 0.1, 0.1, 2.0, 2.0, 0.1]) ** 2)
    rim = circle(HOLE.centre + 0.02 * HOLE.first, HOLE.normal, 0.04)
    assert in_plane(blank, [rim]) is blank


@given(st.integers(0, 999))
@settings(deadline=None)
def test_derivatives_of_the_offsets_are_those_of_differences(seed):
    rng = np.random.default_rng(seed)
    known = circle(rng.normal(size=3) * 0.02 + [0, 0, 0.5], rng.normal(size=3), 0.03, 0.0)
    other = circle(known.centre + rng.normal(size=3) * 0.02, known.normal + 0.01 * rng.normal(size=3), 0.01, 0.0)
    off, slope, _ = off_axis_and_plane(known, other)
    for k in range(5):
        step = np.zeros(6)
        step[k] = 1e-7
        turn = other.normal + step[3] * other.second - step[4] * other.first
        moved = replace(other, centre=other.centre + step[:3], normal=turn / np.linalg.norm(turn))
        np.testing.assert_allclose((off_axis_and_plane(known, moved)[0] - off) / 1e-7, slope[:, k], atol=1e-5)
