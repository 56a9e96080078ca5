"""What is wrong with a model's outline in images besides noise, estimated from what a fit leaves.

An edge is rounded, a part is not to size: then a curve lies off by a straight line along it, the same in all views. The
light falls from one side, a lens bends a line: then it is off by another line in each view. And each point is off by a
little of its own. Two cameras are not quite where they are said to be: then all that one of them shows is off together.
The sigmas of the four are estimated from the residuals, so that the weight of a curve does not grow without end with
its length, nor with the number of views, nor that of all curves with their number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import FloatArray, IntArray

from ..geometry.settings import NOT_ZERO, ROUNDING
from .alignment import (
    Equations,
    Fit,
    ModelError,
    Placed,
    Prior,
    Steps,
    add_to_line,
    align,
    inverse_of_line,
    line_of,
    new_fit,
    take_line,
    with_prior,
)
from .settings import (
    AS_DRAWN,
    FARTHEST_STEP,
    FEWEST_POINTS,
    FIRST_ERROR_PX,
    IMAGE_TURNS,
    LONGEST_JUMP,
    POINT_TURNS,
    SETTLED,
    SIGMA_TURNS,
    TO_POSE,
)

NO_ERROR = ModelError(0.0, 0.0, 0.0, 0.0)
# What is believed at first.
FIRST_ERROR = ModelError(FIRST_ERROR_PX, FIRST_ERROR_PX, FIRST_ERROR_PX, FIRST_ERROR_PX)


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
        The likeliest. What is stated has each times the chance that there is such an error, see :func:`as_likely`.
    """
    error, enough, fit = likeliest(motion, middle, cameras, placed, steps, error, density, rounds, off)
    stated = error
    if enough:
        stated = as_likely(placed, fit.residual, fit.weight, error)
        align(motion, middle, cameras, placed, steps, np.zeros(TO_POSE), density, stated, fit)
    return fit.residual, fit.weight, of_pose(fit.equations.normal, stated.image), error


@njit(nogil=True)
def likeliest(
    motion: FloatArray,
    middle: FloatArray,
    cameras: FloatArray,
    placed: Placed,
    steps: Steps,
    error: ModelError,
    density: float,
    rounds: int,
    off: float,
) -> tuple[ModelError, bool, Fit]:
    """The outline's likeliest errors, whether enough points count, and the fit with them; as :func:`settled`."""
    fit, widths = new_fit(placed, _where_drawn(placed, off)), np.zeros(TO_POSE)
    for _ in range(rounds):
        before = error
        align(motion, middle, cameras, placed, steps, widths, density, error, fit)
        if (fit.weight > 0.0).sum() < FEWEST_POINTS:
            return error, False, fit
        error = fitted_model_error(placed, steps.variance, fit, error)
        change, size = 0.0, 0.0
        for one, other in zip(error, before):
            change += abs(one - other)
            size += other
        if change < SETTLED * size:
            break
    return error, True, fit


@njit(nogil=True)
def of_pose(normal: FloatArray, image: float) -> FloatArray:
    """What a normal matrix (m, m) says of the pose alone, (6, 6), when images are off by so many pixels, sigma."""
    pose = normal[:6, :6].copy()
    if image > 0.0 and len(normal) > 6:
        further = normal[6:, 6:] + np.eye(len(normal) - 6) / image**2
        pose -= normal[:6, 6:] @ np.linalg.solve(further, np.ascontiguousarray(normal[6:, :6]))
    return pose


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
def fitted_model_error(placed: Placed, variance: FloatArray, fit: Fit, before: ModelError) -> ModelError:
    """The sigmas by expectation-maximisation; that of images as what is left says is likeliest.

    Parameters
    ----------
    placed : Placed
        n points.
    variance : (n,) float64
        Square pixels, what noise makes of their steps.
    fit : Fit
        Of a pose to these. What the pose has taken of the lines is not known to be none.
    before : ModelError
        The estimate so far.

    Returns
    -------
    ModelError
    """
    least = math.sqrt(NOT_ZERO)
    common, in_view, _, image = before
    prior, residual, weight, equations = fit
    sigmas = max(common, least), max(in_view, least)
    root = root_of_inverse(with_prior(equations, prior, image)[0])
    root[6:] *= image
    curve, view, point = _sigmas(placed, residual, weight, variance, root, sigmas)
    return ModelError(curve, view, point, _of_images(equations, prior))


@njit(nogil=True)
def root_of_inverse(normal: FloatArray) -> FloatArray:
    """A root (m, m) of a matrix's pseudo-inverse: a direction of which nothing is known takes nothing."""
    values, axes = np.linalg.eigh(normal)
    for q in range(len(values)):
        known = values[q] > ROUNDING * values[-1]
        axes[:, q] *= 1.0 / math.sqrt(values[q]) if known else 0.0
    return axes


@njit(nogil=True)
def _of_images(equations: Equations, prior: Prior) -> float:
    """The sigma of images that are off which makes what the equations say of them likeliest, whatever the pose is.

    Its square, times the chance that they are off at all; beforehand they are not, unless that is decisively likelier.
    """
    normal, right = equations
    if len(right) == 6:
        return 0.0
    moved = prior.moved
    root = root_of_inverse(normal[:6, :6] + prior.information)
    taken = root.T @ np.ascontiguousarray(normal[:6, 6:])
    towards = root.T @ (right[:6] - prior.information @ moved[:6])
    own = normal[6:, 6:] - taken.T @ taken
    told = right[6:] - taken.T @ towards + own @ moved[6:]
    values, axes = np.linalg.eigh(own)
    squares = (axes.T @ told) ** 2
    low, high = 0.0, FARTHEST_STEP**2
    for _ in range(IMAGE_TURNS):
        middle = 0.5 * (low + high)
        spread = 1.0 + middle * values
        # The derivative of the likelihood by the variance.
        if (squares / spread**2 - values / spread).sum() > 0.0:
            low = middle
        else:
            high = middle
    gain = 0.5 * (squares * low / (1.0 + low * values) - np.log(1.0 + low * values)).sum()
    return math.sqrt(low / (1.0 + math.exp(DECISIVE - gain)))


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

    root : (m, m), that times its transpose is the covariance of the unknowns; before : sigmas of curve and view
    """
    group, curve = placed.group, placed.curve
    # Of each curve in a view.
    unknowns = len(root)
    sums, of_curve = sums_of_lines(placed, residual, weight, unknowns)
    groups = len(sums)
    # Derivatives by independent unknowns of variance 1 instead of those of the fit: what depends on them has the
    # variance of its squared derivatives.
    own = np.empty(unknowns)
    for g in range(groups):
        if of_curve[g] < 0:
            continue
        for line in range(2):
            own[:] = sums[g, line, 3:]
            for q in range(unknowns):
                total = 0.0
                for i in range(unknowns):
                    total += own[i] * root[i, q]
                sums[g, line, 3 + q] = total
    common, view = before
    most = of_curve.max() + 1
    lines = _Lines(
        np.zeros((most, 2)),
        np.zeros((groups, 2)),
        np.zeros((most, 2, 3 + unknowns)),
        np.zeros((most, 2, 2)),
        np.zeros((most, 2, unknowns)),
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
def as_likely(placed: Placed, residual: FloatArray, weight: FloatArray, error: ModelError) -> ModelError:
    """Errors of a fit, those of curves times the chance that there are such errors at all.

    What is estimated from noise is never less than nothing, and so too much where there is nothing. Curves are where
    they are drawn, or off, or each in its own way in each view, or both: by their likelihood, and AS_DRAWN beforehand.

    Parameters
    ----------
    placed : Placed
        n points.
    residual, weight : (n,) float64
        See :class:`.alignment.Fit`.
    error : ModelError
        The likeliest.

    Returns
    -------
    ModelError
    """
    curve, view, point, image = error
    sums, of_curve = sums_of_lines(placed, residual, weight, 0)
    either = math.hypot(curve, view)
    chance = np.zeros(4)
    chance[1] = _log_likelihood(sums, of_curve, either, 0.0) - AS_DRAWN
    chance[2] = _log_likelihood(sums, of_curve, 0.0, either) - AS_DRAWN
    chance[3] = _log_likelihood(sums, of_curve, curve, view) - 2.0 * AS_DRAWN
    chance = np.exp(chance - chance.max())
    chance /= chance.sum()
    return ModelError(
        math.sqrt(chance[1] * either**2 + chance[3] * curve**2),
        math.sqrt(chance[2] * either**2 + chance[3] * view**2),
        point,
        image,
    )


@njit(nogil=True)
def sums_of_lines(
    placed: Placed, residual: FloatArray, weight: FloatArray, unknowns: int
) -> tuple[FloatArray, IntArray]:
    """Sums (g, 2, 3 + m) of the lines of curves in single views, and of which curve each is (g,); -1: none counts.

    unknowns : whose derivatives are wanted, m, see :func:`.alignment.add_to_line`
    """
    groups = placed.group.max() + 1
    sums, of_curve = np.zeros((groups, 2, 3 + unknowns)), np.full(groups, -1)
    for k in range(len(weight)):
        if weight[k] > 0.0:
            g = placed.group[k]
            of_curve[g] = placed.curve[k]
            add_to_line(sums[g], weight[k], placed.abscissa[k], placed.slope[k, :unknowns], residual[k])
    return sums, of_curve


@njit(nogil=True)
def _log_likelihood(sums: FloatArray, of_curve: IntArray, curve: float, view: float) -> float:
    """Nats, of the lines by which curves are off having these sigmas, against their being none, at the pose as it is.

    sums : (g, 2, 3), see :func:`.alignment.add_to_line`; of_curve : (g,)
    """
    total = 0.0
    whole = np.zeros((of_curve.max() + 1, 2, 3))
    for g in range(len(sums)):
        c = of_curve[g]
        if c < 0:
            continue
        own = sums[g].copy()
        if view > 0.0:
            total += _without_line(own, view)
        whole[c] += own
    if curve > 0.0:
        for c in range(len(whole)):
            if whole[c, 0, 1] > 0.0:
                total += _without_line(whole[c], curve)
    return total


@njit(nogil=True)
def _without_line(sums: FloatArray, sigma: float) -> float:
    """Take a line of sigma out of sums (2, 3), in place: the log of how much likelier it makes them."""
    p, q, r = inverse_of_line(sums, sigma)
    given = line_of(sums, sigma)
    gain: float = 0.5 * (given[0, 0] * sums[0, 0] + given[1, 0] * sums[1, 0])
    gain += 0.5 * math.log(max(p * r - q * q, NOT_ZERO**2)) - math.log(sigma * sigma)
    take_line(sums, given)
    return gain


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
    whole, alone, turned : (c, 2, 3 + m), (c, 2, 2), (c, 2, m) float64
        Of each curve: its sums less what single views take of them; the covariance of its line when the pose is known,
        and how that turns with the unknowns.
    """

    shared: FloatArray
    own: FloatArray
    whole: FloatArray
    alone: FloatArray
    turned: FloatArray


@njit(nogil=True)
def _expected(sums: FloatArray, of_curve: IntArray, curve: float, view: float, lines: _Lines) -> tuple[float, float]:
    """Fill in the lines; the sigmas that are next, none more than that of steps that are fitted at all.

    sums : (g, 2, 3 + m), see :func:`_sigmas`; of_curve : (g,); curve, view : sigmas before
    """
    most, whole, alone, turned = len(lines.whole), lines.whole, lines.alone, lines.turned
    whole[:] = 0.0
    for g in range(len(sums)):
        if of_curve[g] < 0:
            continue
        own, rest = sums[g], whole[of_curve[g]]
        p, q, r = inverse_of_line(own, view)
        for j in range(whole.shape[2]):
            first, second = p * own[0, j] + q * own[1, j], q * own[0, j] + r * own[1, j]
            rest[0, j] += own[0, j] - own[0, 1] * first - own[0, 2] * second
            rest[1, j] += own[1, j] - own[1, 1] * first - own[1, 2] * second
    squares, curves = 0.0, 0
    for c in range(most):
        if whole[c, 0, 1] <= 0.0:
            lines.shared[c] = 0.0
            continue
        alone[c, 0, 0], alone[c, 0, 1], alone[c, 1, 1] = inverse_of_line(whole[c], curve)
        alone[c, 1, 0] = alone[c, 0, 1]
        for i in range(2):
            line = alone[c, i, 0] * whole[c, 0, 0] + alone[c, i, 1] * whole[c, 1, 0]
            lines.shared[c, i] = line
            squares += line * line + alone[c, i, i]
            for j in range(turned.shape[2]):
                by_pose = -alone[c, i, 0] * whole[c, 0, 3 + j] - alone[c, i, 1] * whole[c, 1, 3 + j]
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
            first = here * own[0, 1] + other * own[1, 1]
            second = here * own[0, 2] + other * own[1, 2]
            besides = here * own[0, 0] + other * own[1, 0]
            besides -= first * lines.shared[c, 0] + second * lines.shared[c, 1]
            lines.own[g, i] = besides
            squares += besides * besides + (p if i == 0 else r)
            squares += first * first * alone[c, 0, 0] + 2.0 * first * second * alone[c, 0, 1]
            squares += second * second * alone[c, 1, 1]
            for j in range(turned.shape[2]):
                by_pose = here * own[0, 3 + j] + other * own[1, 3 + j]
                by_pose += first * turned[c, 0, j] + second * turned[c, 1, j]
                squares += by_pose * by_pose
        views += 1
    return min(common, FARTHEST_STEP), min(math.sqrt(squares / max(2 * views, 1)), FARTHEST_STEP)
