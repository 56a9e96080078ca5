"""Compiled fit of a sphere to its occluding contours in two images, for :mod:`.spheres`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray

from ..detection.settings import LEAST_DIVISOR
from .fit_kernels import solve
from .observations import ImagePoints
from .settings import (
    DAMPING_FACTOR,
    DAMPING_START,
    DIFFERENCE_STEP,
    LEAST_DAMPING,
    LEAST_SPHERE_DEPTH,
    SPHERE_EVALUATIONS,
    SPHERE_LOSS_SCALE,
)


@njit
def distances(sphere: FloatArray, seen: ImagePoints) -> FloatArray:
    """(n,) float64, pixels: of edgels from the contours of a sphere (4,), metres, without the bias of smoothing."""
    out = np.empty(len(seen.points))
    for i in range(len(out)):
        camera = seen.camera_left if i < seen.left_count else seen.camera_right
        x, y, z = sphere[0] - (0.0 if i < seen.left_count else seen.baseline), sphere[1], sphere[2]
        u, v = (seen.points[i, 0] - camera[2]) / camera[0], (seen.points[i, 1] - camera[3]) / camera[1]
        # The cone of sight: (c c - r r) s s = (c s)^2 of lines of sight s.
        square, along = x * x + y * y + z * z - sphere[3] ** 2, x * u + y * v + z
        gu, gv = 2.0 * (square * u - along * x) / camera[0], 2.0 * (square * v - along * y) / camera[1]
        value = square * (u * u + v * v + 1.0) - along * along
        radius = camera[0] * sphere[3] / max(z, LEAST_SPHERE_DEPTH)
        out[i] = value / max(np.hypot(gu, gv), LEAST_DIVISOR) + 0.5 * seen.blur / max(radius, 1.0)
    return out


@njit
def fitted(start: FloatArray, size: float, seen: ImagePoints, sigma: FloatArray) -> FloatArray:
    """(4,) metres: the sphere whose contours fit edgels best, by Levenberg and Marquardt with the soft L1 loss.

    start : (4,) centre and radius; size : metres, of steps; sigma : (n,) pixels, of the edgels
    """
    sphere, damping = start.copy(), DAMPING_START
    off = distances(sphere, seen) / sigma
    cost = _cost(off)
    rows = np.empty((len(off), 4))
    for _ in range(SPHERE_EVALUATIONS):
        for k in range(4):
            shifted = sphere.copy()
            shifted[k] += DIFFERENCE_STEP * size
            rows[:, k] = (distances(shifted, seen) / sigma - off) / DIFFERENCE_STEP
        weight = 1.0 / np.sqrt(1.0 + (off / SPHERE_LOSS_SCALE) ** 2)
        normal, step = np.zeros((4, 4)), np.zeros(4)
        for i in range(len(off)):
            for a in range(4):
                step[a] -= weight[i] * rows[i, a] * off[i]
                for b in range(4):
                    normal[a, b] += weight[i] * rows[i, a] * rows[i, b]
        for a in range(4):
            normal[a, a] *= 1.0 + damping
        if not solve(normal, step):
            break
        moved = sphere + size * step
        again = distances(moved, seen) / sigma
        if _cost(again) < cost:
            sphere, off, cost, damping = moved, again, _cost(again), max(damping / DAMPING_FACTOR, LEAST_DAMPING)
        else:
            damping *= DAMPING_FACTOR
    return sphere


@njit
def _cost(off: FloatArray) -> float:
    """The soft L1 loss of residuals (n,), in sigmas."""
    return float(np.sum(np.sqrt(1.0 + (off / SPHERE_LOSS_SCALE) ** 2) - 1.0))
