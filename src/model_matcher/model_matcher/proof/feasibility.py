"""Feasibility: whether a set of pairings has a common pose among those whose rotation is near a given one.

fit_one accepts a pairing when a few residuals, each divided by its tolerance, are at most one: the distances of an
edge's end points (or a curve's centre) from the model line, its shift along the line over the room it has there, its
tilt. Linearised in a step of the pose they are off by half the square of the turn times a lever, at most, whatever the
pose. What is shown here holds for every pose of a region (docs/proof.md has the lemmas):

* Squares with any weights have a weighted mean of at most one under a feasible pose, but for that. Where it is larger
  under every step, the set is infeasible. As it rises with the turn by more than residuals bend, regions can be
  large; how all of them bend together is known to the second order of the turn. The weights of sums of high powers
  come near the best ones: linear programming duality in its least-squares form (Lawson's algorithm for Chebyshev
  approximation).
* Otherwise it bounds the steps of feasible poses, and the region shrinks.

A pairing has four blocks of residuals: across the model line at one end and at the other, along it, and tilt. A region
is a motion (12,) and a turn, radians: all poses whose rotation is not farther than that from the motion's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray, Int8Array, Int32Array, IntArray

from ..geometry.back_projection import fit_one
from ..geometry.features import CURVE, DataFeatures, FeatureRows
from ..geometry.least_squares import damp, normal_equations, solve_positive
from ..geometry.rigid_motion import compose_small, inverse_rotate, inverse_transform, perpendiculars, transform_line
from ..geometry.settings import NOT_ZERO, RIGHT_ANGLE, ROUNDING, SMALLEST_LENGTH, WIDEST_CONE
from .settings import MINIMAX, REGIONS, SUBSETS
from .spares import Groups, left_out, spare_features

INFEASIBLE, FEASIBLE, OPEN = range(3)
# Blocks of residuals of a pairing, and how many there are.
FIRST_END, SECOND_END, ALONG, TILT, BLOCKS = range(5)
# The motion that leaves all where it is.
_STILL = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


class Sample(NamedTuple):
    """Data and model as the kernels of the proof take them.

    Attributes
    ----------
    data : (n, 9)
        Rows of model.index.feature_rows, camera frame, metres.
    kinds : (n,) uint8
    tolerances : (n, 3)
        Metres across, metres along, radians of the direction's cone.
    model : (e, 9)
        Rows in the model frame.
    """

    data: FloatArray
    kinds: ByteArray
    tolerances: FloatArray
    model: FloatArray


class _Residuals(NamedTuple):
    """Residuals over their tolerances as functions of a step s (6,) that turns by t: a block has two.

    They are values - jacobian s to first order, and t bend t / 2 is the second.

    Attributes
    ----------
    jacobian : (b, 2, 6)
    values : (b, 2)
    bends : (b, 2, 6)
        Rows of the lower triangle of a symmetric matrix (3, 3).
    levers : (b,)
        Half of this times the square of a turn is what its second order may do to a residual, a sixth times the cube
        what is beyond.
    own : (b,)
        The tolerance that is divided by, over that at the pose of linearisation itself; 0 for what a curve has not.
    """

    jacobian: FloatArray
    values: FloatArray
    bends: FloatArray
    levers: FloatArray
    own: FloatArray


class _Fit(NamedTuple):
    """What a Newton step finds.

    Attributes
    ----------
    weights : (b,)
        Of the blocks.
    to_lowest, to_flattest : (6,)
        Steps to the least weighted sum of squares and towards the least sum of powers.
    """

    weights: FloatArray
    to_lowest: FloatArray
    to_flattest: FloatArray


@njit
def _room_for(blocks: int) -> _Residuals:
    """Uninitialised residuals of so many blocks."""
    rows, bends = np.empty((blocks, 2, 6)), np.empty((blocks, 2, 6))
    return _Residuals(rows, np.empty((blocks, 2)), bends, np.empty(blocks), np.empty(blocks))


@njit
def _turned(nx: float, ny: float, nz: float, x: float, y: float, z: float, row: FloatArray, bend: FloatArray) -> None:
    """What a turn t does to n exp(-t) y: less row t to first order, and t B t / 2 to the second (lemma 5).

    row : its first three numbers are filled; bend : (6,) the lower triangle of B
    """
    row[0], row[1], row[2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
    straight = nx * x + ny * y + nz * z
    bend[0], bend[2], bend[5] = nx * x - straight, ny * y - straight, nz * z - straight
    bend[1], bend[3], bend[4] = 0.5 * (nx * y + ny * x), 0.5 * (nx * z + nz * x), 0.5 * (ny * z + nz * y)


@njit
def _centroid(sample: Sample, a: IntArray) -> FloatArray:
    """(3,) mean of the mid points of data features a (m,), metres; turns are about it."""
    centre = np.zeros(3)
    m = len(a)
    for k in range(m):
        for axis in range(3):
            centre[axis] += sample.data[a[k], axis] / m
    return centre


@njit
def _linearise(
    motion: FloatArray,
    turn: float,
    centre: FloatArray,
    a: int,
    i: int,
    sample: Sample,
    residuals: _Residuals,
    first: int,
) -> float:
    """The residuals of a on i and their derivatives in a region, into blocks ``first``... of ``residuals``.

    A step turns the model about ``centre``, after it has shifted it. Returns by how much that shift may differ from
    none, metres, under a pose of the region that explains the pairing.
    """
    m, d = sample.model[i], sample.data[a]
    rows, values = residuals.jacobian, residuals.values
    ux, uy, uz, mx, my, mz = transform_line(motion, m)
    ex, ey, ez, fx, fy, fz = perpendiculars(ux, uy, uz)
    curve = sample.kinds[a] == CURVE
    cone = min(sample.tolerances[a, 2], WIDEST_CONE)
    c = abs(ux * d[3] + uy * d[4] + uz * d[5])
    upright = np.cos(cone)  # no less than the cosine of the tilt under any feasible pose
    if turn < RIGHT_ANGLE:
        upright = max(upright, c * np.cos(turn) - np.sqrt(max(1.0 - c * c, 0.0)) * np.sin(turn))
    slack = ROUNDING * (1.0 + abs(d[0]) + abs(d[1]) + abs(d[2]))
    room = 0.0
    for at in range(first, first + BLOCKS):
        values[at], rows[at], residuals.bends[at] = 0.0, 0.0, 0.0
        residuals.levers[at] = residuals.own[at] = 0.0
    for block in (FIRST_END, SECOND_END, ALONG):
        at = first + block
        if block == SECOND_END and curve:
            continue
        step = 0.0 if curve or block == ALONG else d[6] if block == FIRST_END else -d[6]
        x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
        gx, gy, gz = x - centre[0], y - centre[1], z - centre[2]
        if block == ALONG:
            room = max(m[6] + sample.tolerances[a, 1] - upright * d[6], 0.0) + slack
            here, widest = m[6] + sample.tolerances[a, 1] - c * d[6], room
        else:
            here, widest = sample.tolerances[a, 0], sample.tolerances[a, 0] + slack
        residuals.levers[at] = np.sqrt(gx * gx + gy * gy + gz * gz) / widest
        residuals.own[at] = widest / max(here, SMALLEST_LENGTH)
        for k in range(1 if block == ALONG else 2):
            ax, ay, az = (ux, uy, uz) if block == ALONG else (ex, ey, ez) if k == 0 else (fx, fy, fz)
            ax, ay, az = ax / widest, ay / widest, az / widest
            values[at, k] = ax * (x - mx) + ay * (y - my) + az * (z - mz)
            _turned(ax, ay, az, gx, gy, gz, rows[at, k], residuals.bends[at, k])
            rows[at, k, 3], rows[at, k, 4], rows[at, k, 5] = ax, ay, az
    at, widest = first + TILT, np.sin(cone) + ROUNDING
    residuals.levers[at], residuals.own[at] = 1.0 / widest, widest / np.sin(cone)
    for k in range(2):
        ax, ay, az = (ex, ey, ez) if k == 0 else (fx, fy, fz)
        ax, ay, az = ax / widest, ay / widest, az / widest
        values[at, k] = ax * d[3] + ay * d[4] + az * d[5]
        _turned(ax, ay, az, d[3], d[4], d[5], rows[at, k], residuals.bends[at, k])
    gx, gy, gz = d[0] - centre[0], d[1] - centre[1], d[2] - centre[2]
    away = np.sqrt((d[0] - mx) ** 2 + (d[1] - my) ** 2 + (d[2] - mz) ** 2)
    lever = np.sqrt(gx * gx + gy * gy + gz * gz)
    return float(away + room + sample.tolerances[a, 0] + slack + min(turn, 2.0) * lever)


@njit
def _linearise_all(
    motion: FloatArray, turn: float, centre: FloatArray, a: IntArray, i: IntArray, sample: Sample, residuals: _Residuals
) -> float:
    """The residuals of pairings a on i (m,), BLOCKS blocks for each. Returns how far a pose of all may be shifted."""
    shift = np.inf
    for k in range(len(a)):
        shift = min(shift, _linearise(motion, turn, centre, a[k], i[k], sample, residuals, BLOCKS * k))
    return shift


@njit
def _confine(turn: float, residuals: _Residuals, first: int) -> None:
    """Two blocks more: no component of a step turns farther than the region does, radians."""
    for at in range(first, first + 2):
        residuals.jacobian[at], residuals.values[at], residuals.bends[at] = 0.0, 0.0, 0.0
        residuals.levers[at], residuals.own[at] = 0.0, 1.0
    for p in range(3):
        residuals.jacobian[first + p // 2, p % 2, p] = 1.0 / (turn + ROUNDING)


@njit
def _squared_norms(residuals: _Residuals, step: FloatArray, out: FloatArray) -> float:
    """Squared length of each block's residuals after a step (6,), into out (b,); returns the largest."""
    worst = 0.0
    for b in range(len(out)):
        square = 0.0
        for k in range(2):
            value = residuals.values[b, k]
            for p in range(6):
                value -= residuals.jacobian[b, k, p] * step[p]
            square += value * value
        out[b] = square
        worst = max(worst, square)
    return worst


@njit
def _fits_here(residuals: _Residuals) -> bool:
    """Whether all blocks are within their own tolerances at the pose where they were linearised."""
    for b in range(len(residuals.own)):
        square = residuals.values[b, 0] ** 2 + residuals.values[b, 1] ** 2
        if square * residuals.own[b] ** 2 > 1.0:
            return False
    return True


@njit
def _normal_of(residuals: _Residuals, weights: FloatArray, normal: FloatArray) -> None:
    """The normal matrix (6, 6) of weighted blocks."""
    normal[:] = 0.0
    rows = residuals.jacobian
    for b in range(len(weights)):
        for k in range(2):
            for p in range(6):
                for q in range(p + 1):
                    normal[p, q] += weights[b] * rows[b, k, p] * rows[b, k, q]
    for p in range(6):
        for q in range(p):
            normal[q, p] = normal[p, q]


class _Bound(NamedTuple):
    """What weights say of the feasible steps s of a region: (s - lowest) normal (s - lowest) <= room.

    Attributes
    ----------
    lowest : (6,)
        Where the weighted sum is least, nearly; nothing relies on how nearly.
    normal, inverse : (6, 6)
        inverse is nearly that of normal; nothing relies on how nearly.
    room
        Of no meaning when ``reach`` is negative.
    turn, shift
        Radians and metres, the largest components of s - lowest of a pose of the region.
    reach
        Radians, the largest turn of a feasible step; -1 when there is none.
    radius
        Radians, the largest turn from the lowest step to a feasible one.
    """

    lowest: FloatArray
    normal: FloatArray
    inverse: FloatArray
    room: float
    turn: float
    shift: float
    reach: float
    radius: float


@njit
def _growth(normal: FloatArray, inverse: FloatArray, turn: float, shift: float) -> tuple[float, float]:
    """Numbers (square, rest): a step d of the region turns by no more than sqrt(square x d normal d) + rest (lemma 7).

    With Y, the first rows of any matrix, the turn of d is (P - Y normal) d + Y normal d, P taking the turn of a step; Y
    is that of the inverse, so that the first part is rounding. The second is at most the square root of the largest
    eigenvalue of Y normal Y^T, times that of d normal d.
    """
    first = inverse[:3]
    image = first @ normal
    rest = 0.0
    for p in range(3):
        for q in range(6):
            rest += abs((1.0 if p == q else 0.0) - image[p, q]) * (turn if q < 3 else shift)
    spread = image @ first.T
    mean = (spread[0, 0] + spread[1, 1] + spread[2, 2]) / 3.0
    aside = 0.0
    for p in range(3):
        for q in range(3):
            aside += (spread[p, q] - (mean if p == q else 0.0)) ** 2
    # No eigenvalue of a symmetric 3 x 3 matrix is farther from their mean (Wolkowicz and Styan, 1980).
    return (mean + np.sqrt(aside * 2.0 / 3.0)) * (1.0 + ROUNDING), rest


@njit
def _length(vector: FloatArray) -> float:
    """Of a vector (3,)."""
    return float(np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2))


@njit
def _least_eigenvalue(lower: FloatArray) -> float:
    """A lower bound of the eigenvalues of a symmetric matrix (3, 3); the rows of its lower triangle are given (6,)."""
    mean = (lower[0] + lower[2] + lower[5]) / 3.0
    aside = (lower[0] - mean) ** 2 + (lower[2] - mean) ** 2 + (lower[5] - mean) ** 2
    aside += 2.0 * (lower[1] ** 2 + lower[3] ** 2 + lower[4] ** 2)
    return float(mean - np.sqrt(aside * 2.0 / 3.0) * (1.0 + ROUNDING) - ROUNDING * abs(mean))


@njit
def _solved(
    residuals: _Residuals, weights: FloatArray, normal: FloatArray, inverse: FloatArray, lowest: FloatArray
) -> bool:
    """Fill the normal matrix of weighted squares, nearly its inverse and nearly the step where their sum is least."""
    _normal_of(residuals, weights, normal)
    damped, right = normal.copy(), np.zeros(6)
    damp(damped)
    for b in range(len(weights)):
        for k in range(2):
            for p in range(6):
                right[p] += weights[b] * residuals.jacobian[b, k, p] * residuals.values[b, k]
    unit = np.empty(6)
    solved: bool = solve_positive(damped, right, lowest)
    for p in range(6):
        unit[:] = 0.0
        unit[p] = 1.0
        solved = solved and solve_positive(damped, unit, inverse[p])
    if not solved:
        lowest[:], inverse[:] = 0.0, 0.0
    return solved


@njit
def _bound(residuals: _Residuals, weights: FloatArray, turn: float, shift: float) -> _Bound:
    """What weights (b,) of the squares say of the feasible steps of a region (lemmas 6 and 7).

    Under a feasible pose that turns by t the weighted sum is at most that of (1 + levers t^2 / 2)^2. It lies above its
    tangent at any step by the normal matrix' form, and so grows with the turn. What t may be is looked at in slices.
    """
    lowest, slope, normal, inverse = np.zeros(6), np.zeros(6), np.empty((6, 6)), np.zeros((6, 6))
    solved = _solved(residuals, weights, normal, inverse, lowest)
    total = levers = squares = cost = 0.0
    bend = np.zeros(6)
    for b in range(len(weights)):
        total += weights[b]
        levers += weights[b] * residuals.levers[b]
        squares += 0.25 * weights[b] * residuals.levers[b] ** 2
        for k in range(2):
            value = residuals.values[b, k]
            for p in range(6):
                value -= residuals.jacobian[b, k, p] * lowest[p]
            cost += weights[b] * value * value
            for p in range(6):
                slope[p] += 2.0 * weights[b] * value * residuals.jacobian[b, k, p]
                bend[p] += weights[b] * value * residuals.bends[b, k, p]
    far = _length(lowest[:3])
    most_turn, most_shift = turn + far, shift + _length(lowest[3:])
    for p in range(6):
        cost -= abs(slope[p]) * (most_turn if p < 3 else most_shift)
    square, rest, grown = 0.0, np.inf, 0.0
    if solved:
        square, rest = _growth(normal, inverse, most_turn, most_shift)
        grown = 1.0 / max(square, NOT_ZERO**2)
    least = _least_eigenvalue(bend)
    reach, room = -1.0, 0.0
    for k in range(REGIONS.slices):
        low, high = turn * k / REGIONS.slices, turn * (k + 1) / REGIONS.slices
        rises = np.sqrt(grown) * max(low - far - rest, 0.0)
        # By the first order, and by the second.
        allowed = (total + levers * high**2 + squares * high**4) * (1.0 + ROUNDING) - cost
        bent = (total + levers * high**3 / 3.0 + squares * high**6 / 9.0) * (1.0 + ROUNDING) - cost
        bent -= least * (high if least < 0.0 else low) ** 2
        room_here = min(allowed, (np.sqrt(max(bent, 0.0)) + np.sqrt(squares) * high**2) ** 2)
        if bent < 0.0 or room_here < 0.0 or rises**2 > room_here:
            continue
        reach, room = high, max(room, room_here)
    radius = min(np.sqrt(square * room) + rest, reach + far)
    return _Bound(lowest, normal, inverse, room, most_turn, most_shift, reach, radius)


@njit
def _newton(residuals: _Residuals, squares: FloatArray, worst: float, power: float, at: FloatArray, fit: _Fit) -> float:
    """One Newton step for the sum of powers of the squares (b,), from a step ``at`` (6,); fills ``fit``.

    Returns the least weighted sum of squares over the sum of weights, -1 when nothing can be solved.
    """
    rows = residuals.jacobian
    normal, curved = np.zeros((6, 6)), np.zeros((6, 6))
    right, gradient = np.zeros(6), np.empty(6)
    cost = total = 0.0
    for b in range(len(squares)):
        weight = (squares[b] / worst) ** (power - 1.0) if residuals.own[b] > 0.0 else 0.0
        fit.weights[b] = weight
        total += weight
        cost += weight * squares[b]
        # So light a residual changes the normal matrix by rounding.
        if weight < ROUNDING:
            continue
        gradient[:] = 0.0
        for k in range(2):
            value = residuals.values[b, k]
            for p in range(6):
                value -= rows[b, k, p] * at[p]
            for p in range(6):
                gradient[p] += rows[b, k, p] * value
                for q in range(p + 1):
                    normal[p, q] += weight * rows[b, k, p] * rows[b, k, q]
        bend = 2.0 * (power - 1.0) * weight / max(squares[b], 1e-300)
        for p in range(6):
            right[p] += weight * gradient[p]
            for q in range(p + 1):
                curved[p, q] += bend * gradient[p] * gradient[q]
    damp(normal)
    for p in range(6):
        for q in range(p + 1):
            curved[p, q] += normal[p, q]
            curved[q, p], normal[q, p] = curved[p, q], normal[p, q]
    if not solve_positive(normal, right, fit.to_lowest) or not solve_positive(curved, right, fit.to_flattest):
        return -1.0
    for p in range(6):
        cost -= fit.to_lowest[p] * right[p]
    return cost / total


@njit
def _line_search(
    residuals: _Residuals, squares: FloatArray, worst: float, power: float, step: FloatArray, direction: FloatArray
) -> tuple[float, float]:
    """Go from a step (6,) along a direction as far as the sum of powers falls, at first the whole way.

    Changes step and squares (b,); returns the largest square and the part by which the sum has fallen, 0 when it has
    not.
    """
    blocks = len(squares)
    further, tried = np.empty(6), np.empty(blocks)
    before = 0.0
    for b in range(blocks):
        before += (squares[b] / worst) ** power
    length = 1.0
    while length > MINIMAX.shortest:
        for p in range(6):
            further[p] = step[p] + length * direction[p]
        now = _squared_norms(residuals, further, tried)
        after = 0.0
        for b in range(blocks):
            after += (tried[b] / worst) ** power
        if after < before:
            step[:] = further
            squares[:] = tried
            return now, 1.0 - after / before
        length *= MINIMAX.shorter
    return worst, 0.0


@njit
def _bent(residuals: _Residuals, step: FloatArray) -> float:
    """The most that a squared residual of one may be linearly, when it is bent by as much as a step (6,) does."""
    return float((1.0 + 0.5 * residuals.levers.max() * _length(step[:3]) ** 2) ** 2)


@njit
def _approach(residuals: _Residuals, step: FloatArray, turn: float, shift: float, fit: _Fit) -> bool:
    """Change a step (6,) towards the least largest residual; True when no pose of the region is feasible.

    The weights of that are then in ``fit``. turn : negative where nothing is to be refuted; True then only says that
    no pose is likely
    """
    blocks = len(residuals.own)
    squares = np.empty(blocks)
    worst = _squared_norms(residuals, step, squares)
    for level in range(MINIMAX.powers):
        power = 2.0**level
        for _ in range(MINIMAX.newton if level > 0 else 1):
            if worst <= MINIMAX.below_one:
                return False
            bound = _newton(residuals, squares, worst, power, step, fit)
            if bound < 0.0:
                return False
            if turn < 0.0 and bound > 1.0 and bound > _bent(residuals, step + fit.to_lowest):
                return True
            if bound > 1.0 and turn >= 0.0 and _bound(residuals, fit.weights, turn, shift).reach < 0.0:
                return True
            worst, gained = _line_search(residuals, squares, worst, power, step, fit.to_flattest)
            if gained < MINIMAX.least_gain:
                break
        if bound > 1.0 and turn >= 0.0:
            # With some weight on every block the sum rises with the turn in all directions.
            mixed = fit.weights.copy()
            total, count = mixed.sum(), (residuals.own > 0.0).sum()
            for b in range(blocks):
                if residuals.own[b] > 0.0:
                    mixed[b] += REGIONS.mixed * total / count
            if _bound(residuals, mixed, turn, shift).reach < 0.0:
                return True
    return False


@njit
def _follow(motion: FloatArray, centre: FloatArray, step: FloatArray) -> None:
    """The pose (12,) after a step (6,), in place: first the shift, then the turn about the centre."""
    turning = step.copy()
    turning[3:] = 0.0
    motion[9:] += step[3:]
    compose_small(motion, centre, turning)


@njit
def _mean_bound(residuals: _Residuals, turn: float, shift: float) -> _Bound:
    """What the mean of all squares says."""
    weights = np.empty(len(residuals.own))
    for b in range(len(weights)):
        weights[b] = 1.0 if residuals.own[b] > 0.0 else 0.0
    bound: _Bound = _bound(residuals, weights, turn, shift)
    return bound


@njit
def _extent(bound: _Bound, row: FloatArray) -> float:
    """How far row (6,) times a step may be from its value at the lowest one, in the ellipsoid (lemma 7).

    For any vector y, row = (row - normal y) + normal y; with y nearly the inverse times row the first part is rounding.
    """
    y = np.zeros(6)
    for p in range(6):
        for q in range(6):
            y[p] += bound.inverse[p, q] * row[q]
    rest = square = 0.0
    for p in range(6):
        image = 0.0
        for q in range(6):
            image += bound.normal[p, q] * y[q]
        square += y[p] * image
        rest += abs(row[p] - image) * (bound.turn if p < 3 else bound.shift)
    return float(rest + np.sqrt(max(square, 0.0) * max(bound.room, 0.0)))


@njit
def narrow(motion: FloatArray, turn: float, a: IntArray, i: IntArray, sample: Sample) -> float:
    """Shrink a region to where data features a (m,) may lie on model features i (m,), in place.

    Returns its new turn, radians; -1 when there is no such pose in the region.
    """
    residuals, centre = _room_for(BLOCKS * len(a)), _centroid(sample, a)
    for _ in range(REGIONS.narrowings):
        shift = _linearise_all(motion, turn, centre, a, i, sample, residuals)
        bound = _mean_bound(residuals, turn, shift)
        if bound.reach < 0.0:
            return -1.0
        smaller = bound.radius + ROUNDING
        if smaller >= turn:
            turn = min(turn, bound.reach)
            break
        gained = smaller < REGIONS.worthwhile * turn
        _follow(motion, centre, bound.lowest)
        turn = smaller
        if not gained:
            break
    return turn


@njit
def _add_evidence(variance: FloatArray, lead: int, a: int, on_itself: Sample, residuals: _Residuals) -> None:
    """Take into the variance (6, 6) of a step, about a lead's middle, what data feature a on itself says, in place."""
    _linearise(_STILL, 0.0, on_itself.data[lead, :3], a, a, on_itself, residuals, 0)
    gain = np.empty(6)
    for b in range(BLOCKS):
        for k in range(2):
            row = residuals.jacobian[b, k]
            square = 1.0
            for p in range(6):
                gain[p] = 0.0
                for q in range(6):
                    gain[p] += variance[p, q] * row[q]
                square += gain[p] * row[p]
            for p in range(6):
                for q in range(6):
                    variance[p, q] -= gain[p] * gain[q] / square


@njit
def first_variances(features: IntArray, size: float, sample: Sample) -> FloatArray:
    """(m, 6, 6) variances of a step, its turn first, when only one data feature (m,) is known to lie where it should.

    Residuals have their tolerances for sigmas; nothing else is known of the turn but that it is about a radian at most,
    and of the shift but that it is about the model's ``size`` (metres).
    """
    on_itself = Sample(sample.data, sample.kinds, sample.tolerances, sample.data)
    variances, residuals = np.zeros((len(features), 6, 6)), _room_for(BLOCKS)
    for k in range(len(features)):
        for p in range(6):
            variances[k, p, p] = 1.0 if p < 3 else size * size
        _add_evidence(variances[k], features[k], features[k], on_itself, residuals)
    return variances


@njit
def add_steadiest(variance: FloatArray, lead: int, features: IntArray, nodes: IntArray, sample: Sample) -> int:
    """Which of the data features (m,) leaves least: the turn's deviation times its nodes (m,), for each has a region.

    What it says is taken into the variance (6, 6), in place.
    """
    on_itself = Sample(sample.data, sample.kinds, sample.tolerances, sample.data)
    residuals, best, least, steadiest = _room_for(BLOCKS), 0, np.inf, variance
    for k in range(len(features)):
        tried = variance.copy()
        _add_evidence(tried, lead, features[k], on_itself, residuals)
        branches = nodes[k] * np.sqrt(tried[0, 0] + tried[1, 1] + tried[2, 2])
        if branches < least:
            best, least, steadiest = k, branches, tried
    variance[:] = steadiest
    return best


@njit
def _turn_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """(3,) rotation vector, radians below pi, that turns one motion (12,) to another."""
    vector, trace = np.zeros(3), 0.0
    for k in range(9):
        trace += first[k] * second[k]
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        for r in range(3):
            vector[k] += 0.5 * (second[3 * q + r] * first[3 * p + r] - second[3 * p + r] * first[3 * q + r])
    sine = np.sqrt((vector**2).sum())
    if sine < NOT_ZERO:
        return vector
    vector *= np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
    return vector


@njit
def refute(motion: FloatArray, turn: float, a: IntArray, i: IntArray, sample: Sample, weights: FloatArray) -> int:
    """Whether some pose of a region lays data features a (m,) on model features i (m,) within tolerances.

    FEASIBLE, with the pose in ``motion``; INFEASIBLE, with the weight of each pairing in that bound in weights (m,); or
    OPEN. What is linearised where the largest residual is least, is bent least there.
    """
    m = len(a)
    blocks = BLOCKS * m + 2
    residuals, fit = _room_for(blocks), _Fit(np.empty(blocks), np.empty(6), np.empty(6))
    centre, tried, reach = _centroid(sample, a), motion.copy(), turn
    for _ in range(MINIMAX.linearisations):
        shift = _linearise_all(tried, reach, centre, a, i, sample, residuals)
        _confine(reach, residuals, BLOCKS * m)
        if _fits_here(residuals):
            motion[:] = tried
            return FEASIBLE
        step = np.zeros(6)
        if _approach(residuals, step, reach, shift, fit):
            total = fit.weights.sum()
            for k in range(m):
                weights[k] = fit.weights[BLOCKS * k : BLOCKS * k + BLOCKS].sum() / total
            return INFEASIBLE
        _follow(tried, centre, step)
        reach += _length(step[:3]) + ROUNDING
        if (step**2).sum() < MINIMAX.settled**2:
            break
    return OPEN


@njit
def _widest(motion: FloatArray, turn: float, a: IntArray, i: IntArray, sample: Sample) -> float:
    """How many times its own the most widened tolerance across of pairings a on i (m,) is."""
    residuals, centre = _room_for(BLOCKS), _centroid(sample, a)
    widest = 0.0
    for k in range(len(a)):
        _linearise(motion, turn, centre, a[k], i[k], sample, residuals, 0)
        widest = max(widest, 1.0 + 0.5 * residuals.levers[FIRST_END] * turn * turn)
    return widest


@njit
def narrow_in_parts(motion: FloatArray, turn: float, a: IntArray, i: IntArray, sample: Sample) -> float:
    """As :func:`narrow`; where tolerances are still widened much, the parts of the region are shrunk one by one.

    The new region is a ball about what is left of them (lemma 8).
    """
    turn = narrow(motion, turn, a, i, sample)
    centre, step = _centroid(sample, a), np.zeros(6)
    count = REGIONS.across**3
    places, turns, unused = np.empty((count, 3)), np.empty(count), np.empty(len(a))
    # Turns between parts stay far below half a revolution, where a rotation vector would not be one.
    while 0.0 < turn <= 1.0 and _widest(motion, turn, a, i, sample) > REGIONS.widened:
        half = turn / REGIONS.across
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        left = 0
        for part in range(count):
            for p in range(3):
                step[p] = (2 * (part // REGIONS.across**p % REGIONS.across) + 1) * half - turn
            pose = motion.copy()
            _follow(pose, centre, step)
            turns[left] = narrow(pose, np.sqrt(3.0) * half + ROUNDING, a, i, sample)
            if turns[left] >= 0.0 and refute(pose.copy(), turns[left], a, i, sample, unused) != INFEASIBLE:
                places[left] = _turn_between(motion, pose)
                low, high = np.minimum(low, places[left] - turns[left]), np.maximum(high, places[left] + turns[left])
                left += 1
        if left == 0:
            return -1.0
        step[:3] = 0.5 * (low + high)
        around = 0.0
        for part in range(left):
            around = max(around, np.sqrt(((places[part] - step[:3]) ** 2).sum()) + turns[part])
        if around > REGIONS.worthwhile * turn:
            break
        _follow(motion, centre, step)
        turn = narrow(motion, around + ROUNDING, a, i, sample)
    return turn


@njit
def common_pose(motion: FloatArray, a: IntArray, i: IntArray, sample: Sample) -> bool:
    """Whether a pose is found, starting from ``motion``, that lays all a on i (m,) within tolerances; in place."""
    residuals, centre = _room_for(BLOCKS * len(a)), _centroid(sample, a)
    fit = _Fit(np.empty(BLOCKS * len(a)), np.empty(6), np.empty(6))
    for _ in range(MINIMAX.linearisations):
        _linearise_all(motion, 0.0, centre, a, i, sample, residuals)
        if _fits_here(residuals):
            return True
        step = np.zeros(6)
        if _approach(residuals, step, -1.0, np.inf, fit):
            return False
        _follow(motion, centre, step)
    _linearise_all(motion, 0.0, centre, a, i, sample, residuals)
    fits: bool = _fits_here(residuals)
    return fits


@njit
def _halved(cube: FloatArray, turn: float, out: FloatArray) -> int:
    """Those of the eight cubes of half a cube's side that hold turns of a region, into the first rows of out (8, 4).

    cube : (4,) rotation vector of its middle and half its side, radians. Returns how many they are.
    """
    half = 0.5 * cube[3]
    count = 0
    for corner in range(8):
        square = 0.0
        for p in range(3):
            out[count, p] = cube[p] + (half if corner >> p & 1 else -half)
            square += out[count, p] ** 2
        out[count, 3] = half
        count += np.sqrt(square) <= turn + np.sqrt(3.0) * half
    return count


@njit
def search_rotations(motion: FloatArray, turn: float, a: IntArray, i: IntArray, sample: Sample) -> int:
    """As :func:`refute`, in parts: a cube of rotation vectors about the region is halved where it is OPEN (lemma 8)."""
    unused, centre, step = np.empty(len(a)), _centroid(sample, a), np.zeros(6)
    most = max(REGIONS.pairings // len(a), 1)
    # The last of the cubes that wait is looked at, and gives way to its parts.
    stack = np.zeros((8 * (most + 1), 4))
    stack[0, 3] = turn
    waiting = 1
    for _ in range(most):
        waiting -= 1
        cube = stack[waiting].copy()
        step[:3] = cube[:3]
        pose = motion.copy()
        _follow(pose, centre, step)
        part = narrow(pose, min(np.sqrt(3.0) * cube[3] + ROUNDING, np.pi), a, i, sample)
        state = INFEASIBLE if part < 0.0 else refute(pose, part, a, i, sample, unused)
        if state == FEASIBLE:
            motion[:] = pose
            return FEASIBLE
        if state == OPEN:
            waiting += _halved(cube, turn, stack[waiting:])
        if waiting == 0:
            return INFEASIBLE
    return OPEN


@njit
def deviations(motion: FloatArray, a: IntArray, i: IntArray, sample: Sample) -> FloatArray:
    """(m,) the largest residual of each pairing a on i (m,) under a pose; the pairing fits up to 1."""
    residuals, centre = _room_for(BLOCKS), np.zeros(3)
    out = np.zeros(len(a))
    for k in range(len(a)):
        _linearise(motion, 0.0, centre, a[k], i[k], sample, residuals, 0)
        for b in range(BLOCKS):
            square = residuals.values[b, 0] ** 2 + residuals.values[b, 1] ** 2
            out[k] = max(out[k], square * residuals.own[b] ** 2)
    return np.sqrt(out)


@njit
def _misses_everywhere(residuals: _Residuals, bound: _Bound, turn: float) -> bool:
    """Whether a block of residuals (BLOCKS of them) is above one for every pose of the bound."""
    for b in range(BLOCKS):
        lowered = reach = 0.0
        for row in range(2):
            value = residuals.values[b, row]
            for p in range(6):
                value -= residuals.jacobian[b, row, p] * bound.lowest[p]
            lowered += value * value
        limit = 1.0 + 0.5 * residuals.levers[b] * min(turn, bound.reach) ** 2
        if lowered <= limit * limit:
            continue
        for row in range(2):
            reach += _extent(bound, residuals.jacobian[b, row]) ** 2
        if np.sqrt(lowered) - np.sqrt(reach) > limit + ROUNDING:
            return True
    return False


@njit
def can_join(
    motion: FloatArray,
    turn: float,
    a: IntArray,
    i: IntArray,
    others_a: IntArray,
    others_i: IntArray,
    least: int,
    groups: Groups,
    sample: Sample,
) -> BoolArray:
    """(c,) bool: which pairings others_a on others_i may share a pose of a region with the set a on i.

    None when they are of fewer than ``least`` data features, one of each of the groups left out; those of one data
    feature stand together in others_a. A pairing that misses its tolerance under every pose that the set may have is
    refused at once; one that misses it only at ``motion`` is tried together with the set. That takes longer, and is
    done first where a data feature has no other, since too many of these end it.
    """
    m, c = len(a), len(others_a)
    none = np.zeros(c, np.bool_)
    centre, residuals = _centroid(sample, a), _room_for(BLOCKS * m)
    shift = _linearise_all(motion, turn, centre, a, i, sample, residuals)
    bound = _mean_bound(residuals, turn, shift)
    missing = np.empty(len(groups.sizes), np.int64)
    spare = spare_features(a, others_a, least, groups, missing)
    if bound.reach < 0.0 or spare < 0:
        return none
    residuals = _room_for(BLOCKS)
    joins, doubtful = np.zeros(c, np.bool_), np.zeros(c, np.bool_)
    for k in range(c):
        _linearise(motion, turn, centre, others_a[k], others_i[k], sample, residuals, 0)
        joins[k] = _fits_here(residuals)
        doubtful[k] = not joins[k] and not _misses_everywhere(residuals, bound, turn)
    all_a, all_i, unused = np.append(a, 0), np.append(i, 0), np.empty(m + 1)
    for ask in (False, True):
        first = 0
        while first < c:
            x = others_a[first]
            end, any_joins, any_doubtful = first, False, False
            while end < c and others_a[end] == x:
                any_joins, any_doubtful = any_joins or joins[end], any_doubtful or doubtful[end]
                end += 1
            for k in range(first, end if ask else first):
                if any_joins:
                    break
                if doubtful[k]:
                    all_a[m], all_i[m] = x, others_i[k]
                    joins[k] = refute(motion.copy(), turn, all_a, all_i, sample, unused) != INFEASIBLE
                    any_joins, doubtful[k] = joins[k], False
            if not any_joins and any_doubtful == ask:
                spare -= left_out(x, groups, missing)
                if spare < 0:
                    return none
            first = end
    for k in range(c):
        if doubtful[k]:
            all_a[m], all_i[m] = others_a[k], others_i[k]
            joins[k] = refute(motion.copy(), turn, all_a, all_i, sample, unused) != INFEASIBLE
    return joins


@njit
def infeasible_subset(
    motion: FloatArray, turn: float, a: IntArray, i: IntArray, weights: FloatArray, sample: Sample
) -> IntArray:
    """Numbers of few of the pairings a on i (m,), a set infeasible in a region, that are infeasible there already.

    weights : (m,) as refute leaves them; the heaviest are tried first. A small subset is made minimal: without
    any one of its pairings it would not be infeasible.
    """
    m = len(a)
    order = np.argsort(-weights)
    unused = np.empty(m)
    size = min(SUBSETS.least, m)
    while size < m:
        if refute(motion.copy(), turn, a[order[:size]], i[order[:size]], sample, unused[:size]) == INFEASIBLE:
            break
        size += max(size // SUBSETS.growth, 1)
    chosen = order[: min(size, m)].copy()
    k = len(chosen) - 1
    while k >= 0 and len(chosen) > 2 and len(chosen) <= SUBSETS.minimal:
        fewer = np.concatenate((chosen[:k], chosen[k + 1 :]))
        if refute(motion.copy(), turn, a[fewer], i[fewer], sample, unused[: len(fewer)]) == INFEASIBLE:
            chosen = fewer
        k -= 1
    return chosen


@njit
def all_fit(motion: FloatArray, a: IntArray, i: IntArray, sample: Sample, kind_m: ByteArray, radius_tol: float) -> bool:
    """Whether a pose lays every data feature a (m,) on its model feature i (m,), as back-projection counts.

    kind_m : (e,) uint8; radius_tol : metres
    """
    features = DataFeatures(sample.data, sample.kinds, sample.tolerances, radius_tol)
    model = FeatureRows(sample.model, kind_m)
    for k in range(len(a)):
        d = sample.data[a[k]]
        point = inverse_transform(motion, d[0], d[1], d[2])
        direction = inverse_rotate(motion, d[3], d[4], d[5])
        if fit_one(a[k], features, i[k], model, point, direction, 1.0 + ROUNDING) < 0.0:
            return False
    return True


@njit
def least_squares_pose(motion: FloatArray, assignment: Int32Array, sign: Int8Array, sample: Sample) -> None:
    """Least-squares pose of an assignment (n,), in place. Fills sign (n,)."""
    data, model = sample.data, sample.model
    n = data.shape[0]
    normal, right, step = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    centre = _centroid(sample, np.flatnonzero(assignment >= 0))
    features = DataFeatures(data, sample.kinds, sample.tolerances, 0.0)
    for _ in range(MINIMAX.newton):
        for k in range(n):
            sign[k] = 0
            if assignment[k] >= 0:
                m, d = model[assignment[k]], data[k]
                c = 0.0
                for p in range(3):
                    for q in range(3):
                        c += d[3 + p] * motion[3 * p + q] * m[3 + q]
                sign[k] = 1 if c >= 0.0 else -1
        normal_equations(motion, model, features, assignment, sign, centre, normal, right)
        damp(normal)
        if not solve_positive(normal, right, step):
            break
        compose_small(motion, centre, step)
