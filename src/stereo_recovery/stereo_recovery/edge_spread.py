"""The blur of a camera from the profiles of strong straight edges: the slanted-edge method.

The pixels along a straight edge lie at all fractions of a pixel from it, so that they sample its profile far more
finely than one row does. The profile is a step seen through a Gaussian and through the square of a pixel.

References
----------
ISO 12233 (the slanted edge); P. D. Burns, "Slanted-edge MTF for digital camera and scanner analysis", PICS 2000.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray

from .detection.segments import Segments
from .settings import (
    EDGE_CONTRAST,
    EDGE_CONTRAST_NOISE,
    EDGE_LENGTH,
    EDGE_PHASES,
    EDGE_REACH,
    EDGE_SAGITTA,
    FEWEST_EDGES,
    LEAST_PSF,
    MOST_EDGES,
    PIXEL_NODES,
    PROFILE_ERROR,
)


@dataclass(frozen=True, eq=False)
class EdgeSpread:
    """The blur of strong straight edges.

    Attributes
    ----------
    psf : float
        Pixels. Standard deviation of the Gaussian, the median over the edges.
    error : float
        Pixels. Standard error of the median.
    each : (n,) float64
        Pixels. Of each edge.
    """

    psf: float
    error: float
    each: FloatArray


def edge_spread(light: FloatArray, noise: FloatArray, segments: Segments, seen: BoolArray) -> EdgeSpread | None:
    """The blur of a picture.

    Parameters
    ----------
    light : (h, w) float64
        Grey levels, linear.
    noise : (h, w) float64
        Grey levels. Standard deviation of each pixel.
    segments : Segments
        Detected in the picture.
    seen : (h, w) bool
        Pixels to look at: those of one colour of a mosaic, and none that is clipped.

    Returns
    -------
    EdgeSpread or None
        None where fewer than FEWEST_EDGES edges have the profile of a step.
    """
    strong = (
        (segments.arc < 0)
        & (segments.length > EDGE_LENGTH + 2.0 * EDGE_REACH)
        & (np.abs(segments.sagitta) < EDGE_SAGITTA)
        # Along rows or columns all pixels lie at one fraction of a pixel from the edge.
        & (np.abs(segments.direction).min(axis=1) * segments.length > EDGE_PHASES)
    )
    chosen = segments.select(strong)
    chosen = chosen.select(np.argsort(-chosen.magnitude * chosen.length, kind='stable')[:MOST_EDGES])
    found = [psf for k in range(len(chosen)) if (psf := _blur_of(light, noise, chosen, k, seen)) is not None]
    if len(found) < FEWEST_EDGES:
        return None
    each = np.array(found)
    psf = float(np.median(each))
    # Of a median of normal values, by their median absolute deviation.
    deviation = 1.4826 * float(np.median(np.abs(each - psf)))
    return EdgeSpread(psf, 1.2533 * deviation / np.sqrt(len(each)), each)


def _blur_of(light: FloatArray, noise: FloatArray, segments: Segments, k: int, seen: BoolArray) -> float | None:
    """The blur of one edge, pixels; None where its profile is not that of one step."""
    centre, along = segments.centre[k], segments.direction[k]
    across = np.array([-along[1], along[0]])
    low, high = (
        np.clip(np.round(edge + side), 0, np.array(light.shape[::-1]) - 1).astype(int)
        for edge, side in (
            (np.minimum(segments.start[k], segments.end[k]), -EDGE_REACH),
            (np.maximum(segments.start[k], segments.end[k]), EDGE_REACH),
        )
    )
    v, u = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    offset = np.stack([u, v], axis=-1) - centre
    t, s = offset @ across, offset @ along
    first, last = segments.extent[k]
    # The ends of an edge are corners, whose surroundings are no step.
    here = (np.abs(t) <= EDGE_REACH) & (s > first + EDGE_REACH) & (s < last - EDGE_REACH) & seen[v, u]
    if np.count_nonzero(here) < EDGE_LENGTH * EDGE_REACH * seen.mean():
        return None
    t, s, value, sigma = t[here], s[here] / (last - first), light[v, u][here], noise[v, u][here]
    nodes, weights = np.polynomial.legendre.leggauss(PIXEL_NODES)
    # Where parts of a pixel lie across the edge, from its centre, and what they weigh.
    parts = 0.5 * (nodes[:, None] * across[0] + nodes[None] * across[1]).ravel()
    shares = 0.25 * np.outer(weights, weights).ravel()

    # The seam: the imports take 0.7 s, a quarter of a node's start, and no node measures cameras.
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    def profile(p: FloatArray) -> FloatArray:
        """Levels: dark, step, place, turn, blur, shade on either side."""
        dark, step, place, turn, blur, before, after = p
        x = t - place - turn * s
        edge: FloatArray = ndtr((x[:, None] + parts) / blur) @ shares
        return np.asarray(dark + step * edge + before * np.minimum(x, 0.0) + after * np.maximum(x, 0.0))

    sides = [np.median(value[side]) if side.any() else np.nan for side in (t < -0.5 * EDGE_REACH, t > 0.5 * EDGE_REACH)]
    if not np.isfinite(sides).all():
        return None
    start = np.array([sides[0], sides[1] - sides[0], 0.0, 0.0, 0.7, 0.0, 0.0])
    least = np.array([-np.inf, -np.inf, -2.0, -2.0, LEAST_PSF, -np.inf, -np.inf])
    most = np.array([np.inf, np.inf, 2.0, 2.0, 0.5 * EDGE_REACH, np.inf, np.inf])
    fit = least_squares(lambda p: (profile(p) - value) / sigma, start, bounds=(least, most), x_scale='jac')
    step, typical = abs(fit.x[1]), float(np.median(sigma))
    left = float(np.sqrt(np.mean((profile(fit.x) - value) ** 2)))
    strong = step > max(EDGE_CONTRAST, EDGE_CONTRAST_NOISE * typical)
    if not strong or left > np.hypot(1.2 * typical, PROFILE_ERROR * step):
        return None
    return float(fit.x[4])
