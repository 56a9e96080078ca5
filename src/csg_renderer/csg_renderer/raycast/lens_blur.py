"""What a lens blurs is light, before pixels count it: pictures that are finer, blurred, and only then made pixels.

To blur an image of pixels is another thing: an edge that passes through a pixel has given it a share already, and is
blurred as two edges with shares, one pixel apart. Where its place in the pixels is the same all along, as that of an
upright edge is, a measurement of it is off by up to 0.1 pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from msgs_py import PinholeCamera
from msgs_py.numeric.typed import Float32Array

from .settings import FINE_PSF, MOST_FINER, STRIP_SAMPLES


def finer(psf: float) -> int:
    """How many pixels along each side of a pixel a picture has that is blurred.

    Parameters
    ----------
    psf : float
        Standard deviation of the blur, pixels, > 0.

    Returns
    -------
    int

    Examples
    --------
    >>> finer(0.5), finer(3.0), finer(0.01)
    (4, 1, 8)
    """
    return max(1, min(MOST_FINER, math.ceil(FINE_PSF / psf)))


def blurred_light(camera: PinholeCamera, psf: float, light: Callable[[PinholeCamera], np.ndarray]) -> Float32Array:
    """The light of a picture behind a lens that blurs.

    Parameters
    ----------
    camera : PinholeCamera
    psf : float
        Standard deviation of the blur, pixels, > 0.
    light : callable
        What a camera sees without blur, (h, w, 3): it is asked for strips of the picture, finer and with what is beside
        them.

    Returns
    -------
    (h, w, 3) float32
        On the scale of ``light``.
    """
    n, margin = finer(psf), math.ceil(4.0 * psf)
    width = camera.width + 2 * margin
    rows = max(STRIP_SAMPLES // (n * n * width) - 2 * margin, 1)
    out = np.empty((camera.height, camera.width, 3), np.float32)
    for top in range(0, camera.height, rows):
        height = min(rows, camera.height - top)
        # Pixels have whole numbers in their middles.
        middle = [n * (place + margin + 0.5) - 0.5 for place in (camera.cx, camera.cy - top)]
        fine = PinholeCamera(n * width, n * (height + 2 * margin), n * camera.fx, n * camera.fy, *middle)
        seen = np.asarray(light(fine), np.float32)
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), n * psf, borderType=cv2.BORDER_REPLICATE))
        seen = np.asarray(cv2.resize(seen, (width, height + 2 * margin), interpolation=cv2.INTER_AREA))
        out[top : top + height] = seen[margin : margin + height, margin : margin + camera.width]
    return out
