"""Occluding contours of spheres: they look like circles that face the cameras, and are no curves of the object.

The lines of sight that touch a sphere form a cone. The cones of two cameras meet in a plane, so that there is a planar
curve with just these two images: nearly a circle, square to the line of sight. A sphere explains the same edgels with
four parameters instead of six; a disc that faces the cameras differs by being seen slightly from the side by either.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA, NOT_ZERO
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.settings import CAUCHY, CORRELATION_LENGTH
from . import settings
from .agreement import agrees
from .curve import CameraView, Curve
from .fit import distances
from .inlier_kernels import on_conic
from .observations import EdgelMasks, StereoEdgels


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
    sigma, sphere = edgels.seen.sigma[index], np.append(curve.centre, curve.radii.mean())
    for _ in range(settings.ROUNDS):
        off, rows = _distances(sphere, edgels, index)
        weight = 1.0 / (sigma**2 + (off / CAUCHY) ** 2)
        sphere = sphere - np.linalg.lstsq(rows.T @ (weight[:, None] * rows), rows.T @ (weight * off), rcond=None)[0]
        if not 0.0 < sphere[3] < sphere[2]:
            return None
    of_sphere, of_curve = (
        float(np.minimum((off / sigma) ** 2, BOUND_SIGMA**2).sum())
        for off in (_distances(sphere, edgels, index)[0], distances(curve, edgels, index))
    )
    # Two parameters less; edgels that are alike count as one, and the scale is what the curve leaves.
    worse = (of_sphere - of_curve) / (of_curve + NOT_ZERO) * len(index) / CORRELATION_LENGTH
    return sphere if agrees(np.sqrt([max(worse, 0.0)]), np.eye(1), 2) else None


def _distances(sphere: FloatArray, edgels: StereoEdgels, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """(k,) pixels: of edgels from the contours of a sphere (4,), without the bias of smoothing; (k, 4) derivatives."""
    seen = edgels.seen
    is_right = index >= seen.left_count
    camera, points = seen.cameras[is_right.astype(int)], seen.points[index]
    sight = np.column_stack([(points - camera[:, 2:]) / camera[:, :2], np.ones(len(index))])
    centre = sphere[:3] - np.outer(is_right, [seen.baseline, 0.0, 0.0])
    # The cone of sight: (c c - r r) s s = (c s)^2 of lines of sight s.
    square, along = (sight * sight).sum(axis=1), (centre * sight).sum(axis=1)
    touching = (centre * centre).sum(axis=1) - sphere[3] ** 2
    slope = 2.0 * (touching[:, None] * sight - along[:, None] * centre)[:, :2] / camera[:, :2]
    steep = np.hypot(slope[:, 0], slope[:, 1]) + NOT_ZERO
    bias = 0.5 * seen.blur * sphere[2] / (camera[:, 0] * sphere[3])
    by_centre = 2.0 * (square[:, None] * centre - along[:, None] * sight)
    rows = np.column_stack([by_centre, -2.0 * sphere[3] * square]) / steep[:, None]
    return (touching * square - along * along) / steep + bias, rows


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
        on_conic(_contour_conic(sphere, view), side.position, side.direction, around, settings.INLIER_DISTANCE)
        for (side, view), around in zip(edgels.sides, edgels.seen.boxes)
    )
    return edgels.masks(np.concatenate([left, len(edgels.left) + right]))
