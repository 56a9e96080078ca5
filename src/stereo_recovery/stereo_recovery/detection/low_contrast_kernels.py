"""Compiled loop along the lines of segments of low contrast, for :mod:`.low_contrast`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from .line_kernels import Lines, length_of
from .sampling import bilinear
from .settings import (
    LONGEST_TRACK,
    LONGEST_TRACK_SHARE,
    ON_TRACK,
    TOUCHING,
    TRACK_OVERLAP,
    TRACK_SINE,
    TRACKED_PROMINENCE,
    TRACKED_SHARE,
    TRACKED_SIGMA,
    TRACKING_FLANK,
    TRACKING_STEP,
    WINDOW,
)


@njit
def _free_length(lines: Lines, extent: FloatArray, i: int, e: int) -> float:
    """Pixels by which end e of segment i may be moved outwards.

    That is as far as its line is known, and up to the next segment of the same line; none where another segment ends at
    the same point.

    extent : (n, 2), pixels, of the segments as they are now
    """
    tu, tv = lines.direction[i, 0], lines.direction[i, 1]
    cu, cv = lines.centre[i, 0], lines.centre[i, 1]
    outward = 1.0 if e == 1 else -1.0
    free: float = min(LONGEST_TRACK, LONGEST_TRACK_SHARE * length_of(lines, i))
    if lines.sigma[i, 1] > 0.0:
        free = min(free, TRACKED_SIGMA / lines.sigma[i, 1] - outward * extent[i, e])
    eu, ev = cu + extent[i, e] * tu, cv + extent[i, e] * tv
    for k in range(len(extent)):
        if k == i:
            continue
        for f in range(2):
            x = lines.centre[k, 0] + extent[k, f] * lines.direction[k, 0] - eu
            y = lines.centre[k, 1] + extent[k, f] * lines.direction[k, 1] - ev
            if x * x + y * y < TOUCHING**2:
                free = 0.0
        if abs(tu * lines.direction[k, 1] - tv * lines.direction[k, 0]) > TRACK_SINE:
            continue
        for f in range(2):
            x = lines.centre[k, 0] + extent[k, f] * lines.direction[k, 0] - cu
            y = lines.centre[k, 1] + extent[k, f] * lines.direction[k, 1] - cv
            beyond = (x * tu + y * tv - extent[i, e]) * outward
            if -TRACK_OVERLAP < beyond < free and abs(x * tv - y * tu) < ON_TRACK:
                free = max(beyond, 0.0)
    return free


@njit
def track(
    lines: Lines, magnitude: FloatArray, low_contrast: BoolArray, gx: Float32Array, gy: Float32Array, least: float
) -> FloatArray:
    """Extent of segments, of those with low contrast as far as the picture shows their lines.

    Parameters
    ----------
    lines : Lines
        Of n segments.
    magnitude : (n,) float64, grey levels per pixel
        Mean gradient of each.
    low_contrast : (n,) bool
        Those to be tracked.
    gx, gy : (h, w) float32, grey levels per pixel
        Derivatives of the smoothed image.
    least : float
        Grey levels per pixel. Least median gradient that shows an edge.

    Returns
    -------
    (n, 2) float64, pixels
    """
    extent = lines.extent.copy()
    h, w = gx.shape
    values, flanks = np.empty(WINDOW), np.empty(2 * WINDOW)
    for i in range(len(extent)):
        if not low_contrast[i]:
            continue
        tu, tv = lines.direction[i, 0], lines.direction[i, 1]
        limit = max(least, TRACKED_SHARE * magnitude[i])
        for e in range(2):
            outward = 1.0 if e == 1 else -1.0
            free = _free_length(lines, extent, i, e)
            advance = 0.0
            while advance + TRACKING_STEP <= free:
                # The window is centred on the point that would become the end.
                inside = True
                for m in range(WINDOW):
                    s = extent[i, e] + outward * (advance + TRACKING_STEP + m - 0.5 * (WINDOW - 1))
                    for side in range(3):
                        off = (side - 1) * TRACKING_FLANK
                        u = lines.centre[i, 0] + s * tu - off * tv
                        v = lines.centre[i, 1] + s * tv + off * tu
                        if not (1.0 <= u < w - 2.0 and 1.0 <= v < h - 2.0):
                            inside = False
                            break
                        g = bilinear(gy, u, v) * tu - bilinear(gx, u, v) * tv
                        if side == 1:
                            values[m] = g
                        else:
                            flanks[m + (WINDOW if side == 2 else 0)] = g
                    if not inside:
                        break
                if not inside:
                    break
                middle = np.median(values)
                around = max(abs(np.median(flanks[:WINDOW])), abs(np.median(flanks[WINDOW:])))
                if middle < limit or middle - around < TRACKED_PROMINENCE * middle:
                    break
                advance += TRACKING_STEP
            if advance > 0.0:
                extent[i, e] += outward * advance
    return extent
