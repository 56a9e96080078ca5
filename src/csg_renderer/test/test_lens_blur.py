"""A lens that blurs light before pixels count it: edges of light at known places, held against their closed form."""

import numpy as np
import pytest
from scipy.special import ndtr

from csg_renderer import Light, Scene, Solid, Surface, Texture, load_scene, render, render_stereo
from csg_renderer.raycast.exposure import blurred_light, finer, moved_by
from csg_renderer.raycast.render import scene_rig
from csg_renderer.raycast.sensor import SensorModel, grey
from msgs_py import LensDistortion, PinholeCamera, Pose

CAMERA = PinholeCamera.centred(48, 40, 80.0)
WHITE = Surface((1, 1, 1), ambient=1.0, diffuse=0.0)


def half_plane(offset, angle=0.0):
    """White beyond a line through the picture: so many pixels from its middle, along a direction."""
    plate = Solid.block(4.0, 4.0, 1e-5).transformed(Pose(np.eye(3), [offset / CAMERA.fx, -2.0, 1.0]))
    turn = Pose.from_rotation_vector([0.0, 0.0, angle])
    return Scene(plate.transformed(turn).painted(WHITE), ambient_light=(1, 1, 1))


def expected(offset, psf):
    """Light of the pixels of a row: a step, blurred by the lens, and the mean over each pixel."""
    places = np.arange(CAMERA.width)[:, None] + (np.arange(64) + 0.5) / 64 - 0.5 - CAMERA.cx
    return ndtr((places - offset) / psf).mean(axis=1)


@pytest.mark.parametrize('psf', [0.2, 0.5, 1.3, 3.0])
@pytest.mark.parametrize('offset', [0.0, 0.17, 0.5, -3.31])
def test_an_upright_edge_has_the_shape_of_a_step_behind_a_lens(psf, offset):
    seen = render(half_plane(offset), CAMERA, psf=psf, antialias=6).image[:, :, 0] / 255.0
    # Rounded twice, to whole levels and to 1 / 36 of a finer pixel.
    assert np.abs(seen - expected(offset, psf)).max() < 1.0 / 255.0 + 0.2 / (36.0 * finer(psf) * psf)
    centroid = (1.0 - seen).sum(axis=1) - 0.5 - CAMERA.cx
    assert np.abs(centroid - offset).max() < 0.03


def test_blurring_pixels_is_another_thing():
    """What the sensor makes of pixels is a step of another shape, which is why light is blurred here."""
    seen = SensorModel(psf_sigma=0.5).picture(render(half_plane(0.2), CAMERA, antialias=16), monochrome=True)
    assert np.abs(seen[20] / 255.0 - expected(0.2, 0.5)).max() > 0.02


def test_a_picture_is_blurred_once():
    frame = render(half_plane(0.3), CAMERA, psf=0.8, antialias=4)
    assert frame.psf == 0.8
    assert np.array_equal(SensorModel(psf_sigma=0.8).picture(frame), frame.image)
    more = SensorModel(psf_sigma=1.0).picture(frame)
    assert np.array_equal(more, SensorModel(psf_sigma=0.6).apply(frame.image))


def test_what_is_true_is_that_of_the_sharp_picture():
    scene = load_scene('l_shape_v1')
    blurred, sharp = (render(scene, CAMERA, psf=psf, antialias=4) for psf in (0.7, 0.0))
    for name in ('depth', 'primitive_id', 'face_id', 'object_id', 'normal'):
        assert np.array_equal(getattr(blurred, name), getattr(sharp, name), equal_nan=name in ('depth', 'normal'))
    assert not np.array_equal(blurred.image, sharp.image)


@pytest.mark.parametrize('engine', ['reference', 'dap'])
def test_engines_agree(engine):
    camera = PinholeCamera.centred(24, 20, 40.0)
    scene = load_scene('l_shape_v1')
    native, other = (
        render(scene, camera, psf=1.0, antialias=2, every_pixel=True, engine=name).image.astype(int)
        for name in ('native', engine)
    )
    assert np.abs(native - other).max() <= 1


def test_strips_make_the_picture_of_the_whole(monkeypatch):
    scene = half_plane(0.4, 0.3)
    whole = render(scene, CAMERA, psf=0.6, antialias=4).image
    monkeypatch.setattr('csg_renderer.raycast.exposure.STRIP_SAMPLES', 20_000)
    assert np.abs(render(scene, CAMERA, psf=0.6, antialias=4).image.astype(int) - whole).max() <= 1


def test_light_goes_on_beyond_the_border():
    sizes = []

    def light(camera):
        sizes.append((camera.width, camera.height))
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        ramp = 0.5 + 0.002 * (u - camera.cx) / camera.fx * CAMERA.fx + 0.001 * (v - camera.cy) / camera.fy * CAMERA.fy
        return np.repeat(ramp[..., None], 3, axis=2)

    seen = blurred_light(CAMERA, 0.5, light)
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    ramp = 0.5 + 0.002 * (u - CAMERA.cx) + 0.001 * (v - CAMERA.cy)
    np.testing.assert_allclose(seen[..., 1], ramp, atol=1e-6)
    assert sizes == [(4 * 52, 4 * 44)]


def test_a_raw_picture_and_a_moving_one_are_blurred_too():
    scene = load_scene('l_shape_v1')
    lens = LensDistortion('plumb_bob', (-0.1, 0.02, 0.0, 0.0, 0.0))
    rig = scene_rig(scene, 48, 40)
    motion = moved_by(scene.camera_T_scene, [0.002, 0.0, 0.0], [0.0, 0.0, 1.0])
    for more in ({'lens': lens}, {'motion': motion, 'pinholes': 8}):
        light = [
            [grey(frame.radiance) for frame in render_stereo(scene, rig, psf=psf, antialias=4, radiance=True, **more)]
            for psf in (0.8, 0.0)
        ]
        for blurred, sharp in zip(*light):
            of_pixels = SensorModel(psf_sigma=0.8, bits=16).apply(255.0 * sharp) / 65535.0
            assert np.abs(blurred - sharp).max() > 2.0 * np.abs(blurred - of_pixels)[4:-4, 4:-4].max()
            assert blurred.mean() == pytest.approx(sharp.mean(), rel=0.02)


def test_scenes_with_print_share_out_their_samples():
    """Where all pixels take all samples, those of finer pixels are as many."""
    board = Solid.block(0.4, 0.4, 0.1).transformed(Pose(np.eye(3), [-0.2, -0.2, 1.0]))
    printed = board.painted(Surface((1, 1, 1))).textured(Texture([[0.0, 1.0], [1.0, 0.0]], 'planar', (0.1, 0.1)))
    plain, blurred = (
        render(Scene(printed, [Light((0, 0, 0))]), CAMERA, psf=psf, antialias=4).stats.intersections
        for psf in (0.0, 0.5)
    )
    assert blurred < 2.0 * plain


@pytest.mark.parametrize('psf', [-1.0, np.nan, np.inf])
def test_a_blur_that_is_none_is_refused(psf):
    with pytest.raises(ValueError, match=r'^psf: expected a length >= 0'):
        render(half_plane(0.0), CAMERA, psf=psf)
