"""Poses measured and followed with the mesh of a part: those with the solid that it is of."""

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from csg_renderer import Light, Scene, SolidOutline, load_known_models, load_models, render_stereo
from csg_renderer.raycast.sensor import SensorModel
from model_matcher.image_pose.measurement import measure_pose
from model_matcher.image_pose.presence import bent
from model_matcher.image_pose.views import Views
from model_matcher.match_cli import main
from model_matcher.model.library import load_library
from model_matcher.node_answers import collision_shapes
from model_matcher.tracking.tracker import Tracker
from msgs_py import PinholeCamera, Pose, StereoRig

MESHES = Path(__file__).parents[2] / 'csg_renderer' / 'test' / 'meshes'
LIGHTS = [Light((0.3, -0.5, 0.2), (0.8,) * 3), Light((-0.5, -0.2, -0.3), (0.3,) * 3)]


@cache
def part(name):
    """A solid, its outline, and that of its mesh."""
    solid = next(iter(load_models(name).values()))
    return solid, SolidOutline(solid), load_known_models(MESHES / f'{name}.stl')[name].outline


def rig_for(shape, size=(512, 512), focal=700.0):
    return StereoRig.symmetric(PinholeCamera.centred(*size, focal), 0.7 * shape.size)


def before(rig, shape, rotation, shift=(0.0, 0.0, 0.0)):
    """A pose before a rig, shifted by parts of the shape's size."""
    place = np.array([0.5 * rig.baseline, 0.0, 4.0 * shape.size]) + shape.size * np.array(shift)
    return Pose(rotation, place - rotation @ shape.centre)


def pictures(solid, pose, rig, seed):
    scene = Scene([solid.transformed(pose)], LIGHTS, (0.2,) * 3, (0.4,) * 3)
    frames = render_stereo(scene, rig, antialias=2, psf=0.5)
    return [SensorModel(0.5, 2.0, (seed, eye)).picture(frame, monochrome=True) for eye, frame in enumerate(frames)]


@pytest.mark.parametrize(('name', 'seed'), [('plug', 1), ('widget', 2), ('cylinder_box', 5), ('cylinder_box', 7)])
def test_the_pose_is_that_measured_with_the_solid(name, seed):
    solid, shape, mesh = part(name)
    rig = rig_for(shape)
    pose = before(rig, shape, Rotation.random(random_state=seed).as_matrix())
    views = Views.of(pictures(solid, pose, rig, seed), rig)
    near = Pose.from_rotation_vector([0.01, -0.02, 0.01], 0.004 * shape.size * np.ones(3))
    start = Pose(pose.rotation @ near.rotation, pose.translation + near.translation)
    one, other = (measure_pose(outline, start, Views.of(views.images, rig)) for outline in (shape, mesh))
    assert one.reason is None and other.reason is None
    turn = Rotation.from_matrix(other.pose.rotation @ one.pose.rotation.T).as_rotvec()
    between = other.pose.apply(shape.centre) - one.pose.apply(shape.centre)
    # The same pictures: what lies between them is the meshes' doing, and less than the sigmas of both together.
    arm = one.pose.apply(shape.centre) - one.pose.translation
    cross = np.cross(np.eye(3), arm)
    about = np.block([[np.eye(3), -cross.T], [np.zeros((3, 3)), np.eye(3)]])
    turns, shifts = np.sqrt(
        [[np.diag(c)[3:], np.diag(about @ c @ about.T)[:3]] for c in (one.covariance, other.covariance)]
    ).sum(axis=0)
    assert (np.abs(turn) < turns).all()
    assert (np.abs(between) < shifts).all()
    assert other.presence.log_ratio == pytest.approx(one.presence.log_ratio, rel=0.15)
    assert other.presence.support == pytest.approx(one.presence.support, abs=0.06)


def test_an_edge_is_straight_though_views_have_its_points_in_common_but_for_rounding():
    """As two cameras side by side see an edge of a mesh: points of one lie on points of the other."""
    rng = np.random.default_rng(0)
    along = np.linspace(0.0, 1.0, 6)[:, None] * [0.01, 0.02, 0.005] + [0.1, 0.2, 0.3]
    turn = np.linspace(0.0, 0.4, 6)
    arc = 0.05 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(6)])
    for line, wanted in ((along, False), (arc, True)):
        for count in (1, 2, 6):
            points = np.concatenate([line[:count], line])
            points[:count] += 1e-17 * rng.normal(size=(count, 3)).round()
            points = points * (1.0 + 2e-16 * rng.integers(-1, 2, points.shape))
            found = bent(points, np.zeros(len(points), np.int32), np.zeros(len(points)))
            assert found.tolist() == [wanted]


def test_a_mesh_is_followed():
    solid, _, mesh = part('widget')
    rig = rig_for(mesh, (320, 240), 420.0)
    poses = [
        before(rig, mesh, Rotation.from_euler('xy', [25, 30 + 1.5 * k], degrees=True).as_matrix(), (0.01 * k, 0, 0))
        for k in range(10)
    ]
    tracker = Tracker(mesh, poses[0])
    for frame, pose in enumerate(poses):
        found = tracker(pictures(solid, pose, rig, frame), rig)
        assert found is not None
        assert pose.error_to(found).rotation_deg < 0.3
        assert np.linalg.norm(pose.apply(mesh.centre) - found.apply(mesh.centre)) < 3e-3 * mesh.size
    assert tracker.renewed < 10


def test_match_accepts_a_mesh_by_what_the_images_show(tmp_path, capsys):
    """A machined part of CAD in millimetres, and a pair of pictures of it."""
    trimesh = pytest.importorskip('trimesh')
    solid, shape, _ = part('widget')
    rig = rig_for(shape)
    pose = before(rig, shape, Rotation.from_euler('yx', [140, 25], degrees=True).as_matrix())
    for side, image in zip(('left', 'right'), pictures(solid, pose, rig, 3)):
        cv2.imwrite(str(tmp_path / f'{side}.png'), image)
    camera = rig.left
    record = {
        'size': [camera.width, camera.height],
        'K': [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
        'baseline': rig.baseline,
    }
    (tmp_path / 'camera.json').write_text(json.dumps(record))
    mesh = trimesh.load(str(MESHES / 'widget.stl'), force='mesh')
    mesh.apply_scale(1e3)
    mesh.export(tmp_path / 'part.stl')
    files = [str(tmp_path / name) for name in ('part.stl', 'left.png', 'right.png', 'camera.json')]
    assert main([*files, '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    (found,) = said['found']
    assert found['support'] > 0.6  # what the images confirm
    at = Pose.from_quaternion(found['orientation_xyzw'], found['position'])
    assert pose.error_to(at).rotation_deg < 0.1
    np.testing.assert_allclose(at.translation, pose.translation, atol=5e-4 * shape.size)


def test_a_planner_gets_the_mesh_of_a_mesh():
    index = load_library([str(MESHES / 'plug.stl')], 'm').models[0]
    shapes = collision_shapes(index)
    (mesh,) = shapes.meshes
    assert shapes.primitives == () and shapes.note is None
    assert len(mesh.triangles) == 76
    np.testing.assert_allclose(mesh.vertices.max(axis=0), part('plug')[1].box[1], atol=1e-7)
