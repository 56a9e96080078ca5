"""Compiled loops over pairs of segments for :mod:`.junctions`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from .buckets import Buckets, bucketed, in_cell, near, swept
from .line_kernels import Lines, abscissa_of, cosine_of, length_of, offset_of, point_at, sine_of, variance_at
from .settings import (
    AT_JUNCTION,
    BLUNT_GAP,
    BLUNT_SIGMA,
    BLUNT_SINE,
    COLLINEAR_SINE,
    CORNER_SINE,
    CROSSING_SINE,
    DIRECTED_LENGTH,
    LOOSE_END_SIGMA,
    MERGED_COSINE,
    MERGED_DISTANCE,
    ON_CONTINUATION,
    OVERRUN,
    OVERRUN_SHARE,
    ROUNDED_VARIANCE,
    SHORT_NEIGHBOUR_COST,
    SHORTEST_CONTINUATION,
    SPURIOUS_COSINE,
    SPURIOUS_LENGTH,
    SPURIOUS_OVERHANG,
    SPURIOUS_RATIO,
    SPURIOUS_WIDTH,
    SQUARE_GAP,
    SURE_OVERRUN,
)

# px: side of the cells in which junctions are looked for.
CELL = 16.0


@njit
def _boxes(lines: Lines, margin: float) -> FloatArray:
    """(n, 4) float64, pixels: least u, v and largest u, v of every segment, with a margin."""
    box = np.empty((len(lines.centre), 4))
    for i in range(len(box)):
        for c in range(2):
            a = lines.centre[i, c] + lines.extent[i, 0] * lines.direction[i, c]
            b = lines.centre[i, c] + lines.extent[i, 1] * lines.direction[i, c]
            box[i, c], box[i, 2 + c] = min(a, b) - margin, max(a, b) + margin
    return box


@njit
def _outside(box: FloatArray, k: int, x: float, y: float) -> bool:
    """Whether a point, pixels, is outside box k."""
    outside: bool = x < box[k, 0] or y < box[k, 1] or x > box[k, 2] or y > box[k, 3]
    return outside


@njit
def _cells(lines: Lines, widest: float) -> Buckets:
    """The segments, by the cells that have places where ends may meet them.

    widest : pixels, largest gap
    """
    # As far beyond its end as the crossing and the other's end may be; across, the gap at a square corner, since it
    # grows no faster than the sine falls.
    beyond, across = 2.0 * max(widest, OVERRUN), max(2.0 * SQUARE_GAP, OVERRUN, MERGED_DISTANCE, ON_CONTINUATION)
    start, end = np.empty_like(lines.centre), np.empty_like(lines.centre)
    for i in range(len(start)):
        start[i, 0], start[i, 1] = point_at(lines, i, lines.extent[i, 0] - beyond)
        end[i, 0], end[i, 1] = point_at(lines, i, lines.extent[i, 1] + beyond)
    cells: Buckets = swept(start, end, across, CELL)
    return cells


@njit
def _continues(
    lines: Lines, box: FloatArray, close: IntArray, pair: tuple[int, int], point: tuple[float, float], collinear: float
) -> bool:
    """Whether a segment other than i continues segment k on its line beyond a point, pixels.

    box : see :func:`_boxes`; close : segments near the point; pair : k and i; collinear : largest sine between the two
    """
    (k, i), (x, y) = pair, point
    own = abscissa_of(lines, k, x, y)
    # Positive when segment k lies in its direction from the point.
    ahead = 0.5 * (lines.extent[k, 0] + lines.extent[k, 1]) - own
    for m in close:
        itself = (m == k) | (m == i)
        if itself or _outside(box, m, x, y):
            continue
        if length_of(lines, m) < SHORTEST_CONTINUATION or abs(sine_of(lines, k, m)) > collinear:
            continue
        if abs(offset_of(lines, m, x, y)) > ON_CONTINUATION:
            continue
        u, v = point_at(lines, m, 0.5 * (lines.extent[m, 0] + lines.extent[m, 1]))
        if ((u - x) * lines.direction[k, 0] + (v - y) * lines.direction[k, 1]) * ahead < 0.0:
            return True
    return False


@njit
def find_junctions(lines: Lines, widest: float) -> tuple[FloatArray, Int32Array, BoolArray, FloatArray]:
    """Where the ends of segments meet other segments.

    Parameters
    ----------
    lines : Lines
        Of n segments.
    widest : float
        Pixels. Largest gap.

    Returns
    -------
    abscissa, neighbour, t_junction, sigma : (n, 2)
        As in :class:`.junctions.Junctions`.
    """
    n = len(lines.centre)
    abscissa = lines.extent.copy()
    neighbour = np.full((n, 2), -1, np.int32)
    t_junction = np.zeros((n, 2), np.bool_)
    sigma = np.full((n, 2), LOOSE_END_SIGMA)
    box = _boxes(lines, widest)
    cells = _cells(lines, widest)
    for i in range(n):
        for e in range(2):
            s_end = lines.extent[i, e]
            outward = -1.0 if e == 0 else 1.0
            x, y = point_at(lines, i, s_end)
            best = np.inf
            for k in in_cell(cells, x, y):
                if k == i or _outside(box, k, x, y):
                    continue
                sine = sine_of(lines, i, k)
                if abs(sine) < BLUNT_SINE:
                    continue
                # Abscissas of the crossing on lines i and k.
                dx, dy = lines.centre[k, 0] - lines.centre[i, 0], lines.centre[k, 1] - lines.centre[i, 1]
                s = (dx * lines.direction[k, 1] - dy * lines.direction[k, 0]) / sine
                r = (dx * lines.direction[i, 1] - dy * lines.direction[i, 0]) / sine
                beyond = (s - s_end) * outward
                gap = min(widest, SQUARE_GAP + SQUARE_GAP / abs(sine))
                if beyond > gap or beyond < -min(OVERRUN, OVERRUN_SHARE * length_of(lines, i)):
                    continue
                outside = max(lines.extent[k, 0] - r, r - lines.extent[k, 1])
                if outside > gap:
                    continue
                own, its = variance_at(lines, i, s), variance_at(lines, k, r)
                spread = np.sqrt((its + (1.0 - sine * sine) * own) / (sine * sine) + ROUNDED_VARIANCE)
                # Two edges of nearly one direction meet where their chains end.
                if abs(sine) < CORNER_SINE and (
                    spread > BLUNT_SIGMA
                    or abs(beyond) > BLUNT_GAP
                    or abs(outside) > BLUNT_GAP
                    or cosine_of(lines, i, k) < 0.0
                ):
                    continue
                cost = abs(beyond) + max(outside, 0.0) + SHORT_NEIGHBOUR_COST / length_of(lines, k)
                if cost < best:
                    best = cost
                    abscissa[i, e] = s
                    neighbour[i, e] = k
                    t_junction[i, e] = outside < -SURE_OVERRUN
                    sigma[i, e] = spread
            # The bar of a T may be broken just where the stem meets it: another segment then continues it.
            k = neighbour[i, e]
            if k >= 0 and not t_junction[i, e]:
                at = point_at(lines, i, abscissa[i, e])
                # Where both lines go on, even roughly, four faces meet in a corner.
                close = in_cell(cells, at[0], at[1])
                if _continues(lines, box, close, (k, i), at, COLLINEAR_SINE):
                    t_junction[i, e] = not _continues(lines, box, close, (i, k), at, CROSSING_SINE)
                elif _continues(lines, box, close, (i, k), at, COLLINEAR_SINE):
                    t_junction[i, e] = not _continues(lines, box, close, (k, i), at, CROSSING_SINE)
    _share_junctions(lines, cells, abscissa, neighbour, sigma)
    return abscissa, neighbour, t_junction, sigma


@njit
def _share_junctions(
    lines: Lines, cells: Buckets, abscissa: FloatArray, neighbour: Int32Array, sigma: FloatArray
) -> None:
    """Ends without a junction, of chains that are lost where they near another one, get that one's junction, in place.

    abscissa, neighbour, sigma : (n, 2), see :class:`.junctions.Junctions`
    """
    n = len(lines.centre)
    for i in range(n):
        length = length_of(lines, i)
        for e in range(2):
            if neighbour[i, e] >= 0:
                continue
            outward = -1.0 if e == 0 else 1.0
            x, y = point_at(lines, i, lines.extent[i, e])
            best = np.inf
            for k in in_cell(cells, x, y):
                if k == i or length_of(lines, k) < DIRECTED_LENGTH:
                    continue
                cosine = cosine_of(lines, i, k)
                if abs(cosine) < MERGED_COSINE:
                    continue
                r = abscissa_of(lines, k, x, y)
                off = abs(offset_of(lines, k, x, y))
                if off > MERGED_DISTANCE or r < lines.extent[k, 0] or r > lines.extent[k, 1]:
                    continue
                far = e if cosine > 0.0 else 1 - e
                if neighbour[k, far] < 0 or neighbour[k, far] == i:
                    continue
                cx, cy = point_at(lines, k, abscissa[k, far])
                s = abscissa_of(lines, i, cx, cy)
                beyond = (s - lines.extent[i, e]) * outward
                miss = abs(offset_of(lines, i, cx, cy))
                allowed = min(AT_JUNCTION + 2.0 * np.sqrt(variance_at(lines, i, s)), 2.0 * AT_JUNCTION)
                if beyond < 0.0 or beyond > length or miss > allowed or miss > off:
                    continue
                if miss < best:
                    best = miss
                    abscissa[i, e] = s
                    neighbour[i, e] = neighbour[k, far]
                    sigma[i, e] = np.sqrt(sigma[k, far] ** 2 + AT_JUNCTION**2)


@njit(nogil=True)
def spurious(lines: Lines) -> BoolArray:
    """Short segments that only show how a longer one bends where it nears another one, or blurs.

    Both ends of such a segment are near the longer one's line.

    Parameters
    ----------
    lines : Lines
        Of n segments.

    Returns
    -------
    (n,) bool
    """
    n = len(lines.centre)
    result = np.zeros(n, np.bool_)
    # Points along the longer ones, as far as they reach, are near the middle of any that they make spurious.
    step = SPURIOUS_LENGTH
    count = np.zeros(n + 1, np.int64)
    for m in range(n):
        if length_of(lines, m) >= DIRECTED_LENGTH:
            count[m + 1] = int((length_of(lines, m) + 2.0 * SPURIOUS_OVERHANG) / step) + 2
    count = np.cumsum(count)
    points, owner = np.empty((count[-1], 2)), np.empty(count[-1], np.int64)
    for m in range(n):
        total = count[m + 1] - count[m]
        for p in range(total):
            low, high = lines.extent[m, 0] - SPURIOUS_OVERHANG, lines.extent[m, 1] + SPURIOUS_OVERHANG
            at = count[m] + p
            points[at, 0], points[at, 1] = point_at(lines, m, low + (high - low) * p / (total - 1))
            owner[at] = m
    if len(points) == 0:
        return result
    buckets = bucketed(points, step)
    for k in range(n):
        length = length_of(lines, k)
        if length > SPURIOUS_LENGTH:
            continue
        u, v = point_at(lines, k, 0.5 * (lines.extent[k, 0] + lines.extent[k, 1]))
        for p in near(buckets, u, v):
            m = owner[p]
            longer = length_of(lines, m)
            if m == k or longer < SPURIOUS_RATIO * length:
                continue
            if cosine_of(lines, k, m) < SPURIOUS_COSINE:
                continue
            beside = True
            for e in range(2):
                x, y = point_at(lines, k, lines.extent[k, e])
                s = abscissa_of(lines, m, x, y)
                if (
                    abs(offset_of(lines, m, x, y)) > SPURIOUS_WIDTH
                    or s < lines.extent[m, 0] - SPURIOUS_OVERHANG
                    or s > lines.extent[m, 1] + SPURIOUS_OVERHANG
                ):
                    beside = False
                    break
            if beside:
                result[k] = True
                break
    return result
