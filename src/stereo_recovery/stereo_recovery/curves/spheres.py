"""Occluding contours of spheres: they look like circles that face the cameras, and are no curves of the object.

The lines of sight that touch a sphere form a cone. The cones of two cameras meet in a plane, so that there is a planar
curve with just these two images: nearly a circle, square to the line of sight. A sphere explains the same edgels with
four parameters instead of six; a disc that faces the cameras differs by being seen slightly from the side by either.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray

from . import settings, sphere_kernels
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
    return bool(left[curve.left].mean() > settings.SPHERE_SHARE and right[curve.right].mean() > settings.SPHERE_SHARE)


def _sphere(curve: Curve, edgels: StereoEdgels) -> FloatArray | None:
    """(4,) float64, metres, left frame: centre and radius of the sphere that explains a curve's edgels about as well.

    None when no sphere does.
    """
    rig = edgels.rig
    middle = curve.centre - [0.5 * rig.baseline, 0.0, 0.0]
    mostly = curve.coverage > settings.MOSTLY_SEEN
    facing = settings.WHOLE_FACING_COSINE if mostly else settings.FACING_COSINE
    is_oval = curve.radii[1] < settings.FACING_COSINE * curve.radii[0]
    if is_oval or abs(curve.normal @ middle) < facing * np.linalg.norm(middle):
        return None
    if min(int(curve.left.sum()), int(curve.right.sum())) < settings.LEAST_CURVE_EDGELS:
        return None
    index = np.flatnonzero(np.concatenate([curve.left, curve.right]))
    seen = edgels.seen
    sigma = seen.sigma[index]
    start = np.append(curve.centre, curve.radii.mean())
    sphere: FloatArray = sphere_kernels.fitted(start, float(curve.radii[0]), seen, index)
    distance = float(np.linalg.norm(sphere[:3]))
    if not (sphere[3] > 0.0 and distance > settings.LEAST_SPHERE_DISTANCE * sphere[3] and sphere[2] > 0.0):
        return None
    of_curve = distances(curve, edgels, index)
    of_sphere = sphere_kernels.distances(sphere, seen, index)
    most = settings.SPHERE_TRUNCATION**2
    cost, curve_cost = (np.minimum((off / sigma) ** 2, most).sum() for off in (of_sphere, of_curve))
    return sphere if cost < settings.SPHERE_COST_FACTOR * curve_cost else None


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
