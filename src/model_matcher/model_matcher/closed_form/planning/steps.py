"""What a step of grey, blurred and noisy, tells of its place: Fisher information, closed form.

A step of c grey levels, blurred by a Gaussian of s pixels, in noise of sigma grey levels, has the Fisher information
c^2 / (2 sqrt(pi) s sigma^2) on its displacement along its normal, for every pixel of its length (the integral of the
squared derivative of the profile, over the variance of a pixel). To estimate the grey levels beside it from a window of
w pixels across costs about the share 2 sqrt(pi) s / w of that; the height of the step costs nothing (its derivative is
odd about the step, that of a displacement even).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import AnyArray, FloatArray, Int32Array

from ...geometry.settings import UNIFORM_VARIANCE
from ...image_pose.settings import CONTRAST, FLANK, LEAST_SLOPE, ON_EDGE, WALKS
from .settings import BESIDE


class Profiles(NamedTuple):
    """What stands in the profiles across steps.

    Attributes
    ----------
    flank : (n,) int32
        Pixels to either side that are looked at; 0 where there is no room.
    limb : (n,) float64
        1 or -1: the side on which a curved surface turns away from the eye; 0 where none does.
    beside : (n, m) float64
        Pixels to further steps; not a number where there are fewer.
    stretch : (n,) float64
        Pixels along the step, over which a profile is the mean.
    """

    flank: Int32Array
    limb: FloatArray
    beside: FloatArray
    stretch: FloatArray


def sensor_blur(psf: float) -> float:
    """What a sensor makes of a step: the blur of its lens and its pixels' own width.

    Parameters
    ----------
    psf : float
        Pixels, standard deviation of the point spread function of the lens.

    Returns
    -------
    float
        Pixels, standard deviation.

    Examples
    --------
    >>> round(sensor_blur(0.0), 4), round(sensor_blur(1.0), 4)
    (0.2887, 1.0408)
    """
    return float(np.sqrt(psf * psf + UNIFORM_VARIANCE))


def edge_information(contrast: FloatArray | float, blur: float, noise: FloatArray | float) -> FloatArray:
    """Fisher information on the normal displacement of steps.

    Parameters
    ----------
    contrast : (n,) float64 or float
        Grey levels.
    blur : float
        Pixels, standard deviation of all of it, see :func:`sensor_blur`.
    noise : (n,) float64 or float
        Grey levels, standard deviation.

    Returns
    -------
    (n,) float64
        One over square pixels, for each pixel of their length.

    Examples
    --------
    >>> float(edge_information(2.0, 0.5, 1.0).round(4))
    2.2568
    """
    return np.asarray(np.square(contrast) / (2.0 * np.sqrt(np.pi) * blur * np.square(noise)))


def place_variances(
    contrast: FloatArray, profiles: Profiles, blur: float, noise: FloatArray | float, walk: float = WALKS[0]
) -> FloatArray:
    """Variance that noise gives the places of steps as they are fitted to their profiles.

    The fit is that of :func:`model_matcher.image_pose.profiles.fit_profiles`: the level before the step, its place and
    height, the slope of shade beside it, the shading of a curved surface that turns away from the eye, and places and
    heights of further steps beside are estimated together, while a walk of the levels is allowed for, which costs some
    of what noise alone would leave.
    Of the steps beside, the height is taken for the step's own.

    Parameters
    ----------
    contrast : (n,) float64
        Grey levels.
    profiles : Profiles
    blur : float
        Pixels.
    noise : (n,) float64 or float
        Grey levels of a pixel.
    walk : float
        Grey levels for a root of a pixel.

    Returns
    -------
    (n,) float64
        Square pixels; infinite where there is nothing to measure.

    Examples
    --------
    A step that stands alone loses some to the estimate of its levels, and to what it allows for shade:

    >>> alone = Profiles(np.array([4]), np.zeros(1), np.full((1, 2), np.nan), np.array([4.0]))
    >>> variance = place_variances(np.array([50.0]), alone, 0.6, 2.0)
    >>> (1.0 / variance / (4.0 * edge_information(50.0, 0.6, 2.0))).round(2).tolist()
    [0.77]
    """
    n, reach = len(contrast), np.arange(-FLANK, FLANK + 1.0)
    height = np.abs(contrast)[:, None]
    columns, believed = [], []
    for offset in (np.zeros(n), *profiles.beside.T):
        # A quarter of a pixel beside the middle of one, which tells as much as all places do on average.
        t = (reach - 0.25 - np.nan_to_num(offset)[:, None]) / blur
        there = np.isfinite(offset)[:, None]
        columns += [np.where(there, -height * np.exp(-0.5 * t * t) / (np.sqrt(2.0 * np.pi) * blur), 0.0)]
        columns += [np.where(there, ndtr(t), 0.0)]
        believed += [ON_EDGE, CONTRAST]
    columns += [np.sqrt(np.maximum(profiles.limb[:, None] * reach, 0.0)), np.abs(reach - 0.25) + 0.0 * height]
    believed += [CONTRAST, LEAST_SLOPE]
    rows = np.diff(np.stack(columns, axis=2), axis=1)
    rows *= (np.abs(reach[:-1] + 0.5) < profiles.flank[:, None])[..., None]
    # Differences of neighbours: the level before all falls out, and a walk leaves them independent.
    pixel = noise**2 / np.maximum(profiles.stretch, 1.0)
    size = rows.shape[1]
    of_noise = pixel[:, None, None] * (2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1))
    inside = (rows != 0.0).any(axis=2)
    apart = np.where(inside[:, :, None] & inside[:, None], of_noise, 0.0)
    allowed = apart + np.eye(size) * np.where(inside, walk**2, 1.0)[:, :, None]
    good = (profiles.flank > 0) & (np.abs(contrast) > BOUND_SIGMA * np.sqrt(pixel))
    out = np.full(n, np.inf)
    if good.any():
        rows, apart = rows[good], apart[good]
        weighed = np.linalg.solve(allowed[good], rows)
        normal = np.swapaxes(rows, 1, 2) @ weighed + np.diag(1.0 / np.square(believed))
        gain = np.linalg.solve(normal, np.swapaxes(weighed, 1, 2))[:, :1]
        out[good] = (gain @ apart @ np.swapaxes(gain, 1, 2))[:, 0, 0]
    return out


def flanking_levels(image: AnyArray, pixels: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Grey levels on both sides of places, in a picture of point samples.

    Parameters
    ----------
    image : (h, w) array
        Neither blurred nor noisy.
    pixels, normals : (n, 2) float64

    Returns
    -------
    ahead, behind : (n,) float64
        Along the normal and against it; the same where either is beyond the picture's border.
    """
    height, width = image.shape
    sides = []
    inside = np.ones(len(pixels), bool)
    for side in (BESIDE, -BESIDE):
        at = np.round(pixels + side * normals).astype(int)
        inside &= ((at >= 0) & (at < [width, height])).all(axis=1)
        column, row = np.clip(at, 0, [width - 1, height - 1]).T
        sides.append(np.asarray(image[row, column], float))
    return np.where(inside, sides[0], sides[1]), sides[1]


def step_heights(image: AnyArray, pixels: FloatArray, normals: FloatArray) -> FloatArray:
    """Grey levels on one side of each place less those on the other; 0 at the picture's border.

    Parameters
    ----------
    image, pixels, normals
        As of :func:`flanking_levels`.

    Returns
    -------
    (n,) float64
    """
    ahead, behind = flanking_levels(image, pixels, normals)
    return ahead - behind
