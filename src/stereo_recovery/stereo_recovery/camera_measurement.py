"""What a camera does to a picture, from two pictures of one still scene: its noise and its blur."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py.numeric.typed import AnyArray, FloatArray

from .cameras.photon_transfer import PhotonTransfer, photon_transfer
from .detection.view import detect_view
from .edge_spread import EdgeSpread, edge_spread
from .params import RecoveryParams
from .settings import GREEN_PIXELS, MEASURED_SHIFT, MIDDLE_GREY, TOLD_APART


@dataclass(frozen=True, eq=False)
class CameraMeasurement:
    """Noise and blur of a camera. Grey levels are of 255, whatever the bits; None is what the pictures do not tell.

    Attributes
    ----------
    noise, noise_error : float or None
        Grey levels. Standard deviation of a pixel of the picture at mid grey, without rounding, and its standard error.
    gain : float or None
        Grey levels an electron, in linear light: shot noise has the variance gain times level.
    read_noise : float or None
        Grey levels. Standard deviation of a pixel that no light falls on, in linear light.
    psf, psf_error : float or None
        Pixels. Standard deviation of the blur of lens and focus, without the width of a pixel, and its standard error.
    edges : int
        From which psf was read off.
    shift : (2,) float64
        Pixels. How far the second picture is shifted, to the right and down.
    transfer : PhotonTransfer or None
    reasons : tuple of str
        Why something is None, or not to be relied on.
    """

    noise: float | None
    noise_error: float | None
    gain: float | None
    read_noise: float | None
    psf: float | None
    psf_error: float | None
    edges: int
    shift: FloatArray
    transfer: PhotonTransfer | None
    reasons: tuple[str, ...]

    @property
    def record(self) -> dict[str, object]:
        """What JSON says of it: the file that ``plan_rig --camera-noise`` reads."""
        return {
            'noise': self.noise,
            'noise_error': self.noise_error,
            'gain': self.gain,
            'read_noise': self.read_noise,
            'psf': self.psf,
            'psf_error': self.psf_error,
            'edges': self.edges,
            'shift': self.shift.tolist(),
            'reasons': list(self.reasons),
        }


def measure_camera(
    first: AnyArray,
    second: AnyArray,
    bits: int | None = None,
    black_level: float = 0.0,
    gamma: float = 1.0,
    bayer: str = '',
) -> CameraMeasurement:
    """Noise and blur of the camera that took two pictures of one still scene.

    Parameters
    ----------
    first, second : (h, w) or (h, w, 3) uint8 or uint16
        Grey, or BGR, of which the luma counts, as in :func:`.recover`.
    bits : int, optional
        Of the numbers of uint16 pictures; 16 by default.
    black_level : float
        Grey levels of a pixel that no light falls on. It tells read noise and gain apart: by default 0.
    gamma : float
        The curve of the picture: light is the numbers to this power. 1 for a linear one; sRGB is nearly 2.2.
    bayer : str
        The pictures are mosaics: 'rggb', 'bggr', 'gbrg' or 'grbg'. Green pixels count.

    Returns
    -------
    CameraMeasurement

    Raises
    ------
    ValueError
        The pictures or arguments do not go together; the message begins with the argument's name.
    """
    if first.shape != second.shape or first.dtype != second.dtype:
        raise ValueError(
            f'second: {second.shape} {second.dtype}, expected {first.shape} {first.dtype}, as the first picture'
        )
    if bayer and (bayer not in GREEN_PIXELS or first.ndim != 2):
        raise ValueError(f'bayer: expected one of {", ".join(GREEN_PIXELS)} and grey pictures, got {bayer!r}')
    if not 0.1 <= gamma <= 10.0:
        raise ValueError(f'gamma: expected 0.1 to 10, got {gamma:g}')
    if not 0.0 <= black_level < MIDDLE_GREY:
        raise ValueError(f'black_level: expected grey levels from 0 to {MIDDLE_GREY:g}, got {black_level:g}')
    white = _white(first, bits)
    pictures = [_grey(picture, white) for picture in (first, second)]
    if np.array_equal(pictures[0], pictures[1]):
        raise ValueError('second: the same picture as the first; take two, one after the other')
    step = 255.0 / white
    # Rounding of three channels is less in their luma.
    rounding = step / np.sqrt(12.0) * (1.0 if first.ndim == 2 else 0.669)
    if bayer:
        greens = [np.concatenate([p[v::2, u::2] for v, u in GREEN_PIXELS[bayer]]) for p in pictures]
    else:
        greens = pictures
    transfer = photon_transfer(greens[0], greens[1], rounding, gamma)
    spread = _spread(0.5 * (pictures[0] + pictures[1]), transfer, gamma, bayer)
    return _measurement(transfer, spread, _shift(greens if not bayer else pictures), black_level, gamma)


def _white(picture: AnyArray, bits: int | None) -> int:
    """The largest number."""
    if picture.dtype == np.uint8 and bits in (None, 8):
        return 255
    if picture.dtype != np.uint16 or not 8 < (bits or 16) <= 16:
        raise ValueError(
            f'bits: expected 8 in pictures of uint8, 9 to 16 in those of uint16, got {bits} in {picture.dtype}'
        )
    white = int(2 ** (bits or 16) - 1)
    if int(picture.max()) > white:
        raise ValueError(f'bits: {bits} end at {white}, but the picture has {picture.max()}')
    return white


def _grey(picture: AnyArray, white: int) -> FloatArray:
    """(h, w) float64 grey levels of 255."""
    grey = picture if picture.ndim == 2 else picture[..., :3] @ np.array([0.114, 0.587, 0.299])
    return np.asarray(grey, dtype=np.float64) * (255.0 / white)


def _spread(mean: FloatArray, transfer: PhotonTransfer | None, gamma: float, bayer: str) -> EdgeSpread | None:
    """The blur of the mean of both pictures."""
    params = RecoveryParams()
    shown = np.asarray(mean, np.float32)
    seen = (mean > 0.5) & (mean < 254.5) if mean.max() > 254.5 or mean.min() < 0.5 else np.ones(mean.shape, bool)
    if bayer:
        green = np.zeros(mean.shape, bool)
        for v, u in GREEN_PIXELS[bayer]:
            green[v::2, u::2] = True
        seen &= green
        # Edges are looked for where each pixel is the mean of its green neighbours, and measured in what was seen.
        kernel = np.array([[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]])
        total, weight = (cv2.filter2D(np.where(green, x, 0.0), -1, kernel) for x in (mean, np.ones_like(mean)))
        shown = np.asarray(total / weight, np.float32)
    view = detect_view(shown, params.detector, params.sigma, params.low, params.high)
    light = 255.0 * (mean / 255.0) ** gamma
    variance = np.zeros(mean.shape)
    if transfer is not None:
        # Of a mean of two.
        variance = 0.5 * (transfer.coefficients[0] + transfer.coefficients[1] * light)
    return edge_spread(light, np.sqrt(np.maximum(variance, 1.0 / 24.0)), view.segments, seen)


def _shift(pictures: list[FloatArray]) -> FloatArray:
    """How far the second picture is shifted, pixels: least squares of the difference on the slopes."""
    smooth = [cv2.GaussianBlur(picture, (0, 0), 1.5) for picture in pictures]
    down, across = np.gradient(0.5 * (smooth[0] + smooth[1]))
    slopes = np.stack([across.ravel(), down.ravel()], axis=1)
    return np.asarray(np.linalg.lstsq(slopes, (smooth[0] - smooth[1]).ravel(), rcond=None)[0])


def _measurement(
    transfer: PhotonTransfer | None, spread: EdgeSpread | None, shift: FloatArray, black_level: float, gamma: float
) -> CameraMeasurement:
    """All that was found, and why something was not."""
    reasons = []
    noise, noise_error, gain, read_noise = None, None, None, None
    if transfer is None:
        reasons.append('noise: no grey level has enough even and unclipped pixels; show surfaces of several shades')
    else:
        share = MIDDLE_GREY / 255.0
        variance, error = transfer.variance_at(255.0 * share**gamma)
        # From light back to numbers, by the slope of the curve at mid grey.
        steepness = gamma * share ** (gamma - 1.0)
        told = len(transfer.level) > 1 and error < TOLD_APART * abs(variance)
        if told:
            gain = max(float(transfer.coefficients[1]), 0.0)
            dark, _ = transfer.variance_at(255.0 * (black_level / 255.0) ** gamma)
            read_noise = float(np.sqrt(max(dark, 0.0)))
            if dark < 0.0:
                reasons.append('read_noise: the variance vanishes above black; give the black level of the camera')
        else:
            k = int(np.argmin(transfer.error))
            variance, error = float(transfer.variance[k]), float(transfer.error[k])
            steepness = gamma * (transfer.level[k] / 255.0) ** ((gamma - 1.0) / gamma)
            reasons.append(
                f'gain, read_noise: all that is even is about {transfer.level[k]:.0f} of 255; show several shades. '
                'noise is that of this one'
            )
        noise = float(np.sqrt(max(variance, 0.0)) / steepness)
        noise_error = float(0.5 * error / np.sqrt(max(variance, error)) / steepness)
    if spread is None:
        reasons.append('psf: too few strong straight edges with even sides; show some, in focus')
    if np.hypot(*shift) > MEASURED_SHIFT:
        reasons.append(
            f'the camera or the scene has moved by {np.hypot(*shift):.2f} pixels between the pictures; fix both'
        )
    return CameraMeasurement(
        noise,
        noise_error,
        gain,
        read_noise,
        None if spread is None else spread.psf,
        None if spread is None else spread.error,
        0 if spread is None else len(spread.each),
        shift,
        transfer,
        tuple(reasons),
    )
