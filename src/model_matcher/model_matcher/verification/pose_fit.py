"""The last fit of a pose and its covariance: one weighted least squares, every data feature by its own covariance.

Features that state a covariance weigh by it; how large all errors of a picture are, its residuals say as well, and the
more, the more there are. Of the others the bounds say how uncertain they are relative to each other (and the residuals,
how much worse they are along the line of sight, see :mod:`.line_of_sight`); how uncertain at all, the residuals alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import FeatureKind
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array

from ..geometry.features import CURVE, DataFeatures, FeatureRows, ModelFeatures
from ..geometry.least_squares import covariances as pose_covariances
from ..geometry.pose_rows import as_pose, step_between
from ..geometry.weighted_fit import weighted_fit
from ..model.problem import Problem
from ..model.settings import EXACT
from ..params import MatchParams
from .line_of_sight import sight_ratio
from .settings import STATED_WORTH


class StatedErrors(NamedTuple):
    """What the data features say of their errors.

    Attributes
    ----------
    covariance : (n, 6, 6) float64
        Of both ends, of a curve's centre and normal; square metres and radians. Zero where not known.
    known : (n,) bool
    """

    covariance: FloatArray
    known: BoolArray


class FittedPose(NamedTuple):
    """A pose after its last fit.

    Attributes
    ----------
    motion : (12,) float64
    covariance : (6, 6) float64
        Of (x, y, z, rx, ry, rz), metres and radians. A direction that the data leaves free has the variance of its
        whole range: the model's size squared, or pi squared / 3, that of a uniform angle.
    rms : float
        Metres, of the distances of end points from their model features.
    """

    motion: FloatArray
    covariance: FloatArray
    rms: float


def stated_errors(problem: Problem, params: MatchParams) -> StatedErrors:
    """What a problem's data features say of their errors, err_scale included."""
    data = problem.data
    known = data.has_covariance
    if not known.any():
        return StatedErrors(np.zeros((len(data), 6, 6)), known)
    covariance = np.where(known[:, None, None], params.err_scale**2 * data.covariance, 0.0)
    # What counts as exact keeps a covariance of zero from weighing without end.
    least = np.full((len(data), 6), (EXACT * problem.index.size) ** 2)
    least[data.kind == FeatureKind.CURVE, 3:] = EXACT**2
    covariance += least[:, :, None] * np.eye(6)
    return StatedErrors(covariance, known)


def fitted_poses(
    problem: Problem,
    errors: StatedErrors,
    motions: FloatArray,
    assignments: Int32Array,
    signs: Int8Array,
    by_sight: BoolArray,
) -> list[FittedPose]:
    """The poses that assignments determine, by all that is known of the errors of the data.

    Parameters
    ----------
    problem : Problem
        Model and data.
    errors : StatedErrors
        See :func:`stated_errors`.
    motions : (c, 12) float64
        Poses near them; changed in place.
    assignments : (c, n) int32
        The model feature of each usable data feature, BIN for none.
    signs : (c, n) int8
        Which way round each data feature lies on its model feature.
    by_sight : (c,) bool
        Whether data without covariances may be worse known along the line of sight from the origin, where its eye is.
    """
    at = motions.copy()
    fitted = _fitted(problem, problem.features, errors, motions, assignments, signs, by_sight)
    if problem.moved is None:
        return fitted
    # An error that all data has in common moves the pose as a whole: as far as a fit to data that is one sigma off.
    moved = _fitted(problem, problem.moved, errors, at, assignments, signs, by_sight)
    return [_with_move(one, other) for one, other in zip(fitted, moved)]


def _with_move(fitted: FittedPose, moved: FittedPose) -> FittedPose:
    """A pose of which the other is one sigma of an error that is not in its covariance off."""
    step = step_between(as_pose(fitted.motion), as_pose(moved.motion))
    return fitted._replace(covariance=fitted.covariance + np.outer(step, step))


def _fitted(
    problem: Problem,
    data: DataFeatures,
    errors: StatedErrors,
    motions: FloatArray,
    assignments: Int32Array,
    signs: Int8Array,
    by_sight: BoolArray,
) -> list[FittedPose]:
    """As :func:`fitted_poses`, of data (n,) that stands where it stands."""
    count = len(motions)
    normals, levers, factors, rms = np.empty((count, 6, 6)), np.empty((count, 3)), np.empty(count), np.empty(count)
    _fit_all(motions, assignments, signs, problem.model, data, errors, by_sight, normals, levers, factors, rms)
    covariances = pose_covariances(normals, factors, levers, problem.index.size)
    return [FittedPose(*one) for one in zip(motions, covariances, rms.tolist())]


@njit
def _fit_all(
    motions: FloatArray,
    assignments: Int32Array,
    signs: Int8Array,
    model: ModelFeatures,
    data: DataFeatures,
    errors: StatedErrors,
    by_sight: BoolArray,
    normals: FloatArray,
    levers: FloatArray,
    factors: FloatArray,
    rms: FloatArray,
) -> None:
    """As :func:`fitted_poses`; fills normal matrices, arms from their centres, factors of variance, and residuals."""
    rows = FeatureRows(data.rows, data.kind)
    for c in range(len(motions)):
        motion, assignment, sign = motions[c], assignments[c], signs[c]
        stated = True
        for k in range(len(assignment)):
            stated &= assignment[k] < 0 or errors.known[k]
        covariance = errors.covariance
        if not stated:
            ratio = sight_ratio(motion.copy(), model, data, assignment, sign) if by_sight[c] else 1.0
            covariance = errors.covariance.copy()
            assume(covariance, errors.known, data, assignment, ratio)
        fit = weighted_fit(motion, model.rows, rows, covariance, assignment, sign, STATED_WORTH if stated else 0.0)
        normals[c], factors[c], rms[c] = fit.normal, fit.scale, fit.rms
        for i in range(3):
            levers[c, i] = motion[9 + i] - fit.centre[i]


@njit
def assume(covariance: FloatArray, known: BoolArray, data: DataFeatures, assignment: Int32Array, ratio: float) -> None:
    """Covariances of assigned features that state none, in place, up to a common factor: by what they may be off.

    Parameters
    ----------
    covariance : (n, 6, 6) float64
    known : (n,) bool
        Which are stated, and stay.
    data : DataFeatures
    assignment : (n,) int32
        Negative for what is not fitted.
    ratio : float
        Of errors across the line of sight to those along it; 1: alike in all directions, as far as each may be off.

    """
    least = np.inf
    for k in range(len(known)):
        if assignment[k] >= 0:
            least = min(least, data.tolerances[k, 0])
    for k in range(len(known)):
        if assignment[k] < 0 or known[k]:
            continue
        d, across = data.rows[k], data.tolerances[k, 0]
        covariance[k] = 0.0
        for end in range(2):
            step = d[6] if end else -d[6]
            x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
            far = x * x + y * y + z * z
            if data.kind[k] == CURVE and end:
                variance, deep = data.tolerances[k, 2] ** 2, 0.0
            elif ratio < 1.0 and far > 0.0:
                # What is known worse than the rest along the line of sight counts less there.
                variance, deep = least**2, (least / ratio) ** 2 + across**2 - least**2
            else:
                variance, deep = across**2, 0.0
            sight = (x, y, z)
            for i in range(3):
                covariance[k, 3 * end + i, 3 * end + i] = variance
                if deep > 0.0:
                    for j in range(3):
                        covariance[k, 3 * end + i, 3 * end + j] += deep * sight[i] * sight[j] / far
