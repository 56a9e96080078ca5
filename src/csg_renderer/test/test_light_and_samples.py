"""Shadows, mirrors, glass, anti-aliasing and the sensor, each against what can be said without rendering."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, render
from csg_renderer.raycast.raw_view import box_samples
from csg_renderer.raycast.sensor import SensorModel, grey
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(64, 64, 80.0)
ENGINES = ['native', 'reference', 'dap']
MATT = Surface((0.8, 0.8, 0.8), ambient=0.5, diffuse=0.5)
GLOW = Surface((0.8, 0.6, 0.4), ambient=1.0, diffuse=0.0)


def moved(solid, x, y, z):
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def wall(z, surface, size=2.0):
    return moved(Solid.block(size, size, 0.1), -size / 2, -size / 2, z).painted(surface)


# -- shadows --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('transparency', [0.0, 0.25, 1.0])
def test_a_plate_between_light_and_wall_takes_its_share_of_the_light(engine, transparency):
    # The light and the plate are beside the camera's view; the plate's shadow is a square about the wall's centre.
    light = Light((0.0, -2.0, -1.0))
    plate = moved(Solid.block(0.1, 0.1, 0.001), -0.05, -1.05, 0.0).painted(Surface(transparency=transparency))
    scene = Scene([wall(1.0, MATT), plate], [light], ambient_light=(0.2, 0.2, 0.2))
    lit, shaded = (render(scene, CAMERA, engine=engine, shadows=shadows) for shadows in (False, True))
    rays = CAMERA.rays(CAMERA.pixel_grid())
    # Where the feeler from a wall point to the light crosses the plane z = 0 of the plate: half way.
    x, y = rays[..., 0] / 2, (rays[..., 1] - 2.0) / 2
    shadow = (np.abs(x) < 0.0495) & (np.abs(y + 1.0) < 0.0495)
    clear = (np.abs(x) > 0.0505) | (np.abs(y + 1.0) > 0.0505)
    assert shadow.sum() > 100 and clear.sum() > 2000
    ambient = 0.5 * 0.8 * 0.2 * 255
    expected = ambient + transparency * (lit.image.astype(float) - ambient)
    assert np.abs(shaded.image - expected)[shadow].max() <= 1.0
    assert np.array_equal(shaded.image[clear], lit.image[clear])
    assert np.array_equal(shaded.depth, lit.depth, equal_nan=True)


@pytest.mark.parametrize('engine', ENGINES)
def test_convex_solids_cast_no_shadow_on_their_own_lit_side(engine):
    for solid in (
        Solid.sphere(0.1),
        Solid.cone(0.1, (0.02, 0.15, 0.05)),
        Solid.cylinder(0.08, (0.1, 0.1, 0.1)),
        Solid.block(0.1, 0.1, 0.1),
    ):
        turned = solid.painted(MATT).transformed(Pose.from_rotation_vector([0.5, 0.4, 0.3], [0, 0, 0.5]))
        scene = Scene(turned, [Light((0.3, -0.4, 0.0))])
        a, b = (render(scene, CAMERA, engine=engine, shadows=shadows) for shadows in (False, True))
        assert np.array_equal(a.image, b.image)


# -- mirrors and glass ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
def test_a_perfect_mirror_shows_the_mirrored_scene(engine):
    mirror = Surface((0, 0, 0), ambient=0.0, diffuse=0.0, reflection=1.0)
    # Behind the camera, seen only in the mirror at z = 1; its mirror image is at z = 1 + (1 + 0.5).
    ball = moved(Solid.sphere(0.3), 0.2, 0.1, -0.5).painted(GLOW)
    image = moved(Solid.sphere(0.3), 0.2, 0.1, 2.5).painted(GLOW)
    seen = render(Scene([wall(1.0, mirror, 4.0), ball], background=(0.1, 0.2, 0.3)), CAMERA, levels=2, engine=engine)
    direct = render(Scene(image, background=(0.1, 0.2, 0.3)), CAMERA, engine=engine)
    assert (seen.image != direct.image).any(axis=2).sum() <= 4
    cast = render(Scene([wall(1.0, mirror, 4.0), ball]), CAMERA, levels=1, engine=engine)
    assert (cast.image == 0).all()


@pytest.mark.parametrize('engine', ENGINES)
def test_glass_mixes_what_is_behind_by_its_transparency(engine):
    glass = Surface((1.0, 1.0, 1.0), ambient=1.0, diffuse=0.0, transparency=0.75)
    scene = Scene([wall(1.0, GLOW), wall(0.5, glass, 0.2)], ambient_light=(0.4, 0.4, 0.4))
    frame = render(scene, CAMERA, levels=2, engine=engine)
    behind = 0.4 * np.array(GLOW.colour)
    pane = frame.primitive_id == 1
    assert np.abs(frame.image[pane] - 255 * (0.25 * 0.4 + 0.75 * behind)).max() <= 0.51
    assert np.abs(frame.image[~pane] - 255 * behind).max() <= 0.51
    # The last level counts as opaque, and panes multiply.
    assert np.abs(render(scene, CAMERA, levels=1, engine=engine).image[pane] - 255 * 0.4).max() <= 0.51
    panes = [wall(0.5 + 0.01 * k, glass, 0.2).transformed(np.diag([1, 1, 0.01, 1.0])) for k in range(4)]
    panes = [moved(pane, 0, 0, 0.4) for pane in panes]
    stacked = render(Scene([wall(1.0, GLOW), *panes], ambient_light=(0.4, 0.4, 0.4)), CAMERA, levels=9, engine=engine)
    left = 0.75**4
    assert np.abs(stacked.image[32, 32] - 255 * ((1 - left) * 0.4 + left * behind)).max() <= 0.6


@pytest.mark.parametrize('engine', ENGINES)
def test_two_mirrors_stop_at_the_level_asked_for(engine):
    mirror = Surface((0.5, 0.5, 0.5), ambient=1.0, diffuse=0.0, reflection=0.5)
    scene = Scene(
        [wall(1.0, mirror, 8.0), moved(Solid.block(8, 8, 0.1), -4, -4, -1.1).painted(mirror)], ambient_light=(1, 1, 1)
    )
    for levels in (1, 2, 3, 6):
        frame = render(scene, CAMERA, levels=levels, engine=engine)
        expected = 0.5 * sum(0.5**k for k in range(levels))
        assert np.abs(frame.image[32, 32] - 255 * min(expected, 1)).max() <= 0.51


# -- anti-aliasing ----------------------------------------------------------------------------------------------------


def edge_scene():
    tilted = Solid.block(1, 1, 1).transformed(Pose.from_rotation_vector([0, 0, 0.3], [0.01, -0.3, 1.0]))
    return Scene(tilted.painted(Surface((1, 1, 1), ambient=1.0, diffuse=0.0)), ambient_light=(1, 1, 1))


@pytest.mark.parametrize('engine', ENGINES)
def test_box_mode_is_the_mean_of_rays_in_rows_and_columns_of_their_own(engine):
    n = 3
    frame = render(edge_scene(), CAMERA, antialias=n, engine=engine)
    fine = PinholeCamera.centred(64 * n * n, 64 * n * n, 80.0 * n * n)
    rays = render(edge_scene(), fine, engine=engine).image.astype(float)
    right, below = np.floor(n * n * (box_samples(n)[:, :2].T + 0.5)).astype(int)
    mean = rays.reshape(64, n * n, 64, n * n, 3)[:, below, :, right].mean(axis=0)
    assert np.abs(frame.image - mean).max() <= 0.51
    assert len(np.unique(frame.image)) > 5
    plain = render(edge_scene(), CAMERA, engine=engine)
    for name in ('depth', 'primitive_id', 'face_id', 'normal'):
        assert np.array_equal(getattr(frame, name), getattr(plain, name), equal_nan=name in ('depth', 'normal'))


@pytest.mark.parametrize('engine', ENGINES)
def test_adaptive_mode_weighs_nine_samples_at_boundaries_only(engine):
    plain, smooth = (render(edge_scene(), CAMERA, antialias=mode, engine=engine) for mode in (False, True))
    ids = np.pad(plain.primitive_id, 1, mode='edge')
    boundary = np.zeros((64, 64), bool)
    for dv in range(3):
        for du in range(3):
            boundary |= ids[dv : dv + 64, du : du + 64] != plain.primitive_id
    faces = np.pad(plain.face_id, 1, mode='edge')
    for dv in range(3):
        for du in range(3):
            boundary |= faces[dv : dv + 64, du : du + 64] != plain.face_id
    assert np.array_equal(smooth.image[~boundary], plain.image[~boundary])
    sixteenths = np.unique(np.rint(smooth.image[boundary] / 255 * 16 * 1000) / 1000)
    assert np.abs(sixteenths - np.rint(sixteenths)).max() < 0.04 and len(sixteenths) > 4
    third = PinholeCamera.centred(64 * 3, 64 * 3, 240.0)
    samples = render(edge_scene(), third, engine=engine).image.astype(float).reshape(64, 3, 64, 3, 3)
    crow = np.outer([1, 2, 1], [1, 2, 1]) / 16
    assert np.abs(np.einsum('aibjc,ij->abc', samples, crow) - smooth.image)[boundary].max() <= 0.51


@pytest.mark.parametrize('antialias', [True, 3])
def test_anti_aliasing_works_with_levels_and_shadows_and_engines_agree(antialias):
    scene = Scene(
        [
            wall(1.0, Surface(reflection=0.3, specular=0.4)),
            moved(Solid.sphere(0.1), 0, 0, 0.6).painted(Surface((0.9, 0.2, 0.1), transparency=0.3)),
        ],
        [Light((0.5, -0.5, 0.0))],
    )
    one_tile = PinholeCamera.centred(32, 32, 40.0)
    a, *others = (
        render(scene, one_tile, antialias=antialias, levels=3, shadows=True, engine=engine) for engine in ENGINES
    )
    for other in others:
        assert np.abs(a.image.astype(int) - other.image).max() <= 1


# -- the sensor -------------------------------------------------------------------------------------------------------


def test_sensor_without_faults_only_rounds():
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    assert np.array_equal(SensorModel().apply(image), image)
    assert np.array_equal(SensorModel().apply(np.array([[-3.0, 1.4, 300.0]])), [[0, 1, 255]])


def test_sensor_blur_is_gaussian_and_keeps_the_mean():
    spot = np.zeros((41, 41))
    spot[20, 20] = 25500.0
    blurred = SensorModel(psf_sigma=2.0).apply(spot).astype(float)
    v, u = np.mgrid[-20:21, -20:21]
    expected = 25500.0 / (2 * np.pi * 4.0) * np.exp(-(u * u + v * v) / 8.0)
    assert np.abs(blurred - np.minimum(expected, 255)).max() < 4.0
    flat = np.full((30, 30), 77, np.uint8)
    assert np.array_equal(SensorModel(psf_sigma=1.5).apply(flat), flat)


def test_sensor_noise_has_its_deviation_and_its_seed():
    flat = np.full((200, 200), 128, np.uint8)
    noisy = SensorModel(noise_sigma=3.0, seed=4).apply(flat).astype(float)
    assert noisy.std() == pytest.approx(3.0, abs=0.1) and noisy.mean() == pytest.approx(128.0, abs=0.1)
    assert np.array_equal(noisy, SensorModel(noise_sigma=3.0, seed=4).apply(flat))
    assert not np.array_equal(noisy, SensorModel(noise_sigma=3.0, seed=(4, 1)).apply(flat))


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [({'psf_sigma': -1}, 'psf_sigma'), ({'noise_sigma': np.nan}, 'noise_sigma'), ({'seed': -2}, 'seed')],
)
def test_sensor_misuse_names_the_field(arguments, name):
    with pytest.raises(ValueError, match=name):
        SensorModel(**arguments)


def test_grey_is_luma():
    assert np.allclose(
        grey(np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]]], np.uint8)), [[76.245, 149.685, 29.07, 9]]
    )
