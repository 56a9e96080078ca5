"""Typical mistakes of a first day: the first line on stderr names the file or the option, and what to do."""

from __future__ import annotations

import json
import shutil
import subprocess
from itertools import takewhile
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
import yaml

import csg_renderer
from csg_renderer.features_cli import main as features
from csg_renderer.render_cli import main as render
from dap_emulator.dap_cli import main as dap
from model_matcher.closed_form.cli import main as closed_form
from model_matcher.closed_form.following.track_cli import main as track
from model_matcher.closed_form.planning.plan_cli import main as plan_rig
from model_matcher.closed_form.recordings.replay_cli import main as replay
from model_matcher.closed_form.viewing.view_cli import main as view
from model_matcher.completion import script
from model_matcher.index_cli import main as index_models
from model_matcher.match_cli import main as match
from stereo_recovery.check_rig_cli import main as check_rig
from stereo_recovery.measure_camera_cli import main as measure_camera
from stereo_recovery.recover_cli import main as recover

SCENE = """
UNITS MM;
part = (BLOCK (70, 10, 50) UNION BLOCK (12, 45, 50) DIFFERENCE BLOCK (60, 60, 60) ZROT (35) AT (12, 34, -5)
        DIFFERENCE CYLINDER (9, 0, 30, 0) AT (46, -10, 25)) PAINT FACES;
CAMERA SIZE (512, 512) FOCAL (703) FROM (130, 130, -130) TO (32, 15, 25) UP (0, 1, 0);
STEREO (35);
AMBIENT (0.93);
LIGHT (100, 300, -100) COLOUR (0.06);
DRAW part;
"""
PAIR = ['left.png', 'right.png', 'calibration.json']
LENS = np.array([-0.35, 0.1, 0.0, 0.0, 0.0])


def camera_info(k: np.ndarray, offset: float, size: int = 512, lens: bool = False) -> dict:
    """A ROS calibration file's content, P[0,3] being fx times ``offset`` (metres)."""
    return {
        'image_width': size,
        'image_height': size,
        'camera_matrix': {'data': k.ravel().tolist()},
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': {'data': LENS.tolist() if lens else [0.0] * 5},
        'rectification_matrix': {'data': np.eye(3).ravel().tolist()},
        'projection_matrix': {'data': np.column_stack([k, [k[0, 0] * offset, 0, 0]]).ravel().tolist()},
    }


def distorted(image: np.ndarray, k: np.ndarray) -> np.ndarray:
    """What a lens would have made of an ideal image."""
    v, u = np.mgrid[0 : image.shape[0], 0 : image.shape[1]].astype(np.float64)
    ideal = cv2.undistortPoints(np.stack([u.ravel(), v.ravel()], axis=1)[:, None], k, LENS, P=k)
    maps = ideal.reshape(*image.shape[:2], 2).astype(np.float32)
    return cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@pytest.fixture(scope='module')
def made(tmp_path_factory) -> Path:
    """Good files and bad ones."""
    folder = tmp_path_factory.mktemp('made')
    (folder / 'part.csg').write_text(SCENE)
    (folder / 'part_m.csg').write_text(SCENE.replace('UNITS MM', 'UNITS M'))
    (folder / 'typo.csg').write_text(SCENE.replace('BLOCK (12', 'BLOK (12'))
    assert render([str(folder / 'part.csg'), '--stereo', '--camera', '--noise', '2', '-o', str(folder / 'p.png')]) == 0
    for side in ('left', 'right'):
        shutil.move(folder / f'p_{side}.png', folder / f'{side}.png')
    record = json.loads((folder / 'p_left.json').read_text())
    k = np.array(record['K'], float)
    images = {side: cv2.imread(str(folder / f'{side}.png')) for side in ('left', 'right')}
    rng = np.random.default_rng(0)
    for side, image in images.items():
        for name, sigma in (('blurred', 24.0), ('shaken', 12.0)):
            blurred = cv2.GaussianBlur(image.astype(float), (0, 0), sigma)
            noisy = np.clip(blurred + rng.normal(0.0, 2.0, image.shape), 0, 255)
            cv2.imwrite(str(folder / f'{name}_{side}.png'), noisy.astype(np.uint8))
        cv2.imwrite(str(folder / f'raw_{side}.png'), distorted(image, k))
        cv2.imwrite(str(folder / f'black_{side}.png'), rng.integers(0, 3, image.shape[:2], dtype=np.uint8))
    cv2.imwrite(str(folder / 'small.png'), images['right'][:256, :256])
    shutil.copy(folder / 'left.png', folder / 'copy.png')
    (folder / 'text.png').write_text('no picture')
    (folder / 'cad.STEP').write_text('ISO-10303-21;')
    (folder / 'notes.json').write_text('{"a": 1}')
    (folder / 'broken.npz').write_bytes(b'no archive')

    def pair(name: str, left: dict, right: dict) -> None:
        (folder / name).write_text(yaml.safe_dump({'left': left, 'right': right}))

    (folder / 'calibration.json').write_text(json.dumps(record))
    (folder / 'mm.json').write_text(json.dumps(record | {'baseline': 1e3 * record['baseline']}))
    good = camera_info(k, 0.0), camera_info(k, -record['baseline'])
    pair('twice.yaml', good[0], good[0])
    pair('exchanged.yaml', good[1], good[0])
    pair('other_size.yaml', *(one | {'image_width': 640, 'image_height': 480} for one in good))
    pair('uncalibrated.yaml', *(one | {'projection_matrix': {'data': [0.0] * 12}} for one in good))
    pair('lens.yaml', camera_info(k, 0.0, lens=True), camera_info(k, -record['baseline'], lens=True))
    (folder / 'one_left.yaml').write_text(yaml.safe_dump(good[0]))
    box = trimesh.creation.box((0.07, 0.05, 0.03))
    box.apply_scale(1e3)
    box.export(folder / 'box.stl')
    boxed = csg_renderer.model_features(csg_renderer.Solid.block(0.07, 0.05, 0.03))
    boxed.transformed(csg_renderer_pose()).save(folder / 'boxed.npz')
    return folder


def csg_renderer_pose():
    from msgs_py import Pose

    return Pose.from_rotation_vector([0.4, 0.5, 0.1], [0.0, 0.0, 0.3])


MISTAKES = {
    'no calibration': (match, ['part.csg', *PAIR[:2]], 2, ('left.png right.png', 'and calibration')),
    'left and right exchanged': (
        match,
        ['part.csg', 'right.png', 'left.png', PAIR[2]],
        1,
        ('right.png, left.png', 'exchanged', 'Give them in the other order'),
    ),
    'exchanged, for recover': (recover, ['right.png', 'left.png', PAIR[2]], 1, ('right.png, left.png', 'other order')),
    'left twice': (match, ['part.csg', 'left.png', 'left.png', PAIR[2]], 2, ('left.png', 'same', 'give the right')),
    'a copy of left': (recover, ['left.png', 'copy.png', PAIR[2]], 2, ('copy.png', 'same picture', 'give the right')),
    'images of two sizes': (recover, ['left.png', 'small.png', PAIR[2]], 2, ('small.png: 256 x 256', 'two images of')),
    'a calibration of another size': (
        match,
        ['part.csg', *PAIR[:2], 'other_size.yaml'],
        2,
        ('other_size.yaml', '640 x 480', 'left.png', '512 x 512', 'calibrate at this size'),
    ),
    'the left calibration twice': (
        match,
        ['part.csg', *PAIR[:2], 'twice.yaml'],
        2,
        ('twice.yaml', 'P[0,3]', '--baseline METRES'),
    ),
    'calibrations exchanged': (recover, [*PAIR[:2], 'exchanged.yaml'], 2, ('exchanged.yaml', 'left and right exch')),
    'not calibrated': (recover, [*PAIR[:2], 'uncalibrated.yaml'], 2, ('uncalibrated.yaml', 'uncalibrated camera')),
    'one camera only': (recover, [*PAIR[:2], 'one_left.yaml'], 2, ('one_left.yaml', 'one camera', '...right...')),
    'no calibration file': (recover, [*PAIR[:2], 'notes.json'], 2, ('notes.json', 'no projection_matrix', 'expected')),
    'files in another order': (
        match,
        ['part.csg', PAIR[2], *PAIR[:2]],
        2,
        ('calibration.json', 'not a readable image', 'in this order'),
    ),
    'a blurred pair': (
        match,
        ['part.csg', 'blurred_left.png', 'blurred_right.png', PAIR[2]],
        1,
        ('blurred_', 'is blurred', 'made 2 times smaller', 'Focus'),
    ),
    'a shaken pair': (
        match,
        ['part.csg', 'shaken_left.png', 'shaken_right.png', PAIR[2]],
        1,
        ('shaken_left.png, shaken_right.png', 'are blurred', 'Focus'),
    ),
    'a cap on the lens': (
        match,
        ['part.csg', 'black_left.png', 'black_right.png', PAIR[2]],
        1,
        ('black_left.png', 'no edges', '0 to 2', 'Take off the cap'),
    ),
    'raw images': (match, ['part.csg', 'raw_left.png', 'raw_right.png', 'lens.yaml'], 0, ('raw_left.png', '--raw')),
    'text for a picture': (recover, ['text.png', *PAIR[1:]], 2, ('text.png', 'not a readable image')),
    'a picture that is not there': (recover, ['nowhere.png', *PAIR[1:]], 2, ('nowhere.png', 'no such file')),
    'no model': (match, ['left.png', *PAIR], 2, ('left.png', 'not a model file', '.csg', '.stl')),
    'a model that is not there': (match, ['parts.stl', *PAIR], 2, ('parts.stl', 'no such file')),
    'a typing error in a model': (match, ['typo.csg', *PAIR], 2, ('typo.csg:3:', 'BLOK', 'BLOCK')),
    'a model in another unit': (match, ['part_m.csg', *PAIR], 1, ('part_m.csg', 'mm taken for m', 'UNITS')),
    'a mesh in another unit': (
        match,
        ['box.stl', 'boxed.npz', '--mesh-units', 'in'],
        1,
        ('box.stl', 'is found when its unit is mm', '--mesh-units mm'),
    ),
    'a calibration in millimetres': (
        match,
        ['part.csg', *PAIR[:2], 'mm.json'],
        1,
        ('m taken for mm', '--baseline 0.035'),
    ),
    'a broken file of features': (match, ['part.csg', 'broken.npz'], 2, ('broken.npz', 'not an archive of arrays')),
    'a camera for a pair': (match, ['part.csg', *PAIR, '--focal', '700'], 2, ('--focal', 'a pair of images has its')),
    'a negative baseline': (recover, [*PAIR, '--baseline', '-35'], 2, ('--baseline', 'metres above 0')),
    'a result without ending': (match, ['part.csg', *PAIR, '-o', 'found'], 2, ('found', 'such as found.png')),
    'a file in place of a folder': (recover, [*PAIR, '-o', 'left.png'], 2, ('left.png', 'a folder')),
    'a drawing of no kind': (features, ['part.csg', '-o', 'part.doc'], 2, ('--output: part.doc', '.png')),
    'a scene that is not there': (render, ['l_shap'], 2, ('l_shap', 'l_shape')),
    'a program that is not there': (dap, ['run', 'lif'], 2, ('lif', 'life')),
    'a value that is none': (dap, ['run', 'life', '-a', 'cells'], 2, ('cells', 'NAME=VALUE')),
    'a part as CAD keeps it': (match, ['cad.STEP', *PAIR], 2, ('cad.STEP', 'not a model file', 'as .stl from CAD')),
    'the same, for features': (features, ['cad.STEP'], 2, ('cad.STEP', 'expected .csg', 'as .stl from CAD')),
    'exchanged, for view': (
        view,
        ['part.csg', 'right.png', 'left.png', PAIR[2], '-o', 'found.html'],
        1,
        ('right.png, left.png', 'other order'),
    ),
    'a unit, for view': (view, ['part_m.csg', *PAIR, '-o', 'found.html'], 1, ('part_m.csg', 'mm taken for m', 'UNITS')),
    'a page without ending': (view, ['part.csg', *PAIR, '-o', 'found'], 2, ('found', '.html')),
    'no calibration, for view': (view, ['part.csg', *PAIR[:2]], 2, ('left.png right.png', 'and calibration')),
    'no bag': (replay, ['recorded', 'part.csg'], 2, ('recorded', 'no such bag')),
    'a picture for a bag': (replay, ['left.png', 'part.csg'], 2, ('left.png', 'not a bag', '.mcap')),
    'exchanged, for check_rig': (check_rig, ['right.png', 'left.png', PAIR[2]], 1, ('exchanged', 'swapped')),
    'one picture of the camera': (measure_camera, ['left.png'], 2, ('measure_camera:', 'second', 'required')),
    'a folder of models that is not there': (index_models, ['parts'], 2, ('parts', 'no such folder')),
    'no distance for a plan': (plan_rig, ['part.csg'], 2, ('plan_rig:', '--distance', 'required')),
    'an option that there is not': (match, ['part.csg', *PAIR, '--unit', 'mm'], 2, ('match:', '--unit')),
    'a recording that is not there': (track, ['recorded', 'part.csg'], 2, ('recorded', 'expected', 'a bag')),
}


def exit_status(command, arguments: list[str]) -> int:
    try:
        return command(arguments)
    except SystemExit as ended:
        return ended.code


@pytest.mark.parametrize('mistake', MISTAKES)
def test_the_first_line_names_the_mistake_and_the_remedy(made, monkeypatch, tmp_path, capsys, mistake):
    command, arguments, code, words = MISTAKES[mistake]
    monkeypatch.chdir(made)
    out = ['-o', str(tmp_path / 'found')] if command is recover and '-o' not in arguments else []
    assert exit_status(command, [*arguments, *out]) == code
    lines = capsys.readouterr().err.splitlines()
    # Of a model's text the place is shown below the line, indented.
    first = '\n'.join([lines[0], *takewhile(lambda line: line.startswith(' '), lines[1:])])
    assert all(word in first for word in words), first


def test_a_good_pair_is_matched_in_one_command(made, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(made)
    assert match(['part.csg', *PAIR, '-o', str(tmp_path / 'found.png'), '--json']) == 0
    said = capsys.readouterr()
    (found,) = json.loads(said.out)['found']
    truth = csg_renderer.load_scene('part.csg')
    pose = truth.camera_T_scene.compose(truth.placements[0].pose)
    assert np.linalg.norm(np.array(found['position']) - pose.translation) < 1e-4
    assert cv2.imread(str(tmp_path / 'found.png')).shape[:2] == (1024, 1024)


def test_the_remedies_help(made, monkeypatch, capsys):
    """What the first lines say, done."""
    monkeypatch.chdir(made)
    assert match(['part.csg', 'raw_left.png', 'raw_right.png', 'lens.yaml', '--raw']) == 0
    assert match(['part.csg', *PAIR[:2], 'twice.yaml', '--baseline', '0.035']) == 0
    assert match(['part.csg', *PAIR[:2], 'mm.json', '--baseline', '0.035']) == 0
    assert match(['box.stl', 'boxed.npz', '--mesh-units', 'mm']) == 0
    assert capsys.readouterr().err == ''


@pytest.mark.parametrize(
    ('command', 'arguments', 'key'),
    [
        (features, ['part.csg'], 'part'),
        (render, ['--list'], 'scenes'),
        (render, ['part.csg', '-o', 'rendered.png', '--size', '16'], 'written'),
        (recover, [*PAIR], 'features'),
        (dap, ['run', 'life', '--example'], 'arguments'),
        (dap, ['list'], 'life'),
        (dap, ['run', 'lif'], 'error'),
        (track, ['recorded', 'part.csg'], 'error'),
        (match, ['part.csg', 'broken.npz'], 'error'),
        (measure_camera, ['left.png'], 'error'),
        (closed_form, ['l_shape_v1', '--path', 'turn', '--frames', '1', '--size', '64', '64'], 'out'),
    ],
)
def test_with_json_stdout_is_one_object(made, monkeypatch, tmp_path, capfd, command, arguments, key):
    monkeypatch.chdir(made)
    out = ['-o', str(tmp_path / 'found')] if command in (recover, closed_form) else []
    exit_status(command, [*arguments, *out, '--json'])
    assert key in json.loads(capfd.readouterr().out)


def test_completion_knows_options_choices_names_and_files(made, tmp_path):
    (tmp_path / 'completion').write_text(script())

    def completed(*words: str) -> list[str]:
        asked = f"""source {tmp_path}/completion; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}
        COMP_WORDS+=(''); _complete_{words[0]}; printf '%s\\n' "${{COMPREPLY[@]}}" """
        done = subprocess.run(['bash', '-c', asked], cwd=made, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert completed('match', '--mesh-u') == ['--mesh-units']
    assert completed('match', '--mesh-units', 'c') == ['cm']
    assert {'part.csg', 'part_m.csg'} == set(completed('match', 'part'))
    assert completed('dap', 'run', 'lif') == ['life']
    assert 'l_shape_v1' in completed('render', 'l_sh')
