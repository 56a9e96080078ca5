"""Vectors perpendicular to others."""

import numpy as np
import pytest

from msgs_py.numeric.vectors import farthest_axis, perpendicular


@pytest.mark.parametrize('shape', [(3,), (50, 3), (4, 5, 3)])
def test_a_perpendicular_is_a_unit_vector_at_a_right_angle(shape):
    directions = np.random.default_rng(3).normal(size=shape) * 40.0
    found = perpendicular(directions)
    assert found.shape == shape
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, rtol=1e-15)
    np.testing.assert_allclose((found * directions).sum(axis=-1), 0.0, atol=1e-13)
    second = np.cross(directions, found)
    np.testing.assert_allclose(np.cross(found, second), directions, atol=1e-12)


def test_many_directions_at_once_give_what_each_gives_alone():
    directions = np.random.default_rng(4).normal(size=(50, 3))
    np.testing.assert_allclose(perpendicular(directions), [perpendicular(one) for one in directions], rtol=1e-15)
    assert (farthest_axis(directions) == [farthest_axis(one) for one in directions]).all()


def test_none_of_no_directions():
    assert perpendicular(np.zeros((0, 3))).shape == (0, 3)
