"""Contours of spheres and discs that face the cameras are told apart: exact images with the noise of edgels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from msgs_py import PinholeCamera, StereoRig
from stereo_recovery.curves.curve import CameraView, Curve, camera_views
from stereo_recovery.curves.fit import refine
from stereo_recovery.curves.observations import StereoEdgels
from stereo_recovery.curves.spheres import without_spheres
from stereo_recovery.detection.edgels import Edgels

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.05)
CENTRE = np.array([0.03, -0.01, 0.25])
NOISE = 0.03


def towards(middle: np.ndarray) -> np.ndarray:
    return middle / np.linalg.norm(middle)


def ring(centre: np.ndarray, normal: np.ndarray, radius: float, extent: float) -> np.ndarray:
    first = np.cross(normal, [0.1, 0.9, 0.0])
    first /= np.linalg.norm(first)
    angle = np.linspace(0.3, 0.3 + extent, 160, endpoint=False)[:, None]
    return centre + radius * (np.cos(angle) * first + np.sin(angle) * np.cross(normal, first))


def edgels(points: np.ndarray, view: CameraView, seed: int) -> Edgels:
    at = view.camera.project(points - view.centre)
    centre = view.camera.project((CENTRE - view.centre)[None])[0]
    across = (at - centre) / np.linalg.norm(at - centre, axis=1, keepdims=True)
    at = at + NOISE * np.random.default_rng(seed).normal(size=(len(at), 1)) * across
    level = np.full(len(at), NOISE)
    return Edgels(
        at,
        np.arctan2(across[:, 1], across[:, 0]),
        np.full(len(at), 40.0),
        level,
        level,
        np.ones(len(at)),
        np.zeros(len(at)),
        1.0 / level,
    )


def fitted(radius: float, pair: StereoEdgels) -> Curve:
    """The circle that the curve fit makes of the edgels of both images."""
    start = Curve(
        CENTRE,
        -towards(CENTRE),
        towards(np.cross(CENTRE, [0.0, 1.0, 0.0])),
        np.full(2, radius),
        np.zeros((6, 6)),
        np.inf,
        np.ones(len(pair.left), bool),
        np.ones(len(pair.right), bool),
    )
    found = refine(start, pair, circle=True)
    assert found is not None
    return replace(found, left=start.left, right=start.right)


@pytest.mark.parametrize('radius', [0.005, 0.01, 0.02])
@pytest.mark.parametrize('extent', [2.0 * np.pi, np.pi])
def test_the_contour_of_a_sphere_is_no_curve(radius, extent):
    pair = []
    for seed, view in enumerate(camera_views(RIG)):
        # The circle in which the cone of sight touches the sphere.
        sight = CENTRE - view.centre
        far = np.linalg.norm(sight)
        pair.append(
            edgels(
                ring(
                    CENTRE - radius**2 / far * towards(sight),
                    towards(sight),
                    radius * np.sqrt(1.0 - (radius / far) ** 2),
                    extent,
                ),
                view,
                seed,
            )
        )
    both = StereoEdgels(*pair, RIG, 0.0)
    assert without_spheres([fitted(radius, both)], both) == []


@pytest.mark.parametrize('radius', [0.007, 0.01, 0.02])
@pytest.mark.parametrize('tilt', [0.0, 0.1, 0.5])
def test_a_disc_is_a_curve_even_when_it_faces_us(radius, tilt):
    normal = towards(towards(CENTRE - [0.5 * RIG.baseline, 0.0, 0.0]) + [0.0, tilt, 0.0])
    points = ring(CENTRE, normal, radius, 2.0 * np.pi)
    left, right = (edgels(points, view, seed) for seed, view in enumerate(camera_views(RIG)))
    pair = StereoEdgels(left, right, RIG, 0.0)
    assert len(without_spheres([fitted(radius, pair)], pair)) == 1
