"""Edge elements with sub-pixel position, direction and their uncertainty (thesis 3.7).

The default detector is Canny's: Gaussian derivative, maxima of the gradient along its own direction, hysteresis (done
on chains, see :mod:`.chains`). The position along the gradient is the maximum of a quadratic fitted to the
*logarithm* of the gradient magnitude over 3 x 3 pixels: the magnitude across a blurred step is a Gaussian, so its
logarithm is exactly quadratic and the fit has no pixel-locking bias (for straight edges). Roberts, Sobel and
Marr-Hildreth are there for study and give the same type.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np

from ..params import DETECTORS
from . import edgel_kernels

# Variance, px^2, that a camera's aperture (a unit box) and a sharp lens (0.5 px) add to the smoothing: where no picture
# tells.
CAMERA_BLUR_VARIANCE = 1.0 / 12.0 + 0.25
# Noise below this, in grey levels, is never believed: it is what rounding to 8 bits leaves.
QUANTISATION_NOISE = 0.3
# Position error, px, that remains without noise: sampling, and surfaces that are not evenly shaded.
POSITION_FLOOR = 0.015
# The same for pictures without anti-aliasing, and the blur, px^2, below which a picture counts as one: half of what
# a pixel's own area blurs.
JAGGED_FLOOR = 0.13
LEAST_BLUR_VARIANCE = 1.0 / 24.0
# Where the two sides of an edge are looked at, in widths of the blurred step; how unequal noise makes them at most,
# and by how much an edgel has to stand out from them, in sigmas of the gradient.
SIDES = 2.0
UNEVEN_NOISE = 2.5
PROMINENCE = 2.5


@dataclass(frozen=True, eq=False)
class Edgels:
    """n edge elements, a struct of arrays.

    position : (n, 2) float64, pixels (u, v), integer = centre of a pixel
    direction : (n,) float64, radians: of the gradient (from dark to bright), so it carries the contrast's sign
    magnitude : (n,) float64, grey levels per pixel
    sigma_position : (n,) float64, pixels, along the gradient
    sigma_direction : (n,) float64, radians
    width : (n,) float64, pixels: standard deviation of the blurred step, smoothing included
    bias : (n,) float64, pixels: how far shading or another edge beside it may have moved it; neighbours move alike
    """

    position: np.ndarray
    direction: np.ndarray
    magnitude: np.ndarray
    sigma_position: np.ndarray
    sigma_direction: np.ndarray
    width: np.ndarray
    bias: np.ndarray

    @classmethod
    def empty(cls) -> Edgels:
        return cls(np.zeros((0, 2)), *(np.zeros(0) for _ in range(6)))

    def __len__(self) -> int:
        return len(self.position)

    def select(self, index: np.ndarray) -> Edgels:
        """A subset or reordering: (m,) indices or (n,) bool."""
        if index.dtype == bool:
            index = np.flatnonzero(index)  # once, not for each array
        return Edgels(*(getattr(self, f.name)[index] for f in fields(self)))

    @classmethod
    def concatenate(cls, parts: Sequence[Edgels]) -> Edgels:
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    @property
    def tangent(self) -> np.ndarray:
        """(n, 2) float64, unit, along the edge with the bright side on the right hand as drawn (v down)."""
        return np.stack([np.sin(self.direction), -np.cos(self.direction)], axis=1)


def as_grey(image: np.ndarray, name: str = 'image') -> np.ndarray:
    """Any picture as (h, w) float32 grey levels on the scale 0..255.

    image : (h, w) or (h, w, 1|3|4), uint8, uint16 (scaled by 1/256) or float (taken as grey levels). Colour is
    averaged with equal weights, so that RGB and BGR agree. NaN becomes 0.
    Raises ValueError, naming the argument, for anything else.
    """
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] in (1, 3, 4):
        array = array[..., :3].mean(axis=2, dtype=np.float32) if array.shape[2] > 1 else array[..., 0]
        scale = 1.0 / 256.0 if np.asarray(image).dtype == np.uint16 else 1.0
    elif array.ndim == 2:
        scale = 1.0 / 256.0 if array.dtype == np.uint16 else 1.0
    else:
        raise ValueError(f'{name}: expected shape (h, w) or (h, w, 3), got {array.shape}')
    if array.dtype == bool or not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise ValueError(f'{name}: expected grey levels as uint8, uint16 or float, got {array.dtype}')
    grey = np.ascontiguousarray(array, dtype=np.float32)
    if scale != 1.0:
        grey = grey * np.float32(scale)
    if np.issubdtype(array.dtype, np.floating) and not np.isfinite(grey).all():
        grey = np.nan_to_num(grey, nan=0.0, posinf=255.0, neginf=0.0)
    return grey


def noise_level(grey: np.ndarray) -> float:
    """Standard deviation of the image noise, grey levels, from the median of a second difference of the second
    difference, which flat and evenly shaded areas do not excite (Immerkaer 1996, made robust)."""
    if min(grey.shape) < 3:
        return QUANTISATION_NOISE
    kernel = np.array([1.0, -2.0, 1.0], np.float32)
    # One row in two is plenty for a median, and it halves the time.
    response = np.abs(cv2.sepFilter2D(grey, cv2.CV_32F, kernel, kernel))[1:-1:3, 1:-1:2]
    return max(QUANTISATION_NOISE, float(np.median(response)) / (0.6745 * 6.0))


def blur_variance(found: Sequence[Edgels]) -> float:
    """Variance, px^2, of a usual step in some pictures: the smoothing, and what the camera blurs."""
    return float(np.median(np.concatenate([e.width for e in found]))) ** 2


def gaussian_kernels(sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Sampled Gaussian (sum 1) and its derivative (unit response to a unit ramp), float32, radius 4 sigma."""
    radius = max(1, int(np.ceil(4.0 * sigma)))
    x = np.arange(-radius, radius + 1, dtype=np.float64)
    smooth = np.exp(-0.5 * (x / sigma) ** 2)
    smooth /= smooth.sum()
    slope = x * smooth
    slope /= (x * slope).sum()
    return smooth.astype(np.float32), slope.astype(np.float32)


def gradient(grey: np.ndarray, detector: str, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal and vertical derivative, (h, w) float32, grey levels per pixel.

    Roberts' pair is the diagonal 2 x 2 difference, rotated to the axes; its half-pixel shift is undone by averaging
    the four 2 x 2 windows around a pixel. Both it and Sobel's are applied to the smoothed image (thesis 3.7.1).
    """
    smooth, slope = gaussian_kernels(sigma)
    border = cv2.BORDER_REPLICATE
    if detector in ('canny', 'marr-hildreth'):
        return (
            cv2.sepFilter2D(grey, cv2.CV_32F, slope, smooth, borderType=border),
            cv2.sepFilter2D(grey, cv2.CV_32F, smooth, slope, borderType=border),
        )
    blurred = cv2.sepFilter2D(grey, cv2.CV_32F, smooth, smooth, borderType=border)
    if detector == 'sobel':
        return (
            cv2.Sobel(blurred, cv2.CV_32F, 1, 0, scale=0.125, borderType=border),
            cv2.Sobel(blurred, cv2.CV_32F, 0, 1, scale=0.125, borderType=border),
        )
    diagonal = np.array([[-0.25, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.25]], np.float32)
    g1 = cv2.filter2D(blurred, cv2.CV_32F, diagonal, borderType=border)
    g2 = cv2.filter2D(blurred, cv2.CV_32F, np.ascontiguousarray(diagonal[:, ::-1]) * -1.0, borderType=border)
    return g1 + g2, g1 - g2


def detect(
    grey: np.ndarray,
    detector: str = 'canny',
    sigma: float = 1.0,
    threshold: float = 1.0,
    noise: float | None = None,
    slopes: tuple[np.ndarray, np.ndarray] | None = None,
    usual_width: float | None = None,
) -> Edgels:
    """Edgels of a grey image.

    grey : (h, w) float32, grey levels; detector : one of DETECTORS; sigma : smoothing, pixels
    threshold : least gradient magnitude, grey levels per pixel; noise : grey levels, estimated when None
    slopes : what :func:`gradient` gave for this picture, when it is known already; usual_width : median width of its
    edgels, pixels, likewise
    Returns Edgels in raster order. Images smaller than 5 pixels have none.
    """
    if detector not in DETECTORS:
        raise ValueError(f'detector: expected one of {", ".join(DETECTORS)}, got {detector!r}')
    if min(grey.shape) < 5:
        return Edgels.empty()
    noise = noise_level(grey) if noise is None else noise
    gx, gy = gradient(grey, detector, sigma) if slopes is None else slopes
    if detector == 'marr-hildreth':
        smooth, _ = gaussian_kernels(sigma)
        blurred = cv2.sepFilter2D(grey, cv2.CV_32F, smooth, smooth, borderType=cv2.BORDER_REPLICATE)
        laplacian = cv2.Laplacian(blurred, cv2.CV_32F, borderType=cv2.BORDER_REPLICATE)
        u, v, gu, gv = edgel_kernels.zero_crossings(laplacian, gx, gy, np.float32(threshold))
        width = np.full(len(u), np.sqrt(sigma**2 + CAMERA_BLUR_VARIANCE))
    else:
        u, v, gu, gv, width = edgel_kernels.ridge_maxima(gx, gy, np.float32(threshold))
    magnitude = np.hypot(gu, gv)
    # Noise of the second derivative over the slope of that derivative at a step (DESIGN section 8 wants it stated):
    # sigma_e = sqrt(3/8) noise/contrast (S/s)^3 with S^2 = s^2 + the camera's own blur, which the steps show.
    if usual_width is None:
        usual_width = float(np.median(width)) if len(width) else sigma
    total = max(usual_width, sigma)
    contrast = magnitude * np.sqrt(2.0 * np.pi) * total
    # A camera always blurs a little; a picture with one sample a pixel does not, and its edges are stairs.
    floor = JAGGED_FLOOR if usual_width**2 < sigma**2 + LEAST_BLUR_VARIANCE else POSITION_FLOOR
    along = np.hypot(np.sqrt(0.375) * noise / contrast * (total / sigma) ** 3, floor)
    across = noise / (np.sqrt(8.0 * np.pi) * sigma**2) / magnitude
    sides = edgel_kernels.beside(gx, gy, u, v, gu, gv, SIDES * total)
    # What the two sides' gradients differ by, less what noise does to them.
    shift = np.sqrt(np.maximum((sides[:, 0] - sides[:, 1]) ** 2 - (UNEVEN_NOISE * across) ** 2, 0.0))
    found = Edgels(np.stack([u, v], axis=1), np.arctan2(gv, gu), magnitude, along, across, width, shift)
    # On a slope (the side of a cylinder) noise alone makes maxima: an edge stands out from both its sides.
    return found.select(1.0 - sides.max(axis=1) > PROMINENCE * across)
