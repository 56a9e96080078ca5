"""Boxes that packets of rays go down: along which axes they lie, and that none is passed by that one ray meets."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, render
from csg_renderer.raycast.hierarchy import boxes_of
from csg_renderer.raycast.kernels.packets import BOUNDS, FIRST, MEETING_PARTS, PACKETS, cut, first_places, invert_bounds
from csg_renderer.raycast.kernels.rows import HIT, STRIDE
from csg_renderer.raycast.programs.program import program_of
from csg_renderer.raycast.settings import PACKET
from msgs_py import PinholeCamera, Pose

TILTED = Pose.from_rotation_vector([0.6, 0.3, -0.2], [0.1, 0.0, 1.0])


def board(x, y, z):
    return Solid.block(0.4, 0.02, 0.3).transformed(Pose(np.eye(3), [x, y, z]))


def test_boxes_lie_along_the_axes_that_most_of_the_surface_has():
    solids = [board(0.0, 0.1 * k, 0.0).transformed(TILTED) for k in range(4)]
    solids.append(Solid.block(0.05, 0.05, 0.05))
    box, hierarchy = boxes_of(program_of(Scene(solids)))
    sizes = np.sort(box[3:, :4] - box[:3, :4], axis=0)
    assert np.allclose(sizes, np.array([[0.02], [0.3], [0.4]]), atol=1e-7)
    assert np.allclose(hierarchy.frame @ hierarchy.frame.T, np.eye(3))


def test_boxes_lie_along_the_scenes_axes_where_those_are_better():
    # What is taken away may have the largest surface, but no box.
    cutter = Solid.block(2.0, 2.0, 2.0).transformed(TILTED)
    solids = [Solid.block(0.1, 0.02, 0.3).transformed(Pose(np.eye(3), [0.2 * k, 0.0, 1.0])) - cutter for k in range(3)]
    box, hierarchy = boxes_of(program_of(Scene(solids)))
    assert np.array_equal(hierarchy.frame, np.eye(3))
    assert np.allclose(box[3:] - box[:3], np.array([[0.1], [0.02], [0.3]]), atol=1e-7)


@pytest.mark.parametrize('seed', range(30))
def test_a_packet_meets_a_box_no_later_than_each_of_its_rays(seed):
    random = np.random.default_rng(seed)
    origins = random.normal(size=(PACKET, 3)) * random.choice([0.01, 0.3, 2.0])
    directions = random.normal(size=3) + random.normal(size=(PACKET, 3)) * random.choice([0.01, 0.3, 2.0])
    low = random.normal(size=(60, 3)) * 2.0
    high = low + 0.2 + random.exponential(size=(60, 3))
    with np.errstate(divide='ignore'):
        a, b = ((side - origins[:, None]) / directions[:, None] for side in (low, high))
    enter = np.maximum(np.minimum(a, b).max(axis=2), 0.0)
    meets = enter <= np.maximum(a, b).min(axis=2)
    bounds = np.zeros((PACKETS + 1, BOUNDS))
    bounds[:, :12] = np.concatenate([f(axis=0) for v in (origins, directions) for f in (v.min, v.max)])
    invert_bounds(bounds, 1)
    work = np.zeros(MEETING_PARTS * STRIDE)
    for axis in range(3):
        work[STRIDE * axis : STRIDE * axis + 60] = low[:, axis]
        work[STRIDE * (3 + axis) : STRIDE * (3 + axis) + 60] = high[:, axis]
    first_places(bounds, 0, 1e30, work, np.uint64(60))
    place = work[int(FIRST) : int(FIRST) + 60]
    earliest = np.where(meets, enter, np.inf).min(axis=0)
    assert (place <= earliest * (1.0 + 1e-12) + 1e-12).all()


@pytest.mark.parametrize('faces', [1, 2, 7, 40, 256])
def test_packets_hold_every_ray_once_and_one_face_where_they_can(faces):
    for n in (1, 15, 16, 17, 100, STRIDE):
        s = np.zeros(int(HIT) + STRIDE)
        s[int(HIT) : int(HIT) + n] = np.sort(np.arange(n) % faces)
        start = np.zeros(PACKETS + 1, dtype=np.int64)
        count = cut(s, np.uint64(n), start)
        sizes = np.diff(start[: count + 1])
        assert start[0] == 0 and start[count] == n and sizes.max() <= PACKET
        assert (sizes[:-1] >= PACKET // 2).all() and count <= PACKETS


def test_a_tilted_scene_takes_hardly_more_work_than_an_upright_one():
    mirror = Surface((0.5, 0.5, 0.5), reflection=0.3)
    scene = Scene([board(0.0, 0.12 * k, 1.0).painted(mirror) for k in range(5)], [Light((0.3, -2.0, 0.2))])
    camera = PinholeCamera.centred(96, 96, 120.0)
    view = Pose.from_rotation_vector([-0.3, 0.2, 0.0], [-0.1, 0.1, 0.2])
    turned = Scene([solid.transformed(TILTED) for solid in scene.solids], [Light(TILTED.apply([0.3, -2.0, 0.2]))])
    upright, tilted = (
        render(one, camera, pose, levels=4, shadows=True)
        for one, pose in ((scene, view), (turned, view.compose(TILTED.inverse())))
    )
    assert np.abs(upright.image.astype(int) - tilted.image).max() <= 1
    assert tilted.stats.intersections <= 1.05 * upright.stats.intersections
