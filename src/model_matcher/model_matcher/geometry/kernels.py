"""Compiled inner loops of the hypothesis search: pair geometry, voxel table, back-projection.

Numba's cache looks only at the file of the function it compiled: after an edit here, the caches of the modules that
call these functions have to go too.

A feature is a row of nine numbers: mid point (3), unit direction (3), half length, major and minor radius. A CURVE's
mid point is its centre, its direction the plane normal and its half length 0. Distances in metres.
A tolerance is a row of three: across (metres), along (metres), half cone angle (radians).
A rigid motion is a row of twelve: rotation row by row (9), translation (3), taking model to camera.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

CURVE = 1
PARALLEL_SINE = 0.17  # pairs nearer to parallel than about 10 degrees do not fix a pose well
ANGLE_CELLS = 36
FLIP_MARGIN = 0.27  # radians beyond 90 degrees that the angle axis of the pair table reaches
MAX_ANGLE = 0.5 * np.pi + FLIP_MARGIN
OFFSET_CELLS = 64


@njit
def pair_geometry(a, b):
    """Relation of two lines (rows of features): cosine >= 0, sine, signed distance, both feet, flip of b.

    b's direction is reversed (flip = -1) when that makes the cosine positive. A foot is where the common
    perpendicular meets the line, measured from the mid point along the (flipped) direction.
    """
    wx, wy, wz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ux, uy, uz = a[3], a[4], a[5]
    vx, vy, vz = b[3], b[4], b[5]
    c = ux * vx + uy * vy + uz * vz
    flip = 1.0
    if c < 0.0:
        flip = -1.0
        c, vx, vy, vz = -c, -vx, -vy, -vz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    s = np.sqrt(nx * nx + ny * ny + nz * nz)
    if s < 1e-9:
        return c, 0.0, 0.0, 0.0, 0.0, flip
    d = (wx * nx + wy * ny + wz * nz) / s
    wu = wx * ux + wy * uy + wz * uz
    wv = wx * vx + wy * vy + wz * vz
    return c, s, d, (wu - c * wv) / (s * s), (c * wu - wv) / (s * s), flip


# -- the model's pair table ------------------------------------------------------------------------------------------


@njit
def _pair_cell(angle, d, reach):
    i = int(angle / MAX_ANGLE * ANGLE_CELLS)
    j = int((d / reach + 1.0) * 0.5 * OFFSET_CELLS)
    return min(max(i, 0), ANGLE_CELLS - 1), min(max(j, 0), OFFSET_CELLS - 1)


@njit
def build_pair_table(features, reach):
    """All ordered, non-parallel pairs of model features, sorted into cells of (angle, signed distance).

    A pair near 90 degrees is entered twice, because noise may turn its angle beyond 90 degrees, where the other
    line counts as reversed. Returns starts (cells + 1,) int32, members (p, 2) int32, values (p, 6) float64: angle,
    signed distance, foot of first, foot of second, flip of second, half length of the shorter. Within a cell that
    falls, so that a search for a pair of long features ends at the first too short one.
    """
    e = features.shape[0]
    shorter = np.empty(e * e)
    for i in range(e):
        for j in range(e):
            shorter[i * e + j] = min(features[i, 6], features[j, 6])
    order = np.argsort(-shorter, kind='mergesort')
    counts = np.zeros(ANGLE_CELLS * OFFSET_CELLS + 1, np.int32)
    members = np.zeros((0, 2), np.int32)
    values = np.zeros((0, 6))
    cursor = counts
    for sweep in range(2):
        if sweep == 1:
            for k in range(len(counts) - 1):
                counts[k + 1] += counts[k]
            members = np.zeros((counts[-1], 2), np.int32)
            values = np.zeros((counts[-1], 6))
            cursor = counts.copy()
        for k in order:
            i, j = k // e, k % e
            if i == j:
                continue
            c, s, d, fi, fj, flip = pair_geometry(features[i], features[j])
            if s < PARALLEL_SINE:
                continue
            angle = np.arctan2(s, c)
            for other in range(2):
                if other == 1:
                    if np.pi - angle > MAX_ANGLE:
                        continue
                    angle, d, fj, flip = np.pi - angle, -d, -fj, -flip
                p, q = _pair_cell(angle, d, reach)
                cell = p * OFFSET_CELLS + q
                if sweep == 0:
                    counts[cell + 1] += 1
                    continue
                at = cursor[cell]
                cursor[cell] += 1
                members[at, 0], members[at, 1] = i, j
                values[at, 0], values[at, 1], values[at, 2], values[at, 3], values[at, 4] = angle, d, fi, fj, flip
                values[at, 5] = shorter[k]
    return counts, members, values


# -- the model's voxel table -----------------------------------------------------------------------------------------


@njit
def build_voxels(features, low, cell, shape, reach):
    """Which model features pass near each cell of a grid: starts (cells + 1,) int32, items (m,) int32.

    A feature is listed where its distance from the cell's centre is within reach plus half the cell's diagonal.
    """
    nx, ny, nz = shape
    counts = np.zeros(nx * ny * nz + 1, np.int32)
    items = np.zeros(0, np.int32)
    cursor = counts
    limit = (reach + 0.8661 * cell) ** 2
    margin = reach + cell
    for sweep in range(2):
        if sweep == 1:
            for k in range(len(counts) - 1):
                counts[k + 1] += counts[k]
            items = np.zeros(counts[-1], np.int32)
            cursor = counts.copy()
        for i in range(features.shape[0]):
            f = features[i]
            h = f[6]
            lo = np.zeros(3, np.int64)
            hi = np.zeros(3, np.int64)
            for axis in range(3):
                extent = h * abs(f[3 + axis]) + margin
                lo[axis] = max(0, int(np.floor((f[axis] - extent - low[axis]) / cell)))
                hi[axis] = min(shape[axis] - 1, int(np.floor((f[axis] + extent - low[axis]) / cell)))
            for x in range(lo[0], hi[0] + 1):
                for y in range(lo[1], hi[1] + 1):
                    for z in range(lo[2], hi[2] + 1):
                        rx = low[0] + (x + 0.5) * cell - f[0]
                        ry = low[1] + (y + 0.5) * cell - f[1]
                        rz = low[2] + (z + 0.5) * cell - f[2]
                        s = rx * f[3] + ry * f[4] + rz * f[5]
                        s = min(max(s, -h), h)
                        rx, ry, rz = rx - s * f[3], ry - s * f[4], rz - s * f[5]
                        if rx * rx + ry * ry + rz * rz > limit:
                            continue
                        k = (x * ny + y) * nz + z
                        if sweep == 0:
                            counts[k + 1] += 1
                        else:
                            items[cursor[k]] = i
                            cursor[k] += 1
    return counts, items


# -- ranking data pairs ----------------------------------------------------------------------------------------------


@njit
def _cost_of_pair(features, a, b, size):
    """gap / (length x sine) of two features, infinite for those too far apart or too nearly parallel.

    As pair_geometry has it, but number by number: taking rows apart costs as much as the rest.
    """
    ha, hb = features[a, 6], features[b, 6]
    wx, wy, wz = features[b, 0] - features[a, 0], features[b, 1] - features[a, 1], features[b, 2] - features[a, 2]
    square = wx * wx + wy * wy + wz * wz
    if square > (size + ha + hb) ** 2:
        return np.inf
    ux, uy, uz = features[a, 3], features[a, 4], features[a, 5]
    vx, vy, vz = features[b, 3], features[b, 4], features[b, 5]
    c = ux * vx + uy * vy + uz * vz
    sine = 1.0 - c * c
    if sine < PARALLEL_SINE * PARALLEL_SINE:
        return np.inf
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    fa, fb = (wu - c * wv) / sine, (c * wu - wv) / sine
    over_a, over_b = max(0.0, abs(fa) - ha), max(0.0, abs(fb) - hb)
    # What is left of the gap of the mid points when both have gone to the common perpendicular.
    across = max(square - wu * fa + wv * fb, 0.0)
    gap = np.sqrt(across + over_a * over_a + over_b * over_b)
    # A curve's normal has no length, but its direction is as good as that of a long edge.
    la = ha if ha > 0.0 else 0.1 * size
    lb = hb if hb > 0.0 else 0.1 * size
    return (gap + 0.05 * size) / (min(la, lb) * np.sqrt(sine) + 1e-12)


@njit
def _keep_best(best_cost, best_other, a, b, cost):
    at = best_cost.shape[1] - 1
    if cost >= best_cost[a, at]:
        return
    while at > 0 and best_cost[a, at - 1] > cost:
        best_cost[a, at] = best_cost[a, at - 1]
        best_other[a, at] = best_other[a, at - 1]
        at -= 1
    best_cost[a, at] = cost
    best_other[a, at] = b


@njit
def rank_pairs(features, neighbours, size, knn):
    """Data pairs, most promising first: near, long and far from parallel (gap / (length x sine)).

    neighbours : (n, m) int32 candidates of each feature, or (0, 0): all. Each feature contributes its knn best.
    size : metres, the model's diameter: farther pairs cannot be of one object.
    Returns (p, 2) int32, best first, and the knn partners of each feature (n, knn) int32, -1 at the end.
    """
    n = features.shape[0]
    knn = min(knn, max(n - 1, 0))
    best_cost = np.full((n, max(knn, 1)), np.inf)
    best_other = np.full((n, max(knn, 1)), -1, np.int32)
    everyone = neighbours.shape[0] == 0
    for a in range(n):
        if everyone:
            for b in range(a + 1, n):
                cost = _cost_of_pair(features, a, b, size)
                if cost < np.inf:
                    _keep_best(best_cost, best_other, a, b, cost)
                    _keep_best(best_cost, best_other, b, a, cost)
        else:
            for k in range(neighbours.shape[1]):
                b = neighbours[a, k]
                if b >= 0 and b != a:
                    _keep_best(best_cost, best_other, a, b, _cost_of_pair(features, min(a, b), max(a, b), size))
    pairs = np.zeros((n * knn, 2), np.int32)
    costs = np.zeros(n * knn)
    count = 0
    for a in range(n):
        for k in range(knn):
            b = best_other[a, k]
            if b < 0:
                break
            if b < a:
                # Entered already when a is also among b's best.
                known = False
                for q in range(knn):
                    if best_other[b, q] == a:
                        known = True
                        break
                if known:
                    continue
            pairs[count, 0], pairs[count, 1] = a, b
            costs[count] = best_cost[a, k]
            count += 1
    order = np.argsort(costs[:count], kind='mergesort')
    return pairs[:count][order], best_other


# -- back-projection -------------------------------------------------------------------------------------------------


@njit(inline='always')  # as a call it would cost more than what it does
def fit_one(k, data, kind_d, tols, j, model, kind_m, px, py, pz, vx, vy, vz, widen, radius_tol):
    """How well data feature k, its middle p and direction v in the model frame, lies on model feature j.

    Returns the largest end point distance across the line over its tolerance, in [0, 1], or -1 when it does not fit.
    """
    if kind_d[k] != kind_m[j]:
        return -1.0
    rx, ry, rz = px - model[j, 0], py - model[j, 1], pz - model[j, 2]
    mx, my, mz = model[j, 3], model[j, 4], model[j, 5]
    along = rx * mx + ry * my + rz * mz
    across = tols[k, 0] * widen
    qx, qy, qz = rx - along * mx, ry - along * my, rz - along * mz
    middle = qx * qx + qy * qy + qz * qz
    if middle > across * across:
        return -1.0
    c = vx * mx + vy * my + vz * mz
    h = data[k, 6]
    if abs(along) + abs(c) * h > model[j, 6] + tols[k, 1] * widen:
        return -1.0
    # sin(x)^2 lies between x^2 - x^4 / 3 and x^2: the sine itself is hardly ever needed.
    cone = min(tols[k, 2] * widen, 1.2)
    square = cone * cone
    away = 1.0 - c * c
    if away > square or (away > square * (1.0 - square / 3.0) and away > np.sin(cone) ** 2):
        return -1.0
    if kind_d[k] == CURVE:
        room = radius_tol + tols[k, 0]
        if abs(data[k, 7] - model[j, 7]) > room or abs(data[k, 8] - model[j, 8]) > room:
            return -1.0
        return min(1.0, np.sqrt(middle + along * along) / across)
    sx, sy, sz = h * (vx - c * mx), h * (vy - c * my), h * (vz - c * mz)
    cross = qx * sx + qy * sy + qz * sz
    worst = middle + sx * sx + sy * sy + sz * sz + 2.0 * abs(cross)
    if worst > across * across:
        return -1.0
    return np.sqrt(worst) / across


@njit
def count_matches(
    motion, model, kind_m, low, cell, shape, starts, items, data, kind_d, tols, widen, radius_tol, stamp, mark, needed
):
    """Distinct model features with data on them under a pose, plus the mean quality of fit as the fraction.

    Gives up, returning 0, as soon as ``needed`` distinct features are out of reach.
    """
    r0, r1, r2, r3, r4, r5, r6, r7, r8, tx, ty, tz = (
        motion[0],
        motion[1],
        motion[2],
        motion[3],
        motion[4],
        motion[5],
        motion[6],
        motion[7],
        motion[8],
        motion[9],
        motion[10],
        motion[11],
    )
    nx, ny, nz = shape
    n = data.shape[0]
    distinct = 0
    fits = 0
    quality = 0.0
    inverse = 1.0 / cell
    lx, ly, lz = low[0], low[1], low[2]
    for k in range(n):
        if distinct + n - k < needed:
            return 0.0
        x, y, z = data[k, 0] - tx, data[k, 1] - ty, data[k, 2] - tz
        px = r0 * x + r3 * y + r6 * z
        gx = (px - lx) * inverse
        if gx < 0.0 or gx >= nx:
            continue
        py = r1 * x + r4 * y + r7 * z
        gy = (py - ly) * inverse
        if gy < 0.0 or gy >= ny:
            continue
        pz = r2 * x + r5 * y + r8 * z
        gz = (pz - lz) * inverse
        if gz < 0.0 or gz >= nz:
            continue
        at = (int(gx) * ny + int(gy)) * nz + int(gz)
        first, last = starts[at], starts[at + 1]
        if first == last:
            continue
        ux, uy, uz = data[k, 3], data[k, 4], data[k, 5]
        vx, vy, vz = r0 * ux + r3 * uy + r6 * uz, r1 * ux + r4 * uy + r7 * uz, r2 * ux + r5 * uy + r8 * uz
        best = 2.0
        which = -1
        for q in range(first, last):
            j = items[q]
            fit = fit_one(k, data, kind_d, tols, j, model, kind_m, px, py, pz, vx, vy, vz, widen, radius_tol)
            if 0.0 <= fit < best:
                best = fit
                which = j
        if which >= 0:
            fits += 1
            quality += 1.0 - best * best
            if stamp[which] != mark:
                stamp[which] = mark
                distinct += 1
    if fits == 0:
        return 0.0
    return distinct + 0.9 * quality / fits


@njit
def assign(
    motion, model, kind_m, low, cell, shape, starts, items, data, kind_d, tols, widen, radius_tol, assignment, sign
):
    """Best model feature of every data feature under a pose, written to assignment and sign. Returns how many."""
    nx, ny, nz = shape
    count = 0
    for k in range(data.shape[0]):
        assignment[k] = -1
        sign[k] = 0
        x, y, z = data[k, 0] - motion[9], data[k, 1] - motion[10], data[k, 2] - motion[11]
        px = motion[0] * x + motion[3] * y + motion[6] * z
        py = motion[1] * x + motion[4] * y + motion[7] * z
        pz = motion[2] * x + motion[5] * y + motion[8] * z
        gx, gy, gz = (px - low[0]) / cell, (py - low[1]) / cell, (pz - low[2]) / cell
        if not (0.0 <= gx < nx and 0.0 <= gy < ny and 0.0 <= gz < nz):
            continue
        at = (int(gx) * ny + int(gy)) * nz + int(gz)
        ux, uy, uz = data[k, 3], data[k, 4], data[k, 5]
        vx = motion[0] * ux + motion[3] * uy + motion[6] * uz
        vy = motion[1] * ux + motion[4] * uy + motion[7] * uz
        vz = motion[2] * ux + motion[5] * uy + motion[8] * uz
        best = 2.0
        for q in range(starts[at], starts[at + 1]):
            j = items[q]
            fit = fit_one(k, data, kind_d, tols, j, model, kind_m, px, py, pz, vx, vy, vz, widen, radius_tol)
            if 0.0 <= fit < best:
                best = fit
                assignment[k] = j
                sign[k] = 1 if vx * model[j, 3] + vy * model[j, 4] + vz * model[j, 5] >= 0.0 else -1
        if assignment[k] >= 0:
            count += 1
    return count
