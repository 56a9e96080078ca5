"""What is visible of a shape, kept for as long as it looks about the same.

A crease is where it is, and is seen until something hides it. The limb of a surface of radius r wanders over it as the
eye moves: seen from an angle a away, its points are r (1 - cos a) inside the true limb. So an outline serves again
until a^2 r / 2, in pixels, with half the size of the shape for r, is more than SAGITTA_PX.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import FloatArray

from ..image_pose.settings import SPACING
from ..image_pose.sight import Outline, Shape, outline_of
from ..image_pose.views import Views
from .settings import MARGIN_PX, MOST_POINTS, SAGITTA_PX


@dataclass(frozen=True, eq=False)
class _Kept:
    """An outline, where it was seen from (v, 3), metres, model frame, and where its middle was (v, 2), pixels."""

    outline: Outline
    cameras: tuple[PinholeCamera, ...]
    eyes: FloatArray
    pixels: FloatArray


class AspectCache:
    """The outline of a shape for views that move little from one call to the next.

    Parameters
    ----------
    shape : Shape

    Attributes
    ----------
    renewed : int
        How many outlines were made.
    """

    def __init__(self, shape: Shape) -> None:
        self._shape = shape
        self._kept: _Kept | None = None
        self._spacing = SPACING
        self.renewed = 0

    def outline(self, pose: Pose, views: Views) -> Outline:
        """What views see of the shape at first_T_model, or see all but for SAGITTA_PX."""
        eyes = (np.array([stand.translation for stand in views.poses]) - pose.translation) @ pose.rotation
        middle, rows = pose.apply(self._shape.centre), views.rows
        at = rows[:, :9].reshape(-1, 3, 3) @ middle + rows[:, 9:12]
        pixels = rows[:, 12:14] * at[:, :2] / at[:, 2:] + rows[:, 14:]
        kept = self._kept
        if kept is None or not self._serves(kept, views, eyes, pixels):
            wide = [_widened(camera) for camera in views.cameras]
            outline = outline_of(self._shape, pose, wide, views.poses, self._spacing)
            if self._spacing == SPACING and len(outline.eye) > MOST_POINTS:
                self._spacing *= len(outline.eye) / MOST_POINTS
                outline = outline_of(self._shape, pose, wide, views.poses, self._spacing)
            else:  # for the next one
                self._spacing = max(SPACING, float(outline.spacing.sum()) / MOST_POINTS)
            kept = self._kept = _Kept(outline, tuple(views.cameras), eyes, pixels)
            self.renewed += 1
        return kept.outline

    def _serves(self, kept: _Kept, views: Views, eyes: FloatArray, pixels: FloatArray) -> bool:
        if kept.cameras != tuple(views.cameras):
            return False
        away = np.linalg.norm(eyes - self._shape.centre, axis=1)
        angle = np.linalg.norm(eyes - kept.eyes, axis=1) / np.maximum(away, 0.5 * self._shape.size)
        radius = np.array([camera.fx for camera in views.cameras]) * 0.5 * self._shape.size / away
        moved = np.abs(pixels - kept.pixels).max(axis=1)
        return bool((0.5 * angle**2 * radius <= SAGITTA_PX).all() and (moved <= MARGIN_PX).all())


def _widened(camera: PinholeCamera) -> PinholeCamera:
    """A camera that sees MARGIN_PX more to all sides."""
    width, height = camera.width + 2 * MARGIN_PX, camera.height + 2 * MARGIN_PX
    return PinholeCamera(width, height, camera.fx, camera.fy, camera.cx + MARGIN_PX, camera.cy + MARGIN_PX)
