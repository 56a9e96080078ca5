"""Closed-form testing: one case, sweeps, clutter, several processes, saved and replayed cases, exit status."""

from __future__ import annotations

import csv
import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from csg_renderer import Scene, Solid, Terrain, load_scene, model_features, render, render_stereo, scene_path
from dap_emulator import DapError
from model_matcher.closed_form.array_machine import roberts_through_service
from model_matcher.closed_form.batch import brought_home, files_of, run_batch, run_far
from model_matcher.closed_form.case import Case, Limits
from model_matcher.closed_form.cli import main
from model_matcher.closed_form.comparison import surface_residual
from model_matcher.closed_form.placement import case_lights, case_pose, case_rig, model_centre
from model_matcher.closed_form.poses import SWEEPS, pose_from_angles, sweep_cases
from model_matcher.closed_form.result import result_document
from model_matcher.closed_form.run_library import run_library_case
from model_matcher.closed_form.saved import load_case
from model_matcher.closed_form.scene_files import case_scene, clutter_of
from msgs_py import PinholeCamera, Pose

SCENE = 'l_shape_v1'
FAST = ['-q', '--antialias', '2']


def matrix(case: Case) -> np.ndarray:
    return np.reshape(case.pose, (4, 4))


@pytest.fixture
def own_scene(tmp_path) -> Path:
    """A user's scene file outside the package, with an include beside it."""
    folder = tmp_path / 'mine'
    folder.mkdir()
    (folder / 'parts.csg').write_text('bracket = (BLOCK (60, 12, 40) UNION BLOCK (14, 50, 40)) PAINT FACES;\n')
    path = folder / 'desk.csg'
    path.write_text(
        'INCLUDE "parts.csg";\nCAMERA SIZE (320, 240) FOCAL (440) CENTRE (150, 130);\nSTEREO (45);\n'
        'AMBIENT (0.9);\nLIGHT (-100, -300, -100) COLOUR (0.1);\n'
        'DRAW bracket YROT (35) XROT (25) AT (-20, -10, 230);\n'
    )
    return path


@pytest.mark.parametrize('sweep', SWEEPS)
def test_a_sweep_keeps_the_object_in_place_and_its_poses_are_rotations(sweep):
    case = Case(SCENE)
    cases = sweep_cases(case, sweep, 7)
    scene = load_scene(scene_path(SCENE))
    middle, _ = model_centre(scene)
    before = case_pose(case, scene).apply(middle)
    assert len({one.name for one in cases}) == 7 and len({one.seed for one in cases}) == 7
    for one in cases:
        pose = Pose.from_matrix(matrix(one))
        np.testing.assert_allclose(np.linalg.det(pose.rotation), 1.0, atol=1e-9)
        allowed = 0.1 * before[2] if sweep == 'random' else 1e-9
        assert np.abs(pose.apply(middle) - before).max() <= allowed
    turns = np.array([Pose.from_matrix(matrix(one)).rotation for one in cases])
    assert min(np.abs(a - b).max() for i, a in enumerate(turns) for b in turns[:i]) > 0.05


def test_a_turntable_starts_at_the_scene_and_turns_about_the_vertical():
    cases = sweep_cases(Case(SCENE), 'turntable', 4)
    start, opposite = (Pose.from_matrix(matrix(cases[k])).rotation for k in (0, 2))
    np.testing.assert_allclose(start, case_pose(Case(SCENE), load_scene(scene_path(SCENE))).rotation, atol=1e-12)
    np.testing.assert_allclose(opposite @ start.T, np.diag([-1.0, 1.0, -1.0]), atol=1e-9)


def test_a_sweep_can_be_put_at_another_distance_and_bad_arguments_are_named():
    middle, _ = model_centre(load_scene(scene_path(SCENE)))
    (case,) = sweep_cases(Case(SCENE), 'turntable', 1, distance=0.3)
    assert Pose.from_matrix(matrix(case)).apply(middle)[2] == pytest.approx(0.3)
    for arguments, name in ((('spiral', 3), 'sweep'), (('grid', 0), 'count'), (('grid', 3, -1.0), 'distance')):
        with pytest.raises(ValueError, match=name):
            sweep_cases(Case(SCENE), *arguments)


def test_angles_of_the_command_line_mean_what_they_mean_in_a_scene_file():
    scene = load_scene(scene_path(SCENE))  # YROT (40) XROT (-30) AT (10, -30, 150): first Y, then X
    pose = case_pose(Case(SCENE), scene)
    first_y = np.reshape(pose_from_angles([0, 40, 0, 0, 0, 1]), (4, 4))[:3, :3]
    then_x = np.reshape(pose_from_angles([-30, 0, 0, 10, -30, 150]), (4, 4))
    np.testing.assert_allclose(then_x[:3, :3] @ first_y, pose.rotation, atol=1e-12)
    np.testing.assert_allclose(then_x[:3, 3], pose.translation, atol=1e-12)


def test_a_written_scene_is_the_scene_it_stands_for(own_scene, tmp_path):
    case = Case(str(own_scene), pose=tuple(np.eye(4).ravel()), clutter=3)
    rig = case_rig(case)
    scene = load_scene(case_scene(case, rig, tmp_path / 'case'))
    original = load_scene(own_scene)
    assert scene.camera == original.camera and scene.baseline == original.baseline
    assert len(scene.placements) == 4 and scene.placements[0].name == 'bracket'
    np.testing.assert_array_equal(scene.placements[0].matrix, np.eye(4))
    np.testing.assert_allclose(scene.lights[0].position, original.lights[0].position)
    assert all(len(placed.model.primitives) for placed in scene.placements)


@pytest.fixture
def bare_part(tmp_path) -> Path:
    """A part as one models it: about the origin, with no camera and no light."""
    path = tmp_path / 'part.csg'
    path.write_text('bracket = BLOCK (60, 12, 40) UNION BLOCK (14, 50, 40);\nDRAW bracket AT (-20, 0, -10);\n')
    return path


@pytest.mark.parametrize('size', [(None, None), (640, 480), (300, 500)])
def test_a_bare_part_is_shown_whole_and_lit(bare_part, tmp_path, size):
    case = Case(str(bare_part), *size)
    rig = case_rig(case)
    scene = load_scene(case_scene(case, rig, tmp_path / 'case'))
    pose, (middle, radius) = case_pose(case, load_scene(bare_part)), model_centre(scene)
    centre = pose.apply(middle)
    assert centre[2] > 2.0 * radius and rig.baseline == pytest.approx(centre[2] / 5.0)
    corners = model_features(scene.placements[0].model).transformed(pose)
    pixels = rig.left.project(np.concatenate([corners.start, corners.end]))
    assert (pixels > 0).all() and (pixels < (rig.left.width, rig.left.height)).all()
    assert len(scene.lights) == 2
    image = render_stereo(scene, rig)[0].image
    assert len(np.unique(image[image > 0])) >= 3  # three faces are seen, and none is as bright as another


def test_a_bare_part_is_recognised_in_every_kind_of_view(bare_part, tmp_path):
    case = Case(str(bare_part), antialias=2)
    for one in [case, *sweep_cases(case, 'random', 3)]:
        result = run_library_case(one, tmp_path / one.name)
        assert result_document(result, Limits())['passed'], one.name


def test_what_the_scene_says_of_light_stands(tmp_path):
    for text in ('LIGHT (0, 0, 0);', 'AMBIENT (0.7);'):
        path = tmp_path / 'lit.csg'
        path.write_text(f'{text} a = BLOCK (10, 10, 10); DRAW a AT (0, 0, 200);')
        scene = load_scene(path)
        assert case_lights(scene, case_pose(Case(str(path)), scene)) == tuple(scene.lights)
        assert case_scene(Case(str(path)), case_rig(Case(str(path))), tmp_path) == path


def test_clutter_stands_beside_or_behind_the_object():
    case = Case(SCENE, clutter=12)
    scene, rig = load_scene(scene_path(SCENE)), case_rig(case)
    pose = case_pose(case, scene)
    middle, radius = model_centre(scene)
    centre = pose.apply(middle)
    outline = rig.left.fx * radius / centre[2]
    assert len(clutter_of(case, scene, pose, rig)) == 12
    for _, place in clutter_of(case, scene, pose, rig):
        beside = np.linalg.norm(rig.left.project(place.translation) - rig.left.project(centre)) > outline
        assert beside or place.translation[2] > centre[2] + radius


def test_a_case_through_the_libraries_is_measured_against_the_truth(own_scene, tmp_path):
    result = run_library_case(Case(str(own_scene)), tmp_path)
    assert result.found is not None and result.pose_error.rotation_deg < 0.5
    assert result.edges.edges_found >= 0.7 * len(result.edges.covered) and result.surface_residual_m < 1e-6


def test_a_sweep_writes_csv_json_and_a_page_and_sets_the_exit_status(tmp_path):
    out = tmp_path / 'out'
    arguments = [SCENE, '--sweep', 'turntable', '--count', '3', '-o', str(out), *FAST]
    lenient = ['--max-rotation-deg', '2', '--max-translation-mm', '5', '--min-success', '0.3']
    assert main([*arguments, *lenient]) == 0
    rows = list(csv.DictReader((out / 'summary.csv').read_text().splitlines()))
    document = json.loads((out / 'summary.json').read_text())
    assert len(rows) == len(document['cases']) == document['summary']['cases'] == 3
    assert rows[0]['case'] == 'l_shape_v1_turntable_0' and float(rows[0]['rotation_error_deg']) < 2.0
    assert 'Closed-form sweep' in (out / 'index.html').read_text()
    assert main([*arguments, '--max-rotation-deg', '0']) == 1


def test_a_failing_case_is_saved_and_replayed_to_the_same_figures(own_scene, tmp_path):
    out = tmp_path / 'out'
    assert (
        main(
            [
                str(own_scene),
                '--sweep',
                'grid',
                '--count',
                '2',
                '--clutter',
                '2',
                '-o',
                str(out),
                '--max-rotation-deg',
                '1e-9',
                *FAST,
            ]
        )
        == 1
    )
    first = json.loads((out / 'summary.json').read_text())['cases'][0]
    folder = out / first['saved']
    page = (folder / 'report.html').read_text()
    assert 'outside the limits' in page and 'Array machine' not in page and 'node and library' not in page
    own_scene.unlink()  # the folder alone is enough
    assert {'case.json', 'scene.csg', 'left.png', 'right.png', 'features.npz', 'report.html'} <= {
        path.name for path in folder.iterdir()
    }
    case, limits = load_case(folder)
    assert limits.rotation_deg == 1e-9 and case.name == first['case']
    again = tmp_path / 'again'
    assert main(['--replay', str(folder), '-o', str(again), '-q']) == 1
    replayed = json.loads((again / case.name / 'result.json').read_text())
    for name in ('rotation_error_deg', 'translation_error_m'):
        assert replayed[name] == pytest.approx(first[name], rel=1e-6)


def test_a_damaged_saved_case_is_refused_by_name(tmp_path, capsys):
    (tmp_path / 'case.json').write_text('{"case": {"scene": "l_shape_v1", "colour": 3}, "limits": {}}')
    with pytest.raises(ValueError, match='colour'):
        load_case(tmp_path)
    assert main(['--replay', str(tmp_path)]) == 2 and 'colour' in capsys.readouterr().err
    for text in ('[' * 100_000, f'{{"case": {{"scene": "l_shape_v1", "noise": 1{400 * "0"}}}, "limits": {{}}}}'):
        (tmp_path / 'case.json').write_text(text)
        with pytest.raises(ValueError, match='case.json'):
            load_case(tmp_path)
    assert main(['--replay', str(tmp_path / 'nowhere')]) == 2


def test_several_processes_give_what_one_gives(tmp_path):
    cases = sweep_cases(Case(SCENE, width=256, antialias=2), 'turntable', 3)
    documents = [run_batch(cases, Limits(), tmp_path / str(workers), workers, quiet=True) for workers in (1, 2)]
    for one, other in zip(*documents):
        assert one['case'] == other['case'] and one['rotation_error_deg'] == other['rotation_error_deg']


def test_an_unusable_scene_is_a_result_of_a_batch_and_misuse_of_the_command(tmp_path, capsys):
    (document,) = run_batch([Case('no_such_scene')], Limits(), tmp_path, quiet=True)
    assert not document['passed'] and 'no_such_scene' in document['verdict']
    with pytest.raises(SystemExit) as stop:
        main(['no_such_scene', '--sweep', 'grid', '-o', str(tmp_path)])
    assert stop.value.code == 2 and 'no_such_scene' in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_one_line_and_status_2(tmp_path, capsys):
    (tmp_path / 'taken').write_text('a file')
    assert main([SCENE, '--sweep', 'grid', '--count', '2', '-o', str(tmp_path / 'taken' / 'out'), '-q']) == 2
    error = capsys.readouterr().err
    assert error.startswith('closed_form: ') and 'taken' in error and error.count('\n') == 1


def test_a_saved_case_whose_scene_is_gone_fails_by_name(tmp_path, capsys):
    (tmp_path / 'case.json').write_text('{"case": {"scene": "gone.csg"}, "limits": {}}')
    assert main(['--replay', str(tmp_path), '-o', str(tmp_path / 'out'), '-q']) == 1
    assert 'gone.csg' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        ([], 'name at least one scene'),
        (['no_such_scene'], 'no_such_scene'),
        ([SCENE, '--noise', '-3'], '--noise: expected a number in 0..100'),
        ([SCENE, '--psf', '-1'], '--psf'),
        ([SCENE, '--baseline', '0'], '--baseline: expected a number > 0'),
        ([SCENE, '--distance', '-5', '--sweep', 'grid'], '--distance'),
        ([SCENE, '--min-success', '2'], 'in 0..1'),
        ([SCENE, '--focal', 'nan'], '--focal'),
    ],
)
def test_misuse_has_status_2_and_names_the_option_in_the_users_units(arguments, told, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*arguments, '-o', str(tmp_path)])
    assert stop.value.code == 2 and told in capsys.readouterr().err


def test_a_scene_that_cannot_be_moved_is_refused_before_anything_runs(tmp_path, capsys):
    scene = tmp_path / 'anonymous.csg'
    scene.write_text('AMBIENT (1);\nDRAW (BLOCK (30, 20, 10)) AT (-15, -10, 200);\n')
    with pytest.raises(SystemExit) as stop:
        main([str(scene), '--sweep', 'grid', '-o', str(tmp_path / 'out')])
    assert stop.value.code == 2 and 'has no name' in capsys.readouterr().err


def test_scenes_of_one_name_have_folders_of_their_own(own_scene, tmp_path):
    other = tmp_path / 'other'
    other.mkdir()
    for path in own_scene.parent.iterdir():
        (other / path.name).write_text(path.read_text())
    scenes = [str(own_scene), str(other / own_scene.name)]
    main([*scenes, '--workers', '2', '--reports', '-o', str(tmp_path / 'out'), *FAST])
    assert {path.name for path in (tmp_path / 'out' / 'cases').iterdir()} == {'desk', 'desk_2'}


def test_a_pose_within_the_limits_with_a_wrong_pairing_is_told_from_a_bad_pose(own_scene, tmp_path):
    result = run_library_case(Case(str(own_scene)), tmp_path)
    assert result_document(result, Limits())['verdict'].startswith('recognised')
    assert result_document(result, Limits(rotation_deg=0.0))['verdict'].startswith('outside the limits')
    wrong = replace(result, assignment=replace(result.assignment, right=result.assignment.right - 1))
    document = result_document(wrong, Limits())
    assert not document['passed'] and document['verdict'].startswith('a pairing or sign is wrong')


def test_a_case_for_another_machine_takes_its_scene_along_and_brings_its_results_back(tmp_path, monkeypatch):
    mine, elsewhere = tmp_path / 'mine', tmp_path / 'elsewhere'
    (mine / 'lib' / 'steel').mkdir(parents=True)
    elsewhere.mkdir()
    (mine / 'lib' / 'steel' / 'foot.csg').write_text('foot = BLOCK (60, 10, 40);\n')
    (mine / 'lib' / 'part.csg').write_text(
        'INCLUDE "steel/foot.csg";\npart = (foot UNION BLOCK (10, 50, 40)) PAINT FACES;\n'
    )
    (mine / 'desk.csg').write_text(
        'INCLUDE "lib/part.csg";\nAMBIENT (0.9);\nLIGHT (0, -300, 0) COLOUR (0.1);\n'
        'DRAW part YROT (35) XROT (25) AT (-20, -10, 230);\n'
    )
    monkeypatch.chdir(mine)
    (case,) = sweep_cases(Case('desk.csg', width=256, antialias=2), 'turntable', 1)
    job, files = (0, case, Limits(rotation_deg=0.0), str(tmp_path / 'out'), False, False), files_of(case)
    monkeypatch.chdir(elsewhere)
    _, document = brought_home(job, run_far(job, files))
    assert document['case'] == 'desk_turntable_0' and document['rotation_error_deg'] < 1.0
    folder = tmp_path / 'out' / document['saved']
    assert main(['--replay', str(folder), '-o', str(tmp_path / 'again'), '-q']) == 1
    again = json.loads((tmp_path / 'again' / 'desk_turntable_0' / 'result.json').read_text())
    assert again['rotation_error_deg'] == pytest.approx(document['rotation_error_deg'], rel=1e-6)


HOSTILE_NAMES = ('../../precious', '/etc', '..', '.', '', 'a/../../b', 'failing/other', 'x\0y', 'cases', 'failing')


@pytest.mark.parametrize('name', HOSTILE_NAMES)
def test_the_answer_of_a_worker_names_no_folder_outside_its_case(tmp_path, name):
    """What is removed is said by the job; what is written lies below it; everything else is a failed case."""
    out = tmp_path / 'results'
    job = (0, Case(SCENE), Limits(), str(out), False, False)
    kept = [tmp_path / 'precious' / 'file', out / 'failing' / 'other' / 'file']
    for file in kept:
        file.parent.mkdir(parents=True)
        file.write_text('keep')
    before = sorted(path for path in tmp_path.rglob('*'))
    for answer in (
        (0, {'case': name, 'passed': True}, str(out), {f'{name}/file': b'spoilt'}),
        (0, {'case': name, 'passed': False, 'saved': name}, str(out), {}),
        (7, {'case': name, 'passed': True}, name, {name: b'spoilt'}),
        (0, {'case': name}, str(out), {}),
        None,
        (0, None, None, None),
    ):
        index, document = brought_home(job, answer)
        assert index == 0 and not document['passed'] and document['verdict'].startswith('error: the answer of a worker')
    good = (7, {'case': name, 'passed': True}, name, {f'failing/{SCENE}/file': b'mine'})
    assert brought_home(job, good)[1] == {'case': SCENE, 'passed': True}
    (out / 'failing' / SCENE / 'file').unlink()
    (out / 'failing' / SCENE).rmdir()
    assert sorted(path for path in tmp_path.rglob('*')) == before
    assert all(file.read_text() == 'keep' for file in kept)


@pytest.mark.parametrize(
    ('values', 'told'),
    [
        *(({'label': name}, 'label') for name in HOSTILE_NAMES if '/' in name or len(name) < 3 or '\0' in name),
        *(({'scene': name}, 'scene') for name in ('/etc/passwd', '../x.csg', 'a/../../x.csg', 'no/such.csg', 'a\0b')),
        ({'scene': 3}, 'scene'),
        ({'seed': 'one'}, 'seed'),
        ({'noise': None}, 'noise'),
        ({'width': [1]}, 'width'),
        ({'pose': 'abcdefghijklmnop'}, 'could not convert'),
        ({'pose': 3}, 'not iterable'),
        ({'time_limit_s': True}, 'time_limit_s'),
    ],
)
def test_what_a_saved_case_says_is_checked(tmp_path, values, told):
    folder = tmp_path / 'saved'
    folder.mkdir()
    (folder / 'case.json').write_text(json.dumps({'case': {'scene': SCENE, **values}, 'limits': {}}))
    with pytest.raises(ValueError, match=told) as error:
        load_case(folder)
    assert str(error.value).startswith(str(folder / 'case.json'))


def test_a_saved_case_may_not_lead_out_of_its_folder_by_a_link(tmp_path):
    folder = tmp_path / 'saved'
    folder.mkdir()
    (tmp_path / 'secret.csg').write_text('DRAW BLOCK (1, 1, 1);')
    (folder / 'scene.csg').symlink_to(tmp_path / 'secret.csg')
    (folder / 'case.json').write_text(json.dumps({'case': {'scene': 'scene.csg'}, 'limits': {}}))
    with pytest.raises(ValueError, match='below the folder'):
        load_case(folder)


def test_dask_runs_the_cases_or_says_that_it_is_not_installed(tmp_path):
    cases = sweep_cases(Case(SCENE, width=256, antialias=2), 'turntable', 2)
    if importlib.util.find_spec('distributed') is None:
        with pytest.raises(ValueError, match='distributed'):
            run_batch(cases, Limits(), tmp_path, dask='local', quiet=True)
        pytest.skip('dask.distributed is not installed')
    assert len(run_batch(cases, Limits(), tmp_path, dask='local', quiet=True)) == 2


def test_one_case_through_the_real_nodes_with_pose_and_clutter(own_scene, tmp_path):
    pose = ['--pose', '25', '30', '0', '-20', '-10', '230']
    assert main(
        [
            str(own_scene),
            *pose,
            '--clutter',
            '2',
            '-o',
            str(tmp_path / 'out'),
            '-q',
            '--max-rotation-deg',
            '1',
            '--max-translation-mm',
            '3',
        ]
    ) in (0, 1)
    document = json.loads((tmp_path / 'out' / 'desk' / 'result.json').read_text())
    assert document['model'] == 'bracket' and document['camera']['cx'] == 150.0
    assert document['render']['node_image_differs_from_library_pixels'] == 0
    assert document['rotation_error_deg'] < 1.0


def test_a_report_without_the_array_machine_says_why(monkeypatch):
    def refuse(*arguments, **options):
        raise DapError('emulator_node: no such service within 5 s')

    monkeypatch.setattr('model_matcher.closed_form.array_machine.DapClient', refuse)
    row = roberts_through_service(None, None, '/emulator_node', np.zeros((80, 80), np.uint8))
    assert row == {'program': 'Roberts operator', 'error': 'emulator_node: no such service within 5 s'}


@pytest.mark.parametrize('interpolation', ['triangles', 'bilinear'])
def test_rendered_points_of_a_terrain_lie_on_it(interpolation):
    heights = np.random.default_rng(2).normal(scale=0.05, size=(6, 7))
    heights[3, 3] = np.nan
    ground = Terrain(heights, (0.2, 0.25), interpolation)
    tilted = ground.transformed(Pose.from_rotation_vector([1.9, 0.1, 0.0], [-0.6, 0.4, 1.2]))
    ball = Solid.sphere(0.1).transformed(Pose(np.eye(3), [0.1, 0.0, 0.9]))
    frame = render(Scene([tilted, ball]), PinholeCamera.centred(64, 48, 60.0))
    assert (frame.primitive_id == 0).sum() > 200
    assert surface_residual(Scene([tilted, ball]), frame) < 1e-6
    # Half a cell beside, it would not.
    beside = Scene([tilted.transformed(Pose(np.eye(3), [0.1, 0.0, 0.0])), ball])
    assert surface_residual(beside, frame) > 1e-3


def test_a_changed_case_takes_the_heights_of_its_scene_along(tmp_path):
    np.save(tmp_path / 'ground.npy', np.zeros((3, 3)))
    scene = tmp_path / 'scene.csg'
    scene.write_text(
        'box = BLOCK (40, 50, 60) PAINT FACES; ground = TERRAIN ("ground.npy", 400, 400, 1);'
        'DRAW box AT (0, 0, 400); DRAW ground AT (-200, 0, 500);'
    )
    case = replace(Case(str(scene)), pose=tuple(Pose(np.eye(3), [0.0, 0.0, 0.5]).matrix.ravel().tolist()))
    written = case_scene(case, case_rig(case), tmp_path / 'out')
    assert written.parent == tmp_path / 'out' and (tmp_path / 'out' / 'ground.npy').is_file()
    assert load_scene(written).placements[0].name == 'box'


RAW_CAMERA = (
    'full_well=9000',
    'read_noise=8',
    'vignetting=0.3',
    'distortion_model=plumb_bob',
    'distortion=-0.3,0.08,0.001,0,0',
    'encoding=mono16',
    'bits=12',
)


@pytest.mark.parametrize('nodes', [False, True])
def test_a_part_is_found_with_a_raw_camera(nodes, tmp_path):
    case = Case(SCENE, width=384, antialias=3, noise=0.0, camera=RAW_CAMERA)
    if nodes:
        from model_matcher.closed_form.run_graph import run_case

        result = run_case(case)
    else:
        result = run_library_case(case, tmp_path)
    assert result.image_difference == 0
    assert result.pose_error.rotation_deg < 0.2 and result.edges.recall > 0.7


@pytest.mark.parametrize(
    ('camera', 'name'),
    [
        ('full_well', 'NAME=VALUE'),
        ('scene=/etc/passwd', 'NAME=VALUE'),
        ('full_well=much', 'full_well'),
        ('distortion_model=plumb_bob', 'distortion'),
        ('bits=12', 'bits'),
    ],
)
def test_a_camera_that_cannot_be_is_refused_by_name(camera, name, tmp_path, capsys):
    with pytest.raises(SystemExit) as error:
        main([SCENE, '-o', str(tmp_path), '--camera', camera])
    assert error.value.code == 2 and name in capsys.readouterr().err
