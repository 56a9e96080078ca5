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
from .edgel_kernels import Maxima
from .noise import NoiseMap, measured_response, white_response
from .settings import (
    CAMERA_BLUR_VARIANCE,
    FLANK_DISTANCE,
    KERNEL_NORM,
    KERNEL_RADIUS,
    LOGARITHM_FLOOR,
    PROMINENCE,
    QUANTISATION_NOISE,
    SIXTEEN_BIT_SCALE,
    SMALLEST_IMAGE,
    WEAKEST,
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
    prominence : (n,) float64
        By how much the gradient exceeds that beside the edge, in sigma of its noise.
    """

    position: FloatArray
    direction: FloatArray
    magnitude: FloatArray
    sigma_position: FloatArray
    sigma_direction: FloatArray
    width: FloatArray
    bias: FloatArray
    prominence: FloatArray

    @classmethod
    def empty(cls) -> Edgels:
        """No edgels."""
        return cls(np.zeros((0, 2)), *(np.zeros(0) for _ in range(7)))

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

    def magnified(self, factor: float, sigma: float) -> Edgels:
        """Those of a reduced image as edgels of the image itself.

        Parameters
        ----------
        factor : float
            Pixels of the image a pixel of the reduced one.
        sigma : float
            Pixels. Smoothing, the same number in both images: widths are made what they would be with it.

        Returns
        -------
        Edgels
            Their errors are those of as many neighbours as agree at the finer scale.
        """
        # What a pixel of the reduced image averages blurs too.
        smoothing = (factor * sigma) ** 2 + (factor**2 - 1.0) / 12.0
        blur = np.maximum((factor * self.width) ** 2 - smoothing, 0.0)
        return Edgels(
            factor * self.position + 0.5 * (factor - 1.0),
            self.direction,
            self.magnitude / factor,
            np.sqrt(factor) * factor * self.sigma_position,
            self.sigma_direction,
            np.sqrt(sigma**2 + blur),
            self.bias,
            self.prominence,
        )

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


@dataclass(frozen=True, eq=False)
class Slopes:
    """The derivatives of a smoothed image.

    Attributes
    ----------
    gx, gy : (h, w) float32, grey levels per pixel
        Along rows and columns.
    noise : NoiseMap
        Of either.
    """

    gx: Float32Array
    gy: Float32Array
    noise: NoiseMap


def slopes_of(grey: Float32Array, detector: str, sigma: float, noise: NoiseMap | float | None = None) -> Slopes:
    """Derivatives of an image, with their noise; arguments as of :func:`maxima`."""
    gx, gy = gradient(grey, detector, sigma)
    if noise is None:
        noise = measured_response(gx, gy, sigma)
    elif not isinstance(noise, NoiseMap):
        noise = NoiseMap.uniform(white_response(noise, sigma), (grey.shape[0], grey.shape[1]))
    return Slopes(gx, gy, noise)


# Where it was looked for before it had a module of its own.
gradient_noise = white_response


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


def described(found: Maxima, index: AnyArray, sigma: float) -> Edgels:
    """Some maxima as edgels, with their uncertainty.

    Parameters
    ----------
    found : Maxima
    index : (m,) int
        Which, in their order.
    sigma : float
        Pixels. Of the smoothing.

    Returns
    -------
    Edgels
    """
    return Edgels(*edgel_kernels.described(found, index, sigma))


def maxima(
    grey: Float32Array,
    detector: str = 'canny',
    sigma: float = 1.0,
    threshold: float = 1.0,
    noise: NoiseMap | float | Slopes | None = None,
) -> Maxima:
    """Where the gradient is largest across its own direction and stands out of the noise.

    Parameters
    ----------
    grey : (h, w) float32, grey levels
    detector : str
        One of :data:`~stereo_recovery.params.DETECTORS`.
    sigma : float
        Pixels. Of the smoothing.
    threshold : float
        Grey levels per pixel. Least gradient magnitude; where the picture is noisy, WEAKEST sigma of the noise.
    noise : NoiseMap, float or Slopes, optional
        Of the derivatives; or grey levels, of the image, differing from pixel to pixel; or with the derivatives
        themselves, which are not taken again then. Measured when it is not given.

    Returns
    -------
    Maxima
        In raster order; none for images below 5 pixels.

    Raises
    ------
    ValueError
        The detector is unknown.
    """
    if detector not in DETECTORS:
        raise ValueError(f'detector: expected one of {", ".join(DETECTORS)}, got {detector!r}')
    if min(grey.shape) < SMALLEST_IMAGE:
        pairs, numbers = np.zeros((0, 2)), np.zeros(0)
        return Maxima(pairs, pairs, numbers, numbers, numbers, pairs, numbers)
    slopes = noise if isinstance(noise, Slopes) else slopes_of(grey, detector, sigma, noise)
    gx, gy, noise = slopes.gx, slopes.gy, slopes.noise
    if detector == 'marr-hildreth':
        smooth, _ = gaussian_kernels(sigma)
        laplacian = cv2.Laplacian(_filtered(grey, smooth, smooth), cv2.CV_32F, borderType=cv2.BORDER_REPLICATE)
        position, slope = edgel_kernels.zero_crossings(laplacian, gx, gy, np.float32(threshold))
        magnitude, response = np.hypot(slope[:, 0], slope[:, 1]), noise.at(position)
        width = np.full(len(position), np.sqrt(sigma**2 + CAMERA_BLUR_VARIANCE))
    else:
        least = np.maximum(np.float32(threshold), WEAKEST * noise.sigma)
        with np.errstate(over='ignore'):
            squared = gx * gx
            squared += gy * gy
        logarithm = np.asarray(cv2.log(squared + LOGARITHM_FLOOR * least.min() ** 2), np.float32)
        position, slope, magnitude, response, width = edgel_kernels.ridge_maxima(
            (gx, gy), squared, logarithm, least, noise.sigma, noise.tile
        )
    distance = FLANK_DISTANCE * edgel_kernels.usual_width(width, response, magnitude, sigma)
    flanks, saddle = edgel_kernels.flanking_gradients(gx, gy, position, slope, distance)
    return Maxima(position, slope, magnitude, response, width, flanks, saddle)


def detect(
    grey: Float32Array,
    detector: str = 'canny',
    sigma: float = 1.0,
    threshold: float = 1.0,
    noise: NoiseMap | float | None = None,
) -> Edgels:
    """Edgels of a grey image: those maxima of the gradient that exceed both flanks.

    Parameters
    ----------
    grey, detector, sigma, threshold, noise
        See :func:`maxima`.

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
    found = maxima(grey, detector, sigma, threshold, noise)
    return described(found, np.flatnonzero(found.prominence > PROMINENCE).astype(np.int32), sigma)
