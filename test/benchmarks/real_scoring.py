"""Real stereo pairs with reference poses, and scores of what is recovered from them.

Seven chessboard pairs (the first comes with stereo_recovery) and two pairs of a box, in the folder that the environment
variable STEREO_REAL_DATA names, or in ../shared/real beside the project; see its README. Lengths of the chessboards
are in squares.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from msgs_py import FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig
from stereo_recovery.cameras.calibration import load_cameras, load_rig
from stereo_recovery.cameras.rectification import Rectifier

PACKAGED = Path(str(resources.files('stereo_recovery'))) / 'data' / 'chessboard'
BOARDS = Path(__file__).resolve().parents[1] / 'chessboards'
# Where the printed pattern ends, squares; the inner corners (i, j) lie at (i, j, 0).
COLUMNS, ROWS = np.array([-0.52, *range(9), 8.48]), np.array([-0.96, *range(6), 5.94])
# A found edge belongs to the box when its direction and its ends are this near to one of its edges (the rounded card
# folds of the real one leave the ideal box by some millimetres), and to the board's plane when this near, squares.
SAME_ANGLE_DEG, SAME_PLACE_M, ON_BOARD = 10.0, 0.008, 0.3
COVERED = 0.5


def real_folder() -> Path | None:
    """The folder with chessboard/ and teabox/, or None when this machine has none."""
    named = os.environ.get('STEREO_REAL_DATA')
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / 'shared' / 'real'
    return folder if folder.is_dir() else None


@dataclass(frozen=True, eq=False)
class RealPair:
    """A rectified pair and its reference. left_T_object: the pose of the board (squares) or the box (metres)."""

    name: str
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    left_T_object: Pose
    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3)))

    @property
    def depth(self) -> float:
        return float(self.left_T_object.translation[2])

    def scaled(self, factor: float) -> RealPair:
        """The same pair at another resolution."""
        size = (round(self.left.shape[1] * factor), round(self.left.shape[0] * factor))
        how = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_CUBIC
        cameras = []
        for camera in (self.rig.left, self.rig.right):
            x, y = size[0] / camera.width, size[1] / camera.height
            cameras.append(
                PinholeCamera(
                    *size, camera.fx * x, camera.fy * y, (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5
                )
            )
        return RealPair(
            f'{self.name} x {factor:g}',
            cv2.resize(self.left, size, interpolation=how),
            cv2.resize(self.right, size, interpolation=how),
            StereoRig(*cameras, self.rig.baseline),
            self.left_T_object,
            self.edges,
        )


def _grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return image


def chessboards() -> list[RealPair]:
    """All seven pairs: rectified ones where the real data is, else the packaged one and six that are rectified here."""
    folder = real_folder()
    if folder is None or not (folder / 'chessboard').is_dir():
        return [*_rectified_boards(PACKAGED), *_raw_boards()]
    return _rectified_boards(folder / 'chessboard')


def _raw_boards() -> list[RealPair]:
    """Pairs 02 to 07 of the repository, as the cameras took them, rectified."""
    poses = json.loads((BOARDS / 'board_poses.json').read_text())
    size = (640, 480)
    rectifier = Rectifier(*load_cameras(PACKAGED / 'calibration.yaml', size))
    rig = load_rig(PACKAGED / 'calibration.yaml', size)
    result = []
    for number, pose in sorted(poses.items()):
        images = rectifier.apply(*(_grey(BOARDS / f'{side}{number}.jpg') for side in ('left', 'right')))
        joint = pose['joint']
        result.append(
            RealPair(f'chessboard {number}', *images, rig, Pose.from_rotation_vector(joint['rvec'], joint['tvec']))
        )
    return result


def _rectified_boards(folder: Path) -> list[RealPair]:
    """The pairs of a folder that are rectified."""
    poses = json.loads((folder / 'board_poses.json').read_text())
    result = []
    for number in sorted(poses):
        if not (folder / f'left{number}_rect.png').exists():
            continue
        left, right = (_grey(folder / f'{side}{number}_rect.png') for side in ('left', 'right'))
        joint = poses[number]['joint']
        rig = load_rig(folder / 'calibration.yaml', (left.shape[1], left.shape[0]))
        result.append(
            RealPair(f'chessboard {number}', left, right, rig, Pose.from_rotation_vector(joint['rvec'], joint['tvec']))
        )
    return result


def teaboxes() -> list[RealPair]:
    """The pairs of the box that are here, with the box's visible edges (7, 2, 3), left optical frame, metres."""
    folder = real_folder()
    if folder is None or not (folder / 'teabox').is_dir():
        return []
    folder = folder / 'teabox'
    reference = json.loads((folder / 'box_poses.json').read_text())
    given = json.loads((folder / 'calibration.json').read_text())['rectified']
    vertices, visible = np.array(reference['vertices_m']), np.array(reference['visible_edges'])
    result = []
    for number, entry in sorted(reference['poses'].items()):
        left, right = (_grey(folder / f'{side}{number}_rect.png') for side in ('left', 'right'))
        camera = PinholeCamera(*given['size'], given['f'], given['f'], given['cx'], given['cy'])
        pose = Pose.from_rotation_vector(entry['rvec'], entry['tvec_m'])
        result.append(
            RealPair(
                f'tea box {number}',
                left,
                right,
                StereoRig.symmetric(camera, given['baseline_m_corrected']),
                pose,
                pose.apply(vertices)[visible],
            )
        )
    return result


@dataclass
class BoardScore:
    """recall : share of the grid's edge length; wrong : share of the reported length inside the board that lies off its
    plane (a match a period off); normal_deg : of the plane through the edges; angles, offsets : of every edge on a grid
    line, degrees and squares."""

    recall: float
    wrong: float
    normal_deg: float
    angles: np.ndarray
    offsets: np.ndarray


def score_board(pair: RealPair, features: FeatureSet) -> BoardScore:
    features = features.of_kind(FeatureKind.EDGE)
    board = pair.left_T_object.inverse()
    start, end = board.apply(features.start), board.apply(features.end)
    on = (np.abs(start[:, 2]) < ON_BOARD) & (np.abs(end[:, 2]) < ON_BOARD)
    for x in (start, end):
        on &= (np.abs(x[:, 0] - 4.0) < 4.6) & (np.abs(x[:, 1] - 2.5) < 3.6)
    camera = pair.rig.left
    outline = camera.project(pair.left_T_object.apply([[0, 0, 0], [8, 0, 0], [8, 5, 0], [0, 5, 0]]))
    seen = camera.project(features.midpoints)
    inside = np.array(
        [cv2.pointPolygonTest(outline.astype(np.float32)[:, None], (float(u), float(v)), False) > 0 for u, v in seen],
        bool,
    )
    length = np.linalg.norm(camera.project(features.start) - camera.project(features.end), axis=1)
    off = np.abs(board.apply(features.midpoints)[:, 2]) > 1.0
    wrong = float(length[inside & off].sum() / max(length[inside].sum(), 1e-9))
    start, end = start[on], end[on]
    covered = total = 0.0
    angles, offsets = [], []
    for along, lines, limits in ((1, range(9), ROWS), (0, range(6), COLUMNS)):
        for line in lines:
            s, e = (x[:, [along, 1 - along]] for x in (start, end))
            near = (np.abs(s[:, 1] - line) < 0.15) & (np.abs(e[:, 1] - line) < 0.15)
            low, high = np.minimum(s[near, 0], e[near, 0]) - 0.06, np.maximum(s[near, 0], e[near, 0]) + 0.06
            run = end[near] - start[near]
            angles += [*np.degrees(np.arccos(np.minimum(1.0, np.abs(run[:, along]) / np.linalg.norm(run, axis=1))))]
            offsets += [np.hypot(x[near, 1 - along] - line, x[near, 2]) for x in (start, end)]
            for a, b in zip(limits[:-1], limits[1:]):
                places = a + (np.arange(40) + 0.5) / 40 * (b - a)
                covered += ((places[:, None] >= low) & (places[:, None] <= high)).any(axis=1).mean() * (b - a)
                total += b - a
    return BoardScore(covered / total, wrong, _normal_error(start, end), np.array(angles), np.concatenate(offsets))


def _normal_error(start: np.ndarray, end: np.ndarray) -> float:
    """Degrees between the board's z axis and the normal of the plane through edges given in the board's frame."""
    points = np.concatenate([start, end])
    if len(points) < 6:
        return float('nan')
    weight = np.tile(np.linalg.norm(end - start, axis=1), 2)
    keep = np.ones(len(points), bool)
    for _ in range(4):
        centre = np.average(points[keep], axis=0, weights=weight[keep])
        normal = np.linalg.svd((points[keep] - centre) * np.sqrt(weight[keep])[:, None], full_matrices=False)[2][2]
        keep = np.abs((points - centre) @ normal) < 0.06
    return float(np.degrees(np.arccos(min(1.0, abs(normal[2])))))


@dataclass
class BoxScore:
    """covered : (7,) share of each edge; angle : (7,) degrees, median along it; across : (7,) metres, median distance
    of the ends of its pieces from the true line (NaN where nothing was found)."""

    covered: np.ndarray
    angle: np.ndarray
    across: np.ndarray

    @property
    def edges(self) -> int:
        return int((self.covered >= COVERED).sum())


def score_box(pair: RealPair, features: FeatureSet) -> BoxScore:
    """A found edge belongs to the true one whose line it follows, both ends within SAME_PLACE_M of it; where pieces
    overlap (print runs beside the edges) each edge is judged by the pieces nearest to it."""
    features = features.of_kind(FeatureKind.EDGE)
    samples = (np.arange(200) + 0.5) / 200
    covered, angle, across = np.zeros(len(pair.edges)), *np.full((2, len(pair.edges)), np.nan)
    mine: dict[int, list[tuple]] = {}
    for start, end in zip(features.start, features.end):
        options = []
        for m, (a, b) in enumerate(pair.edges):
            length = np.linalg.norm(b - a)
            line = (b - a) / length
            turn = np.degrees(np.arccos(min(1.0, abs((end - start) @ line) / max(np.linalg.norm(end - start), 1e-12))))
            places = np.array([(x - a) @ line for x in (start, end)])
            off = max(np.linalg.norm(x - a - np.clip(p, 0, length) * line) for x, p in zip((start, end), places))
            if turn < SAME_ANGLE_DEG and off < SAME_PLACE_M:
                beside = [np.linalg.norm(x - a - p * line) for x, p in zip((start, end), places)]
                options.append((off, m, turn, beside, np.sort(places) / length))
        if options:
            best = min(options, key=lambda option: option[0])
            mine.setdefault(best[1], []).append(best)
    for m, pieces in mine.items():
        # Print runs beside the edges: each place along one is judged by the piece nearest to it.
        hit = np.array([(samples >= p[4][0]) & (samples <= p[4][1]) for p in pieces])
        covered[m] = hit.any(axis=0).mean()
        if covered[m] == 0.0:
            continue
        away = np.where(hit, np.array([[np.mean(p[3])] for p in pieces]), np.inf)
        judged = away.argmin(axis=0)[hit.any(axis=0)]
        angle[m] = np.median([pieces[k][2] for k in judged])
        across[m] = np.median([pieces[k][3] for k in judged])
    return BoxScore(covered, angle, across)


def disparity_window(pair: RealPair) -> tuple[float, float]:
    """What the usual recipe has to be told: 0.75 to 1.25 times the object's disparity, pixels."""
    points = (
        pair.edges.reshape(-1, 3)
        if len(pair.edges)
        else pair.left_T_object.apply([[x, y, 0.0] for x in COLUMNS[[0, -1]] for y in ROWS[[0, -1]]])
    )
    disparity = pair.rig.left.fx * pair.rig.baseline / points[:, 2]
    return 0.75 * float(disparity.min()), 1.25 * float(disparity.max())


def method_of(peer: Any, pair: RealPair) -> Any:
    """The peer recipe for this pair: features from its two images."""
    lowest, highest = disparity_window(pair)
    return partial(peer, rig=pair.rig, lowest=lowest, highest=highest)
