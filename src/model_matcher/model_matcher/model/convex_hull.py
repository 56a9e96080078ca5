"""The faces of a model's convex hull, and which edges and curves lie on them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from msgs_py import FeatureKind
from msgs_py.numeric.vectors import perpendicular

from .index import ModelIndex
from .settings import CURVE_POINTS, SAME, SYMMETRY_TOLERANCE


def hull_faces(index: ModelIndex) -> tuple[np.ndarray, np.ndarray]:
    """Faces of a model's convex hull, and the edges and curves on them.

    Parameters
    ----------
    index : ModelIndex
        A model with e features.

    Returns
    -------
    planes : (h, 4) float64
        Outward normal and offset (metres) of each face, where normal . x + offset = 0. A flat model has two faces, a
        straight one none.
    lies : (h, e) bool
        Which edges and curves lie on them.
    """
    rows = index.rows
    step = rows[:, 6:7] * rows[:, 3:6]
    rims = _rims(index)
    points = np.concatenate([rows[:, :3] - step, rows[:, :3] + step, rims])
    planes = _planes(points, index.size)
    lies = np.ones((len(planes), len(rows)), bool)
    near = SYMMETRY_TOLERANCE * index.size
    for sign in (-1.0, 1.0):
        away = np.abs((rows[:, :3] + sign * step) @ planes[:, :3].T + planes[:, 3])
        lies &= (away < near).T
    lies &= index.kind == FeatureKind.EDGE
    curves = index.kind == FeatureKind.CURVE
    on = np.abs(rims @ planes[:, :3].T + planes[:, 3]) < near
    # A rim lies on the flat face that it bounds, and on those beside it along which the hull goes on.
    lies[:, curves] = (on.reshape(int(curves.sum()), CURVE_POINTS, len(planes)).sum(axis=1) > 1).T
    return planes, lies


def _rims(index: ModelIndex) -> np.ndarray:
    """Points of the curves, CURVE_POINTS of each, one curve after the other."""
    rows = index.rows[index.kind == FeatureKind.CURVE]
    angle = np.arange(CURVE_POINTS) * 2.0 * np.pi / CURVE_POINTS
    normal = rows[:, 3:6]
    u = -perpendicular(normal)
    v = np.cross(normal, u)
    around = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    points: np.ndarray = rows[:, None, :3] + np.nan_to_num(rows[:, None, 7:8]) * around
    return points.reshape(-1, 3)


def _planes(points: np.ndarray, size: float) -> np.ndarray:
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(spread) < 3 or spread[1] < SYMMETRY_TOLERANCE * size:
        return np.zeros((0, 4))
    if spread[2] < SYMMETRY_TOLERANCE * size:
        return np.array([[*(sign * axes[2]), -sign * float(axes[2] @ middle)] for sign in (-1.0, 1.0)])
    try:
        found = ConvexHull(points).equations
    except QhullError:
        return np.zeros((0, 4))
    # The hull comes in triangles; a face is all of them in one plane.
    steps = SAME * np.array([1.0, 1.0, 1.0, size])
    _, first = np.unique(np.round(found / steps), axis=0, return_index=True)
    return np.ascontiguousarray(found[np.sort(first)])
