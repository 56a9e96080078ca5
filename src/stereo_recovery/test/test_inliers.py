"""Edgels of a curve: near its conic with a gradient across it, and not at the ends of runs."""

from __future__ import annotations

import numpy as np
import pytest

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.curves import inlier_kernels
from stereo_recovery.curves.curve import Curve, CurveShape
from stereo_recovery.curves.fit_kernels import is_line, recovered
from stereo_recovery.curves.observations import StereoEdgels
from stereo_recovery.curves.settings import ACROSS_COSINE, CORNER_EDGELS, INLIER_DISTANCE, INLIER_SIGMAS
from stereo_recovery.detection.edgels import Edgels

CIRCLE = np.diag([1.0, 1.0, -400.0])


WHOLE = (0.0, 2.0 * np.pi, 1.0)
SMALL = np.full(2, 0.04)


def around(count: int, radius: float = 20.0, share: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Edgels round a circle about the origin, with gradients along the radius."""
    angle = np.linspace(0.0, 2.0 * np.pi * share, count, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), angle


def on_circle(position: np.ndarray, direction: np.ndarray, conic: np.ndarray = CIRCLE) -> np.ndarray:
    """Edgels on the circle or another conic, as those of a curve are."""
    return within(np.full(len(position), INLIER_DISTANCE), position, direction, conic)


def within(most: np.ndarray, position: np.ndarray, direction: np.ndarray, conic: np.ndarray = CIRCLE) -> np.ndarray:
    """The same of edgels that may be off by so much each."""
    on = np.zeros(len(position), bool)
    around = inlier_kernels.boxes(position)
    on[inlier_kernels.on_conic(conic, position, direction, around, most, ACROSS_COSINE)] = True
    return on


def test_edgels_belong_by_distance_and_by_gradient():
    position, direction = around(60)
    assert on_circle(position, direction).all()
    assert on_circle(position, direction + np.pi).all()
    assert not on_circle(position, direction + 0.5).any()
    for radius, near in ((20.6, True), (19.4, True), (20.8, False), (19.2, False)):
        assert (on_circle(*around(60, radius)) == near).all()


def test_a_vague_edgel_may_be_farther_off_than_a_sure_one():
    vague = np.arange(60) < 20
    assert (within(np.where(vague, 1.2, INLIER_DISTANCE), *around(60, 21.0)) == vague).all()


def noisy_pair(noise: float, crossing: int, rng: np.random.Generator) -> tuple[StereoEdgels, CurveShape]:
    """Edgels of a circle of 40 px, 1 m before a rig, and so many more beside it whose gradients lie anyhow."""
    rig = StereoRig.symmetric(PinholeCamera.centred(640, 480, 1000.0), 0.1)
    shape = CurveShape(np.array([0.05, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), np.eye(3)[0], SMALL)
    angle = np.linspace(0.0, 2.0 * np.pi, 250, endpoint=False)
    away = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    eyes = []
    for x in (0.0, 0.1):
        centre = rig.left.project(shape.centre[None] - [x, 0.0, 0.0])[0]
        on = centre + (40.0 + rng.normal(0.0, noise, 250))[:, None] * away
        beside = centre + (40.0 + rng.uniform(-0.6, 0.6, crossing))[:, None] * away[rng.integers(0, 250, crossing)]
        position, count = np.concatenate([on, beside]), 250 + crossing
        direction = np.concatenate([angle, rng.uniform(0.0, 2.0 * np.pi, crossing)])
        sigma, one = np.full(count, noise), np.ones(count)
        eyes.append(Edgels(position, direction, one, sigma, sigma, one, 0.0 * one, one))
    return StereoEdgels(eyes[0], eyes[1], rig, 0.0), shape


@pytest.mark.parametrize('noise', [0.05, 0.3, 0.6])
def test_in_noise_a_curve_keeps_its_edgels(noise):
    seen, shape = noisy_pair(noise, 0, np.random.default_rng(5))
    found, belongs, arc, _ = recovered(shape, seen.seen, np.arange(500))
    assert found.good
    # Two sigma; a few more are lost where noise has turned the picture of the curve.
    assert len(belongs) > 0.9 * 500
    assert arc[2] == 1.0
    assert abs(found.shape.radii[0] - 0.04) < 3.0 * np.sqrt(found.covariance[5, 5])


@pytest.mark.parametrize('crossing', [0, 600])
def test_a_curve_is_found_in_texture(crossing):
    seen, shape = noisy_pair(0.1, crossing, np.random.default_rng(6))
    own = np.concatenate([np.arange(250), 250 + crossing + np.arange(250)])
    assert recovered(shape, seen.seen, own).fit.good


@pytest.mark.parametrize('noise', [0.1, 0.3, 0.6])
def test_what_lies_evenly_along_a_curve_by_chance_is_texture(noise):
    seen, shape = noisy_pair(noise, 0, np.random.default_rng(6))
    rng = np.random.default_rng(7)
    for edgels in (seen.left, seen.right):
        away = np.stack([np.cos(edgels.direction), np.sin(edgels.direction)], axis=1)
        limit = max(INLIER_DISTANCE, INLIER_SIGMAS * noise)
        off = np.linalg.norm(edgels.position - edgels.position.mean(axis=0), axis=1)
        edgels.position[:] += (40.0 + rng.uniform(-limit, limit, 250) - off)[:, None] * away
    assert not recovered(shape, StereoEdgels(seen.left, seen.right, seen.rig, 0.0).seen, np.arange(500)).fit.good


def test_runs_lose_their_ends_and_short_ones_go():
    position, _ = around(40, share=0.5)
    mask = np.zeros(40, bool)
    # A single edgel, a run of three, and one of ten.
    mask[[0, 5, 6, 7, *range(12, 22)]] = True
    kept = inlier_kernels.without_ends(np.flatnonzero(mask), position)
    assert kept.tolist() == list(range(12 + CORNER_EDGELS, 22 - CORNER_EDGELS))


def test_a_closed_run_has_no_ends():
    position, _ = around(60)
    assert len(inlier_kernels.without_ends(np.arange(60), position)) == 60
    assert len(inlier_kernels.without_ends(np.arange(0), position)) == 0


@pytest.mark.parametrize(('degrees', 'line'), [(0.0, True), (1.0, True), (3.0, False), (30.0, False), (90.0, False)])
def test_a_circle_seen_edge_on_is_a_line(degrees, line):
    """A radius of 20 mm at 1 m, f = 1000 pixels: 20 pixels, times the sine of the angle from which its face is seen."""
    angle = np.radians(degrees)
    centre, normal = np.array([0.0, 0.0, 1.0]), np.array([np.cos(angle), 0.0, np.sin(angle)])
    curve = Curve.unfitted(CurveShape(centre, normal, np.array([0.0, 1.0, 0.0]), np.full(2, 0.02)))
    rig = StereoRig.symmetric(PinholeCamera.centred(640, 480, 1000.0), 0.3)
    seen = StereoEdgels(Edgels.empty(), Edgels.empty(), rig, 0.0).seen
    assert is_line(curve.shape, WHOLE, seen, 0) == line
    # From the side the other camera sees its face.
    assert not is_line(curve.shape, WHOLE, seen, 1)


@pytest.mark.parametrize(('extent', 'line'), [(0.2, True), (0.42, True), (0.5, False), (3.0, False)])
def test_a_short_arc_of_a_large_circle_is_a_line(extent, line):
    """Face on, of 40 pixels: the ends of an arc are off its line by two thirds of 40 (1 - cos(extent / 2)) pixels."""
    curve = Curve.unfitted(CurveShape(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), np.eye(3)[0], SMALL))
    rig = StereoRig.symmetric(PinholeCamera.centred(640, 480, 1000.0), 0.1)
    seen = StereoEdgels(Edgels.empty(), Edgels.empty(), rig, 0.0).seen
    assert is_line(curve.shape, (0.4, extent, 1.0), seen, 0) == line
    assert is_line(curve.shape, (0.4, extent, 1.0), seen, 1) == line
    # What a fit that has gone astray makes of it is no error.
    assert not is_line(curve.shape._replace(centre=np.zeros(3)), WHOLE, seen, 0)


@pytest.mark.parametrize(('wide', 'high', 'turn'), [(20.0, 20.0, 0.0), (60.0, 15.0, 0.4), (30.0, 5.0, 1.3)])
def test_none_is_missed_because_it_is_far_from_the_middle(wide, high, turn):
    """All edgels of a picture, by the same distance, without a box about the ellipse."""
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    block = axes @ np.diag([wide**-2.0, high**-2.0]) @ axes.T
    centre = np.array([150.0, 110.0])
    conic = np.block([[block, -(block @ centre)[:, None]], [-(block @ centre)[None], centre @ block @ centre - 1.0]])
    rng = np.random.default_rng(3)
    angle = rng.uniform(0.0, 2.0 * np.pi, 4000)
    on = centre + np.stack([wide * np.cos(angle), high * np.sin(angle)], axis=1) @ axes.T
    position = np.concatenate([rng.uniform([0.0, 0.0], [320.0, 240.0], (4000, 2)), on + rng.normal(0.0, 0.7, on.shape)])
    gradient = (position - centre) @ block
    value = ((position - centre) * gradient).sum(axis=1) - 1.0
    near = np.abs(value) < 2.0 * INLIER_DISTANCE * np.hypot(*gradient.T)
    found = on_circle(position, np.arctan2(*gradient.T[::-1]), conic)
    assert found.sum() > 1000
    assert (found == near).all()
