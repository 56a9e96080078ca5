"""What the noise of one picture says of how it codes light.

Light comes in grains, so that by nature bright places are noisier than dark ones, or as noisy. A picture that codes
light by a power of it stretches the dark: where plain places are the noisier the darker they are, light is coded.

References
----------
C. Liu, R. Szeliski, S. B. Kang, C. L. Zitnick, W. T. Freeman, Automatic estimation and removal of noise from a single
image, PAMI 30(2), 2008: the noise of a level is that of its plainest places. EMVA Standard 1288, release 4.0 linear,
section 6: the variance of noise grows in proportion to light.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.settings import SRGB_EXPONENT
from msgs_py.numeric.typed import Float32Array, FloatArray

from .detection.edgel_kernels import noise_of_tiles
from .detection.settings import QUANTISATION_NOISE, WHITE
from .settings import (
    FEWEST_TILES,
    MEAN_TEXTURE,
    MOST_TILES,
    NOISE_TOLD_SIGMA,
    PLAIN_TILE,
    PLAINEST,
    TEXTURED_SHARE,
    TONE_LEVELS,
)

# Grey levels: noise of the levels on the whole; and how much more variance full light has than none, over that of none.
SIGMAS = np.geomspace(0.05, 20.0, 120)
SHOT = np.array([0.0, 0.3, 1.0, 3.0, 10.0, 100.0])


class NoiseByLevel(NamedTuple):
    """The noise of k grey levels.

    Attributes
    ----------
    level : (k,) float64, grey levels
        Mean of the places of each.
    sigma : (k,) float64, grey levels
        Standard deviation of the noise of the plainest of them.
    """

    level: FloatArray
    sigma: FloatArray


class NoiseSpread(NamedTuple):
    """How far the logarithms of levels' noise are from those of the sensor's.

    Attributes
    ----------
    sigma : float
        Of plain levels.
    textured : float
        Share of levels of which even the plainest places have texture.
    texture : float
        Mean by which these are noisier.
    """

    sigma: float = NOISE_TOLD_SIGMA
    textured: float = TEXTURED_SHARE
    texture: float = MEAN_TEXTURE


def noise_by_level(grey: Float32Array) -> NoiseByLevel:
    """The noise of every grey level that enough of a picture has.

    Parameters
    ----------
    grey : (h, w) float32, grey levels

    Returns
    -------
    NoiseByLevel
        Without places that are clipped.

    References
    ----------
    J. Immerkaer, Fast noise variance estimation, CVIU 64(2), 1996: the second difference, along columns, of the second
    difference along rows, which even shade does not excite.
    """
    tiles = (grey.shape[0] // PLAIN_TILE) * (grey.shape[1] // PLAIN_TILE)
    level, power, clipped = noise_of_tiles(grey, PLAIN_TILE, max(1, -(-tiles // MOST_TILES)))
    level, power = level[~clipped], power[~clipped]
    bins = np.minimum(level * (TONE_LEVELS / WHITE), TONE_LEVELS - 1).astype(np.int64)
    order = np.lexsort((power, bins))
    count = np.bincount(bins, minlength=TONE_LEVELS)
    many = np.flatnonzero(count >= FEWEST_TILES)
    plainest = (np.cumsum(count) - count + PLAINEST * count).astype(np.int64)[many]
    mean = np.bincount(bins, level, TONE_LEVELS)[many] / count[many]
    return NoiseByLevel(mean, np.sqrt(power[order][plainest]))


def nats_of_code(noise: NoiseByLevel) -> float:
    """How much likelier the noise of a picture is if it codes light by a power than if it does not.

    Parameters
    ----------
    noise : NoiseByLevel

    Returns
    -------
    float
        Natural logarithm of the ratio; 0 where the picture does not tell.

    Examples
    --------
    Noise that grows with the level is that of light, noise that falls with it of light that is coded:

    >>> level = np.linspace(20.0, 240.0, 12)
    >>> round(nats_of_code(NoiseByLevel(level, 0.1 * np.sqrt(level + 50.0))))
    -69
    >>> round(nats_of_code(NoiseByLevel(level, 1.0 + 40.0 / level)))
    15
    """
    return log_likelihood(noise, True) - log_likelihood(noise, False)


def log_likelihood(noise: NoiseByLevel, coded: bool, spread: NoiseSpread | None = None) -> float:
    """Nats of the noise of a picture that codes light by a power, or does not, whatever its sensor's noise is.

    Parameters
    ----------
    noise : NoiseByLevel
    coded : bool
    spread : NoiseSpread, optional
        Of the levels about what the sensor's noise is there.
    """
    spread = spread or NoiseSpread()
    if len(noise.level) == 0:
        return 0.0
    exponent = SRGB_EXPONENT if coded else 1.0
    light = (noise.level / WHITE) ** exponent
    steepness = (noise.level / WHITE) ** (1.0 - exponent) / exponent
    variance = steepness**2 * (1.0 + SHOT[:, None] * light)
    variance /= variance.mean(axis=1, keepdims=True)
    expected = SIGMAS[:, None, None] ** 2 * variance + QUANTISATION_NOISE**2
    off = np.log(np.maximum(noise.sigma, QUANTISATION_NOISE)) - 0.5 * np.log(expected)
    plain = np.exp(-0.5 * (off / spread.sigma) ** 2) / (spread.sigma * np.sqrt(2.0 * np.pi))
    textured = np.where(off > 0.0, np.exp(-np.maximum(off, 0.0) / spread.texture) / spread.texture, 0.0)
    chance = (1.0 - spread.textured) * plain + spread.textured * textured
    nats = np.log(chance + np.finfo(float).tiny).sum(axis=-1)
    return float(np.logaddexp.reduce(nats, axis=None) - np.log(nats.size))
