"""Occluding contours of spheres: they look like circles that face the cameras, and are no curves of the object.

The lines of sight that touch a sphere form a cone. The cones of two cameras meet in a plane, so that there is a planar
curve with just these two images: nearly a circle, square to the line of sight. A sphere explains the same edgels with
four parameters instead of six; a disc that faces the cameras differs by being seen slightly from the side by either.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import BOUND_SIGMA, NOT_ZERO
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.settings import CAUCHY, CORRELATION_LENGTH
from . import settings
from .agreement import agrees
from .curve import CameraView, Curve
from .fit import distances
from .fit_kernels import solve
from .inlier_kernels import on_conic
from .observations import EdgelMasks, Seen, StereoEdgels
from .settings import ROUNDS


def without_spheres(curves: list[Curve], edgels: StereoEdgels) -> list[Curve]:
    """The curves that are no occluding contours of spheres.

    Parameters
    ----------
    curves : list of Curve
        Left optical frame, metres.
    edgels : StereoEdgels
        All edgels of chains.

    Returns
    -------
    list of Curve
        In the same order.
    """
    spheres = [sphere for curve in curves if (sphere := _sphere(curve, edgels)) is not None]
    on = [_on_contour(sphere, edgels) for sphere in spheres]
    return [c for c in curves if not any(_shows(c, left, right) for left, right in on)]


def _shows(curve: Curve, left: BoolArray, right: BoolArray) -> bool:
    """Whether most of a curve's edgels are on a sphere's contours, given as masks over all edgels."""
    return bool(min(left[curve.left].mean(), right[curve.right].mean()) > settings.SHARED_EDGELS)


def _sphere(curve: Curve, edgels: StereoEdgels) -> FloatArray | None:
    """(4,) float64, metres, left frame: centre and radius of the sphere that explains a curve's edgels as well.

    None when no sphere does.
    """
    middle = curve.centre - [0.5 * edgels.rig.baseline, 0.0, 0.0]
    index = np.flatnonzero(np.concatenate([curve.left, curve.right]))
    if len(index) == 0 or abs(curve.normal @ middle) < settings.FACING_COSINE * np.linalg.norm(middle):
        return None
    start = np.append(curve.centre, curve.radii.mean())
    good, sphere, of_sphere = fitted_sphere(start, edgels.seen, index)
    if not good:
        return None
    off = distances(curve, edgels, index) / edgels.seen.sigma[index]
    of_curve = float(np.minimum(off**2, BOUND_SIGMA**2).sum())
    # Two parameters less; edgels that are alike count as one, and the scale is what the curve leaves.
    worse = (of_sphere - of_curve) / (of_curve + NOT_ZERO) * len(index) / CORRELATION_LENGTH
    return sphere if agrees(np.sqrt([max(worse, 0.0)]), np.eye(1), 2) else None


@njit(nogil=True)
def fitted_sphere(sphere: FloatArray, seen: Seen, index: IntArray) -> tuple[bool, FloatArray, float]:
    """The sphere whose contours lie on edgels, by least squares with Cauchy weights.

    Parameters
    ----------
    sphere : (4,) float64, metres
        Centre and radius to start from, left frame.
    seen : Seen
    index : (k,) int64
        Which edgels.

    Returns
    -------
    good : bool
    sphere : (4,) float64, metres
    cost : float
        Squares of the distances over their sigma, of each up to three sigma.
    """
    sphere = sphere.copy()
    row, square, step = np.empty(4), np.empty((4, 4)), np.empty((4, 1))
    for _ in range(ROUNDS):
        square[:], step[:] = 0.0, 0.0
        for k in index:
            off = _distance(sphere, seen, k, row)
            weight = 1.0 / (seen.sigma[k] ** 2 + (off / CAUCHY) ** 2)
            for a in range(4):
                step[a, 0] += weight * off * row[a]
                for b in range(4):
                    square[a, b] += weight * row[a] * row[b]
        if not solve(square, step):
            return False, sphere, np.inf
        sphere -= step[:, 0]
        if not 0.0 < sphere[3] < sphere[2]:
            return False, sphere, np.inf
    cost = 0.0
    for k in index:
        cost += min((_distance(sphere, seen, k, row) / seen.sigma[k]) ** 2, BOUND_SIGMA**2)
    return True, sphere, cost


@njit
def _distance(sphere: FloatArray, seen: Seen, k: int, row: FloatArray) -> float:
    """Pixels: of an edgel from the contour of a sphere (4,), without the bias of smoothing; its derivatives in (4,)."""
    side = 0 if k < seen.left_count else 1
    fx, fy, cx, cy = seen.cameras[side]
    sx, sy = (seen.points[k, 0] - cx) / fx, (seen.points[k, 1] - cy) / fy
    x, y, z, radius = sphere[0] - side * seen.baseline, sphere[1], sphere[2], sphere[3]
    # The cone of sight: (c c - r r) s s = (c s)^2 of lines of sight s.
    square, along = sx * sx + sy * sy + 1.0, x * sx + y * sy + z
    touching = x * x + y * y + z * z - radius * radius
    steep = np.hypot(2.0 * (touching * sx - along * x) / fx, 2.0 * (touching * sy - along * y) / fy) + NOT_ZERO
    row[0], row[1] = 2.0 * (square * x - along * sx) / steep, 2.0 * (square * y - along * sy) / steep
    row[2], row[3] = 2.0 * (square * z - along) / steep, -2.0 * radius * square / steep
    return float((touching * square - along * along) / steep + 0.5 * seen.blur * z / (fx * radius))


def _contour_conic(sphere: FloatArray, view: CameraView) -> FloatArray:
    """(3, 3) float64: the image conic of a sphere's occluding contour, negative inside."""
    centre = sphere[:3] - view.centre
    inverse = np.linalg.inv(view.matrix)
    cone = (centre @ centre - sphere[3] ** 2) * np.eye(3) - np.outer(centre, centre)
    conic: FloatArray = inverse.T @ cone @ inverse
    conic /= np.abs(conic).max()
    return conic


def _on_contour(sphere: FloatArray, edgels: StereoEdgels) -> EdgelMasks:
    """Edgels of the two images on a sphere's contours."""
    left, right = (
        on_conic(
            _contour_conic(sphere, view),
            side.position,
            side.direction,
            around,
            np.full(len(side), settings.INLIER_DISTANCE),
            settings.ACROSS_COSINE,
        )
        for (side, view), around in zip(edgels.sides, edgels.seen.boxes)
    )
    return edgels.masks(np.concatenate([left, len(edgels.left) + right]))
