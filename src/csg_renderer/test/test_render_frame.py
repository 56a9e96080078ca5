"""The contract of render(): Frame outputs, closed forms, errors. Any engine must keep it."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from csg_renderer import (
    Frame,
    Light,
    Placement,
    Scene,
    Solid,
    Surface,
    default_camera,
    default_rig,
    render,
    render_stereo,
)
from msgs_py import PinholeCamera, Pose

ENGINES = ['native', 'reference']


def xrot(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def yrot(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


# DESIGN section 7, L-shape view 1: row form, so the column form is the transpose.
POSE = Pose((yrot(40) @ xrot(-30)).T, [0.010, -0.030, 0.150])
L_SHAPE = Solid.block(-0.05, 0.02, -0.03) | Solid.block(-0.02, 0.05, -0.03)


def at(x, y, z, rotation=None):
    return Pose(np.eye(3) if rotation is None else rotation, [x, y, z])


@pytest.mark.parametrize('engine', ENGINES)
def test_depth_of_l_shape_is_the_ray_plane_answer(engine):
    camera = default_camera()
    frame = render(Scene(L_SHAPE.transformed(POSE), [Light((0, 0, 0))]), camera, engine=engine)
    assert frame.mask.sum() > 20_000
    # Each visible point lies on the face plane its ids name: n . (z ray) = n . p for any p of the face.
    rays = camera.rays(camera.pixel_grid())
    sizes = [np.array([-0.05, 0.02, -0.03]), np.array([-0.02, 0.05, -0.03])]
    for primitive in (0, 1):
        for face in range(6):
            seen = (frame.primitive_id == primitive) & (frame.face_id == face)
            normal = POSE.rotation[:, face // 2]
            corner = POSE.apply(np.eye(3)[face // 2] * (sizes[primitive] if face % 2 else 0.0))
            expected = (normal @ corner) / (rays[seen] @ normal)
            assert np.abs(frame.depth[seen] - expected).max(initial=0.0) < 1e-6
            towards = np.einsum('ni,i->n', frame.normal[seen], normal)
            assert np.abs(np.abs(towards) - 1.0).max(initial=0.0) < 1e-6


@pytest.mark.parametrize('engine', ENGINES)
def test_outputs_have_the_stated_types_and_backgrounds(engine):
    camera = PinholeCamera.centred(70, 50, 80.0)
    scene = Scene(Solid.sphere(0.1).transformed(at(0, 0, 0.5)), [Light((0, 0, 0))], background=(0.2, 0.4, 1.0))
    frame = render(scene, camera, engine=engine)
    assert isinstance(frame, Frame)
    assert (frame.image.shape, frame.image.dtype) == ((50, 70, 3), np.uint8)
    assert (frame.depth.shape, frame.depth.dtype) == ((50, 70), np.float32)
    assert (frame.normal.shape, frame.normal.dtype) == ((50, 70, 3), np.float32)
    assert (frame.camera_normal.shape, frame.camera_normal.dtype) == ((50, 70, 3), np.float32)
    empty = ~frame.mask
    assert empty[0, 0] and not empty[25, 35]
    for ids in (frame.primitive_id, frame.face_id, frame.object_id):
        assert (ids.shape, ids.dtype) == ((50, 70), np.int32)
        assert (ids[empty] == -1).all() and (ids[~empty] >= 0).all()
    assert np.isnan(frame.depth[empty]).all() and np.isfinite(frame.depth[~empty]).all()
    assert np.isnan(frame.normal[empty]).all()
    assert np.allclose(np.linalg.norm(frame.normal[~empty], axis=-1), 1.0, atol=1e-6)
    assert (frame.image[empty] == [51, 102, 255]).all()
    assert frame.stats.seconds > 0 and frame.stats.intersections > 0


@pytest.mark.parametrize('engine', ENGINES)
def test_a_cut_face_is_the_cutters_and_its_normal_leaves_the_solid(engine):
    # A pit in the near face of a plate: its floor, at z = 0.45, is the cutter's far face.
    plate = Solid.block(0.4, 0.4, 0.1).transformed(at(-0.2, -0.2, 0.4))
    pit = Solid.block(0.1, 0.1, 0.1).transformed(at(-0.05, -0.05, 0.35))
    frame = render(Scene(plate - pit), default_camera(64), engine=engine)
    assert frame.primitive_id[32, 32] == 1 and frame.face_id[32, 32] == 5
    assert frame.depth[32, 32] == pytest.approx(0.45, abs=1e-6)
    assert np.allclose(frame.normal[32, 32], [0, 0, -1], atol=1e-6)
    assert frame.primitive_id[32, 2] == 0 and frame.face_id[32, 2] == 4


@pytest.mark.parametrize('engine', ENGINES)
def test_object_ids_count_solids_and_primitive_ids_count_leaves(engine):
    a = Solid.sphere(0.05) - Solid.sphere(0.01)
    b = Solid.cone(0.05, (0, 0.1, 0))
    scene = Scene([a.transformed(at(-0.1, 0, 0.5)), b.transformed(at(0.1, -0.05, 0.5))])
    frame = render(scene, default_camera(64), engine=engine)
    assert set(np.unique(frame.primitive_id)) == {-1, 0, 2}
    assert (frame.object_id[frame.primitive_id == 0] == 0).all()
    assert (frame.object_id[frame.primitive_id == 2] == 1).all()


@pytest.mark.parametrize('engine', ENGINES)
def test_world_to_camera_moves_the_camera_and_normals_stay_in_the_scene_frame(engine):
    solid = L_SHAPE
    camera = default_camera(96)
    inside = render(Scene(solid.transformed(POSE)), camera, engine=engine)
    outside = render(Scene(solid), camera, POSE, engine=engine)
    assert np.array_equal(inside.primitive_id, outside.primitive_id)
    seen = inside.mask
    assert np.allclose(inside.depth[seen], outside.depth[seen], atol=1e-7)
    assert np.allclose(outside.camera_normal[seen], inside.normal[seen], atol=1e-6)
    assert np.allclose(np.abs(outside.normal[seen]).max(axis=-1), 1.0, atol=1e-6)


@pytest.mark.parametrize('engine', ENGINES)
def test_stereo_disparity_is_that_of_the_rig(engine):
    scene = Scene(Placement('wall', Solid.block(0.1, 0.1, 1e-4), at(-0.05, -0.05, 0.5).matrix), [Light((0, 0, 0))])
    rig = default_rig(scene, default_camera(128))
    assert rig.baseline == pytest.approx(0.1)
    left, right = render_stereo(scene, rig, engine=engine)
    shift = rig.disparity(0.5)
    edges = [np.flatnonzero(frame.mask[64])[[0, -1]] for frame in (left, right)]
    assert np.abs(edges[0] - edges[1] - shift).max() <= 1.0
    single = render(scene, rig.right, at(-rig.baseline, 0, 0), engine=engine)
    assert np.array_equal(right.image, single.image) and np.array_equal(right.primitive_id, single.primitive_id)


@pytest.mark.parametrize('threads', [1, 2, 5])
@pytest.mark.parametrize('options', [{}, {'antialias': True}, {'levels': 2, 'shadows': True}])
def test_a_pair_rendered_by_many_threads_is_its_two_images(threads, options):
    scene = Scene(
        [L_SHAPE.transformed(POSE), Solid.sphere(0.02).transformed(at(0.05, 0.02, 0.3))], [Light((0.2, -0.3, 0))]
    )
    rig = default_rig(scene, default_camera(120))
    pair = render_stereo(scene, rig, threads=threads, **options)
    for frame, pose in zip(pair, (Pose.identity(), at(-rig.baseline, 0, 0))):
        single = render(scene, rig.left, pose, threads=1, **options)
        assert np.array_equal(frame.image, single.image) and np.array_equal(frame.depth, single.depth, equal_nan=True)
        assert (frame.stats.tiles, frame.stats.intersections) == (single.stats.tiles, single.stats.intersections)


def test_what_goes_wrong_in_one_eye_is_raised_and_nobody_waits_for_it(monkeypatch):
    scene = Scene(L_SHAPE.transformed(POSE))
    rig = default_rig(scene, default_camera(64))
    monkeypatch.setattr('csg_renderer.raycast.engine_native.plan_of', lambda *arguments: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        render_stereo(scene, rig, threads=2)
    monkeypatch.undo()
    assert render_stereo(scene, rig, threads=2)[1].mask.any()


def test_pairs_may_be_rendered_from_several_threads_at_once():
    scene = Scene(L_SHAPE.transformed(POSE))
    rig = default_rig(scene, default_camera(64))
    expected = render_stereo(scene, rig)[1].image
    with ThreadPoolExecutor(6) as pool:
        for pair in pool.map(lambda k: render_stereo(scene, rig, threads=2), range(60)):
            assert np.array_equal(pair[1].image, expected)


@pytest.mark.parametrize('engine', ENGINES)
def test_an_empty_scene_is_background(engine):
    for scene in (Scene([]), Scene(Solid.empty()), Scene(Solid.sphere(0.1).transformed(at(0, 0, -1)))):
        frame = render(scene, default_camera(40), engine=engine)
        assert not frame.mask.any() and (frame.image == 0).all()


@pytest.mark.parametrize('engine', ENGINES)
def test_one_light_on_one_plane_follows_the_stated_formula(engine):
    surface = Surface((0.5, 0.6, 0.7), ambient=0.5, diffuse=0.6, specular=0.3, shininess=10)
    wall = Solid.block(2, 2, 1).transformed(at(-1, -1, 1)).painted(surface)
    light = Light((0.3, -0.2, 0.1), (0.9, 0.8, 0.7))
    camera = PinholeCamera.centred(65, 65, 60.0)
    frame = render(Scene(wall, [light], ambient_light=(0.1, 0.2, 0.3)), camera, engine=engine)
    point = camera.rays(camera.pixel_grid())  # the wall is at z = 1
    to_light = np.array(light.position) - point
    to_light /= np.linalg.norm(to_light, axis=-1, keepdims=True)
    ray = point / np.linalg.norm(point, axis=-1, keepdims=True)
    mirrored = ray * [1, 1, -1]
    facing = -to_light[..., 2:]
    glint = np.maximum((mirrored * to_light).sum(axis=-1, keepdims=True), 0.0) ** 10
    colour = np.array(surface.colour)
    expected = 0.5 * colour * [0.1, 0.2, 0.3] + (0.6 * facing * colour + 0.3 * glint) * light.colour
    assert np.abs(frame.image - expected.clip(0, 1) * 255).max() <= 0.51


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [
        ({'engine': 'fast'}, 'engine'),
        ({'levels': 0}, 'levels'),
        ({'antialias': 1.5}, 'antialias'),
        ({'tile_size': 1}, 'tile_size'),
        ({'antialias': 99}, 'antialias'),
    ],
)
def test_misuse_names_the_argument(arguments, name):
    with pytest.raises(ValueError, match=name):
        render(Scene([]), default_camera(8), **arguments)


def test_no_scene_is_a_type_error():
    with pytest.raises(TypeError, match='scene'):
        render(L_SHAPE)


def test_a_baseline_that_cannot_be_guessed_is_refused_by_name():
    with pytest.raises(ValueError, match='baseline'):
        default_rig(Scene([]))
