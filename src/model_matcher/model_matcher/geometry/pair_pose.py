"""Poses from pairs of features, and the first quick test of one: whether a neighbour of the pair fits a third feature.

A pair of lines has a frame and a place: the orthonormal frame of its directions, and the middle of its two feet. A pose
takes the model pair's onto the data pair's. Neighbours of the data pair are brought into its frame once, and from there
into the model by each model pair's frame. Nothing is allocated for a hypothesis, and the first neighbour that fits a
third model feature decides. Rows, tolerances and motions as in kernels.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from .kernels import CURVE, FLIP_MARGIN, _pair_cell, pair_geometry


@njit
def pair_window(data, tols, a, b, reach):
    """What a model pair may be that a data pair lies on: where in the model's pair table it can stand, and how far off.

    Returns angle, signed distance, feet and flip of the data pair (kernels.pair_geometry); by how much a model pair may
    differ in angle (cone), in distance (across) and along either line (slides); and the table's cells, lowest and
    highest of angle, lowest and highest of distance. reach : metres, of the table.
    """
    c, s, d, fa, fb, flip = pair_geometry(data[a], data[b])
    angle = np.arctan2(s, c)
    over_a, over_b = max(0.0, abs(fa) - data[a, 6]), max(0.0, abs(fb) - data[b, 6])
    cone = min(tols[a, 2] + tols[b, 2], FLIP_MARGIN)
    across = tols[a, 0] + tols[b, 0] + tols[a, 2] * over_a + tols[b, 2] * over_b
    slide_a, slide_b = tols[a, 1] + across / s, tols[b, 1] + across / s
    a_low, d_low = _pair_cell(angle - cone, d - across, reach)
    a_high, d_high = _pair_cell(angle + cone, d + across, reach)
    return angle, d, fa, fb, flip, cone, across, slide_a, slide_b, a_low, a_high, d_low, d_high


@njit
def pair_frame(features, a, foot_a, b, flip_b, foot_b, out):
    """Frame and place of a pair into out (12,): rows bisector, in-plane, common normal, symmetric in the errors of both
    directions; then the middle of the feet. foot, flip : as kernels.pair_geometry gives them"""
    ux, uy, uz = features[a, 3], features[a, 4], features[a, 5]
    vx, vy, vz = flip_b * features[b, 3], flip_b * features[b, 4], flip_b * features[b, 5]
    ax, ay, az = ux + vx, uy + vy, uz + vz
    n = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = n * ax, n * ay, n * az
    cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    n = 1.0 / np.sqrt(cx * cx + cy * cy + cz * cz)
    cx, cy, cz = n * cx, n * cy, n * cz
    out[0], out[1], out[2] = ax, ay, az
    out[3], out[4], out[5] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    out[6], out[7], out[8] = cx, cy, cz
    out[9] = 0.5 * (features[a, 0] + foot_a * ux + features[b, 0] + foot_b * vx)
    out[10] = 0.5 * (features[a, 1] + foot_a * uy + features[b, 1] + foot_b * vy)
    out[11] = 0.5 * (features[a, 2] + foot_a * uz + features[b, 2] + foot_b * vz)


@njit
def pair_pose(data_pair, model_pair, turn, motion):
    """The pose that lays a model pair on a data pair, frames and places (12,); turn = -1 reverses both data directions,
    which is half a turn about the common normal."""
    for p in range(3):
        for q in range(3):
            motion[3 * p + q] = (
                turn * (data_pair[p] * model_pair[q] + data_pair[3 + p] * model_pair[3 + q])
                + data_pair[6 + p] * model_pair[6 + q]
            )
    for p in range(3):
        motion[9 + p] = data_pair[9 + p] - (
            motion[3 * p] * model_pair[9] + motion[3 * p + 1] * model_pair[10] + motion[3 * p + 2] * model_pair[11]
        )


@njit
def into_frame(a, b, pair, data, tols, near, widen, places, limits):
    """Neighbours of a data pair in the pair's frame: places (m, 6) point and direction, limits (m, 4) squared distance
    across, length and slack along, half length, squared cosine of the cone. The pair itself is left out.

    near : their numbers, -1 ends them. Returns how many are left; their numbers replace those in ``near``.
    """
    count = 0
    for at in range(len(near)):
        k = near[at]
        if k < 0:
            break
        if k in (a, b):
            continue
        x, y, z = data[k, 0] - pair[9], data[k, 1] - pair[10], data[k, 2] - pair[11]
        u, v, w = data[k, 3], data[k, 4], data[k, 5]
        for axis in range(3):
            fx, fy, fz = pair[3 * axis], pair[3 * axis + 1], pair[3 * axis + 2]
            places[count, axis] = fx * x + fy * y + fz * z
            places[count, 3 + axis] = fx * u + fy * v + fz * w
        limits[count, 0] = (tols[k, 0] * widen) ** 2
        limits[count, 1] = tols[k, 1] * widen
        limits[count, 2] = data[k, 6]
        limits[count, 3] = np.cos(min(tols[k, 2] * widen, 1.2)) ** 2
        near[count] = k
        count += 1
    return count


@njit
def third(
    pair,
    turn,
    i,
    j,
    count,
    places,
    limits,
    near,
    model,
    kind_m,
    low,
    inverse,
    shape,
    vox_starts,
    vox_items,
    data,
    kind_d,
    tols,
    radius_tol,
):
    """Whether a neighbour lies on a model feature other than i and j, whose frame and place is ``pair`` (12,)."""
    nx, ny, nz = shape
    # A reversed pair is turned half about the common normal.
    a0, a1, a2 = turn * pair[0], turn * pair[1], turn * pair[2]
    b0, b1, b2 = turn * pair[3], turn * pair[4], turn * pair[5]
    c0, c1, c2 = pair[6], pair[7], pair[8]
    cx, cy, cz = pair[9], pair[10], pair[11]
    lx, ly, lz = low[0], low[1], low[2]
    for at in range(count):
        p, q, r = places[at, 0], places[at, 1], places[at, 2]
        x = cx + p * a0 + q * b0 + r * c0
        gx = (x - lx) * inverse
        if gx < 0.0 or gx >= nx:
            continue
        y = cy + p * a1 + q * b1 + r * c1
        gy = (y - ly) * inverse
        if gy < 0.0 or gy >= ny:
            continue
        z = cz + p * a2 + q * b2 + r * c2
        gz = (z - lz) * inverse
        if gz < 0.0 or gz >= nz:
            continue
        cell = (int(gx) * ny + int(gy)) * nz + int(gz)
        first, last = vox_starts[cell], vox_starts[cell + 1]
        if first == last:
            continue
        p, q, r = places[at, 3], places[at, 4], places[at, 5]
        vx, vy, vz = p * a0 + q * b0 + r * c0, p * a1 + q * b1 + r * c1, p * a2 + q * b2 + r * c2
        k = near[at]
        across, slack, h, cone = limits[at, 0], limits[at, 1], limits[at, 2], limits[at, 3]
        for item in range(first, last):
            m = vox_items[item]
            if m in (i, j) or kind_d[k] != kind_m[m]:
                continue
            ux, uy, uz = model[m, 3], model[m, 4], model[m, 5]
            c = vx * ux + vy * uy + vz * uz
            if c * c < cone:
                continue
            dx, dy, dz = x - model[m, 0], y - model[m, 1], z - model[m, 2]
            along = dx * ux + dy * uy + dz * uz
            if abs(along) + abs(c) * h > model[m, 6] + slack:
                continue
            dx, dy, dz = dx - along * ux, dy - along * uy, dz - along * uz
            sx, sy, sz = h * (vx - c * ux), h * (vy - c * uy), h * (vz - c * uz)
            worst = dx * dx + dy * dy + dz * dz + sx * sx + sy * sy + sz * sz + 2.0 * abs(dx * sx + dy * sy + dz * sz)
            if worst > across:
                continue
            if kind_d[k] == CURVE:
                room = radius_tol + tols[k, 0]
                if abs(data[k, 7] - model[m, 7]) > room or abs(data[k, 8] - model[m, 8]) > room:
                    continue
            return True
    return False
