"""Compiled loops over segments of chains for :mod:`.matching`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array, IntArray

# How much a candidate may disagree with a neighbour: support is half at this disparity gradient (PMF's limit is 0.5, up
# to which it counts in full; surfaces steeper than that are rare, and grading tells a period's neighbours apart), and
# ends at that one.
GRADIENT_HALF = 0.25
GRADIENT_END = 1.0
# An edge itself may recede more steeply, up to where it would run the other way in the other image (2), but few do.
STEEPEST = 1.9
STEEP = 0.6
LEAST_STEEP = 0.2
# Disparity error, pixels, that measuring alone makes.
SLACK = 0.8
# How far, pixels, the two images' ends of an edge may differ in height, and what a differing end costs.
END_SLACK = 4.0
LOOSE_END = 0.65
FLAT_SLACK = 2.0
# What is left of likeness when only one side agrees; how much that counts when it is the picture's backdrop, an even
# area within this many levels.
ONE_SIDE = 0.6
BACKDROP_WEIGHT = 0.05
BACKDROP_WIDTH = 6.0
# An eye that sees past an object's side sees one edge more there, outside the one both eyes see. Of two candidates a
# few pixels apart the nearer is therefore the true one, and the farther counts less.
LEAST_BESIDE, BESIDE = 1.0, 20.0
FARTHER = 0.5
# A change of the contrast's sign is rare, and only believed when one side stays equal to within this.
FLIP_CONTRAST = 8.0
FLIPPED = 0.75
# Two segments that match one straight segment are parts of one line: the middle of each is off the other's line by at
# most this, pixels, and this share of their distance.
BREAK_OFFSET = 1.0
BREAK_SINE = 0.05
# Segments that have less than this share of the shorter one's rows in common are parts of an edge that each image
# breaks elsewhere: their lines need not agree there.
LEAST_COMMON = 0.2
# When the rows two segments share are less than this share of the longer, only those rows are compared.
PART = 0.6
# What an outline before the backdrop is worth that both images show from end to end.
OUTLINE = 0.05
# Candidates less alike than this are not looked at.
LEAST_LIKENESS = 0.04


@njit
def _beside(samples: FloatArray, row: FloatArray, first: float, last: float, side: int) -> float:
    """Grey level beside a segment between two rows: samples (m, 2) from its start to its end, row (9,) of its table."""
    m = len(samples)
    run = row[3] - row[1]
    a, b = (first - row[1]) / run * m, (last - row[1]) / run * m
    if a > b:
        a, b = b, a
    low, high = max(0, int(np.ceil(a - 0.5))), min(m, int(np.floor(b - 0.5)) + 1)
    if high <= low:
        low = min(max(int(0.5 * (a + b)), 0), m - 1)
        high = low + 1
    total = 0.0
    for i in range(low, high):
        total += samples[i, side]
    return total / (high - low)


@njit
def candidates(  # noqa: C901, PLR0912, PLR0915
    left: FloatArray,
    right: FloatArray,
    left_beside: FloatArray,
    right_beside: FloatArray,
    lowest: float,
    highest: float,
    flat_sine: float,
    backdrop: float,
    contrast: float,
) -> tuple[Int32Array, FloatArray]:
    """All pairs of segments that could be one edge: same contrast sign, common rows, allowed disparity and slope.

    left, right : (n, 9) float64 rows: start u, v; end u, v; direction u, v; grey level on the dark and the bright
    side; gradient magnitude. left_beside, right_beside : (n, m, 2) float64, the grey levels on either side from start
    to end. backdrop : grey level of an even background (-1000: none); contrast : grey levels by which
    a side of an edge may differ before its likeness falls to 1 / e.
    Segments are directed with the bright side on one hand, so direction carries the sign.
    Returns node (k, 2) int32 segments; value (k, 6): disparity at the left segment's start, middle, end; first and last
    common row; likeness 0..1.
    """
    count = 0
    node = np.empty((1024, 2), np.int32)
    value = np.empty((1024, 6))
    order = np.argsort(np.minimum(right[:, 1], right[:, 3]))
    tallest = 0.0
    for j in range(len(right)):
        tallest = max(tallest, abs(right[j, 3] - right[j, 1]))
    tops = np.minimum(right[:, 1], right[:, 3])[order]
    for i in range(len(left)):
        u0, v0, u1, v1 = left[i, 0], left[i, 1], left[i, 2], left[i, 3]
        top, bottom = min(v0, v1), max(v0, v1)
        flat_left = abs(left[i, 5]) < flat_sine
        begin = np.searchsorted(tops, top - tallest - 3.0)
        for q in range(begin, len(order)):
            j = order[q]
            if tops[q] > bottom + 3.0:
                break
            flip = left[i, 4] * right[j, 4] + left[i, 5] * right[j, 5] < 0.0
            tu, tv = right[j, 4], right[j, 5]
            x0, y0, x1, y1 = right[j, 0], right[j, 1], right[j, 2], right[j, 3]
            if flip:
                tu, tv = -tu, -tv
                x0, y0, x1, y1 = x1, y1, x0, y0
            flat_right = abs(tv) < flat_sine
            a, b = max(top, min(y0, y1)), min(bottom, max(y0, y1))
            partial, gradient = False, 0.0
            if flat_left or flat_right:
                # Rows say little: the ends must be at the same height, and give the disparity. When only one end is,
                # the other is hidden or was not found.
                if left[i, 4] * tu < 0.0 or abs(left[i, 5] - tv) > 0.2:
                    continue
                first, last = abs(v0 - y0) < FLAT_SLACK, abs(v1 - y1) < FLAT_SLACK
                if not (first or last):
                    continue
                d0, d1 = u0 - x0, u1 - x1
                partial = not (first and last) or abs(d0 - d1) > 0.5 * abs(u1 - u0)
                if partial:
                    d0 = d1 = d0 if first else d1
                dm = 0.5 * (d0 + d1)
                a, b = top, bottom
            else:
                if left[i, 5] * tv <= 0.0:
                    continue
                shorter = min(bottom - top, abs(y1 - y0))
                if b - a < max(min(2.0, 0.5 * shorter), LEAST_COMMON * shorter):
                    continue
                cl, cr = left[i, 4] / left[i, 5], tu / tv
                # The segment's own disparity gradient, in cyclopean coordinates.
                gradient = abs(cl - cr) / np.sqrt(1.0 + 0.25 * (cl + cr) ** 2)
                if gradient > STEEPEST:
                    continue
                d0 = u0 - (x0 + (v0 - y0) * cr)
                d1 = u1 - (x0 + (v1 - y0) * cr)
                dm = 0.5 * (d0 + d1)
            if dm < lowest or dm > highest:
                continue
            # A nearer surface hides one background from the left eye and another from the right: its edge may change
            # the sign of its contrast, but its own side stays as it is.
            left_dark, left_bright, right_dark, right_bright = left[i, 6], left[i, 7], right[j, 6], right[j, 7]
            if not (flat_left or flat_right) and b - a < PART * max(bottom - top, abs(y1 - y0)):
                # What lies beside the rest of the longer segment says nothing.
                if b - a < PART * (bottom - top):
                    left_dark = _beside(left_beside[i], left[i], a, b, 0)
                    left_bright = _beside(left_beside[i], left[i], a, b, 1)
                if b - a < PART * abs(y1 - y0):
                    right_dark = _beside(right_beside[j], right[j], a, b, 0)
                    right_bright = _beside(right_beside[j], right[j], a, b, 1)
            if flip:
                dark, bright = abs(left_dark - right_bright), abs(left_bright - right_dark)
                if min(dark, bright) > FLIP_CONTRAST:
                    continue
            else:
                dark, bright = abs(left_dark - right_dark), abs(left_bright - right_bright)
            ratio = left[i, 8] / right[j, 8]
            if ratio > 1.0:
                ratio = 1.0 / ratio
            if ratio < 0.04 or (ratio < 0.25 and min(dark, bright) > FLIP_CONTRAST):
                continue
            # A background on one side in both images says little; the surface that the edge belongs to says it.
            one, two = np.exp(-dark / contrast), np.exp(-bright / contrast)
            evidence = max(
                one * (BACKDROP_WEIGHT if abs(left_dark - backdrop) < BACKDROP_WIDTH else 1.0),
                two * (BACKDROP_WEIGHT if abs(left_bright - backdrop) < BACKDROP_WIDTH else 1.0),
            )
            likeness = evidence * (ONE_SIDE + (1.0 - ONE_SIDE) * min(one, two)) * ratio**0.1
            if flip or partial:
                likeness *= FLIPPED
            if gradient > GRADIENT_END:
                likeness *= STEEP
            # Ends at the same height: both images show the whole edge.
            loose = 0
            for e in range(2):
                if abs(left[i, 1 + 2 * e] - (y0 if e == 0 else y1)) > END_SLACK:
                    likeness *= LOOSE_END
                    loose += 1
            # Then an outline whose other side is a narrow face, that looks different to each eye, is worth a try.
            dark_ground = abs(left_dark - backdrop) < BACKDROP_WIDTH and dark < BACKDROP_WIDTH
            bright_ground = abs(left_bright - backdrop) < BACKDROP_WIDTH and bright < BACKDROP_WIDTH
            if loose == 0 and not flip and not partial and (dark_ground or bright_ground):
                likeness = max(likeness, OUTLINE)
            steep = gradient > GRADIENT_END and likeness != OUTLINE
            if likeness < LEAST_LIKENESS or (steep and likeness < LEAST_STEEP):
                continue
            if count == len(node):
                grown, grown_value = np.empty((2 * count, 2), np.int32), np.empty((2 * count, 6))
                grown[:count], grown_value[:count] = node, value
                node, value = grown, grown_value
            node[count, 0], node[count, 1] = i, j
            value[count, 0], value[count, 1], value[count, 2] = d0, dm, d1
            value[count, 3], value[count, 4], value[count, 5] = a, b, likeness
            count += 1
    return node[:count], value[:count]


@njit
def neighbours(left: FloatArray, radius: float, most: int) -> tuple[Int32Array, FloatArray, Int8Array, FloatArray]:
    """For every left segment the ``most`` heaviest others near it.

    Returns other (n, most) int32 (-1: none), gap (n, most) pixels between the nearest of start, middle and end, which
    of the three on either side, and weight (n, most).
    """
    n = len(left)
    other = np.full((n, most), -1, np.int32)
    gap = np.zeros((n, most))
    place = np.zeros((n, most, 2), np.int8)
    weight = np.zeros((n, most))
    points = np.empty((n, 3, 2))
    length = np.empty(n)
    for i in range(n):
        for c in range(2):
            points[i, 0, c], points[i, 2, c] = left[i, c], left[i, 2 + c]
            points[i, 1, c] = 0.5 * (left[i, c] + left[i, 2 + c])
        length[i] = np.sqrt((left[i, 2] - left[i, 0]) ** 2 + (left[i, 3] - left[i, 1]) ** 2)
    order = np.argsort(points[:, 1, 1])
    rows = points[:, 1, 1][order]
    longest = 0.0
    for i in range(n):
        longest = max(longest, length[i])
    for i in range(n):
        reach = radius + 0.5 * length[i] + 0.5 * longest
        for q in range(
            np.searchsorted(rows, rows[0] if points[i, 1, 1] - reach < rows[0] else points[i, 1, 1] - reach), n
        ):
            k = order[q]
            if rows[q] > points[i, 1, 1] + reach:
                break
            if k == i or abs(points[k, 1, 0] - points[i, 1, 0]) > radius + 0.5 * (length[i] + length[k]):
                continue
            best = 1e30
            pa = pb = 0
            for a in range(3):
                for b in range(3):
                    d = (points[i, a, 0] - points[k, b, 0]) ** 2 + (points[i, a, 1] - points[k, b, 1]) ** 2
                    if d < best:
                        best, pa, pb = d, a, b
            best = np.sqrt(best)
            if best > radius:
                continue
            w = min(length[k], 60.0) / (best + 8.0)
            # Keep the heaviest.
            slot = -1
            lightest = w
            for m in range(most):
                if weight[i, m] < lightest:
                    lightest, slot = weight[i, m], m
            if slot >= 0:
                other[i, slot], gap[i, slot], weight[i, slot] = k, best, w
                place[i, slot, 0], place[i, slot, 1] = pa, pb
    return other, gap, place, weight


@njit
def _rival(strength: float, nearer: float) -> float:
    """Strength of a competitor that is nearer by this disparity."""
    return strength * FARTHER if -BESIDE < nearer < -LEAST_BESIDE else strength


@njit
def _supporters(
    node: Int32Array, value: FloatArray, first: IntArray, other: Int32Array, gap: FloatArray, place: Int8Array
) -> tuple[IntArray, Int32Array, Int8Array, FloatArray]:
    """Supporters of candidates: each one's start (k + 1,); of each its candidate, column in ``other``, and share."""
    start = np.zeros(len(node) + 1, np.int64)
    who, column, share = np.empty(64 * len(node), np.int32), np.empty(64 * len(node), np.int8), np.empty(64 * len(node))
    count = 0
    for a in range(len(node)):
        i = node[a, 0]
        for m in range(other.shape[1]):
            o = other[i, m]
            if o < 0:
                continue
            da = value[a, place[i, m, 0]]
            for b in range(first[o], first[o + 1]):
                apart = abs(da - value[b, place[i, m, 1]]) - SLACK
                g = apart / (gap[i, m] + 1.0)
                if g >= GRADIENT_END:
                    continue
                if node[b, 1] == node[a, 1] and value[a, 4] - value[b, 3] > 1.0 and value[b, 4] - value[a, 3] > 1.0:
                    continue
                if count == len(who):
                    who, column, share = (
                        np.append(who, np.empty_like(who)),
                        np.append(column, np.empty_like(column)),
                        np.append(share, np.empty_like(share)),
                    )
                who[count], column[count] = b, m
                share[count] = 1.0 / (1.0 + (g / GRADIENT_HALF) ** 2) if g > 0.0 else 1.0
                count += 1
        start[a + 1] = count
    return start, who[:count], column[:count], share[:count]


@njit
def relax(
    node: Int32Array,
    value: FloatArray,
    first: IntArray,
    other: Int32Array,
    gap: FloatArray,
    place: Int8Array,
    weight: FloatArray,
    length: FloatArray,
    right_of: IntArray,
    right_first: IntArray,
    rounds: int,
) -> tuple[FloatArray, FloatArray]:
    """Relaxation: a candidate is as strong as its own evidence and the support of its neighbours' candidates.

    node, value : from :func:`candidates`, ordered by left segment; first (n + 1,): where each segment's candidates
        start;
    right_of, right_first : the same candidates ordered by right segment. Returns strength (k,), belief (k,) 0..1.
    """
    k = len(node)
    belief = np.ones(k)
    strength = np.zeros(k)
    start, who, column, share = _supporters(node, value, first, other, gap, place)
    for _ in range(rounds):
        for a in range(k):
            i = node[a, 0]
            support = best = 0.0
            for q in range(start[a], start[a + 1]):
                b = who[q]
                best = max(best, share[q] * (belief[b] * value[b, 5]))
                if q + 1 == start[a + 1] or column[q + 1] != column[q]:
                    support += best * weight[i, column[q]]
                    best = 0.0
            strength[a] = value[a, 5] * length[a] * (1.0 + support)
        # Uniqueness, from both sides, among candidates that compete for the same rows.
        for a in range(k):
            top = strength[a]
            i, j = node[a, 0], node[a, 1]
            for b in range(first[i], first[i + 1]):
                if min(value[a, 4], value[b, 4]) - max(value[a, 3], value[b, 3]) > 0.3 * (value[a, 4] - value[a, 3]):
                    top = max(top, _rival(strength[b], value[b, 1] - value[a, 1]))
            for q in range(right_first[j], right_first[j + 1]):
                b = right_of[q]
                if min(value[a, 4], value[b, 4]) - max(value[a, 3], value[b, 3]) > 0.3 * (value[a, 4] - value[a, 3]):
                    top = max(top, _rival(strength[b], value[b, 1] - value[a, 1]))
            ratio = strength[a] / top if top > 0.0 else 0.0
            belief[a] = ratio * ratio
    return strength, belief


@njit
def standing(
    node: Int32Array,
    value: FloatArray,
    strength: FloatArray,
    belief: FloatArray,
    first: IntArray,
    right_of: IntArray,
    right_first: IntArray,
) -> FloatArray:
    """(k,) float64: strength of candidates; a farther one waits for a nearer one beside it that is nearly as strong."""
    result = strength * belief
    for a in range(len(node)):
        for side in range(2):
            low, high = (
                (first[node[a, 0]], first[node[a, 0] + 1])
                if side == 0
                else (right_first[node[a, 1]], right_first[node[a, 1] + 1])
            )
            for q in range(low, high):
                b = q if side == 0 else right_of[q]
                nearer = value[b, 1] - value[a, 1]
                if LEAST_BESIDE < nearer < BESIDE and belief[b] > 0.5 and strength[b] > FARTHER * strength[a]:
                    common = min(value[a, 4], value[b, 4]) - max(value[a, 3], value[b, 3])
                    if common > 0.3 * (value[a, 4] - value[a, 3]):
                        result[a] = FARTHER * strength[a] * belief[a]
    return result


@njit
def _one_edge(table: FloatArray, i: int, k: int, other: FloatArray, j: int) -> bool:
    """Whether segments i and k of one image (rows as for :func:`candidates`) can both be segment j of the other.

    Either they are parts of one line, or two edges that meet and that the other eye, in their plane, sees as one.
    """
    du = 0.5 * (table[k, 0] + table[k, 2] - table[i, 0] - table[i, 2])
    dv = 0.5 * (table[k, 1] + table[k, 3] - table[i, 1] - table[i, 3])
    off = max(abs(du * table[i, 5] - dv * table[i, 4]), abs(du * table[k, 5] - dv * table[k, 4]))
    if off < BREAK_OFFSET + BREAK_SINE * np.sqrt(du * du + dv * dv):
        return True
    first, last = min(table[i, 1], table[i, 3]), max(table[i, 1], table[i, 3])
    top, bottom = min(table[k, 1], table[k, 3]), max(table[k, 1], table[k, 3])
    gap = top - last if dv > 0.0 else first - bottom
    meet: bool = (
        -END_SLACK < gap < 2.0 * END_SLACK
        and abs(min(first, top) - min(other[j, 1], other[j, 3])) < END_SLACK
        and abs(max(last, bottom) - max(other[j, 1], other[j, 3])) < END_SLACK
    )
    return meet


@njit
def _rivals(node: Int32Array, value: FloatArray, a: int, b: int, left: FloatArray, right: FloatArray) -> bool:
    """Whether candidates a and b claim the same rows of the same segment, or different straight edges for it."""
    if node[a, 0] != node[b, 0] and node[a, 1] != node[b, 1]:
        return False
    if node[a, 1] == node[b, 1] and not _one_edge(left, node[a, 0], node[b, 0], right, node[a, 1]):
        return True
    if node[a, 0] == node[b, 0] and not _one_edge(right, node[a, 1], node[b, 1], left, node[a, 0]):
        return True
    common = min(value[a, 4], value[b, 4]) - max(value[a, 3], value[b, 3])
    shorter = min(value[a, 4] - value[a, 3], value[b, 4] - value[b, 3])
    both: bool = common > 0.3 * shorter or shorter < 1e-9
    return both


@njit
def greedy(node: Int32Array, value: FloatArray, order: IntArray, left: FloatArray, right: FloatArray) -> IntArray:
    """Candidates in the given order, without those that claim what an earlier one has; (m,) int64."""
    chosen = np.empty(len(order), np.int64)
    count = 0
    # Chains of the chosen, by left and by right segment.
    most = 1
    for a in range(len(node)):
        most = max(most, node[a, 0] + 1, node[a, 1] + 1)
    last = np.full((2, most), -1, np.int64)
    before = np.full((2, len(order)), -1, np.int64)
    for a in order:
        free = True
        for side in range(2):
            k = last[side, node[a, side]]
            while k >= 0 and free:
                if _rivals(node, value, a, chosen[k], left, right):
                    free = False
                k = before[side, k]
        if free:
            chosen[count] = a
            for side in range(2):
                before[side, count] = last[side, node[a, side]]
                last[side, node[a, side]] = count
            count += 1
    return chosen[:count].copy()


@njit
def compatible(node: Int32Array, value: FloatArray, chosen: IntArray, left: FloatArray, right: FloatArray) -> BoolArray:
    """(k,) bool: the chosen candidates and those that claim nothing the chosen have."""
    kept = np.ones(len(node), np.bool_)
    is_chosen = np.zeros(len(node), np.bool_)
    most = 1
    for a in range(len(node)):
        most = max(most, node[a, 0] + 1, node[a, 1] + 1)
    last = np.full((2, most), -1, np.int64)
    before = np.full((2, len(chosen)), -1, np.int64)
    for k in range(len(chosen)):
        is_chosen[chosen[k]] = True
        for side in range(2):
            before[side, k] = last[side, node[chosen[k], side]]
            last[side, node[chosen[k], side]] = k
    for a in range(len(node)):
        if is_chosen[a]:
            continue
        for side in range(2):
            k = last[side, node[a, side]]
            while k >= 0 and kept[a]:
                if _rivals(node, value, a, chosen[k], left, right):
                    kept[a] = False
                k = before[side, k]
    return kept
