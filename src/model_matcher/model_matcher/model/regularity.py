"""What a model owes to the regularity of made things: few directions, and planes that many edges share.

Other objects share this regularity. When one corner of a box lies on one corner of a model, every further edge along
the same directions does so at the price of one coincidence: that a dimension agrees. evidence.py counts these
coincidences, and for this needs to know which features lie in which planes of the usual orientations.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py.numeric.vectors import perpendicular

from .convex_hull import hull_faces
from .index import ModelIndex
from .settings import MAX_DIRECTIONS, MAX_NORMALS, PARALLEL_COSINE, PERPENDICULAR_COSINE, SAME


class Regularity(NamedTuple):
    """Directions and planes of a model's e features.

    Attributes
    ----------
    order : (e,) int32
        The features, longest first, curves before edges.
    direction : (e,) int32
        Number of each one's direction.
    normals : (q, 3) float64
        Unit normals of planes spanned by two of the directions, or upright to a flat model.
    offsets : (q, e) float64
        Metres, distance of each feature's plane from the origin, NaN when it lies in no such plane: a line in planes
        along it, a curve also in its own.
    sorted : (q, e) int32
        The features by offset, those without one last.
    usual : (d,) int32
        Numbers of the most frequent directions, which span the planes.
    spanned : (q, d) int8
        By plane and usual direction: 1 when it lies in the plane, 2 when it is upright to it.
    upright : (d, d) int32
        Which usual direction is upright to two of them, -1 for none.
    faces, lies : ndarray
        Of the model's convex hull, see :func:`.convex_hull.hull_faces`.
    """

    order: np.ndarray
    direction: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    sorted: np.ndarray
    usual: np.ndarray
    spanned: np.ndarray
    upright: np.ndarray
    faces: np.ndarray
    lies: np.ndarray


_known: WeakKeyDictionary[ModelIndex, Regularity] = WeakKeyDictionary()


def regularity(index: ModelIndex) -> Regularity:
    """The regularity of a model; computed once for each index."""
    if index not in _known:
        _known[index] = _find(index)
    return _known[index]


def _planes_of_parallels(rows: np.ndarray) -> list[np.ndarray]:
    """Unit normals of planes along parallel features (e, 9): through the commonest place and the farthest, and across.

    Where all are on one line, through it.
    """
    direction = rows[0, 3:6]
    places = rows[:, :3] - np.outer(rows[:, :3] @ direction, direction)
    gaps = np.linalg.norm(places[:, None] - places, axis=2)
    widest = gaps.max()
    if widest < SAME * max(np.ptp(rows[:, :3], axis=0).max(), widest) or widest == 0.0:
        across = perpendicular(direction)
        return [across, np.cross(direction, across)]
    middle = int(np.argmax((gaps < SAME * widest).sum(axis=1)))
    way = places[int(np.argmax(gaps[middle]))] - places[middle]
    across = way / np.linalg.norm(way)
    return [across, np.cross(direction, across)]


def _find(index: ModelIndex) -> Regularity:
    rows = index.rows
    parallel, perpendicular = PARALLEL_COSINE, PERPENDICULAR_COSINE
    directions = rows[:, 3:6]
    order = np.lexsort((-rows[:, 6], rows[:, 6] > 0.0)).astype(np.int32)
    number = np.full(len(rows), -1, np.int32)
    distinct: list[np.ndarray] = []
    for j in order:
        if number[j] < 0:
            alike = (number < 0) & (np.abs(directions @ directions[j]) > parallel)
            number[alike] = len(distinct)
            distinct.append(directions[j])
    usual = np.argsort(-np.bincount(number), kind='stable')[:MAX_DIRECTIONS]
    normals: list[np.ndarray] = []
    for place, a in enumerate(usual):
        for b in usual[:place]:
            normal = np.cross(distinct[a], distinct[b])
            length = np.linalg.norm(normal)
            if length > perpendicular and not any(abs(normal @ other) > parallel * length for other in normals):
                normals.append(normal / length)
    # The lines of a flat model lie in its plane only: the other planes along them are upright to it.
    for a in usual:
        flat = [normal for normal in normals if abs(normal @ distinct[a]) < perpendicular]
        if len(flat) == 1:
            upright = np.cross(flat[0], distinct[a])
            normals.append(upright / np.linalg.norm(upright))
    # A curve lies in its own plane, whatever else there is; and where all directions are one, the lines along it stand
    # in planes beside each other.
    normals += [directions[j] for j in order[: int((rows[:, 6] == 0.0).sum())]]
    if len(distinct) == 1:
        normals += _planes_of_parallels(rows)
    kept: list[np.ndarray] = []
    for normal in normals:
        if not any(abs(normal @ other) > parallel for other in kept):
            kept.append(normal)
    normals = kept
    stack = np.array(normals).reshape(-1, 3)
    cosine = np.abs(stack @ directions.T)
    lies = (cosine < perpendicular) | ((cosine > parallel) & (rows[:, 6] == 0.0))
    chosen = np.argsort(-lies.sum(axis=1), kind='stable')[:MAX_NORMALS]
    stack, lies = stack[chosen], lies[chosen]
    offsets = np.where(lies, stack @ rows[:, :3].T, np.nan)
    frequent = np.array(distinct)[usual]
    towards = np.abs(stack @ frequent.T)
    spanned = np.where(towards > parallel, 2, np.where(towards < perpendicular, 1, 0)).astype(np.int8)
    towards = np.abs(frequent @ frequent.T)
    both = (
        (towards[:, None, :] < perpendicular) & (towards[None, :, :] < perpendicular) & (towards < parallel)[:, :, None]
    )
    upright = np.where(both.any(axis=2), both.argmax(axis=2), -1).astype(np.int32)
    return Regularity(
        order,
        number,
        stack,
        offsets,
        np.argsort(offsets, axis=1, kind='stable').astype(np.int32),
        usual.astype(np.int32),
        spanned,
        upright,
        *hull_faces(index),
    )
