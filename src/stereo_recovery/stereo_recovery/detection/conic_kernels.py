"""Compiled least squares of a conic through points, and the search for arcs, for :mod:`.conics`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from .settings import (
    CORRELATION_LENGTH,
    ELLIPSE_PARAMETERS,
    FEW_POINTS,
    FINAL_ROUNDS,
    FIRST_ROUNDS,
    LARGEST_RADIUS_RATIO,
    LEAST_DISCRIMINANT,
    LEAST_PIVOT,
    LEAST_RADIUS,
    LEAST_TURN,
    LEAST_WEIGHT_SHARE,
    MOST_ARC_BREAKS,
    SHARPEST_BREAK,
    SHORTEST_ARC,
    SMALLEST,
)


@njit
def _solve5(a: FloatArray, b: FloatArray) -> bool:
    """Solve a (5, 5) system a x = b in place, x in b, by elimination with pivots; False when it is singular."""
    for c in range(5):
        pivot = c
        for r in range(c + 1, 5):
            if abs(a[r, c]) > abs(a[pivot, c]):
                pivot = r
        if abs(a[pivot, c]) < LEAST_PIVOT:
            return False
        if pivot != c:
            for k in range(5):
                a[c, k], a[pivot, k] = a[pivot, k], a[c, k]
            b[c], b[pivot] = b[pivot], b[c]
        for r in range(c + 1, 5):
            f = a[r, c] / a[c, c]
            for k in range(c, 5):
                a[r, k] -= f * a[c, k]
            b[r] -= f * b[c]
    for c in range(4, -1, -1):
        for k in range(c + 1, 5):
            b[c] -= a[c, k] * b[k]
        b[c] /= a[c, c]
    return True


@njit
def fit(points: FloatArray, rounds: int) -> tuple[FloatArray, float]:
    """Conic through points, by least squares.

    Each equation is divided by its gradient of the round before, which removes the bias of small ellipses.

    Parameters
    ----------
    points : (n, 2) float64, pixels
        n >= 5.
    rounds : int
        Of reweighting, the first without weights included.

    Returns
    -------
    conic : (6,) float64
        a, b, c, d, e, f of a u^2 + b u v + c v^2 + d u + e v + f, negative inside, with a + c = 1 in scaled
        coordinates.
    rms : float
        Pixels. Of the Sampson distance; infinite when there is no ellipse.

    References
    ----------
    P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18(1), 1982.
    """
    n = len(points)
    none = np.zeros(6)
    mx = my = 0.0
    for i in range(n):
        mx += points[i, 0] / n
        my += points[i, 1] / n
    scale = NOT_ZERO
    for i in range(n):
        scale += (abs(points[i, 0] - mx) + abs(points[i, 1] - my)) / n
    q = np.zeros(6)
    w = np.ones(n)
    rms = 0.0
    for turn in range(rounds + 1):
        if turn < rounds:
            a = np.zeros((5, 5))
            b = np.zeros(5)
            row = np.empty(5)
            for i in range(n):
                x, y = (points[i, 0] - mx) / scale, (points[i, 1] - my) / scale
                # c = 1 - a: unknown a, b, d, e, f; right side -y^2.
                row[0], row[1], row[2], row[3], row[4] = x * x - y * y, x * y, x, y, 1.0
                for j in range(5):
                    wr = w[i] * row[j]
                    b[j] -= wr * y * y
                    for k in range(5):
                        a[j, k] += wr * row[k]
            if not _solve5(a, b):
                return none, np.inf
            q[0], q[1], q[2], q[3], q[4], q[5] = b[0], b[1], 1.0 - b[0], b[2], b[3], b[4]
            if 4.0 * q[0] * q[2] - q[1] * q[1] <= LEAST_DISCRIMINANT:
                return none, np.inf
        mean = 0.0
        total = 0.0
        for i in range(n):
            x, y = (points[i, 0] - mx) / scale, (points[i, 1] - my) / scale
            gx, gy = 2.0 * q[0] * x + q[1] * y + q[3], q[1] * x + 2.0 * q[2] * y + q[4]
            g2 = gx * gx + gy * gy
            w[i] = g2
            mean += g2 / n
            f = q[0] * x * x + q[1] * x * y + q[2] * y * y + q[3] * x + q[4] * y + q[5]
            total += f * f / (g2 + NOT_ZERO)
        for i in range(n):
            w[i] = 1.0 / max(w[i], LEAST_WEIGHT_SHARE * mean)
        rms = scale * np.sqrt(total / n)
    # Back to pixels.
    s2 = scale * scale
    a0, b0, c0, d0, e0 = q[0] / s2, q[1] / s2, q[2] / s2, q[3] / scale, q[4] / scale
    out = np.array(
        [
            a0,
            b0,
            c0,
            d0 - 2.0 * a0 * mx - b0 * my,
            e0 - 2.0 * c0 * my - b0 * mx,
            q[5] - d0 * mx - e0 * my + a0 * mx * mx + b0 * mx * my + c0 * my * my,
        ]
    )
    return out, rms


@njit
def radii(q: FloatArray) -> tuple[float, float]:
    """Radii of an ellipse.

    Parameters
    ----------
    q : (6,) float64
        The numbers of :func:`fit`.

    Returns
    -------
    major, minor : float
        Pixels. 0 and 0 when the conic is no real ellipse.
    """
    a, b, c, d, e, f = q[0], 0.5 * q[1], q[2], 0.5 * q[3], 0.5 * q[4], q[5]
    small = a * c - b * b
    whole = a * (c * f - e * e) - b * (b * f - e * d) + d * (b * e - c * d)
    # The conic is negative at the centre of a real ellipse.
    if not (small > 0.0 and whole < 0.0):
        return 0.0, 0.0
    middle, half = 0.5 * (a + c), np.sqrt(0.25 * (a - c) ** 2 + b * b)
    level = -whole / small
    return np.sqrt(level / max(middle - half, SMALLEST)), np.sqrt(level / (middle + half))


@njit
def _arc_of(
    some: IntArray, position: FloatArray, limit: FloatArray, bounds: IntArray, direction: FloatArray
) -> tuple[bool, FloatArray, float]:
    """Whether one ellipse explains the edgels of some segments (k,): within their limits, and better than their lines.

    An ellipse lies along the sides of a corner, too, but not as close. position, limit, bounds, direction : as of
    :func:`arcs`. Returns its conic and rms as well, see :func:`fit`.
    """
    n, off_lines = 0, 0.0
    for i in some:
        n += bounds[i, 1] - bounds[i, 0]
    if n < SHORTEST_ARC:
        return False, np.zeros(6), np.inf
    points, slack = np.empty((n, 2)), np.empty(n)
    n = 0
    for i in some:
        first, last = bounds[i]
        end = n + last - first
        points[n:end], slack[n:end] = position[first:last], limit[first:last]
        across = points[n:end, 0] * direction[i, 1] - points[n:end, 1] * direction[i, 0]
        off_lines += ((across - across.mean()) ** 2).sum()
        n = end
    # Akaike's criterion: what each parameter, two of a line, has to gain of edgels whose errors are one over a length.
    allowed = (2 * len(some) - ELLIPSE_PARAMETERS) * CORRELATION_LENGTH / n
    most = min(np.median(slack), np.sqrt(off_lines / n) * np.exp(allowed))
    # What is none is mostly found out by a few of the points.
    q, rms = fit(points[:: max(1, n // FEW_POINTS)], FIRST_ROUNDS)
    if not rms < most:
        return False, q, rms
    q, rms = fit(points, FINAL_ROUNDS)
    major, minor = radii(q)
    u, v = points[:, 0], points[:, 1]
    small = major <= LARGEST_RADIUS_RATIO * max(u.max() - u.min(), v.max() - v.min())
    return rms < most and minor > LEAST_RADIUS and small, q, rms


@njit
def _claim(
    segments: IntArray,
    turns: FloatArray,
    position: FloatArray,
    limit: FloatArray,
    bounds: IntArray,
    direction: FloatArray,
    arc: Int32Array,
    conics: FloatArray,
    errors: FloatArray,
    found: int,
) -> int:
    """The longest stretches of a run of segments that one ellipse explains each; returns how many there are then.

    segments : (k,), twice in a row for a closed chain; turns : (k - 1,) radians, between them; arc : (m,) of all
    segments, conics, errors : (m, 6), (m,), are filled from ``found`` on; the others as of :func:`arcs`
    """
    k = len(segments)
    first = 0
    while first + 1 < k:
        taken = False
        for last in range(min(k - 1, first + MOST_ARC_BREAKS), first, -1):
            free, turn = True, 0.0
            for i in range(first, last + 1):
                free = free and arc[segments[i]] < 0 and (i == first or segments[i] != segments[first])
                turn += turns[i] if i < last else 0.0
            if not free or abs(turn) < LEAST_TURN:
                continue
            some = segments[first : last + 1]
            is_arc, q, rms = _arc_of(some, position, limit, bounds, direction)
            if is_arc:
                arc[some], conics[found], errors[found] = found, q, rms
                found += 1
                first = last
                taken = True
                break
        if not taken:
            first += 1
    return found


@njit(nogil=True)
def arcs(
    chain: IntArray,
    closed: BoolArray,
    direction: FloatArray,
    length: FloatArray,
    position: FloatArray,
    limit: FloatArray,
    bounds: IntArray,
    sagitta: FloatArray,
) -> tuple[Int32Array, FloatArray, FloatArray]:
    """The arcs of chains: runs of segments that turn one way are tried as ellipses, the longest first.

    Parameters
    ----------
    chain : (m,) int64
        Of each segment.
    closed : (c,) bool
        Of the chains.
    direction : (m, 2) float64
    length : (m,) float64, pixels
    position : (n, 2) float64, pixels
        Edgels.
    limit : (n,) float64, pixels
        Largest offset of each from its curve.
    bounds : (m, 2) int64
    sagitta : (m,) float64, pixels
        Of the segments, see :class:`.segments.Segments`.

    Returns
    -------
    arc : (m,) int32
        The ellipse of each segment, or -1.
    conics : (k, 6) float64
        See :func:`fit`.
    rms : (k,) float64, pixels
    """
    count = len(chain)
    arc, conics, errors = np.full(count, -1, np.int32), np.empty((count, 6)), np.empty(count)
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    # Radians, from a segment's chord to the tangent at its end, were it the arc of a circle. With a positive sagitta
    # it turns against the angles.
    bend = 2.0 * np.arctan2(2.0 * sagitta, length)
    found, first = 0, 0
    while first < count:
        last = first + 1
        while last < count and chain[last] == chain[first]:
            last += 1
        own = last - first
        if closed[chain[first]]:
            # All round it no break is too sharp for an arc.
            is_arc, q, rms = _arc_of(np.arange(first, last), position, limit, bounds, direction)
            if is_arc:
                arc[first:last], conics[found], errors[found] = found, q, rms
                found, first = found + 1, last
                continue
        # Of a closed chain twice round.
        size = 2 * own if own >= 3 and closed[chain[first]] else own
        members, turns, breaks = first + np.arange(size) % own, np.empty(size - 1), np.empty(size - 1)
        for k in range(size - 1):
            i, j = members[k], members[k + 1]
            turns[k] = (angle[j] - angle[i] + np.pi) % (2.0 * np.pi) - np.pi
            # Half of what either bends itself is no break between the two.
            breaks[k] = turns[k] + (bend[i] + bend[j])
        k = 0
        while own >= 2 and k < size - 1:
            end = k + 1
            if turns[k] != 0.0 and abs(breaks[k]) < SHARPEST_BREAK:
                while end < size - 1 and abs(breaks[end]) < SHARPEST_BREAK and np.sign(turns[end]) == np.sign(turns[k]):
                    end += 1
                some = members[k : end + 1], turns[k:end]
                found = _claim(some[0], some[1], position, limit, bounds, direction, arc, conics, errors, found)
            k = end
        first = last
    # Where edgels are off by more than an arc is high, it is one segment, which bends.
    for i in range(count):
        if arc[i] < 0 and 2.0 * abs(bend[i]) >= LEAST_TURN:
            is_arc, q, rms = _arc_of(np.array([i]), position, limit, bounds, direction)
            if is_arc:
                arc[i], conics[found], errors[found] = found, q, rms
                found += 1
    return arc, conics[:found], errors[:found]


@njit
def sampson(conic: FloatArray, points: FloatArray) -> FloatArray:
    """Distance of points from a conic, to first order, see :func:`.conics.sampson`.

    Parameters
    ----------
    conic : (3, 3) float64
    points : (n, 2) float64, pixels

    Returns
    -------
    (n,) float64, pixels
    """
    out = np.empty(len(points))
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        hx = conic[0, 0] * x + conic[1, 0] * y + conic[2, 0]
        hy = conic[0, 1] * x + conic[1, 1] * y + conic[2, 1]
        value = hx * x + hy * y + conic[0, 2] * x + conic[1, 2] * y + conic[2, 2]
        out[k] = 0.5 * value / max(np.hypot(hx, hy), NOT_ZERO)
    return out
