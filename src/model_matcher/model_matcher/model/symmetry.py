"""A model's own symmetry: the proper rigid motions that lay its features on themselves.

One pair of non-parallel features fixes a motion, so every pair that looks like it gives a candidate, and a candidate is
a symmetry when it lays every feature on one of the same kind and size. Edges and normals count without direction.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from msgs_py import Pose

from ..geometry.settings import PARALLEL_SINE
from .index import ModelIndex
from .settings import SAME, SAME_POSE_DEG, SYMMETRY_TOLERANCE

_known: WeakKeyDictionary[ModelIndex, tuple[Pose, ...]] = WeakKeyDictionary()


def symmetries(index: ModelIndex) -> tuple[Pose, ...]:
    """The proper rigid motions that lay a model on itself; computed once for each index.

    Parameters
    ----------
    index : ModelIndex
        The model.

    Returns
    -------
    tuple of Pose
        model_T_model, without the identity. Empty for a model without symmetry, and for one whose features are all
        parallel: their group is not finite.
    """
    if index not in _known:
        _known[index] = _find(index)
    return _known[index]


def symmetric_poses(index: ModelIndex, pose: Pose, known: tuple[Pose, ...] = ()) -> tuple[Pose, ...]:
    """The poses that a model's symmetry makes equal to one.

    Parameters
    ----------
    index : ModelIndex
        The model.
    pose : Pose
        camera_T_model.
    known : tuple of Pose
        Equal poses that are known already; they come first.

    Returns
    -------
    tuple of Pose
        Each once, without ``pose`` itself.
    """
    poses = list(known)
    for motion in symmetries(index):
        other = pose.compose(motion)
        if not any(_alike(index, other, one) for one in (pose, *poses)):
            poses.append(other)
    return tuple(poses)


def _alike(index: ModelIndex, a: Pose, b: Pose) -> bool:
    """Within 1 degree and 1 % of the model's size."""
    return (
        a.error_to(b).rotation_deg < SAME_POSE_DEG
        and float(np.linalg.norm(a.apply(index.middle) - b.apply(index.middle))) < SAME * index.size
    )


def _find(index: ModelIndex) -> tuple[Pose, ...]:
    rows = index.rows
    mids, directions = rows[:, 0:3], rows[:, 3:6]
    tolerance = SYMMETRY_TOLERANCE * index.size
    alike = _lookalikes(index, tolerance)
    base = _base_pair(directions, alike)
    if base is None:
        return ()
    i, j = base
    c = float(directions[i] @ directions[j])
    gap = np.linalg.norm(mids[j] - mids[i])
    source = _frame(directions[i], directions[j])
    found: list[Pose] = []
    for k in np.flatnonzero(alike[i]):
        partners = alike[j] & (np.abs(np.linalg.norm(mids - mids[k], axis=1) - gap) < 2.0 * tolerance)
        partners &= np.abs(np.abs(directions @ directions[k]) - abs(c)) < SAME
        for m in np.flatnonzero(partners):
            for first in (1.0, -1.0):
                for second in (1.0, -1.0):
                    u, v = first * directions[k], second * directions[m]
                    if abs(u @ v - c) > SAME:
                        continue
                    rotation = _frame(u, v).T @ source
                    shift = 0.5 * (mids[k] + mids[m] - rotation @ (mids[i] + mids[j]))
                    motion = Pose(rotation, shift)
                    if (
                        not _alike(index, motion, Pose.identity())
                        and _maps(motion, rows, alike, tolerance)
                        and not any(_alike(index, motion, one) for one in found)
                    ):
                        found.append(motion)
    return tuple(found)


def _lookalikes(index: ModelIndex, tolerance: float) -> np.ndarray:
    """(e, e) bool: features of the same kind and size."""
    sizes = np.column_stack([index.rows[:, 6], np.nan_to_num(index.rows[:, 7:9])])
    same = (np.abs(sizes[:, None] - sizes) < tolerance).all(axis=2)
    alike: np.ndarray = same & (index.kind[:, None] == index.kind)
    return alike


def _base_pair(directions: np.ndarray, alike: np.ndarray) -> tuple[int, int] | None:
    """Two features far from parallel with as few lookalikes as possible; None when all are parallel."""
    count = alike.sum(axis=1)
    product = (count[:, None] * count).astype(float)
    # Nearer to parallel than that, two directions do not fix a motion well.
    product[np.abs(directions @ directions.T) > np.cos(np.arcsin(PARALLEL_SINE))] = np.inf
    best = int(np.argmin(product))
    if not np.isfinite(product.flat[best]):
        return None
    return best // len(count), best % len(count)


def _frame(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(3, 3) orthonormal, rows: bisector, difference, common normal; the errors of both directions count alike."""
    first = (u + v) / np.linalg.norm(u + v)
    third = np.cross(u, v)
    third = third / np.linalg.norm(third)
    return np.stack([first, np.cross(third, first), third])


def _maps(motion: Pose, rows: np.ndarray, alike: np.ndarray, tolerance: float) -> bool:
    """Whether every feature comes to lie on a lookalike."""
    mids = motion.apply(rows[:, 0:3])
    directions = motion.rotate(rows[:, 3:6])
    near = np.linalg.norm(mids[:, None] - rows[:, 0:3], axis=2) < tolerance
    along = np.linalg.norm(np.cross(directions[:, None], rows[:, 3:6]), axis=2)
    # An edge's ends must come to lie as near as its middle; a curve's normal has no length, its radius is its lever.
    lever = np.maximum(rows[:, 6], np.nan_to_num(rows[:, 7]))[:, None]
    return bool((near & alike & (along * lever < tolerance)).any(axis=1).all())
