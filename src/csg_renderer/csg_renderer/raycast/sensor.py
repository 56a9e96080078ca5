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

    psf_sigma : standard deviation of the Gaussian point spread function, pixels, >= 0
    noise_sigma : standard deviation of additive Gaussian noise, grey levels of 255, >= 0
    seed : a whole number >= 0, or several: the same seed gives the same noise
    Raises ValueError, naming the field.
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
        """(h, w) or (h, w, channels), uint8 or float on the scale 0..255, to uint8 of the same shape.

        Blur comes first, then noise, independent in every pixel and channel; then rounding and clipping.
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
    """(h, w, 3) RGB uint8 to (h, w) float64 luma, 0..255, not rounded."""
    return image @ LUMA
