"""Whether a rig has drifted: right cameras turned by known angles, rendered and in pictures of cameras."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from csg_renderer import load_scene, render, scene_path
from msgs_py import PinholeCamera, Pose, StereoRig, codecs
from msgs_py.node_runtime.runtime import STEREO_TOPICS
from stereo_recovery import RigError, check_rig
from stereo_recovery.check_rig_cli import main
from stereo_recovery.matching.rig_error import mean_error, rig_error
from stereo_recovery.matching.row_error import RowWitnesses
from stereo_recovery.node import RecoveryNode
from stereo_recovery.pair_files import read_pair
from stereo_recovery.rig_check import turned_back

RIG = StereoRig.symmetric(PinholeCamera.centred(512, 512, 703.0), 0.035)
BOARD = Path(str(resources.files('stereo_recovery') / 'data' / 'chessboard'))


def pictures(turn_deg, seeds: int = 1) -> list[tuple[np.ndarray, np.ndarray]]:
    """The table, seen by a rig whose right camera is turned, with so many noises of 2 grey levels."""
    scene = load_scene(scene_path('table'))
    view = scene.camera_T_scene
    turned = Pose(Pose.from_rotation_vector(np.radians(turn_deg)).rotation, [RIG.baseline, 0.0, 0.0])
    clean = [
        cv2.cvtColor(
            render(scene, camera, first_T_camera.inverse().compose(view), antialias=True).image, cv2.COLOR_RGB2GRAY
        )
        for camera, first_T_camera in ((RIG.left, Pose.identity()), (RIG.right, turned))
    ]
    found = []
    for seed in range(1, seeds + 1):
        rng = np.random.default_rng(seed)
        left, right = (np.clip(np.rint(grey + rng.normal(0.0, 2.0, grey.shape)), 0, 255) for grey in clean)
        found.append((left.astype(np.uint8), right.astype(np.uint8)))
    return found


@pytest.mark.parametrize(
    'turn_deg', [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.1, 0.2, -0.2], [0.0, 0.0, 0.1]]
)
def test_a_turned_camera_is_found_within_its_stated_sigma(turn_deg):
    scores, drifted = [], []
    for pair in pictures(turn_deg, seeds=7):
        error, reason = check_rig(*pair, RIG)
        assert error is not None and not reason and error.tells
        off = error.rotation - np.radians(turn_deg)
        scores.append(off @ np.linalg.solve(error.covariance[:3, :3], off))
        assert np.degrees(error.sigma[0]) < 0.01 and np.degrees(error.sigma[2]) < 0.03, 'and that sigma says something'
        drifted.append(error.has_drifted())
        assert error.has_drifted(0.0) == (max(np.abs(turn_deg)) > 0.0), 'a perfect calibration would have told'
    # A roll of a tenth of a degree is four sigma of a fresh calibration.
    assert (np.mean(drifted) > 0.5) == (max(np.abs(turn_deg)) > 0.05)
    # Edges are sampled alike in all pictures of one rig, so that their errors are not independent.
    assert np.median(scores) < 7.8, f'{scores} for {turn_deg}: chi-squared, 5 %'
    assert max(scores) < 21.1, f'{scores} for {turn_deg}: chi-squared, 1 in 10,000'


def test_a_real_rig_is_in_order_and_its_pair_turned_is_not():
    pair = read_pair((BOARD / 'left01_rect.png', BOARD / 'right01_rect.png'), BOARD / 'calibration.yaml')
    before, _ = check_rig(pair.left, pair.right, pair.rig)
    assert not before.has_drifted()
    # The camera turned by this much takes what the one as calibrated would have, turned the other way.
    turn = np.radians([-0.2, 0.0, 0.1])
    taken = turned_back(pair.right, pair.rig, Pose.from_rotation_vector(turn).rotation.T)
    after, _ = check_rig(pair.left, taken, pair.rig)
    assert after.has_drifted()
    np.testing.assert_array_less(np.abs(after.rotation - before.rotation - turn), 2.0 * after.sigma)


def witnesses(rotation_deg, seed: int, count: int = 60) -> RowWitnesses:
    """Rows of a camera that is turned, exactly, but for their stated errors and one in ten that is none."""
    rng = np.random.default_rng(seed)
    ideal = rng.uniform(20.0, 490.0, (count, 2))
    camera = RIG.right
    rays = np.column_stack([(ideal - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(count)])
    seen = rays @ Pose.from_rotation_vector(np.radians(rotation_deg)).rotation
    point = seen[:, :2] / seen[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    sigma = rng.uniform(0.02, 0.3, count)
    off = point[:, 1] - ideal[:, 1] + sigma * rng.normal(size=count)
    off[::10] = rng.uniform(-3.0, 3.0, len(off[::10]))
    return RowWitnesses(point, off, sigma)


def test_stated_errors_are_those_of_many_trials():
    truth = [0.05, 0.1, -0.1]
    scores = []
    for seed in range(60):
        found = rig_error(witnesses(truth, seed), RIG, 0.01)
        off = found.rotation - np.radians(truth)
        scores.append(off @ np.linalg.solve(found.covariance[:3, :3], off))
    assert 0.5 < np.mean(scores) / 3.0 < 1.4


def test_nothing_seen_tells_nothing():
    nothing = RowWitnesses(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    error = rig_error(nothing, RIG, 0.01)
    assert not error.tells and not error.has_drifted() and 'too little is seen' in error.verdict()


def test_several_pairs_are_as_certain_as_one_and_their_mean():
    errors = [rig_error(witnesses([0.05, 0.0, 0.0], seed), RIG, 0.01) for seed in range(8)]
    together = mean_error(errors)
    assert isinstance(together, RigError)
    assert together.sigma[0] == pytest.approx(np.mean([e.sigma[0] for e in errors]), rel=0.3)
    assert np.degrees(together.rotation[0]) == pytest.approx(0.05, abs=0.005)


@pytest.fixture
def files(tmp_path):
    """A pair as calibrated, the right image of a camera that has turned, a picture without edges, and a calibration."""
    left, right = pictures([0.0, 0.0, 0.0])[0]
    turned = turned_back(right, RIG, Pose.from_rotation_vector(np.radians([0.15, 0.0, 0.0])).rotation.T)
    record = {'K': [[703.0, 0.0, 255.5], [0.0, 703.0, 255.5], [0.0, 0.0, 1.0]], 'baseline': 0.035}
    (tmp_path / 'camera.json').write_text(json.dumps(record | {'width': 512, 'height': 512}))
    for name, image in {'left': left, 'right': right, 'turned': turned, 'dark': right // 250}.items():
        cv2.imwrite(str(tmp_path / f'{name}.png'), image)
    return tmp_path


@pytest.mark.parametrize(
    ('right', 'code', 'text'),
    [
        ('right', 0, 'no drift: pitch'),
        ('turned', 1, 'the rig has drifted since it was calibrated: pitch +0.1'),
        ('dark', 1, 'the pair does not tell: no texture: no edges in the right image'),
        ('missing', 2, 'missing.png: no such file'),
    ],
)
def test_the_command_says_whether_and_by_how_much(files, capsys, right, code, text):
    given = [str(files / name) for name in ('left.png', f'{right}.png', 'camera.json')]
    assert main(given) == code
    out = capsys.readouterr()
    assert text in out.out + out.err
    assert main([*given, '--json']) == code
    record = json.loads(capsys.readouterr().out)
    assert record.get('drifted', 'error') == {'right': False, 'turned': True, 'dark': None}.get(right, 'error')
    if right == 'turned':
        assert np.degrees(record['rotation'][0]) == pytest.approx(0.15, abs=0.01)


def test_recovery_node_warns_of_a_rig_that_has_drifted(graph, files):
    node = graph.add(RecoveryNode)
    statuses = graph.collect(DiagnosticArray, '/diagnostics')
    sources = [graph.publisher(CameraInfo if t.endswith('info') else Image, t) for t in STEREO_TOPICS]
    graph.wait_matched(*sources)
    graph.wait_heard('/diagnostics')

    def reports(processed: int) -> list[DiagnosticStatus]:
        """Those of the node that count so many pairs: one from before may arrive after the pair is done."""
        own = [m.status[0] for m in statuses if m.status[0].name == '/recovery_node']
        return [one for one in own if KeyValue(key='processed', value=str(processed)) in one.values]

    def told(second: int, right: str) -> tuple[str, dict[str, str]]:
        """Message and values of the first status after a pair."""
        at = Header(frame_id='left_optical')
        at.stamp.sec = second
        images = [cv2.imread(str(files / f'{name}.png'), cv2.IMREAD_GRAYSCALE) for name in ('left', right)]
        infos = codecs.camera_infos_from_rig(RIG, at)
        for k in range(2):
            sources[2 * k].publish(codecs.array_to_image(images[k], 'mono8', at))
            sources[2 * k + 1].publish(infos[k])
        graph.spin_until(lambda: reports(second), what='a status of the pair')
        status = reports(second)[0]
        return status.message, {item.key: item.value for item in status.values}

    message, values = told(1, 'right')
    assert message == 'ok' and values['rig.drifted'] == 'False' and abs(float(values['rig.pitch_deg'])) < 0.02
    node.reset()
    message, values = told(2, 'turned')
    assert message.startswith('the rig has drifted since it was calibrated: pitch +0.1')
    assert values['rig.drifted'] == 'True' and float(values['rig.pitch_deg']) == pytest.approx(0.15, abs=0.01)
    assert float(values['rig.rows_middle_px']) == pytest.approx(0.15 * np.pi / 180.0 * 703.0, abs=0.15)
