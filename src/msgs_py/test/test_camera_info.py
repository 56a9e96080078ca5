"""camera_info, field by field: binning, region of interest, skew, P[1,3], unequal focal lengths work or are refused."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msgs_py import CameraRig, StereoRig
from msgs_py.camera import ImageWindow, projection_of


def roi(x=0, y=0, width=0, height=0):
    return SimpleNamespace(x_offset=x, y_offset=y, width=width, height=height, do_rectify=False)


def infos(fx=700.0, fy=650.0, window=None, binning=(0, 0), right_window=None, **changes):
    """Two messages of a camera of 640 x 480; changes : (side, row, column) -> value of P, by 'p01' of the right one."""
    made = []
    for side, offset in (('left', 0.0), ('right', -fx * 0.1)):
        p = np.array([[fx, 0, 310.0, offset], [0, fy, 230.0, 0], [0, 0, 1, 0]])
        if side == 'right':
            for name, value in changes.items():
                p[int(name[1]), int(name[2])] = value
        made.append(
            SimpleNamespace(
                width=640,
                height=480,
                p=p.ravel().tolist(),
                binning_x=binning[0],
                binning_y=binning[1],
                roi=(right_window if side == 'right' and right_window else window) or roi(),
            )
        )
    return made


@given(
    st.integers(1, 8),
    st.integers(1, 8),
    st.integers(0, 300),
    st.integers(0, 200),
    st.floats(-0.2, 0.2),
    st.floats(-0.2, 0.2),
    st.floats(0.5, 5.0),
)
def test_a_point_is_seen_in_the_pixel_that_holds_the_cameras_pixel(bx, by, x, y, across, down, z):
    """Pixel k of a binned image is pixels x + k b to x + k b + b - 1 of the camera."""
    point = np.array([across * z, down * z, z])
    whole = StereoRig.from_camera_info(*infos())
    part = StereoRig.from_camera_info(*infos(window=roi(x, y, 640 - x, 480 - y), binning=(bx, by)))
    assert (part.left.width, part.left.height) == ((640 - x) // bx, (480 - y) // by)
    for full, seen in zip(whole.project(point), part.project(point)):
        # Edges of pixels: half a pixel before a centre.
        np.testing.assert_allclose((seen + 0.5) * [bx, by] + [x, y], full + 0.5, atol=1e-9)
    assert part.baseline == pytest.approx(whole.baseline)
    np.testing.assert_allclose(part.triangulate(part.project(point)[0], part.project(point)[1][0]), point, atol=1e-9)


def test_a_camera_of_one_pixel_is_one_and_of_none_is_refused():
    left, right = infos()
    for info in (left, right):
        info.width = info.height = 1
    assert StereoRig.from_camera_info(left, right).left.width == 1
    for name in ('width', 'height'):
        left, right = infos()
        setattr(left, name, 0)
        with pytest.raises(ValueError, match='left camera_info: size .* expected at least one pixel'):
            StereoRig.from_camera_info(left, right)


def test_zeros_mean_all_of_the_camera_and_no_binning():
    assert StereoRig.from_camera_info(*infos()) == StereoRig.from_camera_info(*infos(binning=(1, 1)))
    assert StereoRig.from_camera_info(*infos()) == StereoRig.from_camera_info(*infos(window=roi(0, 0, 640, 480)))
    bare = [SimpleNamespace(width=one.width, height=one.height, p=one.p) for one in infos()]
    assert StereoRig.from_camera_info(*bare) == StereoRig.from_camera_info(*infos())


def test_columns_may_differ_between_the_eyes_as_principal_points_may():
    rig = StereoRig.from_camera_info(*infos(window=roi(0, 40, 400, 400), right_window=roi(60, 40, 400, 400)))
    assert rig.left.cx == 310.0 and rig.right.cx == 250.0
    np.testing.assert_allclose(
        rig.triangulate(*(lambda a, b: (a, b[0]))(*rig.project([0.1, 0.2, 2.0]))), [0.1, 0.2, 2.0]
    )


@pytest.mark.parametrize(
    ('given', 'told'),
    [
        ({'p01': 2.0}, r'right camera_info: P\[0,1\] \(skew\) is 2, expected 0'),
        ({'p13': 5.0}, r'right camera_info: P\[1,3\] is 5, expected 0: the cameras of a pair stand side by side'),
        ({'p10': 1.0}, r'right camera_info: P\[1,0\] is 1, expected 0'),
        ({'p20': 1.0}, r'right camera_info: P\[2,0\] is 1, expected 0'),
        ({'p21': 1.0}, r'right camera_info: P\[2,1\] is 1, expected 0'),
        ({'p22': 2.0}, r'right camera_info: P\[2,2\] is 2, expected 1'),
        ({'p23': 1.0}, r'right camera_info: P\[2,3\] is 1, expected 0'),
        ({'p00': 701.0}, r'fx: left camera has 700.0 and right 701.0; they are equal in a rectified pair'),
        ({'p11': 651.0}, r'fy: left camera has 650.0 and right 651.0; they are equal in a rectified pair'),
        (
            {'window': roi(600, 0, 100, 100)},
            r'left camera_info: roi is 100 x 100 pixels at \(600, 0\), expected a part',
        ),
        ({'window': roi(0, 0, 100, 0)}, r'left camera_info: roi is 100 x 0 pixels'),
        ({'window': roi(5, 0, 0, 0)}, r'left camera_info: roi is 0 x 0 pixels at \(5, 0\)'),
        ({'window': roi(0, 0, 2**32 - 1, 2**32 - 1)}, r'left camera_info: roi is 4294967295 x'),
        ({'binning': (641, 1)}, r'left camera_info: binning_x, binning_y are 641, 1, expected no more'),
        (
            {'window': roi(0, 0, 640, 400), 'right_window': roi(0, 10, 640, 400)},
            r'camera_info: roi.y_offset: left has 0 and right 10, expected the same',
        ),
        (
            {'window': roi(0, 0, 640, 400), 'right_window': roi(0, 0, 640, 300)},
            'height: left image has 400 pixels and right 300',
        ),
    ],
)
def test_what_cannot_be_is_refused_by_topic_and_field(given, told):
    with pytest.raises(ValueError, match=told):
        StereoRig.from_camera_info(*infos(**given))


def test_binning_of_one_eye_is_named():
    left, right = infos()
    right.binning_x = 2
    with pytest.raises(ValueError, match='binning_x: left has 1 and right 2'):
        StereoRig.from_camera_info(left, right)


def test_several_cameras_may_stand_above_each_other_and_have_windows():
    left, right = infos(p03=0.0, p13=-65.0, window=roi(20, 10, 600, 400), binning=(2, 2))
    rig = CameraRig.from_camera_info([left, right])
    np.testing.assert_allclose(rig.poses[1].translation, [0.0, 0.1, 0.0])
    assert (rig.cameras[1].width, rig.cameras[1].height, rig.cameras[1].fy) == (300, 200, 325.0)
    np.testing.assert_allclose(projection_of('camera_1', right)[:, 3], [0.0, -32.5, 0.0])


def test_a_window_says_what_it_is():
    left, _ = infos(window=roi(20, 10, 600, 400), binning=(2, 4))
    assert str(ImageWindow.of('left', left)) == '300 x 100 (roi at (20, 10), binning 2 x 4)'
