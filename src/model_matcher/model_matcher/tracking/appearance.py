"""What an object looked like in the last frame, and where that is in the next: the shift after a sudden move.

Normalised correlation of the part of the image that the outline encloses, at a resolution at which it is small. It
tells nothing of turns, and the shift to a pixel of that resolution; the outline does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import ByteArray, FloatArray

from ..image_pose.settings import PATCH
from ..image_pose.sight import Sight
from ..image_pose.views import Views
from .settings import JUMP_M, PATCH_PX


@dataclass(frozen=True, eq=False)
class Patch:
    """A piece of one view.

    Attributes
    ----------
    image : (h, w) uint8
        Made smaller.
    corner : (2,) int64
        Column and row of its first pixel in the smaller view.
    place : (2,) float64
        Where the middle of the object was, pixels of the whole view.
    level : int
        How often the view was halved.
    """

    image: ByteArray
    corner: FloatArray
    place: FloatArray
    level: int


def patches(sight: Sight, middle: FloatArray, views: Views) -> tuple[Patch | None, ...]:
    """What each view shows of an object inside its outline; None where it is too small or out of sight.

    middle : (3,) float64, metres, first camera's frame
    """
    out: list[Patch | None] = []
    for eye, (camera, stand) in enumerate(zip(views.cameras, views.poses)):
        pixel, at = sight.placed.pixel[sight.rows(eye)], stand.inverse().apply(middle)
        # The middle of what passes a camera by may lie behind it.
        if not (len(pixel) and at[2] > 0.0):
            out.append(None)
            continue
        low, high = pixel.min(axis=0), pixel.max(axis=0)
        level = max(0, int(np.ceil(np.log2(max(float((high - low).max()), 1.0) / PATCH_PX))))
        image = _at_level(views, level).images[eye]
        first = np.maximum(np.floor(low / 2**level), 0).astype(int)
        last = np.minimum(np.ceil(high / 2**level).astype(int) + 1, image.shape[::-1])
        if (last - first).min() < 2 * PATCH:
            out.append(None)
            continue
        piece = image[first[1] : last[1], first[0] : last[0]].copy()
        out.append(Patch(piece, first, camera.project(at), level))
    return tuple(out)


def shifted(
    was: tuple[Patch | None, ...], pose: Pose, middle: FloatArray, views: Views, reach_px: float
) -> Pose | None:
    """A pose shifted so that the object is where it looks most as it did; None where no view tells.

    Parameters
    ----------
    was : tuple of Patch or None
        One for each view.
    pose : Pose
        first_T_model, predicted.
    middle : (3,) float64
        Metres, model frame.
    views : Views
    reach_px : float
        Pixels from the predicted place that are searched.
    """
    place = pose.apply(middle)
    # A weak belief that it has not moved along a line of sight of which no other view tells.
    normal, right = np.eye(3) / JUMP_M**2, np.zeros(3)
    told = False
    for eye, (patch, camera, stand) in enumerate(zip(was, views.cameras, views.poses)):
        back = stand.inverse()
        at = back.apply(place)
        if patch is None or not at[2] > 0.0:
            continue
        moved = _moved(patch, _at_level(views, patch.level).images[eye], camera.project(at), reach_px)
        if moved is None:
            continue
        told = True
        slope = np.array([[camera.fx, 0, -camera.fx * at[0] / at[2]], [0, camera.fy, -camera.fy * at[1] / at[2]]])
        slope = slope / at[2] @ back.rotation
        weight = 1.0 / 4.0**patch.level
        normal += weight * slope.T @ slope
        right += weight * slope.T @ moved
    return Pose(pose.rotation, pose.translation + np.linalg.solve(normal, right)) if told else None


def _moved(patch: Patch, image: ByteArray, predicted: FloatArray, reach_px: float) -> FloatArray | None:
    """Where the middle is from where it was predicted, (2,) pixels of the whole view."""
    scale = 2**patch.level
    ahead = np.rint((predicted - patch.place) / scale).astype(int)
    reach = int(np.ceil(reach_px / scale)) + 1
    height, width = patch.image.shape
    first = np.maximum(patch.corner + ahead - reach, 0)
    last = np.minimum(patch.corner + ahead + reach + [width, height], image.shape[::-1])
    if (last - first < [width, height]).any():
        return None
    window = image[first[1] : last[1], first[0] : last[0]]
    likeness = cv2.matchTemplate(window, patch.image, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    found = first + [int(column), int(row)]
    moved: FloatArray = scale * (found - patch.corner) + patch.place - predicted
    return moved


def _at_level(views: Views, level: int) -> Views:
    for _ in range(level):
        views = views.halved
    return views
