"""The outline of a shape as several views see it: points, normals and all that is said of each beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from csg_renderer.visibility.outline import OutlinePoints
from msgs_py import PinholeCamera, Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..geometry.pose_rows import as_motion
from ..geometry.rigid_motion import Motion, rotate, transform
from ..geometry.settings import NOT_ZERO
from .alignment import Placed
from .settings import OF_IMAGE, SPACING
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

    def surface(self, pose: Pose, camera: PinholeCamera, pixels: FloatArray) -> FloatArray:
        """Where its surface is seen at camera_T_model, (n, 3) float64, metres, model frame, or not a number."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Points of an outline in all views; those of a view together, those of a curve one after the other.

    Attributes
    ----------
    placed : Placed
        n points.
    spacing : (n,) float64
        Pixels of the outline that each stands for.
    stretch : (n,) float64
        Pixels of the outline along which each is measured.
    bend : (n,) float64
        Curvature in the image towards the normal, one over pixels.
    limb : (n,) float64
        1 or -1 at occluding contours of curved surfaces: the side along the normal on which the surface lies; else 0.
    feature : (n,) int32
        Row of the model's features, -1 for what is none.
    """

    placed: Placed
    spacing: FloatArray
    stretch: FloatArray
    bend: FloatArray
    limb: FloatArray
    feature: Int32Array

    def __len__(self) -> int:
        return len(self.spacing)

    def select(self, index: BoolArray | Int32Array) -> Sight:
        """Some of the points, (n,) bool or their numbers."""
        parts = (getattr(self, part.name)[index] for part in fields(self)[1:])
        return Sight(Placed(*(getattr(self.placed, name)[index] for name in Placed._fields)), *parts)

    def rows(self, eye: int) -> slice:
        """The points of one view."""
        return slice(*np.searchsorted(self.placed.eye, (eye, eye + 1)).tolist())


# What is seen where nothing is looked at.
NO_SIGHT = Sight(
    Placed(
        np.zeros((0, 3)),
        np.zeros(0, np.int32),
        np.zeros((0, 2)),
        np.zeros((0, 2)),
        np.zeros(0, np.int32),
        np.zeros(0, np.int32),
        np.zeros(0),
        np.zeros((0, 6)),
    ),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0, np.int32),
)


class Outline(NamedTuple):
    """What each of several views sees of a shape, in the model's frame: it serves for all poses of about that aspect.

    Attributes
    ----------
    point, tangent, outward : (n, 3) float64
        Points, metres; unit vectors along their curves, and out of the surface where they lie on occluding contours.
    eye, curve, feature : (n,) int32
        View of each, ascending; curve and view, ascending with the views; row of the model's features or -1.
    spacing : (n,) float64
        Pixels of the image that each stands for.
    """

    point: FloatArray
    tangent: FloatArray
    outward: FloatArray
    eye: Int32Array
    curve: Int32Array
    feature: Int32Array
    spacing: FloatArray


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
    outline = outline_of(shape, pose, views.cameras, views.poses, spacing)
    # However far apart points are, steps are looked for over no more of the outline than when it is measured.
    return drawn(outline, as_motion(pose), shape.centre, views, SPACING)


def outline_of(
    shape: Shape, pose: Pose, cameras: Sequence[PinholeCamera], stands: Sequence[Pose], spacing: float = SPACING
) -> Outline:
    """The points of a shape at first_T_model that cameras at first_T_camera see, ``spacing`` pixels apart."""
    seen: list[OutlinePoints] = [
        shape.visible(stand.inverse().compose(pose), camera, spacing) for camera, stand in zip(cameras, stands)
    ]
    curves = np.cumsum([0, *(int(one.curve.max(initial=-1)) + 1 for one in seen)])
    return Outline(
        np.concatenate([one.point for one in seen]),
        np.concatenate([one.tangent for one in seen]),
        np.concatenate([one.outward for one in seen]),
        np.repeat(np.arange(len(seen), dtype=np.int32), [len(one) for one in seen]),
        np.concatenate([one.curve + first for one, first in zip(seen, curves)]).astype(np.int32),
        np.concatenate([one.feature for one in seen]).astype(np.int32),
        np.concatenate([one.spacing for one in seen]),
    )


def drawn(outline: Outline, motion: FloatArray, middle: FloatArray, views: Views, stretch: float = math.inf) -> Sight:
    """An outline as the views have it at a pose.

    Parameters
    ----------
    outline : Outline
        Of a pose from which the shape looks about the same.
    motion : (12,) float64
        first_T_model.
    middle : (3,) float64
        Metres, model frame, about which the pose turns.
    views : Views
    stretch : float
        Pixels along which a point is measured, at most.
    """
    placed, spacing, bend, limb, feature = _drawn(outline, motion, middle, views.rows, views.sizes)
    return Sight(placed, spacing, np.minimum(spacing, stretch), bend, limb, feature)


@njit(nogil=True)
def _drawn(
    outline: Outline, motion: FloatArray, middle: FloatArray, cameras: FloatArray, sizes: FloatArray
) -> tuple[Placed, FloatArray, FloatArray, FloatArray, Int32Array]:
    """Points as drawn, their spacing, bend, limb and feature (n,); see :func:`drawn` and :class:`Sight`."""
    keep, pixel, normal, slope, limb = _projected(outline, motion, middle, cameras, sizes)
    eye, group, spacing, feature = outline.eye[keep], outline.curve[keep], outline.spacing[keep], outline.feature[keep]
    abscissa, bend = _along(group, pixel, normal, spacing)
    curve = same_curves(group, eye, feature)
    point = np.empty((len(keep), 3))
    for n, k in enumerate(keep):
        for i in range(3):
            point[n, i] = outline.point[k, i]
    placed = Placed(point, eye, pixel, normal, group, curve, abscissa, slope)
    return placed, spacing, bend, limb, feature


@njit(nogil=True)
def _projected(
    outline: Outline, motion: FloatArray, middle: FloatArray, cameras: FloatArray, sizes: FloatArray
) -> tuple[Int32Array, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows of the points in the images (n,), their places and normals (n, 2), slopes (n, m), limbs (n,); see Sight.

    cameras, sizes : see :attr:`.views.Views.rows` and :attr:`.views.Views.sizes`
    """
    most = len(outline.eye)
    keep = np.empty(most, np.int32)
    pixel, normal = np.empty((most, 2)), np.empty((most, 2))
    slope, limb = np.zeros((most, 6 + OF_IMAGE * (len(cameras) - 1))), np.empty(most)
    cx, cy, cz = transform(motion, middle[0], middle[1], middle[2])
    n = 0
    for k in range(most):
        c = cameras[outline.eye[k]]
        px, py, pz = transform(motion, outline.point[k, 0], outline.point[k, 1], outline.point[k, 2])
        x = c[0] * px + c[1] * py + c[2] * pz + c[9]
        y = c[3] * px + c[4] * py + c[5] * pz + c[10]
        z = c[6] * px + c[7] * py + c[8] * pz + c[11]
        if not z > 0.0:
            continue
        u, v = c[12] * x / z + c[14], c[13] * y / z + c[15]
        size = sizes[outline.eye[k]]
        if not (u >= -0.5 and v >= -0.5 and u <= size[0] - 0.5 and v <= size[1] - 0.5):
            continue
        du, dv = _image_direction(c, motion, outline.tangent[k], x / z, y / z)
        length = math.sqrt(du * du + dv * dv)
        if not length > 0.0:
            continue
        nu, nv = -dv / max(length, NOT_ZERO), du / max(length, NOT_ZERO)
        ou, ov = _image_direction(c, motion, outline.outward[k], x / z, y / z)
        keep[n] = k
        pixel[n, 0], pixel[n, 1] = u, v
        normal[n, 0], normal[n, 1] = nu, nv
        limb[n] = -np.sign(nu * ou + nv * ov)
        # Derivatives by a shift, in this camera's frame, then in the first one's.
        gx, gy = nu * c[12] / z, nv * c[13] / z
        gz = -(gx * x + gy * y) / z
        ax, ay, az = px - cx, py - cy, pz - cz
        sx = c[0] * gx + c[3] * gy + c[6] * gz
        sy = c[1] * gx + c[4] * gy + c[7] * gz
        sz = c[2] * gx + c[5] * gy + c[8] * gz
        if limb[n] != 0.0:
            # The limb moves as its tangent plane does; its points may have left it a little when the outline is reused.
            ox, oy, oz = rotate(motion, outline.outward[k, 0], outline.outward[k, 1], outline.outward[k, 2])
            share = ox * sx + oy * sy + oz * sz
            sx, sy, sz = share * ox, share * oy, share * oz
        slope[n, 0], slope[n, 1], slope[n, 2] = ay * sz - az * sy, az * sx - ax * sz, ax * sy - ay * sx
        slope[n, 3], slope[n, 4], slope[n, 5] = sx, sy, sz
        if outline.eye[k] > 0:
            first = 6 + OF_IMAGE * (outline.eye[k] - 1)
            slope[n, first], slope[n, first + 1] = nu, nv
        n += 1
    return keep[:n].copy(), pixel[:n].copy(), normal[:n].copy(), slope[:n].copy(), limb[:n].copy()


@njit(nogil=True)
def _image_direction(
    camera: FloatArray, motion: Motion, direction: FloatArray, x: float, y: float
) -> tuple[float, float]:
    """Where in the image a point at (x, y, 1) moves that moves by a direction (3,) of the model; up to a factor."""
    dx, dy, dz = rotate(motion, direction[0], direction[1], direction[2])
    ex = camera[0] * dx + camera[1] * dy + camera[2] * dz
    ey = camera[3] * dx + camera[4] * dy + camera[5] * dz
    ez = camera[6] * dx + camera[7] * dy + camera[8] * dz
    return camera[12] * (ex - ez * x), camera[13] * (ey - ez * y)


@njit(nogil=True)
def same_curves(group: Int32Array, eye: Int32Array, feature: Int32Array) -> Int32Array:
    """Which points lie on one curve of the model, (n,) int32: one number for all views of a curve.

    Parameters
    ----------
    group, eye, feature : (n,) int32
        See :class:`Outline`. Contours are no features: the first of one view is taken for that of the others.
    """
    out = np.empty(len(group), np.int32)
    contours = 0
    for k in range(len(group)):
        if k > 0 and eye[k] != eye[k - 1]:
            contours = 0
        if feature[k] >= 0:
            out[k] = 2 * feature[k]
            continue
        if k == 0 or group[k] != group[k - 1]:
            contours += 1
        out[k] = 2 * contours - 1
    return out


@njit(nogil=True)
def _along(
    group: Int32Array, pixel: FloatArray, normal: FloatArray, spacing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where on its curve each point is (n,), from -1 to 1; its curvature in the image (n,), one over pixels.

    The curvature is towards the normals, from neighbours on one curve.
    """
    n = len(group)
    abscissa, bend, turn = np.empty(n), np.zeros(n), 0.0
    start = 0
    for k in range(n + 1):
        if k < n and group[k] == group[start]:
            continue
        for j in range(start, k):
            abscissa[j] = (2.0 * (j - start) + 1.0) / (k - start) - 1.0
        start = k
    before = False
    for k in range(n):
        # Two neighbours are a spacing apart; more lies between them where something hides the curve.
        after, next_turn = False, 0.0
        if k + 1 < n and group[k + 1] == group[k]:
            step = math.hypot(pixel[k + 1, 0] - pixel[k, 0], pixel[k + 1, 1] - pixel[k, 1])
            after = step < 1.5 * spacing[k + 1]
            if after:
                next_turn = (normal[k, 0] * normal[k + 1, 1] - normal[k, 1] * normal[k + 1, 0]) / max(step, NOT_ZERO)
        count = (1 if before else 0) + (1 if after else 0)
        if count > 0:
            bend[k] = ((turn if before else 0.0) + (next_turn if after else 0.0)) / count
        before, turn = after, next_turn
    return abscissa, bend
