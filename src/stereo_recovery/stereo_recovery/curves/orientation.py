"""Normal orientation: which way the face looks that a circle bounds (thesis 6.4, Figure 6.5).

A rim that is seen all round, or on its far side, bounds a face whose normal points to the cameras. Where only the near
side of a rim is seen, the normal points away (the lower end of a cylinder), unless something beyond it lies in the same
plane: then the upper side of that plane is in view, and the rim is the foot of a cylinder that stands on it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA, NOT_ZERO
from msgs_py.numeric.typed import FloatArray

from . import settings
from .curve import Curve, cross, flipped


def near_side_only(curve: Curve) -> bool:
    """Whether only the half of a curve that is nearer to the cameras is seen.

    Parameters
    ----------
    curve : Curve
        Left optical frame.

    Returns
    -------
    bool
    """
    if curve.arc[1] >= settings.PARTIAL_ARC:
        return False
    angle = curve.arc[0] + 0.5 * curve.arc[1]
    middle = np.cos(angle) * curve.first + np.sin(angle) * curve.second
    return bool(middle @ _towards_camera(curve) > 0.0)


def outward(curve: Curve) -> Curve:
    """Turn a curve's normal out of its face, as far as its own visible arc determines that.

    Parameters
    ----------
    curve : Curve
        Left optical frame.

    Returns
    -------
    Curve
    """
    towards_camera = curve.normal @ curve.centre < 0.0
    return curve if towards_camera != near_side_only(curve) else flipped(curve)


def oriented_by_faces(curves: Sequence[Curve], ends: FloatArray, err_per: FloatArray) -> list[Curve]:
    """The curves, with the normals of those turned to the cameras that stand on a face whose upper side is in view.

    Parameters
    ----------
    curves : sequence of Curve
        Left optical frame, metres.
    ends : (n, 2, 3) float64, metres
        Straight edges, left optical frame.
    err_per : (n,) float64, metres
        Three sigma across the edges.

    Returns
    -------
    list of Curve
        In the same order.
    """
    # A rim that is seen on more than its near side counts as an edge that touches its far side.
    rims = [curve for curve in curves if curve.arc[1] >= settings.PARTIAL_ARC]
    ends = np.concatenate([ends, np.array([_far_tangent(curve) for curve in rims]).reshape(-1, 2, 3)])
    err_per = np.append(err_per, [BOUND_SIGMA * np.sqrt(np.trace(curve.covariance[:3, :3])) for curve in rims])
    return [
        flipped(curve)
        if near_side_only(curve) and curve.normal @ curve.centre > 0.0 and _edge_behind(curve, ends, err_per)
        else curve
        for curve in curves
    ]


def _towards_camera(curve: Curve) -> FloatArray:
    """(3,) float64: unit direction in the curve's plane, from its centre towards the left camera."""
    towards = curve.normal * (curve.centre @ curve.normal) - curve.centre
    return towards / max(float(np.linalg.norm(towards)), NOT_ZERO)


def _far_tangent(curve: Curve) -> FloatArray:
    """(2, 3) float64, metres: a piece of the tangent at the point of a curve that is farthest from the camera."""
    towards = _towards_camera(curve)
    side = cross(curve.normal, towards)
    tangent: FloatArray = curve.centre + curve.radii[0] * np.stack([side - towards, -side - towards])
    return tangent


def _edge_behind(curve: Curve, ends: FloatArray, err_per: FloatArray) -> bool:
    """Whether a straight edge in the curve's plane passes behind its centre; see :func:`oriented_by_faces`.

    The edge's line is what counts: an edge that runs into the near side of the rim may have its far end behind it.
    """
    run = ends - curve.centre
    turn = np.hypot(curve.tilt, settings.TURNED_SIGMA) * np.linalg.norm(run, axis=2)
    of_centre = curve.normal @ curve.covariance[:3, :3] @ curve.normal
    sigma = np.sqrt(of_centre + turn**2 + (err_per[:, None] / BOUND_SIGMA) ** 2)
    coplanar = (np.abs(run @ curve.normal) < BOUND_SIGMA * sigma).all(axis=1)
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), NOT_ZERO)
    across = run[:, 0] - (run[:, 0] * along).sum(axis=1, keepdims=True) * along
    behind = -(across @ _towards_camera(curve)) > settings.BEHIND * curve.radii[0]
    return bool((coplanar & behind).any())
