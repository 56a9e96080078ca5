"""Edge elements with sub-pixel position, direction and their uncertainty (thesis 3.7).

The default detector is Canny's: Gaussian derivative, maxima of the gradient along its own direction, hysteresis (done
on edge chains, see :mod:`.chains`). The position along the gradient is the maximum of a quadratic fitted to the
*logarithm* of the gradient magnitude over 3 x 3 pixels: the magnitude across a blurred step is a Gaussian, so its
logarithm is exactly quadratic and the fit has no pixel-locking bias (for straight edges). Roberts, Sobel and
Marr-Hildreth give the same type, for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np

from msgs_py.numeric.robust import NORMAL_QUARTILE
from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray

from ..params import DETECTORS
from . import edgel_kernels
from .settings import (
    ALIASED_BLUR_VARIANCE,
    ALIASED_POSITION_FLOOR,
    CAMERA_BLUR_VARIANCE,
    FLANK_DISTANCE,
    FLANK_NOISE,
    KERNEL_NORM,
    KERNEL_RADIUS,
    POSITION_FACTOR,
    POSITION_FLOOR,
    PROMINENCE,
    QUANTISATION_NOISE,
    SIXTEEN_BIT_SCALE,
    SMALLEST_IMAGE,
)


@dataclass(frozen=True, eq=False)
class Edgels:
    """n edge elements, a struct of arrays.

    Attributes
    ----------
    position : (n, 2) float64, pixels
        Column u and row v; an integer is the centre of a pixel.
    direction : (n,) float64, radians
        Of the gradient, from dark to bright, so that it carries the sign of the contrast.
    magnitude : (n,) float64, grey levels per pixel
    sigma_position : (n,) float64, pixels
        Along the gradient.
    sigma_direction : (n,) float64, radians
    width : (n,) float64, pixels
        Standard deviation of the blurred step, smoothing included.
    bias : (n,) float64, pixels
        Localisation bias: how far shading or a second edge nearby may have moved the edgel. Neighbouring edgels move
        alike.
    """

    position: FloatArray
    direction: FloatArray
    magnitude: FloatArray
    sigma_position: FloatArray
    sigma_direction: FloatArray
    width: FloatArray
    bias: FloatArray

    @classmethod
    def empty(cls) -> Edgels:
        """No edgels."""
        return cls(np.zeros((0, 2)), *(np.zeros(0) for _ in range(6)))

    def __len__(self) -> int:
        return len(self.position)

    def select(self, index: AnyArray) -> Edgels:
        """A subset or reordering: (m,) indices or (n,) bool."""
        if index.dtype == bool:
            index = np.flatnonzero(index)  # once, not for each array
        return Edgels(*(getattr(self, f.name)[index] for f in fields(self)))

    @classmethod
    def concatenate(cls, parts: Sequence[Edgels]) -> Edgels:
        """The edgels of all parts, in their order."""
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    @property
    def tangent(self) -> FloatArray:
        """(n, 2) float64, unit, along the edge with the bright side on the right hand as drawn (v down)."""
        return np.stack([np.sin(self.direction), -np.cos(self.direction)], axis=1)


def as_grey(image: AnyArray, name: str = 'image') -> Float32Array:
    """Any picture as grey levels on the scale 0..255.

    Parameters
    ----------
    image : (h, w) or (h, w, 1|3|4), uint8, uint16 or float
        uint16 is scaled by 1/256; floats are grey levels. Colour is averaged with equal weights, so that RGB and BGR
        agree. NaN becomes 0.
    name : str
        Of the argument, for messages.

    Returns
    -------
    (h, w) float32, grey levels

    Raises
    ------
    ValueError
        The array is no picture; the message names the argument.

    Examples
    --------
    >>> as_grey(np.array([[[10, 20, 60]]], np.uint8)).tolist()
    [[30.0]]
    >>> as_grey(np.array([[512]], np.uint16)).tolist()
    [[2.0]]
    """
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] in (1, 3, 4):
        array = array[..., :3].mean(axis=2, dtype=np.float32) if array.shape[2] > 1 else array[..., 0]
        scale = SIXTEEN_BIT_SCALE if np.asarray(image).dtype == np.uint16 else 1.0
    elif array.ndim == 2:
        scale = SIXTEEN_BIT_SCALE if array.dtype == np.uint16 else 1.0
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


def noise_level(grey: Float32Array) -> float:
    """Standard deviation of the image noise.

    It is the median of the second difference, along columns, of the second difference along rows, which flat and evenly
    shaded areas do not excite.

    Parameters
    ----------
    grey : (h, w) float32, grey levels

    Returns
    -------
    float
        Grey levels. At least what rounding to 8 bits leaves.

    References
    ----------
    J. Immerkaer, "Fast noise variance estimation", CVIU 64(2), 1996; here with a median instead of the mean.
    """
    if min(grey.shape) < 3:
        return QUANTISATION_NOISE
    kernel = np.array([1.0, -2.0, 1.0], np.float32)
    # The median of one value in six is exact enough, and takes half of the time.
    response = np.abs(cv2.sepFilter2D(grey, cv2.CV_32F, kernel, kernel))[1:-1:3, 1:-1:2]
    return max(QUANTISATION_NOISE, float(np.median(response)) / (NORMAL_QUARTILE * KERNEL_NORM))


def gradient_noise(noise: float, sigma: float) -> float:
    """Standard deviation of a derivative of the smoothed image.

    Parameters
    ----------
    noise : float
        Grey levels. Of the image, independent from pixel to pixel.
    sigma : float
        Pixels. Of the Gaussian smoothing.

    Returns
    -------
    float
        Grey levels per pixel.

    Examples
    --------
    >>> round(gradient_noise(2.0, 1.0), 3)
    0.399
    """
    return float(noise / (np.sqrt(8.0 * np.pi) * sigma**2))


def blur_variance(found: Sequence[Edgels]) -> float:
    """Variance of the median step in some pictures: that of the smoothing and that of the camera's blur.

    Parameters
    ----------
    found : sequence of Edgels
        Of the pictures.

    Returns
    -------
    float
        Squared pixels.
    """
    return float(np.median(np.concatenate([e.width for e in found]))) ** 2


def gaussian_kernels(sigma: float) -> tuple[Float32Array, Float32Array]:
    """Sampled Gaussian (sum 1) and its derivative (unit response to a unit ramp).

    Parameters
    ----------
    sigma : float
        Pixels.

    Returns
    -------
    smooth, slope : (2 r + 1,) float32, r = 4 sigma rounded up
    """
    radius = max(1, int(np.ceil(KERNEL_RADIUS * sigma)))
    x = np.arange(-radius, radius + 1, dtype=np.float64)
    smooth = np.exp(-0.5 * (x / sigma) ** 2)
    smooth /= smooth.sum()
    slope = x * smooth
    slope /= (x * slope).sum()
    return smooth.astype(np.float32), slope.astype(np.float32)


def gradient(grey: Float32Array, detector: str, sigma: float) -> tuple[Float32Array, Float32Array]:
    """Horizontal and vertical derivative of the smoothed image.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    detector : str
        One of :data:`~stereo_recovery.params.DETECTORS`. Sobel's and Roberts' differences are taken of the smoothed
        image. Roberts' pair is the diagonal 2 x 2 difference, rotated to the axes; its shift by half a pixel is undone
        by averaging the four 2 x 2 windows around a pixel.
    sigma : float
        Pixels. Of the smoothing.

    Returns
    -------
    gx, gy : (h, w) float32, grey levels per pixel

    References
    ----------
    Thesis 3.7.1.
    """
    smooth, slope = gaussian_kernels(sigma)
    if detector in ('canny', 'marr-hildreth'):
        return _filtered(grey, slope, smooth), _filtered(grey, smooth, slope)
    blurred = _filtered(grey, smooth, smooth)
    border = cv2.BORDER_REPLICATE
    if detector == 'sobel':
        gx, gy = (cv2.Sobel(blurred, cv2.CV_32F, *order, scale=0.125, borderType=border) for order in ((1, 0), (0, 1)))
        return np.asarray(gx, np.float32), np.asarray(gy, np.float32)
    falling = np.array([[-0.25, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.25]], np.float32)
    rising = np.ascontiguousarray(falling[:, ::-1]) * -1.0
    g1, g2 = (
        np.asarray(cv2.filter2D(blurred, cv2.CV_32F, diagonal, borderType=border), np.float32)
        for diagonal in (falling, rising)
    )
    return g1 + g2, g1 - g2


def _filtered(grey: Float32Array, along_row: Float32Array, along_column: Float32Array) -> Float32Array:
    """(h, w) float32: the image filtered by a row and a column of coefficients, its border repeated outwards."""
    return np.asarray(
        cv2.sepFilter2D(grey, cv2.CV_32F, along_row, along_column, borderType=cv2.BORDER_REPLICATE), np.float32
    )


def detect(
    grey: Float32Array,
    detector: str = 'canny',
    sigma: float = 1.0,
    threshold: float = 1.0,
    noise: float | None = None,
    slopes: tuple[Float32Array, Float32Array] | None = None,
    usual_width: float | None = None,
) -> Edgels:
    """Edgels of a grey image.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    detector : str
        One of :data:`~stereo_recovery.params.DETECTORS`.
    sigma : float
        Pixels. Of the smoothing.
    threshold : float
        Grey levels per pixel. Least gradient magnitude.
    noise : float, optional
        Grey levels. Of the image; measured when it is not given.
    slopes : pair of (h, w) float32, optional
        The result of :func:`gradient` for this picture, where it is there already.
    usual_width : float, optional
        Pixels. Median width of the picture's edgels, where it is known already.

    Returns
    -------
    Edgels
        In raster order; none for images below 5 pixels.

    Raises
    ------
    ValueError
        The detector is unknown.

    References
    ----------
    Thesis 3.7. J. Canny, "A computational approach to edge detection", PAMI 8(6), 1986. The sigma of the position is
    that of the second derivative's noise over the slope of this derivative at a step: with s the smoothing, S^2 the
    step's variance after smoothing, n the noise and C the contrast, sigma_e = sqrt(3/8) (n/C) (S/s)^3.

    Examples
    --------
    >>> picture = np.full((9, 9), 50.0, np.float32)
    >>> picture[:, 4:] = 150.0
    >>> found = detect(picture)
    >>> found.position[:, 0].round(3).tolist(), found.direction.round(3).tolist()
    ([3.5, 3.5, 3.5, 3.5, 3.5], [0.0, 0.0, 0.0, 0.0, 0.0])
    """
    if detector not in DETECTORS:
        raise ValueError(f'detector: expected one of {", ".join(DETECTORS)}, got {detector!r}')
    if min(grey.shape) < SMALLEST_IMAGE:
        return Edgels.empty()
    noise = noise_level(grey) if noise is None else noise
    gx, gy = gradient(grey, detector, sigma) if slopes is None else slopes
    if detector == 'marr-hildreth':
        smooth, _ = gaussian_kernels(sigma)
        laplacian = cv2.Laplacian(_filtered(grey, smooth, smooth), cv2.CV_32F, borderType=cv2.BORDER_REPLICATE)
        u, v, gu, gv = edgel_kernels.zero_crossings(laplacian, gx, gy, np.float32(threshold))
        width = np.full(len(u), np.sqrt(sigma**2 + CAMERA_BLUR_VARIANCE))
    else:
        u, v, gu, gv, width = edgel_kernels.ridge_maxima(gx, gy, np.float32(threshold))
    magnitude = np.hypot(gu, gv)
    if usual_width is None:
        usual_width = float(np.median(width)) if len(width) else sigma
    total = max(usual_width, sigma)
    contrast = magnitude * np.sqrt(2.0 * np.pi) * total
    # A picture with one sample a pixel has staircase edges; every camera blurs more than that.
    floor = ALIASED_POSITION_FLOOR if usual_width**2 < sigma**2 + ALIASED_BLUR_VARIANCE else POSITION_FLOOR
    along = np.hypot(np.sqrt(POSITION_FACTOR) * noise / contrast * (total / sigma) ** 3, floor)
    across = gradient_noise(noise, sigma) / magnitude
    flanks = edgel_kernels.flanking_gradients(gx, gy, u, v, gu, gv, FLANK_DISTANCE * total)
    # The difference of the two flanks' gradients, without the part that noise explains.
    bias = np.sqrt(np.maximum((flanks[:, 0] - flanks[:, 1]) ** 2 - (FLANK_NOISE * across) ** 2, 0.0))
    found = Edgels(np.stack([u, v], axis=1), np.arctan2(gv, gu), magnitude, along, across, width, bias)
    # On a slope (the side of a cylinder) noise alone makes maxima; at an edge the gradient exceeds that on both flanks.
    return found.select(1.0 - flanks.max(axis=1) > PROMINENCE * across)
