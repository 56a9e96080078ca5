"""Compiled loop over pairs of segments for :mod:`.junctions`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

# Below this sine the crossing of two lines is too vague to be a corner.
LEAST_SINE = 0.15
# Unless it is that of two chains whose ends touch, pixels, and known to this, one sigma.
BLUNT_SINE, BLUNT_GAP = 0.06, 6.0
VAGUEST = 3.0
# Two segments of one line differ in direction by less than this (sine); at a crossing by less than that.
COLLINEAR = 0.03
CROSSING = 0.2
# How far from a square corner a chain may end, pixels.
NEAR_GAP = 4.0
# A chain may run around a corner by this much, pixels, before it ends.
OVERRUN = 4.0
# Variance of a corner beyond that of its lines, px^2.
ROUNDED_VARIANCE = 0.0001
# Without a corner, a chain stops this uncertainly, pixels.
LOOSE_END = 1.5
# A chain is lost beside another that is this near, pixels, and runs along with it (cosine); its line hits the corner
# where they meet to this, pixels.
BLURRED = 5.0
ALONG = 0.94
AT_CORNER = 0.7


@njit
def _goes_on(table, box, k, i, x, y, collinear):
    """Whether a segment other than i continues segment k on its line beyond the point x, y."""
    own = (x - table[k, 0]) * table[k, 2] + (y - table[k, 1]) * table[k, 3]
    # Which way segment k lies from the point.
    ahead = 0.5 * (table[k, 4] + table[k, 5]) - own
    for m in range(len(table)):
        itself = (m == k) | (m == i)
        if itself or x < box[m, 0] or y < box[m, 1] or x > box[m, 2] or y > box[m, 3]:
            continue
        if table[m, 5] - table[m, 4] < 5.0 or abs(table[k, 2] * table[m, 3] - table[k, 3] * table[m, 2]) > collinear:
            continue
        if abs((x - table[m, 0]) * table[m, 3] - (y - table[m, 1]) * table[m, 2]) > 1.5:
            continue
        middle = 0.5 * (table[m, 4] + table[m, 5])
        mx, my = table[m, 0] + middle * table[m, 2] - x, table[m, 1] + middle * table[m, 3] - y
        if (mx * table[k, 2] + my * table[k, 3]) * ahead < 0.0:
            return True
    return False


@njit
def find_junctions(table, widest):
    """table : (n, 8) float64: centre u, v; direction; first and last place; sigma of offset and slope.

    widest : gap, pixels.
    """
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
            box[i, c], box[i, 2 + c] = min(a, b) - widest, max(a, b) + widest
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
                if abs(sine) < BLUNT_SINE:
                    continue
                dx, dy = table[k, 0] - table[i, 0], table[k, 1] - table[i, 1]
                s = (dx * table[k, 3] - dy * table[k, 2]) / sine
                r = (dx * table[i, 3] - dy * table[i, 2]) / sine
                beyond = (s - s_end) * outward
                # The sharper the corner, the farther from it its two edges blur into one.
                gap = min(widest, NEAR_GAP + NEAR_GAP / abs(sine))
                if beyond > gap or beyond < -min(OVERRUN, 0.4 * (table[i, 5] - table[i, 4])):
                    continue
                outside = max(table[k, 4] - r, r - table[k, 5])
                if outside > gap:
                    continue
                own = table[i, 6] ** 2 + (s * table[i, 7]) ** 2
                its = table[k, 6] ** 2 + (r * table[k, 7]) ** 2
                spread = np.sqrt((its + (1.0 - sine * sine) * own) / (sine * sine) + ROUNDED_VARIANCE)
                # Two edges that go on in nearly one direction meet where their chains do.
                if abs(sine) < LEAST_SINE and (
                    spread > VAGUEST
                    or abs(beyond) > BLUNT_GAP
                    or abs(outside) > BLUNT_GAP
                    or table[i, 2] * table[k, 2] + table[i, 3] * table[k, 3] < 0.0
                ):
                    continue
                # Long lines are trusted more than the scraps between them.
                cost = abs(beyond) + max(outside, 0.0) + 20.0 / (table[k, 5] - table[k, 4])
                if cost < best:
                    best = cost
                    place[i, e] = s
                    other[i, e] = k
                    through[i, e] = outside < -OVERRUN - 2.0
                    sigma[i, e] = spread
            # A bar may be broken just where the stem meets it: then one of the two goes on in another segment.
            k = other[i, e]
            if k >= 0 and not through[i, e]:
                jx, jy = table[i, 0] + place[i, e] * table[i, 2], table[i, 1] + place[i, e] * table[i, 3]
                # A crossing of two lines (both go on, though roughly) is a corner of four faces.
                if _goes_on(table, box, k, i, jx, jy, COLLINEAR):
                    through[i, e] = not _goes_on(table, box, i, k, jx, jy, CROSSING)
                elif _goes_on(table, box, i, k, jx, jy, COLLINEAR):
                    through[i, e] = not _goes_on(table, box, k, i, jx, jy, CROSSING)
    _beside(table, place, other, sigma)
    return place, other, through, sigma


@njit
def _beside(table, place, other, sigma):
    """Ends that no corner was found for, of chains that are lost where they near another: they share its corner."""
    n = len(table)
    for i in range(n):
        length = table[i, 5] - table[i, 4]
        for e in range(2):
            if other[i, e] >= 0:
                continue
            outward = -1.0 if e == 0 else 1.0
            x = table[i, 0] + table[i, 4 + e] * table[i, 2]
            y = table[i, 1] + table[i, 4 + e] * table[i, 3]
            best = 1e30
            for k in range(n):
                if k == i or table[k, 5] - table[k, 4] < 10.0:
                    continue
                cosine = table[i, 2] * table[k, 2] + table[i, 3] * table[k, 3]
                if abs(cosine) < ALONG:
                    continue
                dx, dy = x - table[k, 0], y - table[k, 1]
                r = dx * table[k, 2] + dy * table[k, 3]
                off = abs(dx * table[k, 3] - dy * table[k, 2])
                if off > BLURRED or r < table[k, 4] or r > table[k, 5]:
                    continue
                far = e if cosine > 0.0 else 1 - e
                if other[k, far] < 0 or other[k, far] == i:
                    continue
                cx = table[k, 0] + place[k, far] * table[k, 2] - table[i, 0]
                cy = table[k, 1] + place[k, far] * table[k, 3] - table[i, 1]
                s = cx * table[i, 2] + cy * table[i, 3]
                beyond = (s - table[i, 4 + e]) * outward
                miss = abs(cx * table[i, 3] - cy * table[i, 2])
                allowed = AT_CORNER + 2.0 * np.sqrt(table[i, 6] ** 2 + (s * table[i, 7]) ** 2)
                if beyond < 0.0 or beyond > length or miss > min(allowed, 2.0 * AT_CORNER) or miss > off:
                    continue
                if miss < best:
                    best = miss
                    place[i, e] = s
                    other[i, e] = other[k, far]
                    sigma[i, e] = np.sqrt(sigma[k, far] ** 2 + AT_CORNER**2)


@njit
def spurious(table, longest, reach, width):
    """(n,) bool: short segments that only show how a longer segment bends where it nears another (or how it blurs).

    Such a segment has both ends within ``width`` pixels of the longer one's line, at most ``reach`` pixels beyond it.
    """
    n = len(table)
    scrap = np.zeros(n, np.bool_)
    for k in range(n):
        length = table[k, 5] - table[k, 4]
        if length > longest:
            continue
        for m in range(n):
            if m == k or table[m, 5] - table[m, 4] < 2.0 * length or table[m, 5] - table[m, 4] < 10.0:
                continue
            if table[k, 2] * table[m, 2] + table[k, 3] * table[m, 3] < 0.8:
                continue
            near = True
            for e in range(2):
                x = table[k, 0] + table[k, 4 + e] * table[k, 2] - table[m, 0]
                y = table[k, 1] + table[k, 4 + e] * table[k, 3] - table[m, 1]
                s = x * table[m, 2] + y * table[m, 3]
                if abs(x * table[m, 3] - y * table[m, 2]) > width or s < table[m, 4] - reach or s > table[m, 5] + reach:
                    near = False
                    break
            if near:
                scrap[k] = True
                break
    return scrap
