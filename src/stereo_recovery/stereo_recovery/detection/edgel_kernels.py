"""Compiled loops over pixels for :mod:`.edgels`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, Int32Array

from .sampling import Pair, bilinear_pair, slope_along
from .settings import (
    ALIASED_BLUR_VARIANCE,
    ALIASED_POSITION_FLOOR,
    ALONG_EDGE,
    CLEAR,
    FLANK_NOISE,
    HALF_WAY,
    KERNEL_NORM,
    LAST_POSITION,
    LEAST_CURVATURE,
    LEAST_INTERPOLATED,
    NOISE_RANK,
    NOISE_STEP,
    POSITION_FACTOR,
    POSITION_FLOOR,
    QUANTISATION_NOISE,
    WHITE,
)


class Maxima(NamedTuple):
    """n maxima of the gradient across itself: edgels of which only as much is known as linking needs.

    Attributes
    ----------
    position : (n, 2) float64, pixels
    gradient : (n, 2) float64, grey levels per pixel
    magnitude : (n,) float64, grey levels per pixel
        Of the gradient.
    noise : (n,) float64, grey levels per pixel
        Sigma of either derivative there.
    width : (n,) float64, pixels
        Standard deviation of the blurred step.
    flanks : (n, 2) float64
        Gradient on the dark and on the bright side, as a share of the magnitude.
    saddle : (n,) float64
        What of the gradient remains on the way to either side, as a share of the magnitude, 0..1.
    """

    position: FloatArray
    gradient: FloatArray
    magnitude: FloatArray
    noise: FloatArray
    width: FloatArray
    flanks: FloatArray
    saddle: FloatArray

    @property
    def prominence(self) -> FloatArray:
        """(n,) float64: by how much the gradient exceeds that on both flanks, in sigma of its noise; at most its own.

        On a slope (the side of a cylinder) noise alone makes maxima, but no prominent ones.
        """
        exceeding: FloatArray = (1.0 - self.saddle) * self.magnitude / self.noise
        return exceeding


@njit
def _mark_maxima(
    rows: tuple[Float32Array, Float32Array, Float32Array],
    gx: Float32Array,
    gy: Float32Array,
    limits: Float32Array,
    marked: BoolArray,
) -> None:
    """Mark where a row (w,) exceeds its limits and is the largest, or first of equals, along its gradient's axis.

    rows : squared magnitudes in the row above, in it and below; gx, gy, limits : (w,) of the row; marked : (w - 4,)
    from the third pixel on, overwritten
    """
    # Without branches, so that several pixels are looked at at once.
    n = len(marked)
    above, below, here = rows[0][2 : n + 2], rows[2][2 : n + 2], rows[1][2 : n + 2]
    before, behind = rows[1][1 : n + 1], rows[1][3 : n + 3]
    gx, gy, limits = gx[2 : n + 2], gy[2 : n + 2], limits[2 : n + 2]
    for k in range(n):
        level = abs(gx[k]) >= abs(gy[k])
        first = before[k] if level else above[k]
        last = behind[k] if level else below[k]
        marked[k] = (here[k] > limits[k]) & (here[k] > first) & (here[k] >= last)


@njit(nogil=True)
def ridge_maxima(
    slopes: tuple[Float32Array, Float32Array],
    squared: Float32Array,
    logarithm: Float32Array,
    least: Float32Array,
    noise: Float32Array,
    tile: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sub-pixel maxima of the gradient magnitude across its own direction, in raster order.

    Parameters
    ----------
    slopes : pair of (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image along rows and columns.
    squared, logarithm : (h, w) float32
        Squared magnitude, and the logarithm of a little more than that.
    least, noise : (rows, columns) float32, grey levels per pixel
        Least magnitude, and the noise, in each tile of the image; see :class:`.noise.NoiseMap`.
    tile : int
        Pixels. Side of a tile.

    Returns
    -------
    position : (n, 2) float64, pixels
    gradient : (n, 2) float64, grey levels per pixel
    magnitude : (n,) float64, grey levels per pixel
    response : (n,) float64, grey levels per pixel
        Noise there.
    width : (n,) float64, pixels
        Standard deviation of the blurred step.
    """
    gx, gy = slopes
    h, w = gx.shape
    room = h * w // 8 + 64
    position, gradient = np.empty((room, 2)), np.empty((room, 2))
    magnitude, response, width = np.empty(room), np.empty(room), np.empty(room)
    limits, marked = np.empty(w, np.float32), np.empty(w - 4, np.bool_)
    n, row = 0, 0
    for y in range(2, h - 2):
        if y == 2 or y % tile == 0:
            row = min(y // tile, least.shape[0] - 1)
            for x in range(w):
                limits[x] = least[row, min(x // tile, least.shape[1] - 1)] ** 2
        _mark_maxima((squared[y - 1], squared[y], squared[y + 1]), gx[y], gy[y], limits, marked)
        for x in range(2, w - 2):
            if not marked[x - 2]:
                continue
            value = squared[y, x]
            norm = np.sqrt(value)
            nx, ny = gx[y, x] / norm, gy[y, x] / norm
            # Least-squares quadratic over 3 x 3 samples of the logarithm (closed form of the facet model).
            above = logarithm[y - 1, x - 1], logarithm[y - 1, x], logarithm[y - 1, x + 1]
            level = logarithm[y, x - 1], logarithm[y, x], logarithm[y, x + 1]
            below = logarithm[y + 1, x - 1], logarithm[y + 1, x], logarithm[y + 1, x + 1]
            up, middle, down = (
                above[0] + above[1] + above[2],
                level[0] + level[1] + level[2],
                below[0] + below[1] + below[2],
            )
            before, behind = above[0] + level[0] + below[0], above[2] + level[2] + below[2]
            total = up + middle + down
            # Half of each, because the logarithm is that of the square.
            kx, ky = (behind - before) / 12.0, (down - up) / 12.0
            kxx, kyy = 0.5 * (behind + before) - total / 3.0, 0.5 * (down + up) - total / 3.0
            kxy = (below[2] - below[0] - above[2] + above[0]) / 8.0
            slope = kx * nx + ky * ny
            bend = kxx * nx * nx + 2.0 * kxy * nx * ny + kyy * ny * ny
            if bend >= -LEAST_CURVATURE:
                continue
            t = -slope / bend
            if abs(t) > 1.0:
                continue
            px, py = x + t * nx, y + t * ny
            gu, gv = bilinear_pair(gx, gy, px, py)
            if gu * gu + gv * gv < LEAST_INTERPOLATED * value:
                continue
            if n == len(width):
                position = np.concatenate((position, np.empty_like(position)))
                gradient = np.concatenate((gradient, np.empty_like(gradient)))
                magnitude = np.concatenate((magnitude, np.empty_like(magnitude)))
                response = np.concatenate((response, np.empty_like(response)))
                width = np.concatenate((width, np.empty_like(width)))
            position[n, 0], position[n, 1] = px, py
            gradient[n, 0], gradient[n, 1] = gu, gv
            magnitude[n] = np.sqrt(gu * gu + gv * gv)
            response[n] = noise[row, min(x // tile, noise.shape[1] - 1)]
            width[n] = 1.0 / np.sqrt(-bend)
            n += 1
    return position[:n], gradient[:n], magnitude[:n], response[:n], width[:n]


@njit(nogil=True)
def zero_crossings(
    laplacian: Float32Array, gx: Float32Array, gy: Float32Array, threshold: float
) -> tuple[FloatArray, FloatArray]:
    """Sign changes of the Laplacian where the gradient is strong, by linear interpolation.

    At most one per pixel: towards the neighbour along the axis nearest to the gradient.

    Parameters
    ----------
    laplacian : (h, w) float32
    gx, gy : (h, w) float32, grey levels per pixel
    threshold : float
        Grey levels per pixel. Least magnitude of the gradient.

    Returns
    -------
    position : (n, 2) float64, pixels
    gradient : (n, 2) float64, grey levels per pixel

    References
    ----------
    D. Marr and E. Hildreth, "Theory of edge detection", Proc. R. Soc. London B 207, 1980.
    """
    h, w = gx.shape
    limit = threshold * threshold
    position, gradient = np.empty((h * w // 2, 2)), np.empty((h * w // 2, 2))
    n = 0
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            if gx[y, x] * gx[y, x] + gy[y, x] * gy[y, x] <= limit or n >= len(position):
                continue
            dx, dy = (1, 0) if abs(gx[y, x]) >= abs(gy[y, x]) else (0, 1)
            a, b = laplacian[y, x], laplacian[y + dy, x + dx]
            if (a > 0.0) == (b > 0.0):
                continue
            # Bright minus dark must agree with the sign of the change, or it is a valley of the gradient.
            slope = gx[y, x] if dx == 1 else gy[y, x]
            if (a > b) != (slope > 0.0):
                continue
            t = a / (a - b)
            position[n, 0], position[n, 1] = x + t * dx, y + t * dy
            gradient[n, 0] = (1 - t) * gx[y, x] + t * gx[y + dy, x + dx]
            gradient[n, 1] = (1 - t) * gy[y, x] + t * gy[y + dy, x + dx]
            n += 1
    return position[:n], gradient[:n]


@njit
def _gradient_beside(gx: Float32Array, gy: Float32Array, position: FloatArray, normal: Pair, away: float) -> float:
    """The gradient (h, w) along a normal, so many pixels along it from a position (2,); at the border, there."""
    x = min(max(position[0] + away * normal[0], 0.0), gx.shape[1] - LAST_POSITION)
    y = min(max(position[1] + away * normal[1], 0.0), gx.shape[0] - LAST_POSITION)
    return float(slope_along(gx, gy, x, y, normal))


@njit(nogil=True)
def flanking_gradients(
    gx: Float32Array, gy: Float32Array, position: FloatArray, gradient: FloatArray, distance: float
) -> tuple[FloatArray, FloatArray]:
    """The gradient on both flanks of edgels along their own gradients, as a share of the edgels'.

    Beside a step between evenly lit faces the share is 0, and on a slope it is 1.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
    position : (n, 2) float64, pixels
        Of edgels.
    gradient : (n, 2) float64, grey levels per pixel
        Theirs.
    distance : float
        Pixels. Of the flanks.

    Returns
    -------
    flanks : (n, 2) float64
        On the dark and on the bright flank.
    saddle : (n,) float64
        The larger of the least gradients on the way to the two flanks: what the edgel has to exceed, even where there
        is a stronger edge beside it.
    """
    flanks, saddle = np.empty((len(position), 2)), np.empty(len(position))
    for i in range(len(position)):
        norm = np.sqrt(gradient[i, 0] ** 2 + gradient[i, 1] ** 2)
        nx, ny = gradient[i, 0] / norm, gradient[i, 1] / norm
        saddle[i] = 0.0
        for flank in range(2):
            away = distance if flank == 1 else -distance
            flanks[i, flank] = _gradient_beside(gx, gy, position[i], (nx, ny), away) / norm
            # Half way it is looked for only where it is not gone already.
            if flanks[i, flank] > saddle[i]:
                nearer = _gradient_beside(gx, gy, position[i], (nx, ny), HALF_WAY * away) / norm
                saddle[i] = max(saddle[i], min(flanks[i, flank], nearer))
    return flanks, saddle


@njit(nogil=True)
def usual_width(width: FloatArray, response: FloatArray, magnitude: FloatArray, sigma: float) -> float:
    """Pixels: median width of clear steps, at least that of the smoothing.

    width : (n,) pixels, of maxima; response, magnitude : (n,) grey levels per pixel, noise and gradient; sigma : of the
    smoothing, pixels
    """
    clear, count = np.empty(len(width)), 0
    for i in range(len(width)):
        if response[i] / magnitude[i] < CLEAR:
            clear[count] = width[i]
            count += 1
    return max(np.median(clear[:count]), sigma) if count else sigma


@njit
def position_factor(width: float, sigma: float) -> float:
    """An edgel's position error, pixels, over the noise of its gradient as a share of the gradient.

    It is what noise that differs from pixel to pixel would do, had it the same effect on the derivatives. width : of
    the blurred step, sigma : of the smoothing, pixels
    """
    return float(np.sqrt(POSITION_FACTOR) * (width / sigma) ** 3 * (2.0 * sigma**2 / width))


@njit(nogil=True)
def described(found: Maxima, order: Int32Array, sigma: float) -> tuple[FloatArray, ...]:
    """Some maxima (m,) as edgels, with their uncertainty: the fields of :class:`.edgels.Edgels` in their order.

    sigma : of the smoothing, pixels
    """
    n = len(order)
    position, direction, size, along = np.empty((n, 2)), np.empty(n), np.empty(n), np.empty(n)
    across, width, bias, prominence = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    response = np.empty(n)
    for k in range(n):
        i = order[k]
        size[k], response[k], width[k] = found.magnitude[i], found.noise[i], found.width[i]
    total = usual_width(width, response, size, sigma)
    # A picture with one sample a pixel has staircase edges; every camera blurs more than that.
    aliased = total**2 < sigma**2 + ALIASED_BLUR_VARIANCE
    floor = ALIASED_POSITION_FLOOR if aliased else POSITION_FLOOR
    factor = position_factor(total, sigma)
    for k in range(n):
        i = order[k]
        across[k] = response[k] / size[k]
        position[k, 0], position[k, 1] = found.position[i, 0], found.position[i, 1]
        direction[k] = np.arctan2(found.gradient[i, 1], found.gradient[i, 0])
        along[k] = np.hypot(factor * across[k], floor)
        # The difference of the two flanks' gradients, without the part that noise explains.
        difference = found.flanks[i, 0] - found.flanks[i, 1]
        bias[k] = np.sqrt(max(difference**2 - (FLANK_NOISE * across[k]) ** 2, 0.0))
        prominence[k] = (1.0 - found.saddle[i]) / across[k]
    return position, direction, size, along, across, width, bias, prominence


@njit(nogil=True)
def change_along_edges(gx: Float32Array, gy: Float32Array, tile: int) -> Float32Array:
    """How much the gradient differs between a pixel and one ALONG_EDGE pixels along the edge, across their mean.

    Two gradients that are nothing but noise, and two of one straight edge with noise, differ there alike: by the root
    of two times the sigma of a derivative.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
    tile : int
        Pixels. Side of the tiles into which the image is cut.

    Returns
    -------
    (h // tile, w // tile) float32, grey levels per pixel
        Quantile NOISE_RANK of the size of this difference over samples of each tile, over the root of two.
    """
    h, w = gx.shape
    out = np.zeros((h // tile, w // tile), np.float32)
    samples = ((tile + NOISE_STEP - 1) // NOISE_STEP) ** 2
    # The largest of a tile, from the quantile on, in ascending order.
    largest = np.empty(samples - int(NOISE_RANK * samples), np.float32)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            largest[:] = 0.0
            for y in range(row * tile, (row + 1) * tile, NOISE_STEP):
                for x in range(column * tile, (column + 1) * tile, NOISE_STEP):
                    value = _change_along_edge(gx, gy, x, y)
                    if value > largest[0]:
                        k = 1
                        while k < len(largest) and value > largest[k]:
                            largest[k - 1] = largest[k]
                            k += 1
                        largest[k - 1] = value
            out[row, column] = largest[0]
    return out


@njit
def _change_along_edge(gx: Float32Array, gy: Float32Array, x: int, y: int) -> np.float32:
    """See :func:`change_along_edges`, of one pixel; 0 where there is no gradient."""
    h, w = gx.shape
    a, b = gx[y, x], gy[y, x]
    norm = np.sqrt(a * a + b * b)
    if not norm > 0.0:
        return np.float32(0.0)
    u, v = x - int(np.rint(ALONG_EDGE * b / norm)), y + int(np.rint(ALONG_EDGE * a / norm))
    u, v = min(max(u, 0), w - 1), min(max(v, 0), h - 1)
    c, d = gx[v, u], gy[v, u]
    both = np.sqrt((a + c) ** 2 + (b + d) ** 2)
    return np.float32(np.sqrt(2.0) * abs(a * d - b * c) / both if both > 0.0 else 0.0)


@njit(nogil=True)
def noise_of_tiles(grey: Float32Array, tile: int, every: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Noise of the tiles of an image, by the second difference, along columns, of the second difference along rows.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    tile : int
        Pixels. Side of the tiles into which the image is cut.
    every : int
        Of the rows of tiles one in so many is looked at.

    Returns
    -------
    level : (n,) float64, grey levels
        Mean of each tile.
    variance : (n,) float64, grey levels squared
        Mean over the tile without its border.
    clipped : (n,) bool
        Whether any of its pixels is black or white.
    """
    columns = grey.shape[1] // tile
    rows = (grey.shape[0] // tile + every - 1) // every
    level, variance, clipped = np.zeros(rows * columns), np.zeros(rows * columns), np.zeros(rows * columns, np.bool_)
    inside = (tile - 2) ** 2 * KERNEL_NORM**2
    for k in range(rows * columns):
        top, left = k // columns * every * tile, k % columns * tile
        total, power = np.float32(0.0), np.float32(0.0)
        for y in range(top, top + tile):
            for x in range(left, left + tile):
                value = grey[y, x]
                total += value
                clipped[k] |= value < QUANTISATION_NOISE or value > WHITE - QUANTISATION_NOISE
        for y in range(top + 1, top + tile - 1):
            for x in range(left + 1, left + tile - 1):
                above = grey[y - 1, x - 1] - np.float32(2.0) * grey[y - 1, x] + grey[y - 1, x + 1]
                here = grey[y, x - 1] - np.float32(2.0) * grey[y, x] + grey[y, x + 1]
                below = grey[y + 1, x - 1] - np.float32(2.0) * grey[y + 1, x] + grey[y + 1, x + 1]
                power += (above - np.float32(2.0) * here + below) ** 2
        level[k], variance[k] = total / tile**2, power / inside
    return level, variance, clipped
