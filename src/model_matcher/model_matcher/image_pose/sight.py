"""The outline of a shape as several views see it: points, normals and all that is said of each beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from csg_renderer.visibility.outline import OutlinePoints
from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, Int32Array

from .alignment import Placed
from .settings import NOT_ZERO, SPACING
from .views import Views


class Shape(Protocol):
    """What is measured: anything that says what of its outline a camera sees."""

    @property
    def centre(self) -> FloatArray:
        """Its middle, (3,) float64, metres, model frame."""

    @property
    def size(self) -> float:
        """Metres, the diagonal of its bounding box."""

    def visible(self, pose: Pose, camera: PinholeCamera, spacing: float) -> OutlinePoints:
        """Points of the outline at camera_T_model, ``spacing`` pixels apart."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Points of an outline in all views; those of a view together, those of a curve one after the other.

    Attributes
    ----------
    placed : Placed
        n points.
    spacing : (n,) float64
        Pixels of the outline that each stands for.
    bend : (n,) float64
        Curvature in the image towards the normal, one over pixels.
    limb : (n,) float64
        1 or -1 at occluding contours of curved surfaces: the side along the normal on which the surface lies; else 0.
    feature : (n,) int32
        Row of the model's features, -1 for what is none.
    """

    placed: Placed
    spacing: FloatArray
    bend: FloatArray
    limb: FloatArray
    feature: Int32Array

    def __len__(self) -> int:
        return len(self.spacing)

    def rows(self, eye: int) -> slice:
        """The points of one view."""
        return slice(*np.searchsorted(self.placed.eye, (eye, eye + 1)).tolist())


def look(shape: Shape, pose: Pose, views: Views, spacing: float = SPACING) -> Sight:
    """What views see of a shape.

    Parameters
    ----------
    shape : Shape
    pose : Pose
        first_T_model.
    views : Views
    spacing : float
        Pixels between neighbouring points.

    Returns
    -------
    Sight
    """
    parts, groups = [], 0
    for eye, (camera, stand) in enumerate(zip(views.cameras, views.poses)):
        back = stand.inverse()
        part, curves = _in_view(shape, back.compose(pose), camera, spacing)
        point, pixel, normal, curve, *more = part
        arm = pose.rotate(point - shape.centre)
        slope = _slope(normal, arm, back.apply(pose.apply(point)), camera, back.rotation)
        group = (curve + groups).astype(np.int32)
        parts.append((point, np.full(len(point), eye, np.int32), pixel, normal, group, slope, *more))
        groups += curves
    point, eye_of, pixel, normal, group, slope, steps, limb, feature = (np.concatenate(part) for part in zip(*parts))
    placed = Placed(point, eye_of, pixel, normal, group, _abscissa(group), slope)
    return Sight(placed, steps, _curvature(placed, steps), limb, feature)


def _slope(
    normal: FloatArray, arm: FloatArray, at: FloatArray, camera: PinholeCamera, camera_R_first: FloatArray
) -> FloatArray:
    """Derivatives (n, 6) of the places along normals (n, 2), by turn and shift in the first camera's frame.

    arm : (n, 3), from the middle of the turn to the points, first camera's frame; at : (n, 3), the points, this one's
    """
    along = normal * np.array([camera.fx, camera.fy]) / at[:, 2:]
    gradient = np.concatenate([along, -(along * at[:, :2]).sum(axis=1, keepdims=True) / at[:, 2:]], axis=1)
    shift = gradient @ camera_R_first
    return np.concatenate([np.cross(arm, shift), shift], axis=1)


def _in_view(shape: Shape, pose: Pose, camera: PinholeCamera, spacing: float) -> tuple[tuple[AnyArray, ...], int]:
    """What one camera sees at camera_T_model, and how many curves there are.

    Points, pixels, normals, curves, spacings, limbs, features.
    """
    seen = shape.visible(pose, camera, spacing)
    at, along = pose.apply(seen.point), pose.rotate(seen.tangent)
    pixel, flow = camera.project(at), _image_direction(along, at, camera)
    length = np.linalg.norm(flow, axis=1, keepdims=True)
    normal = np.stack([-flow[:, 1], flow[:, 0]], axis=1) / np.maximum(length, NOT_ZERO)
    outward = _image_direction(pose.rotate(seen.outward), at, camera)
    limb = -np.sign((normal * outward).sum(axis=1))
    keep: BoolArray = (length[:, 0] > 0.0) & camera.contains(pixel)
    every = (seen.point, pixel, normal, seen.curve, seen.spacing, limb, seen.feature)
    return tuple(one[keep] for one in every), int(seen.curve.max(initial=-1)) + 1


def _image_direction(direction: FloatArray, at: FloatArray, camera: PinholeCamera) -> FloatArray:
    """(n, 2): where in the image points move that move by directions (n, 3) of the camera frame; up to a factor."""
    across = direction[:, :2] - direction[:, 2:] * at[:, :2] / at[:, 2:]
    direction_2d: FloatArray = across * np.array([camera.fx, camera.fy])
    return direction_2d


def _abscissa(group: Int32Array) -> FloatArray:
    """Where on its curve each point is, (n,) from -1 to 1."""
    start = np.flatnonzero(np.diff(group, prepend=-1))
    count = np.diff(np.append(start, len(group)))
    rank = np.arange(len(group)) - np.repeat(start, count)
    share: FloatArray = (2.0 * rank + 1.0) / np.repeat(count, count) - 1.0
    return share


def _curvature(placed: Placed, spacing: FloatArray) -> FloatArray:
    """Curvature in the image, (n,) one over pixels, towards the normals: from neighbours on one curve."""
    step = np.linalg.norm(np.diff(placed.pixel, axis=0), axis=1)
    # Two neighbours are a spacing apart; more lies between them where something hides the curve.
    linked = (np.diff(placed.group) == 0) & (step < 1.5 * spacing[1:])
    before, after = placed.normal[:-1], placed.normal[1:]
    turn = np.where(linked, (before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) / np.maximum(step, NOT_ZERO), 0.0)
    count, total = np.zeros(len(placed.pixel)), np.zeros(len(placed.pixel))
    for some in (slice(None, -1), slice(1, None)):
        count[some] += linked
        total[some] += turn
    bend: FloatArray = total / np.maximum(count, 1.0)
    return bend
