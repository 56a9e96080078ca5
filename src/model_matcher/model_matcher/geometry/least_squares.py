"""Compiled refinement of a pose: point-to-line Gauss-Newton on the data assigned to it.

Rows of features, tolerances and motions as in kernels.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from .kernels import CURVE, assign


@njit
def solve6(a, b, x):
    """Solve a x = b for a symmetric positive definite (6, 6) by Cholesky; False when it is not definite."""
    low = np.zeros((6, 6))
    for i in range(6):
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
    for i in range(6):
        total = b[i]
        for k in range(i):
            total -= low[i, k] * x[k]
        x[i] = total / low[i, i]
    for i in range(5, -1, -1):
        total = x[i]
        for k in range(i + 1, 6):
            total -= low[k, i] * x[k]
        x[i] = total / low[i, i]
    return True


@njit
def _add_row(normal, right, gx, gy, gz, ex, ey, ez, residual, weight):
    row = (gx, gy, gz, ex, ey, ez)
    for i in range(6):
        right[i] += weight * row[i] * residual
        for j in range(i + 1):
            normal[i, j] += weight * row[i] * row[j]


@njit
def normal_equations(motion, model, data, kind_d, tols, assignment, sign, centre, normal, right):
    """Point-to-line least squares, linearised about a pose; rotation is about ``centre`` (3,), camera frame.

    Both end points of every data edge or axis must lie on its model line; a curve's centre on the model's centre and
    its normal along the model's. Unknowns: rotation vector (3), translation (3). Fills normal (6, 6), lower half, and
    right (6,); returns the weighted sum of squares, its number of equations, and the plain sum of squared distances
    with their number.
    """
    normal[:] = 0.0
    right[:] = 0.0
    cost = 0.0
    equations = 0
    squares = 0.0
    points = 0
    for k in range(data.shape[0]):
        j = assignment[k]
        if j < 0:
            continue
        m = model[j]
        ux, uy, uz, mx, my, mz = placed_line(motion, m)
        ex, ey, ez, fx, fy, fz = across_line(ux, uy, uz)
        weight = 1.0 / (tols[k, 0] * tols[k, 0])
        d = data[k]
        curve = kind_d[k] == CURVE
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
                _add_row(
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
                _add_row(
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
def placed_line(motion, m):
    """Direction and middle (ux, uy, uz, mx, my, mz) of a model feature, a row m, where a pose puts it."""
    return (
        motion[0] * m[3] + motion[1] * m[4] + motion[2] * m[5],
        motion[3] * m[3] + motion[4] * m[4] + motion[5] * m[5],
        motion[6] * m[3] + motion[7] * m[4] + motion[8] * m[5],
        motion[0] * m[0] + motion[1] * m[1] + motion[2] * m[2] + motion[9],
        motion[3] * m[0] + motion[4] * m[1] + motion[5] * m[2] + motion[10],
        motion[6] * m[0] + motion[7] * m[1] + motion[8] * m[2] + motion[11],
    )


@njit
def across_line(ux, uy, uz):
    """Two unit vectors (ex, ey, ez, fx, fy, fz) upright to a direction and to each other."""
    if abs(ux) < 0.6:
        ex, ey, ez = 0.0, uz, -uy
    else:
        ex, ey, ez = -uz, 0.0, ux
    length = np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / length, ey / length, ez / length
    return ex, ey, ez, uy * ez - uz * ey, uz * ex - ux * ez, ux * ey - uy * ex


@njit
def apply_step(motion, centre, step):
    """Turn a pose by a rotation vector about ``centre`` and shift it, in place; Rodrigues, then re-orthonormalised."""
    wx, wy, wz = step[0], step[1], step[2]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    s = 1.0 - angle * angle / 6.0 if angle < 1e-6 else np.sin(angle) / angle
    c = 0.5 - angle * angle / 24.0 if angle < 1e-3 else (1.0 - np.cos(angle)) / (angle * angle)
    q = np.empty(9)
    q[0] = 1.0 - c * (wy * wy + wz * wz)
    q[1] = c * wx * wy - s * wz
    q[2] = c * wx * wz + s * wy
    q[3] = c * wx * wy + s * wz
    q[4] = 1.0 - c * (wx * wx + wz * wz)
    q[5] = c * wy * wz - s * wx
    q[6] = c * wx * wz - s * wy
    q[7] = c * wy * wz + s * wx
    q[8] = 1.0 - c * (wx * wx + wy * wy)
    old = motion.copy()
    for i in range(3):
        for j in range(3):
            motion[3 * i + j] = q[3 * i] * old[j] + q[3 * i + 1] * old[3 + j] + q[3 * i + 2] * old[6 + j]
    tx, ty, tz = old[9] - centre[0], old[10] - centre[1], old[11] - centre[2]
    for i in range(3):
        motion[9 + i] = q[3 * i] * tx + q[3 * i + 1] * ty + q[3 * i + 2] * tz + centre[i] + step[3 + i]
    orthonormalise(motion)


@njit
def orthonormalise(motion):
    """Gram-Schmidt on the rows of the rotation, in place."""
    n = np.sqrt(motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2)
    for i in range(3):
        motion[i] /= n
    dot = motion[0] * motion[3] + motion[1] * motion[4] + motion[2] * motion[5]
    for i in range(3):
        motion[3 + i] -= dot * motion[i]
    n = np.sqrt(motion[3] ** 2 + motion[4] ** 2 + motion[5] ** 2)
    for i in range(3):
        motion[3 + i] /= n
    motion[6] = motion[1] * motion[5] - motion[2] * motion[4]
    motion[7] = motion[2] * motion[3] - motion[0] * motion[5]
    motion[8] = motion[0] * motion[4] - motion[1] * motion[3]


@njit
def refine(
    motion,
    model,
    kind_m,
    low,
    cell,
    shape,
    starts,
    items,
    data,
    kind_d,
    tols,
    widths,
    radius_tol,
    assignment,
    sign,
    normal,
):
    """Gauss-Newton on a pose, in place: assign with each of the given tolerance widths in turn and re-fit.

    The last fit's normal matrix, about the returned centre, stays in ``normal``.
    Returns matched, root mean square distance (metres, per end point), weighted cost per equation, centre x, y, z.
    """
    right = np.zeros(6)
    step = np.zeros(6)
    centre = np.zeros(3)
    matched = 0
    rms = 0.0
    chi = 0.0
    for turn in range(len(widths)):
        matched = assign(
            motion,
            model,
            kind_m,
            low,
            cell,
            shape,
            starts,
            items,
            data,
            kind_d,
            tols,
            widths[turn],
            radius_tol,
            assignment,
            sign,
        )
        if matched == 0:
            return matched, 0.0, 0.0, 0.0, 0.0, 0.0
        centre[:] = 0.0
        for k in range(data.shape[0]):
            if assignment[k] >= 0:
                for i in range(3):
                    centre[i] += data[k, i] / matched
        cost, equations, squares, points = normal_equations(
            motion, model, data, kind_d, tols, assignment, sign, centre, normal, right
        )
        trace = 0.0
        for i in range(6):
            trace += normal[i, i]
        for i in range(6):
            normal[i, i] += 1e-9 * trace  # a free direction stays where it is
        if solve6(normal, right, step):
            apply_step(motion, centre, step)
        cost, equations, squares, points = normal_equations(
            motion, model, data, kind_d, tols, assignment, sign, centre, normal, right
        )
        rms = np.sqrt(squares / max(points, 1))
        chi = cost / max(equations - 6, 1)
    return matched, rms, chi, centre[0], centre[1], centre[2]


@njit
def covariances(normals, chi, levers, size, smallest):
    """(c, 6, 6) covariances of translation and rotation, metres and radians, from normal matrices of fits.

    normals : (c, 6, 6), about the data's centre; chi : (c,) weighted cost per equation; levers : (c, 3) metres, from
    the centres to the translations of the poses; size : of the model, metres; smallest : metres
    A direction that the data leaves free gets the variance of its whole range: the model's size, or a half turn.
    """
    out = np.empty((len(chi), 6, 6))
    # Rotation as displacement at the model's rim, to compare the six.
    units = np.ones(6)
    units[:3] = 1.0 / max(0.5 * size, smallest)
    scaled, spread = np.empty((6, 6)), np.empty((6, 6))
    for k in range(len(chi)):
        for i in range(6):
            for j in range(6):
                scaled[i, j] = normals[k, i, j] * units[i] * units[j]
        values, vectors = np.linalg.eigh(scaled)
        floor = max(values[5], 1e-300) * 1e-7
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
                    variance = max(chi[k], 1e-12) / values[q] if values[q] > floor else size * size
                    total += spread[i, q] * variance * spread[j, q]
                out[k, i, j] = out[k, j, i] = total
    return out
