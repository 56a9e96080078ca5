"""The production search: two non-parallel data features fix a pose; back-projection counts what it explains.

Ranked data pairs are looked up in the model's pair table by angle and signed line distance, tested exactly for a
common rigid motion, turned into a pose, and the pose is scored by the number of distinct model features that data lie
on. The best poses, near duplicates suppressed, are the candidates. Cost hardly depends on how much data is spurious.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.kernels import OFFSET_CELLS, count_matches
from ..geometry.pair_pose import into_frame, pair_frame, pair_pose, pair_window, third

WORTH_KEEPING = 0.35  # share of the best score: a decoy may explain more features than a model half hidden
LOCAL_TEST = 50  # with more data than this, a pose is first tried on the pair's neighbours,
LOCAL_PARTNERS = 12  # the best partners of each of the two
# While the best explains less than this share of a large model, patience is so many times longer: each data pair has
# more hypotheses there, and 8000 are soon used up.
LITTLE, LONGER = 0.08, 6.0


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
def search_pairs(
    pairs,
    partners,
    model,
    kind_m,
    pair_starts,
    pair_members,
    pair_values,
    reach,
    low,
    cell,
    shape,
    vox_starts,
    vox_items,
    middle,
    size,
    data,
    kind_d,
    tols,
    widen,
    radius_tol,
    first,
    last,
    patience,
    motions,
    scores,
    state,
):
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
    data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
    n = data.shape[0]
    knn = min(partners.shape[1], LOCAL_PARTNERS)
    local = n > LOCAL_TEST
    near = np.empty(2 * knn + 1, np.int32)
    places, limits = np.empty((2 * knn, 6)), np.empty((2 * knn, 4))
    inverse = 1.0 / cell
    entered = np.full(n, -1, np.int64)
    around, around_kind, around_tols = data.copy(), kind_d.copy(), tols.copy()
    for p in range(first, last):
        a, b = pairs[p, 0], pairs[p, 1]
        (angle, d, fa, fb, flip, cone, across, slide_a, slide_b, a_low, a_high, d_low, d_high) = pair_window(
            data, tols, a, b, reach
        )
        ha, hb = data[a, 6], data[b, 6]
        before = state[1]
        n_around = -1 if local else n
        pair_frame(data, a, fa, b, flip, fb, data_pair)
        count = 0
        if local:
            for k in range(2 * knn):
                other = partners[a, k] if k < knn else partners[b, k - knn]
                if other >= 0 and entered[other] != p:
                    entered[other] = p
                    near[count] = other
                    count += 1
            near[count] = -1
            count = into_frame(a, b, data_pair, data, tols, near, widen, places, limits)
        shortest = min(ha - slide_a, hb - slide_b)
        for cell_of_pair in range((a_high - a_low + 1) * (d_high - d_low + 1)):
            ca, cd = cell_of_pair // (d_high - d_low + 1), cell_of_pair % (d_high - d_low + 1)
            row = (a_low + ca) * OFFSET_CELLS + d_low + cd
            for at in range(pair_starts[row], pair_starts[row + 1]):
                if pair_values[at, 5] < shortest:
                    break
                if abs(pair_values[at, 0] - angle) > cone or abs(pair_values[at, 1] - d) > across:
                    continue
                i, j = pair_members[at, 0], pair_members[at, 1]
                if kind_d[a] != kind_m[i] or kind_d[b] != kind_m[j]:
                    continue
                room_a, room_b = model[i, 6] - ha + slide_a, model[j, 6] - hb + slide_b
                foot_i, foot_j, flip_j = pair_values[at, 2], pair_values[at, 3], pair_values[at, 4]
                placed = False
                for turning in range(2):
                    turn = 1.0 - 2.0 * turning
                    if abs(foot_i - turn * fa) > room_a or abs(foot_j - turn * fb) > room_b:
                        continue
                    state[0] += 1
                    if not placed:
                        pair_frame(model, i, foot_i, j, flip_j, foot_j, model_pair)
                        placed = True
                    if local and not third(
                        model_pair,
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
                        continue
                    pair_pose(data_pair, model_pair, turn, motion)
                    if n_around < 0:
                        reach_a = size + slide_a + across + cone * abs(fa)
                        n_around = _gather(data, kind_d, tols, a, reach_a, widen, around, around_kind, around_tols)
                    needed = max(scores[len(scores) - 1], WORTH_KEEPING * np.floor(scores[0]), 3.0)
                    score = count_matches(
                        motion,
                        model,
                        kind_m,
                        low,
                        cell,
                        shape,
                        vox_starts,
                        vox_items,
                        around[:n_around],
                        around_kind[:n_around],
                        around_tols[:n_around],
                        widen,
                        radius_tol,
                        stamp,
                        state[0],
                        needed,
                    )
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
