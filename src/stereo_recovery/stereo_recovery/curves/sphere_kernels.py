"""Compiled fit of a sphere to its occluding contours in two images, for :mod:`.spheres`."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.settings import LEAST_DIVISOR
from .fit_kernels import solve
from .observations import Seen
from .settings import DAMPING_FACTOR, DAMPING_START, DIFFERENCE_STEP, LEAST_SPHERE_DEPTH, ROUNDS, SPHERE_LOSS_SCALE


@njit
def distances(sphere: FloatArray, seen: Seen, index: IntArray) -> FloatArray:
    """(n,) float64, pixels: of edgels from the contours of a sphere (4,), metres, without the bias of smoothing."""
    out = np.empty(len(index))
    for k, i in enumerate(index):
        camera = seen.cameras[0 if i < seen.left_count else 1]
        x, y, z = sphere[0] - (0.0 if i < seen.left_count else seen.baseline), sphere[1], sphere[2]
        u, v = (seen.points[i, 0] - camera[2]) / camera[0], (seen.points[i, 1] - camera[3]) / camera[1]
        # The cone of sight: (c c - r r) s s = (c s)^2 of lines of sight s.
        square, along = x * x + y * y + z * z - sphere[3] ** 2, x * u + y * v + z
        gu, gv = 2.0 * (square * u - along * x) / camera[0], 2.0 * (square * v - along * y) / camera[1]
        value = square * (u * u + v * v + 1.0) - along * along
        radius = camera[0] * sphere[3] / max(z, LEAST_SPHERE_DEPTH)
        out[k] = value / max(np.hypot(gu, gv), LEAST_DIVISOR) + 0.5 * seen.blur / max(radius, 1.0)
    return out


@njit
def fitted(start: FloatArray, size: float, seen: Seen, index: IntArray) -> FloatArray:
    """(4,) metres: the sphere whose contours fit edgels best, by Levenberg and Marquardt with the soft L1 loss.

    start : (4,) centre and radius; size : metres, of steps; index : (n,) which edgels
    """
    sphere, damping = start.copy(), DAMPING_START
    sigma = seen.sigma[index]
    off = distances(sphere, seen, index) / sigma
    cost = _cost(off)
    rows = np.empty((len(off), 4))
    for _ in range(ROUNDS):
        for k in range(4):
            shifted = sphere.copy()
            shifted[k] += DIFFERENCE_STEP * size
            rows[:, k] = (distances(shifted, seen, index) / sigma - off) / DIFFERENCE_STEP
        weight = 1.0 / np.sqrt(1.0 + (off / SPHERE_LOSS_SCALE) ** 2)
        normal, step = np.zeros((4, 4)), np.zeros((4, 1))
        for i in range(len(off)):
            for a in range(4):
                step[a, 0] -= weight[i] * rows[i, a] * off[i]
                for b in range(4):
                    normal[a, b] += weight[i] * rows[i, a] * rows[i, b]
        for a in range(4):
            normal[a, a] *= 1.0 + damping
        if not solve(normal, step):
            break
        moved = sphere + size * step[:, 0]
        again = distances(moved, seen, index) / sigma
        if _cost(again) < cost:
            sphere, off, cost, damping = moved, again, _cost(again), damping / DAMPING_FACTOR
        else:
            damping *= DAMPING_FACTOR
    return sphere


@njit
def _cost(off: FloatArray) -> float:
    """The soft L1 loss of residuals (n,), in sigmas."""
    return float(np.sum(np.sqrt(1.0 + (off / SPHERE_LOSS_SCALE) ** 2) - 1.0))
