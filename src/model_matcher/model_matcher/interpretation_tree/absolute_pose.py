"""Absolute poses of feasible interpretations by least squares, and a test of every feature (thesis 5.6, 5.9, 6.7).

Rotation by quaternions, for all interpretations at once; translation by point-to-line least squares. The thesis'
translation is singular when the foot vectors of the lines are coplanar; this one only when all edges are parallel, and
then the shift along them stays free and is reported.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Pose
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, IntArray
from msgs_py.numeric.vectors import perpendicular

from ..geometry.settings import NOT_ZERO, ROUNDING
from ..model.index import feature_rows, model_size
from ..model.settings import EXACT


@dataclass(eq=False)
class Validation:
    """Poses fitted to m interpretations of n data features, and how well each feature agrees with them.

    Attributes
    ----------
    poses : list of Pose
        camera_T_model of each interpretation.
    deviations : (m, n) float64
        The larger distance of a feature's end points from its model feature, metres in the model frame; NaN where
        unmatched.
    passed : (m, n) bool
        The deviation is within its limit; True where unmatched.
    signs : (m, n) int8
        Direction signs; those that were 0 are read off the first fit.
    free_shift : (m, 3) float64
        Unit direction of a translation that the data leaves open, camera frame; NaN when there is none.
    free_turn : (m, 3) float64
        Unit axis of a rotation that the data leaves open, camera frame; NaN when there is none.
    stats : dict
        What the array machine spent on it, by the names of the search's statistics; empty when it had no part in it.
    """

    poses: list[Pose]
    deviations: FloatArray
    passed: BoolArray
    signs: Int8Array
    free_shift: FloatArray
    free_turn: FloatArray
    stats: dict[str, Any] = field(default_factory=dict)

    @property
    def valid(self) -> BoolArray:
        """(m,) bool: every matched feature passed."""
        return np.asarray(self.passed.all(axis=1))


def best_rotations(model: FloatArray, data: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations R that minimise the sum of w |d - R v|^2 over pairs of model directions v and data directions d.

    Parameters
    ----------
    model, data : (m, k, 3) float64
        Unit vectors of m fits of k pairs each.
    weights : (m, k) float64
        At least 0.

    Returns
    -------
    rotation : (m, 3, 3) float64
    free : (m, 3) float64
        The axis about which the rotation is undetermined because all directions are parallel, else NaN.

    References
    ----------
    O. D. Faugeras and M. Hebert (1986), The representation, recognition, and locating of 3-D objects; B. K. P. Horn
    (1987), Closed-form solution of absolute orientation using unit quaternions.

    Examples
    --------
    >>> axes = np.eye(3)[None]
    >>> rotation, _ = best_rotations(axes, axes[:, [1, 2, 0]], np.ones((1, 3)))
    >>> (rotation[0].round(6) + 0.0).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    # The quadratic form of sum w |d - R v|^2 in the quaternion (w, x, y, z): Horn's 4 x 4 matrix.
    s = np.einsum('mk,mki,mkj->mij', weights, model, data)
    m = len(s)
    form = np.empty((m, 4, 4))
    form[:, 0, 0] = s[:, 0, 0] + s[:, 1, 1] + s[:, 2, 2]
    form[:, 0, 1] = s[:, 1, 2] - s[:, 2, 1]
    form[:, 0, 2] = s[:, 2, 0] - s[:, 0, 2]
    form[:, 0, 3] = s[:, 0, 1] - s[:, 1, 0]
    form[:, 1, 1] = s[:, 0, 0] - s[:, 1, 1] - s[:, 2, 2]
    form[:, 1, 2] = s[:, 0, 1] + s[:, 1, 0]
    form[:, 1, 3] = s[:, 2, 0] + s[:, 0, 2]
    form[:, 2, 2] = -s[:, 0, 0] + s[:, 1, 1] - s[:, 2, 2]
    form[:, 2, 3] = s[:, 1, 2] + s[:, 2, 1]
    form[:, 3, 3] = -s[:, 0, 0] - s[:, 1, 1] + s[:, 2, 2]
    values, vectors = np.linalg.eigh(form, UPLO='U')
    q = vectors[:, :, 3]
    w, x, y, z = q.T
    rotation = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=-1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=-1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=1,
    )
    total = np.maximum(weights.sum(axis=1), NOT_ZERO)
    spread = np.einsum('mk,mki,mkj->mij', weights, data, data) / total[:, None, None]
    sizes, axes = np.linalg.eigh(spread)
    free = np.where((sizes[:, 1] < ROUNDING)[:, None], axes[:, :, 2], np.nan)
    # Of parallel directions, any turn about them does; the smallest turn is taken.
    for k in np.flatnonzero(sizes[:, 1] < ROUNDING):
        used = weights[k] > 0.0
        if used.any():
            sides = np.sign(model[k, used] @ model[k, used][0])[:, None]
            rotation[k] = _smallest_turn(
                (weights[k, used, None] * model[k, used] * sides).sum(axis=0),
                (weights[k, used, None] * data[k, used] * sides).sum(axis=0),
            )
    return rotation, free


def _smallest_turn(one: FloatArray, other: FloatArray) -> FloatArray:
    """(3, 3): the rotation about their common normal that takes one direction to another."""
    u = one / max(float(np.linalg.norm(one)), NOT_ZERO)
    v = other / max(float(np.linalg.norm(other)), NOT_ZERO)
    axis = np.cross(u, v)
    c = float(u @ v)
    if 1.0 + c < NOT_ZERO:
        across = perpendicular(u)
        half_turn: FloatArray = 2.0 * np.outer(across, across) - np.eye(3)
        return half_turn
    skew = _skew(axis)
    turn: FloatArray = np.eye(3) + skew + skew @ skew / (1.0 + c)
    return turn


def _skew(axis: FloatArray) -> FloatArray:
    """(3, 3): the matrix whose product with a vector is the vector product of the axis and it."""
    return np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])


class PointsOnLines(NamedTuple):
    """Pairs of data points and model lines, for m fits of k pairs each.

    Attributes
    ----------
    model_points, model_directions : (m, k, 3)
        A point of each model line and its unit direction, model frame, metres.
    data_points : (m, k, 3)
        Camera frame, metres.
    weights : (m, k)
    is_point : (m, k) bool
        The model feature is a point (a curve's centre), not a line.
    """

    model_points: FloatArray
    model_directions: FloatArray
    data_points: FloatArray
    weights: FloatArray
    is_point: BoolArray


def best_translations(
    rotation: FloatArray, pairs: PointsOnLines, scale_free: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Translations t (and scales s) that bring data points x nearest to their model lines, under known rotations R.

    They minimise the sum of w |P (x - s R p - t)|^2, p a point of the model line and P the projection across the line
    (the identity for a point).

    Parameters
    ----------
    rotation : (m, 3, 3) float64
    pairs : PointsOnLines
    scale_free : bool
        Estimate the scale too; it is 1 otherwise.

    Returns
    -------
    translation : (m, 3) float64
    scale : (m,) float64
    free : (m, 3) float64
        The direction along which the shift is free, else NaN.
    """
    data_points, data_weights = pairs.data_points, pairs.weights
    u = np.einsum('mij,mkj->mki', rotation, pairs.model_directions)
    placed = np.einsum('mij,mkj->mki', rotation, pairs.model_points)
    projection = np.eye(3) - np.where(pairs.is_point[..., None, None], 0.0, 1.0) * u[..., :, None] * u[..., None, :]
    projection *= data_weights[..., None, None]
    m = len(rotation)
    if not scale_free:
        left = projection.sum(axis=1)
        right = np.einsum('mkij,mkj->mi', projection, data_points - placed)
        values, vectors = np.linalg.eigh(left)
        usable = values > ROUNDING * np.maximum(values[:, 2:], NOT_ZERO)
        inverse = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
        # Along a free direction the weighted middles of data and model are brought together.
        weight = np.maximum(data_weights.sum(axis=1), NOT_ZERO)[:, None]
        middle = (data_weights[..., None] * (data_points - placed)).sum(axis=1) / weight
        open_part = np.einsum('mij,mj->mi', vectors * ~usable[:, None, :], np.einsum('mji,mj->mi', vectors, middle))
        translation = (
            np.einsum('mij,mj->mi', vectors * inverse[:, None, :], np.einsum('mji,mj->mi', vectors, right)) + open_part
        )
        free = np.where(usable[:, 0][:, None], np.nan, vectors[:, :, 0])
        return translation, np.ones(m), free
    return _best_similarities(projection, placed, data_points)


def _best_similarities(
    projection: FloatArray, placed: FloatArray, data_points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As best_translations, with the scale: projection (m, k, 3, 3) times weight, rotated model points (m, k, 3)."""
    m = len(placed)
    left4 = np.zeros((m, 4, 4))
    right4 = np.zeros((m, 4))
    along = np.einsum('mkij,mkj->mki', projection, placed)
    left4[:, :3, :3] = projection.sum(axis=1)
    left4[:, :3, 3] = left4[:, 3, :3] = along.sum(axis=1)
    left4[:, 3, 3] = np.einsum('mki,mki->m', along, placed)
    right4[:, :3] = np.einsum('mkij,mkj->mi', projection, data_points)
    right4[:, 3] = np.einsum('mki,mki->m', along, data_points)
    solution = np.einsum('mij,mj->mi', np.linalg.pinv(left4, rcond=ROUNDING, hermitian=True), right4)
    scale = np.where(solution[:, 3] > 0.0, solution[:, 3], 1.0)
    values, vectors = np.linalg.eigh(left4[:, :3, :3])
    free = np.where((values[:, 0] > ROUNDING * values[:, 2])[:, None], np.nan, vectors[:, :, 0])
    return solution[:, :3], scale, free


def validate(
    model: FeatureSet,
    data: FeatureSet,
    assignments: IntArray,
    signs: Int8Array,
    fracdev: float,
    curvedev: float = 0.1,
    size: float | None = None,
    scale_free: bool = False,
) -> Validation:
    """Fit a pose to each interpretation and test every matched feature.

    Features without a sign take no part in the first rotation; their signs are read off it, and the fit is repeated.

    Parameters
    ----------
    model, data : FeatureSet
        In the model frame and in the camera frame, metres.
    assignments : (m, n) array_like of int
        Model feature of each data feature, or BIN.
    signs : (m, n) array_like of int8
        Direction signs, 0 unknown.
    fracdev : float
        Largest deviation of an end point, as a fraction of ``size``.
    curvedev : float
        Largest deviation of a curve's radii, as a fraction of the largest model radius.
    size : float, optional
        Size of the model, metres; the largest distance between two of its points when not given.
    scale_free : bool
        Estimate a scale for each interpretation too.

    Returns
    -------
    Validation

    References
    ----------
    Thesis 5.6, 6.7.
    """
    assignments = np.atleast_2d(np.asarray(assignments)).astype(np.int64)
    signs = np.array(np.atleast_2d(signs), dtype=np.int8)
    size = model_size(model) if size is None else size
    m, n = assignments.shape
    rows_m, rows_d = feature_rows(model), feature_rows(data)
    matched = assignments != BIN
    chosen = rows_m[np.where(matched, assignments, 0)]
    curves = data.kind == FeatureKind.CURVE
    # The direction of a longer edge is more certain.
    length = np.where(curves, size, 2.0 * rows_d[:, 6])
    rotation, free_turn, signs = _rotations(chosen, rows_d, matched, signs, length, size)
    curve = curves[None] & matched
    ends = np.stack([data.start, data.end])
    ends[:, curves] = rows_d[curves, :3]
    points = np.concatenate([np.broadcast_to(ends[0], (m, n, 3)), np.broadcast_to(ends[1], (m, n, 3))], axis=1)
    twice = np.concatenate([chosen, chosen], axis=1)
    pairs = PointsOnLines(
        twice[..., :3],
        twice[..., 3:6],
        points,
        np.concatenate([matched, matched], axis=1).astype(float),
        np.concatenate([curve, curve], axis=1),
    )
    translation, scale, free_shift = best_translations(rotation, pairs, scale_free)
    back = np.einsum('mji,mkj->mki', rotation, points - translation[:, None]) / scale[:, None, None]
    gap = back - twice[..., :3]
    along = np.einsum('mki,mki->mk', gap, twice[..., 3:6])
    nearest = np.clip(along, -twice[..., 6], twice[..., 6])
    distance = np.linalg.norm(gap - nearest[..., None] * twice[..., 3:6], axis=2)
    deviations = np.where(matched, np.maximum(distance[:, :n], distance[:, n:]), np.nan)
    with np.errstate(invalid='ignore'):
        passed = ~matched | (deviations <= fracdev * size)
        if curve.any():
            limit = curvedev * np.nanmax(model.radii) if np.isfinite(model.radii).any() else 0.0
            difference = np.abs(data.radii[None] / scale[:, None, None] - chosen[..., 7:9]).max(axis=2)
            passed &= ~curve | (difference <= limit)
    poses = [Pose(proper(rotation[k]), translation[k], float(scale[k])) for k in range(m)]
    return Validation(poses, deviations, passed, signs, free_shift, free_turn)


def _rotations(
    chosen: FloatArray, rows_d: FloatArray, matched: BoolArray, signs: Int8Array, length: FloatArray, size: float
) -> tuple[FloatArray, FloatArray, Int8Array]:
    """Rotations (m, 3, 3), free axes (m, 3) and complete signs (m, n).

    chosen : (m, n, 9) rows of the model features that the data rows (n, 9) are on; length : (n,) metres, weights
    """
    m, n = matched.shape
    directions = np.broadcast_to(rows_d[:, 3:6], (m, n, 3))
    signed = matched & (signs != 0)
    # Without any sign, that of the longest feature may be chosen: the mirrored pose belongs to another interpretation.
    for k in np.flatnonzero(~signed.any(axis=1) & matched.any(axis=1)):
        first = int(np.argmax(np.where(matched[k], length, -1.0)))
        signs[k, first] = 1
        signed[k, first] = True
    while True:
        rotation, free_turn = best_rotations(
            chosen[..., 3:6], directions * signs[..., None], np.where(signed, length, 0.0)
        )
        for k in np.flatnonzero(np.isfinite(free_turn[:, 0]) & (matched.sum(axis=1) > 1)):
            # Parallel directions leave the turn about them to the places of the lines.
            used = matched[k]
            turn = _turn_about(free_turn[k], chosen[k, used, :3] @ rotation[k].T, rows_d[used, :3], size)
            if turn is not None:
                rotation[k] = turn @ rotation[k]
                free_turn[k] = np.nan
        if signed[matched].all():
            return rotation, free_turn, signs
        turned = np.einsum('mij,mkj->mki', rotation, chosen[..., 3:6])
        guess = np.where(np.einsum('mki,mki->mk', turned, directions) >= 0.0, 1, -1).astype(np.int8)
        signs = np.where(matched & (signs == 0), guess, signs).astype(np.int8)
        signed = matched


def _turn_about(axis: FloatArray, points: FloatArray, targets: FloatArray, size: float) -> FloatArray | None:
    """(3, 3): the rotation about an axis that brings points (k, 3) nearest to their targets across it.

    None when every rotation does, because the points lie on one line along the axis.
    """
    across = np.eye(3) - np.outer(axis, axis)
    p, q = ((x - x.mean(axis=0)) @ across for x in (points, targets))
    if max(float(np.abs(p).max()), float(np.abs(q).max())) < EXACT * size:
        return None
    angle = np.arctan2(float((np.cross(p, q) @ axis).sum()), float((p * q).sum()))
    skew = _skew(axis)
    turn: FloatArray = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return turn


def proper(rotation: FloatArray) -> FloatArray:
    """(3, 3): the nearest rotation to a matrix that rounding has left no rotation."""
    u, _, v = np.linalg.svd(rotation)
    nearest: FloatArray = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return nearest
