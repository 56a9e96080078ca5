"""Curves that straight edges place in a face."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_recovery.curves import fit_kernels
from stereo_recovery.curves.curve import Curve, CurveShape
from stereo_recovery.curves.faces import in_face

# Metres and radians: of a bore that is seen in part, and of the ends of edges.
CENTRE, TILT, RADIUS = 3e-4, 0.1, 1e-4
END = 1e-4
BORE = Curve.unfitted(
    CurveShape(np.array([0.01, -0.02, 0.6]), np.array([0.0, 0.6, -0.8]), np.array([1.0, 0.0, 0.0]), np.full(2, 0.008))
)
VAGUE = replace(BORE, covariance=np.diag([CENTRE, CENTRE, CENTRE, TILT, TILT, RADIUS]) ** 2)


def face(curve, corners, covariance=END**2):
    """Edges between corners in a curve's plane, (k, 2) metres from its centre, and their covariance."""
    points = curve.centre + np.asarray(corners, float) @ np.stack([curve.first, curve.second])
    ends = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    return ends, np.broadcast_to(covariance * np.eye(6), (len(ends), 6, 6))


SQUARE = [[-0.03, -0.02], [0.02, -0.02], [0.02, 0.03], [-0.03, 0.03]]


def moved(curve, rng):
    """A curve that errs as its covariance says."""
    step = rng.multivariate_normal(np.zeros(6), curve.covariance)
    growth = step[5] / curve.radii[0]
    return curve.with_shape(
        CurveShape(*fit_kernels.moved(curve.shape, np.array([*step[:5], growth, growth, 0.0]), True))
    )


@given(tilt=st.floats(-0.2, 0.2), other=st.floats(-0.2, 0.2))
@settings(deadline=None)
def test_the_edges_of_its_face_tell_the_normal_of_a_vague_curve(tilt, other):
    normal = BORE.normal + tilt * BORE.second - other * BORE.first
    normal /= np.linalg.norm(normal)
    first = BORE.first - normal * (BORE.first @ normal)
    start = replace(VAGUE, normal=normal, first=first / np.linalg.norm(first))
    found = in_face(start, *face(BORE, SQUARE))
    # Edges are 40 mm apart and off by .1 mm; the linear update leaves the square of the tilt.
    assert np.linalg.norm(np.cross(found.normal, BORE.normal)) < 0.01 + tilt**2 + other**2
    assert found.tilt < 0.01 < VAGUE.tilt
    np.testing.assert_allclose(found.radii, BORE.radii, atol=1e-4)


def test_edges_of_another_plane_say_nothing():
    ends, covariance = face(BORE, SQUARE)
    assert in_face(VAGUE, ends + 0.02 * BORE.normal, covariance) is VAGUE
    turned = np.eye(3) + np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert in_face(VAGUE, BORE.centre + (ends - BORE.centre) @ turned.T, covariance) is VAGUE


@pytest.mark.parametrize('count', [0, 1])
def test_one_edge_makes_no_face(count):
    ends, covariance = face(BORE, SQUARE)
    assert in_face(VAGUE, ends[:count], covariance[:count]) is VAGUE


def test_what_a_face_tells_has_a_true_covariance():
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(300):
        ends, covariance = face(BORE, SQUARE)
        ends = ends + rng.normal(scale=END, size=ends.shape)
        found = in_face(moved(VAGUE, rng), ends, covariance)
        tilt = np.array([BORE.normal @ found.second, -BORE.normal @ found.first])
        off = np.array([*(BORE.centre - found.centre), *tilt, BORE.radii[0] - found.radii[0]])
        errors.append(off @ np.linalg.solve(found.covariance, off))
    # Six numbers; the edges that lie best in its plane are chosen, and faces are taken for a little uneven.
    assert 4.8 < np.mean(errors) < 7.2


def test_chance_makes_a_face_once_in_twenty_at_most():
    rng = np.random.default_rng(4)
    taken = 0
    for _ in range(400):
        middle = BORE.centre + rng.uniform(-0.05, 0.05, size=(12, 1, 3))
        run = rng.normal(size=(12, 1, 3)) * np.array([-0.01, 0.01])[:, None]
        found = in_face(VAGUE, middle + run, np.broadcast_to(END**2 * np.eye(6), (12, 6, 6)))
        taken += found is not VAGUE
    assert taken < 20
