"""The features and model_table commands, and what they write."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from csg_renderer import Solid, boundary
from csg_renderer.features.drawing import draw_mesh, draw_solid, save_drawing, view_from
from csg_renderer.features.export import as_json, save_dxf
from csg_renderer.features.mesh_features import mesh_features
from csg_renderer.features_cli import describe, main
from csg_renderer.model_table import MODELS, VIEWS, as_markdown
from csg_renderer.model_table import main as table_main
from msgs_py import FeatureSet

SCENE = """
UNITS MM;
body = BLOCK (40, 30, 20);
hole = CYLINDER (8, 0, 0, 60) AT (20, 15, -20);
part = body DIFFERENCE hole;
DRAW part;
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / 'part.csg'
    path.write_text(SCENE)
    return path


def test_table_lists_every_feature(scene, capsys):
    assert main([str(scene)]) == 0
    out = capsys.readouterr().out
    assert 'part: 12 edges, 2 curves, 1 axes' in out
    assert '7 faces (6 plane, 1 cylinder), 8 vertices' in out
    assert out.count(' EDGE ') == 12 and out.count(' CURVE ') == 2 and out.count(' AXIS ') == 1
    volume = 40 * 30 * 20 - np.pi * 64 * 20
    assert f'volume {volume:.6g} mm3' in out


def test_every_output(scene, tmp_path, capsys):
    names = ['part.png', 'part.svg', 'part.dxf', 'part.json', 'part.npz']
    assert main([str(scene), '-q', *(word for name in names for word in ('-o', str(tmp_path / 'out' / name)))]) == 2
    assert 'out' in capsys.readouterr().err  # the folder is not there
    (tmp_path / 'out').mkdir()
    assert main([str(scene), '-q', *(word for name in names for word in ('-o', str(tmp_path / 'out' / name)))]) == 0
    assert (tmp_path / 'out' / 'part.png').read_bytes().startswith(b'\x89PNG')
    assert '<svg' in (tmp_path / 'out' / 'part.svg').read_text()
    model = json.loads((tmp_path / 'out' / 'part.json').read_text())['part']
    assert [row['kind'] for row in model['features']] == ['EDGE'] * 12 + ['CURVE'] * 2 + ['AXIS']
    assert len(model['faces']) == 7 and len(model['vertices']) == 8
    assert len(FeatureSet.load(tmp_path / 'out' / 'part.npz')) == 15


@pytest.mark.parametrize('suffix', ['stl', 'off'])
def test_mesh(tmp_path, capsys, suffix):
    path = tmp_path / f'drum.{suffix}'
    trimesh.creation.cylinder(20, 50, sections=48).export(path)
    assert main([str(path), '--scale', '0.001', '-o', str(tmp_path / 'drum.png')]) == 0
    assert 'drum: 0 edges, 2 curves, 1 axes' in capsys.readouterr().out
    assert (tmp_path / 'drum.png').stat().st_size > 1000


@pytest.mark.parametrize(
    ('arguments', 'named'),
    [
        (['{scene}', '-o', 'x.gif'], 'x.gif'),
        (['{scene}', '--look', '0', '0', '0', '-o', '{tmp}/x.png'], 'direction'),
        (['{scene}', '--camera'], '--camera'),
        (['{tmp}/missing.csg'], 'missing.csg'),
        (['{tmp}/missing.stl'], 'missing.stl'),
        (['{tmp}/bad.csg'], 'bad.csg'),
        (['{tmp}/bad.stl', '--crease-angle', '500'], '--crease-angle'),
        (['{tmp}/bad.stl', '--scale', '0'], '--scale'),
    ],
)
def test_bad_input_is_named(scene, tmp_path, capsys, arguments, named):
    (tmp_path / 'bad.csg').write_text('DRAW nonsense (')
    assert main([word.format(scene=scene, tmp=tmp_path) for word in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith('features: ') and named in error


def test_hidden_lines_are_drawn_apart():
    block = Solid.block(1, 2, 3)
    drawing = draw_solid(block, *view_from((1, -1.5, 1), np.zeros(3), np.array([1, 2, 3.0])))
    assert len(drawing.seen) == 9 and len(drawing.hidden) == 12
    pixels = np.concatenate(drawing.hidden)
    assert (pixels >= 0).all() and (pixels <= [drawing.width, drawing.height]).all()
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]])
    vertices, triangles = np.array(mesh.vertices), np.array(mesh.faces)
    sampled = draw_mesh(
        mesh_features(vertices, triangles),
        vertices,
        triangles,
        *view_from((1, -1.5, 1), np.zeros(3), np.array([1, 2, 3.0])),
    )
    assert len(sampled.seen) == 9


def test_an_empty_model_is_described_and_drawn(tmp_path):
    nothing = Solid.block(1, 1, 1) - Solid.block(2, 2, 2)
    assert 'note:' in describe('nothing', boundary(nothing).features, nothing)
    save_drawing(draw_solid(nothing, *view_from((1, 1, 1), np.zeros(3), np.ones(3))), tmp_path / 'empty.png')
    json.dumps(as_json(boundary(nothing).features, boundary(nothing)), allow_nan=False)


def test_dxf_has_an_entity_for_every_feature(tmp_path):
    save_dxf(boundary(Solid.cylinder(0.01, (0, 0, 0.02))).features, tmp_path / 'c.dxf')
    words = (tmp_path / 'c.dxf').read_text().split('\n')
    assert words[:4] == ['0', 'SECTION', '2', 'ENTITIES'] and words[-3:] == ['0', 'EOF', '']
    assert words.count('LINE') == 1 and words.count('POLYLINE') == 2 and words.count('VERTEX') == 2 * 65
    x = [float(words[k + 1]) for k in range(0, len(words) - 1, 2) if words[k] == '10']
    np.testing.assert_allclose(max(x), 10.0, atol=1e-6)  # millimetres


def test_table_of_the_thesis_models(tmp_path, capsys):
    assert table_main(['--json', str(tmp_path / 'table.json')]) == 0
    assert '| l_shape | 2 / 2 | 12 / 12 | 8 / 8 | 18 / 18 |' in capsys.readouterr().out
    rows = json.loads((tmp_path / 'table.json').read_text())
    assert set(rows['models']) == set(MODELS) and set(rows['views']) == set(VIEWS)
    # The counts of features that our scene files are made for.
    for name in ('chipped_block', 'chair', 'l_shape', 'wedge', 'plug', 'cylinder_box', 'lamp', 'tubes', 'widget'):
        assert tuple(rows['models'][name]['ours'][3:]) == MODELS[name][3:], name


def test_a_missing_scene_is_a_row_with_a_reason():
    rows = {'models': {'x': {'ours': None, 'thesis': (1, None, 2, 3, 4, 5), 'problem': 'no scene'}}, 'views': {}}
    assert '| x | - / 1 | - / - |' in as_markdown(rows) and 'x: no scene' in as_markdown(rows)
