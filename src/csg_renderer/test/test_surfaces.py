"""Pictures on faces, lights with a size, rough metal and surroundings, each against a closed form."""

import numpy as np
import pytest

from csg_renderer import Environment, Light, Scene, Solid, Surface, Terrain, Texture, render
from csg_renderer.raycast.programs.surface_data import albedo_table
from csg_renderer.raycast.settings import LEAST_ROUGHNESS
from msgs_py import LensDistortion, PinholeCamera, Pose

CAMERA = PinholeCamera.centred(64, 48, 80.0)
ENGINES = ['native', 'reference']
GLOW = Surface((1.0, 1.0, 1.0), ambient=1.0, diffuse=0.0)
WHITE = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)
# Looking along -y of a scene whose z is up, from 1 m in front.
FRONT = Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), [0.0, 0.0, 1.0])


def moved(solid, x, y, z):
    return solid.transformed(Pose(np.eye(3), [x, y, z]))


def wall(z, surface, size=4.0):
    return moved(Solid.block(size, size, 0.1), -size / 2, -size / 2, z).painted(surface)


def places(camera=CAMERA, z=1.0):
    """(h, w, 2): x and y of the points at a depth that the pixels show."""
    return camera.rays(camera.pixel_grid())[..., :2] * z


def glowing(solids, **options):
    return Scene(solids, ambient_light=WHITE, **options)


# -- pictures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
def test_a_plane_picture_lies_where_its_size_says_and_between_its_pixels_is_a_ramp(engine):
    random = np.random.default_rng(1)
    picture = random.integers(0, 256, (3, 4, 3), dtype=np.uint8)
    # Of 0.4 x 0.3 m, with one corner at the origin, x to the right and y up (away from the camera's y).
    scene = glowing(wall(1.0, GLOW).textured(Texture(picture, 'planar', (0.4, 0.3))))
    frame = render(scene, CAMERA, engine=engine)
    x, y = np.moveaxis(places(), -1, 0)
    column, row = x / 0.1 - 0.5, (0.3 - y) / 0.1 - 0.5
    i, j = np.floor(column).astype(int), np.floor(row).astype(int)
    fx, fy = (column - i)[..., None], (row - j)[..., None]

    def at(di, dj):
        return picture[(j + dj) % 3, (i + di) % 4].astype(float)

    expected = (at(0, 0) * (1 - fx) + at(1, 0) * fx) * (1 - fy) + (at(0, 1) * (1 - fx) + at(1, 1) * fx) * fy
    assert np.abs(frame.image - expected).max() <= 0.51


def test_a_picture_multiplies_the_colour_and_moves_with_the_solid_until_it_is_painted_over():
    picture = np.full((1, 1, 3), (255, 128, 0), dtype=np.uint8)
    plain = Surface((0.5, 0.5, 0.5), ambient=1.0, diffuse=0.0)
    textured = wall(1.0, plain).textured(Texture(picture, 'planar', (0.1, 0.1)))
    assert render(glowing(textured), CAMERA).image[0, 0].tolist() == [128, 64, 0]
    assert render(glowing(textured.painted(plain)), CAMERA).image[0, 0].tolist() == [128, 128, 128]
    assert render(glowing(textured.textured(None)), CAMERA).image[0, 0].tolist() == [128, 128, 128]
    halves = Texture(np.array([[0, 255]], dtype=np.uint8), 'planar', (0.4, 0.4))
    turn = Pose.from_rotation_vector([0, 0, 0.5], [0.03, 0.02, 0.1])
    block = moved(Solid.block(0.4, 0.4, 0.2), -0.2, -0.2, 0.0).painted(GLOW)
    moves_along = block.textured(halves).transformed(turn).transformed(Pose(np.eye(3), [0, 0, 1.0]))
    placed = block.transformed(turn).textured(halves, turn.inverse()).transformed(Pose(np.eye(3), [0, 0, 1.0]))
    a, b = (render(glowing(solid), CAMERA).image for solid in (moves_along, placed))
    assert np.abs(a.astype(int) - b).max() <= 1 and a.std() > 50


@pytest.mark.parametrize('engine', ENGINES)
def test_each_side_of_a_box_shows_its_picture_the_right_way_round(engine):
    # Six pictures of 2 x 2 pixels; the upper left, upper right and lower left of each say which it is.
    atlas = np.zeros((4, 6, 3), dtype=np.uint8)
    for side in range(6):
        row, column = 2 * (side // 3), 2 * (side % 3)
        atlas[row, column] = (40 * side + 55, 255, 0)
        atlas[row, column + 1] = (40 * side + 55, 0, 255)
        atlas[row + 1, column] = (40 * side + 55, 128, 128)
    for sizes in ((0.4, 0.3, 0.2), (-0.4, 0.3, -0.2)):
        box = Solid.block(*sizes).painted(GLOW).textured(Texture(atlas, 'box', sizes))
        box = moved(box, *(-0.5 * np.array(sizes)))
        # Each side, with up: the camera looks against the side's normal.
        sides = [((1, 0, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0))]
        sides += [((-1, 0, 0), (0, 0, 1)), ((0, -1, 0), (0, 0, 1)), ((0, 0, -1), (0, 1, 0))]
        for side, (normal, up) in enumerate(sides):
            z, y = -np.array(normal, dtype=float), -np.array(up, dtype=float)
            pose = Pose(np.stack([np.cross(y, z), y, z]), [0.0, 0.0, 1.0])
            frame = render(glowing(box), PinholeCamera.centred(64, 64, 80.0), pose, engine=engine)
            rows, columns = np.nonzero(frame.mask)
            corners = [
                frame.image[v, u].astype(int)
                for v, u in ((rows.min(), columns.min()), (rows.min(), columns.max()), (rows.max(), columns.min()))
            ]
            number = 40 * side + 55
            assert np.abs(np.array(corners) - [(number, 255, 0), (number, 0, 255), (number, 128, 128)]).max() <= 1


@pytest.mark.parametrize('engine', ENGINES)
def test_a_picture_goes_once_around_a_cylinder(engine):
    # Grey rises around the cylinder: what is seen at an angle is the angle.
    ramp = np.tile(np.arange(256, dtype=np.uint8), (4, 1))
    can = Solid.cylinder(0.1, (0, 0, 0.2)).painted(GLOW).textured(Texture(ramp, 'cylindrical', (0.2,)))
    frame = render(glowing(moved(can, 0.0, 0.0, -0.1)), CAMERA, FRONT, engine=engine)
    # The camera stands at y = -1: what it sees has angles about -90 degrees, rising to its right.
    x, y = frame.points[..., 0], frame.points[..., 2] - 1.0
    turns = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
    seen = frame.mask & (np.abs(np.arctan2(y, x) + np.pi / 2) < 1.2)
    assert seen.sum() > 100
    assert np.abs(frame.image[..., 0] - (turns * 256.0 - 0.5))[seen].max() < 1.0
    # The ends keep their colour.
    above = Pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 1.0])
    assert (render(glowing(can), CAMERA, above, engine=engine).image[24, 32] == 255).all()


def test_a_fine_pattern_far_away_is_its_mean_and_a_slanted_one_is_sharp_across():
    checks = ((np.indices((256, 256)).sum(axis=0) % 2) * 255).astype(np.uint8)
    # A pixel covers 12.5 mm of the wall, and 6.4 checks of 2 mm.
    far = render(glowing(wall(1.0, GLOW).textured(Texture(checks, 'planar', (0.5, 0.5)))), CAMERA).image
    assert np.abs(far.astype(float) - 127.5).max() < 2.0
    # A road to the horizon: stripes along it stay stripes, where one level for both directions would be grey.
    stripes = np.tile(np.repeat([0, 255], 32).astype(np.uint8), (64, 1))
    road = Solid.plane((0, -1, 0), -0.1).painted(GLOW)
    road = road.textured(Texture(stripes, 'planar', (0.1, 0.1)), Pose.from_rotation_vector([np.pi / 2, 0, 0]))
    frame = render(glowing(road), CAMERA)
    depths = np.nan_to_num(frame.depth).max(axis=1)
    row = np.flatnonzero(depths > 1.2)[-1]
    depth = float(depths[row])
    # A pixel is 1/6 of a pair of stripes wide there, and 10 times as long.
    assert 1.1 < depth < 2.0 and np.ptp(frame.image[row, :, 0].astype(int)) > 200


# -- lights with a size -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize('engine', ENGINES)
def test_the_penumbra_of_a_straight_edge_is_as_wide_as_similar_triangles_say(engine):
    # Light at 1 m before the wall, an edge 0.25 m before it: 2 r b / a = 2 * 0.06 * 0.25 / 0.75 = 40 mm of half shadow.
    radius, before, distance = 0.06, 0.25, 1.0
    light = Light((0.0, 0.0, 2.0 - distance), WHITE, radius)
    edge = moved(Solid.block(1.0, 2.0, 0.001), 0.0, -1.0, 2.0 - before).painted(Surface(BLACK, ambient=0.0))
    scene = Scene([wall(2.0, Surface(WHITE)), edge], [light], ambient_light=BLACK)
    # From the side, so that the edge itself is not in the way.
    camera = PinholeCamera.centred(160, 6, 2000.0)
    look = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    rotation = np.stack([[look[2], 0.0, -look[0]], [0.0, 1.0, 0.0], look])
    pose = Pose(rotation, rotation @ [1.0, 0.0, -1.0])
    frame = render(scene, camera, pose, engine=engine, shadows=True, samples=400 if engine == 'native' else 100)
    x = pose.inverse().apply(frame.points.reshape(-1, 3))[:, 0].reshape(frame.depth.shape)
    half = radius * before / (distance - before)
    assert x.min() < -half and x.max() > half
    s = np.clip(-x / half, -1.0, 1.0)
    share = 0.5 + (s * np.sqrt(1.0 - s * s) + np.arcsin(s)) / np.pi
    cosine = distance / np.hypot(x, distance)
    expected = 255.0 * share * cosine
    error = frame.image[..., 0] - expected
    # The samples' own scatter; the light is 7 degrees wide, of which a disc is an approximation to 1 %.
    assert np.sqrt((error**2).mean()) < (2.0 if engine == 'native' else 4.0) and np.abs(error.mean()) < 1.0
    # Where all of the light is hidden or seen nothing is by chance.
    assert (frame.image[x > 1.02 * half] == 0).all()
    assert np.abs(error[x < -1.02 * half]).max() < 2.0


@pytest.mark.parametrize('engine', ENGINES)
def test_a_ball_of_light_lights_a_matt_wall_by_the_mean_cosine_of_its_cone(engine):
    radius, distance = 0.5, 1.0
    scene = Scene(wall(1.0, Surface(WHITE)), [Light((0, 0, 1.0 - distance), (0.9, 0.9, 0.9), radius)], BLACK)
    camera = PinholeCamera.centred(8, 8, 400.0)
    image = render(scene, camera, engine=engine, samples=64).image.astype(float)
    expected = 255.0 * 0.9 * (1.0 + np.sqrt(1.0 - (radius / distance) ** 2)) / 2.0
    assert abs(image.mean() - expected) < 1.0 and np.abs(image - expected).max() < 3.0
    point = render(Scene(wall(1.0, Surface(WHITE)), [Light((0, 0, 0), (0.9, 0.9, 0.9))], BLACK), camera, engine=engine)
    small = render(
        Scene(wall(1.0, Surface(WHITE)), [Light((0, 0, 0), (0.9, 0.9, 0.9), 1e-6)], BLACK), camera, engine=engine
    )
    assert np.abs(point.image.astype(int) - small.image).max() <= 1


# -- metal and surroundings -------------------------------------------------------------------------------------------


@pytest.mark.parametrize('roughness', [None, 0.0, 0.1, 0.35, 0.7, 1.0])
def test_a_white_surface_in_white_surroundings_cannot_be_seen(roughness):
    surface = Surface(WHITE, roughness=roughness)
    shapes = [Solid.sphere(0.3), moved(Solid.block(0.3, 0.3, 0.3), 0.35, -0.15, -0.15)]
    turned = [moved(shape.painted(surface), -0.1, 0.0, 1.2) for shape in shapes]
    scene = Scene(turned, environment=Environment(np.full((2, 4), 0.8)))
    frame = render(scene, CAMERA, samples=256)
    assert (frame.image[~frame.mask] == 204).all()
    # Towards the outline the table's steps and the samples' scatter show.
    steep = -(frame.camera_normal * unit(CAMERA.rays(CAMERA.pixel_grid()))).sum(axis=-1) > 0.3
    seen = frame.image[frame.mask & steep].astype(float)
    assert len(seen) > 300 and abs(seen.mean() - 204.0) < 1.0
    assert np.abs(seen - 204.0).max() < (3.0 if roughness is None or roughness < 0.2 else 24.0)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_what_one_reflection_returns_is_an_integral_over_directions():
    # The published formulas (Walter 2007), on a grid of directions instead of samples of facets.
    table = albedo_table()
    steps = len(table) - 1
    theta, phi = ((np.arange(n) + 0.5) * end / n for n, end in ((1500, np.pi / 2), (300, 2.0 * np.pi)))
    theta, phi = np.meshgrid(theta, phi)
    light = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    cell = np.sin(theta) * (np.pi / 2 / 1500) * (2.0 * np.pi / 300)
    for i, j in ((8, 32), (16, 16), (32, 8), (24, 28)):
        alpha, cosine = i / steps, j / steps
        assert table[i, j] == pytest.approx((ggx(light, alpha, cosine) * light[..., 2] * cell).sum(), abs=0.01)


def ggx(light, alpha, cosine):
    """D G / (4 nl nv) of white GGX metal for lights (..., 3) in the frame of the normal, viewer in x, z."""
    view = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    slant = unit(light + view)[..., 2]
    tangent = np.sqrt(1.0 - slant**2) / slant
    facets = alpha**2 / (np.pi * slant**4 * (alpha**2 + tangent**2) ** 2)

    def hidden(c):
        return (np.sqrt(1.0 + alpha**2 * (1.0 - c**2) / c**2) - 1.0) / 2.0

    return facets / (1.0 + hidden(light[..., 2]) + hidden(cosine)) / (4.0 * light[..., 2] * cosine)


@pytest.mark.parametrize('engine', ENGINES)
@pytest.mark.parametrize('alpha', [0.2, 0.5])
def test_the_highlight_of_a_light_on_metal_is_ggx(engine, alpha):
    colour = np.array([0.9, 0.6, 0.3])
    # Seen at 60 degrees to the normal of a wall.
    metal = wall(0.0, Surface(tuple(colour), ambient=0.0, roughness=alpha))
    position = np.array([-0.7, 0.2, -0.9])
    scene = Scene(metal, [Light(tuple(position), (0.3, 0.3, 0.3))], BLACK)
    look = unit(np.array([-np.sqrt(3.0) / 2.0, 0.0, 0.5]))
    across = np.array([0.0, 1.0, 0.0])
    pose = Pose(np.stack([np.cross(across, look), across, look]), [0.0, 0.0, 1.0])
    frame = render(scene, CAMERA, pose, engine=engine)
    assert frame.mask.sum() > 2000
    points, seen = pose.inverse().apply(frame.points[frame.mask]), frame.image[frame.mask]
    light, view = unit(position - points), unit(pose.inverse().translation - points)
    # The normal is -z.
    cosine, facing = -view[..., 2], -light[..., 2]
    half = unit(light + view)
    fresnel = colour + (1.0 - colour) * (1.0 - (half * light).sum(axis=-1, keepdims=True)) ** 5
    slant = -half[..., 2]
    facets = alpha**2 / (np.pi * (slant**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    hidden = [(np.sqrt(1.0 + alpha**2 * (1.0 / c**2 - 1.0)) - 1.0) / 2.0 for c in (facing, cosine)]
    lobe = facets / (1.0 + hidden[0] + hidden[1]) / (4.0 * cosine)
    table, steps = albedo_table(), len(albedo_table()) - 1
    returned = np.interp(cosine * steps, np.arange(steps + 1), between(table, alpha * steps))[..., None]
    more = 1.0 + colour * (1.0 - returned) / returned
    expected = np.clip(255.0 * 0.3 * np.pi * lobe[..., None] * fresnel * more, 0.0, 255.0)
    assert np.abs(seen - expected).max() < 0.51 and np.ptp(expected) > 50.0


def between(table, row):
    i = min(int(row), len(table) - 2)
    return (1.0 - (row - i)) * table[i] + (row - i) * table[i + 1]


@pytest.mark.parametrize('engine', ENGINES)
def test_the_surroundings_are_where_their_directions_say(engine):
    # A smooth world: red rises with the height, green to the right, blue ahead.
    rows, columns = 64, 128
    height = np.pi / 2 - (np.arange(rows) + 0.5) * np.pi / rows
    turn = (np.arange(columns) + 0.5) * 2.0 * np.pi / columns - np.pi
    height, turn = np.meshgrid(height, turn, indexing='ij')
    world = np.stack([np.sin(height), np.cos(height) * np.sin(turn), np.cos(height) * np.cos(turn)], axis=-1) / 2 + 0.5
    mirror = wall(1.0, Surface(WHITE, roughness=LEAST_ROUGHNESS), 0.2)
    scene = Scene(mirror, environment=Environment(world))
    frame = render(scene, CAMERA, engine=engine, samples=64)
    rays = unit(CAMERA.rays(CAMERA.pixel_grid()))
    # Up is -y of the camera, ahead its z, right its x; the wall mirrors z.
    mirrored = np.where(frame.mask[..., None], rays * [1.0, 1.0, -1.0], rays)
    expected = (np.stack([-mirrored[..., 1], mirrored[..., 0], mirrored[..., 2]], axis=-1) / 2 + 0.5) * 255
    assert 50 < frame.mask.sum() < 1000
    assert np.abs(frame.image - expected).max() < 3.0  # the map's pixels are 2.8 degrees


def test_matt_surfaces_gather_the_hemisphere_and_shadows_take_from_it():
    # Half of the world is white, that above: a wall that looks sideways gets half, one that looks up all of it.
    world = np.zeros((64, 8))
    world[:32] = 1.0
    floor = Solid.plane((0, -1, 0), -0.5).painted(Surface((0.8, 0.8, 0.8)))
    side = wall(2.0, Surface((0.8, 0.8, 0.8)), 1.0)
    scene = Scene([floor, side], environment=Environment(world))
    frame = render(scene, CAMERA, samples=64)
    up, aside = frame.object_id == 0, frame.object_id == 1
    assert up.sum() > 100 and aside.sum() > 100
    # Looked up in reduced pictures, the horizon is blurred.
    assert frame.image[up].mean() == pytest.approx(0.8 * 255, abs=4.0)
    assert frame.image[aside].mean() == pytest.approx(0.4 * 255, abs=4.0)
    # Under a wide roof, 0.7 m above the floor, what shines in from the sides is below 1 %.
    roof = moved(Solid.block(40.0, 0.01, 40.0), -20.0, -0.2, -20.0).painted(Surface(BLACK))
    dark = render(Scene([floor, roof], environment=Environment(world)), CAMERA, samples=64, shadows=True)
    near = (dark.object_id == 0) & (dark.depth < 5.0)
    assert near.sum() > 100 and dark.image[near].max() < 10


def test_metal_shows_what_stands_before_it_and_takes_its_colour():
    gold = Surface((1.0, 0.7, 0.3), roughness=LEAST_ROUGHNESS)
    lamp = moved(Solid.sphere(0.3), 0.0, 0.0, -0.5).painted(GLOW)
    scene = Scene([wall(1.0, gold), lamp], ambient_light=WHITE, background=BLACK)
    one, two = (render(scene, CAMERA, levels=levels).image[24, 32] for levels in (1, 2))
    # The ambient light that metal returns, and with a second level the lamp.
    assert np.abs(one.astype(int) - [255, 179, 77]).max() <= 1
    scene = Scene([wall(1.0, Surface((1.0, 0.7, 0.3), ambient=0.0, roughness=LEAST_ROUGHNESS)), lamp], [], WHITE)
    one, two = (render(scene, CAMERA, levels=levels).image[24, 32] for levels in (1, 2))
    assert one.tolist() == [0, 0, 0] and np.abs(two.astype(int) - [255, 179, 77]).max() <= 1


# -- engines ----------------------------------------------------------------------------------------------------------


def surface(random):
    return Surface(
        random.uniform(0.1, 1.0, 3),
        specular=random.uniform(0.0, 0.6),
        reflection=random.choice([0.0, 0.4]),
        transparency=random.choice([0.0, 0.0, 0.5]),
        roughness=random.choice([None, None, random.uniform(0.05, 0.8)]),
    )


def random_scene(seed):
    random = np.random.default_rng(seed)
    picture = random.uniform(0.0, 1.0, (8, 12, 3))
    textures = [
        None,
        Texture(picture, 'planar', (0.2, 0.3)),
        Texture(picture, 'box', (0.2, 0.1)),
        Texture(picture, 'box', (0.4, -0.3, 0.5)),
        Texture(picture, 'cylindrical', (0.3,)),
    ]
    solids = []
    for _ in range(3):
        kind = random.choice(['BLOCK', 'CYLINDER', 'CONE', 'SPHERE'])
        turn = Pose.from_rotation_vector(random.normal(size=3), [*random.uniform(-0.5, 0.5, 2), 2.0])
        leaf = Solid.primitive(kind, np.diag([*random.uniform(0.2, 0.5, 3), 1.0])).painted(surface(random))
        leaf = leaf.textured(textures[random.integers(5)]).transformed(turn)
        solids.append(leaf if not solids or random.random() < 0.5 else solids.pop() - leaf)
    if seed % 2:
        sheet = Terrain(0.1 * random.normal(size=(4, 4)), (1.0, 1.0), surface=surface(random))
        solids.append(sheet.textured(textures[1]).transformed(Pose.from_rotation_vector([1.1, 0, 0], [-1.5, 0.7, 2.5])))
    lights = [Light(random.uniform([-3, -4, 0], [3, -2, 3]), (0.6, 0.5, 0.4), radius) for radius in (0.0, 0.4)]
    world = Environment(random.uniform(0.0, 1.0, (8, 16, 3))) if seed % 3 else None
    return Scene(solids, lights, background=(0.1, 0.2, 0.3), environment=world)


@pytest.mark.parametrize('seed', range(6))
def test_the_reference_engine_shows_the_same(seed):
    options = [{'levels': 1, 'tiling': False}, {'levels': 3}, {'levels': 2, 'antialias': 2}][seed % 3]
    camera = PinholeCamera.centred(32, 24, 38.0)
    scene = random_scene(seed)
    native, reference = (render(scene, camera, engine=e, shadows=seed > 1, samples=3, **options) for e in ENGINES)
    for name in ('primitive_id', 'face_id', 'object_id'):
        assert np.array_equal(getattr(native, name), getattr(reference, name)), name
    assert np.allclose(native.depth, reference.depth, atol=1e-6, equal_nan=True)
    assert native.stats.intersections > 0
    # Rounding, and of which side of a shadow's edge a place lies on.
    difference = np.abs(native.image.astype(int) - reference.image)
    assert (difference > 1).any(axis=2).sum() <= 2 and (difference > 0).sum() <= 6


@pytest.mark.parametrize('antialias', [0, 2])
def test_raw_pictures_of_a_lens_show_the_same(antialias):
    camera, lens = PinholeCamera.centred(24, 20, 30.0), LensDistortion('plumb_bob', (-0.2, 0.05, 0.0, 0.0, 0.0))
    native, reference = (
        render(random_scene(4), camera, engine=e, samples=3, lens=lens, antialias=antialias) for e in ENGINES
    )
    assert native.mask.sum() > 50 and np.array_equal(native.face_id, reference.face_id)
    assert (native.image != reference.image).sum() <= 6


def test_the_array_machine_says_that_it_shows_none_of_this():
    with pytest.raises(ValueError, match=r"^engine: 'dap' shows no TEXTURE, METAL, ENVIRONMENT or RADIUS"):
        render(random_scene(0), CAMERA, engine='dap')


def test_without_any_of_this_nothing_changes_and_pictures_do_not_depend_on_threads_or_runs():
    plain = Scene(wall(1.0, Surface((0.5, 0.6, 0.7), specular=0.5)), [Light((0.3, 0.2, 0.0))])
    again = Scene(wall(1.0, Surface((0.5, 0.6, 0.7), specular=0.5)), [Light((0.3, 0.2, 0.0), radius=0.0)])
    white = Texture(np.full((2, 2), 255, dtype=np.uint8), 'planar', (1.0, 1.0))
    blank = Scene(plain.solids[0].textured(white), plain.lights)
    first, second, third = (render(scene, CAMERA).image for scene in (plain, again, blank))
    assert np.array_equal(first, second) and np.array_equal(first, third)
    scene = random_scene(1)
    one, two, tiled = (
        render(scene, CAMERA, shadows=True, levels=2, **options).image
        for options in ({'threads': 1}, {'threads': 2}, {'tile_size': 8})
    )
    assert np.array_equal(one, two) and np.array_equal(one, tiled)


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: Texture(np.zeros((2, 2)), 'round', (1.0,)), 'mapping: expected one of planar, box, cylindrical'),
        (lambda: Texture(np.zeros((2, 2)), 'planar', (1.0,)), 'size: a planar texture takes 2'),
        (lambda: Texture(np.zeros((2, 2)), 'planar', (1.0, -1.0)), 'size: expected lengths > 0'),
        (lambda: Texture(np.zeros((1, 2)), 'box', (1.0, 1.0, 1.0)), 'image: expected 3 x 2 pictures'),
        (lambda: Texture(np.full((2, 2), 2.0), 'planar', (1.0, 1.0)), 'image: expected uint8, or numbers in 0..1'),
        (lambda: Texture(np.zeros(3), 'planar', (1.0, 1.0)), 'image: expected'),
        (lambda: Environment(np.full((2, 2), -1.0)), 'image: expected uint8, or numbers >= 0'),
        (lambda: Environment(np.zeros((2, 2)), 0.0), 'brightness: expected a number > 0'),
        (lambda: Environment(np.zeros((2, 2)), 1.0, (0, 0, 0)), 'up: expected three numbers'),
        (lambda: Light((0, 0, 0), radius=-1.0), 'radius: expected a number >= 0'),
        (lambda: Surface(roughness=1.5), 'roughness: expected a number in 0..1'),
        (lambda: render(random_scene(1), CAMERA, samples=0), 'samples: expected a whole number in 1..1024'),
    ],
)
def test_what_cannot_be_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
