"""Circles, arcs, ellipses and axes: against closed forms and rendered cylinders."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_py import FeatureKind, PinholeCamera, Pose, StereoRig
from stereo_recovery import recover
from stereo_recovery.detection import conic_kernels
from stereo_recovery.detection.conics import Ellipse, sampson, symmetric


def upright(elevation: float, yaw: float, depth: float) -> Pose:
    """A solid whose z is up, seen from above."""
    turn = Pose.from_rotation_vector([np.pi / 2 + elevation, 0, 0])
    return Pose(turn.rotation @ Pose.from_rotation_vector([0, 0, yaw]).rotation, [depth / 10, 0, depth])


@pytest.fixture(scope='module')
def cylinder_pair(synthetic, solids):
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
    solid = solids['cylinder on box'].at(upright(0.6, 0.5, 0.25))
    left, right = synthetic.render_pair(solid, rig)
    return solid, rig, recover(left, right, rig).features


def test_a_rim_is_a_circle_of_the_right_size_and_place(synthetic, cylinder_pair):
    solid, rig, features = cylinder_pair
    curves = features.of_kind(FeatureKind.CURVE)
    rims = sorted(synthetic.truth_rims(solid, rig), key=lambda rim: -rim[3])
    assert len(curves) == 2
    centre, normal, radius, share = rims[0]
    assert share > 0.99
    k = int(np.argmin(np.linalg.norm(curves.start - centre, axis=1)))
    assert np.linalg.norm(curves.start[k] - centre) < 0.05e-3
    assert np.degrees(np.arccos(curves.directions[k] @ normal)) < 0.1
    assert abs(curves.radii[k, 0] - radius) < 0.03e-3
    assert curves.arc[k, 1] == pytest.approx(2 * np.pi)


def half_hidden(synthetic, solid, rig, features):
    """The rim of which about half is seen: recovered centre and normal, true centre, up."""
    centre, normal, _, share = min(synthetic.truth_rims(solid, rig), key=lambda rim: rim[3])
    assert 0.3 < share < 0.55
    curves = features.of_kind(FeatureKind.CURVE)
    k = int(np.argmin(np.linalg.norm(curves.start - centre, axis=1)))
    assert curves.arc[k, 1] < 1.3 * np.pi
    return curves.start[k], curves.directions[k], centre, -normal


def test_the_foot_of_a_cylinder_on_a_box_faces_as_the_box_does(synthetic, cylinder_pair):
    start, normal, centre, up = half_hidden(synthetic, *cylinder_pair)
    assert np.linalg.norm(start - centre) < 0.1e-3
    assert np.degrees(np.arccos(normal @ up)) < 0.3


def test_the_lower_end_of_a_cylinder_in_the_air_faces_away(synthetic):
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
    solid = synthetic.cylinder(0.015, 0.035).at(upright(0.6, 0.5, 0.25))
    features = recover(*synthetic.render_pair(solid, rig), rig).features
    start, normal, centre, up = half_hidden(synthetic, solid, rig, features)
    assert np.linalg.norm(start - centre) < 0.1e-3
    assert np.degrees(np.arccos(-normal @ up)) < 0.3


def test_the_axis_joins_the_centres_of_the_ends(cylinder_pair):
    solid, _, features = cylinder_pair
    axes = features.of_kind(FeatureKind.AXIS)
    assert len(axes) == 1
    low, high = solid.axes[0]
    true = (high - low) / np.linalg.norm(high - low)
    assert np.degrees(np.arccos(abs(axes.directions[0] @ true))) < 0.3
    assert min(np.linalg.norm(axes.start[0] - end) for end in (low, high)) < 0.3e-3


def test_outlines_and_rims_are_no_edges(synthetic, cylinder_pair):
    solid, rig, features = cylinder_pair
    edges = features.of_kind(FeatureKind.EDGE)
    truth = synthetic.truth_edges(solid, rig)
    assert len(edges) >= len(truth) // 2 > 0  # the box below the cylinder has edges, and most of them are found
    for start, end in zip(edges.start, edges.end):
        direction = (end - start) / np.linalg.norm(end - start)
        lines = (truth[:, 1] - truth[:, 0]) / np.linalg.norm(truth[:, 1] - truth[:, 0], axis=1)[:, None]
        off = np.linalg.norm(np.cross(start - truth[:, 0], lines), axis=1)
        assert ((np.abs(lines @ direction) > 0.98) & (off < 0.003)).any()


RIM, HOLE, SPREAD = 0.03, 0.003, 0.02


def plate(rig: StereoRig, normal: np.ndarray, centres: np.ndarray) -> list[np.ndarray]:
    """A pair of a disc in space with dark half discs about centres (n, 2), metres in its plane."""
    camera, samples, images = rig.left, (np.arange(4) + 0.5) / 4 - 0.5, []
    u, v = ((np.arange(n)[:, None] + samples).ravel() for n in (camera.width, camera.height))
    x, y = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.stack([x, y, np.ones_like(x)], axis=2)
    across = np.cross(normal, [0.0, 1.0, 0.0]) / np.hypot(normal[0], normal[2])
    for seed, eye in enumerate((0.0, rig.baseline)):
        middle = np.array([-eye, 0.0, 0.2])
        at = rays * ((middle @ normal) / (rays @ normal))[..., None] - middle
        a, b = at @ across, at @ np.cross(normal, across)
        grey = np.where(np.hypot(a, b) < RIM, 150.0, 60.0)
        for centre in centres:
            grey[(np.hypot(a - centre[0], b - centre[1]) < HOLE) & (b < centre[1])] = 40.0
        grey = grey.reshape(camera.height, 4, camera.width, 4).mean(axis=(1, 3))
        noise = np.random.default_rng(seed).normal(0.0, 2.0, grey.shape)
        images.append(np.clip(np.rint(cv2.GaussianBlur(grey, (0, 0), 0.5) + noise), 0, 255).astype(np.uint8))
    return images


@pytest.mark.parametrize('tilt', [0.3, 0.5])
def test_holes_of_which_half_is_seen_have_the_normal_of_the_rim(tilt):
    """By themselves they might be contours of spheres: of 7 pixels, half in sight, the edgels leave the normal open."""
    rig = StereoRig.symmetric(PinholeCamera.centred(320, 240, 500.0), 0.03)
    normal = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    angle = np.arange(6) * np.pi / 3.0 + 0.2
    left, right = plate(rig, normal, SPREAD * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    rim, *holes = sorted(recover(left, right, rig).curves, key=lambda curve: -curve.radii[0])
    assert abs(rim.radii[0] - RIM) < 1e-4
    assert len(holes) >= 5
    assert np.median([hole.radii[0] for hole in holes]) == pytest.approx(HOLE, rel=0.02)
    assert min(abs(hole.normal @ normal) for hole in holes) > np.cos(np.radians(0.5))


@pytest.fixture(scope='module')
def rounded_block(synthetic):
    """A block with rounded ends: two half cylinders of 16 mm radius joined by faces of 30 mm, 15 mm high."""
    box = synthetic.prism(np.array([(-0.015, -0.016), (0.015, -0.016), (0.015, 0.016), (-0.015, 0.016)]), 0.015)
    can = synthetic.cylinder(0.016, 0.015)
    whole = box + can.at(Pose(np.eye(3), [-0.015, 0, 0])) + can.at(Pose(np.eye(3), [0.015, 0, 0]))
    pose = upright(0.8, 0.4, 0.25)
    rig = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
    return pose, recover(*synthetic.render_pair(whole.at(pose), rig), rig).features


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_edges_that_run_into_arcs_smoothly_are_edges(rounded_block, side):
    pose, features = rounded_block
    edges = features.of_kind(FeatureKind.EDGE)
    ends = pose.apply(np.array([[-0.015, side * 0.016, 0.015], [0.015, side * 0.016, 0.015]]))
    true = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = [max(np.linalg.norm(np.cross(p - ends[0], true)) for p in pair) for pair in zip(edges.start, edges.end)]
    k = int(np.argmin(off))
    assert off[k] < 0.2e-3
    assert edges.lengths[k] == pytest.approx(0.030, abs=0.006)


def test_arcs_that_run_into_edges_are_arcs_and_nothing_else_is(rounded_block):
    pose, features = rounded_block
    curves = features.of_kind(FeatureKind.CURVE)
    true = pose.apply(np.array([[x, 0.0, z] for x in (-0.015, 0.015) for z in (0.0, 0.015)]))
    distance = np.linalg.norm(curves.start[:, None] - true[None], axis=2)
    assert len(curves) >= 3
    assert (distance.min(axis=1) < 0.5e-3).all()
    assert np.allclose(curves.radii, 0.016, atol=0.3e-3)
    assert len(set(distance.argmin(axis=1))) == len(curves)


@given(st.floats(5, 80), st.floats(0.2, 1.0), st.floats(0, np.pi), st.floats(0.35, 1.0), st.floats(0, 2 * np.pi))
@settings(max_examples=40, deadline=None)
def test_ellipse_through_exact_points_is_exact(major, ratio, turn, share, start):
    angle = start + share * np.linspace(0, 2 * np.pi, 60)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    points = np.array([100.0, 60.0]) + (np.column_stack([major * np.cos(angle), major * ratio * np.sin(angle)]) @ axes)
    numbers, rms = conic_kernels.fit(points, 4)
    ellipse = Ellipse(symmetric(numbers), rms)
    assert rms < 1e-6 * major
    assert np.allclose(ellipse.centre, [100.0, 60.0], atol=1e-3)
    assert np.allclose(ellipse.radii, [major, major * ratio], rtol=1e-4)


def test_sampson_distance_of_a_circle_is_the_distance():
    conic = np.diag([1.0, 1.0, -100.0])
    assert sampson(conic, np.array([[10.1, 0.0], [0.0, -9.9]])) == pytest.approx([0.1, -0.1], rel=0.02)


@pytest.mark.parametrize(
    'points',
    [
        np.zeros((8, 2)),
        np.column_stack([np.arange(9.0), np.arange(9.0)]),
        np.column_stack([np.arange(5.0), np.arange(5.0) ** 2]),
    ],
)
def test_points_without_an_ellipse_give_none(points):
    numbers, rms = conic_kernels.fit(points, 4)
    assert rms == np.inf or conic_kernels.radii(numbers) == (0.0, 0.0)


def arcs_of(position: np.ndarray, pieces: int, bend: float, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Arcs and conics of one chain, of a circle of radius bend, cut into segments of as many edgels each.

    bend : pixels, below 0 where the chain turns against the angles; several pieces make it a closed one
    """
    bounds = np.arange(0, len(position) + 1, len(position) // pieces)
    bounds = np.stack([bounds[:-1], bounds[1:]], axis=1)
    chord = position[bounds[:, 1] - 1] - position[bounds[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    sagitta = np.copysign(abs(bend) - np.sqrt(bend**2 - 0.25 * length**2), -bend)
    chain, closed, limits = np.zeros(pieces, np.int64), np.array([pieces > 1]), np.full(len(position), limit)
    return conic_kernels.arcs(chain, closed, chord / length[:, None], length, position, limits, bounds, sagitta)[:2]


@pytest.mark.parametrize('sense', [1.0, -1.0])
def test_quarters_of_a_small_ring_are_one_arc(sense):
    turn = sense * np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    position = 8.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + 20.0
    # The chords of neighbouring quarters turn by a right angle, their tangents hardly.
    arc, conics = arcs_of(position, 4, sense * 8.0, 0.5)
    assert arc.tolist() == [0, 0, 0, 0]
    assert conic_kernels.radii(conics[0]) == pytest.approx((8.0, 8.0), abs=1e-6)


@pytest.mark.parametrize(('turn', 'arcs'), [(2.0, [0]), (0.1, [-1])])
def test_a_bent_segment_is_an_arc_by_itself(turn, arcs):
    """Where edgels may be off by more than an arc is high, splitting leaves it whole."""
    angle, radius = np.linspace(0.0, turn, 20), 12.0 / turn
    position = radius * np.column_stack([np.cos(angle), np.sin(angle)]) + 200.0
    assert arcs_of(position, 1, radius, 2.0)[0].tolist() == arcs
