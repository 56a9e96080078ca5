"""What is wrong with a model's outline in an image besides noise, estimated from what a fit leaves.

An edge is rounded, a part is not to size, a lens bends a line: then the whole image of a curve lies off by a straight
line along it, whose two unknowns have a common sigma; and each point by a little of its own. Both sigmas are estimated
from the residuals, so that the weight of a curve does not grow without end with its length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import FloatArray, Int32Array

from .settings import NOT_ZERO, POSE_UNKNOWNS


class ModelError(NamedTuple):
    """Sigmas, pixels.

    Attributes
    ----------
    curve : float
        Of the offset, and of the slope (over half the length), of a whole curve.
    point : float
        Of a point on its curve.
    """

    curve: float
    point: float


def fitted_model_error(
    group: Int32Array,
    abscissa: FloatArray,
    residual: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    before: ModelError,
) -> ModelError:
    """One step of expectation-maximisation for both sigmas.

    Parameters
    ----------
    group : (n,) int32
        Curve and view of each point, ascending.
    abscissa : (n,) float64
        From -1 to 1 along the curve.
    residual : (n,) float64
        Pixels.
    weight : (n,) float64
        What each counts.
    variance : (n,) float64
        Square pixels, what noise makes of it.
    before : ModelError
        The estimate so far.

    Returns
    -------
    ModelError
    """
    curve, point = _sigmas(group, abscissa, residual, weight, variance, 1.0 / max(before.curve**2, NOT_ZERO))
    return ModelError(curve, point)


@njit(nogil=True)
def _sigmas(
    group: Int32Array,
    abscissa: FloatArray,
    residual: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    prior: float,
) -> tuple[float, float]:
    """As :func:`fitted_model_error`; prior : one over square pixels, of either unknown of a curve's line."""
    n, curves, squares, start = len(group), 0, 0.0, 0
    inner = np.empty(n)
    for end in range(1, n + 1):
        if end < n and group[end] == group[start]:
            continue
        a, b, c, first, second = prior, 0.0, prior, 0.0, 0.0
        for k in range(start, end):
            w, t = weight[k], abscissa[k]
            a += w
            b += w * t
            c += w * t * t
            first += w * residual[k]
            second += w * t * residual[k]
        scale = 1.0 / (a * c - b * b)
        offset, slope = scale * (c * first - b * second), scale * (a * second - b * first)
        squares += offset * offset + slope * slope + scale * (a + c)
        for k in range(start, end):
            inner[k] = abs(residual[k] - offset - slope * abscissa[k])
        curves += 1
        start = end
    # The pose has taken some of the unknowns of the lines, at most half of them.
    curve = math.sqrt(squares / max(2 * curves - POSE_UNKNOWNS, curves))
    point = (np.median(inner) / NORMAL_QUARTILE) ** 2 - np.median(variance)
    return curve, math.sqrt(max(point, 0.0))
