"""The track command: folders and bags in; poses, film and plot out; what cannot be used is named."""

from __future__ import annotations

import csv
import importlib.util
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from model_matcher.closed_form.bop.results import read_results
from model_matcher.closed_form.case import Case
from model_matcher.closed_form.following.track_cli import main
from model_matcher.closed_form.following.track_film import animated_png
from model_matcher.closed_form.sequences.motion import Motion
from model_matcher.closed_form.sequences.sequence import read_sequence, rendered_sequence, write_sequence
from model_matcher.match_cli import main as match_main
from msgs_py import Pose
from stereo_recovery import recover

FRAMES = 6
CASE = Case('chipped_block_v1', width=320, height=240, focal=300.0, antialias=2)


@pytest.fixture(scope='module')
def sequence(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('sequence')
    motion = Motion('turn', frames=FRAMES, turn_deg_s=30.0, shift_m_s=0.03)
    write_sequence(folder, rendered_sequence(CASE, motion), CASE, motion)
    return folder


def test_a_written_sequence_becomes_poses_film_and_plot(sequence, tmp_path, capsys):
    assert main([str(sequence), CASE.scene, '-o', str(tmp_path), '--film', 'film.png', '-q']) == 0
    assert f'{FRAMES} frames, followed in {FRAMES}' in capsys.readouterr().out
    with (tmp_path / 'poses.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    truth = read_sequence(sequence).poses
    for row, true in zip(rows, truth, strict=True):
        pose = Pose.from_quaternion(
            [float(row[key]) for key in ('qx', 'qy', 'qz', 'qw')], [float(row[key]) for key in ('x_m', 'y_m', 'z_m')]
        )
        assert true.error_to(pose).rotation_deg < 0.3
    assert [row['state'] for row in rows[:2]] == ['found', 'followed']
    lines = (tmp_path / 'poses.tum').read_text().splitlines()
    assert len(lines) == FRAMES
    assert all(len(line.split()) == 8 for line in lines)
    for number, (one, true) in enumerate(zip(read_results(tmp_path / 'poses_bop.csv'), truth, strict=True)):
        assert (one.scene_id, one.image_id, one.object_id) == (1, number, 1)
        assert one.score > 0.7
        assert true.error_to(one.pose).rotation_deg < 0.3
    assert cv2.imread(str(tmp_path / 'plot.png')) is not None
    film = cv2.imread(str(tmp_path / 'film.png'))
    assert film.shape == (240, 320, 3)
    assert (film[..., 1].astype(int) - film[..., 2] > 100).sum() > 100  # the outline, green


def test_one_camera_needs_a_pose_to_start_from(sequence, tmp_path, capsys):
    folder = tmp_path / 'left'
    folder.mkdir()
    for number in range(2):
        image = cv2.imread(str(sequence / 'images' / f'{number:06d}_left.png'))
        cv2.imwrite(str(folder / f'{number}.png'), image)
    (folder / 'camera.json').write_text((sequence / 'camera.json').read_text())
    arguments = [str(folder), CASE.scene, '-o', str(tmp_path / 'out'), '-q']
    assert main(arguments) == 2
    assert 'start: one camera' in capsys.readouterr().err
    true = read_sequence(sequence).poses[0]
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(true.rotation).as_euler('xyz', degrees=True)
    assert main([*arguments, '--start', *(str(x) for x in (*angles, *(1e3 * true.translation)))]) == 0


def test_a_bag_is_followed(tmp_path, capsys):
    pytest.importorskip('rosbags', reason='rosbags (pip) is not installed')
    path = Path(__file__).resolve().parent / 'bags' / 'make_bag.py'
    spec = importlib.util.spec_from_file_location('make_bag', path)
    tools = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tools)
    tools.write_bag(tmp_path / 'bag', pairs=2)
    assert main([str(tmp_path / 'bag'), 'l_shape', '-o', str(tmp_path / 'out'), '-q', '--film', 'film.avi']) == 1
    assert '2 frames, followed in 0' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda folder: None, 'there are no pictures'),
        (lambda folder: cv2.imwrite(str(folder / 'left.png'), np.zeros((4, 4), np.uint8)), 'camera.json'),
    ],
)
def test_what_cannot_be_followed_is_named(tmp_path, capsys, make, words):
    make(tmp_path)
    assert main([str(tmp_path), 'l_shape', '-o', str(tmp_path / 'out'), '-q']) == 2
    assert words in capsys.readouterr().err


def test_an_animated_png_has_every_frame_once():
    pictures = [np.full((6, 8, 3), 20 * k, np.uint8) for k in range(5)]
    data = animated_png(pictures, 25.0)
    assert struct.unpack('>II', data[data.index(b'acTL') + 4 :][:8]) == (5, 0)
    assert data.count(b'fcTL') == 5
    assert data.count(b'fdAT') == 4
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (6, 8, 3)


def test_match_measures_in_the_images(sequence, tmp_path, capsys):
    frame = next(iter(read_sequence(sequence)))
    recover(*frame.images, read_sequence(sequence).rig).features.save(tmp_path / 'features.npz')
    left, right = (str(sequence / 'images' / f'000000_{side}.png') for side in ('left', 'right'))
    arguments = [CASE.scene, str(tmp_path / 'features.npz'), '--camera', str(sequence / 'camera.json')]
    assert match_main([*arguments, '--image', left, '--right', right]) == 0
    assert '1 found' in capsys.readouterr().out
    assert match_main([*arguments, '--right', right]) == 2
    assert '--right: needs --image' in capsys.readouterr().err
