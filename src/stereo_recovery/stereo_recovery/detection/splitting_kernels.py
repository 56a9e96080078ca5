"""Compiled loops over chains for :mod:`.splitting` and :mod:`.segments`: splitting into straight segments, and fitting
them."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit


@njit
def _regress(x, y, w, a, b):
    """Orthogonal regression of points a..b-1 with weights: centre, unit direction along the order of points."""
    sw = sx = sy = 0.0
    for i in range(a, b):
        sw += w[i]
        sx += w[i] * x[i]
        sy += w[i] * y[i]
    cx, cy = sx / sw, sy / sw
    sxx = sxy = syy = 0.0
    for i in range(a, b):
        dx, dy = x[i] - cx, y[i] - cy
        sxx += w[i] * dx * dx
        sxy += w[i] * dx * dy
        syy += w[i] * dy * dy
    angle = 0.5 * np.arctan2(2.0 * sxy, sxx - syy)
    tx, ty = np.cos(angle), np.sin(angle)
    if tx * (x[b - 1] - x[a]) + ty * (y[b - 1] - y[a]) < 0.0:
        tx, ty = -tx, -ty
    return cx, cy, tx, ty


@njit
def _fits(x, y, w, limit, a, b):
    """Whether points a..b-1 lie within their limits of their own line."""
    cx, cy, tx, ty = _regress(x, y, w, a, b)
    fits = True
    for i in range(a, b):
        if abs((x[i] - cx) * ty - (y[i] - cy) * tx) > limit[i]:
            fits = False
            break
    return fits


@njit
def _farthest(x, y, a, b):
    """The point farthest from the chord of a..b-1, at least two points from its ends."""
    dx, dy = x[b - 1] - x[a], y[b - 1] - y[a]
    norm = np.sqrt(dx * dx + dy * dy)
    best, where = -1.0, (a + b) // 2
    for i in range(a + 2, b - 2):
        if norm > 1e-9:
            d = abs((x[i] - x[a]) * dy - (y[i] - y[a]) * dx) / norm
        else:
            d = np.sqrt((x[i] - x[a]) ** 2 + (y[i] - y[a]) ** 2)
        if d > best:
            best, where = d, i
    return where


@njit
def split(x, y, limit, offsets, minimum):
    """Recursive fit and segment (thesis 3.10.1): straight segments that cover every chain.

    limit : (n,) how far each edgel may stand off its line, pixels.
    Returns bounds (k, 2) int64 [first, last) in chain order, and chain (k,) int64. Neighbouring segments that one
    line fits are joined again, and the break between two segments goes where their lines meet.
    """
    n = len(x)
    w = 1.0 / (limit * limit)
    bounds = np.empty((n // 2 + len(offsets), 2), np.int64)
    chain = np.empty(len(bounds), np.int64)
    stack = np.empty((n + 2, 2), np.int64)
    count = 0
    for k in range(len(offsets) - 1):
        first = count
        stack[0, 0], stack[0, 1] = offsets[k], offsets[k + 1]
        top = 1
        while top > 0:
            top -= 1
            a, b = stack[top, 0], stack[top, 1]
            if b - a < 2 * minimum or _fits(x, y, w, limit, a, b):
                bounds[count, 0], bounds[count, 1] = a, b
                chain[count] = k
                count += 1
            else:
                m = _farthest(x, y, a, b)
                stack[top, 0], stack[top, 1] = m, b
                stack[top + 1, 0], stack[top + 1, 1] = a, m
                top += 2
        # Join neighbours that one line fits.
        kept = first
        for i in range(first + 1, count):
            if _fits(x, y, w, limit, bounds[kept, 0], bounds[i, 1]):
                bounds[kept, 1] = bounds[i, 1]
            else:
                kept += 1
                bounds[kept, 0], bounds[kept, 1] = bounds[i, 0], bounds[i, 1]
        count = kept + 1 if count > first else count
        # Move each break to where the two lines, fitted without the doubtful points beside it, cross.
        for i in range(first, count - 1):
            a, m, b = bounds[i, 0], bounds[i, 1], bounds[i + 1, 1]
            if m - a < 6 or b - m < 6:
                continue
            c1x, c1y, t1x, t1y = _regress(x, y, w, a, max(a + 4, m - 3))
            c2x, c2y, t2x, t2y = _regress(x, y, w, min(m + 3, b - 4), b)
            best, place = 1e30, m
            total = 0.0
            low, high = max(a + 4, m - 8), min(b - 4, m + 8)
            for j in range(low, high):
                d = (x[j] - c2x) * t2y - (y[j] - c2y) * t2x
                total += d * d
            for j in range(low, high):
                if total < best:
                    best, place = total, j
                d1 = (x[j] - c1x) * t1y - (y[j] - c1y) * t1x
                d2 = (x[j] - c2x) * t2y - (y[j] - c2y) * t2x
                total += d1 * d1 - d2 * d2
            bounds[i, 1] = place
            bounds[i + 1, 0] = place
    return bounds[:count], chain[:count]


@njit
def fit_lines(x, y, sigma, bounds, trim):
    """Robust orthogonal regression of every segment; up to ``trim`` pixels at each end are left out of the fit.

    Edgels beside a corner are pulled towards it. Returns one row a segment: centre u, v; direction u, v; first and
    last place along the line; residual rms; sagitta (the middle's distance from the ends' chord); number of edgels
    used; sum of weights; weighted second moment along the line; (k, 11) float64.
    """
    rows = np.zeros((len(bounds), 11))
    w = np.zeros(len(x))
    for k in range(len(bounds)):
        a, b = bounds[k, 0], bounds[k, 1]
        for i in range(a, b):
            w[i] = 1.0 / (sigma[i] * sigma[i])
        cx, cy, tx, ty = _regress(x, y, w, a, b)
        lo, hi = 1e30, -1e30
        for i in range(a, b):
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            lo, hi = min(lo, s), max(hi, s)
        cut = min(trim, 0.2 * (hi - lo))
        scale = 0.0
        for turn in range(3):
            # First without the ends, then down-weighting what lies far out (Cauchy weights).
            used = 0
            total = weight = 0.0
            for i in range(a, b):
                s = (x[i] - cx) * tx + (y[i] - cy) * ty
                if turn == 0 and (s < lo + cut or s > hi - cut):
                    w[i] = 0.0
                if w[i] > 0.0:
                    base = 1.0 / (sigma[i] * sigma[i])
                    d = (x[i] - cx) * ty - (y[i] - cy) * tx
                    if turn > 0:
                        r = d / (2.5 * scale)
                        w[i] = base / (1.0 + r * r)
                    total += w[i] * d * d
                    weight += w[i]
                    used += 1
            if used < 3:
                for i in range(a, b):
                    w[i] = 1.0 / (sigma[i] * sigma[i])
            cx, cy, tx, ty = _regress(x, y, w, a, b)
            total = weight = 0.0
            used = 0
            for i in range(a, b):
                if w[i] > 0.0:
                    d = (x[i] - cx) * ty - (y[i] - cy) * tx
                    total += w[i] * d * d
                    weight += w[i]
                    used += 1
            scale = max(0.02, np.sqrt(total / weight))
        # Bow: least-squares quadratic on the residuals; s is centred, so its slope is zero already.
        m2 = m4 = dq = 0.0
        length = hi - lo
        sw = 0.0
        for i in range(a, b):
            if w[i] > 0.0:
                s = (x[i] - cx) * tx + (y[i] - cy) * ty
                m2 += w[i] * s * s
                sw += w[i]
        mean2 = m2 / sw
        for i in range(a, b):
            if w[i] > 0.0:
                s = (x[i] - cx) * tx + (y[i] - cy) * ty
                d = (x[i] - cx) * ty - (y[i] - cy) * tx
                q = s * s - mean2
                m4 += w[i] * q * q
                dq += w[i] * q * d
        sagitta = 0.25 * length * length * dq / m4 if m4 > 1e-12 else 0.0
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3] = cx, cy, tx, ty
        rows[k, 4], rows[k, 5], rows[k, 6] = 1e30, -1e30, scale
        for i in range(a, b):
            s = (x[i] - cx) * tx + (y[i] - cy) * ty
            rows[k, 4], rows[k, 5] = min(rows[k, 4], s), max(rows[k, 5], s)
        rows[k, 7], rows[k, 8], rows[k, 9], rows[k, 10] = sagitta, used, sw, m2
    return rows


@njit
def continuations(table, widest, bend, wobble):
    """Which segment continues which on the same straight line, across a gap.

    table : (n, 8): centre u, v; direction; first and last place; sigma of offset and slope. widest : longest gap,
    pixels; bend : largest angle, radians; wobble : how far, pixels,
    real edges stand off a line anyway. Returns successor (n,) int32, or -1; no two have the same.
    """
    n = len(table)
    successor = np.full(n, -1, np.int32)
    price = np.full(n, np.inf)
    for i in range(n):
        length = table[i, 5] - table[i, 4]
        if length < 4.0:
            continue
        x, y = table[i, 0] + table[i, 5] * table[i, 2], table[i, 1] + table[i, 5] * table[i, 3]
        for k in range(n):
            if k == i:
                continue
            sx, sy = table[k, 0] + table[k, 4] * table[k, 2], table[k, 1] + table[k, 4] * table[k, 3]
            if abs(sx - x) > widest or abs(sy - y) > widest:
                continue
            other = table[k, 5] - table[k, 4]
            if other < 4.0:
                continue
            turn = table[i, 2] * table[k, 3] - table[i, 3] * table[k, 2]
            if table[i, 2] * table[k, 2] + table[i, 3] * table[k, 3] < 0.5:
                continue
            slack2 = table[i, 7] ** 2 + table[k, 7] ** 2 + (wobble / min(length, other)) ** 2
            if turn * turn > min(9.0 * slack2, bend * bend):
                continue
            gap = (sx - x) * table[i, 2] + (sy - y) * table[i, 3]
            if gap < -3.0 or gap > min(widest, 0.5 * (length + other)):
                continue
            # Both lines at the middle of the gap.
            si, sk = table[i, 5] + 0.5 * gap, table[k, 4] - 0.5 * gap
            mx, my = table[i, 0] + si * table[i, 2], table[i, 1] + si * table[i, 3]
            off = (mx - table[k, 0]) * table[k, 3] - (my - table[k, 1]) * table[k, 2]
            variance = table[i, 6] ** 2 + (si * table[i, 7]) ** 2 + table[k, 6] ** 2 + (sk * table[k, 7]) ** 2
            variance += wobble * wobble
            if off * off > min(9.0 * variance, 1.0):
                continue
            cost = abs(gap) + 5.0 * abs(off)
            if cost < price[i]:
                price[i] = cost
                successor[i] = k
    taken = np.full(n, -1, np.int32)
    for i in range(n):
        k = successor[i]
        if k >= 0 and (taken[k] < 0 or price[i] < price[taken[k]]):
            taken[k] = i
    for i in range(n):
        if successor[i] >= 0 and taken[successor[i]] != i:
            successor[i] = -1
    return successor


@njit
def medians(values, bounds):
    """(k,) float64: median of each run [first, last) of values (n,); bounds (k, 2)."""
    out = np.empty(len(bounds))
    for k in range(len(bounds)):
        out[k] = np.median(values[bounds[k, 0] : bounds[k, 1]])
    return out
