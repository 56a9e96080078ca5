"""Steps of grey levels, looked for along the normals of an outline in all of its views: compiled loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import ByteArray, FloatArray, Int32Array

from .alignment import Steps
from .settings import CANDIDATES, TAPS

ONE = np.uint64(1)
# One, in whole numbers with 32 binary digits after the point.
FIXED = 4294967296.0


class Pictures(NamedTuple):
    """Images of one moment as compiled functions take them, whatever their number.

    Attributes
    ----------
    pixels : (p,) uint8
        Of all images, by their rows, one after the other.
    sizes : (v, 2) float64
        Widths and heights, pixels.
    noise : (v,) float64
        Grey levels, sigmas.
    """

    pixels: ByteArray
    sizes: FloatArray
    noise: FloatArray


@njit(nogil=True)
def steps_about(
    pictures: Pictures, eye: Int32Array, pixel: FloatArray, normal: FloatArray, stretch: FloatArray, reach: int
) -> Steps:
    """The strongest steps within ``reach`` pixels of all points, along their normals.

    Parameters
    ----------
    pictures : Pictures
    eye : (n,) int32
        View of each, ascending.
    pixel, normal : (n, 2) float64
        Points and unit normals.
    stretch : (n,) float64
        Pixels of the outline along which each is measured.
    reach : int

    Returns
    -------
    Steps
        CANDIDATES places of each, not a number where there are fewer; their variances are 0, number -1 of points whose
        profile leaves the image.
    """
    n = len(eye)
    steps = Steps(np.full((n, CANDIDATES), np.nan), np.zeros(n, np.int32), np.zeros(n))
    strength = np.empty((n, CANDIDATES))
    begin, first = 0, 0
    for view in range(len(pictures.sizes)):
        width, height = int(pictures.sizes[view, 0]), int(pictures.sizes[view, 1])
        image = pictures.pixels[begin : begin + width * height].reshape(height, width)
        begin += width * height
        last = first
        while last < n and eye[last] == view:
            last += 1
        find_steps(
            image,
            pixel[first:last],
            normal[first:last],
            stretch[first:last],
            reach,
            BOUND_SIGMA * pictures.noise[view],
            steps.offset[first:last],
            strength[first:last],
            steps.number[first:last],
        )
        first = last
    return steps


@njit(nogil=True)
def _fits(image: ByteArray, at: tuple[float, ...], spacing: float, reach: int) -> bool:
    """Whether a profile of ``reach`` pixels to either side of a point lies in an image, and a pixel beyond."""
    height, width = image.shape
    u, v, nx, ny = at
    half = 0.5 * spacing
    for side in (-1.0, 1.0):
        for end in (-half, half):
            x, y = u + side * (reach + 1) * nx + end * ny, v + side * (reach + 1) * ny - end * nx
            if not (x >= 0.0 and y >= 0.0 and x < width - 1 and y < height - 1):
                return False
    return True


@njit(nogil=True)
def _straight_profile(image: ByteArray, at: tuple[float, ...], spacing: float, reach: int, out: FloatArray) -> bool:
    """Levels at whole pixels along a normal (2 reach + 1,), each the mean of a straight stretch along the tangent.

    They are looked up bilinearly, which is enough to find a step: in whole numbers, which take half the time.

    Places have 32 binary digits after the point, weights 16: a step moves by less than a thousandth of a pixel.
    """
    if not _fits(image, at, spacing, reach):
        return False
    u, v, nx, ny = at
    pixels, width = image.reshape(-1), np.int64(image.shape[1])
    count = max(1, int(round(spacing)))
    along = 0.5 * spacing / count - 0.5 * spacing
    x0, y0 = np.int64((u - reach * nx + along * ny) * FIXED), np.int64((v - reach * ny - along * nx) * FIXED)
    dx, dy = np.int64(nx * FIXED), np.int64(ny * FIXED)
    part = spacing / count * FIXED
    tx, ty = np.int64(part * ny), np.int64(-part * nx)
    for k in range(2 * reach + 1):
        total, x, y = np.int64(0), x0, y0
        for _ in range(count):
            a, b = (x >> 16) & 65535, (y >> 16) & 65535
            # Unsigned, so that no negative index has to be thought of.
            i = np.uint64((y >> 32) * width + (x >> 32))
            j = i + np.uint64(width)
            top, low = np.int64(pixels[i]), np.int64(pixels[j])
            top = (top << 16) + a * (np.int64(pixels[i + ONE]) - top)
            low = (low << 16) + a * (np.int64(pixels[j + ONE]) - low)
            total += (top << 16) + b * (low - top)
            x += tx
            y += ty
        out[k] = total / (FIXED * count)
        x0 += dx
        y0 += dy
    return True


@njit(nogil=True)
def find_steps(
    image: ByteArray,
    pixel: FloatArray,
    normal: FloatArray,
    spacing: FloatArray,
    reach: int,
    least: float,
    offset: FloatArray,
    strength: FloatArray,
    count: Int32Array,
) -> None:
    """Steps of grey along normals, the strongest of each.

    Parameters
    ----------
    image : (h, w) uint8
    pixel, normal : (n, 2) float64
    spacing : (n,) float64
        Pixels along the tangent that each stands for.
    reach : int
        Pixels to either side that are searched.
    least : float
        Grey levels, response of the filter to a stretch of one pixel; it falls with the root of the stretch.
    offset, strength : (n, c) float64
        Filled with the steps: pixels along the normal, grey levels with their sign.
    count : (n,) int32
        Filled with how many there are; -1 where the profile leaves the image.
    """
    taps = len(TAPS)
    half = reach + taps + 1
    grey, response = np.empty(2 * half + 1), np.empty(2 * reach + 3)
    most = offset.shape[1]
    for n in range(len(pixel)):
        count[n] = -1
        at = (pixel[n, 0], pixel[n, 1], normal[n, 0], normal[n, 1])
        if not _straight_profile(image, at, spacing[n], half, grey):
            continue
        count[n] = 0
        for k in range(2 * reach + 3):
            total = 0.0
            for j in range(taps):
                total += TAPS[j] * (grey[k + taps + j + 1] - grey[k + taps - j - 1])
            response[k] = total
        enough = least / math.sqrt(max(spacing[n], 1.0))
        for k in range(1, 2 * reach + 2):
            here = abs(response[k])
            way = 1.0 if response[k] > 0.0 else -1.0
            before, after = way * response[k - 1], way * response[k + 1]
            if here < enough or here <= before or here < after:
                continue
            place = k - 1 - reach + 0.5 * (before - after) / (before - 2.0 * here + after)
            slot = count[n]
            if slot < most:
                count[n] += 1
            else:
                slot = 0
                for j in range(1, most):
                    if abs(strength[n, j]) < abs(strength[n, slot]):
                        slot = j
                if abs(strength[n, slot]) >= here:
                    continue
            offset[n, slot], strength[n, slot] = place, response[k]
