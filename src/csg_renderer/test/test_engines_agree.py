"""Native, reference and dap engine on random scenes with everything in them: the same ids in every pixel."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, Terrain, render
from csg_renderer.raycast.engines import ENGINES
from msgs_py import PinholeCamera, Pose

# One tile of the array machine.
CAMERA = PinholeCamera.centred(32, 24, 38.0)
# The terrain's z (up) becomes the camera's -y, seen slantwise from above.
LYING = Pose.from_rotation_vector([np.pi / 2 - 0.5, 0.0, 0.0], [0.0, 0.5, 2.6])
OPTIONS = [
    {'levels': 3},
    {'levels': 1, 'antialias': True},
    {'levels': 2, 'tiling': False},
    {'levels': 1, 'antialias': 2},
    {'levels': 2, 'tile_size': 16},
]


def surface(random):
    return Surface(
        random.uniform(0.1, 1.0, 3),
        diffuse=random.uniform(0.3, 1.0),
        specular=random.uniform(0.0, 0.6),
        shininess=float(random.integers(1, 30)),
        reflection=random.choice([0.0, 0.4]),
        transparency=random.choice([0.0, 0.0, 0.5]),
    )


def leaf(random):
    kind = random.choice(['BLOCK', 'CYLINDER', 'CONE', 'SPHERE'])
    turn = Pose.from_rotation_vector(random.normal(size=3), random.uniform(-0.4, 0.4, 3))
    return Solid.primitive(kind, turn.matrix @ np.diag([*random.uniform(0.2, 0.5, 3), 1.0])).painted(surface(random))


def tree(random):
    solid = leaf(random)
    for _ in range(random.integers(1, 3)):
        other = leaf(random)
        solid = random.choice([solid | other, solid - other, solid & other, other - solid], p=[0.4, 0.4, 0.1, 0.1])
    return solid.transformed(Pose(np.eye(3), [random.uniform(-0.7, 0.7), random.uniform(-0.4, 0.3), 2.4]))


def ground(random):
    rows, columns = random.integers(4, 7, 2)
    heights = 0.2 * random.normal(size=(rows, columns))
    if random.random() < 0.5:
        heights[random.integers(1, rows - 1), random.integers(1, columns - 1)] = np.nan
    tints = [[-0.3, 0.1, 0.2, 0.7], [0.0, 0.2, 0.6, 0.1], [0.05, 0.6, 0.5, 0.3], [0.4, 1.0, 1.0, 1.0]]
    sheet = Terrain(
        heights,
        (2.8 / (columns - 1), 2.8 / (rows - 1)),
        random.choice(['triangles', 'bilinear']),
        surface=surface(random),
        tints=tints if random.random() < 0.5 else None,
    )
    return sheet.transformed(Pose(np.eye(3), [-1.4, -1.4, 0.0])).transformed(LYING)


def scene(seed):
    random = np.random.default_rng(seed)
    lights = [Light(random.uniform([-3, -4, 0], [3, -2, 3]), random.uniform(0.3, 1.0, 3)) for _ in range(2)]
    # Once in a while the sheet is united with a solid at the top of a tree.
    solids = [tree(random), tree(random), ground(random)]
    return Scene([solids[0], solids[1] | solids[2]] if seed % 4 == 0 else solids, lights, background=(0.1, 0.2, 0.3))


@pytest.mark.parametrize('seed', range(20))
def test_no_pixel_differs_on_a_random_scene_with_terrain_transparency_and_shadows(seed):
    random_scene, options = scene(seed), OPTIONS[seed % len(OPTIONS)]
    native, *others = (render(random_scene, CAMERA, engine=engine, shadows=True, **options) for engine in ENGINES)
    sheets = [index for index, part in enumerate(random_scene.primitives) if part.kind == 'TERRAIN']
    assert len(sheets) == 1 and (native.primitive_id == sheets[0]).sum() > 50
    for other in others:
        for name in ('primitive_id', 'face_id', 'object_id'):
            assert np.array_equal(getattr(native, name), getattr(other, name)), name
        assert np.allclose(native.depth, other.depth, atol=1e-6, equal_nan=True)
        assert np.allclose(native.normal, other.normal, atol=1e-6, equal_nan=True)
        # Rounding of a colour to a whole grey level, and of which side of a shadow's edge a place lies on.
        difference = np.abs(native.image.astype(int) - other.image)
        assert (difference > 1).any(axis=2).sum() <= 1 and (difference > 0).sum() <= 4
