"""The bound of a pose, against experiments: the best estimate of a step, and pictures that change with the pose."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

sys.path.insert(0, str(Path(__file__).resolve().parent / 'benchmarks'))
from pose_bounds import PoseBound, View, edge_samples, normal_jacobian, pose_bound

from csg_renderer import Scene, Solid, parse_scene, render_stereo
from csg_renderer.raycast.sensor import grey
from model_matcher.closed_form.planning.steps import edge_information, sensor_blur
from msgs_py import PinholeCamera, Pose, StereoRig

RIG = StereoRig.symmetric(PinholeCamera.centred(320, 240, 420.0), 0.07)
POSE = Pose.from_rotation_vector([0.5, -0.6, 0.3], [-0.01, -0.02, 0.4])


@pytest.mark.parametrize('known', [True, False], ids=['levels known', 'levels estimated'])
@pytest.mark.parametrize(('contrast', 'blur', 'noise'), [(40.0, 0.6, 2.0), (90.0, 1.2, 4.0), (25.0, 0.8, 1.0)])
def test_maximum_likelihood_of_a_step_reaches_the_information_and_not_more(contrast, blur, noise, known):
    rng = np.random.default_rng(5)
    x = np.arange(-12.0, 13.0)
    true = rng.uniform(-0.5, 0.5, 20000)
    level = 80.0
    rows = level + contrast * ndtr((x - true[:, None]) / blur) + noise * rng.standard_normal((len(true), len(x)))
    guess = np.column_stack([np.zeros(len(true)), np.full(len(true), level), np.full(len(true), contrast)])
    free = 1 if known else 3
    for _ in range(6):
        z = (x - guess[:, :1]) / blur
        slope = np.exp(-0.5 * z * z) / (blur * np.sqrt(2.0 * np.pi))
        partial = np.stack([-guess[:, 2:] * slope, np.ones_like(z), ndtr(z)], axis=2)[..., :free]
        residual = rows - guess[:, 1:2] - guess[:, 2:] * ndtr(z)
        normal = np.einsum('nki,nkj->nij', partial, partial)
        guess[:, :free] += np.linalg.solve(normal, np.einsum('nki,nk->ni', partial, residual)[..., None])[..., 0]
    variance = float(np.var(guess[:, 0] - true))
    left = 1.0 if known else 1.0 - 2.0 * np.sqrt(np.pi) * blur / len(x)
    assert variance * edge_information(contrast, blur, noise) * left == pytest.approx(1.0, abs=0.03)


def part(text: str) -> Solid:
    """A solid whose faces differ in grey whatever the light: then nothing but its edges tells of its pose."""
    return next(iter(parse_scene(f'UNITS MM;\npart = {text} PAINT FACES;\nDRAW part;').definitions.values()))


STEPPED = part('(BLOCK (80, 50, 60) DIFFERENCE (BLOCK (50, 30, 80) AT (40, 30, -10)))')
BORED = part('(BLOCK (80, 50, 60) DIFFERENCE (CYLINDER (15, 0, 80, 0) AT (40, -10, 30)))')


def views(pose: Pose, solid: Solid, **options: object) -> list[np.ndarray]:
    scene = Scene([solid.transformed(pose)], (), (1.0, 1.0, 1.0), (0.15, 0.15, 0.15))
    return [grey(frame.image) for frame in render_stereo(scene, RIG, **options)]


def bound_of(solid: Solid, pose: Pose, psf: float, noise: float) -> PoseBound:
    eyes = (Pose.identity(), Pose(np.eye(3), RIG.right_T_left))
    made = [View(RIG.left, eye, image) for eye, image in zip(eyes, views(pose, solid))]
    return pose_bound(solid, pose, made, sensor_blur(psf), noise)


@pytest.mark.parametrize('solid', [STEPPED, BORED], ids=['edges', 'rims'])
def test_the_information_of_pictures_that_change_with_the_pose_is_that_of_their_edges(solid):
    """The derivative of the pictures themselves, by rendering the part a little beside, has all there is to know."""
    psf, noise = 0.5, 2.0
    bound = bound_of(solid, POSE, psf, noise)
    step = np.array([2e-4] * 3 + [4e-3] * 3)
    moved = []
    for k in range(6):
        pair = []
        for sign in (1.0, -1.0):
            change = sign * step * np.eye(6)[k]
            turn = Pose.from_rotation_vector(change[3:])
            pose = Pose(turn.rotation @ POSE.rotation, POSE.translation + change[:3])
            pair.append(np.concatenate([image.ravel() for image in views(pose, solid, antialias=16, psf=psf)]))
        moved.append((pair[0] - pair[1]) / (2.0 * step[k]))
    columns = np.array(moved)
    all_there_is = columns @ columns.T / (noise**2 + 1.0 / 12.0)
    for information in (bound.information, all_there_is):
        assert np.linalg.eigvalsh(information).min() > 0.0
    ratio = np.sqrt(np.diag(bound.covariance) / np.diag(np.linalg.inv(all_there_is)))
    assert np.all((ratio > 0.9) & (ratio < 1.15)), ratio


@settings(deadline=None, max_examples=15)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_samples_move_along_their_normals_as_the_jacobian_says(numbers):
    view = View(RIG.right, Pose(np.eye(3), RIG.right_T_left), views(POSE, STEPPED)[1])
    samples = edge_samples(STEPPED, POSE, view)
    assert len(samples.points) > 200
    assert np.allclose(view.camera.project(view.eye_T_left.apply(samples.points)), samples.pixels, atol=1e-6)
    change = 1e-6 * np.array(numbers)
    turn = Pose.from_rotation_vector(change[3:])
    body = POSE.inverse().apply(samples.points)
    moved = Pose(turn.rotation @ POSE.rotation, POSE.translation + change[:3]).apply(body)
    shift = view.camera.project(view.eye_T_left.apply(moved)) - samples.pixels
    along = np.einsum('ij,ij->i', shift, samples.normals)
    assert np.allclose(along, normal_jacobian(samples, view, POSE.translation) @ change, atol=1e-8)


def test_a_ball_leaves_its_turns_free_and_half_the_noise_halves_the_bound():
    ball = Solid.sphere(0.03)
    bound = bound_of(ball, Pose(np.eye(3), [0.0, 0.0, 0.4]), 0.5, 2.0)
    assert bound.degrees < 1e-3
    assert 0.0 < bound.metres(np.zeros(3)) < 1e-3
    one, two = (bound_of(STEPPED, POSE, 0.5, noise) for noise in (2.0, 1.0))
    expected = np.sqrt((4.0 + 1.0 / 12.0) / (1.0 + 1.0 / 12.0))
    assert one.degrees / two.degrees == pytest.approx(expected)
    wider = bound_of(STEPPED, POSE, 1.0, 2.0)
    assert wider.degrees / one.degrees == pytest.approx((sensor_blur(1.0) / sensor_blur(0.5)) ** 0.5)
