"""The noise of a camera from two pictures of one still scene: the photon transfer curve.

What differs between the two is noise, twice over. Its variance grows in proportion to the light, by the number of grey
levels that an electron makes, from what reading a pixel adds.

References
----------
J. R. Janesick, Photon Transfer, SPIE Press, 2007; EMVA Standard 1288, release 4.0 linear, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from .settings import CALM_SIGMA, FEWEST_PAIRS, LEVEL_BINS, OUTLIER_SIGMAS, REWEIGHTED, TRANSFER_HUBER


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Variance against mean, and the straight line through it.

    Attributes
    ----------
    level : (k,) float64, grey levels of 255
        Mean of the pixels of each bin, in linear light.
    variance : (k,) float64, grey levels squared
        Of one picture there, without what rounding adds.
    error : (k,) float64, grey levels squared
        Its standard error.
    coefficients : (2,) float64
        Variance at level 0, and what it grows by with each level: that is the gain, grey levels an electron.
    covariance : (2, 2) float64
        Of the coefficients.
    """

    level: FloatArray
    variance: FloatArray
    error: FloatArray
    coefficients: FloatArray
    covariance: FloatArray

    def variance_at(self, level: float) -> tuple[float, float]:
        """Variance of a pixel at a level of linear light, and its standard error, grey levels squared."""
        row = np.array([1.0, level])
        return float(row @ self.coefficients), float(np.sqrt(row @ self.covariance @ row))


def photon_transfer(
    first: FloatArray, second: FloatArray, rounding: float, gamma: float = 1.0
) -> PhotonTransfer | None:
    """The curve of two pictures.

    Parameters
    ----------
    first, second : (h, w) float64
        Grey levels of 255, of one still scene; of a mosaic the pixels of one colour.
    rounding : float
        Grey levels. Standard deviation of what rounding adds to a number.
    gamma : float
        Light is the numbers to this power.

    Returns
    -------
    PhotonTransfer or None
        None where no level has enough pixels that are neither clipped nor beside an edge.
    """
    # The difference of two equal noises says nothing of their mean, so that choosing by the mean biases nothing.
    mean, difference = 0.5 * (first + second), first - second
    smooth = np.asarray(cv2.GaussianBlur(mean, (0, 0), CALM_SIGMA, borderType=cv2.BORDER_REPLICATE), np.float64)
    down, across = np.gradient(smooth)
    # Where the level does not change by more than a bin within the smoothing, nor near by: there it is that of the
    # pixel, and a camera that trembles by a hundredth of a pixel makes no difference.
    steep = np.hypot(down, across) * (2.0 * CALM_SIGMA) > 255.0 / LEVEL_BINS
    reach = int(np.ceil(2.0 * CALM_SIGMA))
    near = cv2.dilate(steep.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    bins = np.clip((smooth * (LEVEL_BINS / 255.0)).astype(np.int64), 0, LEVEL_BINS - 1)
    bins[near] = -1
    rows = [row for k in range(LEVEL_BINS) if (row := _level(smooth[bins == k], difference[bins == k])) is not None]
    if not rows:
        return None
    numbers, spread, count = np.array(rows).T
    clipped = OUTLIER_SIGMAS * np.sqrt(spread)
    # Without any difference a level tells nothing: it is clipped, or nothing was taken twice.
    kept = (spread > 0.0) & (numbers > clipped) & (255.0 - numbers > clipped)
    if not kept.any():
        return None
    numbers, spread, count = numbers[kept], spread[kept], count[kept]
    # Numbers to light, and their variances with the slope of the curve there.
    steepness = gamma * (numbers / 255.0) ** (gamma - 1.0)
    level = 255.0 * (numbers / 255.0) ** gamma
    variance = (spread - rounding**2) * steepness**2
    return _line(level, variance, spread * steepness**2, count)


def _level(level: FloatArray, apart: FloatArray) -> tuple[float, float, float] | None:
    """Mean and variance of one picture, and the number of pixels, of the pixels of one bin and their differences."""
    if len(level) < FEWEST_PAIRS:
        return None
    for _ in range(REWEIGHTED):
        # Light that flickers changes all pixels of a level alike.
        offset, deviation = apart.mean(), apart.std()
        inside = np.abs(apart - offset) <= OUTLIER_SIGMAS * deviation
        apart, level = apart[inside], level[inside]
    return float(level.mean()), float(0.5 * apart.var(ddof=1)), float(len(apart))


def _line(level: FloatArray, variance: FloatArray, total: FloatArray, count: IntArray | FloatArray) -> PhotonTransfer:
    """The line through variances whose errors are those of normal noise: v sqrt(2 / n), v with rounding."""
    error = total * np.sqrt(2.0 / count)
    design = np.stack([np.ones(len(level)), level], axis=1)
    if len(level) == 1:
        design[:, 1] = 0.0
    weight = error**-2.0
    coefficients: FloatArray = np.zeros(2)
    covariance: FloatArray = np.zeros((2, 2))
    for _ in range(REWEIGHTED):
        covariance = np.asarray(np.linalg.pinv(design.T @ (weight[:, None] * design)), np.float64)
        coefficients = covariance @ (design.T @ (weight * variance))
        # A bin in which something has moved is an outlier.
        z = np.abs(variance - design @ coefficients) / error
        weight = error**-2.0 * np.minimum(1.0, TRANSFER_HUBER / np.maximum(z, TRANSFER_HUBER))
    return PhotonTransfer(level, variance, error, coefficients, covariance)
