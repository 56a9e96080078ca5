"""The compiled inner loop of the prefilter: all pairs of a scene against one model.

As hypotheses.search_pairs, but a pose is tried on the neighbours of its pair before it is made: the neighbours are
brought into the frame of the data pair once, and from there into the model by each model pair's frame. Nothing is
allocated for a hypothesis, and the first neighbour that fits a third model feature decides.
Rows, tolerances and motions as in kernels.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.compiled import njit

from .hypotheses import _frame, _insert, _pose_of_pair
from .kernels import CURVE, FLIP_MARGIN, OFFSET_CELLS, _pair_cell, count_matches, pair_geometry

NEEDED = 3.0  # distinct model features that a pose must explain


@njit
def _into_frame(a, b, flip, fa, fb, frame, data, tols, near, widen, places, limits):
    """Neighbours of a data pair in the pair's frame: places (m, 6) point and direction, limits (m, 4) squared distance
    across, length and slack along, half length, squared cosine of the cone. The pair itself is left out.

    Returns how many; their numbers replace those in ``near``.
    """
    ox = 0.5 * (data[a, 0] + fa * data[a, 3] + data[b, 0] + fb * flip * data[b, 3])
    oy = 0.5 * (data[a, 1] + fa * data[a, 4] + data[b, 1] + fb * flip * data[b, 4])
    oz = 0.5 * (data[a, 2] + fa * data[a, 5] + data[b, 2] + fb * flip * data[b, 5])
    count = 0
    for at in range(len(near)):
        k = near[at]
        if k < 0:
            break
        if k in (a, b):
            continue
        x, y, z = data[k, 0] - ox, data[k, 1] - oy, data[k, 2] - oz
        u, v, w = data[k, 3], data[k, 4], data[k, 5]
        for axis in range(3):
            fx, fy, fz = frame[3 * axis], frame[3 * axis + 1], frame[3 * axis + 2]
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
def _third(frame, cx, cy, cz, turn, i, j, count, places, limits, near, model, kind_m, low, inverse, shape, vox_starts,
           vox_items, data, kind_d, tols, radius_tol):
    """Whether a neighbour lies on a model feature other than i and j; frame (9,) and c: of the model pair."""
    nx, ny, nz = shape
    # A reversed pair is turned half about the common normal.
    a0, a1, a2 = turn * frame[0], turn * frame[1], turn * frame[2]
    b0, b1, b2 = turn * frame[3], turn * frame[4], turn * frame[5]
    c0, c1, c2 = frame[6], frame[7], frame[8]
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
            worst = (dx * dx + dy * dy + dz * dz + sx * sx + sy * sy + sz * sz
                     + 2.0 * abs(dx * sx + dy * sy + dz * sz))
            if worst > across:
                continue
            if kind_d[k] == CURVE:
                room = radius_tol + tols[k, 0]
                if abs(data[k, 7] - model[m, 7]) > room or abs(data[k, 8] - model[m, 8]) > room:
                    continue
            return True
    return False


@njit(nogil=True)
def best_poses(pairs, near, model, kind_m, pair_starts, pair_members, pair_values, reach, low, cell, shape,
               vox_starts, vox_items, data, kind_d, tols, widen, radius_tol, counts, count_only, middle, size, motions,
               scores):
    """The best of the pairs' poses into motions and scores; how many each pair has is added to ``counts``.

    count_only: no more than the latter
    """
    stamp = np.zeros(model.shape[0], np.int64)
    frame_d, frame_m, motion = np.empty(9), np.empty(9), np.empty(12)
    places, limits = np.empty((near.shape[1], 6)), np.empty((near.shape[1], 4))
    members = np.empty(near.shape[1], near.dtype)
    u, v = np.empty(3), np.empty(3)
    tried = 0
    inverse = 1.0 / cell
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        c, s, d, fa, fb, flip = pair_geometry(data[a], data[b])
        angle = np.arctan2(s, c)
        ha, hb = data[a, 6], data[b, 6]
        over_a, over_b = max(0.0, abs(fa) - ha), max(0.0, abs(fb) - hb)
        cone = min(tols[a, 2] + tols[b, 2], FLIP_MARGIN)
        across = tols[a, 0] + tols[b, 0] + tols[a, 2] * over_a + tols[b, 2] * over_b
        slide_a = tols[a, 1] + across / s
        slide_b = tols[b, 1] + across / s
        a_low, d_low = _pair_cell(angle - cone, d - across, reach)
        a_high, d_high = _pair_cell(angle + cone, d + across, reach)
        ready = False
        count = 0
        for ca in range(a_low, a_high + 1):
            row = ca * OFFSET_CELLS
            for at in range(pair_starts[row + d_low], pair_starts[row + d_high + 1]):
                if abs(pair_values[at, 0] - angle) > cone or abs(pair_values[at, 1] - d) > across:
                    continue
                i, j = pair_members[at, 0], pair_members[at, 1]
                if kind_d[a] != kind_m[i] or kind_d[b] != kind_m[j]:
                    continue
                room_a, room_b = model[i, 6] - ha + slide_a, model[j, 6] - hb + slide_b
                fi, fj, flip_j = pair_values[at, 2], pair_values[at, 3], pair_values[at, 4]
                placed = False
                for turning in range(2):
                    turn = 1.0 - 2.0 * turning
                    if abs(fi - turn * fa) > room_a or abs(fj - turn * fb) > room_b:
                        continue
                    counts[p] += 1
                    if count_only:
                        continue
                    if not ready:
                        for k in range(3):
                            u[k], v[k] = data[a, 3 + k], flip * data[b, 3 + k]
                        _frame(u, v, frame_d)
                        members[:] = near[p]
                        count = _into_frame(a, b, flip, fa, fb, frame_d, data, tols, members, widen, places, limits)
                        ready = True
                    if not placed:
                        for k in range(3):
                            u[k], v[k] = model[i, 3 + k], flip_j * model[j, 3 + k]
                        _frame(u, v, frame_m)
                        placed = True
                    tried += 1
                    if not _third(frame_m, 0.5 * (model[i, 0] + fi * u[0] + model[j, 0] + fj * v[0]),
                                  0.5 * (model[i, 1] + fi * u[1] + model[j, 1] + fj * v[1]),
                                  0.5 * (model[i, 2] + fi * u[2] + model[j, 2] + fj * v[2]), turn, i, j, count, places,
                                  limits, members, model, kind_m, low, inverse, shape, vox_starts, vox_items, data,
                                  kind_d, tols, radius_tol):
                        continue
                    _pose_of_pair(data[a], data[b], flip, fa, fb, model[i], model[j], flip_j, fi, fj, turn, np.empty(9),
                                  np.empty(9), motion)
                    score = count_matches(motion, model, kind_m, low, cell, shape, vox_starts, vox_items, data, kind_d,
                                          tols, widen, radius_tol, stamp, tried, max(scores[len(scores) - 1], NEEDED))
                    if score >= NEEDED:
                        _insert(motion, score, middle, size, motions, scores)
