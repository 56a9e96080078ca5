"""Compiled loop along the lines of faint segments, for :mod:`.faint_edges`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit

# Pixels of a line that are looked at together, in steps of so many; and so far beside it.
WINDOW, STEP, ASIDE = 9, 2.0, 3.0
# A line goes on where the gradient's median is this share of what it is on the segment, and stands out by this share
# from what is beside it.
SHARE, PROMINENT = 0.45, 0.4
# Longest continuation, pixels, and as a share of the segment.
LONGEST, LONGEST_SHARE = 60.0, 2.0
# Where its sigma exceeds this, pixels, a line is not followed; nor beyond an end that another segment's end touches.
UNSURE, TOUCHING = 0.5, 4.5
# It ends where another segment of its line begins: within this, pixels, and this sine.
SAME_LINE, SAME_WAY = 1.2, 0.08


@njit
def extend(table, magnitude, faint, gx, gy, least):
    """Reach (n, 2) float64 of segments, those that are faint (n,) bool as far as the picture shows their lines.

    table : (n, 8) rows of segments; magnitude (n,), gx, gy (h, w), least : grey levels per pixel.
    """
    n = len(table)
    extent = table[:, 4:6].copy()
    h, w = gx.shape
    values, beside = np.empty(WINDOW), np.empty(2 * WINDOW)
    for i in range(n):
        if not faint[i]:
            continue
        tu, tv = table[i, 2], table[i, 3]
        length = table[i, 5] - table[i, 4]
        limit = max(least, SHARE * magnitude[i])
        for e in range(2):
            outward = 1.0 if e == 1 else -1.0
            # Room as far as the line is known, and up to the next segment of the same line; none where another goes on.
            room = min(LONGEST, LONGEST_SHARE * length)
            if table[i, 7] > 0.0:
                room = min(room, UNSURE / table[i, 7] - outward * extent[i, e])
            eu, ev = table[i, 0] + extent[i, e] * tu, table[i, 1] + extent[i, e] * tv
            for k in range(n):
                if k == i:
                    continue
                for f in range(2):
                    x = table[k, 0] + extent[k, f] * table[k, 2] - eu
                    y = table[k, 1] + extent[k, f] * table[k, 3] - ev
                    if x * x + y * y < TOUCHING**2:
                        room = 0.0
                if abs(tu * table[k, 3] - tv * table[k, 2]) > SAME_WAY:
                    continue
                for f in range(2):
                    x = table[k, 0] + extent[k, f] * table[k, 2] - table[i, 0]
                    y = table[k, 1] + extent[k, f] * table[k, 3] - table[i, 1]
                    beyond = (x * tu + y * tv - extent[i, e]) * outward
                    if -2.0 < beyond < room and abs(x * tv - y * tu) < SAME_LINE:
                        room = max(beyond, 0.0)
            gone = 0.0
            while gone + STEP <= room:
                # The window is centred on the place that would become the end.
                inside = True
                for m in range(WINDOW):
                    s = extent[i, e] + outward * (gone + STEP + m - 0.5 * (WINDOW - 1))
                    for side in range(3):
                        off = (side - 1) * ASIDE
                        u, v = table[i, 0] + s * tu - off * tv, table[i, 1] + s * tv + off * tu
                        if not (1.0 <= u < w - 2.0 and 1.0 <= v < h - 2.0):
                            inside = False
                            break
                        x0, y0 = int(u), int(v)
                        a, b = u - x0, v - y0
                        dx = (1 - b) * ((1 - a) * gx[y0, x0] + a * gx[y0, x0 + 1]) + b * (
                            (1 - a) * gx[y0 + 1, x0] + a * gx[y0 + 1, x0 + 1]
                        )
                        dy = (1 - b) * ((1 - a) * gy[y0, x0] + a * gy[y0, x0 + 1]) + b * (
                            (1 - a) * gy[y0 + 1, x0] + a * gy[y0 + 1, x0 + 1]
                        )
                        g = dy * tu - dx * tv
                        if side == 1:
                            values[m] = g
                        else:
                            beside[m + (WINDOW if side == 2 else 0)] = g
                    if not inside:
                        break
                if not inside:
                    break
                middle = np.median(values)
                around = max(abs(np.median(beside[:WINDOW])), abs(np.median(beside[WINDOW:])))
                if middle < limit or middle - around < PROMINENT * middle:
                    break
                gone += STEP
            if gone > 0.0:
                extent[i, e] += outward * gone
    return extent
