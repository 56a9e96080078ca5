"""Printing a scene: the text parses to the same scene, bit for bit."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csg_renderer import (
    Environment,
    Light,
    Placement,
    Scene,
    Solid,
    Surface,
    Terrain,
    Texture,
    load_scene,
    parse_scene,
    scene_names,
)
from csg_renderer.language import format_scene
from csg_renderer.scene.solid import FACES, PRIMITIVES, Operation, Primitive
from csg_renderer.scene.textures import Laid
from msgs_py import PinholeCamera, Pose


def again(scene: Scene) -> Scene:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return parse_scene(format_scene(scene))


def assert_same_solid(a: Solid, b: Solid) -> None:
    pending = [(a, b)]
    while pending:
        x, y = pending.pop()
        assert type(x) is type(y)
        if isinstance(x, Operation):
            assert x.operator == y.operator
            pending += [(x.left, y.left), (x.right, y.right)]
        elif isinstance(x, Primitive):
            assert (x.kind, x.surface) == (y.kind, y.surface)
            assert np.array_equal(x.matrix, y.matrix)
            assert (x.face_colours is None) == (y.face_colours is None)
            assert x.face_colours is None or np.array_equal(x.face_colours, y.face_colours)
        if isinstance(x, Primitive | Terrain):
            assert_same_texture(x.laid, y.laid)


def assert_same_texture(a: Laid | None, b: Laid | None) -> None:
    assert (a is None) == (b is None)
    if a is not None:
        assert np.array_equal(a.frame, b.frame) and np.array_equal(a.texture.image, b.texture.image)
        assert (a.texture.mapping, a.texture.size) == (b.texture.mapping, b.texture.size)


def assert_same_scene(a: Scene, b: Scene) -> None:
    assert [p.name for p in a.placements] == [p.name for p in b.placements]
    for p, q in zip(a.placements, b.placements):
        assert np.array_equal(p.matrix, q.matrix)
        assert p.frames == q.frames
        assert_same_solid(p.model, q.model)
    for name, solid in a.definitions.items():
        assert_same_solid(solid, b.definitions[name])
    for name in ('lights', 'ambient_light', 'background', 'camera', 'camera_T_scene', 'baseline'):
        assert getattr(a, name) == getattr(b, name), name
    assert (a.environment is None) == (b.environment is None)
    if a.environment is not None:
        assert np.array_equal(a.environment.image, b.environment.image)
        assert (a.environment.brightness, a.environment.up) == (b.environment.brightness, b.environment.up)


@pytest.mark.parametrize('name', scene_names())
@pytest.mark.filterwarnings('ignore::csg_renderer.SceneWarning')
def test_every_scene_of_the_package_prints_to_itself(name):
    scene = load_scene(name)
    assert_same_scene(scene, again(scene))


# Of a file that comes with the package.
STUDIO = load_scene('printed_goods').environment.image

finite = st.floats(-10.0, 10.0).filter(lambda x: x == 0.0 or abs(x) > 1e-6)
unit = st.floats(0.0, 1.0)
colours = st.tuples(unit, unit, unit)


@st.composite
def matrices(draw) -> np.ndarray:
    """Affine and well away from flat."""
    angles = [draw(st.floats(-3.0, 3.0)) for _ in range(3)]
    m = np.eye(4)
    scales = [draw(st.sampled_from([0.1, 1.0, -2.5])) for _ in 'xyz']
    m[:3, :3] = Pose.from_rotation_vector(angles).rotation @ np.diag(scales)
    m[:3, 3] = [draw(finite) for _ in range(3)]
    return m if draw(st.booleans()) else np.diag([draw(st.floats(0.01, 9.0)) for _ in 'xyz'] + [1.0])


@st.composite
def leaves(draw) -> Solid:
    kind = draw(st.sampled_from(sorted(PRIMITIVES)))
    surface = Surface(
        draw(colours),
        draw(unit),
        draw(unit),
        draw(unit),
        draw(st.floats(0.0, 99.0)),
        draw(unit),
        draw(unit),
        draw(st.none() | unit),
    )
    paint = np.array([draw(colours) for _ in FACES[kind]]) if draw(st.booleans()) else None
    made = {'CYLINDER': Solid.cylinder(0.25, (0.0, -0.5, 0.0)), 'BLOCK': Solid.block(0.1, -0.035, 2.0)}
    leaf = made[kind] if kind in made and draw(st.booleans()) else Primitive(kind, draw(matrices()), surface, paint)
    if draw(st.booleans()):
        return leaf
    mapping, size = draw(st.sampled_from([('planar', (0.1, 0.03)), ('box', (0.5, -0.3, 2.0)), ('cylindrical', (0.1,))]))
    leaf = leaf.textured(Texture(STUDIO, mapping, size, 'studio.png'), draw(st.none() | matrices()))
    return leaf.transformed(draw(matrices())) if draw(st.booleans()) else leaf


solids = st.recursive(
    leaves(),
    lambda inner: st.builds(Operation, st.sampled_from(['UNION', 'INTERSECT', 'DIFFERENCE']), inner, inner),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(solids, matrices()), max_size=3),
    st.lists(st.tuples(finite, finite, finite, colours, st.floats(0.0, 3.0)), max_size=2),
    colours,
    colours,
    st.booleans(),
    st.floats(0.001, 2.0),
)
def test_random_scenes_print_to_themselves(objects, lights, ambient, background, seen, baseline):
    pose = Pose.from_rotation_vector([0.3, -0.2, 0.1], [0.1, 0.2, 0.3]) if seen else None
    camera = PinholeCamera(640, 480, 500.1, 499.9, 320.0, 239.7) if seen else None
    scene = Scene(
        [Placement(f'thing{k}', solid, matrix) for k, (solid, matrix) in enumerate(objects)],
        [Light((x, y, z), colour, radius) for x, y, z, colour, radius in lights],
        ambient,
        background,
        definitions={f'thing{k}': solid for k, (solid, _) in enumerate(objects)},
        camera=camera,
        camera_T_scene=pose,
        baseline=baseline,
        environment=Environment(STUDIO, baseline, (0.0, baseline, 1.0), file='studio.png') if seen else None,
    )
    assert_same_scene(scene, again(scene))


def test_round_numbers_are_printed_in_millimetres_as_they_were_written():
    text = format_scene(parse_scene('DRAW BLOCK (35, 20.5, -30) AT (1, 0.1, 350) AS brick;'))
    assert 'UNITS MM;' in text
    assert 'brick = BLOCK (35, 20.5, -30);' in text
    assert 'DRAW brick AT (1, 0.1, 350) AS brick;' in text


def test_a_terrain_with_a_picture_prints_to_itself():
    for moves in ('AT (1, 2, 3)', 'AT (1, 2, 3) TEXTURE "studio.png" PLANAR (9, 9) XROT (33)'):
        text = f'DRAW (TERRAIN ("hills.png", 40, 40, 13) {moves} TEXTURE "studio.png" BOX (9, 8)) YROT (3) AS hills;'
        scene = parse_scene(text)
        assert_same_scene(scene, again(scene))
    scene = parse_scene('t = TERRAIN ("hills.png", 40, 40, 13) TEXTURE "studio.png" PLANAR (9, 9) XROT (33); DRAW t;')
    assert_same_scene(scene, again(scene))


def test_deep_and_long_trees_are_printed_within_the_limits_of_the_parser():
    long = deep = Solid.sphere(0.01)
    for k in range(1, 300):
        leaf = Solid.sphere(0.01).transformed(Pose(np.eye(3), [k / 1000, 0.0, 0.0]))
        long, deep = long | leaf, leaf - deep
    scene = Scene([long, deep])
    assert_same_scene(scene, again(scene))


def test_names_the_language_does_not_allow_are_changed_and_stay_different():
    ball = Solid.sphere(0.01)
    scene = again(
        Scene(
            [
                Placement('my ball', ball),
                Placement('my_ball', ball),
                Placement('UNION', Solid.empty()),
                Placement('3rd', ball),
            ]
        )
    )
    assert [placement.name for placement in scene.placements] == ['my_ball', 'my_ball_2', '_UNION', '_3rd']


def test_what_the_language_cannot_say_is_refused():
    camera = PinholeCamera.centred(64, 64, 50.0)
    with pytest.raises(ValueError, match='scale 2'):
        format_scene(Scene([], camera=camera, camera_T_scene=Pose(scale=2.0)))
    picture = np.zeros((2, 2), dtype=np.uint8)
    with pytest.raises(ValueError, match='a texture that comes from no file'):
        format_scene(Scene(Solid.sphere(0.1).textured(Texture(picture, 'planar', (1.0, 1.0)))))
    with pytest.raises(ValueError, match='an environment that comes from no file'):
        format_scene(Scene([], environment=Environment(picture)))
    with pytest.raises(ValueError, match='has no camera'):
        format_scene(Scene([], camera_T_scene=Pose(np.eye(3), [1.0, 0.0, 0.0])))
