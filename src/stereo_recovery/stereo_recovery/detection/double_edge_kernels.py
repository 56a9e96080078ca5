"""Compiled fit of two parallel-ish steps to the gradient across an edge, for :mod:`.profiles`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

# Profiles reach so far to either side of the edge, pixels, in steps of so much; an edge is cut into so many sections.
REACH = 4.0
STEP = 0.5
SECTIONS = 4
ROUNDS = 12


@njit
def sample(gx, gy, cx, cy, tx, ty, low, high):
    """Mean gradient across the line in sections of its length.

    gx, gy : (h, w) float32; the line's centre, unit direction, and the part of it that counts, pixels.
    Returns profile (SECTIONS, m) float64, grey levels per pixel along the normal (-ty, tx), and the sections' places.
    """
    m = int(round(2.0 * REACH / STEP)) + 1
    profile, place = np.zeros((SECTIONS, m)), np.zeros(SECTIONS)
    h, w = gx.shape
    nx, ny = -ty, tx
    count = np.zeros(SECTIONS)
    steps = max(SECTIONS, int(high - low))
    for k in range(steps):
        s = low + (k + 0.5) * (high - low) / steps
        section = min(SECTIONS - 1, k * SECTIONS // steps)
        count[section] += 1.0
        place[section] += s
        for i in range(m):
            x = -REACH + i * STEP
            u = min(max(cx + s * tx + x * nx, 0.0), w - 1.001)
            v = min(max(cy + s * ty + x * ny, 0.0), h - 1.001)
            x0, y0 = int(u), int(v)
            fu, fv = u - x0, v - y0
            a, b, c, d = (1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv
            dx = a * gx[y0, x0] + b * gx[y0, x0 + 1] + c * gx[y0 + 1, x0] + d * gx[y0 + 1, x0 + 1]
            dy = a * gy[y0, x0] + b * gy[y0, x0 + 1] + c * gy[y0 + 1, x0] + d * gy[y0 + 1, x0 + 1]
            profile[section, i] += dx * nx + dy * ny
    for k in range(SECTIONS):
        place[k] /= count[k]
        for i in range(m):
            profile[k, i] /= count[k]
    return profile, place


@njit
def _model(profile, place, width, p, matrix, vector):
    """Squared residual of parameters p (height of the first and second step, place and slope of the first, place and
    slope of the second relative to it); fills the normal equations."""
    matrix[:] = 0.0
    vector[:] = 0.0
    total = 0.0
    row = np.zeros(6)
    norm = 1.0 / (np.sqrt(2.0 * np.pi) * width)
    for k in range(profile.shape[0]):
        s = place[k]
        first = p[2] + p[3] * s
        second = first + p[4] + p[5] * s
        for i in range(profile.shape[1]):
            x = -REACH + i * STEP
            a, b = (x - first) / width, (x - second) / width
            ga, gb = norm * np.exp(-0.5 * a * a), norm * np.exp(-0.5 * b * b)
            residual = profile[k, i] - p[0] * ga - p[1] * gb
            row[0], row[1] = ga, gb
            da, db = p[0] * ga * a / width, p[1] * gb * b / width
            row[2] = da + db
            row[3] = s * row[2]
            row[4] = db
            row[5] = s * db
            total += residual * residual
            for m in range(6):
                vector[m] += row[m] * residual
                for n in range(m + 1):
                    matrix[m, n] += row[m] * row[n]
    for m in range(6):
        for n in range(m):
            matrix[n, m] = matrix[m, n]
    return total


@njit
def _descend(profile, place, width, p, free):
    """Levenberg-Marquardt over the parameters named in free; returns the squared residual."""
    matrix, vector = np.zeros((6, 6)), np.zeros(6)
    cost = _model(profile, place, width, p, matrix, vector)
    damping = 1e-2
    for _ in range(ROUNDS):
        a = np.zeros((len(free), len(free)))
        b = np.zeros(len(free))
        for m in range(len(free)):
            b[m] = vector[free[m]]
            for n in range(len(free)):
                a[m, n] = matrix[free[m], free[n]]
            a[m, m] = a[m, m] * (1.0 + damping) + 1e-9
        step = np.linalg.solve(a, b)
        trial = p.copy()
        for m in range(len(free)):
            trial[free[m]] += step[m]
        other, other_vector = np.zeros((6, 6)), np.zeros(6)
        new = _model(profile, place, width, trial, other, other_vector)
        if new < cost and abs(trial[2]) < REACH and abs(trial[2] + trial[4]) < REACH + 1.0:
            done = cost - new < 1e-6 * cost
            p[:] = trial
            cost, matrix, vector = new, other, other_vector
            damping *= 0.3
            if done:
                break
        else:
            damping *= 5.0
    return cost


@njit
def two_steps(profile, place, width):
    """The two steps that explain profiles across an edge best, and one step that does.

    width : pixels, standard deviation of a blurred step. Returns parameters (6,), see :func:`_model`, their squared
    residual, that of one step, and the inverse of the normal matrix (6, 6).
    """
    half = 0.5 * (place[-1] - place[0])
    one = np.zeros(6)
    m = profile.shape[1] // 2
    one[0] = profile[:, m].mean() * np.sqrt(2.0 * np.pi) * width
    single = _descend(profile, place, width, one, np.array([0, 2, 3]))
    best, cost = one.copy(), np.inf
    for gap in (-2.5, -1.2, 1.2, 2.5):
        for share in (-0.5, 0.5):
            p = one.copy()
            p[1], p[4] = share * one[0], gap
            # First with the gap as it is, then parallel, then all.
            _descend(profile, place, width, p, np.array([0, 1, 2, 3]))
            _descend(profile, place, width, p, np.array([0, 1, 2, 3, 4]))
            value = _descend(profile, place, width, p, np.array([0, 1, 2, 3, 4, 5]))
            if value < cost and abs(p[5]) * half < 3.0:
                best, cost = p.copy(), value
    matrix, vector = np.zeros((6, 6)), np.zeros(6)
    _model(profile, place, width, best, matrix, vector)
    for k in range(6):
        matrix[k, k] = matrix[k, k] * (1.0 + 1e-9) + 1e-9
    return best, cost, single, np.linalg.inv(matrix)
