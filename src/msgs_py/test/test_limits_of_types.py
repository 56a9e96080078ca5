"""The types at the edge of what they accept: what is just allowed is kept as it is, what is not is named."""

import numpy as np
import pytest

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose

NONE = np.zeros(0)


def a_curve(radii=(0.2, 0.1), major_axis=None):
    return FeatureSet.from_curves([[0, 0, 1]], [[0, 0, 2]], np.array([radii], float), major_axis=major_axis)


def test_a_focal_length_below_one_pixel_is_one():
    assert PinholeCamera(1, 1, 0.5, 0.25, 0.0, 0.0).fy == 0.25
    for wrong in (0.0, -0.5):
        with pytest.raises(ValueError, match='fx: expected a focal length > 0'):
            PinholeCamera(1, 1, wrong, 1.0, 0.0, 0.0)


@pytest.mark.parametrize('kind', [np.uint8(0), np.zeros((2, 2), np.uint8)])
def test_kinds_are_a_list(kind):
    with pytest.raises(ValueError, match=r'kind: expected shape \(n,\)'):
        FeatureSet(kind, NONE, NONE, NONE, NONE, NONE)


def test_what_is_no_curve_has_no_radii_whatever_is_given():
    kinds = np.array([FeatureKind.EDGE, FeatureKind.CURVE, FeatureKind.AXIS], np.uint8)
    start, end = np.zeros((3, 3)), np.ones((3, 3))
    found = FeatureSet(kinds, start, end, np.full((3, 2), 0.5), np.zeros(3), np.zeros(3))
    assert np.isnan(found.radii[[0, 2]]).all() and found.radii[1].tolist() == [0.5, 0.5]


def test_one_radius_is_that_of_a_circle_and_two_are_of_an_ellipse():
    centres, normals = [[0, 0, 1], [0, 1, 1]], [[0, 0, 1], [0, 0, 1]]
    for radii, expected in (
        (0.3, [[0.3, 0.3]] * 2),
        ([0.3, 0.4], [[0.3, 0.3], [0.4, 0.4]]),
        ([[0.3, 0.1], [0.4, 0.2]], [[0.3, 0.1], [0.4, 0.2]]),
    ):
        assert FeatureSet.from_curves(centres, normals, radii).radii.tolist() == expected


def test_an_ellipse_is_drawn_from_its_major_axis_and_a_circle_from_anywhere():
    (first, *_), ellipse = a_curve(major_axis=[[0, 1, 0]]).polyline(0, 4), a_curve(major_axis=[[0, 1, 0]])
    np.testing.assert_allclose(first, [0, 0.2, 1], atol=1e-12)
    assert ellipse.polyline(0, 5).shape == (5, 3)
    circle = a_curve((0.2, 0.2)).polyline(0, 9)
    np.testing.assert_allclose(np.linalg.norm(circle - [0, 0, 1], axis=1), 0.2)


@pytest.mark.parametrize(('name', 'shape'), [('rotation', (3, 3)), ('translation', (3,))])
def test_a_pose_names_what_is_not_finite_or_of_another_shape(name, shape):
    for wrong in (np.full(shape, np.nan), np.zeros(5)):
        with pytest.raises(ValueError, match=f'^{name}: '):
            Pose(**{name: wrong})
