"""Height grids: closed forms, every cell tried on every ray, light, files, misuse."""

import cv2
import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, Terrain, render
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(60, 48, 70.0)
ENGINES = ['native', 'reference', 'dap']
# The terrain's z (up) is the camera's -z: seen from straight above, its origin 1 m away and 0.5 m to the upper left.
ABOVE = np.array([[1, 0, 0, -0.5], [0, 1, 0, -0.5], [0, 0, -1, 1.0], [0, 0, 0, 1.0]])


def heights_below(terrain, x, y):
    """Heights at (x, y), terrain frame, from the definition of the interpolation."""
    gx, gy = x / terrain.spacing[0], y / terrain.spacing[1]
    rows, columns = terrain.heights.shape
    i = np.clip(np.floor(gx).astype(int), 0, columns - 2)
    j = np.clip(np.floor(gy).astype(int), 0, rows - 2)
    fx, fy = gx - i, gy - j
    h = terrain.heights
    a, b, c, d = h[j, i], h[j, i + 1], h[j + 1, i], h[j + 1, i + 1]
    if terrain.bilinear:
        return a * (1 - fx) * (1 - fy) + b * fx * (1 - fy) + c * (1 - fx) * fy + d * fx * fy
    return np.where(fx + fy <= 1, a + (b - a) * fx + (c - a) * fy, d + (c - d) * (1 - fx) + (b - d) * (1 - fy))


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_flat_and_sloping_ground_are_planes(engine, interpolation):
    x = np.arange(6) * 0.2
    for slope in (0.0, 0.3):
        terrain = Terrain(np.tile(slope * x, (5, 1)), (0.2, 0.25), interpolation).transformed(ABOVE)
        frame = render(Scene(terrain), CAMERA, engine=engine)
        rays = CAMERA.rays(CAMERA.pixel_grid())
        depth = (1.0 + slope * -0.5) / (1.0 + slope * rays[..., 0])  # z = 1 - slope (x + 0.5)
        place = rays * depth[..., None]
        assert np.array_equal(frame.mask, (np.abs(place[..., :2]) <= 0.5).all(axis=-1))
        assert np.abs(frame.depth - depth)[frame.mask].max() < 1e-6
        expected = np.array([-slope, 0, -1.0]) / np.hypot(1, slope)
        assert np.abs(frame.normal[frame.mask] - expected).max() < 1e-6


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_visible_points_lie_on_rugged_ground_and_nothing_hides_them(engine, interpolation):
    heights = 0.15 * np.random.default_rng(3).normal(size=(7, 9))
    terrain = Terrain(heights, (0.125, 1 / 6), interpolation)
    turn = Pose.from_rotation_vector([0.9, 0.2, 0.1], [0.0, 0.1, 1.2]).matrix @ np.array(
        [[1, 0, 0, -0.5], [0, 1, 0, -0.5], [0, 0, -1, 0.0], [0, 0, 0, 1.0]]
    )
    frame = render(Scene(terrain.transformed(turn)), CAMERA, engine=engine)
    assert frame.mask.sum() > 500
    inverse = np.linalg.inv(turn)
    local = frame.points[frame.mask] @ inverse[:3, :3].T + inverse[:3, 3]
    assert np.abs(local[:, 2] - heights_below(terrain, local[:, 0], local[:, 1])).max() < 1e-6
    # March along the rays: above ground stays above (or below below) until the visible point.
    camera = inverse[:3, 3]
    for point in local[::23]:
        t = np.linspace(0.0, 1.0 - 1e-3, 400)[:, None]
        path = camera + t * (point - camera)
        over = (path[:, :2] >= 0).all(axis=1) & (path[:, :2] <= 1.0).all(axis=1)
        sign = np.sign(path[over, 2] - heights_below(terrain, path[over, 0], path[over, 1]))
        assert len(np.unique(sign)) <= 1


@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
@pytest.mark.parametrize('options', [{}, {'levels': 3, 'shadows': True}, {'antialias': True}, {'tiling': False}])
def test_engines_agree_on_ground_with_solids(interpolation, options):
    heights = cv2.GaussianBlur(np.random.default_rng(1).normal(size=(12, 14)), (0, 0), 1.5) * 0.2
    ground = Terrain(heights, (0.08, 0.08), interpolation, surface=Surface((0.4, 0.7, 0.3), reflection=0.2))
    tilt = Pose.from_rotation_vector([0.6, 0.0, 0.2], [0.0, 0.2, 1.1])
    ball = Solid.sphere(0.12).transformed(Pose(np.eye(3), [0.05, 0.0, 0.9]))
    ground = ground.transformed(ABOVE).transformed(Pose(tilt.rotation, [0, 0.5, 0.4]))
    bitten = ball - ball.transformed(Pose(np.eye(3), [0.1, 0, 0]))
    scene = Scene([ground, bitten], [Light((0.6, -0.8, 0))])
    one_tile = PinholeCamera.centred(32, 26, 37.0)
    native, *others = (render(scene, one_tile, engine=engine, **options) for engine in ENGINES)
    assert {0, 1} <= set(np.unique(native.primitive_id))
    for other in others:
        for name in ('primitive_id', 'face_id', 'object_id'):
            assert np.array_equal(getattr(native, name), getattr(other, name))
        assert np.allclose(native.depth, other.depth, atol=1e-6, equal_nan=True)
        assert np.allclose(native.normal, other.normal, atol=1e-5, equal_nan=True)
        assert np.abs(native.image.astype(int) - other.image).max() <= 1


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_cells_without_a_height_are_open(engine, interpolation):
    heights = np.zeros((5, 5))
    heights[2, 3] = np.nan  # the corner of four cells
    terrain = Terrain(heights, (0.25, 0.25), interpolation).transformed(ABOVE)
    frame = render(Scene(terrain), CAMERA, engine=engine)
    x, y = np.moveaxis(CAMERA.rays(CAMERA.pixel_grid())[..., :2] + 0.5, -1, 0)  # at depth 1, from the corner
    there = (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1) & ~((x > 0.5) & (x < 1.0) & (y > 0.25) & (y < 0.75))
    assert 500 < there.sum() < x.size and np.array_equal(frame.mask, there)


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('options', [{}, {'shadows': True}], ids=str)
def test_colours_by_height(engine, options):
    tints = [[0.1, 1.0, 0.0, 0.0], [0.3, 0.0, 1.0, 0.0], [0.7, 0.0, 1.0, 1.0]]
    surface = Surface(ambient=1.0, diffuse=0.0)
    slope = Terrain(np.tile(np.linspace(0.0, 0.8, 9), (2, 1)), (0.125, 1.0), surface=surface, tints=tints)
    frame = render(Scene(slope.transformed(ABOVE), ambient_light=(1, 1, 1)), CAMERA, engine=engine, **options)
    height = 1.0 - frame.depth[frame.mask]
    red, green, blue = (np.interp(height, [0.1, 0.3, 0.7], channel) for channel in ((1, 0, 0), (0, 1, 1), (0, 0, 1)))
    assert np.abs(frame.image[frame.mask] - 255.0 * np.stack([red, green, blue], axis=1)).max() <= 0.51
    plain = render(Scene(slope.painted(surface).transformed(ABOVE)), CAMERA, engine=engine)
    assert len(np.unique(plain.image[plain.mask], axis=0)) == 1


@pytest.mark.parametrize('engine', ENGINES)
def test_a_sheet_united_with_a_solid_keeps_its_place_among_the_primitives(engine):
    ball = Solid.sphere(0.2).transformed(Pose(np.eye(3), [0.0, 0.0, 0.8]))
    sheet = Terrain(np.zeros((3, 3)), (0.5, 0.5)).transformed(ABOVE)
    scene = Scene([ball, ball.transformed(Pose(np.eye(3), [0.4, 0, 0])) | sheet | Solid.block(0.1, 0.1, 0.7)])
    assert [leaf.kind for leaf in scene.primitives] == ['SPHERE', 'SPHERE', 'TERRAIN', 'BLOCK']
    frame = render(scene, CAMERA, engine=engine)
    assert set(np.unique(frame.primitive_id)) == {0, 1, 2, 3}
    assert (frame.object_id[frame.primitive_id >= 1] == 1).all()


@pytest.mark.parametrize('engine', ENGINES)
def test_a_ridge_throws_a_shadow(engine):
    heights = np.zeros((3, 11))
    heights[:, 5] = 0.3
    terrain = Terrain(heights, (0.1, 0.5)).transformed(ABOVE).painted(Surface(ambient=0.0, diffuse=1.0))
    light = Light((-5.0, 0.0, 0.2))  # low over the left: the sun stands at atan(0.8 / 5)
    lit, shaded = (render(Scene(terrain, [light]), CAMERA, shadows=shadows, engine=engine) for shadows in (False, True))
    x = frame_x = lit.points[..., 0]
    behind = (x > 0.11) & (x < 0.45)
    assert behind.sum() > 200 and (shaded.image[behind] == 0).all() and (lit.image[behind] > 0).all()
    before = frame_x < -0.11
    assert np.array_equal(shaded.image[before], lit.image[before])


def test_heights_from_files(tmp_path):
    heights = np.linspace(0.0, 2.0, 12).reshape(3, 4)
    np.save(tmp_path / 'ground.npy', heights)
    assert np.array_equal(Terrain.load(tmp_path / 'ground.npy', (1.0, 1.0)).heights, heights)
    cv2.imwrite(str(tmp_path / 'ground.png'), np.rint(heights / 2.0 * 65535).astype(np.uint16))
    loaded = Terrain.load(tmp_path / 'ground.png', (1.0, 1.0), low=0.0, high=2.0, interpolation='bilinear')
    # Looked at from above it is the right way round: the picture's last row lies at y = 0.
    assert np.abs(loaded.heights - heights[::-1]).max() < 2.0 / 65535 and loaded.bilinear


def test_misuse_names_the_argument(tmp_path):
    with pytest.raises(ValueError, match='heights'):
        Terrain(np.zeros((1, 5)))
    with pytest.raises(ValueError, match='spacing'):
        Terrain(np.zeros((2, 2)), (0.0, 1.0))
    with pytest.raises(ValueError, match='interpolation'):
        Terrain(np.zeros((2, 2)), interpolation='cubic')
    with pytest.raises(FileNotFoundError, match=r'none\.npy'):
        Terrain.load(tmp_path / 'none.npy', (1, 1))
    (tmp_path / 'bad.npy').write_bytes(b'no array')
    with pytest.raises(ValueError, match=r'bad\.npy'):
        Terrain.load(tmp_path / 'bad.npy', (1, 1))
    cv2.imwrite(str(tmp_path / 'eight.png'), np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match=r'eight\.png'):
        Terrain.load(tmp_path / 'eight.png', (1, 1))
    with pytest.raises(ValueError, match='terrain'):
        render(Scene(Solid.sphere(1.0) - Terrain(np.zeros((2, 2)))))
