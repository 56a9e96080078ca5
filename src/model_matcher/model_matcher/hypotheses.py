"""The production search: two non-parallel data features fix a pose; back-projection counts what it explains.

Ranked data pairs are looked up in the model's pair table by angle and signed line distance, tested exactly for a
common rigid motion, turned into a pose, and the pose is scored by the number of distinct model features that data lie
on. The best poses, near duplicates suppressed, are the candidates. Cost hardly depends on how much data is spurious.
"""

from __future__ import annotations

import numpy as np

from msgs_py.compiled import njit

from .evidence import evidence, plane_table
from .kernels import FLIP_MARGIN, OFFSET_CELLS, _pair_cell, assign, count_matches, pair_geometry
from .refinement_kernels import refine

CANDIDATES = 16
WORTH_KEEPING = 0.35  # share of the best score: a decoy may explain more features than a model half hidden
LOCAL_TEST = 50  # with more data than this, a pose is first tried on the pair's neighbours,
LOCAL_PARTNERS = 12  # the best partners of each of the two
# While the best explains less than this share of a large model, patience is so many times longer: each data pair has
# more hypotheses there, and 8000 are soon used up.
LITTLE, LONGER = 0.08, 6.0


@njit
def _frame(u, v, out):
    """Orthonormal frame of two directions, symmetric in their errors: rows bisector, in-plane, common normal."""
    ax, ay, az = u[0] + v[0], u[1] + v[1], u[2] + v[2]
    n = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / n, ay / n, az / n
    cx, cy, cz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    n = np.sqrt(cx * cx + cy * cy + cz * cz)
    cx, cy, cz = cx / n, cy / n, cz / n
    out[0], out[1], out[2] = ax, ay, az
    out[3], out[4], out[5] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    out[6], out[7], out[8] = cx, cy, cz


@njit
def _pose_of_pair(a, b, flip_b, fa, fb, i, j, flip_j, fi, fj, turn, frame_d, frame_m, motion):
    """The pose that lays model lines i, j on data lines a, b; turn = -1 reverses both data directions."""
    u, v = np.empty(3), np.empty(3)
    for k in range(3):
        u[k] = turn * a[3 + k]
        v[k] = turn * flip_b * b[3 + k]
    _frame(u, v, frame_d)
    for k in range(3):
        u[k] = i[3 + k]
        v[k] = flip_j * j[3 + k]
    _frame(u, v, frame_m)
    for p in range(3):
        for q in range(3):
            motion[3 * p + q] = (frame_d[p] * frame_m[q] + frame_d[3 + p] * frame_m[3 + q]
                                 + frame_d[6 + p] * frame_m[6 + q])
    cm = np.empty(3)
    for k in range(3):
        cm[k] = 0.5 * (i[k] + fi * i[3 + k] + j[k] + fj * flip_j * j[3 + k])
    for p in range(3):
        cd = 0.5 * (a[p] + fa * a[3 + p] + b[p] + fb * flip_b * b[3 + p])
        motion[9 + p] = cd - (motion[3 * p] * cm[0] + motion[3 * p + 1] * cm[1] + motion[3 * p + 2] * cm[2])


@njit
def _insert(motion, score, middle, size, motions, scores):
    """Keep a pose among the best, unless a better one stands within 6 degrees and 6 % of the model's size."""
    twin = -1
    mx = motion[0] * middle[0] + motion[1] * middle[1] + motion[2] * middle[2] + motion[9]
    my = motion[3] * middle[0] + motion[4] * middle[1] + motion[5] * middle[2] + motion[10]
    mz = motion[6] * middle[0] + motion[7] * middle[1] + motion[8] * middle[2] + motion[11]
    for k in range(len(scores)):
        if scores[k] <= 0.0:
            break
        other = motions[k]
        trace = 0.0
        for i in range(9):
            trace += motion[i] * other[i]
        if trace < 2.989:
            continue
        dx = mx - (other[0] * middle[0] + other[1] * middle[1] + other[2] * middle[2] + other[9])
        dy = my - (other[3] * middle[0] + other[4] * middle[1] + other[5] * middle[2] + other[10])
        dz = mz - (other[6] * middle[0] + other[7] * middle[1] + other[8] * middle[2] + other[11])
        if dx * dx + dy * dy + dz * dz > (0.06 * size) ** 2:
            continue
        if scores[k] >= score:
            return
        twin = k
        break
    at = len(scores) - 1 if twin < 0 else twin
    if twin < 0 and score <= scores[at]:
        return
    while at > 0 and scores[at - 1] < score:
        scores[at] = scores[at - 1]
        motions[at] = motions[at - 1]
        at -= 1
    scores[at] = score
    motions[at] = motion


@njit(nogil=True)
def _gather(data, kind_d, tols, a, reach, widen, around, around_kind, around_tols):
    """Copy what can lie on a model that data feature a lies on: all within reach (metres) and its own tolerances."""
    count = 0
    for k in range(data.shape[0]):
        x, y, z = data[k, 0] - data[a, 0], data[k, 1] - data[a, 1], data[k, 2] - data[a, 2]
        limit = reach + widen * (tols[k, 0] + tols[k, 1])
        if x * x + y * y + z * z <= limit * limit:
            for i in range(9):
                around[count, i] = data[k, i]
            for i in range(3):
                around_tols[count, i] = tols[k, i]
            around_kind[count] = kind_d[k]
            count += 1
    return count


@njit(nogil=True)
def search_pairs(pairs, partners, model, kind_m, pair_starts, pair_members, pair_values, reach, low, cell, shape,
                 vox_starts, vox_items, middle, size, data, kind_d, tols, widen, radius_tol, first, last, patience,
                 motions, scores, state):
    """Try the ranked data pairs first..last-1; best poses and scores are kept in ``motions`` and ``scores``.

    partners : (n, knn) int32, the features that each one pairs with best: a pose must explain one of them besides the
        pair itself, or the rest of the data is not looked at
    patience : (least, most) stop once the best is unchanged for so many hypotheses: least x the square of data per
        explained model feature, at most ``most``, LONGER while LITTLE is explained; a pair of data features is always
        finished, so that every pose which explains the same data is found
    state : (4,) int64, carried between calls: hypotheses so far, hypothesis of the last improvement, pairs done,
        1 when stopped by patience
    """
    stamp = np.zeros(model.shape[0], np.int64)
    frame_d, frame_m, motion = np.empty(9), np.empty(9), np.empty(12)
    n = data.shape[0]
    knn = min(partners.shape[1], LOCAL_PARTNERS)
    local = n > LOCAL_TEST
    near = np.empty((2 * knn + 2, 9))
    near_kind = np.empty(2 * knn + 2, kind_d.dtype)
    near_tols = np.empty((2 * knn + 2, 3))
    entered = np.full(n, -1, np.int64)
    around, around_kind, around_tols = data.copy(), kind_d.copy(), tols.copy()
    for p in range(first, last):
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
        before = state[1]
        count = 0
        n_around = -1 if local else n
        if local:
            for k in range(2 * knn + 2):
                if k < 2:
                    other = a if k == 0 else b
                else:
                    other = partners[a, k - 2] if k < knn + 2 else partners[b, k - 2 - knn]
                if other < 0 or entered[other] == p:
                    continue
                entered[other] = p
                near[count], near_kind[count], near_tols[count] = data[other], kind_d[other], tols[other]
                count += 1
        for ca in range(a_low, a_high + 1):
            row = ca * OFFSET_CELLS
            for at in range(pair_starts[row + d_low], pair_starts[row + d_high + 1]):
                value = pair_values[at]
                if abs(value[0] - angle) > cone or abs(value[1] - d) > across:
                    continue
                i, j = pair_members[at, 0], pair_members[at, 1]
                if kind_d[a] != kind_m[i] or kind_d[b] != kind_m[j]:
                    continue
                room_a, room_b = model[i, 6] - ha + slide_a, model[j, 6] - hb + slide_b
                for turning in range(2):
                    turn = 1.0 - 2.0 * turning
                    if abs(value[2] - turn * fa) > room_a or abs(value[3] - turn * fb) > room_b:
                        continue
                    _pose_of_pair(data[a], data[b], flip, fa, fb, model[i], model[j], value[4], value[2], value[3],
                                  turn, frame_d, frame_m, motion)
                    state[0] += 1
                    if local and count_matches(motion, model, kind_m, low, cell, shape, vox_starts, vox_items,
                                               near[:count], near_kind[:count], near_tols[:count], widen, radius_tol,
                                               stamp, -1 - state[0], 3.0) < 3.0:
                        continue
                    if n_around < 0:
                        reach_a = size + slide_a + across + cone * abs(fa)
                        n_around = _gather(data, kind_d, tols, a, reach_a, widen, around, around_kind, around_tols)
                    needed = max(scores[len(scores) - 1], WORTH_KEEPING * np.floor(scores[0]), 3.0)
                    score = count_matches(motion, model, kind_m, low, cell, shape, vox_starts, vox_items,
                                          around[:n_around], around_kind[:n_around], around_tols[:n_around], widen,
                                          radius_tol, stamp, state[0], needed)
                    if score < needed:
                        continue
                    if np.floor(score) > np.floor(scores[0]):
                        state[1] = state[0]
                    _insert(motion, score, middle, size, motions, scores)
        state[2] = p + 1
        if before != state[1]:
            continue
        waited = state[0] - state[1]
        share = n / max(np.floor(scores[0]), 3.0)
        longer = LONGER if max(scores[0], 3.0) < LITTLE * model.shape[0] else 1.0
        if waited > longer * min(patience[0] * share * share, patience[1]) or scores[0] >= n:
            state[3] = 1
            return


@njit(nogil=True)
def refine_candidates(motions, scores, keep, doubtful, model, kind_m, low, cell, shape, vox_starts, vox_items, data,
                      kind_d, tols, widths, radius_tol, middle, size, order, direction, normals, offsets, by_offset,
                      assignments, signs, matrices, figures):
    """Refine every candidate whose score is at least keep x best; all, when the best evidence of these is doubtful.

    doubtful : nats
    middle to by_offset : of the model, see ModelIndex and Regularity
    figures (c, 8): score, rms (metres), chi, centre x, y, z, data matched, evidence (nats). Score is the number of
    distinct model features plus 0.9 x the mean quality of fit; 0 for a candidate that was skipped.
    """
    stamp = np.full(model.shape[0], -1, np.int64)
    inverse = 0.0
    for k in range(len(tols)):
        inverse += 1.0 / tols[k, 0]
    number, nats = plane_table(offsets, by_offset, len(tols) / inverse)
    final = widths[len(widths) - 1]
    best = -np.inf
    figures[:, 0] = 0.0
    for k in range(len(scores)):
        if scores[k] <= 0.0 or (np.floor(scores[k]) < keep * np.floor(scores[0]) and best >= doubtful):
            continue
        matched, rms, chi, cx, cy, cz = refine(motions[k], model, kind_m, low, cell, shape, vox_starts, vox_items, data,
                                               kind_d, tols, widths, radius_tol, assignments[k], signs[k], matrices[k])
        matched = assign(motions[k], model, kind_m, low, cell, shape, vox_starts, vox_items, data, kind_d, tols, final,
                         radius_tol, assignments[k], signs[k])
        figures[k, 0] = count_matches(motions[k], model, kind_m, low, cell, shape, vox_starts, vox_items, data, kind_d,
                                      tols, final, radius_tol, stamp, k, 0.0)
        figures[k, 1], figures[k, 2] = rms, chi
        figures[k, 3], figures[k, 4], figures[k, 5], figures[k, 6] = cx, cy, cz, matched
        figures[k, 7] = evidence(motions[k], model, kind_m, data, kind_d, tols, assignments[k], middle, size, order,
                                 direction, normals, number, nats)
        best = max(best, figures[k, 7])
