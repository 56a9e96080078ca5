"""Which of the poses that a model's symmetry makes equal is stated, and how two sightings compare whichever is.

The rule: of all equal poses the canonical one turns the model by the least angle from the camera's frame. It depends on
the pose alone, so every answer about it says the same. Where two equal poses are turned equally far, the one counts
whose rotation matrix, read row by row, is the larger; an object that passes there changes from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from msgs_py import BIN, Interpretation, Pose
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from ..geometry.settings import ROUNDING
from .index import ModelIndex
from .symmetry import axis_of_revolution, equal_but_for_turn, moved, near, symmetries


def symmetry_group(index: ModelIndex) -> dict[str, Any]:
    """A model's symmetry as plain values, which JSON can write.

    Parameters
    ----------
    index : ModelIndex
        The model.

    Returns
    -------
    dict
        ``order``: of the group, None when it is not finite. ``axis``: None, or ``point`` (metres) and ``direction`` of
        the line about which the model is the same all round. ``motions``: the other elements, ``rotation`` (3, 3) and
        ``translation`` (3,) of model_T_model; with an axis, those that are equal but for a turn about it count once.
    """
    axis, motions = axis_of_revolution(index), symmetries(index)
    return {
        'order': len(motions) + 1 if axis is None else None,
        'axis': None if axis is None else {'point': axis.point.tolist(), 'direction': axis.direction.tolist()},
        'motions': [{'rotation': m.rotation.tolist(), 'translation': m.translation.tolist()} for m in motions],
    }


_groups: WeakKeyDictionary[ModelIndex, tuple[FloatArray, FloatArray]] = WeakKeyDictionary()


def equal_motions(index: ModelIndex, rotation: FloatArray, towards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The symmetries of a model, those about an axis at the turn that brings a pose nearest to a rotation.

    Parameters
    ----------
    index : ModelIndex
        The model.
    rotation : (3, 3) float64
        Of the pose camera_T_model.
    towards : (3, 3) float64
        A rotation.

    Returns
    -------
    rotations : (m, 3, 3) float64
    translations : (m, 3) float64
        model_T_model: composed with each, the pose looks the same. The first is the identity, but for a turn.
    """
    if index not in _groups:
        motions = [Pose.identity(), *symmetries(index)]
        _groups[index] = np.array([m.rotation for m in motions]), np.array([m.translation for m in motions])
    rotations, translations = _groups[index]
    axis = axis_of_revolution(index)
    if axis is None:
        return rotations, translations
    # The turn that makes the trace of both, its own after the other, the largest.
    a, eye = axis.direction, np.eye(3)
    relative = towards.T @ rotation @ rotations
    sine = (relative * np.cross(a, eye)).sum(axis=(1, 2))  # with the transposed matrix of a x
    cosine = np.trace(relative, axis1=1, axis2=2) - relative @ a @ a
    angle = np.arctan2(sine, cosine)[:, None, None]
    turns = np.cos(angle) * eye + np.sin(angle) * np.cross(eye, a) + (1.0 - np.cos(angle)) * np.outer(a, a)
    shifts = axis.point - turns @ axis.point
    return rotations @ turns, translations + (rotations @ shifts[:, :, None])[:, :, 0]


def canonical_motion(index: ModelIndex, pose: Pose) -> Pose:
    """The symmetry of a model that takes a pose to the canonical one of those equal to it.

    Examples
    --------
    >>> from msgs_py import FeatureSet
    >>> from model_matcher import index_model
    >>> bar = index_model(FeatureSet.from_edges([[-1, 0, 0], [-1, 1, 0]], [[1, 0, 0], [1, 1, 0]]))
    >>> half = Pose.from_rotation_vector([0, 0, 3.0])
    >>> round(half.compose(canonical_motion(bar, half)).error_to(Pose.identity()).rotation, 3)  # pi - 3
    0.142
    """
    rotations, translations = equal_motions(index, pose.rotation, np.eye(3))
    turned = pose.rotation @ rotations
    numbers = np.column_stack([np.trace(turned, axis1=1, axis2=2), turned.reshape(-1, 9)])
    order: list[list[float]] = (numbers / ROUNDING).round().tolist()
    best = max(range(len(order)), key=order.__getitem__)
    return Pose(rotations[best], translations[best])


def apart(index: ModelIndex, one: Pose, other: Pose) -> float:
    """How far the ends of a model are moved from one pose to another, of those that look the same the nearest.

    Parameters
    ----------
    index : ModelIndex
        The model.
    one, other : Pose
        camera_T_model.

    Returns
    -------
    float
        In sizes of the model.
    """
    rotations, translations = equal_motions(index, one.rotation, other.rotation)
    turned = one.rotation @ rotations
    gap = turned @ index.middle * one.scale + one.apply(translations) - other.apply(index.middle[None])
    return float(moved((turned * other.rotation).sum(axis=(1, 2)), np.linalg.norm(gap, axis=1), index.size).min())


def canonical(index: ModelIndex, found: Interpretation) -> Interpretation:
    """An interpretation at the canonical one of the poses that its model's symmetry makes equal.

    Parameters
    ----------
    index : ModelIndex
        Of its model.
    found : Interpretation

    Returns
    -------
    Interpretation
        Pose, covariance and pairing are those of the canonical pose; the pose that it had is among the symmetric ones.
    """
    motion = canonical_motion(index, found.pose)
    if np.array_equal(motion.rotation, np.eye(3)) and not motion.translation.any():
        return found
    pose = found.pose.compose(motion)
    poses = (found.pose, *found.symmetric_poses)
    others = tuple(one for one, same in zip(poses, _same(index, poses, pose)) if not same)
    covariance = found.covariance
    if covariance is not None:
        covariance = at_point(covariance, pose.translation - found.pose.translation)
    assignment, sign = _repaired(index, found, motion)
    return replace(found, pose=pose, covariance=covariance, symmetric_poses=others, assignment=assignment, sign=sign)


def _same(index: ModelIndex, poses: Sequence[Pose], pose: Pose) -> list[bool]:
    """Which of several poses count as one with another; of a solid of revolution whatever their turn."""
    axis = axis_of_revolution(index)
    if axis is not None:
        return [equal_but_for_turn(one, pose, axis, index.size) for one in poses]
    return [near(index, one, pose) for one in poses]


def at_point(covariance: FloatArray, arm: FloatArray) -> FloatArray:
    """The covariance of a pose stated for another point of the body.

    Parameters
    ----------
    covariance : (6, 6) float64
        Of (x, y, z, rx, ry, rz) of one point.
    arm : (..., 3) float64
        Metres, from that point to the other.

    Returns
    -------
    (..., 6, 6) float64
    """
    carry = np.zeros((*arm.shape[:-1], 6, 6))
    carry[...] = np.eye(6)
    carry[..., :3, 3:] = np.cross(arm[..., None, :], np.eye(3))  # a turn w moves the point by w x arm
    moved: FloatArray = carry @ covariance @ np.swapaxes(carry, -1, -2)
    return moved


def _repaired(index: ModelIndex, found: Interpretation, motion: Pose) -> tuple[Int32Array, Int8Array]:
    """Pairing and directions after the model was moved by a symmetry: data lies on other, equal features then."""
    assignment, sign = found.assignment.copy(), found.sign.copy()
    used = np.unique(assignment[assignment != BIN])
    rows = index.rows[np.searchsorted(index.source, used)]
    back = motion.inverse()
    middles, directions = back.apply(rows[:, :3]), back.rotate(rows[:, 3:6])
    lever = np.maximum(rows[:, 6], np.nan_to_num(rows[:, 7]))[:, None]
    sizes, all_sizes = (np.nan_to_num(some[:, 6:9]) for some in (rows, index.rows))
    apart = (
        np.linalg.norm(middles[:, None] - index.rows[:, :3], axis=2)
        + lever * np.linalg.norm(np.cross(directions[:, None], index.rows[:, 3:6]), axis=2)
        + np.abs(sizes[:, None] - all_sizes).sum(axis=2)
    )
    kinds = index.kind[np.searchsorted(index.source, used)]
    partner = np.argmin(np.where(kinds[:, None] == index.kind, apart, np.inf), axis=1)
    way = np.sign((directions * index.rows[partner, 3:6]).sum(axis=1)).astype(np.int8)
    for old, new, turned in zip(used, index.source[partner], way):
        paired = found.assignment == old
        assignment[paired], sign[paired] = new, turned * found.sign[paired]
    return assignment, sign
