"""Compiled loops over pixels for :mod:`.edgels`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import Float32Array, FloatArray

from .sampling import bilinear, clamped
from .settings import LEAST_CURVATURE, LEAST_DIVISOR, LEAST_INTERPOLATED, LOGARITHM_FLOOR


@njit
def _is_maximum(m2: Float32Array, gx: Float32Array, gy: Float32Array, y: int, x: int) -> bool:
    """Whether m2 (h, w) at (y, x) is the largest, or first of equals, of three along the axis nearest the gradient."""
    dy, dx = (0, 1) if abs(gx[y, x]) >= abs(gy[y, x]) else (1, 0)
    largest: bool = m2[y, x] > m2[y - dy, x - dx] and m2[y, x] >= m2[y + dy, x + dx]
    return largest


@njit
def ridge_maxima(
    gx: Float32Array, gy: Float32Array, threshold: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sub-pixel maxima of the gradient magnitude across its own direction, in raster order.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
    threshold : float
        Grey levels per pixel. Least magnitude.

    Returns
    -------
    u, v : (n,) float64, pixels
    gu, gv : (n,) float64, grey levels per pixel
        Gradient there.
    width : (n,) float64, pixels
        Standard deviation of the blurred step.
    """
    h, w = gx.shape
    m2 = gx * gx + gy * gy
    limit = threshold * threshold
    count = 0
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            if m2[y, x] > limit and _is_maximum(m2, gx, gy, y, x):
                count += 1
    u, v = np.empty(count), np.empty(count)
    gu, gv, width = np.empty(count), np.empty(count), np.empty(count)
    floor = LOGARITHM_FLOOR * limit + LEAST_DIVISOR
    n = 0
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            if m2[y, x] <= limit or not _is_maximum(m2, gx, gy, y, x):
                continue
            norm = np.sqrt(m2[y, x])
            nx, ny = gx[y, x] / norm, gy[y, x] / norm
            # Least-squares quadratic over 3 x 3 samples of the logarithm (closed form of the facet model).
            sx = sy = sxx = syy = sxy = total = 0.0
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    value = 0.5 * np.log(m2[y + dy, x + dx] + floor)
                    total += value
                    sx += dx * value
                    sy += dy * value
                    sxx += dx * dx * value
                    syy += dy * dy * value
                    sxy += dx * dy * value
            kx, ky = sx / 6.0, sy / 6.0
            kxx = sxx - total * 2.0 / 3.0
            kyy = syy - total * 2.0 / 3.0
            kxy = sxy / 4.0
            slope = kx * nx + ky * ny
            bend = kxx * nx * nx + 2.0 * kxy * nx * ny + kyy * ny * ny
            if bend >= -LEAST_CURVATURE:
                continue
            t = -slope / bend
            if abs(t) > 1.0:
                continue
            px, py = x + t * nx, y + t * ny
            u[n], v[n] = px, py
            width[n] = 1.0 / np.sqrt(-bend)
            gu[n], gv[n] = bilinear(gx, px, py), bilinear(gy, px, py)
            if gu[n] * gu[n] + gv[n] * gv[n] < LEAST_INTERPOLATED * m2[y, x]:
                continue
            n += 1
    return u[:n], v[:n], gu[:n], gv[:n], width[:n]


@njit
def zero_crossings(
    laplacian: Float32Array, gx: Float32Array, gy: Float32Array, threshold: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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
    u, v : (n,) float64, pixels
    gu, gv : (n,) float64, grey levels per pixel
        Gradient there.

    References
    ----------
    D. Marr and E. Hildreth, "Theory of edge detection", Proc. R. Soc. London B 207, 1980.
    """
    h, w = gx.shape
    limit = threshold * threshold
    u, v = np.empty(h * w // 2), np.empty(h * w // 2)
    gu, gv = np.empty(h * w // 2), np.empty(h * w // 2)
    n = 0
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            if gx[y, x] * gx[y, x] + gy[y, x] * gy[y, x] <= limit or n >= len(u):
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
            u[n], v[n] = x + t * dx, y + t * dy
            gu[n] = (1 - t) * gx[y, x] + t * gx[y + dy, x + dx]
            gv[n] = (1 - t) * gy[y, x] + t * gy[y + dy, x + dx]
            n += 1
    return u[:n], v[:n], gu[:n], gv[:n]


@njit
def flanking_gradients(
    gx: Float32Array, gy: Float32Array, u: FloatArray, v: FloatArray, gu: FloatArray, gv: FloatArray, distance: float
) -> FloatArray:
    """The gradient on both flanks of edgels along their own gradients, as a share of the edgels'.

    Beside a step between evenly lit faces the share is 0, and on a slope it is 1.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
    u, v : (n,) float64, pixels
        Positions of edgels.
    gu, gv : (n,) float64, grey levels per pixel
        Their gradients.
    distance : float
        Pixels. Of the flanks.

    Returns
    -------
    (n, 2) float64
        On the dark and on the bright flank.
    """
    out = np.empty((len(u), 2))
    for i in range(len(u)):
        norm = np.sqrt(gu[i] * gu[i] + gv[i] * gv[i])
        nx, ny = gu[i] / norm, gv[i] / norm
        for flank in range(2):
            t = distance if flank == 1 else -distance
            x, y = u[i] + t * nx, v[i] + t * ny
            out[i, flank] = (clamped(gx, x, y) * nx + clamped(gy, x, y) * ny) / norm
    return out
