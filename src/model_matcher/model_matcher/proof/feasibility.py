"""Minimax feasibility: whether a set of pairings has a common pose.

fit_one accepts a pairing when a few residuals, each divided by its tolerance, are at most one: the distances of an
edge's end points (or a curve's centre) from the model line, its shift along the line over the room it has there, its
tilt. The minimax pose has the smallest largest residual of all poses; it is approached by minimising sums of ever
higher powers. For any weights that sum to one, the smallest weighted sum of squares is a lower bound of the square of
the minimax residual, and the bound is tight for the weights of a high power. A set whose bound is above one has no pose
that explains it (linear programming duality in its least-squares form: Lawson's algorithm for Chebyshev
approximation).

A pairing has four blocks of residuals: across the model line at one end and at the other, along it, and tilt.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, ByteArray, FloatArray, Int8Array, Int32Array, IntArray

from ..geometry.back_projection import fit_one
from ..geometry.features import CURVE, DataFeatures, FeatureRows
from ..geometry.least_squares import damp, normal_equations, solve6
from ..geometry.rigid_motion import compose_small, inverse_rotate, inverse_transform, perpendiculars, transform_line
from ..geometry.settings import NOT_ZERO, ROUNDING, SMALLEST_LENGTH, WIDEST_CONE
from .settings import MINIMAX, SMALL_TURN, SUBSETS

INFEASIBLE, FEASIBLE, OPEN = range(3)
# Blocks of residuals of a pairing, and how many there are.
FIRST_END, SECOND_END, ALONG, TILT, BLOCKS = range(5)


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
    """Residuals over their tolerances as functions of a small motion s (6,): values - jacobian s; a block has two."""

    jacobian: FloatArray  # (b, 2, 6)
    values: FloatArray  # (b, 2)


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
    return _Residuals(np.empty((blocks, 2, 6)), np.empty((blocks, 2)))


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
    motion: FloatArray, centre: FloatArray, a: int, i: int, sample: Sample, residuals: _Residuals, first: int
) -> None:
    """The residuals of a on i and their derivatives at a motion (12,), into blocks ``first``... of ``residuals``."""
    m, d = sample.model[i], sample.data[a]
    rows, values = residuals.jacobian, residuals.values
    ux, uy, uz, mx, my, mz = transform_line(motion, m)
    ex, ey, ez, fx, fy, fz = perpendiculars(ux, uy, uz)
    curve = sample.kinds[a] == CURVE
    c = ux * d[3] + uy * d[4] + uz * d[5]
    for block in range(BLOCKS):
        at = first + block
        for k in range(2):
            values[at, k] = 0.0
            for p in range(6):
                rows[at, k, p] = 0.0
        if block == TILT:
            scale = (1.0 if c >= 0.0 else -1.0) / np.sin(min(sample.tolerances[a, 2], WIDEST_CONE))
            for k in range(2):
                ax, ay, az = (ex, ey, ez) if k == 0 else (fx, fy, fz)
                values[at, k] = scale * (ax * d[3] + ay * d[4] + az * d[5])
                scaled = abs(scale)
                rows[at, k, 0] = scaled * (uy * az - uz * ay)
                rows[at, k, 1] = scaled * (uz * ax - ux * az)
                rows[at, k, 2] = scaled * (ux * ay - uy * ax)
            continue
        if block == SECOND_END and curve:
            continue
        across = block != ALONG
        step = 0.0 if curve or not across else d[6] if block == FIRST_END else -d[6]
        x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
        along = (x - mx) * ux + (y - my) * uy + (z - mz) * uz
        qx, qy, qz = mx + along * ux, my + along * uy, mz + along * uz
        if across:
            scale = 1.0 / sample.tolerances[a, 0]
        else:
            scale = 1.0 / max(m[6] + sample.tolerances[a, 1] - abs(c) * d[6], SMALLEST_LENGTH)
            qx, qy, qz = mx, my, mz
        gx, gy, gz = qx - centre[0], qy - centre[1], qz - centre[2]
        for k in range(2 if across else 1):
            ax, ay, az = (ux, uy, uz) if not across else (ex, ey, ez) if k == 0 else (fx, fy, fz)
            values[at, k] = scale * (ax * (x - qx) + ay * (y - qy) + az * (z - qz))
            if not across:
                # Turning the line by w moves the shift along it by w x u . (x - m) as well.
                gx, gy, gz = x - centre[0], y - centre[1], z - centre[2]
            rows[at, k, 0] = scale * (gy * az - gz * ay)
            rows[at, k, 1] = scale * (gz * ax - gx * az)
            rows[at, k, 2] = scale * (gx * ay - gy * ax)
            rows[at, k, 3], rows[at, k, 4], rows[at, k, 5] = scale * ax, scale * ay, scale * az


@njit
def _linearise_all(
    motion: FloatArray, centre: FloatArray, a: IntArray, i: IntArray, sample: Sample, residuals: _Residuals
) -> None:
    """The residuals of pairings a on i (m,), BLOCKS blocks for each."""
    for k in range(len(a)):
        _linearise(motion, centre, a[k], i[k], sample, residuals, BLOCKS * k)


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
def _newton(residuals: _Residuals, squares: FloatArray, worst: float, power: float, at: FloatArray, fit: _Fit) -> float:
    """One Newton step for the sum of powers of the squares (b,), from a step ``at`` (6,); fills ``fit``.

    Returns the least weighted sum of squares over the sum of weights, -1 when nothing can be solved.
    """
    rows = residuals.jacobian
    normal, curved = np.zeros((6, 6)), np.zeros((6, 6))
    right, gradient = np.zeros(6), np.empty(6)
    cost = total = 0.0
    for b in range(len(squares)):
        weight = (squares[b] / worst) ** (power - 1.0)
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
    if not solve6(normal, right, fit.to_lowest) or not solve6(curved, right, fit.to_flattest):
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
def minimax_pose(motion: FloatArray, a: IntArray, i: IntArray, sample: Sample, weights: FloatArray) -> int:
    """Whether some pose near ``motion`` (12,) lays data features a (m,) on model features i (m,) within tolerances.

    FEASIBLE, with the pose in ``motion``; INFEASIBLE, with the weight of each pairing in that bound in weights (m,); or
    OPEN.
    """
    m = len(a)
    blocks = BLOCKS * m
    residuals, squares, step = _room_for(blocks), np.empty(blocks), np.empty(6)
    fit = _Fit(np.empty(blocks), np.empty(6), np.empty(6))
    centre = _centroid(sample, a)
    lever = 0.0  # of a turn, over the tolerance
    for k in range(m):
        far = 0.0
        for axis in range(3):
            far += (sample.data[a[k], axis] - centre[axis]) ** 2
        lever = max(lever, (np.sqrt(far) + sample.data[a[k], 6]) / sample.tolerances[a[k], 0])
    for _ in range(MINIMAX.linearisations):
        _linearise_all(motion, centre, a, i, sample, residuals)
        step[:] = 0.0
        worst = _squared_norms(residuals, step, squares)
        if worst <= 1.0:
            return FEASIBLE
        for level in range(MINIMAX.powers):
            power = 2.0**level
            for _ in range(MINIMAX.newton if level > 0 else 1):
                bound = _newton(residuals, squares, worst, power, step, fit)
                if bound < 0.0:
                    return OPEN
                lowest = fit.to_lowest
                turned = (step[0] + lowest[0]) ** 2 + (step[1] + lowest[1]) ** 2 + (step[2] + lowest[2]) ** 2
                if bound > 1.0 and turned < SMALL_TURN**2 and bound > (1.0 + 0.5 * turned * lever) ** 2:
                    total = fit.weights.sum()
                    for k in range(m):
                        weights[k] = fit.weights[BLOCKS * k : BLOCKS * k + BLOCKS].sum() / total
                    return INFEASIBLE
                worst, gained = _line_search(residuals, squares, worst, power, step, fit.to_flattest)
                if worst <= MINIMAX.below_one or gained < MINIMAX.least_gain:
                    break
            if worst <= MINIMAX.below_one:
                break
        compose_small(motion, centre, step)
    _linearise_all(motion, centre, a, i, sample, residuals)
    step[:] = 0.0
    return FEASIBLE if _squared_norms(residuals, step, squares) <= 1.0 else OPEN


@njit
def deviations(motion: FloatArray, a: IntArray, i: IntArray, sample: Sample) -> FloatArray:
    """(m,) the largest residual of each pairing a on i (m,) under a pose; the pairing fits up to 1."""
    residuals, centre = _room_for(BLOCKS), np.zeros(3)
    out = np.zeros(len(a))
    for k in range(len(a)):
        _linearise(motion, centre, a[k], i[k], sample, residuals, 0)
        for b in range(BLOCKS):
            out[k] = max(out[k], residuals.values[b, 0] ** 2 + residuals.values[b, 1] ** 2)
    return np.sqrt(out)


class _Ellipsoid(NamedTuple):
    """Where the pose of a set may be: about ``lowest`` (6,), a step, by no more than ``room`` in the metric of inverse.

    Attributes
    ----------
    inverse : (6, 6)
        Of the mean normal matrix.
    turn
        Radians, the largest turn in there, of meaning when ``solved``.
    """

    lowest: FloatArray
    inverse: FloatArray
    room: float
    turn: float
    solved: bool


@njit
def _reachable(motion: FloatArray, centre: FloatArray, a: IntArray, i: IntArray, sample: Sample) -> _Ellipsoid:
    """The ellipsoid of the poses that may lay all a on i (m,) within tolerances.

    Under such a pose the mean of the squared residuals is at most one.
    """
    blocks = BLOCKS * len(a)
    residuals, squares = _room_for(blocks), np.empty(blocks)
    fit, step = _Fit(np.empty(blocks), np.zeros(6), np.zeros(6)), np.zeros(6)
    _linearise_all(motion, centre, a, i, sample, residuals)
    worst = max(_squared_norms(residuals, step, squares), NOT_ZERO)
    lowest_mean = _newton(residuals, squares, worst, 1.0, step, fit)
    normal = np.zeros((6, 6))
    for b in range(blocks):
        for k in range(2):
            for p in range(6):
                for q in range(6):
                    normal[p, q] += residuals.jacobian[b, k, p] * residuals.jacobian[b, k, q] / blocks
    damp(normal)
    inverse = np.empty((6, 6))
    solved = lowest_mean >= 0.0
    for p in range(6):
        step[:] = 0.0
        step[p] = 1.0
        solved = solved and solve6(normal, step, inverse[p])
    room = max(1.0 - lowest_mean, 0.0)
    lowest = fit.to_lowest
    turn = np.sqrt(lowest[0] ** 2 + lowest[1] ** 2 + lowest[2] ** 2)
    if solved:
        turn += np.sqrt(room * (inverse[0, 0] + inverse[1, 1] + inverse[2, 2]))
    return _Ellipsoid(lowest, inverse, room, turn, solved)


@njit
def _misses_everywhere(residuals: _Residuals, ellipsoid: _Ellipsoid, bent: float) -> bool:
    """Whether a block of residuals (BLOCKS of them) is above one for every pose of the ellipsoid.

    bent : what the second order of the largest turn may take from a residual
    """
    for b in range(BLOCKS):
        lowered = reach = 0.0
        for row in range(2):
            value = residuals.values[b, row]
            for p in range(6):
                value -= residuals.jacobian[b, row, p] * ellipsoid.lowest[p]
                for q in range(6):
                    reach += residuals.jacobian[b, row, p] * ellipsoid.inverse[p, q] * residuals.jacobian[b, row, q]
            lowered += value * value
        if np.sqrt(lowered) - np.sqrt(ellipsoid.room * reach) > 1.0 + bent:
            return True
    return False


@njit
def can_join(
    motion: FloatArray, a: IntArray, i: IntArray, others_a: IntArray, others_i: IntArray, least: int, sample: Sample
) -> BoolArray:
    """(c,) bool: which pairings others_a on others_i may share a pose with the set a on i, whose pose is ``motion``.

    None when they are of fewer than ``least`` data features; those of one data feature stand together in others_a.
    A pairing that misses its tolerance under every pose that the set may have is refused at once; one that misses it
    only at ``motion`` is tried together with the set.
    """
    m = len(a)
    out = np.zeros(len(others_a), np.bool_)
    centre = _centroid(sample, a)
    ellipsoid = _reachable(motion, centre, a, i, sample)
    residuals, turn = _room_for(BLOCKS), ellipsoid.turn
    all_a, all_i, unused = np.empty(m + 1, np.int64), np.empty(m + 1, np.int64), np.empty(m + 1)
    all_a[:m], all_i[:m] = a, i
    spare = -least
    for k in range(len(others_a)):
        spare += k == 0 or others_a[k] != others_a[k - 1]
    joins = False
    for k in range(len(others_a)):
        x = others_a[k]
        if k > 0 and x != others_a[k - 1]:
            spare -= not joins
            if spare < 0:
                out[:] = False
                return out
            joins = False
        _linearise(motion, centre, x, others_i[k], sample, residuals, 0)
        far = 0.0
        for axis in range(3):
            far += (sample.data[x, axis] - centre[axis]) ** 2
        bent = 0.5 * turn * turn * (np.sqrt(far) + sample.data[x, 6]) / sample.tolerances[x, 0]
        linear = ellipsoid.solved and turn < SMALL_TURN
        out[k] = not (linear and _misses_everywhere(residuals, ellipsoid, bent))
        if out[k] and not _fits_here(residuals):
            all_a[m], all_i[m] = x, others_i[k]
            out[k] = minimax_pose(motion.copy(), all_a, all_i, sample, unused) != INFEASIBLE
        joins = joins or out[k]
    return out


@njit
def _fits_here(residuals: _Residuals) -> bool:
    """Whether all blocks of one pairing are at most one at the pose where they were linearised."""
    fits = True
    for b in range(BLOCKS):
        fits = fits and residuals.values[b, 0] ** 2 + residuals.values[b, 1] ** 2 <= 1.0
    return fits


@njit
def infeasible_subset(motion: FloatArray, a: IntArray, i: IntArray, weights: FloatArray, sample: Sample) -> IntArray:
    """Numbers of few of the pairings a on i (m,), an infeasible set, that are infeasible already.

    weights : (m,) as minimax_pose leaves them; the heaviest are tried first. A small subset is made minimal: without
    any one of its pairings it would not be infeasible.
    """
    m = len(a)
    order = np.argsort(-weights)
    unused = np.empty(m)
    size = min(3, m)
    while size < m:
        if minimax_pose(motion.copy(), a[order[:size]], i[order[:size]], sample, unused[:size]) == INFEASIBLE:
            break
        size += 1 if size < SUBSETS.few else SUBSETS.several if size < SUBSETS.many else m
    chosen = order[: min(size, m)].copy()
    k = len(chosen) - 1
    while k >= 0 and len(chosen) > 2 and len(chosen) <= SUBSETS.minimal:
        fewer = np.concatenate((chosen[:k], chosen[k + 1 :]))
        if minimax_pose(motion.copy(), a[fewer], i[fewer], sample, unused[: len(fewer)]) == INFEASIBLE:
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
    normal, right, step, centre = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros(3)
    matched = 0
    for k in range(n):
        if assignment[k] >= 0:
            matched += 1
            for axis in range(3):
                centre[axis] += data[k, axis]
    centre /= max(matched, 1)
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
        if not solve6(normal, right, step):
            break
        compose_small(motion, centre, step)
