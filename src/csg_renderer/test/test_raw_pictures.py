"""Raw pictures of lenses that distort, against OpenCV's lenses and closed forms."""

import json

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from csg_renderer import Light, Scene, Solid, Surface, load_scene, render, render_stereo
from csg_renderer.raycast.raw_view import sampling_camera
from csg_renderer.raycast.render import scene_rig
from csg_renderer.render_cli import main
from msgs_py import LensDistortion, PinholeCamera, Pose

CAMERA = PinholeCamera(96, 80, 70.0, 71.0, 48.5, 38.25)
BARREL = LensDistortion('plumb_bob', (-0.3, 0.08, 0.001, -0.001, 0.0))
LENSES = {
    'barrel': BARREL,
    'rational': LensDistortion('rational_polynomial', (0.6, -0.1, 0.0004, -0.0003, 0.02, 0.95, 0.05, 0.01)),
    'fisheye': LensDistortion('equidistant', (-0.02, 0.004, -0.003, 0.0006)),
}
NONE = LensDistortion('plumb_bob', (0.0,) * 5)
lenses = pytest.mark.parametrize('name', sorted(LENSES))


def opencv_pixels(lens, points, camera=CAMERA):
    """(n, 2) pixels of (n, 3) points, as OpenCV projects them."""
    fisheye = lens.model == 'equidistant'
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    still = np.zeros((3, 1))
    pixels, _ = project(points[None] if fisheye else points, still, still, camera.matrix, np.array(lens.coefficients))
    return pixels.reshape(-1, 2)


def tilted_wall():
    """A plane n . p = 1 that fills the picture, and n."""
    pose = Pose.from_rotation_vector([0.3, -0.25, 0.0], [0.0, 0.0, 1.0])
    wall = Solid.block(40.0, 40.0, 0.1).transformed(Pose(np.eye(3), [-20.0, -20.0, 0.0])).transformed(pose)
    normal = pose.rotation[:, 2]
    return Scene(wall, [Light((0, 0, -1))]), normal / (normal @ pose.translation)


@lenses
@pytest.mark.parametrize('engine', ['native', 'reference'])
def test_depth_is_that_of_the_ray_through_the_raw_pixel(name, engine):
    scene, normal = tilted_wall()
    frame = render(scene, CAMERA, engine=engine, lens=LENSES[name])
    assert frame.mask.all() and np.abs(frame.points @ normal - 1.0).max() < 1e-6
    pixels = opencv_pixels(LENSES[name], frame.points.reshape(-1, 3))
    assert np.abs(pixels - CAMERA.pixel_grid().reshape(-1, 2)).max() < 1e-6


@lenses
@pytest.mark.parametrize('antialias', [0, 1, 2])
def test_both_engines_give_one_picture(name, antialias):
    scene = load_scene('l_shape_v1')
    options = {'antialias': antialias, 'radiance': True, 'shadows': True}
    native, reference = (
        render(scene, CAMERA, engine=engine, lens=LENSES[name], **options) for engine in ('native', 'reference')
    )
    for field in ('image', 'primitive_id', 'face_id', 'object_id', 'depth', 'normal'):
        assert np.array_equal(getattr(native, field), getattr(reference, field), equal_nan=True), field
    # A mean of nine is added up in another order.
    assert np.abs(native.radiance - reference.radiance).max() < 1e-6
    assert 0.02 < native.mask.mean() < 0.98


def test_a_lens_that_does_nothing_changes_nothing():
    scene = load_scene('l_shape_v1')
    for antialias in (0, 1):
        raw, plain = (render(scene, CAMERA, lens=lens, antialias=antialias) for lens in (NONE, None))
        assert np.array_equal(raw.image, plain.image) and np.array_equal(raw.depth, plain.depth, equal_nan=True)
    truth, raw, plain = (
        render(scene, CAMERA, lens=lens, antialias=n, radiance=True).radiance
        for lens, n in ((None, 16), (NONE, 4), (None, 4))
    )
    # Its samples lie on a grid, which is not as good as one in each of all rows and columns.
    assert np.std(raw - truth) < 1.8 * np.std(plain - truth) and abs(np.mean(raw - truth)) < 1e-4


def edge_scene(slope):
    """A bright half plane at z = 1 whose edge leans by ``slope``, and two points of the edge."""
    turn = Pose.from_rotation_vector([0.0, 0.0, np.arctan(slope)], [0.25, 0.1, 1.0])
    plate = Solid.block(10.0, 10.0, 1e-6).transformed(Pose(np.eye(3), [0.0, -5.0, 0.0])).transformed(turn)
    glow = Surface((1.0, 1.0, 1.0), ambient=1.0, diffuse=0.0)
    ends = turn.apply(np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]))
    return Scene([plate.painted(glow)], [], (1.0, 1.0, 1.0)), ends


def crossings(image):
    """Columns at which each row becomes bright, to a fraction of a pixel: what is dark has this area."""
    return image.shape[1] - 0.5 - image.sum(axis=1)


@lenses
def test_an_edge_is_where_opencv_projects_it(name):
    camera, lens = PinholeCamera(120, 100, 90.0, 90.0, 59.0, 48.0), LENSES[name]
    scene, ends = edge_scene(0.2173)
    seen = crossings(render(scene, camera, lens=lens, antialias=6, radiance=True).radiance[..., 0].astype(float))
    along = np.linspace(-0.2, 1.2, 4001)[:, None]
    points = ends[0] + along * (ends[1] - ends[0])
    u, v = opencv_pixels(lens, points, camera).T
    expected = np.interp(np.arange(100), v, u)
    inside = slice(2, 98)
    assert np.ptp(expected - np.polyval(np.polyfit(np.arange(100), expected, 1), np.arange(100))) > 0.5, 'it is bent'
    error = seen[inside] - expected[inside]
    assert np.abs(error).max() < 0.1 and abs(error.mean()) < 0.004 and error.std() < 0.03


@lenses
def test_a_straight_edge_is_straight_in_the_undistorted_picture(name):
    camera, lens = PinholeCamera(120, 100, 90.0, 90.0, 59.0, 48.0), LENSES[name]
    scene, ends = edge_scene(0.2173)
    raw = render(scene, camera, lens=lens, antialias=6, radiance=True).radiance[..., 0]
    size, k, d = (camera.width, camera.height), camera.matrix, np.array(lens.coefficients)
    make = cv2.fisheye.initUndistortRectifyMap if lens.model == 'equidistant' else cv2.initUndistortRectifyMap
    maps = make(k, d, np.eye(3), k, size, cv2.CV_32FC1)
    # cv2.remap of older versions knows 32 places between pixels, this knows all.
    image = map_coordinates(raw.astype(float), maps[::-1], order=3, mode='nearest')
    rows = np.arange(10, 90)
    (u0, v0), (u1, v1) = camera.project(ends)
    error = crossings(image)[rows] - (u0 + (rows - v0) * (u1 - u0) / (v1 - v0))
    assert np.abs(error).max() < 0.15 and abs(error.mean()) < 0.01 and error.std() < 0.04


def test_what_no_light_reaches_is_black():
    scene = Scene([], [], background=(0.5, 0.5, 0.5))
    lens = LensDistortion('equidistant', (0.0, 0.0, 0.0, 0.0))
    camera = PinholeCamera.centred(64, 64, 16.0)  # 90 degrees lie 25 pixels from the middle
    assert sampling_camera(camera, lens, 2) is None, 'its rays are single ones'
    for antialias in (0, 2):
        frame = render(scene, camera, lens=lens, antialias=antialias)
        radius = np.hypot(*(np.mgrid[0:64, 0:64] - 31.5))
        assert (frame.image[radius < 24.0] == 128).all() and (frame.image[radius > 25.2] == 0).all()
        assert not frame.mask.any()


def test_a_pair_has_a_lens_or_two(tmp_path):
    scene = load_scene('l_shape_v1')
    rig = scene_rig(scene, 64, 48)
    pair = render_stereo(scene, rig, lens=(BARREL, LENSES['fisheye']), antialias=2)
    left = render(scene, rig.left, lens=BARREL, antialias=2)
    assert np.array_equal(pair[0].image, left.image) and pair[1].lens == LENSES['fisheye']
    assert render_stereo(scene, rig, lens=BARREL)[1].lens == BARREL
    with pytest.raises(ValueError, match="lens: the engine 'dap' has none"):
        render(scene, rig.left, lens=BARREL, engine='dap')


def test_the_command_writes_raw_pictures_and_their_lens(tmp_path, capsys):
    out = tmp_path / 'raw.png'
    text = 'plumb_bob:' + ','.join(map(str, BARREL.coefficients))
    options = ['l_shape_v1', '-q', '--size', '64', '--camera', '--antialias', '2', '-o', str(out)]
    assert main([*options, '--distortion', text]) == 0
    scene = load_scene('l_shape_v1')
    expected = render(scene, scene_rig(scene, 64).left, lens=BARREL, antialias=2)
    assert np.array_equal(cv2.imread(str(out))[..., ::-1], expected.image)
    record = json.loads(out.with_suffix('.json').read_text())
    assert record['distortion_model'] == 'plumb_bob' and record['D'] == list(BARREL.coefficients)
    for wrong in ('barrel:1,2', 'plumb_bob:1,2', 'plumb_bob'):
        with pytest.raises(SystemExit):
            main([*options, '--distortion', wrong])
        assert 'MODEL:K1' in capsys.readouterr().err
