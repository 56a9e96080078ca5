"""The array-machine engine gives the other engines' image, and charges the machine for it."""

import numpy as np
import pytest

from csg_renderer import Light, Scene, Solid, Surface, render
from csg_renderer.raycast.engine_dap import render as render_dap
from csg_renderer.raycast.frame import RenderOptions
from dap_emulator import Dap
from msgs_py import PinholeCamera, Pose

CAMERA = PinholeCamera.centred(70, 50, 90.0)
AT = Pose(np.eye(3), (0.0, 0.0, 4.0))


def turned(solid, degrees, offset=(0.0, 0.0, 0.0)):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return solid.transformed(
        Pose(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), offset)
    )


def scene(*solids, **options):
    lights = [Light((-3.0, -4.0, -5.0), (0.9, 0.8, 0.7)), Light((4.0, -1.0, -2.0), (0.3, 0.3, 0.4))]
    return Scene(solids, lights, background=(0.1, 0.2, 0.3), **options)


SHINY = Surface((0.8, 0.3, 0.2), specular=0.5, shininess=12)
SOLIDS = {
    'block': turned(Solid.block(1.0, 1.2, 0.8), 35),
    'cylinder': turned(Solid.cylinder(0.6, (0.0, 1.4, 0.0)), 25).painted(SHINY),
    'cone': turned(Solid.cone(0.8, (0.3, 1.3, 0.2)), 40),
    'sphere': Solid.sphere(0.9).painted(SHINY),
    'half-space': Solid.plane((0.1, -1.0, 0.0), -0.8),
    'half-space about the camera': Solid.plane((0.1, -1.0, 0.2), 0.8),
    'room about the camera': Solid.block(3.0, 3.0, 9.0).transformed(Pose(np.eye(3), (-1.4, -1.2, -6.0))),
    'difference': turned(Solid.block(1.2, 1.2, 1.2) - Solid.cylinder(0.4, (1.2, 1.2, 1.2)), 30),
    'intersection': turned(Solid.sphere(1.0) & Solid.block(1.0, 1.0, -1.0), 20),
    'union of touching blocks': turned(Solid.block(0.8, 0.8, 0.8) | Solid.block(-0.6, 0.8, 0.8), 30),
    'cut by a coincident face': turned(Solid.block(1.0, 1.0, 1.0) - Solid.block(0.5, 0.5, 1.0), 50),
    'nested': turned((Solid.block(1, 1, 1) - (Solid.sphere(0.9) - Solid.sphere(0.5))) | Solid.sphere(0.2), 30),
}


def assert_same(ours, theirs):
    for name in ('primitive_id', 'face_id', 'object_id', 'image'):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name
    assert np.allclose(ours.depth, theirs.depth, rtol=1e-6, equal_nan=True)
    assert np.allclose(ours.normal, theirs.normal, atol=1e-6, equal_nan=True)


@pytest.mark.parametrize('name', SOLIDS)
def test_same_image_ids_depth_and_normals_as_native(name):
    one = scene(SOLIDS[name])
    assert_same(render(one, CAMERA, AT, engine='dap'), render(one, CAMERA, AT))


@pytest.mark.parametrize(
    'options',
    [
        {'tiling': False},
        {'tile_size': 8},
        {'antialias': True},
        {'antialias': 2, 'every_pixel': True},
        {'shadows': True},
        {'levels': 3, 'shadows': True},
    ],
    ids=str,
)
def test_same_image_with_every_option(options):
    glass = Surface((0.3, 0.6, 0.9), reflection=0.3, transparency=0.4, specular=0.4, shininess=7.5)
    one = scene(
        turned(SOLIDS['block'], 10, (-0.9, 0.0, 0.5)).painted(glass),
        Solid.sphere(0.7).painted(SHINY),
        turned(SOLIDS['cone'], 5, (0.9, 0.2, 1.0)),
    )
    ours, theirs = render(one, CAMERA, AT, engine='dap', **options), render(one, CAMERA, AT, **options)
    assert np.array_equal(ours.primitive_id, theirs.primitive_id)
    difference = np.abs(ours.image.astype(int) - theirs.image)
    assert difference.max() <= 1 and (difference > 0).mean() < 0.002


def test_the_machine_is_charged_and_tiles_pay():
    one = scene(SOLIDS['block'])
    tiled, brute = (render(one, CAMERA, AT, engine='dap', tiling=tiling).stats for tiling in (True, False))
    assert 0 < tiled.dap_cycles < brute.dap_cycles
    assert render(one, CAMERA, AT, engine='dap').stats.dap_cycles == tiled.dap_cycles


def test_short_words_are_cheaper_and_show_the_same_surfaces():
    one = scene(SOLIDS['difference'])
    long, short = (render_dap(one, CAMERA, AT, RenderOptions(), length=length) for length in (8, 4))
    assert short.stats.dap_cycles < 0.5 * long.stats.dap_cycles
    assert (long.primitive_id != short.primitive_id).mean() < 0.002


def test_a_machine_that_is_too_small_says_so_by_name():
    with pytest.raises(ValueError, match=r"engine: 'dap' is out of store: .* bit-planes.*; tiles of 32 pixels"):
        render_dap(scene(SOLIDS['nested']), CAMERA, AT, RenderOptions(), Dap.model('510', memory_bits_per_pe=1024))


def test_an_empty_scene_is_background():
    frame = render(scene(), CAMERA, AT, engine='dap')
    assert (frame.image == [26, 51, 77]).all() and not frame.mask.any()
