"""Whether a set of pairings has a common pose: the bounds of the proof.

What fit_one asks of a pairing is that a few numbers, each divided by its tolerance, stay below one: the distances of an
edge's end points (or a curve's centre) from the model line, its shift along it over the room it has there, its tilt.
The bound is minimax: of all poses, the one whose largest such number is smallest. It is approached by minimising sums
of ever higher powers. For any weights that sum to one, the smallest weighted sum of squares is a lower bound of its
square, tight for the weights of a high power; a set whose bound is above one has no pose that explains it.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.kernels import CURVE, fit_one
from ..geometry.least_squares import across_line, apply_step, normal_equations, placed_line, solve6

FEASIBLE, INFEASIBLE, OPEN = 1, 0, 2
BLOCKS = 4  # groups of numbers that a pairing has
LINEARISED = 4  # times that the numbers are linearised anew
POWERS = 10  # 2, 4, 8, ...
NEWTON = 8  # steps for each at most
SMALL_TURN = 0.3  # radians: what is linear in the pose is so for smaller steps, up to second order, which is added
ENOUGH = 12  # pairings that a conflict is looked for among, at first
FITS = 8  # Gauss-Newton steps of a fit


@njit
def _numbers(motion, centre, a, i, data, kind_d, tols, model, rows, values, first):
    """The numbers of a on i, linearised about a pose, into blocks ``first``... of rows (b, 2, 6) and values (b, 2).

    A block's number is the length of its values: across at one end and the other, along, tilt.
    """
    m, d = model[i], data[a]
    ux, uy, uz, mx, my, mz = placed_line(motion, m)
    ex, ey, ez, fx, fy, fz = across_line(ux, uy, uz)
    curve = kind_d[a] == CURVE
    c = ux * d[3] + uy * d[4] + uz * d[5]
    for block in range(BLOCKS):
        at = first + block
        for k in range(2):
            values[at, k] = 0.0
            for p in range(6):
                rows[at, k, p] = 0.0
        if block == 3:
            scale = (1.0 if c >= 0.0 else -1.0) / np.sin(min(tols[a, 2], 1.2))
            for k in range(2):
                ax, ay, az = (ex, ey, ez) if k == 0 else (fx, fy, fz)
                values[at, k] = scale * (ax * d[3] + ay * d[4] + az * d[5])
                scaled = abs(scale)
                rows[at, k, 0] = scaled * (uy * az - uz * ay)
                rows[at, k, 1] = scaled * (uz * ax - ux * az)
                rows[at, k, 2] = scaled * (ux * ay - uy * ax)
            continue
        if block == 1 and curve:
            continue
        across = block < 2
        step = 0.0 if curve or not across else d[6] if block == 0 else -d[6]
        x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
        along = (x - mx) * ux + (y - my) * uy + (z - mz) * uz
        qx, qy, qz = mx + along * ux, my + along * uy, mz + along * uz
        if across:
            scale = 1.0 / tols[a, 0]
        else:
            scale = 1.0 / max(m[6] + tols[a, 1] - abs(c) * d[6], 1e-9)
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
def _squares(rows, values, step, out):
    """Squares of the blocks' numbers after a step (6,), into out; returns the largest."""
    worst = 0.0
    for b in range(len(out)):
        square = 0.0
        for k in range(2):
            value = values[b, k]
            for p in range(6):
                value -= rows[b, k, p] * step[p]
            square += value * value
        out[b] = square
        worst = max(worst, square)
    return worst


@njit
def _newton(rows, values, squares, worst, power, at, shares, to_lowest, to_flattest):
    """At a step ``at``: shares of the blocks for a power, and the further steps to the weighted sum's minimum and
    towards the power sum's. Returns the weighted minimum over the sum of shares, -1 when nothing can be solved."""
    normal, curved = np.zeros((6, 6)), np.zeros((6, 6))
    right, pulls = np.zeros(6), np.empty(6)
    cost = total = 0.0
    for b in range(len(squares)):
        share = (squares[b] / worst) ** (power - 1.0)
        shares[b] = share
        total += share
        cost += share * squares[b]
        if share < 1e-9:
            continue
        pulls[:] = 0.0
        for k in range(2):
            value = values[b, k]
            for p in range(6):
                value -= rows[b, k, p] * at[p]
            for p in range(6):
                pulls[p] += rows[b, k, p] * value
                for q in range(p + 1):
                    normal[p, q] += share * rows[b, k, p] * rows[b, k, q]
        bend = 2.0 * (power - 1.0) * share / max(squares[b], 1e-300)
        for p in range(6):
            right[p] += share * pulls[p]
            for q in range(p + 1):
                curved[p, q] += bend * pulls[p] * pulls[q]
    trace = 0.0
    for p in range(6):
        trace += normal[p, p]
    for p in range(6):
        normal[p, p] += 1e-9 * trace
        for q in range(p + 1):
            curved[p, q] += normal[p, q]
            curved[q, p], normal[q, p] = curved[p, q], normal[p, q]
    if not solve6(normal, right, to_lowest) or not solve6(curved, right, to_flattest):
        return -1.0
    for p in range(6):
        cost -= to_lowest[p] * right[p]
    return cost / total


@njit
def common_pose(motion, a, i, data, kind_d, tols, model, weights):
    """Whether some pose near ``motion`` lays data features a (m,) on model features i (m,) within their tolerances.

    FEASIBLE, with the pose in ``motion``; INFEASIBLE, with each pairing's part in that in weights (m,); or OPEN.
    """
    m = len(a)
    blocks = BLOCKS * m
    rows, values = np.empty((blocks, 2, 6)), np.empty((blocks, 2))
    shares, squares, tried = np.empty(blocks), np.empty(blocks), np.empty(blocks)
    centre = np.zeros(3)
    for k in range(m):
        for axis in range(3):
            centre[axis] += data[a[k], axis] / m
    lever = 0.0  # of a turn, over the tolerance
    for k in range(m):
        far = 0.0
        for axis in range(3):
            far += (data[a[k], axis] - centre[axis]) ** 2
        lever = max(lever, (np.sqrt(far) + data[a[k], 6]) / tols[a[k], 0])
    step, lowest, flattest, further = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for _ in range(LINEARISED):
        for k in range(m):
            _numbers(motion, centre, a[k], i[k], data, kind_d, tols, model, rows, values, BLOCKS * k)
        step[:] = 0.0
        worst = _squares(rows, values, step, squares)
        if worst <= 1.0:
            return FEASIBLE
        for level in range(POWERS):
            power = 2.0**level
            for _ in range(NEWTON if level > 0 else 1):
                bound = _newton(rows, values, squares, worst, power, step, shares, lowest, flattest)
                if bound < 0.0:
                    return OPEN
                turned = (step[0] + lowest[0]) ** 2 + (step[1] + lowest[1]) ** 2 + (step[2] + lowest[2]) ** 2
                if bound > 1.0 and turned < SMALL_TURN**2 and bound > (1.0 + 0.5 * turned * lever) ** 2:
                    total = shares.sum()
                    for k in range(m):
                        weights[k] = shares[BLOCKS * k : BLOCKS * k + BLOCKS].sum() / total
                    return INFEASIBLE
                # As far as the power sum falls, at first the whole step.
                before = 0.0
                for b in range(blocks):
                    before += (squares[b] / worst) ** power
                length = 1.0
                gained = 0.0
                while length > 0.02:
                    for p in range(6):
                        further[p] = step[p] + length * flattest[p]
                    now = _squares(rows, values, further, tried)
                    after = 0.0
                    for b in range(blocks):
                        after += (tried[b] / worst) ** power
                    if after < before:
                        gained = 1.0 - after / before
                        step[:] = further
                        squares[:] = tried
                        worst = now
                        break
                    length *= 0.4
                if worst <= 0.999 or gained < 0.002:
                    break
            if worst <= 0.999:
                break
        apply_step(motion, centre, step)
    for k in range(m):
        _numbers(motion, centre, a[k], i[k], data, kind_d, tols, model, rows, values, BLOCKS * k)
    step[:] = 0.0
    return FEASIBLE if _squares(rows, values, step, squares) <= 1.0 else OPEN


@njit
def deviations(motion, a, i, data, kind_d, tols, model):
    """(m,) the largest number of each pairing under a pose: it fits up to 1."""
    rows, values, centre = np.empty((BLOCKS, 2, 6)), np.empty((BLOCKS, 2)), np.zeros(3)
    out = np.zeros(len(a))
    for k in range(len(a)):
        _numbers(motion, centre, a[k], i[k], data, kind_d, tols, model, rows, values, 0)
        for b in range(BLOCKS):
            out[k] = max(out[k], values[b, 0] ** 2 + values[b, 1] ** 2)
    return np.sqrt(out)


@njit
def can_join(motion, a, i, others_a, others_i, least, data, kind_d, tols, model):
    """(c,) bool: which pairings others_a on others_i may share a pose with the set a on i, whose pose is ``motion``.

    None when they are of fewer than ``least`` data features; those of one data feature stand together in others_a.

    Poses of the set lie in an ellipsoid, because the mean square of its numbers is below one; what misses its
    tolerance everywhere in there is refused at once, and what misses it at ``motion`` is tried together with the set.
    """
    m = len(a)
    blocks = BLOCKS * m
    out = np.zeros(len(others_a), np.bool_)
    rows, values = np.empty((blocks, 2, 6)), np.empty((blocks, 2))
    shares, squares = np.empty(blocks), np.empty(blocks)
    centre, step, lowest, flattest = np.zeros(3), np.zeros(6), np.zeros(6), np.zeros(6)
    for k in range(m):
        for axis in range(3):
            centre[axis] += data[a[k], axis] / m
    normal = np.zeros((6, 6))
    for k in range(m):
        _numbers(motion, centre, a[k], i[k], data, kind_d, tols, model, rows, values, BLOCKS * k)
    worst = max(_squares(rows, values, step, squares), 1e-12)
    lowest_mean = _newton(rows, values, squares, worst, 1.0, step, shares, lowest, flattest)
    for b in range(blocks):
        for k in range(2):
            for p in range(6):
                for q in range(6):
                    normal[p, q] += rows[b, k, p] * rows[b, k, q] / blocks
    trace = 0.0
    for p in range(6):
        trace += normal[p, p]
    for p in range(6):
        normal[p, p] += 1e-9 * trace
    inverse = np.empty((6, 6))
    solved = lowest_mean >= 0.0
    for p in range(6):
        step[:] = 0.0
        step[p] = 1.0
        solved = solved and solve6(normal, step, inverse[p])
    room = max(1.0 - lowest_mean, 0.0)
    turn = np.sqrt(lowest[0] ** 2 + lowest[1] ** 2 + lowest[2] ** 2)
    if solved:
        turn += np.sqrt(room * (inverse[0, 0] + inverse[1, 1] + inverse[2, 2]))
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
        _numbers(motion, centre, x, others_i[k], data, kind_d, tols, model, rows, values, 0)
        out[k] = True
        fits = True
        far = 0.0
        for axis in range(3):
            far += (data[x, axis] - centre[axis]) ** 2
        bent = 0.5 * turn * turn * (np.sqrt(far) + data[x, 6]) / tols[x, 0]
        for b in range(BLOCKS):
            here = lowered = reach = 0.0
            for row in range(2):
                value = values[b, row]
                here += value * value
                for p in range(6):
                    value -= rows[b, row, p] * lowest[p]
                    for q in range(6):
                        reach += rows[b, row, p] * inverse[p, q] * rows[b, row, q]
                lowered += value * value
            fits = fits and here <= 1.0
            if solved and turn < SMALL_TURN and np.sqrt(lowered) - np.sqrt(room * reach) > 1.0 + bent:
                out[k] = False
                break
        if out[k] and not fits:
            all_a[m], all_i[m] = x, others_i[k]
            out[k] = common_pose(motion.copy(), all_a, all_i, data, kind_d, tols, model, unused) != INFEASIBLE
        joins = joins or out[k]
    return out


@njit
def conflict(motion, a, i, weights, data, kind_d, tols, model):
    """Few of the pairings a on i (m,), a set without a common pose, that have none already: their numbers.

    weights : (m,) as common_pose leaves them; the heaviest are tried first, then what is not needed is left out
    """
    m = len(a)
    order = np.argsort(-weights)
    unused = np.empty(m)
    size = min(3, m)
    while size < m:
        if (
            common_pose(motion.copy(), a[order[:size]], i[order[:size]], data, kind_d, tols, model, unused[:size])
            == INFEASIBLE
        ):
            break
        size += 1 if size < 8 else 4 if size < 24 else m
    chosen = order[: min(size, m)].copy()
    k = len(chosen) - 1
    while k >= 0 and len(chosen) > 2 and len(chosen) <= ENOUGH:
        fewer = np.concatenate((chosen[:k], chosen[k + 1 :]))
        if (
            common_pose(motion.copy(), a[fewer], i[fewer], data, kind_d, tols, model, unused[: len(fewer)])
            == INFEASIBLE
        ):
            chosen = fewer
        k -= 1
    return chosen


@njit
def all_fit(motion, a, i, data, kind_d, tols, model, kind_m, radius_tol):
    """Whether a pose lays every data feature a (m,) on its model feature i (m,), as back-projection counts."""
    for k in range(len(a)):
        d = data[a[k]]
        x, y, z = d[0] - motion[9], d[1] - motion[10], d[2] - motion[11]
        px = motion[0] * x + motion[3] * y + motion[6] * z
        py = motion[1] * x + motion[4] * y + motion[7] * z
        pz = motion[2] * x + motion[5] * y + motion[8] * z
        vx = motion[0] * d[3] + motion[3] * d[4] + motion[6] * d[5]
        vy = motion[1] * d[3] + motion[4] * d[4] + motion[7] * d[5]
        vz = motion[2] * d[3] + motion[5] * d[4] + motion[8] * d[5]
        if fit_one(a[k], data, kind_d, tols, i[k], model, kind_m, px, py, pz, vx, vy, vz, 1.0 + 1e-9, radius_tol) < 0.0:
            return False
    return True


@njit
def fit(motion, assignment, sign, data, kind_d, tols, model, normal, figures):
    """Least-squares pose of an assignment (n,), in place.

    Fills sign (n,), normal (6, 6) and figures: rms (metres), weighted cost per equation, centre x, y, z.
    """
    n = data.shape[0]
    right, step, centre = np.zeros(6), np.zeros(6), np.zeros(3)
    matched = 0
    for k in range(n):
        if assignment[k] >= 0:
            matched += 1
            for axis in range(3):
                centre[axis] += data[k, axis]
    centre /= max(matched, 1)
    for turn in range(FITS + 1):
        for k in range(n):
            sign[k] = 0
            if assignment[k] >= 0:
                m, d = model[assignment[k]], data[k]
                c = 0.0
                for p in range(3):
                    for q in range(3):
                        c += d[3 + p] * motion[3 * p + q] * m[3 + q]
                sign[k] = 1 if c >= 0.0 else -1
        cost, equations, squares, points = normal_equations(
            motion, model, data, kind_d, tols, assignment, sign, centre, normal, right
        )
        figures[0], figures[1] = np.sqrt(squares / max(points, 1)), cost / max(equations - 6, 1)
        if turn == FITS:
            break
        trace = 0.0
        for p in range(6):
            trace += normal[p, p]
        for p in range(6):
            normal[p, p] += 1e-9 * trace
        if not solve6(normal, right, step):
            break
        apply_step(motion, centre, step)
    figures[2], figures[3], figures[4] = centre
