"""How an object moved from one frame to the next, by corners of its surface (Lucas & Kanade 1981; Shi & Tomasi 1994).

Print and stains are not in the model, but they keep their places on it: corners inside the outline are put on the
surface as the last pose has it, found again in the next image, and the pose is laid on them. That tells the motion, not
where the object is; it is a prediction, better than that of a constant velocity where there is print.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, Float32Array, FloatArray, IntArray

from ..geometry.least_squares import solve_positive
from ..geometry.pose_rows import as_motion, as_pose
from ..geometry.rigid_motion import transform
from ..image_pose.settings import FIT_TURNS
from ..image_pose.sight import Shape, Sight
from ..image_pose.views import Views
from .motion_filter import move_middle
from .settings import CORNER_APART, CORNER_OF_NOISE, CORNER_SIGMA, CORNERS, FEWEST_CORNERS, FLOW_WINDOW


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of an object in one view.

    Attributes
    ----------
    eye : int
        Which view.
    image : (h, w) uint8
        The whole view.
    pixel : (n, 2) float32
        Where they were.
    point : (n, 3) float64
        On the surface, metres, model frame.
    """

    eye: int
    image: ByteArray
    pixel: Float32Array
    point: FloatArray


def corners_of(shape: Shape, pose: Pose, sight: Sight, views: Views) -> list[Corners]:
    """The corners inside the outline of a shape at first_T_model, on its surface."""
    found = []
    for eye, (image, camera, stand) in enumerate(zip(views.images, views.cameras, views.poses)):
        outline = sight.placed.pixel[sight.rows(eye)].astype(np.float32)
        if len(outline) < 3:
            continue
        first, last = _box(outline, 0.0, image)
        if (last - first).min() <= 2 * CORNER_APART:
            continue
        mask = np.zeros(last[::-1] - first[::-1], np.uint8)
        hull = cv2.convexHull(outline)
        cv2.fillConvexPoly(mask, np.rint(hull - first).astype(np.int32), 255)
        # Where an edge of the model passes, what looks like a corner may slide along it.
        for u, v in np.rint(outline - first).astype(int).tolist():
            cv2.circle(mask, (u, v), CORNER_APART, 0, cv2.FILLED)
        piece = np.ascontiguousarray(image[first[1] : last[1], first[0] : last[0]])
        strongest = float(cv2.minMaxLoc(cv2.cornerMinEigenVal(piece, 3), mask)[1])
        least = CORNER_OF_NOISE * float(views.noise[eye]) ** 2
        if strongest <= least:
            continue
        corners = cv2.goodFeaturesToTrack(piece, CORNERS, least / strongest, CORNER_APART, mask=mask)
        if corners is None:
            continue
        pixel = (corners[:, 0] + first).astype(np.float32)
        point = shape.surface(stand.inverse().compose(pose), camera, pixel.astype(float))
        on = np.isfinite(point[:, 0])
        if on.any():
            found.append(Corners(eye, image, pixel[on], point[on]))
    return found


def followed(
    was: list[Corners], pose: Pose, covariance: FloatArray, middle: FloatArray, views: Views, reach_px: float
) -> tuple[Pose, FloatArray] | None:
    """The pose laid on corners where they are found again, and the covariance (6, 6) of middle and turn.

    Parameters
    ----------
    was : list of Corners
        Of the frame before.
    pose : Pose
        first_T_model, predicted.
    covariance : (6, 6) float64
        Of middle and turn, as predicted after a sudden move: what corners leave open stays about there.
    middle : (3,) float64
        Metres, model frame.
    views : Views
    reach_px : float
        Pixels that the object may be from where it is predicted.

    Returns
    -------
    pose, covariance
        None where too few corners agree.
    """
    point, seen, eye = [], [], []
    for one in was:
        if one.eye >= len(views):
            continue
        pixel, good = _flow(one, pose, views, reach_px)
        point.append(one.point[good])
        seen.append(pixel[good])
        eye.append(np.full(int(good.sum()), one.eye, np.int64))
    if sum(len(part) for part in point) < FEWEST_CORNERS:
        return None
    return _laid(np.concatenate(point), np.concatenate(seen), np.concatenate(eye), pose, covariance, middle, views)


def _flow(one: Corners, pose: Pose, views: Views, reach_px: float) -> tuple[FloatArray, BoolArray]:
    """Where corners are now (n, 2), pixels, and which of them were found, there and back (n,)."""
    camera, image = views.cameras[one.eye], views.images[one.eye]
    ahead = camera.project(views.poses[one.eye].inverse().apply(pose.apply(one.point)))
    ahead = np.where(np.isfinite(ahead), ahead, one.pixel).astype(np.float32)
    first, last = _box(np.concatenate([one.pixel, ahead]), reach_px + FLOW_WINDOW, image)
    if image.shape != one.image.shape or (last - first).min() < 2 * FLOW_WINDOW:
        return ahead.astype(float), np.zeros(len(ahead), bool)
    before, after = (
        np.ascontiguousarray(whole[first[1] : last[1], first[0] : last[0]]) for whole in (one.image, image)
    )
    window = (FLOW_WINDOW, FLOW_WINDOW)
    start, guess = (one.pixel - first).astype(np.float32)[:, None], (ahead - first).astype(np.float32)[:, None]
    moved, good, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, guess.copy(), winSize=window, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    back, again, _ = cv2.calcOpticalFlowPyrLK(
        after, before, moved, start.copy(), winSize=window, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept: BoolArray = (good[:, 0] > 0) & (again[:, 0] > 0) & (np.abs(back - start).max(axis=(1, 2)) < 1.0)
    return (moved[:, 0] + first).astype(float), kept


def _laid(
    point: FloatArray,
    seen: FloatArray,
    eye: IntArray,
    pose: Pose,
    covariance: FloatArray,
    middle: FloatArray,
    views: Views,
) -> tuple[Pose, FloatArray] | None:
    """Robust Gauss-Newton (Cauchy's weights) of a pose on points (n, 3) seen at pixels (n, 2) of views (n,)."""
    motion = as_motion(pose)
    normal, agree = _aligned(motion, point, seen, views.rows[eye], np.linalg.inv(covariance), middle)
    if agree < max(FEWEST_CORNERS, 0.5 * len(point)):
        return None
    return as_pose(motion), np.linalg.inv(normal)


@njit(nogil=True)
def _aligned(
    motion: FloatArray, point: FloatArray, seen: FloatArray, camera: FloatArray, prior: FloatArray, middle: FloatArray
) -> tuple[FloatArray, int]:
    """Lay a pose (12,) on corners, in place: the normal matrix of middle and turn, and how many agree.

    point : (n, 3); seen : (n, 2); camera : (n, 16), that of each; prior : (6, 6), of middle and turn; middle : (3,)
    """
    n = len(point)
    off, length, slope = np.empty((n, 2)), np.empty(n), np.empty((n, 2, 6))
    normal, right = prior.copy(), np.empty(6)
    step, total, shift = np.zeros(6), np.zeros(6), np.empty(3)
    agree = 0
    for _ in range(FIT_TURNS):
        cx, cy, cz = transform(motion, middle[0], middle[1], middle[2])
        for k in range(n):
            px, py, pz = transform(motion, point[k, 0], point[k, 1], point[k, 2])
            c = camera[k]
            x = c[0] * px + c[1] * py + c[2] * pz + c[9]
            y = c[3] * px + c[4] * py + c[5] * pz + c[10]
            z = c[6] * px + c[7] * py + c[8] * pz + c[11]
            if not z > 0.0:
                return normal, 0
            off[k, 0] = seen[k, 0] - (c[12] * x / z + c[14])
            off[k, 1] = seen[k, 1] - (c[13] * y / z + c[15])
            length[k] = math.hypot(off[k, 0], off[k, 1])
            ax, ay, az = px - cx, py - cy, pz - cz
            for i in range(2):
                along, across = c[12 + i] / z, (x if i == 0 else y) / z
                for j in range(3):
                    shift[j] = along * (c[3 * i + j] - across * c[6 + j])
                slope[k, i, :3] = shift
                slope[k, i, 3] = ay * shift[2] - az * shift[1]
                slope[k, i, 4] = az * shift[0] - ax * shift[2]
                slope[k, i, 5] = ax * shift[1] - ay * shift[0]
        # The median of a distance whose two coordinates have normal errors (Rayleigh's distribution).
        sigma = max(CORNER_SIGMA, np.median(length) / math.sqrt(2.0 * math.log(2.0)))
        normal[:], right[:] = prior, -prior @ total
        agree = 0
        for k in range(n):
            weight = 1.0 / (1.0 + (length[k] / sigma) ** 2)
            # Within two sigmas.
            agree += weight > 0.2
            weight /= sigma**2
            for line in range(2):
                row = slope[k, line]
                for i in range(6):
                    right[i] += weight * row[i] * off[k, line]
                    for j in range(6):
                        normal[i, j] += weight * row[i] * row[j]
        if not solve_positive(normal, right, step):
            return normal, 0
        total += step
        move_middle(motion, middle, step)
    return normal, agree


def _box(pixel: FloatArray | Float32Array, more: float, image: ByteArray) -> tuple[FloatArray, FloatArray]:
    """First column and row of the box about pixels (n, 2), and those after its last, inside the image."""
    first = np.maximum(np.floor(pixel.min(axis=0) - more), 0).astype(int)
    last = np.minimum(np.ceil(pixel.max(axis=0) + more).astype(int) + 1, image.shape[::-1])
    return first, last
