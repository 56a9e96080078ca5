"""The match command: prints a table, draws what was found, explains bad input in one line."""

import json

import cv2
import numpy as np
import pytest
import trimesh

import csg_renderer
from model_matcher import MatchResult
from model_matcher.closed_form.synthetic.scenes import l_shape, make_scene, wedge
from model_matcher.match_cli import main, summary
from msgs_py import Interpretation, Pose


@pytest.fixture
def files(tmp_path):
    """A model file and a file of features in which it stands in clutter."""
    l_shape().save(tmp_path / 'l_shape.npz')
    make_scene(l_shape(), 3, clutter=0.4).data.save(tmp_path / 'features.npz')
    return tmp_path


def test_prints_model_matched_residual_pose_and_signs(files, capsys):
    assert main([str(files / 'l_shape.npz'), str(files / 'features.npz')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ['model', 'matched']
    assert lines[1].startswith('l_shape ') and 'accepted' in lines[1]
    assert '1 found' in lines[-1]


def test_nothing_found_has_a_reason_and_exit_status_1(files, capsys):
    make_scene(wedge(), 1, instances=0, clutter=0.3).data.save(files / 'other.npz')
    assert main([str(files / 'l_shape.npz'), str(files / 'other.npz')]) == 1
    assert 'nothing found: ' in capsys.readouterr().out


def test_parallel_data_says_along_what_the_model_may_shift(files, capsys):
    model = l_shape()
    upright = model.select(np.flatnonzero(np.abs(model.directions[:, 2]) > 0.9))
    upright.save(files / 'parallel.npz')
    assert main([str(files / 'l_shape.npz'), str(files / 'parallel.npz')]) in (0, 1)
    assert main([str(files / 'l_shape.npz'), str(files / 'parallel.npz'), '--false-alarm-rate', '1']) == 0
    assert 'free to shift along (0.000 0.000 ' in capsys.readouterr().out.replace('-0.000', '0.000')


def test_draws_over_the_image_with_a_camera_file(files):
    image = np.zeros((120, 160), np.uint8)
    cv2.imwrite(str(files / 'left.png'), image)
    camera = {'width': 160, 'height': 120, 'K': [[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]]}
    (files / 'left.json').write_text(json.dumps(camera))
    out = files / 'found.png'
    assert (
        main(
            [
                str(files / 'l_shape.npz'),
                str(files / 'features.npz'),
                '-o',
                str(out),
                '--image',
                str(files / 'left.png'),
                '--camera',
                str(files / 'left.json'),
            ]
        )
        == 0
    )
    picture = cv2.imread(str(out))
    assert picture.shape == (240, 320, 3)
    green = (picture[..., 1] > 150) & (picture[..., 2] < 120)
    assert green.sum() > 50


def test_draws_two_views_without_a_camera(files):
    out = files / 'views.png'
    assert main([str(files / 'l_shape.npz'), str(files / 'features.npz'), '-o', str(out)]) == 0
    assert cv2.imread(str(out)).std() > 1.0


def test_the_array_machine_searches_as_the_thesis_prints_it(files, capsys):
    data = l_shape().select([1, 4, 8, 10, 12, 14])
    data.save(files / 'part.npz')
    options = ['--engine', 'dap', '--no-eliminate', '--ranges', 'corners', '--real-bytes', '4', '--max-bin', '0']
    for search in (['--search', 'tree'], ['--search', 'subgraph', '--quadrant', '8']):
        main([str(files / 'l_shape.npz'), str(files / 'part.npz'), *options, *search, '--false-alarm-rate', '1'])
        assert '1 found' in capsys.readouterr().out


def test_the_searches_of_the_thesis_can_be_chosen(files, capsys):
    make_scene(l_shape(), 1).data.save(files / 'clean.npz')
    assert main([str(files / 'l_shape.npz'), str(files / 'clean.npz'), '--search', 'tree', '--ordering', 'worst']) == 0
    assert 'l_shape' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['missing.npz'], 'missing.npz'),
        (['features.npz', '--fracdev', '7'], 'fracdev'),
        (['features.npz', '--focal', '500'], '--size'),
        (['features.npz', '--camera', 'features.npz'], 'not a camera file'),
        (['features.npz', '--image', 'none.png'], 'none.png'),
        (
            ['features.npz', '--image', 'small.png', '--focal', '500', '--size', '640', '480', '-o', 'x.png'],
            '5 x 4 pixels, but the camera has 640 x 480',
        ),
        (['features.npz', '--focal', '500', '--size', '640', '480', '-o', 'x.none'], 'x.none: cannot be written'),
        (['features.npz', '-o', 'x.none'], 'x.none: cannot be written'),
    ],
)
def test_bad_input_is_one_line_and_exit_status_2(files, capsys, monkeypatch, arguments, said):
    monkeypatch.chdir(files)
    cv2.imwrite('small.png', np.zeros((4, 5), np.uint8))
    assert main(['l_shape.npz', *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count('\n') == 1


def test_an_unknown_model_is_named(files, capsys):
    assert main(['no_such_model_there', str(files / 'features.npz')]) == 2
    assert 'no_such_model_there' in capsys.readouterr().err


@pytest.mark.parametrize(('metres', 'unit'), [(1e-3, 'mm'), (1.0, 'm'), (0.0254, 'in'), (0.01, 'cm')])
def test_a_mesh_in_any_unit_is_found(tmp_path, capsys, metres, unit):
    """An object of CAD is in millimetres and a robot's in metres: both are guessed, and said; others are given."""
    path, block = tmp_path / 'part.stl', csg_renderer.Solid.block(0.09, 0.05, 0.03)
    mesh = trimesh.creation.box((0.09, 0.05, 0.03))
    mesh.apply_scale(1.0 / metres)
    mesh.export(path)
    scene = make_scene(csg_renderer.model_features(block), 4, clutter=0.3)
    scene.data.save(tmp_path / 'features.npz')
    given = [] if unit in ('mm', 'm') else ['--mesh-units', unit]
    assert main([str(path), str(tmp_path / 'features.npz'), *given]) == 0
    said = capsys.readouterr()
    assert f' {unit} across' in (said.out if given else said.err) and ('guessed' in said.err) == (not given)
    assert main([str(path), str(tmp_path / 'features.npz'), '--mesh-units', 'mm' if unit != 'mm' else 'm']) == 1


def test_the_summary_counts_the_poses_that_are_not_told_apart():
    found = Interpretation('box', [0, 1, 2], [1, 1, 1], Pose(), ambiguous_poses=(Pose.from_rotation_vector([0, 0, 3]),))
    assert 'poses that what is seen does not tell apart: 2' in summary(MatchResult((found,), (), {}, None), 3)
    alone = Interpretation('box', [0, 1, 2], [1, 1, 1], Pose())
    assert 'apart' not in summary(MatchResult((alone,), (), {}, None), 3)
