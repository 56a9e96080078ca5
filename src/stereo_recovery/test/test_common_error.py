"""What all features of a pair have in common: columns that are off."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msgs_py import FeatureSet, PinholeCamera, StereoRig
from stereo_recovery.common_error import with_columns_off
from stereo_recovery.matching.row_error import RowError

RIG = StereoRig.symmetric(PinholeCamera.centred(640, 480, 800.0), 0.1)


def seen_with_columns_off(points, pixels):
    """Points (n, 3) as triangulation has them when all disparities are smaller by so many pixels."""
    column, row = RIG.left.project(points).T
    disparity = RIG.left.fx * RIG.baseline / points[:, 2] - pixels
    z = RIG.left.fx * RIG.baseline / disparity
    x, y = (column - RIG.left.cx) * z / RIG.left.fx, (row - RIG.left.cy) * z / RIG.left.fy
    return np.column_stack([x, y, z])


@given(st.integers(0, 2**32 - 1))
def test_features_move_as_what_is_triangulated_does(seed):
    """Ends of edges and axes, centres and normals of circles, by finite differences."""
    rng = np.random.default_rng(seed)
    start, end, centre = rng.uniform(-0.2, 0.2, (3, 2, 3)) + [0.0, 0.0, 0.8]
    normal = rng.normal(size=(2, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    covariance = np.repeat(1e-6 * np.eye(6)[None], 2, axis=0)
    features = FeatureSet.concatenate(
        [
            FeatureSet.from_edges(start, end, covariance=covariance),
            FeatureSet.from_curves(centre, normal, 0.05, covariance=covariance),
            FeatureSet.from_axes(start, end, covariance=covariance),
        ]
    )
    off, sigma = 1e-4, 0.5
    common = with_columns_off(features, sigma, RIG).common * (off / sigma)
    for points, found in ((start, common[:2, :3]), (end, common[4:, 3:]), (centre, common[2:4, :3])):
        # The sign of one sigma says nothing: that which makes depths smaller is taken.
        np.testing.assert_allclose(found, -(seen_with_columns_off(points, off) - points), rtol=1e-3, atol=1e-10)
    for k in range(2):
        across = np.linalg.svd(normal[k][None])[2][1:]
        three = seen_with_columns_off(centre[k] + np.vstack([np.zeros(3), 1e-3 * across]), -off)
        turned = np.cross(three[1] - three[0], three[2] - three[0])
        turned *= np.sign(turned @ normal[k]) / np.linalg.norm(turned)
        np.testing.assert_allclose(common[2 + k, 3:], turned - normal[k], rtol=1e-2, atol=1e-8)


def test_without_an_error_features_have_nothing_in_common():
    edges = FeatureSet.from_edges([[0, 0, 1]], [[0.1, 0, 1]], covariance=1e-6 * np.eye(6)[None])
    assert with_columns_off(edges, 0.0, RIG) is edges
    assert len(with_columns_off(FeatureSet.empty(), 0.5, RIG)) == 0


def test_the_mean_square_of_a_row_error_over_an_image():
    half = np.array([320.0, 240.0])
    error = RowError(0.3, np.array([0.4, -0.2]), half - 0.5, half, 0.0, 20)
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    everywhere = error.at(np.column_stack([u.ravel(), v.ravel()]))
    assert error.rms == pytest.approx(np.sqrt((everywhere**2).mean()), rel=1e-4)
