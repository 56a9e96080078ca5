"""Two cameras of a rig, turned about their centres until their rows agree: a stereo pair, wherever the two stand.

The columns run along the baseline, so a camera above another is turned by a right angle and one to the left of it by
two. The turn of a camera about its own centre is a homography of its picture.

References
----------
Hartley and Zisserman, Multiple View Geometry, 2nd edition, sections 8.4.2 and 11.12; A. Fusiello, E. Trucco, A. Verri,
"A compact algorithm for rectification of stereo pairs", Machine Vision and Applications 12, 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import cv2
import numpy as np

from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.typed import Float32Array, FloatArray
from msgs_py.settings import RECTIFIED_TOLERANCE, WIDEST_RAY

from .settings import BASELINES_AWAY, BORDER_SAMPLES, LEAST_SIDEWAYS, MOST_OBLIQUE, OVERLAP_DEPTHS, OVERLAP_GRID


@dataclass(frozen=True, eq=False)
class CameraPair:
    """Two cameras of a rig as a rectified pair.

    Attributes
    ----------
    cameras : (int, int)
        Which of the rig's cameras are its left and its right one.
    rig : StereoRig
        The pair when turned.
    first_T_pair : Pose
        Its left optical frame, in the rig's.
    homographies : (2, 3, 3) float64
        Pixels of the pair's pictures from those of the two cameras.
    as_it_comes : bool
        Whether the two cameras are a rectified pair by themselves, so that nothing is turned.
    """

    cameras: tuple[int, int]
    rig: StereoRig
    first_T_pair: Pose
    homographies: FloatArray
    as_it_comes: bool

    def pictures(self, greys: tuple[Float32Array, Float32Array]) -> tuple[Float32Array, Float32Array]:
        """(h, w) float32 each, grey levels: the pictures of the two cameras, turned; 0 beside them."""
        if self.as_it_comes:
            return greys
        size = self.rig.left.width, self.rig.left.height
        # Lanczos keeps edges where they are; linear interpolation would blur them by their sub-pixel position.
        turned = [
            np.maximum(cv2.warpPerspective(grey, h, size, flags=cv2.INTER_LANCZOS4), 0.0)
            for grey, h in zip(greys, self.homographies)
        ]
        return np.asarray(turned[0], np.float32), np.asarray(turned[1], np.float32)


def camera_pair(rig: CameraRig, left: int, right: int) -> CameraPair | None:
    """Two of a rig's cameras as a rectified pair.

    Parameters
    ----------
    rig : CameraRig
    left, right : int
        Which two.

    Returns
    -------
    CameraPair
        None where there is none: one camera stands before the other, or they have no rows in common.
    """
    poses = rig.poses[left], rig.poses[right]
    between = poses[0].inverse().compose(poses[1])
    own = _as_it_comes(rig.cameras[left], rig.cameras[right], between)
    if own is not None:
        return CameraPair((left, right), own, poses[0], np.stack([np.eye(3)] * 2), True)
    run = poses[1].translation - poses[0].translation
    baseline = float(np.linalg.norm(run))
    x = run / baseline
    ahead = poses[0].rotation[:, 2] + poses[1].rotation[:, 2]
    z = ahead - (ahead @ x) * x
    if np.linalg.norm(z) < LEAST_SIDEWAYS * np.linalg.norm(ahead):
        return None
    z /= np.linalg.norm(z)
    first_R_pair = np.stack([x, np.cross(z, x), z], axis=1)
    focal = float(np.exp(np.mean([np.log([rig.cameras[k].fx, rig.cameras[k].fy]) for k in (left, right)])))
    turns = [first_R_pair.T @ pose.rotation for pose in poses]
    windows = [_window(rig.cameras[k], turn, focal) for k, turn in zip((left, right), turns)]
    top, bottom = max(windows[0][0, 1], windows[1][0, 1]), min(windows[0][1, 1], windows[1][1, 1])
    if not bottom > top:
        return None
    widths = [np.ceil(window[1, 0] - window[0, 0]) for window in windows]
    size = int(max(widths)) + 1, int(np.ceil(bottom - top)) + 1
    turned = [PinholeCamera(*size, focal, focal, float(-window[0, 0]), float(-top)) for window in windows]
    homographies = np.stack(
        [
            camera.matrix @ turn @ np.linalg.inv(rig.cameras[k].matrix)
            for camera, turn, k in zip(turned, turns, (left, right))
        ]
    )
    return CameraPair(
        (left, right),
        StereoRig(turned[0], turned[1], baseline),
        Pose(first_R_pair, poses[0].translation),
        homographies,
        False,
    )


@lru_cache
def main_pairs(rig: CameraRig) -> tuple[CameraPair, ...]:
    """All pairs of a rig, the likeliest to show most, most exactly, first.

    That is by the share of the left picture that the right camera sees as well, times the baseline.
    """
    widest = max(float(np.linalg.norm(a.translation - b.translation)) for a, b in combinations([*rig.poses], 2))
    found: list[tuple[float, CameraPair]] = []
    for i, j in combinations(range(len(rig)), 2):
        pairs = [pair for pair in (camera_pair(rig, i, j), camera_pair(rig, j, i)) if pair is not None]
        if not pairs:
            continue
        # Of the two ways round, the one that turns the pictures less.
        upright = min(pairs, key=lambda pair: float(-np.trace(_turn(rig, pair))))
        found.append((_overlap(rig, upright, BASELINES_AWAY * widest) * upright.rig.baseline, upright))
    # The order of the cameras decides between equals.
    return tuple(pair for _, pair in sorted(found, key=lambda entry: -round(entry[0] / widest, 6)))


def _as_it_comes(left: PinholeCamera, right: PinholeCamera, between: Pose) -> StereoRig | None:
    """The two as they are, when that is a rectified pair; between : left_T_right."""
    baseline = float(between.translation[0])
    if baseline <= 0.0 or np.abs(between.translation[1:]).max() > RECTIFIED_TOLERANCE * baseline:
        return None
    if np.abs(between.rotation - np.eye(3)).max() > RECTIFIED_TOLERANCE:
        return None
    try:
        return StereoRig(left, right, baseline)
    except ValueError:
        return None


def _turn(rig: CameraRig, pair: CameraPair) -> FloatArray:
    """(3, 3) how a pair's left picture is turned."""
    return np.asarray(pair.first_T_pair.rotation.T @ rig.poses[pair.cameras[0]].rotation)


def _window(camera: PinholeCamera, turn: FloatArray, focal: float) -> FloatArray:
    """(2, 2) float64, pixels from the principal point: least and largest column and row of a camera's turned picture.

    What is seen too far from straight ahead would be drawn out beyond measure, and is cut off.
    """
    # Corners are the farthest points of a turned picture unless they are cut off.
    u, v = (np.linspace(0.0, size - 1.0, BORDER_SAMPLES) for size in (camera.width, camera.height))
    border = np.concatenate(
        [np.stack([u, np.full_like(u, at)], axis=1) for at in v[[0, -1]]]
        + [np.stack([np.full_like(v, at), v], axis=1) for at in u[[0, -1]]]
    )
    rays = camera.rays(border) @ turn.T
    seen = rays[:, :2] / np.maximum(rays[:, 2:], 1.0 / WIDEST_RAY)
    seen = np.clip(seen, -MOST_OBLIQUE, MOST_OBLIQUE) * focal
    return np.stack([seen.min(axis=0), seen.max(axis=0)])


def _overlap(rig: CameraRig, pair: CameraPair, nearest: float) -> float:
    """Share of the left camera's picture that the right one sees too, over depths from infinity to ``nearest``."""
    left, right = (rig.cameras[k] for k in pair.cameras)
    between = rig.poses[pair.cameras[1]].inverse().compose(rig.poses[pair.cameras[0]])
    columns, rows = (np.linspace(0, size - 1, OVERLAP_GRID) for size in (left.width, left.height))
    rays = left.rays(np.stack(np.meshgrid(columns, rows), axis=-1))
    near = np.linspace(0.0, 1.0 / nearest, OVERLAP_DEPTHS)[:, None, None, None]
    return float(right.contains(right.project(between.rotate(rays) + between.translation * near)).mean())
