"""What is wrong with a model's outline in an image besides noise, estimated from what a fit leaves.

An edge is rounded, a part is not to size, a lens bends a line: then the whole image of a curve lies off by a straight
line along it, whose two unknowns have a common sigma; and each point by a little of its own. Both sigmas are estimated
from the residuals, so that the weight of a curve does not grow without end with its length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.robust import sigma_from_median
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
    label = np.unique(group, return_inverse=True)[1]
    prior = 1.0 / max(before.curve**2, NOT_ZERO)
    sums = [np.bincount(label, weight * abscissa**k) for k in range(3)]
    right = [np.bincount(label, weight * residual * abscissa**k) for k in range(2)]
    a, b, c = sums[0] + prior, sums[1], sums[2] + prior
    scale = 1.0 / (a * c - b * b)
    offset, slope = scale * (c * right[0] - b * right[1]), scale * (a * right[1] - b * right[0])
    inner = residual - offset[label] - slope[label] * abscissa
    squares = (offset**2 + slope**2 + scale * (a + c)).sum()
    # The pose has taken some of the unknowns of the lines, at most half of them.
    curve = np.sqrt(squares / max(2 * len(offset) - POSE_UNKNOWNS, len(offset)))
    point = sigma_from_median(float(np.median(np.abs(inner)))) ** 2 - float(np.median(variance))
    return ModelError(float(curve), float(np.sqrt(max(point, 0.0))))
