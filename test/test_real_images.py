"""Real stereo pairs, from the images to the pose: chessboards (the first comes with the package) and a tea box.

The other pairs are looked for where test/benchmarks/real_scoring.py says; without them their tests are skipped.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseArray, PoseStamped
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

import csg_renderer
from model_matcher import match
from model_matcher.closed_form.real_pair import SQUARE_M, board_symmetries, chessboard_model
from model_matcher.node import MatcherConfig, MatcherNode
from msgs_py import FeatureSet, Pose, StereoRig, codecs
from stereo_recovery import recover
from stereo_recovery.node import RecoveryNode

# Floors: degrees, and share of the depth, at the model's middle.
ROTATION_DEG, OF_DEPTH = 0.6, 0.004
BOX_MM = (165, 80, 68)
BOX = 'UNITS MM;\ntea_box = BLOCK ({}, {}, {});\nDRAW tea_box;\n'.format(*BOX_MM)
TEA_BOX_EDGES = 5
# The box's reference itself is trusted to a millimetre, 0.25 % of depth.
OF_DEPTH_OF_BOX = 0.005
# px: the second pair's reference is off by more than this from what its pictures show, which is why no pose is judged
# by it, see :func:`test_the_second_tea_box_is_not_where_its_reference_is`; recovered edges are off by less.
CONTRADICTION, AGREEMENT = 0.6, 0.5


def _scoring():
    name = 'real_scoring'
    if name not in sys.modules:
        path = Path(__file__).parent / 'benchmarks' / 'real_scoring.py'
        spec = importlib.util.spec_from_file_location(name, path)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


scoring = _scoring()
BOARDS = {pair.name: pair for pair in scoring.chessboards()}
BOXES = {pair.name: pair for pair in scoring.teaboxes()}
NAMES = [*(f'chessboard {k:02d}' for k in range(1, 8)), 'tea box 000']


@dataclass
class Case:
    """A pair in metres, its model, and every pose that the model's symmetry makes as true."""

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    model: FeatureSet
    true: list[Pose]

    def error_of(self, pose: Pose) -> tuple[float, float]:
        """Degrees, and share of the depth by which the model's middle is off; of the nearest true pose."""
        low = np.minimum(self.model.start, self.model.end).min(axis=0)
        middle = 0.5 * (low + np.maximum(self.model.start, self.model.end).max(axis=0))
        errors = [
            (
                true.error_to(pose).rotation_deg,
                float(np.linalg.norm(true.apply(middle) - pose.apply(middle))) / true.apply(middle)[2],
            )
            for true in self.true
        ]
        return min(errors)


def case(name: str) -> Case:
    if name in BOARDS:
        pair = BOARDS[name]
        rig = StereoRig(pair.rig.left, pair.rig.right, pair.rig.baseline * SQUARE_M)
        truth = Pose(pair.left_T_object.rotation, SQUARE_M * pair.left_T_object.translation)
        model = chessboard_model()
        # A flat grid is also itself seen from behind.
        over = np.diag([1.0, -1.0, -1.0])
        middle = SQUARE_M * np.array([4.0, 2.5, 0.0])
        both = [truth, *board_symmetries(truth)]
        turned = [pose.compose(Pose(over, middle - over @ middle)) for pose in both]
        return Case(pair.left, pair.right, rig, model, both + turned)
    if name in BOXES:
        pair = BOXES[name]
        solid = csg_renderer.Solid.block(*(1e-3 * x for x in BOX_MM))
        middle = 0.5e-3 * np.array(BOX_MM)
        true = []
        for turn in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
            half = np.diag(np.array(turn, float))
            true.append(pair.left_T_object.compose(Pose(half, middle - half @ middle)))
        return Case(pair.left, pair.right, pair.rig, csg_renderer.model_features(solid), true)
    pytest.skip(f'{name} is not here: no such data in STEREO_REAL_DATA or beside the project (../shared/real)')


@pytest.mark.parametrize('name', NAMES)
def test_the_right_pose_of_a_real_object(name):
    real = case(name)
    features = recover(real.left, real.right, real.rig).features
    params = MatcherConfig().match_params().replace(time_limit_s=20.0)
    best = match(real.model, features, params).best
    assert best is not None
    rotation, share = real.error_of(best.pose)
    assert rotation < ROTATION_DEG and share < (OF_DEPTH_OF_BOX if name in BOXES else OF_DEPTH)


@pytest.mark.parametrize('name', ['tea box 000'])
def test_most_edges_of_the_tea_box_are_recovered(name):
    real = case(name)
    score = scoring.score_box(BOXES[name], recover(real.left, real.right, real.rig).features)
    found = score.covered >= scoring.COVERED
    assert found.sum() >= TEA_BOX_EDGES
    assert np.median(score.angle[found]) < 1.5
    assert np.median(score.across[found]) < 2.5e-3


def printed_disparity(pair) -> tuple[np.ndarray, np.ndarray]:
    """Places (k, 2) of the left image on the box's printed top, and their disparities (k,), pixels, by OpenCV alone."""
    left, right = (image.astype(np.uint8) for image in (pair.left, pair.right))
    share = np.stack(np.meshgrid(np.linspace(0.08, 0.92, 22), np.linspace(0.1, 0.9, 14)), axis=-1).reshape(-1, 2)
    top = np.column_stack([share[:, 0] * BOX_MM[0], np.zeros(len(share)), share[:, 1] * BOX_MM[2]]) * 1e-3
    places, disparities = [], []
    for u, v in zip(*pair.rig.project(pair.left_T_object.apply(top))):
        patch = cv2.getRectSubPix(left, (17, 17), tuple(u.tolist()))
        if patch.std() < 12.0:
            continue
        window = cv2.getRectSubPix(right, (33, 23), tuple(v.tolist()))
        score = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(score.argmax(), score.shape)
        if score.max() < 0.9 or not 0 < column < score.shape[1] - 1:
            continue
        a, b, c = score[row, column - 1 : column + 2]
        places.append(u)
        disparities.append(u[0] - v[0] - (column - 8 + 0.5 * (a - c) / (a - 2.0 * b + c)))
    return np.array(places), np.array(disparities)


def plane_of(places: np.ndarray, disparities: np.ndarray) -> np.ndarray:
    """(3,) disparity's plane, of u, v and one, by robust least squares."""
    rows = np.column_stack([places, np.ones(len(places))])
    weight = np.ones(len(rows))
    for _ in range(20):
        plane = np.linalg.lstsq(rows * weight[:, None], disparities * weight, rcond=None)[0]
        weight = 1.0 / np.sqrt(1.0 + ((disparities - rows @ plane) / 0.3) ** 2)
    return plane


def test_the_second_tea_box_is_not_where_its_reference_is():
    """Between its two exposures something moved: its print says so, by OpenCV's template matching."""
    name = 'tea box 005'
    if name not in BOXES:
        pytest.skip('no tea box in STEREO_REAL_DATA or beside the project (../shared/real)')
    pair = BOXES[name]
    places, disparities = printed_disparity(pair)
    top = pair.left_T_object.apply(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) * 0.05)
    left, right = pair.rig.project(top)
    stated = plane_of(left, (left - right)[:, 0])
    off = disparities - np.column_stack([places, np.ones(len(places))]) @ stated
    assert len(off) > 100
    assert np.median(off) > CONTRADICTION


@pytest.mark.parametrize('name', [name for name in ('tea box 000', 'tea box 005') if name in BOXES])
def test_the_edges_of_the_tea_boxes_lie_where_their_print_is(name):
    pair = BOXES[name]
    plane = plane_of(*printed_disparity(pair))
    features = recover(pair.left, pair.right, pair.rig).features
    corners = pair.left_T_object.apply(np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]) * 1e-3 * np.array(BOX_MM))
    shown = pair.rig.left.project(corners)
    off = []
    for a, b in zip(shown, np.roll(shown, -1, axis=0)):
        across = np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a))
        for start, end in zip(features.start, features.end):
            ends, there = pair.rig.project(np.stack([start, end]))
            along = (ends - a) @ (b - a) / ((b - a) @ (b - a))
            beside = np.abs((ends - a) @ across).max() < 3.0 and along.min() > -0.1 and along.max() < 1.1
            if beside and np.hypot(*(ends[1] - ends[0])) > 20.0:
                off += ((ends - there)[:, 0] - np.column_stack([ends, np.ones(2)]) @ plane).tolist()
    assert len(off) >= 8, 'four edges of the top or more'
    # Folds of card are rounded, so that single ends lie before or behind the print by up to two millimetres.
    assert abs(np.median(off)) < AGREEMENT
    assert np.median(np.abs(off)) < 2.0 * AGREEMENT


@pytest.mark.parametrize('factor', [0.5, 2.0])
def test_the_packaged_board_at_another_resolution(factor):
    pair = BOARDS['chessboard 01'].scaled(factor)
    score = scoring.score_board(pair, recover(pair.left, pair.right, pair.rig).features)
    assert score.recall > 0.8 and score.wrong < 0.03 and score.normal_deg < 0.5


@pytest.mark.parametrize('name', ['chessboard 01', 'tea box 000'])
def test_from_real_images_through_the_graph_to_the_pose(graph, tmp_path, name):
    real = case(name)
    if name in BOXES:
        path = tmp_path / 'tea_box.csg'
        path.write_text(BOX)
    else:
        path = tmp_path / 'board.npz'
        real.model.save(path)
    graph.add(RecoveryNode)
    graph.add(MatcherNode, parameters={'models': [str(path)], 'time_limit': 20.0})
    arrays = graph.collect(PoseArray, 'interpretations')
    poses = graph.collect(PoseStamped, f'interpretations/{path.stem}')
    images = [graph.publisher(Image, f'{side}/image_rect') for side in ('left', 'right')]
    infos = [graph.publisher(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')]
    graph.wait_matched(*images, *infos)
    graph.wait_heard('/features', '/interpretations', f'/interpretations/{path.stem}')
    header = Header(frame_id='camera_left_optical_frame')
    header.stamp.sec = 3
    for publisher, image in zip(images, (real.left, real.right)):
        publisher.publish(codecs.array_to_image(image, 'mono8', header))
    for publisher, info in zip(infos, codecs.camera_infos_from_rig(real.rig, header)):
        publisher.publish(info)
    graph.spin_until(lambda: arrays and poses, 40.0, 'a pose')
    rotation, share = real.error_of(codecs.pose_from_message(poses[0].pose))
    assert poses[0].header == header
    assert rotation < ROTATION_DEG and share < OF_DEPTH
