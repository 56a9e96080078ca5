"""A model's own symmetry: the proper rigid motions that lay its features on themselves.

One pair of features that are not on one line fixes a motion, so every pair that looks like it gives a candidate, and a
candidate is a symmetry when it lays every feature on one of the same kind and size. Edges and normals count without
direction. Where all features are about one axis, so is the solid, and any turn about it is one more symmetry.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from msgs_py import FeatureKind, Pose
from msgs_py.numeric.vectors import perpendicular

from ..geometry.features import PairTable
from ..geometry.pose_rows import as_motion, as_pose
from ..geometry.self_motions import Lookalikes, lays_on_lookalikes, self_motions
from ..geometry.settings import PARALLEL_SINE
from .index import ModelIndex
from .settings import EXACT, SAME, SYMMETRY_TOLERANCE


class Axis(NamedTuple):
    """A line that features are about: point (3,) metres, and unit direction (3,)."""

    point: np.ndarray
    direction: np.ndarray

    def distances(self, points: np.ndarray) -> np.ndarray:
        """How far points (n, 3) are from it, (n,) metres."""
        return self.across(points - self.point)

    def across(self, vectors: np.ndarray) -> np.ndarray:
        """Lengths of vectors (n, 3) across it, (n,)."""
        across: np.ndarray = np.linalg.norm(vectors - np.outer(vectors @ self.direction, self.direction), axis=1)
        return across

    def about(self, rotation: np.ndarray) -> Pose:
        """The motion that turns by a rotation (3, 3) and leaves the point where it is."""
        return Pose(rotation, self.point - rotation @ self.point)

    def turn(self, angle: float) -> Pose:
        """The motion that turns about the line by an angle, radians.

        Examples
        --------
        >>> axis = Axis(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
        >>> axis.turn(np.pi).apply([[2.0, 0.0, 5.0]]).round(9).tolist()
        [[0.0, 0.0, 5.0]]
        """
        return self.about(Pose.from_rotation_vector(angle * self.direction).rotation)


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
        model_T_model, without the identity. Empty for a model without symmetry. Of a solid of revolution, see
        :func:`common_axis`, those that are equal but for a turn about its axis count once.
    """
    if index not in _known:
        _known[index] = _find(index)
    return _known[index]


_distinct: WeakKeyDictionary[ModelIndex, PairTable] = WeakKeyDictionary()


def distinct_pairs(index: ModelIndex) -> PairTable:
    """The pairs of a model's table that no symmetry makes equal: one of each orbit; computed once for each index.

    Data that lies on one of a cube's corners lies on all 24 of its orders: the poses are equal, and would leave no room
    for any other.

    Parameters
    ----------
    index : ModelIndex
        The model.

    Returns
    -------
    PairTable
    """
    if index not in _distinct:
        table = index.pair_table
        first = number = table.members.astype(np.int64) @ [len(index), 1]
        for motion in symmetries(index):
            first = np.minimum(first, _where(motion, index)[table.members] @ [len(index), 1])
        kept = first == number
        starts = np.concatenate([[0], np.cumsum(kept)])[table.starts].astype(np.int32)
        _distinct[index] = PairTable(table.reach, starts, table.members[kept], table.values[kept])
    return _distinct[index]


def _where(motion: Pose, index: ModelIndex) -> np.ndarray:
    """(e,) int: the feature on which a symmetry lays each."""

    def told(middle: np.ndarray, direction: np.ndarray) -> np.ndarray:
        # Metres; a direction without its sign by its square.
        sizes = index.rows[:, 6:7], np.nan_to_num(index.rows[:, 7:9]), index.size * index.kind[:, None]
        square = 0.5 * index.size * (direction[:, :, None] * direction[:, None]).reshape(-1, 9)
        return np.column_stack([middle, square, *sizes])

    middle, direction = index.rows[:, :3], index.rows[:, 3:6]
    tree = cKDTree(told(middle, direction))
    at: np.ndarray = tree.query(told(motion.apply(middle), motion.rotate(direction)))[1]
    return at


def about_axis(rows: np.ndarray, axis: Axis, size: float) -> np.ndarray:
    """Which features, rows (n, 9) of a model of that size, lie along an axis, or are circles about it, (n,) bool."""
    lever = np.maximum(rows[:, 6], np.nan_to_num(rows[:, 7]))
    about: np.ndarray = axis.distances(rows[:, :3]) + axis.across(rows[:, 3:6]) * lever <= EXACT * size
    return about


def common_axis(rows: np.ndarray, size: float) -> Axis | None:
    """The one line that features lie along, or have their centres on and their planes upright to.

    Parameters
    ----------
    rows : (n, 9) float64
        Features of a model, see geometry/features.py.
    size : float
        Metres, of the model.

    Returns
    -------
    Axis or None
        Model frame; with the direction of the first feature. None also when there are no features.
    """
    if len(rows) == 0:
        return None
    point, direction = rows[0, :3], rows[0, 3:6]
    if not about_axis(rows, Axis(point, direction), size).all():
        return None
    along = (rows[:, :3] - point) @ direction
    # The middle keeps what a turn about the line does to points of it small.
    return Axis(point + 0.5 * (along.min() + along.max()) * direction, direction)


_axes: WeakKeyDictionary[ModelIndex, Axis | None] = WeakKeyDictionary()


def axis_of_revolution(index: ModelIndex) -> Axis | None:
    """The axis about which a model is the same all round, None when there is none; computed once for each index."""
    if index not in _axes:
        _axes[index] = _find_axis(index)
    return _axes[index]


def _find_axis(index: ModelIndex) -> Axis | None:
    # An ellipse is not the same all round, though its centre and normal are all that is compared.
    radii = index.rows[index.kind == FeatureKind.CURVE, 7:9]
    if (radii[:, 0] - radii[:, 1] > SYMMETRY_TOLERANCE * index.size).any():
        return None
    return common_axis(index.rows, index.size)


def equal_but_for_turn(a: Pose, b: Pose, axis: Axis, size: float) -> bool:
    """Whether two poses differ by nothing but a turn about an axis of the model; to 1 % of its size."""
    way = b.rotate(axis.direction[None])[0] - a.rotate(axis.direction[None])[0]
    gap = a.apply(axis.point[None]) - b.apply(axis.point[None])
    return bool(np.hypot(0.5 * np.linalg.norm(way), np.linalg.norm(gap) / size) < SAME)


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
    axis = axis_of_revolution(index)
    for motion in symmetries(index):
        other = pose.compose(motion)
        if not any(
            near(index, other, one) if axis is None else equal_but_for_turn(other, one, axis, index.size)
            for one in (pose, *poses)
        ):
            poses.append(other)
    return tuple(poses)


def near(index: ModelIndex, a: Pose, b: Pose) -> bool:
    """Whether no end of the model is moved by more than 1 % of its size."""
    gap = a.apply(index.middle) - b.apply(index.middle)
    return bool(moved(np.sum(a.rotation * b.rotation), float(np.linalg.norm(gap)), index.size) < SAME)


def all_near(index: ModelIndex, motions: np.ndarray) -> np.ndarray:
    """Which of some poses (c, 12) are near which, (c, c) bool; see :func:`near`."""
    middles = motions[:, :9].reshape(-1, 3, 3) @ index.middle + motions[:, 9:]
    gaps = np.linalg.norm(middles[:, None] - middles, axis=2)
    together: np.ndarray = moved(motions[:, :9] @ motions[:, :9].T, gaps, index.size) < SAME
    return together


def moved(trace: np.ndarray | float, gap: np.ndarray | float, size: float) -> np.ndarray:
    """In model sizes, how far poses move the ends of a model, half its size from the middle.

    trace : of the turn between them, 3 less the squared chord of its angle; gap : metres, of its middle
    """
    return np.sqrt(0.25 * np.maximum(3.0 - trace, 0.0) + np.square(gap / size))


def _find(index: ModelIndex) -> tuple[Pose, ...]:
    model = Lookalikes(
        index.rows, _lookalikes(index), SYMMETRY_TOLERANCE * index.size, SAME, index.middle, float(index.size)
    )
    axis = axis_of_revolution(index)
    if axis is not None:
        return _end_for_end(axis, model)
    base = _base_pair(model)
    if base is None:
        return ()
    return tuple(as_pose(motion) for motion in self_motions(*base, model)[1:])


def _end_for_end(axis: Axis, model: Lookalikes) -> tuple[Pose, ...]:
    """The half turn that swaps the two ends of a solid of revolution, when it is a symmetry."""
    across = perpendicular(axis.direction[None])[0]
    motion = axis.about(2.0 * np.outer(across, across) - np.eye(3))
    return (motion,) if lays_on_lookalikes(as_motion(motion), model) else ()


def _lookalikes(index: ModelIndex) -> np.ndarray:
    """(e, e) bool: features of the same kind and size."""
    sizes = np.column_stack([index.rows[:, 6], np.nan_to_num(index.rows[:, 7:9])])
    same = (np.abs(sizes[:, None] - sizes) < SYMMETRY_TOLERANCE * index.size).all(axis=2)
    alike: np.ndarray = same & (index.kind[:, None] == index.kind)
    return alike


def _base_pair(model: Lookalikes) -> tuple[int, int] | None:
    """Two features far from parallel, or a way apart, with as few lookalikes as possible; None when all are on a line.

    Parallel ones are taken only where there are no others.
    """
    rows, count = model.rows, model.alike.sum(axis=1)
    product = (count[:, None] * count).astype(float)
    directions = rows[:, 3:6]
    parallel = np.abs(directions @ directions.T) > np.cos(np.arcsin(PARALLEL_SINE))
    if parallel.all():
        gaps = rows[None, :, :3] - rows[:, None, :3]
        along = np.einsum('ijk,ik->ij', gaps, directions)
        apart = np.sqrt(np.maximum((gaps**2).sum(axis=2) - along**2, 0.0))
        # The farther apart, the better they tell a turn.
        product[apart < max(model.tolerance, 0.5 * apart.max())] = np.inf
    else:
        product[parallel] = np.inf
    best = int(np.argmin(product))
    if not np.isfinite(product.flat[best]):
        return None
    return best // len(count), best % len(count)
