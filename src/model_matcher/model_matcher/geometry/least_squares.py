"""Compiled refinement of a pose: point-to-line Gauss-Newton on the data assigned to it.

Rows of features, tolerances and motions as in features.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int8Array, Int32Array

from .back_projection import assign
from .features import CURVE, DataFeatures, ModelFeatures
from .rigid_motion import compose_small, perpendiculars, transform_line
from .settings import NOT_ZERO, ROUNDING, SMALLEST_LENGTH, UNIFORM_ANGLE


@njit
def cholesky(a: FloatArray, n: int, low: FloatArray) -> bool:
    """Fill the lower half of ``low`` with the Cholesky factor of the first n rows of a; both may be one array.

    Returns whether a is positive definite; ``low`` is without meaning when it is not.
    """
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                low[i, i] = np.sqrt(total)
            else:
                low[i, j] = total / low[j, j]
    return True


@njit
def solve_positive(a: FloatArray, b: FloatArray, x: FloatArray) -> bool:
    """Solve a x = b by Cholesky's decomposition.

    Parameters
    ----------
    a : (n, n) float64
        Symmetric; its lower half is read.
    b : (n,) float64
    x : (n,) float64
        Filled with the solution.

    Returns
    -------
    bool
        False when a is not positive definite; x is then without meaning.

    Examples
    --------
    >>> x = np.empty(6)
    >>> solve_positive(4.0 * np.eye(6), np.ones(6), x), x.tolist()
    (True, [0.25, 0.25, 0.25, 0.25, 0.25, 0.25])

    """
    n = len(b)
    low = np.zeros((n, n))
    if not cholesky(a, n, low):
        return False
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= low[i, k] * x[k]
        x[i] = total / low[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= low[k, i] * x[k]
        x[i] = total / low[i, i]
    return True


@njit
def add_equation(
    normal: FloatArray,
    right: FloatArray,
    gx: float,
    gy: float,
    gz: float,
    ex: float,
    ey: float,
    ez: float,
    residual: float,
    weight: float,
) -> None:
    """Add one equation, derivatives by rotation g and translation e, to the lower half of the normal equations."""
    row = (gx, gy, gz, ex, ey, ez)
    for i in range(6):
        right[i] += weight * row[i] * residual
        for j in range(i + 1):
            normal[i, j] += weight * row[i] * row[j]


@njit
def normal_equations(
    motion: FloatArray,
    lines: FloatArray,
    data: DataFeatures,
    assignment: Int32Array,
    sign: Int8Array,
    centre: FloatArray,
    normal: FloatArray,
    right: FloatArray,
) -> tuple[float, int, float, int]:
    """Point-to-line least squares, linearised about a pose.

    Both end points of every data edge or axis must lie on its model line; a curve's centre on the model's centre and
    its normal along the model's. Unknowns: rotation vector about ``centre`` (radians), translation (metres).

    Parameters
    ----------
    motion : (12,) float64
        The pose.
    lines : (e, 9) float64
        The model's features.
    data : DataFeatures
    assignment : (n,) int32
        Model feature of each data feature, or -1.
    sign : (n,) int8
        1 or -1, whether the directions agree.
    centre : (3,) float64
        Camera frame, metres.
    normal : (6, 6) float64
    right : (6,) float64
        Filled with both sides of the equations.

    Returns
    -------
    cost : float
        Weighted sum of squares.
    equations : int
        How many squares that is the sum of.
    squares : float
        Square metres, sum of squared distances.
    points : int
        How many distances that is the sum of.

    """
    rows, tols = data.rows, data.tolerances
    normal[:] = 0.0
    right[:] = 0.0
    cost = 0.0
    equations = 0
    squares = 0.0
    points = 0
    for k in range(rows.shape[0]):
        j = assignment[k]
        if j < 0:
            continue
        ux, uy, uz, mx, my, mz = transform_line(motion, lines[j])
        ex, ey, ez, fx, fy, fz = perpendiculars(ux, uy, uz)
        weight = 1.0 / (tols[k, 0] * tols[k, 0])
        d = rows[k]
        curve = data.kind[k] == CURVE
        for end in range(2):
            step = d[6] if end == 0 else -d[6]
            if curve and end == 1:
                break
            x, y, z = d[0] + step * d[3], d[1] + step * d[4], d[2] + step * d[5]
            along = (x - mx) * ux + (y - my) * uy + (z - mz) * uz
            if curve:
                along = 0.0
            qx, qy, qz = mx + along * ux, my + along * uy, mz + along * uz
            rx, ry, rz = x - qx, y - qy, z - qz
            gx, gy, gz = qx - centre[0], qy - centre[1], qz - centre[2]
            for axis in range(3 if curve else 2):
                if axis == 0:
                    ax, ay, az = ex, ey, ez
                elif axis == 1:
                    ax, ay, az = fx, fy, fz
                else:
                    ax, ay, az = ux, uy, uz
                residual = ax * rx + ay * ry + az * rz
                add_equation(
                    normal, right, gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax, ax, ay, az, residual, weight
                )
                cost += weight * residual * residual
                equations += 1
                squares += residual * residual
            points += 1
        if curve:
            turn = 1.0 / (tols[k, 2] * tols[k, 2])
            s = 1.0 if sign[k] >= 0 else -1.0
            for axis in range(2):
                if axis == 0:
                    ax, ay, az = ex, ey, ez
                else:
                    ax, ay, az = fx, fy, fz
                residual = s * (ax * d[3] + ay * d[4] + az * d[5])
                add_equation(
                    normal,
                    right,
                    uy * az - uz * ay,
                    uz * ax - ux * az,
                    ux * ay - uy * ax,
                    0.0,
                    0.0,
                    0.0,
                    residual,
                    turn,
                )
                cost += turn * residual * residual
                equations += 1
    for i in range(6):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return cost, equations, squares, points


@njit
def damp(normal: FloatArray) -> None:
    """Add a little of the trace to the diagonal of a normal matrix (n, n): a free motion stays where it is."""
    trace = 0.0
    for i in range(len(normal)):
        trace += normal[i, i]
    for i in range(len(normal)):
        normal[i, i] += ROUNDING * trace


@njit
def refine(
    motion: FloatArray,
    model: ModelFeatures,
    data: DataFeatures,
    widths: tuple[float, ...],
    assignment: Int32Array,
    sign: Int8Array,
) -> float:
    """Gauss-Newton on a pose, in place: assign with each of the given tolerance widths in turn and fit again.

    Parameters
    ----------
    motion : (12,) float64
        Changed in place.
    model : ModelFeatures
    data : DataFeatures
    widths : (w,) float64
        How many times the tolerances count, one after the other.
    assignment : (n,) int32
    sign : (n,) int8
        Both filled, as :func:`.back_projection.assign` has them.

    Returns
    -------
    float
        Metres, root mean square of the distances of end points from their lines; 0 when nothing is matched.

    """
    normal, right, step, centre = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros(3)
    rms = 0.0
    for turn in range(len(widths)):
        matched = assign(motion, model, data, widths[turn], assignment, sign)
        if matched == 0:
            return 0.0
        centre[:] = 0.0
        for k in range(data.rows.shape[0]):
            if assignment[k] >= 0:
                for i in range(3):
                    centre[i] += data.rows[k, i] / matched
        normal_equations(motion, model.rows, data, assignment, sign, centre, normal, right)
        damp(normal)
        if solve_positive(normal, right, step):
            compose_small(motion, centre, step)
        _, _, squares, points = normal_equations(motion, model.rows, data, assignment, sign, centre, normal, right)
        rms = np.sqrt(squares / max(points, 1))
    return rms


@njit
def covariances(normals: FloatArray, chi: FloatArray, levers: FloatArray, size: float) -> FloatArray:
    """Covariances of poses from the normal matrices of their fits.

    A direction that the data leaves free gets the variance of its whole range: a turn that of an angle that is anywhere
    on the circle, pi squared / 3, a shift the model's size squared.

    Parameters
    ----------
    normals : (c, 6, 6) float64
        About the data's centre, see :func:`.weighted_fit.weighted_fit`.
    chi : (c,) float64
        What their inverses are multiplied by.
    levers : (c, 3) float64
        Metres, from the data's centre to the translation of the pose.
    size : float
        Metres, of the model.

    Returns
    -------
    (c, 6, 6) float64
        Of translation and rotation, metres and radians.

    """
    out = np.empty((len(chi), 6, 6))
    # Rotation as displacement near the model's rim, to compare the six: so that a free turn, of the standard deviation
    # of a uniform angle, displaces as a free shift does.
    units = np.ones(6)
    units[:3] = UNIFORM_ANGLE / max(size, SMALLEST_LENGTH)
    scaled, spread = np.empty((6, 6)), np.empty((6, 6))
    for k in range(len(chi)):
        for i in range(6):
            for j in range(6):
                scaled[i, j] = normals[k, i, j] * units[i] * units[j]
        values, vectors = np.linalg.eigh(scaled)
        floor = values[5] * ROUNDING
        x, y, z = levers[k, 0], levers[k, 1], levers[k, 2]
        for j in range(6):
            turn = (vectors[0, j] * units[0], vectors[1, j] * units[1], vectors[2, j] * units[2])
            spread[0, j] = vectors[3, j] + z * turn[1] - y * turn[2]
            spread[1, j] = vectors[4, j] + x * turn[2] - z * turn[0]
            spread[2, j] = vectors[5, j] + y * turn[0] - x * turn[1]
            spread[3, j], spread[4, j], spread[5, j] = turn
        for i in range(6):
            for j in range(i + 1):
                total = 0.0
                for q in range(6):
                    variance = max(chi[k], NOT_ZERO) / values[q] if values[q] > floor else size * size
                    total += spread[i, q] * variance * spread[j, q]
                out[k, i, j] = out[k, j, i] = total
    return out
