"""Compiled loop over pairs of pieces for :func:`.segmentation.corners`."""

from __future__ import annotations

import numpy as np
from numba import njit

# Below this sine the crossing of two lines is too vague to be a corner.
LEAST_SINE = 0.15
# A string may run around a corner by this much, pixels, before it ends.
OVERRUN = 4.0
# Without a corner, a string stops this uncertainly, pixels.
LOOSE_END = 1.5


@njit(cache=True)
def meet(table, gap):
    """table : (n, 8) float64: centre u, v; direction; first and last place; sigma of offset and slope."""
    n = len(table)
    place = table[:, 4:6].copy()
    other = np.full((n, 2), -1, np.int32)
    through = np.zeros((n, 2), np.bool_)
    sigma = np.full((n, 2), LOOSE_END)
    box = np.empty((n, 4))
    for i in range(n):
        for c in range(2):
            a = table[i, c] + table[i, 4] * table[i, 2 + c]
            b = table[i, c] + table[i, 5] * table[i, 2 + c]
            box[i, c], box[i, 2 + c] = min(a, b) - gap, max(a, b) + gap
    for i in range(n):
        for e in range(2):
            s_end = table[i, 4 + e]
            outward = -1.0 if e == 0 else 1.0
            x = table[i, 0] + s_end * table[i, 2]
            y = table[i, 1] + s_end * table[i, 3]
            best = 1e30
            for k in range(n):
                if k == i or x < box[k, 0] or y < box[k, 1] or x > box[k, 2] or y > box[k, 3]:
                    continue
                sine = table[i, 2] * table[k, 3] - table[i, 3] * table[k, 2]
                if abs(sine) < LEAST_SINE:
                    continue
                dx, dy = table[k, 0] - table[i, 0], table[k, 1] - table[i, 1]
                s = (dx * table[k, 3] - dy * table[k, 2]) / sine
                r = (dx * table[i, 3] - dy * table[i, 2]) / sine
                beyond = (s - s_end) * outward
                if beyond > gap or beyond < -min(OVERRUN, 0.4 * (table[i, 5] - table[i, 4])):
                    continue
                outside = max(table[k, 4] - r, r - table[k, 5])
                if outside > gap:
                    continue
                # Long lines are trusted more than the scraps between them.
                cost = abs(beyond) + max(outside, 0.0) + 20.0 / (table[k, 5] - table[k, 4])
                if cost < best:
                    best = cost
                    place[i, e] = s
                    other[i, e] = k
                    through[i, e] = outside < -OVERRUN - 2.0
                    own = table[i, 6] ** 2 + (s * table[i, 7]) ** 2
                    its = table[k, 6] ** 2 + (r * table[k, 7]) ** 2
                    cosine2 = 1.0 - sine * sine
                    sigma[i, e] = np.sqrt((its + cosine2 * own) / (sine * sine) + 0.0025)
    return place, other, through, sigma
