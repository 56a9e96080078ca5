"""Normal orientation: which way the face looks that a circle bounds (thesis 6.4, Figure 6.5).

A rim that is seen all round, or on its far side, bounds a face whose normal points to the cameras. Where only the near
side of a rim is seen, the normal points away (the lower end of a cylinder), unless something beyond it lies in the same
plane: then the upper side of that plane is in view, and the rim is the foot of a cylinder that stands on it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py.numeric.typed import FloatArray

from ..detection.settings import LEAST_DIVISOR
from . import settings
from .curve import Curve, flipped


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
    result = []
    for curve in curves:
        if (
            near_side_only(curve)
            and curve.normal @ curve.centre > 0.0
            and (_edge_behind(curve, ends, err_per) or any(_rim_behind(curve, c) for c in curves if c is not curve))
        ):
            curve = flipped(curve)
        result.append(curve)
    return result


def _towards_camera(curve: Curve) -> FloatArray:
    """(3,) float64: unit direction in the curve's plane, from its centre towards the left camera."""
    towards = curve.normal * (curve.centre @ curve.normal) - curve.centre
    return towards / max(float(np.linalg.norm(towards)), LEAST_DIVISOR)


def _coplanar_limit(curve: Curve, distance: FloatArray) -> FloatArray:
    """Metres: how far off the curve's plane points of that plane may be, by their distance from the centre, metres."""
    along = settings.BOUND_SIGMA * np.sqrt(curve.normal @ curve.covariance[:3, :3] @ curve.normal)
    radius = curve.radii[0]
    limit = along + settings.BOUND_SIGMA * curve.tilt * distance + settings.COPLANAR * radius
    nearest: FloatArray = np.minimum(limit, settings.MOST_COPLANAR * radius)
    return nearest


def _edge_behind(curve: Curve, ends: FloatArray, err_per: FloatArray) -> bool:
    """Whether a straight edge in the curve's plane passes behind its centre; see :func:`oriented_by_faces`.

    The edge's line is what counts: an edge that runs into the near side of the rim may have its far end behind it.
    """
    if len(ends) == 0:
        return False
    run = ends - curve.centre
    distance = np.linalg.norm(run, axis=2)
    coplanar = (np.abs(run @ curve.normal) < _coplanar_limit(curve, distance) + err_per[:, None]).all(axis=1)
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), LEAST_DIVISOR)
    across = run[:, 0] - (run[:, 0] * along).sum(axis=1, keepdims=True) * along
    offset = np.linalg.norm(across, axis=1)
    behind = -(across @ _towards_camera(curve)) > settings.BEHIND_COSINE * offset
    return bool((coplanar & behind & (offset > settings.BEHIND_OFFSET * curve.radii[0])).any())


def _rim_behind(curve: Curve, other: Curve) -> bool:
    """Whether another rim in the curve's plane, seen on more than its near side, reaches behind the curve."""
    run = other.centre - curve.centre
    distance = np.linalg.norm(run) + other.radii[0]
    off_plane = abs(run @ curve.normal) + other.radii[0] * np.linalg.norm(np.cross(curve.normal, other.normal))
    if off_plane > _coplanar_limit(curve, distance):
        return False
    far = -(run @ _towards_camera(curve)) + other.radii[0]
    return bool(other.arc[1] >= settings.PARTIAL_ARC and far > settings.BEHIND_RING * curve.radii[0])
