"""Ray casting on a machine that computes on bit-planes: a tile of 32 x 32 rays in REAL*4, intersections and shading."""

import time

import numpy as np
import pytest

from csg_renderer import load_scene, scene_path
from csg_renderer.raycast import engine_dap
from csg_renderer.raycast.frame import RenderOptions
from csg_renderer.raycast.render import default_rig
from dap_emulator import Dap
from msgs_py import PinholeCamera


@pytest.mark.parametrize('name', ['l_shape_v1', 'cylinder_box_v1'])
def test_a_tile_is_the_same_on_bit_planes_and_quick(name):
    """The same surfaces, depths within a few roundings; the aim is 10 s of this computer's time."""
    scene = load_scene(scene_path(name))
    full = default_rig(scene).left
    scale = 32 / full.width
    camera = PinholeCamera(32, 32, full.fx * scale, full.fy * scale, 15.5, 15.5)
    frames, machines = [], []
    started = time.process_time()
    for arithmetic in ('words', 'bits'):
        machines.append(Dap.model('510', arithmetic=arithmetic))
        frames.append(
            engine_dap.render(scene, camera, scene.camera_T_scene, RenderOptions(), dap=machines[-1], length=4)
        )
    assert time.process_time() - started < 10
    fast, slow = frames
    assert (fast.primitive_id >= 0).sum() > 100
    assert np.array_equal(fast.primitive_id, slow.primitive_id) and np.array_equal(fast.face_id, slow.face_id)
    np.testing.assert_allclose(slow.depth, fast.depth, rtol=16 * 2.0**-20)
    assert np.abs(slow.image.astype(int) - fast.image).max() <= 1
    words, planes = machines
    assert words.cycles == planes.cycles
    # REALs take between one and two times what the table has for them (docs/dap.md), whole programs as well.
    assert 1.2 < planes.counted_cycles / planes.cycles < 2.0
