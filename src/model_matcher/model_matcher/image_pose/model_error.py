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

from ..geometry.settings import NOT_ZERO, ROUNDING
from .alignment import Placed, Prior, Steps, add_to_line, align, inverse_of_line
from .settings import (
    FARTHEST_STEP,
    FEWEST_POINTS,
    FIRST_ERROR_PX,
    LONGEST_JUMP,
    POINT_TURNS,
    SETTLED,
    SIGMA_TURNS,
    TO_POSE,
)


class ModelError(NamedTuple):
    """Sigmas, pixels.

    Attributes
    ----------
    curve : float
        Of the offset, and of the slope (over half the length), of a whole curve in all views.
    view : float
        Of those that it has in one view besides.
    point : float
        Of a point on its curve, beyond what its step is stated to be off.
    """

    curve: float
    view: float
    point: float


NO_ERROR = ModelError(0.0, 0.0, 0.0)
# What is believed at first.
FIRST_ERROR = ModelError(FIRST_ERROR_PX, FIRST_ERROR_PX, FIRST_ERROR_PX)


@njit(nogil=True)
def settled(
    motion: FloatArray,
    middle: FloatArray,
    cameras: FloatArray,
    placed: Placed,
    steps: Steps,
    error: ModelError,
    density: float,
    rounds: int,
    off: float,
) -> tuple[FloatArray, FloatArray, FloatArray, ModelError]:
    """Lay a pose on fitted steps, in place, and tell the outline's errors, in turns; until too few points count.

    Beforehand each curve is where it is drawn, give or take ``off``, and those as well that no step was fitted to: else
    a turn that little tells of would go wherever its curves can be said to be off, and these the more the farther it
    goes.

    Parameters
    ----------
    motion, middle, cameras, placed, steps
        See :func:`.alignment.align`.
    error : ModelError
        To begin with.
    density : float
        Steps a pixel that are not the outline's, over the chance that a point of it shows one.
    rounds : int
    off : float
        Pixels, sigma by which curves may lie off where they are drawn.

    Returns
    -------
    residual, weight, normal : (n,), (n,), (6, 6) float64
        See :func:`.alignment.align`.
    error : ModelError
    """
    n = len(placed.eye)
    residual, weight, normal = np.empty(n), np.empty(n), np.zeros((6, 6))
    widths, prior = np.zeros(TO_POSE), Prior(_where_drawn(placed, off), np.zeros(6))
    for _ in range(rounds):
        curve, view, point = error
        own = Steps(steps.offset, steps.number, steps.variance + point**2)
        align(motion, middle, cameras, placed, own, widths, density, (curve, view), prior, residual, weight, normal)
        if (weight > 0.0).sum() < FEWEST_POINTS:
            break
        error = fitted_model_error(placed, residual, weight, steps.variance, normal + prior.information, error)
        change, size = 0.0, 0.0
        for one, other in zip(error, (curve, view, point)):
            change += abs(one - other)
            size += other
        if change < SETTLED * size:
            break
    return residual, weight, normal, error


@njit(nogil=True)
def _where_drawn(placed: Placed, off: float) -> FloatArray:
    """Information (6, 6) on a pose at which each curve lies within so many pixels, sigma, of where each view has it."""
    n = len(placed.eye)
    count = np.bincount(placed.group)
    out = np.zeros((6, 6))
    for k in range(n):
        weight = 1.0 / (count[placed.group[k]] * off * off)
        for i in range(6):
            for j in range(6):
                out[i, j] += weight * placed.slope[k, i] * placed.slope[k, j]
    return out


@njit(nogil=True)
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
        Information on the pose, also what was known beforehand: what the pose has taken of the lines is not known to be
        none.
    before : ModelError
        The estimate so far.

    Returns
    -------
    ModelError
    """
    least = math.sqrt(NOT_ZERO)
    common, in_view, _ = before
    sigmas = max(common, least), max(in_view, least)
    # A root of its pseudo-inverse: a direction of which nothing is known takes nothing.
    values, axes = np.linalg.eigh(normal)
    root = np.zeros((6, 6))
    for q in range(6):
        if values[q] > ROUNDING * values[5]:
            for i in range(6):
                root[i, q] = axes[i, q] / math.sqrt(values[q])
    curve, view, point = _sigmas(placed, residual, weight, variance, root, sigmas)
    return ModelError(curve, view, point)


@njit(nogil=True)
def _sigmas(
    placed: Placed,
    residual: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    root: FloatArray,
    before: tuple[float, float],
) -> tuple[float, float, float]:
    """As :func:`fitted_model_error`.

    root : (6, 6), that times its transpose is the covariance of the pose; before : sigmas of curve and view
    """
    group, curve = placed.group, placed.curve
    # Of each curve in a view.
    groups = group.max() + 1
    sums, of_curve = np.zeros((groups, 2, 9)), np.full(groups, -1)
    for k in range(len(curve)):
        if not weight[k] > 0.0:
            continue
        of_curve[group[k]] = curve[k]
        add_to_line(sums[group[k]], weight[k], placed.abscissa[k], placed.slope[k], residual[k])
    # Derivatives by independent unknowns of variance 1 instead of the pose: what depends on it has the variance of its
    # squared derivatives.
    own = np.empty(6)
    for g in range(groups):
        if of_curve[g] < 0:
            continue
        for line in range(2):
            own[:] = sums[g, line, :6]
            for q in range(6):
                total = 0.0
                for i in range(6):
                    total += own[i] * root[i, q]
                sums[g, line, q] = total
    common, view = before
    most = of_curve.max() + 1
    lines = _Lines(
        np.zeros((most, 2)),
        np.zeros((groups, 2)),
        np.zeros((most, 2, 9)),
        np.zeros((most, 2, 2)),
        np.zeros((most, 2, 6)),
    )
    for _ in range(SIGMA_TURNS):
        last = common, view
        one = _expected(sums, of_curve, common, view, lines)
        two = _expected(sums, of_curve, one[0] + NOT_ZERO, one[1] + NOT_ZERO, lines)
        common, view = _ahead(last[0], one[0], two[0]), _ahead(last[1], one[1], two[1])
        if abs(common - last[0]) + abs(view - last[1]) < SETTLED * (last[0] + last[1]):
            break
    inner, noise, n = np.empty(len(curve)), np.empty(len(curve)), 0
    for k in range(len(curve)):
        if weight[k] > 0.0:
            off = lines.shared[curve[k]] + lines.own[group[k]]
            inner[n], noise[n] = residual[k] - off[0] - off[1] * placed.abscissa[k], variance[k]
            n += 1
    return common, view, _beyond(inner[:n], noise[:n])


@njit(nogil=True)
def _beyond(residual: FloatArray, noise: FloatArray) -> float:
    """The sigma that residuals (n,) have beyond variances (n,) of their own.

    With it the median square of residuals over their sigmas is as it should be. (Medians of either would not tell:
    sigmas of strong steps and of faint ones differ by much.)
    """
    squares = residual * residual
    if np.median(squares / noise) <= NORMAL_QUARTILE**2:
        return 0.0
    low, high = 0.0, np.median(squares) / NORMAL_QUARTILE**2
    for _ in range(POINT_TURNS):
        middle = 0.5 * (low + high)
        if np.median(squares / (noise + middle)) > NORMAL_QUARTILE**2:
            low = middle
        else:
            high = middle
    return math.sqrt(high)


@njit(nogil=True)
def _ahead(before: float, one: float, two: float) -> float:
    """Where two steps from a sigma lead to, of which each is a share of the one before (Varadhan and Roland 2008).

    Steps of expectation-maximisation creep where a sigma is less than the noise. These leaps end where those steps do.
    """
    first, second = math.log((one + NOT_ZERO) / before), math.log((two + NOT_ZERO) / (one + NOT_ZERO))
    bend = abs(second - first)
    length = 1.0 if bend <= 0.0 else min(max(abs(first) / bend, 1.0), LONGEST_JUMP)
    farthest = math.log(FARTHEST_STEP / before)
    return before * math.exp(min(2.0 * length * first + length**2 * (second - first), farthest)) + NOT_ZERO


class _Lines(NamedTuple):
    """By what lines curves are off.

    Attributes
    ----------
    shared, own : (c, 2), (g, 2) float64
        Offset and slope of each curve in all views, and in one view besides.
    whole, alone, turned : (c, 2, 9), (c, 2, 2), (c, 2, 6) float64
        Of each curve: its sums less what single views take of them; the covariance of its line when the pose is known,
        and how that turns with the pose.
    """

    shared: FloatArray
    own: FloatArray
    whole: FloatArray
    alone: FloatArray
    turned: FloatArray


@njit(nogil=True)
def _expected(sums: FloatArray, of_curve: IntArray, curve: float, view: float, lines: _Lines) -> tuple[float, float]:
    """Fill in the lines; the sigmas that are next, none more than that of steps that are fitted at all.

    sums : (g, 2, 9), see :func:`_sigmas`; of_curve : (g,); curve, view : sigmas before
    """
    most, whole, alone, turned = len(lines.whole), lines.whole, lines.alone, lines.turned
    whole[:] = 0.0
    for g in range(len(sums)):
        if of_curve[g] < 0:
            continue
        own, rest = sums[g], whole[of_curve[g]]
        p, q, r = inverse_of_line(own, view)
        for j in range(9):
            first, second = p * own[0, j] + q * own[1, j], q * own[0, j] + r * own[1, j]
            rest[0, j] += own[0, j] - own[0, 7] * first - own[0, 8] * second
            rest[1, j] += own[1, j] - own[1, 7] * first - own[1, 8] * second
    squares, curves = 0.0, 0
    for c in range(most):
        if whole[c, 0, 7] <= 0.0:
            lines.shared[c] = 0.0
            continue
        alone[c, 0, 0], alone[c, 0, 1], alone[c, 1, 1] = inverse_of_line(whole[c], curve)
        alone[c, 1, 0] = alone[c, 0, 1]
        for i in range(2):
            line = alone[c, i, 0] * whole[c, 0, 6] + alone[c, i, 1] * whole[c, 1, 6]
            lines.shared[c, i] = line
            squares += line * line + alone[c, i, i]
            for j in range(6):
                by_pose = -alone[c, i, 0] * whole[c, 0, j] - alone[c, i, 1] * whole[c, 1, j]
                turned[c, i, j] = by_pose
                squares += by_pose * by_pose
        curves += 1
    common = math.sqrt(squares / max(2 * curves, 1))
    squares, views = 0.0, 0
    for g in range(len(sums)):
        c = of_curve[g]
        if c < 0:
            continue
        own = sums[g]
        p, q, r = inverse_of_line(own, view)
        for i in range(2):
            here, other = (p, q) if i == 0 else (q, r)
            # What the offset and the slope of the whole curve take of this one.
            first = here * own[0, 7] + other * own[1, 7]
            second = here * own[0, 8] + other * own[1, 8]
            besides = here * own[0, 6] + other * own[1, 6]
            besides -= first * lines.shared[c, 0] + second * lines.shared[c, 1]
            lines.own[g, i] = besides
            squares += besides * besides + (p if i == 0 else r)
            squares += first * first * alone[c, 0, 0] + 2.0 * first * second * alone[c, 0, 1]
            squares += second * second * alone[c, 1, 1]
            for j in range(6):
                by_pose = here * own[0, j] + other * own[1, j]
                by_pose += first * turned[c, 0, j] + second * turned[c, 1, j]
                squares += by_pose * by_pose
        views += 1
    return min(common, FARTHEST_STEP), min(math.sqrt(squares / max(2 * views, 1)), FARTHEST_STEP)
