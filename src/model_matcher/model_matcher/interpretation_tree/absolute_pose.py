"""Validation of feasible interpretations (thesis 5.6, 5.9, 6.7): a pose by least squares, then a test of every feature.

Rotation by quaternions, for all interpretations at once; translation by point-to-line least squares. The thesis'
translation is singular when the foot vectors of the lines are coplanar; this one only when all edges are parallel, and
then the shift along them stays free and is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import BIN, FeatureKind, FeatureSet, Pose
from msgs_py.numeric.vectors import perpendicular

# Relative size below which a singular value counts as zero: a free direction.
FREE = 1e-9


@dataclass(eq=False)
class Validation:
    """What the fit of m interpretations of n data features says.

    poses : m poses, camera_T_model; deviations : (m, n) metres, the larger distance of a feature's end points from its
    model feature, measured in the model frame, NaN where unmatched; passed : (m, n) bool (True where unmatched)
    signs : (m, n) int8, with unsigned features' signs pulled in after the first fit
    free_shift : (m, 3) unit direction of a translation that the data leaves open, NaN when there is none
    free_turn : (m, 3) unit axis of a rotation that it leaves open, NaN when there is none
    """

    poses: list[Pose]
    deviations: np.ndarray
    passed: np.ndarray
    signs: np.ndarray
    free_shift: np.ndarray
    free_turn: np.ndarray

    @property
    def valid(self) -> np.ndarray:
        """(m,) bool: every matched feature passed."""
        return np.asarray(self.passed.all(axis=1))


def best_rotations(model: np.ndarray, data: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations that turn model directions into data directions best (Faugeras and Hebert's quaternions, batched).

    model, data : (m, k, 3) unit vectors; weights : (m, k) >= 0
    Returns (m, 3, 3) and the axis (m, 3) about which the rotation is undetermined (all directions parallel), else NaN.
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
    total = np.maximum(weights.sum(axis=1), 1e-300)
    spread = np.einsum('mk,mki,mkj->mij', weights, data, data) / total[:, None, None]
    sizes, axes = np.linalg.eigh(spread)
    free = np.where((sizes[:, 1] < FREE)[:, None], axes[:, :, 2], np.nan)
    # With parallel directions only, two eigenvalues coincide; the smallest turn is as good as any.
    for k in np.flatnonzero(sizes[:, 1] < FREE):
        used = weights[k] > 0.0
        if used.any():
            rotation[k] = _smallest_turn(
                (weights[k, used, None] * model[k, used] * np.sign(model[k, used] @ model[k, used][0])[:, None]).sum(
                    axis=0
                ),
                (weights[k, used, None] * data[k, used] * np.sign(model[k, used] @ model[k, used][0])[:, None]).sum(
                    axis=0
                ),
            )
    return rotation, free


def _smallest_turn(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(3, 3): the rotation about their common normal that takes one direction to another."""
    u = one / max(float(np.linalg.norm(one)), 1e-300)
    v = other / max(float(np.linalg.norm(other)), 1e-300)
    axis = np.cross(u, v)
    c = float(u @ v)
    if c < -1.0 + 1e-12:
        across = perpendicular(u)
        return 2.0 * np.outer(across, across) - np.eye(3)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + c)


def best_translations(
    rotation: np.ndarray,
    model_points: np.ndarray,
    model_directions: np.ndarray,
    data_points: np.ndarray,
    data_weights: np.ndarray,
    is_point: np.ndarray,
    scale_free: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translations (and scales) that bring data points nearest to their model lines.

    rotation : (m, 3, 3); model_points, model_directions : (m, k, 3); data_points : (m, k, 3); data_weights : (m, k)
    is_point : (m, k) bool, the model feature is a point (a curve's centre), not a line

    Minimises sum w |P (x - s R p - t)|^2, with P the projection across the line (or the identity for a point).
    Returns translations (m, 3), scales (m,), and the direction (m, 3) along which the shift is free, else NaN.
    """
    u = np.einsum('mij,mkj->mki', rotation, model_directions)
    placed = np.einsum('mij,mkj->mki', rotation, model_points)
    projection = np.eye(3) - np.where(is_point[..., None, None], 0.0, 1.0) * u[..., :, None] * u[..., None, :]
    projection *= data_weights[..., None, None]
    m = len(rotation)
    if not scale_free:
        left = projection.sum(axis=1)
        right = np.einsum('mkij,mkj->mi', projection, data_points - placed)
        values, vectors = np.linalg.eigh(left)
        usable = values > FREE * np.maximum(values[:, 2:], 1e-300)
        inverse = np.where(usable, 1.0 / np.where(usable, values, 1.0), 0.0)
        # A free shift is resolved by bringing the middles together along it, which is at least near.
        weight = np.maximum(data_weights.sum(axis=1), 1e-300)[:, None]
        middle = (data_weights[..., None] * (data_points - placed)).sum(axis=1) / weight
        open_part = np.einsum('mij,mj->mi', vectors * ~usable[:, None, :], np.einsum('mji,mj->mi', vectors, middle))
        translation = (
            np.einsum('mij,mj->mi', vectors * inverse[:, None, :], np.einsum('mji,mj->mi', vectors, right)) + open_part
        )
        free = np.where(usable[:, 0][:, None], np.nan, vectors[:, :, 0])
        return translation, np.ones(m), free
    left4 = np.zeros((m, 4, 4))
    right4 = np.zeros((m, 4))
    along = np.einsum('mkij,mkj->mki', projection, placed)
    left4[:, :3, :3] = projection.sum(axis=1)
    left4[:, :3, 3] = left4[:, 3, :3] = along.sum(axis=1)
    left4[:, 3, 3] = np.einsum('mki,mki->m', along, placed)
    right4[:, :3] = np.einsum('mkij,mkj->mi', projection, data_points)
    right4[:, 3] = np.einsum('mki,mki->m', along, data_points)
    solution = np.einsum('mij,mj->mi', np.linalg.pinv(left4, rcond=1e-12, hermitian=True), right4)
    scale = np.where(solution[:, 3] > 0.0, solution[:, 3], 1.0)
    values, vectors = np.linalg.eigh(left4[:, :3, :3])
    free = np.where((values[:, 0] > FREE * values[:, 2])[:, None], np.nan, vectors[:, :, 0])
    return solution[:, :3], scale, free


def validate(
    model: FeatureSet,
    data: FeatureSet,
    assignments: np.ndarray,
    signs: np.ndarray,
    fracdev: float,
    curvedev: float = 0.1,
    size: float | None = None,
    scale_free: bool = False,
) -> Validation:
    """Fit a pose to each interpretation and test every matched feature (thesis 5.6, 6.7).

    assignments : (m, n) int, model feature or BIN; signs : (m, n) int8, 0 unknown
    fracdev x size (metres; the largest distance between two model points when not given) is the largest deviation of an
    end point, curvedev x the largest model radius that of a curve's radii.

    Unsigned features do not take part in the first rotation; their signs are read off it, and the fit is repeated.
    """
    from ..model.index import feature_rows, model_size

    assignments = np.atleast_2d(np.asarray(assignments)).astype(np.int64)
    signs = np.array(np.atleast_2d(signs), dtype=np.int8)
    size = model_size(model) if size is None else size
    m, n = assignments.shape
    rows_m, rows_d = feature_rows(model), feature_rows(data)
    matched = assignments != BIN
    chosen = rows_m[np.where(matched, assignments, 0)]
    curve = (data.kind == FeatureKind.CURVE)[None] & matched
    # A longer edge has the better direction.
    length = np.where(data.kind == FeatureKind.CURVE, size, 2.0 * rows_d[:, 6])
    directions = np.broadcast_to(rows_d[:, 3:6], (m, n, 3))
    for attempt in range(2):
        signed = matched & (signs != 0)
        if attempt == 0:
            # Without any sign, the first feature's may be chosen: it costs nothing, the mirror pose is found by others.
            for k in np.flatnonzero(~signed.any(axis=1) & matched.any(axis=1)):
                first = int(np.argmax(np.where(matched[k], length, -1.0)))
                signs[k, first] = 1
                signed[k, first] = True
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
        if attempt == 0:
            turned = np.einsum('mij,mkj->mki', rotation, chosen[..., 3:6])
            guess = np.where(np.einsum('mki,mki->mk', turned, directions) >= 0.0, 1, -1).astype(np.int8)
            signs = np.where(matched & (signs == 0), guess, signs).astype(np.int8)
            if signed[matched].all():
                break
    ends = np.stack([data.start, data.end])
    ends[:, data.kind == FeatureKind.CURVE] = rows_d[data.kind == FeatureKind.CURVE, :3]
    points = np.concatenate([np.broadcast_to(ends[0], (m, n, 3)), np.broadcast_to(ends[1], (m, n, 3))], axis=1)
    twice = np.concatenate([chosen, chosen], axis=1)
    weights = np.concatenate([matched, matched], axis=1).astype(float)
    translation, scale, free_shift = best_translations(
        rotation, twice[..., :3], twice[..., 3:6], points, weights, np.concatenate([curve, curve], axis=1), scale_free
    )
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
    poses = [Pose(_proper(rotation[k]), translation[k], float(scale[k])) for k in range(m)]
    return Validation(poses, deviations, passed, signs, free_shift, free_turn)


def _turn_about(axis: np.ndarray, points: np.ndarray, targets: np.ndarray, size: float) -> np.ndarray | None:
    """(3, 3): the rotation about an axis that brings points (k, 3) to their targets best across it; None when every
    one does, because they lie on one line along it."""
    across = np.eye(3) - np.outer(axis, axis)
    p, q = ((x - x.mean(axis=0)) @ across for x in (points, targets))
    if max(float(np.abs(p).max()), float(np.abs(q).max())) < 1e-6 * size:
        return None
    angle = np.arctan2(float((np.cross(p, q) @ axis).sum()), float((p * q).sum()))
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


def _proper(rotation: np.ndarray) -> np.ndarray:
    """The nearest rotation, against rounding."""
    u, _, v = np.linalg.svd(rotation)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
