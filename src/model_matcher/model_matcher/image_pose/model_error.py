"""What is wrong with a model's outline in images besides noise, estimated from what a fit leaves.

An edge is rounded, a part is not to size: then a curve lies off by a straight line along it, the same in all views. The
light falls from one side, a lens bends a line, two cameras are not quite where they are said to be: then it is off by
another line in each view. And each point is off by a little of its own. The sigmas of the three are estimated from the
residuals, so that the weight of a curve does not grow without end with its length, nor with the number of views.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import FloatArray, IntArray

from .alignment import Placed, add_to_line, inverse_of_line
from .settings import FIRST_CURVE_ERROR, FIRST_POINT_ERROR, NOT_ZERO, SETTLED, SIGMA_TURNS


class ModelError(NamedTuple):
    """Sigmas, pixels.

    Attributes
    ----------
    curve : float
        Of the offset, and of the slope (over half the length), of a whole curve in all views.
    view : float
        Of those that it has in one view besides.
    point : float
        Of a point on its curve.
    """

    curve: float
    view: float
    point: float


NO_ERROR = ModelError(0.0, 0.0, 0.0)
# What is believed at first.
FIRST_ERROR = ModelError(FIRST_CURVE_ERROR, FIRST_CURVE_ERROR, FIRST_POINT_ERROR)


def fitted_model_error(
    placed: Placed,
    residual: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    normal: FloatArray,
    before: ModelError,
) -> ModelError:
    """The sigmas by expectation-maximisation.

    Parameters
    ----------
    placed : Placed
        n points.
    residual : (n,) float64
        Pixels; of what counts nothing, it may be not a number.
    weight : (n,) float64
        What each counts.
    variance : (n,) float64
        Square pixels, what noise makes of it.
    normal : (6, 6) float64
        Information that fixed the pose: what the pose has taken of the lines is not known to be none.
    before : ModelError
        The estimate so far.

    Returns
    -------
    ModelError
    """
    least = math.sqrt(NOT_ZERO)
    sigmas = max(before.curve, least), max(before.view, least)
    pose = np.linalg.pinv(normal, hermitian=True)
    return ModelError(*_sigmas(placed, residual, weight, variance, pose, sigmas))


@njit(nogil=True)
def _sigmas(
    placed: Placed,
    residual: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    pose: FloatArray,
    before: tuple[float, float],
) -> tuple[float, float, float]:
    """As :func:`fitted_model_error`; pose : (6, 6), its covariance; before : sigmas of curve and view."""
    group, curve = placed.group, placed.curve
    # Of each curve in a view.
    sums, of_curve = np.zeros((group.max() + 1, 2, 9)), np.full(group.max() + 1, -1)
    for k in range(len(curve)):
        if not weight[k] > 0.0:
            continue
        of_curve[group[k]] = curve[k]
        add_to_line(sums[group[k]], weight[k], placed.abscissa[k], placed.slope[k], residual[k])
    common, view = before
    shared, own = np.zeros((0, 2)), np.zeros((0, 2))
    for _ in range(SIGMA_TURNS):
        last = common + view
        shared, own, common, view = _lines(sums, of_curve, pose, common + NOT_ZERO, view + NOT_ZERO)
        if abs(common + view - last) < SETTLED * last:
            break
    inner, noise, n = np.empty(len(curve)), np.empty(len(curve)), 0
    for k in range(len(curve)):
        if weight[k] > 0.0:
            off = shared[curve[k]] + own[group[k]]
            inner[n], noise[n] = abs(residual[k] - off[0] - off[1] * placed.abscissa[k]), variance[k]
            n += 1
    point = (np.median(inner[:n]) / NORMAL_QUARTILE) ** 2 - np.median(noise[:n])
    return common, view, math.sqrt(max(point, 0.0))


@njit(nogil=True)
def _lines(
    sums: FloatArray, of_curve: IntArray, pose: FloatArray, curve: float, view: float
) -> tuple[FloatArray, FloatArray, float, float]:
    """Offset and slope of each curve in all views (c, 2), and in one besides (g, 2); the sigmas that are next.

    sums, of_curve, pose : see :func:`_sigmas`; curve, view : sigmas before
    """
    most = of_curve.max() + 1
    whole, alone, turned = np.zeros((most, 2, 9)), np.zeros((most, 2, 2)), np.zeros((most, 2, 6))
    line, besides, by_pose = np.zeros((most, 2)), np.zeros((len(sums), 2)), np.empty((2, 6))
    for g in range(len(sums)):
        if of_curve[g] < 0:
            continue
        own, inverse, rest = sums[g], inverse_of_line(sums[g][:, 7:], view), whole[of_curve[g]]
        for j in range(9):
            first = inverse[0, 0] * own[0, j] + inverse[0, 1] * own[1, j]
            second = inverse[1, 0] * own[0, j] + inverse[1, 1] * own[1, j]
            rest[0, j] += own[0, j] - own[0, 7] * first - own[0, 8] * second
            rest[1, j] += own[1, j] - own[1, 7] * first - own[1, 8] * second
    # The line of each curve, its covariance when the pose is known, and how it turns with the pose.
    squares, curves = 0.0, 0
    for c in range(most):
        if whole[c, 0, 7] <= 0.0:
            continue
        alone[c] = inverse_of_line(whole[c][:, 7:], curve)
        for i in range(2):
            line[c, i] = alone[c, i, 0] * whole[c, 0, 6] + alone[c, i, 1] * whole[c, 1, 6]
            for j in range(6):
                turned[c, i, j] = -alone[c, i, 0] * whole[c, 0, j] - alone[c, i, 1] * whole[c, 1, j]
            squares += line[c, i] ** 2 + alone[c, i, i] + _form(turned[c, i], pose)
        curves += 1
    common = math.sqrt(squares / max(2 * curves, 1))
    squares, views = 0.0, 0
    for g in range(len(sums)):
        c = of_curve[g]
        if c < 0:
            continue
        own, inverse = sums[g], inverse_of_line(sums[g][:, 7:], view)
        for i in range(2):
            # What the offset and the slope of the whole curve take of this one.
            first = inverse[i, 0] * own[0, 7] + inverse[i, 1] * own[1, 7]
            second = inverse[i, 0] * own[0, 8] + inverse[i, 1] * own[1, 8]
            of_own = inverse[i, 0] * own[0, 6] + inverse[i, 1] * own[1, 6]
            besides[g, i] = of_own - first * line[c, 0] - second * line[c, 1]
            for j in range(6):
                by_pose[i, j] = inverse[i, 0] * own[0, j] + inverse[i, 1] * own[1, j]
                by_pose[i, j] += first * turned[c, 0, j] + second * turned[c, 1, j]
            of_line = first * first * alone[c, 0, 0] + 2.0 * first * second * alone[c, 0, 1]
            of_line += second * second * alone[c, 1, 1]
            squares += besides[g, i] ** 2 + inverse[i, i] + of_line + _form(by_pose[i], pose)
        views += 1
    return line, besides, common, math.sqrt(squares / max(2 * views, 1))


@njit(nogil=True)
def _form(row: FloatArray, pose: FloatArray) -> float:
    """Variance of what depends on the pose by so much (6,)."""
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += row[i] * pose[i, j] * row[j]
    return total
