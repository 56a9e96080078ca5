"""The compiled inner loop of the prefilter: all pairs of a scene against one model.

As hypotheses.search_pairs, but with few pairs, the same for all models. Rows, tolerances and motions as in kernels.py.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

from ..geometry.kernels import OFFSET_CELLS, count_matches
from ..geometry.pair_pose import into_frame, pair_frame, pair_pose, pair_window, third
from .pair_search import _insert

NEEDED = 3.0  # distinct model features that a pose must explain


@njit(nogil=True)
def best_poses(
    pairs,
    near,
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
    data,
    kind_d,
    tols,
    widen,
    radius_tol,
    counts,
    count_only,
    middle,
    size,
    motions,
    scores,
):
    """The best of the pairs' poses into motions and scores; how many each pair has is added to ``counts``.

    count_only: no more than the latter
    """
    stamp = np.zeros(model.shape[0], np.int64)
    data_pair, model_pair, motion = np.empty(12), np.empty(12), np.empty(12)
    places, limits = np.empty((near.shape[1], 6)), np.empty((near.shape[1], 4))
    members = np.empty(near.shape[1], near.dtype)
    tried = 0
    inverse = 1.0 / cell
    for p in range(pairs.shape[0]):
        a, b = pairs[p, 0], pairs[p, 1]
        (angle, d, fa, fb, flip, cone, across, slide_a, slide_b, a_low, a_high, d_low, d_high) = pair_window(
            data, tols, a, b, reach
        )
        ha, hb = data[a, 6], data[b, 6]
        ready = False
        count = 0
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
                        pair_frame(data, a, fa, b, flip, fb, data_pair)
                        members[:] = near[p]
                        count = into_frame(a, b, data_pair, data, tols, members, widen, places, limits)
                        ready = True
                    if not placed:
                        pair_frame(model, i, fi, j, flip_j, fj, model_pair)
                        placed = True
                    tried += 1
                    if not third(
                        model_pair,
                        turn,
                        i,
                        j,
                        count,
                        places,
                        limits,
                        members,
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
                    score = count_matches(
                        motion,
                        model,
                        kind_m,
                        low,
                        cell,
                        shape,
                        vox_starts,
                        vox_items,
                        data,
                        kind_d,
                        tols,
                        widen,
                        radius_tol,
                        stamp,
                        tried,
                        max(scores[len(scores) - 1], NEEDED),
                    )
                    if score >= NEEDED:
                        _insert(motion, score, middle, size, motions, scores)
