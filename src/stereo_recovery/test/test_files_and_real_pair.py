"""Calibration files, the command line, rectification, and the real stereo pair that comes with the package."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from msgs_py import FeatureKind, FeatureSet, Pose
from stereo_recovery import recover
from stereo_recovery.cameras.calibration import load_cameras, load_rig
from stereo_recovery.cameras.rectification import Rectifier
from stereo_recovery.recover_cli import main

DATA = Path(str(resources.files('stereo_recovery'))) / 'data' / 'chessboard'
BOARDS = Path(__file__).resolve().parents[3] / 'test' / 'chessboards'
SHAPES = {'K': (3, 3), 'D': (1, 5), 'R': (3, 3), 'P': (3, 4)}
SIZE = (640, 480)


def board_features(features, pose):
    """Ends of the edges in the board's frame, for those that lie on the board."""
    start, end = (pose.inverse().apply(x) for x in (features.start, features.end))
    on = (np.abs(start[:, 2]) < 0.3) & (np.abs(end[:, 2]) < 0.3)
    for x in (start, end):
        on &= (x[:, 0] > -0.6) & (x[:, 0] < 8.6) & (x[:, 1] > -1.1) & (x[:, 1] < 6.1)
    return start[on], end[on]


def grid_recall(start, end) -> float:
    """Share of the 123 segments of grid lines between neighbouring corners that edges cover."""
    rows, columns = np.array([-0.96, *range(6), 5.94]), np.array([-0.52, *range(9), 8.48])
    covered = total = 0.0
    for along, lines, limits in ((1, range(9), rows), (0, range(6), columns)):
        for line in lines:
            s, e = (x[:, [along, 1 - along]] for x in (start, end))
            near = (np.abs(s[:, 1] - line) < 0.15) & (np.abs(e[:, 1] - line) < 0.15)
            low, high = np.minimum(s[near, 0], e[near, 0]) - 0.06, np.maximum(s[near, 0], e[near, 0]) + 0.06
            for a, b in zip(limits[:-1], limits[1:]):
                places = a + (np.arange(40) + 0.5) / 40 * (b - a)
                hit = ((places[:, None] >= low) & (places[:, None] <= high)).any(axis=1)
                covered += hit.mean() * (b - a)
                total += b - a
    return covered / total


def plane_normal(start, end) -> np.ndarray:
    points = np.concatenate([start, end])
    weight = np.tile(np.linalg.norm(end - start, axis=1), 2)
    keep = np.ones(len(points), bool)
    for _ in range(4):
        centre = np.average(points[keep], axis=0, weights=weight[keep])
        spread = (points[keep] - centre) * np.sqrt(weight[keep])[:, None]
        normal = np.linalg.svd(spread, full_matrices=False)[2][2]
        keep = np.abs((points - centre) @ normal) < 0.06
    return normal


def check_board(folder: Path, pair: str) -> float:
    """Recall and wrong matches are checked; returns by how many degrees the board's normal is off."""
    raw = folder != DATA
    left, right = (
        cv2.imread(str(folder / f'{side}{pair}{".jpg" if raw else "_rect.png"}'), cv2.IMREAD_GRAYSCALE)
        for side in ('left', 'right')
    )
    rig = load_rig(DATA / 'calibration.yaml', SIZE)
    if raw:
        left, right = Rectifier(*load_cameras(DATA / 'calibration.yaml', SIZE)).apply(left, right)
    joint = json.loads((folder / 'board_poses.json').read_text())[pair]['joint']
    pose = Pose.from_rotation_vector(joint['rvec'], joint['tvec'])
    features = recover(left, right, rig).features.of_kind(FeatureKind.EDGE)
    start, end = board_features(features, pose)
    assert grid_recall(start, end) >= 0.95
    # A match one period off would put an edge in front of or behind the board, inside its outline.
    seen = rig.left.project(features.midpoints).astype(np.float32)
    outline = rig.left.project(pose.apply([[0, 0, 0], [8, 0, 0], [8, 5, 0], [0, 5, 0]])).astype(np.float32)
    inside = np.array([cv2.pointPolygonTest(outline[:, None], (float(u), float(v)), False) > 0 for u, v in seen])
    off = np.abs(pose.inverse().apply(features.midpoints)[:, 2]) > 1.0
    length = np.linalg.norm(rig.left.project(features.start) - rig.left.project(features.end), axis=1)
    assert length[inside & off].sum() <= 0.01 * length[inside].sum()
    return float(np.degrees(np.arccos(abs(plane_normal(start, end)[2]))))


def test_the_packaged_chessboard():
    assert check_board(DATA, '01') < 0.4


def test_the_other_chessboards():
    errors = [check_board(BOARDS, pair) for pair in ('02', '03', '04', '05', '06', '07')]
    assert max(errors) < 0.5
    assert np.median(errors) < 0.25


def test_opencv_calibration_gives_the_rig():
    rig = load_rig(DATA / 'calibration.yaml', SIZE)
    assert rig.left.fx == pytest.approx(516.5623, abs=1e-3)
    assert rig.baseline == pytest.approx(3.32726, abs=1e-4)


def test_opencv_files_say_what_opencv_wrote(tmp_path):
    random = np.random.default_rng(0)
    written = {f'{name}{k}': 10.0 ** random.uniform(-9, 9, shape) for k in (1, 2) for name, shape in SHAPES.items()}
    storage = cv2.FileStorage(str(tmp_path / 'calibration.yaml'), cv2.FILE_STORAGE_WRITE)
    for name, matrix in written.items():
        storage.write(name, matrix)
    storage.release()
    for k, camera in enumerate(load_cameras(tmp_path / 'calibration.yaml', SIZE), 1):
        for name in SHAPES:
            assert getattr(camera, name.lower()) == written[f'{name}{k}'].ravel().tolist()


def camera_info_yaml(name: str, offset: float) -> str:
    return (
        f'image_width: 640\nimage_height: 480\ncamera_name: {name}\ndistortion_model: plumb_bob\n'
        'camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n'
        'distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n'
        'rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n'
        f'projection_matrix: {{rows: 3, cols: 4, data: [500, 0, 320, {offset}, 0, 500, 240, 0, 0, 0, 1, 0]}}\n'
    )


def test_ros_calibration_is_two_files_or_one(tmp_path):
    (tmp_path / 'left.yaml').write_text(camera_info_yaml('left', 0))
    (tmp_path / 'right.yaml').write_text(camera_info_yaml('right', -50))
    assert load_rig(tmp_path / 'left.yaml', SIZE).baseline == pytest.approx(0.1)
    (tmp_path / 'both.yaml').write_text(camera_info_yaml('left', 0) + '---\n' + camera_info_yaml('right', -50))
    assert load_rig(tmp_path / 'both.yaml', SIZE).baseline == pytest.approx(0.1)


def test_the_camera_of_an_ideal_pair_is_one_file(tmp_path):
    (tmp_path / 'left.json').write_text(
        '{"width": 64, "height": 48, "K": [[70, 0, 31.5], [0, 70, 23.5], [0, 0, 1]], "baseline": 0.05}'
    )
    rig = load_rig(tmp_path / 'left.json', SIZE)
    assert rig.baseline == pytest.approx(0.05) and (rig.left.width, rig.left.fx, rig.left.cy) == (64, 70.0, 23.5)
    (tmp_path / 'raw.json').write_text(
        '{"K": [[70, 0, 31.5], [0, 70, 23.5], [0, 0, 1]], "baseline": 0.05, '
        '"distortion_model": "equidistant", "D": [0.1, 0, 0, 0]}'
    )
    assert {(c.distortion_model, *c.d) for c in load_cameras(tmp_path / 'raw.json', SIZE)} == {
        ('equidistant', 0.1, 0.0, 0.0, 0.0)
    }


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'expected a calibration'),
        ('{"K": [1, 2], "baseline": 0.1}', 'expected K, nine numbers'),
        ('a: [', 'not YAML'),
        ('just words', 'expected a calibration'),
        ('image_width: 3', 'describes one camera'),
        ('%YAML:1.0\n---\nK1: 3\n', 'no matrix P1'),
        ('%YAML:1.0\n---\nP1: !!opencv-matrix\n  rows: 3\n  cols: 4\n  data: [1, 2]', 'P1: expected rows x cols'),
        ('%YAML:1.0\n---\nP1: !!opencv-matrix\n  data: [1', 'not readable as OpenCV YAML'),
        ('%YAML:1.0\n---\nP1: ' + 5000 * '[', 'not readable as OpenCV YAML'),
        ('left: {}\nright: {}', 'left camera: projection_matrix'),
    ],
)
def test_unusable_calibration_names_the_file_and_what_it_lacks(tmp_path, text, message):
    path = tmp_path / 'calibration.yaml'
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as raised:
        load_cameras(path, SIZE)
    assert 'calibration.yaml' in str(raised.value)


def test_command_line_writes_features_picture_and_table(tmp_path, capsys):
    code = main(
        [
            str(DATA / 'left01_rect.png'),
            str(DATA / 'right01_rect.png'),
            str(DATA / 'calibration.yaml'),
            '-o',
            str(tmp_path),
            '--baseline',
            '0.083',
        ]
    )
    assert code == 0
    features = FeatureSet.load(tmp_path / 'features.npz')
    assert len(features) > 50
    assert cv2.imread(str(tmp_path / 'features.png')).shape == (480, 640, 3)
    assert len((tmp_path / 'features.csv').read_text().splitlines()) == len(features) + 1
    assert 'EDGE' in capsys.readouterr().out
    again = load_rig(tmp_path / 'camera.json', SIZE)
    assert again.baseline == pytest.approx(0.083) and again.left.fx == pytest.approx(
        load_rig(DATA / 'calibration.yaml', SIZE).left.fx
    )
    assert np.array_equal(cv2.imread(str(tmp_path / 'left.png'), 0), cv2.imread(str(DATA / 'left01_rect.png'), 0))


def test_command_line_says_which_file_is_missing(tmp_path, capsys):
    assert main(['nowhere.png', 'right.png', 'c.yaml', '-o', str(tmp_path)]) == 2
    assert 'nowhere.png: no such file' in capsys.readouterr().err


def raw_camera(offset: float, **change) -> SimpleNamespace:
    k = [500.0, 0, 319.5, 0, 500.0, 239.5, 0, 0, 1]
    p = [500.0, 0, 319.5, offset, 0, 500.0, 239.5, 0, 0, 0, 1, 0]
    r = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]
    return SimpleNamespace(
        **{
            **{
                'width': 640,
                'height': 480,
                'distortion_model': 'plumb_bob',
                'd': [-0.2, 0.05, 0, 0, 0],
                'k': k,
                'r': r,
                'p': p,
            },
            **change,
        }
    )


def test_rectification_straightens_a_distorted_line():
    rectifier = Rectifier(raw_camera(0), raw_camera(-50))
    # A vertical line x = 0.4 z, seen through the lens.
    y = np.linspace(-0.45, 0.45, 2000)
    bent, _ = cv2.projectPoints(
        np.column_stack([np.full_like(y, 0.4), y, np.ones_like(y)]),
        np.zeros(3),
        np.zeros(3),
        np.array(raw_camera(0).k).reshape(3, 3),
        np.array(raw_camera(0).d),
    )
    v, u = np.mgrid[0:480, 0:640]
    at_row = np.interp(v[:, 0], bent[:, 0, 1], bent[:, 0, 0])
    image = np.clip((u - at_row[:, None]) * 100 + 128, 0, 255).astype(np.uint8)
    straight, _ = rectifier.apply(image, image)
    crossing = [np.interp(128, row.astype(float)[500:540], np.arange(500, 540)) for row in straight[60:420]]
    assert np.ptp(crossing) < 0.1
    assert np.mean(crossing) == pytest.approx(319.5 + 200, abs=0.1)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'distortion_model': 'magic'}, 'magic'),
        ({'d': [float('nan')]}, 'D contains NaN'),
        ({'k': [0.0] * 9}, 'K has'),
        ({'r': [0.0] * 9}, 'R is no rotation'),
        ({'d': [0.1] * 3}, 'D has 3'),
    ],
)
def test_unusable_camera_info_is_refused_by_field(change, message):
    with pytest.raises(ValueError, match=message):
        Rectifier(raw_camera(0, **change), raw_camera(-50))


def test_image_of_another_size_than_its_camera_info_is_refused():
    with pytest.raises(ValueError, match='left image: 10 x 20'):
        Rectifier(raw_camera(0), raw_camera(-50)).apply(np.zeros((20, 10), np.uint8), np.zeros((480, 640), np.uint8))
