"""What of an outline other objects hide, about: the convex hulls of theirs are taken for opaque."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import BoolArray

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
        pixel = camera.project(stand.inverse().apply(at[rows])).astype(np.float32)
        for other in others:
            theirs = other.placed.pixel[other.rows(eye)].astype(np.float32)
            if len(theirs) < 3 or not len(rows):
                continue
            hidden[rows] |= _inside(cv2.convexHull(theirs)[:, 0], pixel)
    return hidden


def _inside(hull: np.ndarray, points: np.ndarray) -> BoolArray:
    """Whether points (n, 2) lie inside a convex polygon (k, 2), corners in order."""
    edge = np.roll(hull, -1, axis=0) - hull
    away = points[:, None] - hull
    side = edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]
    inside: BoolArray = (side >= 0.0).all(axis=1) | (side <= 0.0).all(axis=1)
    return inside
