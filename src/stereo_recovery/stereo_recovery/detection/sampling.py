"""Looking up images between pixels, by bilinear interpolation."""

from __future__ import annotations

from typing import TypeAlias

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import Float32Array

# A place or a vector in an image, pixels.
Pair: TypeAlias = tuple[float, float]


@njit
def bilinear(image: Float32Array, u: float, v: float) -> float:
    """The image (h, w) at column u and row v, pixels, 0 <= u < w - 1, 0 <= v < h - 1."""
    x, y = int(u), int(v)
    a, b = u - x, v - y
    value: float = (
        (1 - a) * (1 - b) * image[y, x]
        + a * (1 - b) * image[y, x + 1]
        + (1 - a) * b * image[y + 1, x]
        + a * b * image[y + 1, x + 1]
    )
    return value


@njit
def bilinear_pair(first: Float32Array, second: Float32Array, u: float, v: float) -> tuple[float, float]:
    """As :func:`bilinear`, of two images of one size."""
    x, y = int(u), int(v)
    a, b = u - x, v - y
    w00, w01, w10, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
    return (
        w00 * first[y, x] + w01 * first[y, x + 1] + w10 * first[y + 1, x] + w11 * first[y + 1, x + 1],
        w00 * second[y, x] + w01 * second[y, x + 1] + w10 * second[y + 1, x] + w11 * second[y + 1, x + 1],
    )


@njit
def slope_along(gx: Float32Array, gy: Float32Array, u: float, v: float, normal: Pair) -> float:
    """The gradient (h, w) along a normal, at a place as of :func:`bilinear`."""
    gu, gv = bilinear_pair(gx, gy, u, v)
    along: float = gu * normal[0] + gv * normal[1]
    return along
