"""A pose laid on steps found along the normals of its outline: robust Gauss-Newton on rigid motions, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array

from ..geometry.least_squares import damp, solve6
from ..geometry.rigid_motion import compose_small, transform
from .settings import HALF_TURN_INFORMATION


class Placed(NamedTuple):
    """Points of an outline as the views saw them at the pose where it was drawn.

    Attributes
    ----------
    point : (n, 3) float64
        Metres, model frame.
    eye : (n,) int32
        Which of the views.
    pixel, normal : (n, 2) float64
        Where each was, and the unit normal there, along which steps are measured from it.
    group : (n,) int32
        Curve and view of each, ascending: what is wrong with one point of a curve is likely so with the next.
    abscissa : (n,) float64
        Where on its curve each is, from -1 to 1.
    slope : (n, 6) float64
        How far each moves along its normal by a turn about the middle of the model and a shift, at the pose where it
        was drawn: pixels a radian, and a metre.
    """

    point: FloatArray
    eye: Int32Array
    pixel: FloatArray
    normal: FloatArray
    group: Int32Array
    abscissa: FloatArray
    slope: FloatArray


class Steps(NamedTuple):
    """Steps that may be the points' edges.

    Attributes
    ----------
    offset : (n, c) float64
        Pixels along the normal.
    number : (n,) int32
        How many of them there are; none or fewer: the point says nothing.
    variance : (n,) float64
        Square pixels, of their places.
    """

    offset: FloatArray
    number: Int32Array
    variance: FloatArray


@njit(nogil=True)
def displacement(motion: FloatArray, cameras: FloatArray, placed: Placed, k: int) -> float:
    """How far point k has moved along its normal, pixels; not a number behind its camera."""
    x, y, z = transform(motion, placed.point[k, 0], placed.point[k, 1], placed.point[k, 2])
    c = cameras[placed.eye[k]]
    px = c[0] * x + c[1] * y + c[2] * z + c[9]
    py = c[3] * x + c[4] * y + c[5] * z + c[10]
    pz = c[6] * x + c[7] * y + c[8] * z + c[11]
    if not pz > 0.0:
        return np.nan
    du = c[12] * px / pz + c[14] - placed.pixel[k, 0]
    dv = c[13] * py / pz + c[15] - placed.pixel[k, 1]
    moved: float = placed.normal[k, 0] * du + placed.normal[k, 1] * dv
    return moved


@njit(nogil=True)
def align(
    motion: FloatArray,
    middle: FloatArray,
    cameras: FloatArray,
    placed: Placed,
    steps: Steps,
    widths: FloatArray,
    elsewhere: float,
    common: float,
    prior: FloatArray,
    residual: FloatArray,
    weight: FloatArray,
    normal: FloatArray,
) -> None:
    """Lay a pose on steps, in place: each is that of the point, with normal errors, or lies anywhere.

    Expectation-maximisation of that mixture, one Gauss-Newton step a width. A whole curve is off besides, by a straight
    line along it: its two unknowns are eliminated from the normal equations.

    Parameters
    ----------
    motion : (12,) float64
        camera_T_model; changed in place.
    middle : (3,) float64
        Metres, model frame, about which the pose turns.
    cameras : (v, 16) float64
        See :attr:`.cameras.Views.rows`.
    placed : Placed
    steps : Steps
    widths : (k,) float64
        Pixels, sigma that is added to that of the steps in each turn.
    elsewhere : float
        A pixel: density of steps that are not the point's, over the chance that a point has its own.
    common : float
        Pixels, sigma of either unknown of that line.
    prior : (6, 6) float64
        Information beforehand on turn and shift from the given pose; zeros where there is none.
    residual, weight : (n,) float64
        Filled with what remains (not a number without step) and what it counts: the chance that the step is the
        point's, over its variance.
    normal : (6, 6) float64
        Filled with the normal matrix, turn and shift, about the middle; the prior is not in it.
    """
    right, step, centre, moved = np.zeros(6), np.zeros(6), np.zeros(3), np.zeros(6)
    shared = np.empty((2, 9))
    for turn in range(len(widths) + 1):
        last = turn == len(widths)
        width = widths[min(turn, len(widths) - 1)]
        cx, cy, cz = transform(motion, middle[0], middle[1], middle[2])
        centre[0], centre[1], centre[2] = cx, cy, cz
        normal[:], right[:], shared[:] = 0.0, 0.0, 0.0
        for k in range(len(placed.eye)):
            if k > 0 and placed.group[k] != placed.group[k - 1]:
                _eliminate(normal, right, shared, common)
                shared[:] = 0.0
            residual[k], weight[k] = np.nan, 0.0
            if steps.number[k] <= 0:
                continue
            at = displacement(motion, cameras, placed, k)
            row = placed.slope[k]
            if math.isnan(at):
                continue
            variance = steps.variance[k] + width * width
            spread = variance + common * common
            total, mean = 0.0, 0.0
            for j in range(steps.number[k]):
                e = steps.offset[k, j] - at
                share = math.exp(-0.5 * e * e / spread)
                total += share
                mean += share * e
            own = total / (total + elsewhere * math.sqrt(6.283185307179586 * spread))
            if total <= 1e-300:
                continue
            residual[k], weight[k] = mean / total, own / variance
            for line in range(2):
                part = weight[k] * (placed.abscissa[k] if line else 1.0)
                for i in range(6):
                    shared[line, i] += part * row[i]
                shared[line, 6] += part * residual[k]
                shared[line, 7] += part
                shared[line, 8] += part * placed.abscissa[k]
            for i in range(6):
                right[i] += weight[k] * row[i] * residual[k]
                for j in range(i + 1):
                    normal[i, j] += weight[k] * row[i] * row[j]
        _eliminate(normal, right, shared, common)
        for i in range(6):
            for j in range(i):
                normal[j, i] = normal[i, j]
        if last:
            break
        damped = normal + prior
        for i in range(6):
            for j in range(6):
                right[i] -= prior[i, j] * moved[j]
        for i in range(3):
            damped[i, i] += HALF_TURN_INFORMATION
        damp(damped)
        if not solve6(damped, right, step):
            break
        compose_small(motion, centre, step)
        moved += step


@njit(nogil=True)
def _eliminate(normal: FloatArray, right: FloatArray, shared: FloatArray, common: float) -> None:
    """Take the line by which a curve is off, of sigmas ``common``, out of the lower half of the normal equations.

    shared : (2, 9), for offset and slope the sums of weights times: derivatives (6), residual, offset, slope
    """
    if common <= 0.0 or shared[0, 7] <= 0.0:
        return
    prior = 1.0 / (common * common)
    a, b, c = shared[0, 7] + prior, shared[0, 8], shared[1, 8] + prior
    scale = 1.0 / (a * c - b * b)
    for i in range(6):
        first = scale * (c * shared[0, i] - b * shared[1, i])
        second = scale * (a * shared[1, i] - b * shared[0, i])
        right[i] -= first * shared[0, 6] + second * shared[1, 6]
        for j in range(i + 1):
            normal[i, j] -= first * shared[0, j] + second * shared[1, j]
