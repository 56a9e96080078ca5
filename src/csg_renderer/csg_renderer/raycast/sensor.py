"""What a real camera does to a perfect image: a lens that blurs and vignettes, and a chip that counts electrons.

The order is that of the light. The lens spreads it (``psf_sigma``) and darkens the corners (``vignetting``); each pixel
of a mosaic sees one colour (``bayer``); a pixel counts electrons (``exposure``, ``full_well``), whose number is that of
Poisson's law, and reading them adds a normal error (``read_noise``); what is amplified (``gain``) gets ``noise_sigma``
and ``black_level``; a curve (``gamma`` or ``srgb``) is applied before the numbers are rounded to ``bits``.

References
----------
EMVA Standard 1288, release 4.0 linear, section 2 (the linear camera model and the photon transfer curve);
IEC 61966-2-1 (sRGB).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from msgs_py.numeric.typed import AnyArray, ByteArray, Float32Array

from .frame import Frame
from .settings import BAYER_CHANNELS, LUMA, SENSOR_RANGES, SRGB_OFFSET, SRGB_POWER, SRGB_SLOPE, SRGB_TOE, WHITE


@dataclass(frozen=True)
class SensorModel:
    """A lens and a chip; by default neither has a fault, and the picture is only rounded.

    Grey levels are on the scale 0..255, whatever the number of bits.

    Parameters
    ----------
    psf_sigma : float
        Standard deviation of the Gaussian point spread function, pixels, >= 0. Here it blurs pixels; to blur light, as
        lenses do, render with ``psf`` (see :class:`RenderOptions`), which :meth:`picture` knows of.
    noise_sigma : float
        Standard deviation of additive Gaussian noise, grey levels, >= 0: what does not depend on the light, after the
        gain.
    seed : int or sequence of int
        >= 0; the same seed gives the same noise.
    vignetting : float
        The share of the light that is lost in the corners, 0..0.99. It falls as cos^4 of an angle whose tangent grows
        with the distance from the middle of the picture.
    exposure : float
        What the light is multiplied by before it is counted, > 0.
    full_well : float
        Electrons that make white (255) at gain 1, and the most that a pixel holds; 0: so many that their number is
        certain, and there is no shot noise.
    read_noise : float
        Standard deviation of what reading a pixel adds, electrons, >= 0; needs a ``full_well``.
    gain : float
        Amplification of the electrons, > 0.
    black_level : float
        What is added to every pixel, grey levels, 0..254.
    gamma : float
        Numbers are the light to the power of 1 / gamma, 0.1..10; 1 for a linear picture.
    srgb : bool
        Numbers are those of sRGB; needs ``gamma`` 1.
    bits : int
        Of a number, 8..16. With 8 pictures are of uint8, with more of uint16, white being 2^bits - 1.
    bayer : str
        'rggb', 'bggr', 'gbrg' or 'grbg': the colours of the pixels of the upper left 2 x 2, row by row, as sensor_msgs
        names them. Empty: every pixel sees all colours.

    Raises
    ------
    ValueError
        A field is out of its range; the message begins with its name.

    Examples
    --------
    >>> SensorModel().apply(np.array([[1.4, 300.0]])).tolist()
    [[1, 255]]
    >>> SensorModel(bits=12, black_level=16.0).apply(np.array([[0.0, 127.5]])).tolist()
    [[257, 2304]]
    """

    psf_sigma: float = 0.0
    noise_sigma: float = 0.0
    seed: int | Sequence[int] = 0
    vignetting: float = 0.0
    exposure: float = 1.0
    full_well: float = 0.0
    read_noise: float = 0.0
    gain: float = 1.0
    black_level: float = 0.0
    gamma: float = 1.0
    srgb: bool = False
    bits: int = 8
    bayer: str = ''

    def __post_init__(self) -> None:
        for name in ('psf_sigma', 'noise_sigma', 'full_well', 'read_noise'):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise ValueError(f'{name}: expected a finite number >= 0, got {value}')
        if np.min(self.seed) < 0:
            raise ValueError(f'seed: expected whole numbers >= 0, got {self.seed}')
        for name, (low, high) in SENSOR_RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f'{name}: expected {low:g} to {high:g}, got {value}')
        if int(self.bits) != self.bits:
            raise ValueError(f'bits: expected a whole number, got {self.bits}')
        if self.read_noise > 0.0 and self.full_well == 0.0:
            raise ValueError('read_noise: is in electrons, so it needs a full_well > 0 that says how many make white')
        if self.srgb and self.gamma != 1.0:
            raise ValueError(f'gamma: expected 1 beside srgb, which is a curve of its own, got {self.gamma}')
        if self.bayer and self.bayer not in BAYER_CHANNELS:
            raise ValueError(f'bayer: expected one of {", ".join(BAYER_CHANNELS)}, or nothing, got {self.bayer!r}')

    @property
    def white(self) -> int:
        """The largest number of a pixel, 2^bits - 1."""
        return int(2**self.bits - 1)

    @property
    def fine(self) -> bool:
        """Whether the picture shows more than the bytes of a rendered image tell, so that its radiance is needed."""
        return self != SensorModel(self.psf_sigma, self.noise_sigma, self.seed, bayer=self.bayer)

    def picture(self, frame: Frame, monochrome: bool = False) -> np.ndarray:
        """The picture of a rendered frame, from its radiance where it has one, with the blur that it has not yet.

        Parameters
        ----------
        frame : Frame
        monochrome : bool
            Whether the chip sees luma and no colours.

        Returns
        -------
        (h, w) or (h, w, 3) array of uint8 or uint16
            As :meth:`apply`.
        """
        light = frame.image if frame.radiance is None else WHITE * frame.radiance
        left = replace(self, psf_sigma=float(np.sqrt(max(self.psf_sigma**2 - frame.psf**2, 0.0))))
        return left.apply(grey(light) if monochrome else light)

    def apply(self, image: np.ndarray) -> np.ndarray:
        """An image as the sensor gives it: blurred, then with noise, then rounded and clipped.

        Parameters
        ----------
        image : (h, w) or (h, w, channels) array, uint8 or float
            The light, linear, on the scale 0..255. A mosaic needs three channels: red, green and blue.

        Returns
        -------
        uint8 or uint16 array of the same shape, (h, w) of a mosaic
            Noise is independent in every pixel and channel.

        Raises
        ------
        ValueError
            A mosaic is made of an image without colours.
        """
        values: Float32Array = np.asarray(image, dtype=np.float32)
        if self.psf_sigma > 0.0:
            values = np.asarray(cv2.GaussianBlur(values, (0, 0), self.psf_sigma, borderType=cv2.BORDER_REPLICATE))
        if self.bayer:
            values = mosaic(values, self.bayer)
        if self.vignetting > 0.0:
            light = illumination(values.shape[1], values.shape[0], self.vignetting)
            values = values * (light if values.ndim == 2 else light[..., None])
        return self._rounded(self._curve(self._amplified(values)))

    def _amplified(self, values: Float32Array) -> Float32Array:
        """Grey levels of light as grey levels of a linear chip, with its noise."""
        random = np.random.default_rng(self.seed)
        if self.exposure != 1.0:
            values = values * np.float32(self.exposure)
        if self.full_well > 0.0:
            per_level = self.full_well / WHITE
            electrons = random.poisson(np.maximum(values, 0.0) * per_level).clip(0.0, self.full_well)
            if self.read_noise > 0.0:
                electrons = electrons + self.read_noise * random.standard_normal(values.shape, dtype=np.float32)
            values = (electrons / per_level).astype(np.float32)
        if self.gain != 1.0:
            values = values * np.float32(self.gain)
        if self.noise_sigma > 0.0:
            values = values + np.float32(self.noise_sigma) * random.standard_normal(values.shape, dtype=np.float32)
        return values + np.float32(self.black_level) if self.black_level > 0.0 else values

    def _curve(self, values: Float32Array) -> Float32Array:
        """Grey levels of a linear chip as those of the picture."""
        if self.gamma == 1.0 and not self.srgb:
            return values
        share = values.clip(0.0, WHITE) / WHITE
        if self.srgb:
            bent = (1.0 + SRGB_OFFSET) * share ** (1.0 / SRGB_POWER) - SRGB_OFFSET
            return np.asarray(WHITE * np.where(share <= SRGB_TOE, SRGB_SLOPE * share, bent), dtype=np.float32)
        return np.asarray(WHITE * share ** (1.0 / self.gamma), dtype=np.float32)

    def _rounded(self, values: Float32Array) -> AnyArray:
        """Grey levels as the numbers of the picture."""
        if self.bits == 8:
            pixels: ByteArray = np.rint(values).clip(0.0, WHITE).astype(np.uint8)
            return pixels
        numbers: AnyArray = np.rint(values * np.float32(self.white / WHITE)).clip(0, self.white).astype(np.uint16)
        return numbers


def mosaic(image: np.ndarray, pattern: str) -> np.ndarray:
    """What a chip behind a colour mosaic sees.

    Parameters
    ----------
    image : (h, w, 3) array
        RGB.
    pattern : str
        One of BAYER_CHANNELS.

    Returns
    -------
    (h, w) array of the same element type

    Raises
    ------
    ValueError
        The image has no colours.

    Examples
    --------
    >>> mosaic(np.arange(12).reshape(2, 2, 3), 'rggb').tolist()
    [[0, 4], [7, 11]]
    """
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f'bayer: a mosaic is made of an image with red, green and blue, got shape {image.shape}')
    out: AnyArray = np.empty(image.shape[:2], dtype=image.dtype)
    for place, channel in enumerate(BAYER_CHANNELS[pattern]):
        down, across = divmod(place, 2)
        out[down::2, across::2] = image[down::2, across::2, channel]
    return out


def illumination(width: int, height: int, lost: float) -> Float32Array:
    """How much of the light a lens that vignettes lets through.

    Parameters
    ----------
    width, height : int
        Pixels.
    lost : float
        The share that is lost in the corners, the centres of the outermost pixels.

    Returns
    -------
    (height, width) float32
        cos^4 of the angle whose tangent is proportional to the distance from the middle, 1 in the middle.

    Examples
    --------
    >>> (100.0 * illumination(3, 3, 0.75)).round().astype(int).tolist()
    [[25, 44, 25], [44, 100, 44], [25, 44, 25]]
    """
    v, u = np.ogrid[0:height, 0:width]
    x, y = u - (width - 1) / 2, v - (height - 1) / 2
    corner = max(((width - 1) / 2) ** 2 + ((height - 1) / 2) ** 2, 1.0)
    # cos^4 = (1 + tan^2)^-2, and 1 - lost in the corner.
    steepest = (1.0 - lost) ** -0.5 - 1.0
    return np.asarray((1.0 + steepest * (x * x + y * y) / corner) ** -2.0, dtype=np.float32)


def grey(image: np.ndarray) -> np.ndarray:
    """Luma of a picture.

    Parameters
    ----------
    image : (h, w, 3) array of uint8 or float
        RGB.

    Returns
    -------
    (h, w) float64
        0..255, not rounded (ITU-R BT.601).
    """
    return image @ LUMA
