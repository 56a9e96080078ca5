"""Compiled fit of two nearly parallel steps to the gradient across an edge, for :mod:`.double_edges`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray, IntArray

from .sampling import clamped
from .settings import (
    BEYOND_PROFILE,
    CONVERGED,
    DAMPING,
    DAMPING_DOWN,
    DAMPING_UP,
    LEAST_GAP,
    MOST_GAP,
    MOST_ITERATIONS,
    MOST_SPREAD,
    NORMAL_RIDGE,
    PROFILE_HALF_LENGTH,
    PROFILE_STEP,
    SECTIONS,
)


@njit(nogil=True)
def sample(
    gx: Float32Array,
    gy: Float32Array,
    centre: tuple[float, float],
    direction: tuple[float, float],
    low: float,
    high: float,
) -> tuple[FloatArray, FloatArray]:
    """Mean gradient across a line, in sections of its length.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image.
    centre, direction : pair of float
        Of the line: a point, pixels, and its unit direction.
    low, high : float
        Pixels. Abscissas between which the line counts.

    Returns
    -------
    profile : (SECTIONS, m) float64, grey levels per pixel
        Along the normal (-v, u) of the direction.
    abscissa : (SECTIONS,) float64, pixels
        Mean abscissa of each section.
    """
    m = int(round(2.0 * PROFILE_HALF_LENGTH / PROFILE_STEP)) + 1
    profile, abscissa = np.zeros((SECTIONS, m)), np.zeros(SECTIONS)
    (cx, cy), (tx, ty) = centre, direction
    nx, ny = -ty, tx
    count = np.zeros(SECTIONS)
    steps = max(SECTIONS, int(high - low))
    for k in range(steps):
        s = low + (k + 0.5) * (high - low) / steps
        section = min(SECTIONS - 1, k * SECTIONS // steps)
        count[section] += 1.0
        abscissa[section] += s
        for i in range(m):
            x = -PROFILE_HALF_LENGTH + i * PROFILE_STEP
            u, v = cx + s * tx + x * nx, cy + s * ty + x * ny
            profile[section, i] += clamped(gx, u, v) * nx + clamped(gy, u, v) * ny
    for k in range(SECTIONS):
        abscissa[k] /= count[k]
        for i in range(m):
            profile[k, i] /= count[k]
    return profile, abscissa


@njit
def _model(
    profile: FloatArray, abscissa: FloatArray, width: float, p: FloatArray, matrix: FloatArray, vector: FloatArray
) -> float:
    """Squared residual of parameters p (see :func:`two_steps`); fills the normal equations.

    profile, abscissa : see :func:`sample`; width : pixels; matrix (6, 6), vector (6,) : overwritten
    """
    matrix[:] = 0.0
    vector[:] = 0.0
    total = 0.0
    row = np.zeros(6)
    norm = 1.0 / (np.sqrt(2.0 * np.pi) * width)
    for k in range(profile.shape[0]):
        s = abscissa[k]
        first = p[2] + p[3] * s
        second = first + p[4] + p[5] * s
        for i in range(profile.shape[1]):
            x = -PROFILE_HALF_LENGTH + i * PROFILE_STEP
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
def _descend(profile: FloatArray, abscissa: FloatArray, width: float, p: FloatArray, free: IntArray) -> float:
    """Levenberg-Marquardt over the parameters with the numbers in ``free``, in place; returns the squared residual."""
    matrix, vector = np.zeros((6, 6)), np.zeros(6)
    cost: float = _model(profile, abscissa, width, p, matrix, vector)
    damping = DAMPING
    for _ in range(MOST_ITERATIONS):
        a = np.zeros((len(free), len(free)))
        b = np.zeros(len(free))
        for m in range(len(free)):
            b[m] = vector[free[m]]
            for n in range(len(free)):
                a[m, n] = matrix[free[m], free[n]]
            a[m, m] = a[m, m] * (1.0 + damping) + NORMAL_RIDGE
        step = np.linalg.solve(a, b)
        trial = p.copy()
        for m in range(len(free)):
            trial[free[m]] += step[m]
        other, other_vector = np.zeros((6, 6)), np.zeros(6)
        new = _model(profile, abscissa, width, trial, other, other_vector)
        if (
            new < cost
            and abs(trial[2]) < PROFILE_HALF_LENGTH
            and abs(trial[2] + trial[4]) < PROFILE_HALF_LENGTH + BEYOND_PROFILE
        ):
            done = cost - new < CONVERGED * cost
            p[:] = trial
            cost, matrix, vector = new, other, other_vector
            damping *= DAMPING_DOWN
            if done:
                break
        else:
            damping *= DAMPING_UP
    return cost


@njit(nogil=True)
def two_steps(profile: FloatArray, abscissa: FloatArray, width: float) -> tuple[FloatArray, float, float, FloatArray]:
    """The two steps that explain profiles across an edge best, and one step that does.

    Parameters
    ----------
    profile, abscissa
        See :func:`sample`.
    width : float
        Pixels. Standard deviation of a blurred step.

    Returns
    -------
    p : (6,) float64
        Heights of the first and the second step, grey levels; offset, pixels, and slope of the first; the same of the
        second, less those of the first.
    cost, single : float
        Squared residuals of the two steps and of the one.
    inverse : (6, 6) float64
        Inverse of the normal matrix at p.
    """
    half = 0.5 * (abscissa[-1] - abscissa[0])
    one = np.zeros(6)
    m = profile.shape[1] // 2
    one[0] = profile[:, m].mean() * np.sqrt(2.0 * np.pi) * width
    single = _descend(profile, abscissa, width, one, np.array([0, 2, 3]))
    best = _start(profile, width)
    best[3] = one[3]
    cost = _descend(profile, abscissa, width, best, np.array([0, 1, 2, 3, 4]))
    parallel, parallel_cost = best.copy(), cost
    cost = _descend(profile, abscissa, width, best, np.array([0, 1, 2, 3, 4, 5]))
    if abs(best[5]) * half >= MOST_SPREAD:
        best, cost = parallel, parallel_cost
    matrix, vector = np.zeros((6, 6)), np.zeros(6)
    _model(profile, abscissa, width, best, matrix, vector)
    for k in range(6):
        matrix[k, k] = matrix[k, k] * (1.0 + NORMAL_RIDGE) + NORMAL_RIDGE
    inverse: AnyArray = np.linalg.inv(matrix)
    return best, cost, single, inverse


@njit
def _start(profile: FloatArray, width: float) -> FloatArray:
    """(6,) parameters of the two steps, at sampled places, that explain the mean profile best; the higher first.

    With their places given the heights are linear least squares.
    """
    samples = profile.shape[1]
    mean = np.zeros(samples)
    for k in range(profile.shape[0]):
        mean += profile[k] / profile.shape[0]
    norm = 1.0 / (np.sqrt(2.0 * np.pi) * width)
    shape, product = np.empty((samples, samples)), np.empty(samples)
    for j in range(samples):
        for i in range(samples):
            shape[j, i] = norm * np.exp(-0.5 * ((i - j) * PROFILE_STEP / width) ** 2)
        product[j] = np.sum(shape[j] * mean)
    best, p = -1.0, np.zeros(6)
    for j in range(samples):
        for k in range(j + int(LEAST_GAP / PROFILE_STEP), min(samples, j + int(MOST_GAP / PROFILE_STEP) + 1)):
            own, other, both = np.sum(shape[j] ** 2), np.sum(shape[k] ** 2), np.sum(shape[j] * shape[k])
            determinant = own * other - both * both
            a = (other * product[j] - both * product[k]) / determinant
            b = (own * product[k] - both * product[j]) / determinant
            explained = a * product[j] + b * product[k]
            if explained > best:
                best = explained
                first, second = (j, k) if abs(a) >= abs(b) else (k, j)
                p[0], p[1] = (a, b) if abs(a) >= abs(b) else (b, a)
                p[2] = (first - samples // 2) * PROFILE_STEP
                p[4] = (second - first) * PROFILE_STEP
    return p
