"""Raw pictures: the rays of a camera whose lens distorts, and the mean light of its pixels.

What is true of a pixel (depth, ids, normals) is that of the one ray through its centre, by the inverse of the lens.
Its colour is the mean over its area. Rays in straight rows cost a hundredth of single ones, so that the ideal image
plane is sampled in rows, at least as finely as is asked for, and the lens says where in the raw picture the cell of
each sample lies: no picture is warped. Where that would take many more samples than pixels need (a fisheye that sees
nearly sideways), the samples are rays of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from msgs_py import LensDistortion, PinholeCamera
from msgs_py.numeric.typed import FloatArray

from .kernels.raw_image import add_light
from .kernels.records import Lens, RawRays
from .settings import BAND_RAYS, CROW_OFFSETS, CROW_WEIGHTS, GOLDEN, MOST_IDEAL_SAMPLES, MOST_RAW_CAMERAS, STRIP_SAMPLES
from .stop import Stop


class RawView(NamedTuple):
    """What a raw camera sees.

    Attributes
    ----------
    rays : RawRays
    ideal : PinholeCamera
        An ideal camera of as many pixels that sees all its rays.
    extent : (2, 2) float64
        Least and largest (x, y) of its rays in the image plane; NaN where it has none.
    step : float
        The least distance of neighbouring rays in the image plane.
    """

    rays: RawRays
    ideal: PinholeCamera
    extent: FloatArray
    step: float


def enclosing_camera(extent: FloatArray, width: int, height: int) -> PinholeCamera:
    """An ideal camera of a size, the centres of whose outermost pixels lie on the outermost rays.

    Parameters
    ----------
    extent : (2, 2) array of float64
        Least and largest (x, y) of the image plane.
    width, height : int
        Pixels.
    """
    focal = np.maximum([width - 1, height - 1], 1) / np.maximum(extent[1] - extent[0], np.finfo(np.float64).tiny)
    centre = -extent[0] * focal
    return PinholeCamera(width, height, focal[0], focal[1], centre[0], centre[1])


@lru_cache(maxsize=MOST_RAW_CAMERAS)
def _made(camera: PinholeCamera, lens: LensDistortion) -> list[RawView]:
    """What :func:`raw_view` gives, once it has been computed; it can be stopped before."""
    return []


def raw_view(camera: PinholeCamera, lens: LensDistortion, stop: Stop | None = None) -> RawView:
    """The rays of all raw pixels, and of a border of one pixel about them.

    Parameters
    ----------
    camera : PinholeCamera
        Its calibration matrix is that of the raw camera.
    lens : LensDistortion
    stop : Stop, optional
        With it another thread can end the computation.

    Returns
    -------
    RawView

    Raises
    ------
    RenderStopped
    """
    made = _made(camera, lens)
    if not made:
        made.append(_computed(camera, lens, stop or Stop()))
    return made[0]


def _computed(camera: PinholeCamera, lens: LensDistortion, stop: Stop) -> RawView:
    """Band by band, because the largest pictures have millions of rays."""
    columns = np.arange(-1, camera.width + 1)
    rays: FloatArray = np.empty((camera.height + 2, camera.width + 2, 2))
    extent: FloatArray = np.array([[np.inf, np.inf], [-np.inf, -np.inf]])
    step = np.inf
    rows = max(BAND_RAYS // len(columns), 1)
    for first in range(0, len(rays), rows):
        stop.check()
        v, u = np.meshgrid(np.arange(first, min(first + rows, len(rays))) - 1, columns, indexing='ij')
        rays[first : first + rows] = lens.rays(camera, np.stack([u, v], axis=-1))[..., :2]
        # With the last row of the band before.
        band = rays[max(first - 1, 0) : first + rows]
        extent[0] = np.fmin(extent[0], np.fmin.reduce(band, axis=(0, 1)))
        extent[1] = np.fmax(extent[1], np.fmax.reduce(band, axis=(0, 1)))
        for axis in (0, 1):
            apart = np.diff(band, axis=axis)
            step = np.fmin(step, np.fmin.reduce(np.hypot(apart[..., 0], apart[..., 1]), axis=None, initial=np.inf))
    if np.isfinite(extent).all():
        ideal = enclosing_camera(extent, camera.width, camera.height)
    else:
        ideal = camera
    return RawView(
        RawRays(rays, ideal.fx, ideal.fy, ideal.cx, ideal.cy, ideal.width, ideal.height), ideal, extent, float(step)
    )


def box_samples(n: int) -> FloatArray:
    """N x n samples of a pixel: how far right and below its centre, pixels, and the weight of each, (n * n, 3).

    In each cell of a grid there is one, and in each of n x n columns and rows (N-rooks: Chiu, Shirley and Wang 1994,
    multi-jittered sampling), in the same order in all cells: an edge along the rows or columns passes one sample after
    another, not n at once, and the pixel tells it to 1 / n^2 of its width. The order is that of multiples of the golden
    ratio, so that no other direction is as bad as those along a grid are.
    """
    row, column = np.divmod(np.arange(n * n), max(n, 1))
    rank = np.argsort(np.argsort(np.arange(n) * GOLDEN % 1.0))
    right, below = ((a + (rank[b] + 0.5) / n) / n - 0.5 for a, b in ((column, row), (row, column)))
    return np.stack([right, below, np.full(n * n, 1.0 / max(n * n, 1))], axis=1)


def crow_samples() -> FloatArray:
    """The nine samples of a pixel where faces meet, (9, 3), as :func:`box_samples`."""
    down, across = np.meshgrid(CROW_OFFSETS, CROW_OFFSETS, indexing='ij')
    return np.stack([across.ravel(), down.ravel(), CROW_WEIGHTS.ravel()], axis=1)


# -- rows of the ideal image plane ------------------------------------------------------------------------------------


@lru_cache(maxsize=MOST_RAW_CAMERAS)
def sampling_camera(camera: PinholeCamera, lens: LensDistortion, n: int) -> PinholeCamera | None:
    """The ideal camera whose pixels are the samples of a raw picture, n and more along each side of every pixel.

    Parameters
    ----------
    camera : PinholeCamera
        Its calibration matrix is that of the raw camera.
    lens : LensDistortion
    n : int

    Returns
    -------
    PinholeCamera or None
        None where it would have more than MOST_IDEAL_SAMPLES times the samples that the pixels need.
    """
    view = raw_view(camera, lens)
    if not np.isfinite(view.step):
        return None
    columns, rows = (np.ceil((view.extent[1] - view.extent[0]) * n / view.step) + 1.0).tolist()
    if columns * rows > MOST_IDEAL_SAMPLES * n * n * camera.width * camera.height:
        return None
    return enclosing_camera(view.extent, int(columns), int(rows))


def mean_light(
    camera: PinholeCamera, lens: LensDistortion, n: int, light: Callable[[PinholeCamera], np.ndarray]
) -> tuple[FloatArray, FloatArray] | None:
    """The mean light of raw pixels.

    Parameters
    ----------
    camera : PinholeCamera
        Its calibration matrix is that of the raw camera.
    lens : LensDistortion
    n : int
        Least samples along each side of a pixel.
    light : callable
        What an ideal camera sees, (h, w, 3) float32.

    Returns
    -------
    light : (h, w, 3) float64
    area : (h, w) float64
        How much of each pixel samples tell, about 1; 0 where they tell nothing.
        None instead of both where single rays cost less.
    """
    samples = sampling_camera(camera, lens, n)
    if samples is None:
        return None
    coefficients = np.zeros(8)
    coefficients[: len(lens.coefficients)] = lens.coefficients
    numbers = Lens(lens.model == 'equidistant', coefficients, lens.widest)
    raw = (camera.fx, camera.fy, camera.cx, camera.cy)
    total = np.zeros((camera.height, camera.width, 4))
    rows = max(STRIP_SAMPLES // samples.width, 1)
    for first in range(0, samples.height, rows):
        height = min(rows, samples.height - first)
        part = PinholeCamera(samples.width, height, samples.fx, samples.fy, samples.cx, samples.cy - first)
        add_light(light(part), (part.fx, part.fy, part.cx, part.cy), raw, numbers, total)
    area = total[..., 3]
    return total[..., :3] / np.where(area > 0.0, area, 1.0)[..., None], area
