"""What a real camera does to a perfect image: blur, noise, whole numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import ByteArray

from .settings import LUMA


@dataclass(frozen=True)
class SensorModel:
    """A lens and a chip.

    Parameters
    ----------
    psf_sigma : float
        Standard deviation of the Gaussian point spread function, pixels, >= 0.
    noise_sigma : float
        Standard deviation of additive Gaussian noise, grey levels of 255, >= 0.
    seed : int or sequence of int
        >= 0; the same seed gives the same noise.

    Raises
    ------
    ValueError
        A field is out of its range; the message begins with its name.

    Examples
    --------
    >>> SensorModel().apply(np.array([[1.4, 300.0]])).tolist()
    [[1, 255]]
    """

    psf_sigma: float = 0.0
    noise_sigma: float = 0.0
    seed: int | Sequence[int] = 0

    def __post_init__(self) -> None:
        for name in ('psf_sigma', 'noise_sigma'):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise ValueError(f'{name}: expected a finite number >= 0, got {value}')
        if np.min(self.seed) < 0:
            raise ValueError(f'seed: expected whole numbers >= 0, got {self.seed}')

    def apply(self, image: np.ndarray) -> np.ndarray:
        """An image as the sensor gives it: blurred, then with noise, then rounded and clipped.

        Parameters
        ----------
        image : (h, w) or (h, w, channels) array, uint8 or float
            On the scale 0..255.

        Returns
        -------
        uint8 array of the same shape
            Noise is independent in every pixel and channel.
        """
        values: np.ndarray = np.asarray(image, dtype=np.float32)
        if self.psf_sigma > 0.0:
            values = np.asarray(cv2.GaussianBlur(values, (0, 0), self.psf_sigma, borderType=cv2.BORDER_REPLICATE))
        if self.noise_sigma > 0.0:
            noise = np.random.default_rng(self.seed).standard_normal(values.shape, dtype=np.float32)
            values = values + np.float32(self.noise_sigma) * noise
        pixels: ByteArray = np.rint(values).clip(0.0, 255.0).astype(np.uint8)
        return pixels


def grey(image: np.ndarray) -> np.ndarray:
    """Luma of a picture.

    Parameters
    ----------
    image : (h, w, 3) array of uint8
        RGB.

    Returns
    -------
    (h, w) float64
        0..255, not rounded (ITU-R BT.601).
    """
    return image @ LUMA
