"""The command line: scenes to pictures, arrays, cameras and meshes."""

import json
import os
import sys

import cv2
import numpy as np
import pytest

from csg_renderer import load_scene, parse_scene, render, scene_names
from csg_renderer.raycast.outputs import id_picture
from csg_renderer.render_cli import main, turned
from csg_renderer.scene import mesh_export

BALL = 'DRAW SPHERE (20) COLOUR (1, 0, 0) AT (0, 0, 100); AMBIENT (1);\n'


@pytest.fixture
def scene_file(tmp_path):
    file = tmp_path / 'ball.csg'
    file.write_text(BALL)
    return file


def test_a_picture_is_what_render_returns(tmp_path):
    assert main(['l_shape_v1', '-o', str(tmp_path / 'out.png'), '-q']) == 0
    expected = render(load_scene('l_shape_v1')).image
    assert np.array_equal(cv2.imread(str(tmp_path / 'out.png'))[..., ::-1], expected)


def test_everything_can_be_written_of_both_eyes(tmp_path):
    out = str(tmp_path / 'a' / 'out.png')
    assert (
        main(
            [
                'l_shape_v1',
                '-o',
                out,
                '--stereo',
                '--depth',
                '--ids',
                '--normals',
                '--npz',
                '--camera',
                '--size',
                '64x48',
                '-q',
            ]
        )
        == 0
    )
    names = {path.name for path in (tmp_path / 'a').iterdir()}
    assert names == {
        f'out_{eye}{rest}'
        for eye in ('left', 'right')
        for rest in ('.png', '_depth.png', '_ids.png', '_normals.png', '.npz', '.json')
    }
    data = np.load(tmp_path / 'a' / 'out_right.npz')
    assert data['depth'].shape == (48, 64) and set(data) >= {'image', 'normal', 'primitive_id', 'face_id', 'object_id'}
    camera = json.loads((tmp_path / 'a' / 'out_right.json').read_text())
    assert camera['camera_T_scene'][0] == [1.0, 0.0, 0.0, -0.03] and camera['baseline'] == pytest.approx(0.03)
    assert np.allclose(camera['K'], data['K'])


def test_arrays_alone(scene_file, tmp_path):
    assert main([str(scene_file), '-o', str(tmp_path / 'out.npz'), '--size', '33', '-q']) == 0
    data = np.load(tmp_path / 'out.npz')
    assert data['depth'][16, 16] == pytest.approx(0.08)
    assert not (tmp_path / 'out.png').exists()


def test_the_default_output_is_named_after_the_scene(scene_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([str(scene_file), '--size', '16', '-q']) == 0
    assert cv2.imread('ball.png').shape == (16, 16, 3)


def test_options_reach_the_renderer(scene_file, tmp_path):
    out = tmp_path / 'out.png'
    for extra in (
        ['--engine', 'reference'],
        ['--no-tiling'],
        ['--shadows', '--levels', '2'],
        ['--antialias'],
        ['--antialias', '2'],
        ['--noise', '3', '--seed', '4', '--psf', '1'],
        ['--focal', '40'],
    ):
        assert main([str(scene_file), '-o', str(out), '--size', '32', '-q', *extra]) == 0
    assert main([str(scene_file), '-o', str(out), '--size', '32', '-q', '--levels', '0']) == 2


def test_a_turntable_is_a_full_turn(tmp_path):
    assert main(['l_shape_v1', '-o', str(tmp_path / 't.png'), '--turntable', '4', '--size', '48', '-q']) == 0
    pictures = [cv2.imread(str(tmp_path / f't_00{k}.png')) for k in range(4)]
    assert all(not np.array_equal(pictures[0], other) for other in pictures[1:])
    scene = load_scene('coverplate')
    assert turned(scene, 2.0 * np.pi).error_to(scene.camera_T_scene).rotation < 1e-9
    up = scene.camera_T_scene.rotate([0.0, 1.0, 0.0])
    assert np.allclose(turned(scene, 1.0).rotate([0.0, 1.0, 0.0]), up)  # the scene's vertical stays


def test_mistakes_are_one_clear_message(scene_file, tmp_path, capsys):
    scene_file.write_text('DRAW BLOK (1, 2, 3);')
    assert main([str(scene_file)]) == 2
    assert "ball.csg:1:6: 'BLOK'" in capsys.readouterr().err
    assert main(['no_such_scene']) == 2
    assert "no scene 'no_such_scene'" in capsys.readouterr().err
    scene_file.write_text(BALL)
    assert main([str(scene_file), '-o', str(tmp_path / 'out.xyz'), '--size', '9', '-q']) == 2
    assert 'no such picture format' in capsys.readouterr().err
    with pytest.raises(SystemExit, match='2'):
        main([str(scene_file), '--size', 'big'])
    assert 'expected WIDTHxHEIGHT' in capsys.readouterr().err
    with pytest.raises(SystemExit, match='2'):
        main([])


def test_warnings_do_not_stop_it(scene_file, tmp_path, capsys):
    scene_file.write_text('spare = 3;' + BALL)
    assert main([str(scene_file), '-o', str(tmp_path / 'o.png'), '--size', '9', '-q']) == 0
    assert 'warning: ' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('DRAW BLOCK (9, 9, 9);', ['within or beside', 'no LIGHT']),
        ('DRAW BLOCK (9, 9, 9) AT (0, 0, -50);', ['behind', 'no LIGHT']),
        ('LIGHT (0, -90, 0); DRAW BLOCK (9, 9, 9) AT (0, 0, 50);', []),
        ('ENVIRONMENT "studio.png"; DRAW BLOCK (9, 9, 9) AT (0, 0, 50);', []),
    ],
)
def test_what_makes_a_poor_picture_is_hinted_at(scene_file, tmp_path, capsys, text, expected):
    scene_file.write_text(text)
    assert main([str(scene_file), '-o', str(tmp_path / 'o.png'), '--size', '9', '-q']) == 0
    hints = [line for line in capsys.readouterr().err.splitlines() if line.startswith('hint: ')]
    assert len(hints) == len(expected) and all(part in line for part, line in zip(expected, hints))


def test_the_list_and_the_printed_scene(capsys):
    assert main(['--list']) == 0
    assert capsys.readouterr().out.split() == scene_names()
    assert main(['l_shape_v1', '--print']) == 0
    assert len(parse_scene(capsys.readouterr().out).primitives) == 2


def test_watch_renders_again_and_survives_a_typo(scene_file, tmp_path, capsys):
    from csg_renderer import render_cli

    part = tmp_path / 'part.csg'
    part.write_text('ball = SPHERE (20);')
    scene_file.write_text('INCLUDE "part.csg"; DRAW ball AT (0, 0, 100);')
    out = tmp_path / 'out.npz'
    steps = iter(
        [
            (scene_file, 'DRAW BOLL;'),
            (scene_file, 'INCLUDE "part.csg"; DRAW ball AT (0, 0, 200);'),
            (part, 'ball = SPHERE (50);'),
            None,
        ]
    )
    depths = []

    def next_step(_seconds):
        depths.append(round(float(np.load(out)['depth'][8, 8]), 4))
        step = next(steps)
        if step is None:
            raise KeyboardInterrupt
        file, text = step
        file.write_text(text)
        os.utime(file, ns=(0, len(depths) * 10**9))

    options = render_cli.render_parser().parse_args([str(scene_file), '-o', str(out), '--size', '17', '--watch', '-q'])
    assert render_cli.watch(options, wait=next_step) == 0
    assert depths == [0.08, 0.08, 0.18, 0.15]
    assert "'BOLL' is not defined" in capsys.readouterr().err


def test_ids_have_colours_of_their_own():
    picture = id_picture(np.array([[-1, 0, 1], [2, 3, 4]]))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 6
    assert (picture[0, 0] == 0).all()
    assert (id_picture(np.full((2, 2), -1)) == 0).all()


def test_a_missing_mesh_library_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'manifold3d', None)
    assert main(['l_shape', '--export', str(tmp_path / 'l.stl')]) == 2
    assert 'manifold3d is missing (pip install' in capsys.readouterr().err
    assert main(['l_shape', '--export', str(tmp_path / 'l.step')]) == 2
    assert "unknown format '.step'" in capsys.readouterr().err


@pytest.mark.parametrize('suffix', mesh_export.FORMATS)
def test_meshes_have_the_volume_of_the_solid(tmp_path, suffix, capsys):
    pytest.importorskip('manifold3d')
    trimesh = pytest.importorskip('trimesh')
    file = tmp_path / f'l{suffix}'
    assert main(['l_shape', '--export', str(file)]) == 0
    assert not (tmp_path / 'l_shape.png').exists()
    mesh = trimesh.load(file, force='mesh')
    assert abs(mesh.volume) == pytest.approx(16e-3 * (56e-3 * 8e-3 + 32e-3 * 12e-3), rel=1e-5)


def test_meshes_of_every_primitive_and_operator():
    pytest.importorskip('manifold3d')
    trimesh = pytest.importorskip('trimesh')

    def volume(text):
        vertices, faces, _ = mesh_export.mesh_of(parse_scene(f'UNITS M; DRAW {text};').solids[0], 256)
        return trimesh.Trimesh(vertices, faces).volume

    assert volume('CYLINDER (1, 0, 0, 2) SCALE (1, -1, 1)') == pytest.approx(2 * np.pi, rel=1e-3)
    assert volume('CONE (1, 0, 3, 0)') == pytest.approx(np.pi, rel=1e-3)
    assert volume('SPHERE (1) INTERSECT (PLANE (0, 0, 1, 0))') == pytest.approx(2 / 3 * np.pi, rel=1e-3)
    assert volume('BLOCK (2, 2, 2) DIFFERENCE (BLOCK (1, 1, 9))') == pytest.approx(6.0)
