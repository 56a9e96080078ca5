"""Compiled walk along straight segments beyond their ends, as far as the picture goes on with their contrast."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import DECISIVE
from msgs_py.numeric.typed import Float32Array, FloatArray, Int32Array, IntArray

from .line_kernels import Lines, length_of, point_at, sine_of, variance_at
from .sampling import Pair, slope_along
from .settings import (
    CHAINED,
    CORNER_TRIM,
    CORRELATION_LENGTH,
    FLANKED_VARIANCE,
    FOLLOWED_VARIANCE,
    GROWN_SHARE,
    MEDIAN_SAMPLES,
    RUNS_INTO_SINE,
)


class Picture(NamedTuple):
    """What growing looks at.

    Attributes
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image.
    noise : (rows, columns) float32, grey levels per pixel
        Sigma of a derivative in each tile.
    tile : int
        Pixels. Side of a tile.
    flank : float
        Pixels. Distance from an edge at which the gradient is that of its surroundings.
    """

    gx: Float32Array
    gy: Float32Array
    noise: Float32Array
    tile: int
    flank: float


class Grown(NamedTuple):
    """n edgels by which segments grew.

    Attributes
    ----------
    owner, step : (n,) int64
        Segment, and pixels from its end: below 0 before its start, above 0 beyond its end.
    position : (n, 2) float64, pixels
    magnitude, noise, prominence : (n,) float64
        As in :class:`.edgel_kernels.Maxima`.
    """

    owner: IntArray
    step: IntArray
    position: FloatArray
    magnitude: FloatArray
    noise: FloatArray
    prominence: FloatArray


@njit
def _inside(picture: Picture, x: float, y: float) -> bool:
    """Whether a point and what lies beside it is in the picture."""
    room = picture.flank + 2.0
    h, w = picture.gx.shape
    return bool(x >= room and y >= room and x < w - 1 - room and y < h - 1 - room)


@njit
def _across(picture: Picture, x: float, y: float, n: Pair) -> float:
    """Gradient along a normal n at a point."""
    return float(slope_along(picture.gx, picture.gy, x, y, n))


@njit
def _exceeding(picture: Picture, x: float, y: float, n: Pair) -> float:
    """By how much the gradient along a normal n exceeds that on both flanks, at a point."""
    f = picture.flank
    beside = _across(picture, x - f * n[0], y - f * n[1], n), _across(picture, x + f * n[0], y + f * n[1], n)
    return float(_across(picture, x, y, n) - 0.5 * (beside[0] + beside[1]))


@njit
def _noise_at(picture: Picture, x: float, y: float) -> float:
    """Sigma of a derivative at a point."""
    rows, columns = picture.noise.shape
    return float(picture.noise[min(int(y) // picture.tile, rows - 1), min(int(x) // picture.tile, columns - 1)])


@njit
def _usual(picture: Picture, lines: Lines, i: int, n: Pair) -> float:
    """Median of what a segment's gradient exceeds that on its flanks by."""
    found, count = np.empty(MEDIAN_SAMPLES), 0
    for k in range(MEDIAN_SAMPLES):
        x, y = point_at(lines, i, lines.extent[i, 0] + (k + 0.5) / MEDIAN_SAMPLES * length_of(lines, i))
        if _inside(picture, x, y):
            found[count] = _exceeding(picture, x, y, n)
            count += 1
    return float(np.median(found[:count])) if count else 0.0


@njit
def _runs_into(lines: Lines, marked: Int32Array, i: int, x: float, y: float) -> bool:
    """Whether segment i comes to the border, or to an edgel of another segment that goes on with it, at a point."""
    u, v = int(x + 0.5), int(y + 0.5)
    if marked[v, u] < 0:
        return True
    for dv in range(-1, 2):
        for du in range(-1, 2):
            k = marked[v + dv, u + du] - 1
            if k >= 0 and k != i and abs(sine_of(lines, i, k)) < RUNS_INTO_SINE:
                return True
    return False


@njit
def _walk(picture: Picture, lines: Lines, marked: Int32Array, i: int, side: int, usual: float) -> int:
    """How many pixels segment i goes on beyond one of its ends.

    A sum of log likelihood ratios decides, of an edge with a share of the usual contrast against none, after E. Page,
    "Continuous inspection schemes", Biometrika 41, 1954. Noise alone makes it go on at one end in twenty.
    """
    n = -lines.direction[i, 1], lines.direction[i, 0]
    assumed = GROWN_SHARE * usual
    total = most = 0.0
    step = grown = 0
    while total >= most - DECISIVE:
        s = lines.extent[i, side] + (step if side == 1 else -step)
        x, y = point_at(lines, i, s)
        if not _inside(picture, x, y) or variance_at(lines, i, s) > FOLLOWED_VARIANCE:
            break
        noise = _noise_at(picture, x, y)
        if step == 0 and assumed > CHAINED * noise or usual < noise or _runs_into(lines, marked, i, x, y):
            break
        # So near the end the chain's own smoothing explains what there is.
        if step > CORNER_TRIM:
            variance = FLANKED_VARIANCE * noise**2 * CORRELATION_LENGTH
            total += assumed * (_exceeding(picture, x, y, n) - 0.5 * assumed) / variance
        if total > most:
            most, grown = total, step
        step += 1
    return grown if most > DECISIVE else 0


@njit
def _edgel(picture: Picture, x: float, y: float, n: Pair, found: FloatArray) -> bool:
    """Whether the gradient along a normal has a maximum within a pixel of a point, above its noise.

    found : (5,) position, magnitude, noise and prominence of it, as in :class:`Grown`
    """
    before, here, behind = (
        _across(picture, x - n[0], y - n[1], n),
        _across(picture, x, y, n),
        _across(picture, x + n[0], y + n[1], n),
    )
    bend = 2.0 * here - before - behind
    if bend <= 0.0 or abs(behind - before) > 2.0 * bend:
        return False
    t = 0.5 * (behind - before) / bend
    found[0], found[1] = x + t * n[0], y + t * n[1]
    found[2], found[3] = _across(picture, found[0], found[1], n), _noise_at(picture, x, y)
    found[4] = _exceeding(picture, found[0], found[1], n) / found[3]
    return bool(found[2] > found[3])


@njit(nogil=True)
def grow(picture: Picture, lines: Lines, order: IntArray, marked: Int32Array) -> Grown:
    """Follow segments beyond their ends.

    Parameters
    ----------
    picture : Picture
    lines : Lines
        Of n segments.
    order : (k,) int
        Those that may grow, in the order in which they do.
    marked : (h, w) int32
        One more than the segment that has an edgel there, 0 where none has, -1 where no segment may go; what grows is
        added.
    """
    owner, away, found = np.empty(1024, np.int64), np.empty(1024, np.int64), np.empty((1024, 5))
    count = 0
    for i in order:
        n = -lines.direction[i, 1], lines.direction[i, 0]
        usual = _usual(picture, lines, i, n)
        for side in range(2):
            far = _walk(picture, lines, marked, i, side, usual)
            while count + far > len(owner):
                owner, away = np.concatenate((owner, owner)), np.concatenate((away, away))
                found = np.concatenate((found, found))
            for step in range(1, far + 1):
                step = step if side == 1 else -step
                x, y = point_at(lines, i, lines.extent[i, side] + step)
                marked[int(y + 0.5), int(x + 0.5)] = i + 1
                if _edgel(picture, x, y, n, found[count]):
                    owner[count], away[count] = i, step
                    count += 1
    found = found[:count]
    return Grown(
        owner[:count], away[:count], found[:, :2].copy(), found[:, 2].copy(), found[:, 3].copy(), found[:, 4].copy()
    )
