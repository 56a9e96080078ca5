"""Recovery and matching on a real stereo pair: the chessboard of OpenCV's samples, with its reference pose.

The pictures, their calibration and the reference pose are data of stereo_recovery; see the README beside them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from msgs_py import FeatureSet, Interpretation, Pose, StereoRig
from msgs_py.files import check_image
from stereo_recovery import recover
from stereo_recovery.cameras.calibration import load_rig

from ..drawing import GREEN, GREY, canvas, draw_features
from ..image_pose.views import Views
from ..params import MatchParams
from ..pipeline import match
from ..viewing.moments import Moment, placed_objects
from .comparison import best_pose_error, compare_edges
from .viewing.view_files import write_view

PAIR = '01'


class Chessboard(NamedTuple):
    """A printed chessboard with its inner corners (i, j) at (i, j, 0), in squares.

    Attributes
    ----------
    square
        Metres, the side of one.
    columns, rows
        Of inner corners.
    x_limits, y_limits
        Squares, where the printed pattern ends.
    """

    square: float
    columns: range
    rows: range
    x_limits: tuple[float, float]
    y_limits: tuple[float, float]


# The size of a square is not published: it is what we take it to be. The limits are measured, see the data's README.
BOARD = Chessboard(0.025, range(9), range(6), (-0.52, 8.48), (-0.96, 5.94))
SQUARE_M = BOARD.square


def chessboard_model() -> FeatureSet:
    """The grid lines of the printed board as edges, metres, board frame (x along the rows, z into the board)."""
    (left, right), (top, bottom) = BOARD.x_limits, BOARD.y_limits
    start = [(x, top, 0.0) for x in BOARD.columns] + [(left, y, 0.0) for y in BOARD.rows]
    end = [(x, bottom, 0.0) for x in BOARD.columns] + [(right, y, 0.0) for y in BOARD.rows]
    return FeatureSet.from_edges(SQUARE_M * np.array(start), SQUARE_M * np.array(end))


def reference_pose(folder: Any, pair: str = PAIR) -> Pose:
    """left_T_board of the pair, from the corners in both images (joint least squares), metres."""
    joint = json.loads((folder / 'board_poses.json').read_text())[pair]['joint']
    return Pose.from_rotation_vector(joint['rvec'], SQUARE_M * np.asarray(joint['tvec']))


def run_chessboard(out: Path) -> str:
    """Recover and match pair 01.

    Parameters
    ----------
    out : Path
        Folder for pictures, features.npz and result.json; made when missing.

    Returns
    -------
    str
        What to tell the user, one line.
    """
    data = resources.files('stereo_recovery') / 'data' / 'chessboard'
    left, right = (_read(data / f'{side}{PAIR}_rect.png') for side in ('left', 'right'))
    rig = load_rig(Path(str(data / 'calibration.yaml')), (left.shape[1], left.shape[0]))
    rig = StereoRig(rig.left, rig.right, rig.baseline * SQUARE_M)
    recovery = recover(left, right, rig)
    features = recovery.features
    model, truth = chessboard_model(), reference_pose(data)
    edges = compare_edges(model.transformed(truth), features, same_place_m=0.2 * SQUARE_M)
    result = match(model, features, MatchParams(time_limit_s=10.0))
    best = result.interpretations[0] if result.interpretations else None

    out.mkdir(parents=True, exist_ok=True)
    features.save(out / 'features.npz')
    colours = [GREEN if index >= 0 else GREY for index in edges.true_index]
    picture = draw_features(canvas(left, dim=0.6), features.select(features.kind == 0), rig.left, colours, 2)
    cv2.imwrite(str(out / 'recovered.png'), picture)
    document: dict[str, Any] = {
        'pair': PAIR,
        'square_m': SQUARE_M,
        'features': len(features),
        'recovery': edges.summary(),
        'accepted': bool(best and best.accepted),
        'reason': None if best and best.accepted else _why(best, result.reason),
    }
    if best is not None:
        error = best_pose_error(best, truth, board_symmetries(truth))
        document |= {
            'rotation_error_deg': error.rotation_deg,
            'translation_error_m': error.translation,
            'matched': best.matched,
        }
        cv2.imwrite(
            str(out / 'matched.png'),
            draw_features(canvas(left, dim=0.6), model.transformed(best.pose), rig.left, thickness=1),
        )
    (out / 'result.json').write_text(json.dumps(document, indent=2) + '\n')
    placed = placed_objects([replace(best, model='board')] if best is not None and best.accepted else [])
    moment = Moment(None, Views.of([left, right], rig), features, placed, document['reason'] or '')
    write_view(out, f'chessboard {PAIR}', {'board': model}, [moment])
    head = (
        f"real chessboard pair {PAIR}: {len(features)} features, {100 * edges.recall:.0f} % of the grid lines' length"
    )
    if best is None or not best.accepted:
        return f'{head}; no pose: {document["reason"]}; pictures in {out}/'
    return (
        f'{head}; pose {document["rotation_error_deg"]:.2f} deg and {1e3 * document["translation_error_m"]:.1f} mm '
        f"(squares of {1e3 * SQUARE_M:g} mm) from the reference, up to the board's symmetry; pictures in {out}/"
    )


def board_symmetries(pose: Pose) -> list[Pose]:
    """Poses of the board that lay its grid lines on themselves: half a turn about the pattern's middle.

    The printed margins differ by a few hundredths of a square, less than a grid of straight lines can tell.
    """
    middle = SQUARE_M * np.array([np.mean(BOARD.columns), np.mean(BOARD.rows), 0.0])
    turn = Pose.from_rotation_vector([0.0, 0.0, np.pi])
    about_middle = Pose(turn.rotation, middle - turn.rotate(middle))
    return [pose.compose(about_middle)]


def _read(path: Any) -> np.ndarray:
    image = cv2.imread(str(check_image(path)), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise OSError(f'{path}: not a readable image')
    return image


def _why(best: Interpretation | None, reason: str | None) -> str:
    return (best.rejected_reason if best is not None else None) or reason or 'no interpretation'
