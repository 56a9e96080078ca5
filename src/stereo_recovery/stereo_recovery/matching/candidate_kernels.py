"""Compiled loops over pairs of segments that may show one edge: their geometry and what the grey levels beside say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, Int32Array

from ..detection.sampling import Pair
from .settings import (
    BORDER,
    BOTH_SIDES,
    BOTH_SIDES_REVERSED,
    END_AGREEMENT,
    END_HEIGHT,
    EXPOSURE_ROUNDS,
    GAIN_SIGMA,
    LEAST_SCALE,
    LEVEL,
    LEVEL_BOTH,
    LEVEL_ONE,
    LIKE_ENDS,
    MOST_SCALE,
    NO_SIDE,
    NO_SIDE_REVERSED,
    ONE_SIDE,
    ONE_SIDE_REVERSED,
    PROFILE_OFFSETS,
    PROFILE_SAMPLES,
    ROW_SCALE,
    SAME_ROW,
    SHIFT_SIGMA,
    SLANT_SCALE,
    STEEPEST,
)

# Disparities that are tried for one pair: of a level one by both ends, by the first, by the last; and by its rows.
BY_ROWS = 3


class SegmentTable(NamedTuple):
    """n segments as the loops take them.

    start, end : (n, 2) float64, pixels; direction : (n, 2) float64, unit, the bright side on one hand
    """

    start: FloatArray
    end: FloatArray
    direction: FloatArray


class Photometry(NamedTuple):
    """What the grey levels beside an edge mean.

    profile : (n, PROFILE_SAMPLES, 2, offsets) float32, grey levels on either side of the left segments, as the right
    camera would show them; image : (h, w) float32, the right image, smoothed; density : (256,) float64, of the grey
    levels beside the right image's segments; scale : grey levels, see settings
    """

    profile: Float32Array
    image: Float32Array
    density: FloatArray
    scale: float


class Candidates(NamedTuple):
    """k pairs of segments that could be one edge, ordered by the left one.

    node : (k, 2) int32, segments; value : (k, 9) float64: disparity at the left segment's start, middle and end, first
    and last common row, log likelihood ratio of the geometry against a pair at random, disparity in the first and in
    the last common row, sine of the flatter segment's slope; samples : (k, 2) int32, first and last of the left
    segment's profile that the right one covers; reverse : (k,) bool, the contrast changes its sign; chances : (n,)
    float64, how many pairs geometry alone offers along each left segment
    """

    node: Int32Array
    value: FloatArray
    samples: Int32Array
    reverse: BoolArray
    chances: FloatArray


@njit
def _pixel(image: Float32Array, x: float, y: float) -> float:
    """Grey level of the pixel of (h, w) image that is nearest to column x, row y."""
    row, column = min(max(int(y + 0.5), 0), image.shape[0] - 1), min(max(int(x + 0.5), 0), image.shape[1] - 1)
    return float(image[row, column])


@njit(nogil=True)
def profiles(image: Float32Array, table: SegmentTable) -> Float32Array:
    """(n, PROFILE_SAMPLES, 2, offsets) float32: grey levels beside segments, from start to end."""
    out = np.empty((len(table.start), PROFILE_SAMPLES, 2, len(PROFILE_OFFSETS)), np.float32)
    for i in range(len(table.start)):
        nx, ny = -table.direction[i, 1], table.direction[i, 0]
        for k in range(PROFILE_SAMPLES):
            s = (k + 0.5) / PROFILE_SAMPLES
            x = table.start[i, 0] + s * (table.end[i, 0] - table.start[i, 0])
            y = table.start[i, 1] + s * (table.end[i, 1] - table.start[i, 1])
            for o in range(len(PROFILE_OFFSETS)):
                t = PROFILE_OFFSETS[o]
                out[i, k, 0, o] = _pixel(image, x - t * nx, y - t * ny)
                out[i, k, 1, o] = _pixel(image, x + t * nx, y + t * ny)
    return out


@njit
def photometric(photometry: Photometry, table: SegmentTable, found: Candidates) -> FloatArray:
    """(k,) logarithm of how much likelier the right image's grey levels are beside candidates than beside any edge.

    table : of the left segments
    """
    ratio = np.empty(len(found.node))
    # Of each grey level, the density that a Cauchy density has at zero over its own.
    rarity = -np.log(np.pi * photometry.scale * photometry.density)
    for k in range(len(ratio)):
        i = found.node[k, 0]
        start = (table.start[i, 0] - found.value[k, 0], table.start[i, 1])
        run = (table.end[i, 0] - found.value[k, 2] - start[0], table.end[i, 1] - start[1])
        normal = (-table.direction[i, 1], table.direction[i, 0])
        samples = (found.samples[k, 0], found.samples[k, 1])
        ratio[k] = _photometric(photometry, rarity, i, start, run, normal, samples, found.reverse[k])
    return ratio


@njit
def _photometric(
    photometry: Photometry,
    rarity: FloatArray,
    i: int,
    start: Pair,
    run: Pair,
    normal: Pair,
    samples: tuple[int, int],
    reverse: bool,
) -> float:
    """:func:`photometric` of one candidate.

    rarity : (256,); i : left segment; start, run : where the right image shows its start, and from there its end;
    normal : of the left segment; samples : first and last of its profile to compare; reverse : the contrast changes its
    sign.
    """
    height, width = photometry.image.shape
    one, two, count = 0.0, 0.0, 0
    # Products of what the logarithms are of; a side has at most 24 factors.
    near, far = 1.0, 1.0
    for k in range(samples[0], samples[1]):
        s = (k + 0.5) / PROFILE_SAMPLES
        x, y = start[0] + s * run[0], start[1] + s * run[1]
        if x < 0.0 or y < 0.0 or x > width - 1 or y > height - 1:
            continue
        count += 1
        for side in range(2):
            for o in range(len(PROFILE_OFFSETS)):
                t = PROFILE_OFFSETS[o] if side == 1 else -PROFILE_OFFSETS[o]
                seen = _pixel(photometry.image, x + t * normal[0], y + t * normal[1])
                off = (seen - photometry.profile[i, k, side, o]) / photometry.scale
                # A Cauchy density, since shading and highlights differ more than noise does.
                if side == 0:
                    one += rarity[min(max(int(seen), 0), 255)]
                    near *= 1.0 + off * off
                else:
                    two += rarity[min(max(int(seen), 0), 255)]
                    far *= 1.0 + off * off
    if count == 0:
        return float(np.log(NO_SIDE * _polarity(NO_SIDE_REVERSED, reverse)))
    # What lies beside one edge is one surface: all samples of a side are worth one.
    one = (one - np.log(near)) / (count * len(PROFILE_OFFSETS))
    two = (two - np.log(far)) / (count * len(PROFILE_OFFSETS))
    both = BOTH_SIDES * _polarity(BOTH_SIDES_REVERSED, reverse) * np.exp(one + two)
    either = 0.5 * ONE_SIDE * _polarity(ONE_SIDE_REVERSED, reverse) * (np.exp(one) + np.exp(two))
    return float(np.log(both + either + NO_SIDE * _polarity(NO_SIDE_REVERSED, reverse)))


@njit
def _polarity(reversed_share: float, reverse: bool) -> float:
    """Probability of the contrast's sign, given the share of edges that change it."""
    return reversed_share if reverse else 1.0 - reversed_share


@njit
def _at_border(x: float, y: float, shape: tuple[int, int]) -> bool:
    """Whether a segment ends where the picture does, (h, w), which says nothing about the edge's end."""
    return bool(min(min(x, y), min(shape[1] - 1 - x, shape[0] - 1 - y)) < BORDER)


@njit
def _ends_ratio(p: FloatArray, q: FloatArray, spans: float, shape: tuple[int, int]) -> float:
    """Log likelihood ratio of the heights of two steep segments' ends.

    p, q : (2, 2) ends in the left and in the right image; spans : rows that the two cover, together; shape : (h, w).
    """
    by_chance = min(0.9, max(LIKE_ENDS, 4.0 * END_HEIGHT / spans))
    ratio = 0.0
    for e in range(2):
        if _at_border(p[e, 0], p[e, 1], shape) or _at_border(q[e, 0], q[e, 1], shape):
            continue
        if abs(p[e, 1] - q[e, 1]) < END_HEIGHT:
            ratio += np.log(END_AGREEMENT / by_chance)
        else:
            ratio += np.log((1.0 - END_AGREEMENT) / (1.0 - by_chance))
    return ratio


@njit
def _level_pair(p: FloatArray, q: FloatArray, choice: int, disparity: FloatArray) -> float:
    """Log likelihood ratio of a pair along the rows whose disparity is told by its ends, or -inf.

    p, q : (2, 2) ends in the left and in the right image; choice : by both, by the first, by the last. Fills
    ``disparity`` (2,).
    """
    for e in range(2):
        disparity[e] = p[e, 0] - q[e, 0]
    ratio = LEVEL_BOTH if choice == 0 else LEVEL_ONE
    for e in range(2):
        off = abs(p[e, 1] - q[e, 1])
        if choice == 0 or choice == e + 1:
            if off > SAME_ROW:
                return -np.inf
            # Rows that agree, against rows that chance has within the limit.
            ratio += np.log(2.0 * SAME_ROW / (np.pi * ROW_SCALE * (1.0 + (off / ROW_SCALE) ** 2)))
    if choice == 0:
        return ratio if abs(disparity[0] - disparity[1]) < 0.5 * abs(p[1, 0] - p[0, 0]) else -np.inf
    disparity[:] = disparity[choice - 1]
    return ratio


@njit
def _common_samples(p: FloatArray, top: float, bottom: float) -> tuple[int, int]:
    """First and last sample of a left segment with ends p (2, 2) in rows ``top`` to ``bottom``."""
    s0, s1 = (top - p[0, 1]) / (p[1, 1] - p[0, 1]), (bottom - p[0, 1]) / (p[1, 1] - p[0, 1])
    if s0 > s1:
        s0, s1 = s1, s0
    first = max(0, int(np.ceil(s0 * PROFILE_SAMPLES - 0.5)))
    last = min(PROFILE_SAMPLES, int(np.floor(s1 * PROFILE_SAMPLES - 0.5)) + 1)
    if last <= first:
        first = min(max(int(0.5 * (s0 + s1) * PROFILE_SAMPLES), 0), PROFILE_SAMPLES - 1)
        last = first + 1
    return first, last


@njit(nogil=True)
def candidates(
    left: SegmentTable, right: SegmentTable, shape: tuple[int, int], lowest: float, highest: float
) -> Candidates:
    """All pairs of segments that could be one edge, and how likely each is by its geometry.

    shape : (h, w) of the images; lowest, highest : allowed disparity, pixels.
    """
    count = 0
    node, value = np.empty((1024, 2), np.int32), np.empty((1024, 9))
    compared, reversed_ = np.empty((1024, 2), np.int32), np.empty(1024, np.bool_)
    chances = np.zeros(len(left.start))
    tops = np.minimum(right.start[:, 1], right.end[:, 1])
    order = np.argsort(tops)
    tops = tops[order]
    tallest = np.max(np.abs(right.end[:, 1] - right.start[:, 1]))
    p, q, disparity = np.empty((2, 2)), np.empty((2, 2)), np.empty(2)
    for i in range(len(left.start)):
        p[0], p[1] = left.start[i], left.end[i]
        tu, tv = left.direction[i]
        top, bottom = min(p[0, 1], p[1, 1]), max(p[0, 1], p[1, 1])
        for rank in range(np.searchsorted(tops, top - tallest - SAME_ROW), len(order)):
            if tops[rank] > bottom + SAME_ROW:
                break
            j = order[rank]
            ru, rv = right.direction[j]
            # The bright side is on one hand, so that directions against each other show opposite contrasts.
            steep = min(abs(tv), abs(rv)) > LEVEL
            reverse = tv * rv < 0.0 if steep else tv * rv + tu * ru < 0.0
            if reverse:
                ru, rv = -ru, -rv
                q[0], q[1] = right.end[j], right.start[j]
            else:
                q[0], q[1] = right.start[j], right.end[j]
            level = abs(tv) < LEVEL or abs(rv) < LEVEL
            first_row, last_row = max(top, min(q[0, 1], q[1, 1])), min(bottom, max(q[0, 1], q[1, 1]))
            if level and (tu * ru < 0.0 or abs(tv - rv) > 2.0 * LEVEL):
                continue
            shorter = min(bottom - top, abs(q[1, 1] - q[0, 1]))
            common = last_row - first_row
            # A level pair that slopes alike is one by its rows, too, wherever its ends are. One end of a short segment
            # may be in the row of the other, however it slopes.
            by_rows = shorter > 0.0 and (not level or tv * rv > 0.0) and common >= min(SAME_ROW, 0.5 * shorter)
            for choice in range(0 if level else BY_ROWS, BY_ROWS + by_rows):
                if choice < BY_ROWS:
                    ratio = _level_pair(p, q, choice, disparity)
                    gradient = (disparity[0] - disparity[1]) / max(abs(p[1, 0] - p[0, 0]), NOT_ZERO)
                    rows = top, bottom
                else:
                    rows = first_row, last_row
                    slope, right_slope = tu / tv, ru / rv
                    gradient = abs(slope - right_slope) / np.sqrt(1.0 + 0.25 * (slope + right_slope) ** 2)
                    for e in range(2):
                        disparity[e] = p[e, 0] - (q[0, 0] + (p[e, 1] - q[0, 1]) * right_slope)
                    ratio = _ends_ratio(p, q, bottom - top + abs(q[1, 1] - q[0, 1]), shape)
                middle = 0.5 * (disparity[0] + disparity[1])
                if ratio == -np.inf or gradient > STEEPEST or middle < lowest or middle > highest:
                    continue
                # Chance covers the edge once with so much of a pair.
                share = (rows[1] - rows[0] + 1.0) / (bottom - top + 1.0)
                chances[i] += min(1.0, share) / (BY_ROWS + 1 if level else 1)
                # Directions that agree, against directions at random.
                ratio += np.log(4.0 / (np.pi * SLANT_SCALE * (1.0 + (gradient / SLANT_SCALE) ** 2)))
                if count == len(node):
                    node = np.concatenate((node, np.empty_like(node)))
                    value = np.concatenate((value, np.empty_like(value)))
                    compared = np.concatenate((compared, np.empty_like(compared)))
                    reversed_ = np.concatenate((reversed_, np.empty_like(reversed_)))
                samples = (0, PROFILE_SAMPLES) if choice < BY_ROWS else _common_samples(p, rows[0], rows[1])
                compared[count, 0], compared[count, 1], reversed_[count] = samples[0], samples[1], reverse
                node[count, 0], node[count, 1] = i, j
                value[count, 0], value[count, 1], value[count, 2] = disparity[0], middle, disparity[1]
                value[count, 3], value[count, 4], value[count, 5] = rows[0], rows[1], ratio
                per_row = 0.0 if choice < BY_ROWS else (disparity[1] - disparity[0]) / (p[1, 1] - p[0, 1])
                value[count, 6] = disparity[0] + per_row * (rows[0] - p[0, 1])
                value[count, 7] = disparity[0] + per_row * (rows[1] - p[0, 1])
                value[count, 8] = min(abs(tv), abs(rv))
                count += 1
    return Candidates(node[:count], value[:count], compared[:count], reversed_[:count], chances)


@njit(nogil=True)
def learnt_exposure(left: Float32Array, right: Float32Array, node: Int32Array) -> tuple[float, float, float]:
    """Gain, shift and scale of what two cameras make of the surfaces beside matched edges, by a robust fit.

    left, right : (n, samples, 2, offsets), (m, samples, 2, offsets) grey levels; node : (k, 2) matched segments
    """
    a, b = np.empty(2 * len(node)), np.empty(2 * len(node))
    for k in range(len(node)):
        for s in range(2):
            a[2 * k + s] = np.median(left[node[k, 0], :, s].copy())
            b[2 * k + s] = np.median(right[node[k, 1], :, s].copy())
    gain, shift = 1.0, 0.0
    for _ in range(EXPOSURE_ROUNDS):
        off = b - gain * a - shift
        scale = max(np.median(np.abs(off)) / NORMAL_QUARTILE, LEAST_SCALE)
        # Normal equations of gain and shift, with their priors.
        aa, a1, one = GAIN_SIGMA**-2.0, 0.0, SHIFT_SIGMA**-2.0
        ab, b1 = GAIN_SIGMA**-2.0, 0.0
        for k in range(len(a)):
            weight = 1.0 / (scale**2 + off[k] ** 2)
            aa += weight * a[k] * a[k]
            a1 += weight * a[k]
            one += weight
            ab += weight * a[k] * b[k]
            b1 += weight * b[k]
        determinant = aa * one - a1 * a1
        gain, shift = (ab * one - b1 * a1) / determinant, (aa * b1 - a1 * ab) / determinant
    scale = np.median(np.abs(b - gain * a - shift)) / NORMAL_QUARTILE
    return gain, shift, min(max(scale, LEAST_SCALE), MOST_SCALE)
