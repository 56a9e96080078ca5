"""Compiled least-squares equations of one curve on the edgels of two images, for :mod:`.curves3d`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

# Variance, px^2, by which fitting a quadratic to 3 x 3 pixels (see :mod:`.edgels`) adds to the pull of the smoothing: a
# ridge that bends by c moves by c/2 times the mean square of what lies beside its normal, 2/3 where the normal runs
# along the pixels and a quarter of that where it runs diagonally.
FACET, DIAGONAL = 2.0 / 3.0, 0.75


@njit
def _conic(centre, major, minor, camera, eye):
    """The picture of a curve: (6,) of u^2, uv, v^2, u, v, 1 halves, as a00, a01, a11, a02, a12, a22; inside < 0."""
    m = np.empty((3, 3))
    for c in range(3):
        x = major[0] if c == 0 else (minor[0] if c == 1 else centre[0] - eye)
        y = major[1] if c == 0 else (minor[1] if c == 1 else centre[1])
        z = major[2] if c == 0 else (minor[2] if c == 1 else centre[2])
        m[0, c] = camera[0] * x + camera[2] * z
        m[1, c] = camera[1] * y + camera[3] * z
        m[2, c] = z
    # Adjugate: the inverse up to a factor that cancels.
    a = np.empty((3, 3))
    a[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    a[0, 1] = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]
    a[0, 2] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    a[1, 0] = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    a[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]
    a[1, 2] = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    a[2, 0] = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    a[2, 1] = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]
    a[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    q = np.empty(6)
    for j in range(3):
        for i in range(j + 1):
            q[i + j * (j + 1) // 2] = a[0, i] * a[0, j] + a[1, i] * a[1, j] - a[2, i] * a[2, j]
    norm = abs(q[5]) + 1e-300
    if q[0] + q[2] < 0.0:
        norm = -norm
    return q / norm


@njit
def residuals(centre, normal, first, radii, points, count, camera_left, camera_right, baseline, blur, out, bend):
    """Distances of edgels from the curve's pictures, pixels, positive outside, into out (n,); bend (n,): what
    smoothing of variance ``blur`` and the edgels' fit move an edgel towards the centre of curvature (already taken off
    ``out``); nothing for points that come from no picture, blur 0."""
    second = np.array(
        [
            normal[1] * first[2] - normal[2] * first[1],
            normal[2] * first[0] - normal[0] * first[2],
            normal[0] * first[1] - normal[1] * first[0],
        ]
    )
    major, minor = radii[0] * first, radii[1] * second
    for side in range(2):
        q = _conic(centre, major, minor, camera_left if side == 0 else camera_right, 0.0 if side == 0 else baseline)
        for i in range(0 if side == 0 else count, count if side == 0 else len(points)):
            u, v = points[i, 0], points[i, 1]
            gu = q[0] * u + q[1] * v + q[3]
            gv = q[1] * u + q[2] * v + q[4]
            value = gu * u + gv * v + q[3] * u + q[4] * v + q[5]
            g2 = gu * gu + gv * gv + 1e-300
            g = np.sqrt(g2)
            curvature = (q[0] * gv * gv - 2.0 * q[1] * gu * gv + q[2] * gu * gu) / (g2 * g)
            twice = 2.0 * gu * gv / g2
            pull = blur + FACET * (1.0 - DIAGONAL * twice * twice) if blur > 0.0 else 0.0
            bend[i] = min(0.5 * pull * abs(curvature), 1.0)
            out[i] = 0.5 * value / g + bend[i]


@njit
def moved(centre, normal, first, radii, step, circle):
    """A curve changed by a step: centre (3), tilts (2), log radii (1 or 2), turn in the plane (0 or 1)."""
    second = np.array(
        [
            normal[1] * first[2] - normal[2] * first[1],
            normal[2] * first[0] - normal[0] * first[2],
            normal[0] * first[1] - normal[1] * first[0],
        ]
    )
    n = normal + step[3] * second - step[4] * first
    n = n / np.sqrt((n * n).sum())
    f = first.copy()
    if not circle:
        f = f + step[7] * second
    f = f - n * (f * n).sum()
    f = f / np.sqrt((f * f).sum())
    r = radii.copy()
    r[0] *= np.exp(step[5])
    r[1] *= np.exp(step[5] if circle else step[6])
    return centre + step[:3], n, f, r


@njit
def jacobian(centre, normal, first, radii, circle, points, count, camera_left, camera_right, baseline, blur, out, bend):
    """Residuals into out, and their derivatives (n, p) by the parameters of :func:`moved`."""
    size = 6 if circle else 8
    n = len(points)
    residuals(centre, normal, first, radii, points, count, camera_left, camera_right, baseline, blur, out, bend)
    result = np.empty((n, size))
    shifted, unused = np.empty(n), np.empty(n)
    for k in range(size):
        step = np.zeros(8)
        h = 1e-5 * radii[0] if k < 3 else 1e-5
        step[k] = h
        c, m, f, r = moved(centre, normal, first, radii, step, circle)
        residuals(c, m, f, r, points, count, camera_left, camera_right, baseline, blur, shifted, unused)
        for i in range(n):
            result[i, k] = (shifted[i] - out[i]) / h
    return result


@njit
def equations(
    centre, normal, first, radii, circle, points, count, camera_left, camera_right, baseline, blur, sigma, out, bend
):
    """Normal equations at a curve: matrix (p, p), gradient (p,), cost, weights (n,), jacobian (n, p); residuals go to
    out."""
    rows = jacobian(
        centre, normal, first, radii, circle, points, count, camera_left, camera_right, baseline, blur, out, bend
    )
    n, size = rows.shape
    weights = np.empty(n)
    ratio = np.abs(out) / sigma
    spread = max(1.4826 * np.median(ratio), 1.0)
    cost = 0.0
    for i in range(n):
        # A fifth of the correction for curvature is doubted.
        variance = sigma[i] * sigma[i] + 0.04 * bend[i] * bend[i]
        weights[i] = 1.0 / (variance * (1.0 + (ratio[i] / (2.5 * spread)) ** 2))
        cost += weights[i] * out[i] * out[i]
    matrix = np.zeros((size, size))
    gradient = np.zeros(size)
    for i in range(n):
        for a in range(size):
            wa = weights[i] * rows[i, a]
            gradient[a] += wa * out[i]
            for b in range(a + 1):
                matrix[a, b] += wa * rows[i, b]
    for a in range(size):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, gradient, cost, weights, rows


@njit
def _solve(matrix, right):
    """Solution of a small system by elimination with pivots; changes both; False when the system is singular."""
    n = len(right)
    for c in range(n):
        pivot = c
        for r in range(c + 1, n):
            if abs(matrix[r, c]) > abs(matrix[pivot, c]):
                pivot = r
        if not abs(matrix[pivot, c]) > 0.0:
            return False
        if pivot != c:
            for k in range(c, n):
                matrix[c, k], matrix[pivot, k] = matrix[pivot, k], matrix[c, k]
            right[c], right[pivot] = right[pivot], right[c]
        for r in range(c + 1, n):
            f = matrix[r, c] / matrix[c, c]
            for k in range(c, n):
                matrix[r, k] -= f * matrix[c, k]
            right[r] -= f * right[c]
    for c in range(n - 1, -1, -1):
        for k in range(c + 1, n):
            right[c] -= matrix[c, k] * right[k]
        right[c] /= matrix[c, c]
    return True


@njit
def axle_residual(axle, centre, normal, off):
    """Of a curve on an axle, into off (4,): the normal's tilt, and the centre's offset. axle : (4, 3): its point, its
    direction, two directions across it. Returns the sign of the normal along the axle."""
    sign = 1.0 if (axle[1] * normal).sum() >= 0.0 else -1.0
    for k in range(2):
        off[k] = sign * (axle[2 + k] * normal).sum()
        off[2 + k] = (axle[2 + k] * (centre - axle[0])).sum()
    return sign


@njit
def _hold_to(axle, hold, centre, normal, first, matrix, gradient):
    """Adds what an axle says, with weights hold (4, 4), to the normal equations; returns its cost."""
    off = np.empty(4)
    sign = axle_residual(axle, centre, normal, off)
    slope = np.zeros((4, 5))
    second = np.array(
        [
            normal[1] * first[2] - normal[2] * first[1],
            normal[2] * first[0] - normal[0] * first[2],
            normal[0] * first[1] - normal[1] * first[0],
        ]
    )
    for k in range(2):
        slope[k, 3] = sign * (axle[2 + k] * second).sum()
        slope[k, 4] = -sign * (axle[2 + k] * first).sum()
        slope[2 + k, :3] = axle[2 + k]
    cost = 0.0
    for i in range(4):
        for j in range(4):
            cost += hold[i, j] * off[i] * off[j]
            for a in range(5):
                gradient[a] += slope[i, a] * hold[i, j] * off[j]
                for b in range(5):
                    matrix[a, b] += slope[i, a] * hold[i, j] * slope[j, b]
    return cost


@njit
def settle(
    centre,
    normal,
    first,
    radii,
    circle,
    points,
    count,
    camera_left,
    camera_right,
    baseline,
    blur,
    sigma,
    rounds,
    axle,
    hold,
):
    """Moves a curve until its pictures lie on the edgels (Levenberg-Marquardt, Cauchy weights).

    axle, hold : see :func:`_hold_to`; hold is (0, 0) when nothing holds the curve. Returns whether that went well, and
    the curve: centre, normal, first, radii.
    """
    size = 6 if circle else 8
    out, bend = np.empty(len(points)), np.empty(len(points))
    held = len(hold) > 0
    off = np.empty(4)
    damping = 1e-3
    for _ in range(rounds):
        matrix, gradient, cost, weights, _rows = equations(
            centre,
            normal,
            first,
            radii,
            circle,
            points,
            count,
            camera_left,
            camera_right,
            baseline,
            blur,
            sigma,
            out,
            bend,
        )
        if held:
            cost += _hold_to(axle, hold, centre, normal, first, matrix, gradient)
        if not (np.isfinite(cost) and np.isfinite(matrix).all()):
            return False, centre, normal, first, radii
        gained = 0.0
        for _attempt in range(6):
            damped, right = matrix.copy(), -gradient
            for a in range(size):
                damped[a, a] += damping * matrix[a, a]
            if not _solve(damped, right):
                return False, centre, normal, first, radii
            step = np.zeros(8)
            for a in range(size):
                widest = radii[0] if a < 3 else 0.5
                step[a] = min(max(right[a], -widest), widest)
            c, m, f, r = moved(centre, normal, first, radii, step, circle)
            residuals(c, m, f, r, points, count, camera_left, camera_right, baseline, blur, out, bend)
            new_cost = (weights * out * out).sum()
            if held:
                axle_residual(axle, c, m, off)
                for i in range(4):
                    for j in range(4):
                        new_cost += hold[i, j] * off[i] * off[j]
            if np.isfinite(new_cost) and new_cost <= cost:
                centre, normal, first, radii = c, m, f, r
                gained = cost - new_cost
                damping = max(damping / 10.0, 1e-9)
                break
            damping *= 10.0
        if gained < 1e-5 * cost:
            break
    return True, centre, normal, first, radii


@njit
def common(rows, weights, shift, group, groups):
    """(p, p): what displacements that all edgels of a group share add to the normal equations' right side (variance).

    rows : (n, p) jacobian; shift : (n,) pixels, one sigma; group : (n,) int64 below ``groups``.
    """
    n, size = rows.shape
    sums = np.zeros((groups, size))
    for i in range(n):
        for a in range(size):
            sums[group[i], a] += weights[i] * shift[i] * rows[i, a]
    return sums.T @ sums
