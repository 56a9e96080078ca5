"""Noise of the detector's own filter, place by place, measured in the picture.

Cameras with a colour mosaic, compression and smoothing make noise whose neighbouring pixels agree, shot noise makes
bright places noisier than dark ones, and print or cloth covers parts of a picture with small marks. What an edge has to
stand out of is in all cases what the derivative of the smoothed image does where it stands; so that is what is
measured, not the noise of single pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import Float32Array, FloatArray

from . import edgel_kernels
from .settings import NOISE_RANK_SIGMA, NOISE_TILE, QUANTISATION_NOISE


@dataclass(frozen=True, eq=False)
class NoiseMap:
    """Standard deviation of a derivative of the smoothed image, in tiles.

    Attributes
    ----------
    sigma : (rows, columns) float32, grey levels per pixel
        Of each tile.
    tile : int
        Pixels. Side of a tile; the last row and column of tiles also hold for what is left of the image.
    """

    sigma: Float32Array
    tile: int

    @classmethod
    def uniform(cls, sigma: float, shape: tuple[int, int]) -> NoiseMap:
        """One sigma, grey levels per pixel, all over an image of this (height, width)."""
        return cls(np.full((1, 1), sigma, np.float32), max(shape))

    def at(self, position: FloatArray) -> FloatArray:
        """(n,) float64, grey levels per pixel: sigma at points (n, 2), columns and rows in pixels."""
        index = np.maximum(position, 0.0).astype(np.intp) // self.tile
        rows, columns = self.sigma.shape
        found = self.sigma[np.minimum(index[:, 1], rows - 1), np.minimum(index[:, 0], columns - 1)]
        return np.asarray(found, np.float64)


def white_response(noise: float, sigma: float) -> float:
    """Standard deviation of a derivative of the smoothed image when its noise differs from pixel to pixel.

    Parameters
    ----------
    noise : float
        Grey levels. Of the image.
    sigma : float
        Pixels. Of the Gaussian smoothing.

    Returns
    -------
    float
        Grey levels per pixel.

    Examples
    --------
    >>> round(white_response(2.0, 1.0), 3)
    0.399
    """
    return float(noise / (np.sqrt(8.0 * np.pi) * sigma**2))


def measured_response(gx: Float32Array, gy: Float32Array, sigma: float) -> NoiseMap:
    """Noise of the two derivatives, from the picture itself.

    A slope or an edge has the same gradient a little farther along it, noise and texture have not: the part of the
    gradient there that is across the one here is noise. In each tile a high quantile of it counts, because texture has
    heavier tails than noise; and of 3 x 3 tiles the median, because corners are rare.

    Parameters
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image.
    sigma : float
        Pixels. Of the smoothing.

    Returns
    -------
    NoiseMap
        At least what rounding to 8 bits leaves.
    """
    tile = min(NOISE_TILE, *gx.shape)
    deviation = edgel_kernels.change_along_edges(gx, gy, tile) / np.float32(NOISE_RANK_SIGMA)
    smooth = cv2.medianBlur(deviation, 3) if min(deviation.shape) > 2 else deviation
    return NoiseMap(np.maximum(smooth, np.float32(white_response(QUANTISATION_NOISE, sigma))), tile)
