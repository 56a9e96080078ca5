"""How much of what a camera sees of a model was found: evidence beyond coincidences.

An edge on a model's convex hull is in view when a face of the hull that it lies on looks at the eye: nothing of the
model itself can hide it. Of a real object most edges in view are found; a pose that lies on the data by chance explains
those few that made it, and seldom half of what it would show. So a larger share speaks for the pose. A smaller one
does not speak against it: objects hide each other.
"""

from __future__ import annotations

import numpy as np

from msgs_py import FeatureKind
from msgs_py.compiled import njit

from .kernels import CURVE
from .model_index import ModelIndex

# Corners and edges lie on a face of the hull when they are this near to it, as a share of the model's size.
ON_FACE = 0.005
# Nats for each further share of the length in view, above the share that chance explains as well.
PER_SHARE, COMMON = 20.0, 0.55
BINS = 24  # places along an edge that are looked at
RIM = 16  # points that stand for a curve


def hull_faces(index: ModelIndex) -> tuple[np.ndarray, np.ndarray]:
    """Faces of a model's convex hull: outward normals and offsets (h, 4), the face where normal . x + offset = 0,
    metres; and lies (h, e) bool, which edges lie on them. A flat model has two faces, a straight one none."""
    rows = index.rows
    step = rows[:, 6:7] * rows[:, 3:6]
    points = np.concatenate([rows[:, :3] - step, rows[:, :3] + step, _rims(index)])
    planes = _planes(points, index.size)
    lies = np.ones((len(planes), len(rows)), bool)
    near = ON_FACE * index.size
    for sign in (-1.0, 1.0):
        away = np.abs((rows[:, :3] + sign * step) @ planes[:, :3].T + planes[:, 3])
        lies &= (away < near).T
    return planes, lies & (index.kind == FeatureKind.EDGE)


def _rims(index: ModelIndex) -> np.ndarray:
    rows = index.rows[index.kind == FeatureKind.CURVE]
    angle = np.arange(RIM) * 2.0 * np.pi / RIM
    normal = rows[:, 3:6]
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)]) if len(rows) else normal
    u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    v = np.cross(normal, u)
    around = np.cos(angle)[:, None, None] * u + np.sin(angle)[:, None, None] * v
    return (rows[:, :3] + np.nan_to_num(rows[:, 7:8]) * around).reshape(-1, 3)


def _planes(points: np.ndarray, size: float) -> np.ndarray:
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(spread) < 3 or spread[1] < ON_FACE * size:
        return np.zeros((0, 4))
    if spread[2] < ON_FACE * size:
        return np.array([[*(sign * axes[2]), -sign * float(axes[2] @ middle)] for sign in (-1.0, 1.0)])
    from scipy.spatial import ConvexHull, QhullError
    try:
        found = ConvexHull(points).equations
    except QhullError:
        return np.zeros((0, 4))
    # The hull comes in triangles; a face is all of them in one plane.
    _, first = np.unique(np.round(found / [0.01, 0.01, 0.01, 0.01 * size]), axis=0, return_index=True)
    return np.ascontiguousarray(found[np.sort(first)])


@njit
def nats_of_view(motion, model, kind_m, data, kind_d, assignment, planes, lies):
    """Nats for the share of the edges in view that data (n, 9) assigned (n,) to them covers; the eye is the origin of
    the data's frame, pose (12,). planes (h, 4), lies (h, e) : see :func:`hull_faces`; rows as in kernels.py."""
    e = model.shape[0]
    in_view = np.zeros(e, np.bool_)
    for h in range(planes.shape[0]):
        # The eye in the model's frame is -R^T t.
        side = planes[h, 3]
        for axis in range(3):
            side -= planes[h, axis] * (motion[axis] * motion[9] + motion[3 + axis] * motion[10]
                                       + motion[6 + axis] * motion[11])
        if side > 0.0:
            for j in range(e):
                in_view[j] |= lies[h, j]
    total = 0.0
    for j in range(e):
        if in_view[j]:
            total += model[j, 6]
    if total == 0.0:
        return 0.0
    hit = np.zeros((e, BINS), np.bool_)
    covered = 0.0
    for k in range(data.shape[0]):
        j = assignment[k]
        if j < 0 or kind_d[k] == CURVE or kind_m[j] == CURVE or not in_view[j]:
            continue
        along = dot = 0.0
        for axis in range(3):
            rotated = (motion[axis] * data[k, 3] + motion[3 + axis] * data[k, 4] + motion[6 + axis] * data[k, 5])
            x = (motion[axis] * (data[k, 0] - motion[9]) + motion[3 + axis] * (data[k, 1] - motion[10])
                 + motion[6 + axis] * (data[k, 2] - motion[11]) - model[j, axis])
            along += x * model[j, 3 + axis]
            dot += rotated * model[j, 3 + axis]
        half, reach = model[j, 6], abs(dot) * data[k, 6]
        for b in range(BINS):
            place = half * (2.0 * (b + 0.5) / BINS - 1.0)
            if not hit[j, b] and abs(place - along) <= reach:
                hit[j, b] = True
                covered += half / BINS
    return PER_SHARE * max(covered / total - COMMON, 0.0)
