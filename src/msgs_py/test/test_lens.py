"""Lenses that distort, against OpenCV's projections and against themselves."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msgs_py import LensDistortion, PinholeCamera

CAMERA = PinholeCamera(640, 480, 420.0, 424.0, 321.5, 236.25)
LENSES = {
    'barrel': LensDistortion('plumb_bob', (-0.28, 0.07, 0.0008, -0.0006, -0.008)),
    'pincushion': LensDistortion('plumb_bob', (0.12, 0.02, 0.0, 0.001, 0.0)),
    'rational': LensDistortion('rational_polynomial', (0.6, -0.1, 0.0004, -0.0003, 0.02, 0.95, 0.05, 0.01)),
    'fisheye': LensDistortion('equidistant', (-0.02, 0.004, -0.003, 0.0006)),
}
lenses = pytest.mark.parametrize('name', sorted(LENSES))


def opencv_pixels(lens, points):
    """(n, 2) pixels of (n, 3) points, as OpenCV projects them."""
    nowhere = np.zeros((3, 1))
    coefficients = np.array(lens.coefficients)
    if lens.model == 'equidistant':
        pixels, _ = cv2.fisheye.projectPoints(points[None], nowhere, nowhere, CAMERA.matrix, coefficients)
    else:
        pixels, _ = cv2.projectPoints(points, nowhere, nowhere, CAMERA.matrix, coefficients)
    return pixels.reshape(-1, 2)


@lenses
def test_points_are_seen_where_opencv_projects_them(name):
    random = np.random.default_rng(2)
    depth = random.uniform(0.2, 5.0, 2000)
    points = np.stack([random.uniform(-1.0, 1.0, 2000) * depth, random.uniform(-0.8, 0.8, 2000) * depth, depth], axis=1)
    assert np.abs(LENSES[name].project(CAMERA, points) - opencv_pixels(LENSES[name], points)).max() < 1e-6


@lenses
def test_the_ray_of_every_raw_pixel_comes_back_to_it(name):
    rays = LENSES[name].rays(CAMERA, CAMERA.pixel_grid()).reshape(-1, 3)
    seen = np.isfinite(rays).all(axis=1)
    assert seen.all(), 'these lenses fill the picture'
    assert np.abs(opencv_pixels(LENSES[name], rays) - CAMERA.pixel_grid().reshape(-1, 2)).max() < 1e-6


@given(
    st.sampled_from(sorted(LENSES)),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
    st.lists(st.floats(-0.05, 0.05), min_size=4, max_size=4),
)
def test_undistort_is_the_inverse_of_distort(name, x, y, changes):
    base = LENSES[name]
    first = [
        value + change * (0.01 if base.model != 'equidistant' and k in (2, 3) else 1.0)
        for k, (value, change) in enumerate(zip(base.coefficients, changes))
    ]
    lens = LensDistortion(base.model, (*first, *base.coefficients[4:]))
    if np.hypot(x, y) < 0.95 * lens.widest:
        assert np.abs(lens.undistort(lens.distort([x, y])) - [x, y]).max() < 1e-9


def test_what_folds_back_is_not_seen():
    # r (1 - r^2 / 3) is largest at r = 1, where it is 2 / 3.
    lens = LensDistortion('plumb_bob', (-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0))
    assert lens.widest == pytest.approx(1.0)
    assert np.isnan(lens.distort([1.001, 0.0])).all() and np.isfinite(lens.distort([0.999, 0.0])).all()
    assert np.isnan(lens.undistort([0.667, 0.0])).all() and lens.undistort([0.6666, 0.0])[0] == pytest.approx(
        0.99, abs=0.01
    )


def test_a_fisheye_shows_equal_angles_at_equal_distances_up_to_89_degrees():
    lens = LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0))
    angles = np.radians([0.0, 1.0, 30.0, 60.0, 88.0])
    seen = lens.undistort(np.stack([angles, np.zeros(5)], axis=1))
    assert np.allclose(np.arctan(seen[:, 0]), angles, atol=1e-12)
    assert np.isnan(lens.undistort([[np.radians(89.5), 0.0], [2.0, 2.0]])).all()


def test_behind_the_camera_nothing_is_seen():
    assert np.isnan(LENSES['barrel'].project(CAMERA, [[0.1, 0.1, -1.0]])).all()


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        (('fisheye', (0.0,) * 4), 'model'),
        (('plumb_bob', (0.0,) * 4), 'coefficients.*5'),
        (('equidistant', (0.0, np.nan, 0.0, 0.0)), 'coefficients'),
    ],
)
def test_misuse_names_the_field(arguments, name):
    with pytest.raises(ValueError, match=f'^{name}'):
        LensDistortion(*arguments)
