"""What of an outline other objects hide, about: the convex hulls of theirs are taken for opaque."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..image_pose.sight import Outline, Sight
from ..image_pose.views import Views


def behind(outline: Outline, pose: Pose, views: Views, others: Sequence[Sight]) -> BoolArray:
    """Points of an outline at first_T_model that lie inside the convex hulls of other outlines.

    Parameters
    ----------
    outline : Outline
    pose : Pose
    views : Views
    others : sequence of Sight
        Of objects that are nearer to the cameras, in the same views.

    Returns
    -------
    (n,) bool
    """
    hidden = np.zeros(len(outline.eye), bool)
    at = pose.apply(outline.point)
    for eye, (camera, stand) in enumerate(zip(views.cameras, views.poses)):
        rows = np.flatnonzero(outline.eye == eye)
        pixel = np.ascontiguousarray(camera.project(stand.inverse().apply(at[rows])))
        for other in others:
            theirs = other.placed.pixel[other.rows(eye)].astype(np.float32)
            if len(theirs) < 3 or not len(rows):
                continue
            hidden[rows] |= _inside(cv2.convexHull(theirs)[:, 0].astype(float, 'C'), pixel)
    return hidden


@njit(nogil=True)
def _inside(hull: FloatArray, points: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside a convex polygon (k, 2), corners in order."""
    out = np.empty(len(points), np.bool_)
    for n in range(len(points)):
        left = right = True
        for k in range(len(hull)):
            u, v = hull[k - 1, 0], hull[k - 1, 1]
            across = (hull[k, 0] - u) * (points[n, 1] - v) - (hull[k, 1] - v) * (points[n, 0] - u)
            left, right = left and across >= 0.0, right and across <= 0.0
        out[n] = left or right
    return out
