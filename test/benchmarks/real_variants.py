"""Real pairs as other cameras would have seen them, with their reference: other sizes, turned, mirrored, other light.

Run as a command it prints, for every pair and variant, what is recovered and the pose that the matcher finds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from real_scoring import RealPair, chessboards, score_board, score_box, teaboxes

from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig

BOX_M = np.array([0.165, 0.080, 0.068])
SQUARE_M = 0.025
SEED = 5


def _camera(camera: PinholeCamera, mirror: tuple[bool, bool]) -> PinholeCamera:
    return replace(
        camera,
        cx=camera.width - 1 - camera.cx if mirror[0] else camera.cx,
        cy=camera.height - 1 - camera.cy if mirror[1] else camera.cy,
    )


def mirrored(pair: RealPair, name: str, across: bool, down: bool) -> RealPair:
    """The pair mirrored left to right, upside down, or both (turned by 180 degrees). Left to right the two eyes change
    their roles. One mirror makes another object: of one that is its own mirror image, the pose goes with the middle of
    its first axis."""
    left, right = (pair.right, pair.left) if across else (pair.left, pair.right)
    first, second = (pair.rig.right, pair.rig.left) if across else (pair.rig.left, pair.rig.right)
    axes = tuple(axis for axis, wanted in ((0, down), (1, across)) if wanted)
    left, right = (np.ascontiguousarray(np.flip(image, axes)) for image in (left, right))
    rig = StereoRig(_camera(first, (across, down)), _camera(second, (across, down)), pair.rig.baseline)
    flip = np.diag([-1.0 if across else 1.0, -1.0 if down else 1.0, 1.0])
    shift = np.array([pair.rig.baseline if across else 0.0, 0.0, 0.0])
    rotation, translation = flip @ pair.left_T_object.rotation, flip @ (pair.left_T_object.translation - shift)
    if across != down:
        length = BOX_M[0] if len(pair.edges) else 8.0
        translation = translation + rotation @ [length, 0.0, 0.0]
        rotation = rotation @ np.diag([-1.0, 1.0, 1.0])
    edges = (pair.edges - shift) @ flip if len(pair.edges) else pair.edges
    return RealPair(f'{pair.name} {name}', left, right, rig, Pose(rotation, translation), edges)


def _with_images(pair: RealPair, name: str, change: Callable[[np.ndarray, int], np.ndarray]) -> RealPair:
    left, right = (
        np.clip(change(image.astype(float), k), 0, 255).round().astype(np.uint8)
        for k, image in enumerate((pair.left, pair.right))
    )
    return RealPair(f'{pair.name} {name}', left, right, pair.rig, pair.left_T_object, pair.edges)


def shifted(pair: RealPair, right: float, down: float) -> RealPair:
    """The pair as sampled by pixels that lie elsewhere, pixels."""
    how = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
    size = pair.left.shape[::-1]
    moved = _with_images(
        pair,
        f'shifted {right:g} {down:g}',
        lambda image, _: cv2.warpAffine(image, how, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE),
    )
    cameras = (replace(camera, cx=camera.cx + right, cy=camera.cy + down) for camera in (pair.rig.left, pair.rig.right))
    return replace(moved, rig=StereoRig(*cameras, pair.rig.baseline))


def cropped(pair: RealPair, columns: int, rows: int) -> RealPair:
    """The pair without so many columns and rows at every side."""
    left, right = (
        np.ascontiguousarray(image[rows : image.shape[0] - rows, columns : image.shape[1] - columns])
        for image in (pair.left, pair.right)
    )
    cameras = (
        replace(
            camera,
            width=camera.width - 2 * columns,
            height=camera.height - 2 * rows,
            cx=camera.cx - columns,
            cy=camera.cy - rows,
        )
        for camera in (pair.rig.left, pair.rig.right)
    )
    return replace(
        pair,
        name=f'{pair.name} cropped {columns} {rows}',
        left=left,
        right=right,
        rig=StereoRig(*cameras, pair.rig.baseline),
    )


def variants(pair: RealPair, seed: int = SEED) -> list[RealPair]:
    """The pair itself and twenty-one others."""
    rng = np.random.default_rng(seed)

    def noise(sigma: float) -> Callable[[np.ndarray, int], np.ndarray]:
        return lambda image, _: image + rng.normal(0.0, sigma, image.shape)

    return [
        pair,
        *(pair.scaled(f) for f in (0.5, 0.75, 1.5, 2.0)),
        mirrored(pair, 'turned', True, True),
        mirrored(pair, 'mirrored', True, False),
        mirrored(pair, 'upside down', False, True),
        _with_images(pair, 'dark', lambda image, _: 0.5 * image),
        _with_images(pair, 'bright', lambda image, _: 1.3 * image + 10.0),
        _with_images(pair, 'flat', lambda image, _: 0.6 * image + 60.0),
        _with_images(pair, 'gamma', lambda image, _: 255.0 * (image / 255.0) ** 0.6),
        _with_images(pair, 'unequal', lambda image, k: (1.0, 0.8)[k] * image + (0.0, 15.0)[k]),
        _with_images(pair, 'negative', lambda image, _: 255.0 - image),
        *(shifted(pair, *by) for by in ((0.5, 0.0), (0.0, 0.5), (0.25, 0.25))),
        cropped(pair, 40, 20),
        _with_images(pair, 'noise 1', noise(1.0)),
        _with_images(pair, 'noise 3', noise(3.0)),
        _with_images(pair, 'noise 6', noise(6.0)),
        _with_images(pair, 'blurred', lambda image, _: cv2.GaussianBlur(image, (0, 0), 0.8)),
    ]


def in_metres(pair: RealPair) -> tuple[StereoRig, FeatureSet, list[Pose], np.ndarray]:
    """Rig, model, every pose that the model's symmetry makes as true, and the model's middle; metres."""
    import csg_renderer
    from model_matcher.closed_form.real_pair import board_symmetries, chessboard_model

    if len(pair.edges):
        middle = 0.5 * BOX_M
        halves = [np.diag(np.array(turn, float)) for turn in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
        model = csg_renderer.model_features(csg_renderer.Solid.block(*BOX_M))
        return (
            pair.rig,
            model,
            [pair.left_T_object.compose(Pose(half, middle - half @ middle)) for half in halves],
            middle,
        )
    rig = StereoRig(pair.rig.left, pair.rig.right, pair.rig.baseline * SQUARE_M)
    truth = Pose(pair.left_T_object.rotation, SQUARE_M * pair.left_T_object.translation)
    middle = SQUARE_M * np.array([4.0, 2.5, 0.0])
    over = np.diag([1.0, -1.0, -1.0])
    both = [truth, *board_symmetries(truth)]
    return rig, chessboard_model(), both + [pose.compose(Pose(over, middle - over @ middle)) for pose in both], middle


def judge(pair: RealPair) -> tuple[str, bool]:
    """A line about one pair, and whether the pose is within 0.6 degrees and 0.5 % of the depth."""
    from model_matcher import MatchParams, match
    from stereo_recovery import recover

    rig, model, true, middle = in_metres(pair)
    features = recover(pair.left, pair.right, rig).features
    result = match(model, features, MatchParams(false_alarm_rate=1.0, time_limit_s=20.0))
    sure = match(model, features, MatchParams(time_limit_s=20.0))
    rotation, share = 180.0, 1.0
    if result.best is not None:
        rotation, share = min(
            (
                t.error_to(result.best.pose).rotation_deg,
                float(np.linalg.norm(t.apply(middle) - result.best.pose.apply(middle))) / t.apply(middle)[2],
            )
            for t in true
        )
    if len(pair.edges):
        box = score_box(pair, features)
        found = box.covered >= 0.5
        text = f'edges {box.edges}  {np.median(box.angle[found]):5.2f} deg {1e3 * np.median(box.across[found]):5.2f} mm'
    else:
        squares = FeatureSet(
            features.kind,
            features.start / SQUARE_M,
            features.end / SQUARE_M,
            features.radii / SQUARE_M,
            features.err_par / SQUARE_M,
            features.err_per / SQUARE_M,
        )
        board = score_board(pair, squares)
        text = f'recall {board.recall:.3f}  wrong {100 * board.wrong:4.1f} %  normal {board.normal_deg:5.3f} deg'
    right = rotation < 0.6 and share < 0.005
    return (
        f'{pair.name:<28} {len(features):4d} features  {text}  pose {rotation:7.3f} deg {100 * share:6.3f} %  '
        f'evidence {result.stats.get("evidence", np.nan):6.2f}, accepted {"yes" if sure.best else "no":<3} '
        f'{"" if right else "WRONG"}',
        right,
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--pairs', default='', help='only pairs whose name contains this')
    parser.add_argument('--seed', type=int, default=SEED, help='of the noise')
    parser.add_argument('--quick', action='store_true', help='the first board and the boxes only')
    chosen = parser.parse_args(arguments)
    boards = chessboards()
    good = []
    for pair in (boards[:1] if chosen.quick else boards) + teaboxes():
        if chosen.pairs in pair.name:
            for variant in variants(pair, chosen.seed):
                text, right = judge(variant)
                good.append(right)
                print(text, flush=True)
    print(f'{sum(good)} of {len(good)} poses right')
    return 0


if __name__ == '__main__':
    sys.exit(main())
