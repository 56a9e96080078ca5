"""Which way the face looks that a circle bounds: the sign of its normal (thesis 6.4, Figure 6.5).

A rim that is seen all round, or on its far side, bounds a face that looks at us. Of one that is seen on its near side
only, the face looks away (the lower end of a cylinder), unless something beyond it lies in the same plane: then that
plane's upper side is in view, and the rim is the foot of a cylinder that stands on it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .curve import Curve, turned

# A curve is seen in part when its arc is shorter than this, radians.
PART = 1.25 * np.pi
# What lies beyond passes the curve's centre at more than this, in radii, on the side away from the eye (cosine). Of a
# face that looks away, only edges on the near side are seen.
BEYOND = 0.5
BEHIND = 0.2
# Distance from the curve's plane that does not count, in radii, beside three sigma; most it may be, in radii.
FLAT, FARTHEST = 0.02, 0.25


def near_side_only(curve: Curve) -> bool:
    """Whether only the half of the curve that is nearer to the eye is seen."""
    if curve.arc[1] >= PART:
        return False
    middle = curve.arc[0] + 0.5 * curve.arc[1]
    spot = np.cos(middle) * curve.first + np.sin(middle) * curve.second
    return bool(spot @ _towards(curve) > 0.0)


def outward(curve: Curve) -> Curve:
    """The curve with its normal out of its face, as far as it alone can tell."""
    towards_us = curve.normal @ curve.centre < 0.0
    return curve if towards_us != near_side_only(curve) else turned(curve)


def on_faces(curves: Sequence[Curve], ends: np.ndarray, sigma: np.ndarray) -> list[Curve]:
    """The same curves; those that stand on a face whose upper side is in view have their normals turned to us.

    ends : (n, 2, 3) float64, metres, straight edges; sigma : (n,) metres, three sigma across them.
    """
    result = []
    for curve in curves:
        if (
            near_side_only(curve)
            and curve.normal @ curve.centre > 0.0
            and (_edges_beyond(curve, ends, sigma) or any(_ring_beyond(curve, c) for c in curves if c is not curve))
        ):
            curve = turned(curve)
        result.append(curve)
    return result


def _towards(curve: Curve) -> np.ndarray:
    """(3,): in the curve's plane, towards the eye."""
    towards = curve.normal * (curve.centre @ curve.normal) - curve.centre
    return towards / max(float(np.linalg.norm(towards)), 1e-12)


def _slack(curve: Curve, distance: np.ndarray) -> np.ndarray:
    """How far from the curve's plane points at a distance from its centre may be, metres."""
    along = 3.0 * np.sqrt(curve.normal @ curve.covariance[:3, :3] @ curve.normal)
    return np.minimum(along + 3.0 * curve.tilt * distance + FLAT * curve.radii[0], FARTHEST * curve.radii[0])


def _edges_beyond(curve: Curve, ends: np.ndarray, sigma: np.ndarray) -> bool:
    if len(ends) == 0:
        return False
    run = ends - curve.centre
    distance = np.linalg.norm(run, axis=2)
    flat = (np.abs(run @ curve.normal) < _slack(curve, distance) + sigma[:, None]).all(axis=1)
    # The line has to pass behind the centre: an edge that runs into the rim's near side goes far back, too.
    along = ends[:, 1] - ends[:, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = run[:, 0] - (run[:, 0] * along).sum(axis=1, keepdims=True) * along
    offset = np.linalg.norm(across, axis=1)
    behind = -(across @ _towards(curve)) > BEHIND * offset
    return bool((flat & behind & (offset > BEYOND * curve.radii[0])).any())


def _ring_beyond(curve: Curve, other: Curve) -> bool:
    run = other.centre - curve.centre
    distance = np.linalg.norm(run) + other.radii[0]
    if abs(run @ curve.normal) + other.radii[0] * np.linalg.norm(np.cross(curve.normal, other.normal)) > _slack(
        curve, distance
    ):
        return False
    far = -(run @ _towards(curve)) + other.radii[0]
    return bool(other.arc[1] >= PART and far > 1.05 * curve.radii[0])
