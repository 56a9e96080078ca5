"""A pose laid on steps found along the normals of its outline: robust Gauss-Newton on rigid motions, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..geometry.least_squares import damp, solve6
from ..geometry.rigid_motion import compose_small, transform
from ..geometry.settings import UNIFORM_ANGLE


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
        Curve and view of each, ascending.
    curve : (n,) int32
        Curve of the model, one number for all views.
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
    curve: Int32Array
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

    def without(self, points: BoolArray) -> Steps:
        """The steps, but none at some points (n,)."""
        return self._replace(number=np.where(points, np.minimum(self.number, 0), self.number))


class Prior(NamedTuple):
    """What is known of a pose beforehand.

    Attributes
    ----------
    information : (6, 6) float64
        On its turn, about the middle of the model, and shift; zeros where nothing is known.
    moved : (6,) float64
        How far the pose is from where it is believed to be: changed in place with the pose.
    """

    information: FloatArray
    moved: FloatArray


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
def moved_by(motion: FloatArray, cameras: FloatArray, placed: Placed) -> float:
    """Pixels, root mean square, that a pose (12,) moves points along their normals from where they were drawn."""
    total = 0.0
    for k in range(len(placed.eye)):
        total += displacement(motion, cameras, placed, k) ** 2
    return math.sqrt(total / max(len(placed.eye), 1))


@njit(nogil=True)
def align(
    motion: FloatArray,
    middle: FloatArray,
    cameras: FloatArray,
    placed: Placed,
    steps: Steps,
    widths: FloatArray,
    elsewhere: float,
    common: tuple[float, float],
    prior: Prior,
    residual: FloatArray,
    weight: FloatArray,
    normal: FloatArray,
) -> None:
    """Lay a pose on steps, in place: each is that of the point, with normal errors, or lies anywhere.

    Expectation-maximisation of that mixture, one Gauss-Newton step a width. A whole curve is off besides, by a straight
    line along it, the same in all views, and by another one in each view: their unknowns, two each, are eliminated from
    the normal equations.

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
    common : tuple of float
        Pixels, sigmas of either unknown of the line of a curve in all views, and of that in one view.
    prior : Prior
        Of the pose.
    residual, weight : (n,) float64
        Filled with what remains (not a number without step) and what it counts: the chance that the step is the
        point's, over its variance.
    normal : (6, 6) float64
        Filled with the normal matrix, turn and shift, about the middle; the prior is not in it.
    """
    right, step, centre = np.zeros(6), np.zeros(6), np.zeros(3)
    information, moved = prior
    n, with_lines = len(placed.eye), common[0] > 0.0 or common[1] > 0.0
    of_group = np.empty((placed.group.max() + 1 if n else 0, 2, 9))
    of_curve = np.empty((placed.curve.max() + 1 if n else 0, 2, 9))
    for turn in range(len(widths) + 1):
        last = turn == len(widths)
        width = widths[min(turn, len(widths) - 1)]
        cx, cy, cz = transform(motion, middle[0], middle[1], middle[2])
        centre[0], centre[1], centre[2] = cx, cy, cz
        normal[:], right[:], of_group[:], of_curve[:] = 0.0, 0.0, 0.0, 0.0
        for k in range(n):
            residual[k], weight[k] = np.nan, 0.0
            if steps.number[k] <= 0:
                continue
            at = displacement(motion, cameras, placed, k)
            row = placed.slope[k]
            if math.isnan(at):
                continue
            variance = steps.variance[k] + width * width
            spread = variance + common[0] ** 2 + common[1] ** 2
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
            if with_lines:
                add_to_line(of_group[placed.group[k]], weight[k], placed.abscissa[k], row, residual[k])
            for i in range(6):
                right[i] += weight[k] * row[i] * residual[k]
                for j in range(i + 1):
                    normal[i, j] += weight[k] * row[i] * row[j]
        if with_lines:
            _without_lines(normal, right, placed, of_group, of_curve, common)
        for i in range(6):
            for j in range(i):
                normal[j, i] = normal[i, j]
        if last:
            break
        damped = normal + information
        for i in range(6):
            for j in range(6):
                right[i] -= information[i, j] * moved[j]
        for i in range(3):
            # What nothing tells of a turn: any is as likely.
            damped[i, i] += 1.0 / UNIFORM_ANGLE**2
        damp(damped)
        if not solve6(damped, right, step):
            break
        compose_small(motion, centre, step)
        moved += step


@njit(nogil=True)
def _without_lines(
    normal: FloatArray,
    right: FloatArray,
    placed: Placed,
    of_group: FloatArray,
    of_curve: FloatArray,
    common: tuple[float, float],
) -> None:
    """Take the lines by which curves are off out of normal equations of which the lower half is filled.

    of_group, of_curve : (g, 2, 9) and (c, 2, 9) zeros, see :func:`_eliminate`; common : see :func:`align`
    """
    for k in range(len(placed.eye)):
        if k == 0 or placed.group[k] != placed.group[k - 1]:
            _eliminate(normal, right, of_group[placed.group[k]], common[1])
            of_curve[placed.curve[k]] += of_group[placed.group[k]]
    for curve in range(len(of_curve)):
        _eliminate(normal, right, of_curve[curve], common[0])


@njit(nogil=True)
def _eliminate(normal: FloatArray, right: FloatArray, sums: FloatArray, sigma: float) -> None:
    """Take a line by which points are off, of sigma, out of the lower half of the normal equations, and of its sums.

    sums : (2, 9), for offset and slope the sums of weights times: derivatives (6), residual, offset, slope; in place
    """
    if sigma <= 0.0 or sums[0, 7] <= 0.0:
        return
    p, q, r = inverse_of_line(sums, sigma)
    given = np.empty((2, 9))
    for i in range(9):
        given[0, i] = p * sums[0, i] + q * sums[1, i]
        given[1, i] = q * sums[0, i] + r * sums[1, i]
    for i in range(6):
        right[i] -= given[0, i] * sums[0, 6] + given[1, i] * sums[1, 6]
        for j in range(i + 1):
            normal[i, j] -= given[0, i] * sums[0, j] + given[1, i] * sums[1, j]
    a, b, c = sums[0, 7], sums[0, 8], sums[1, 8]
    for i in range(9):
        sums[0, i] -= a * given[0, i] + b * given[1, i]
        sums[1, i] -= b * given[0, i] + c * given[1, i]


@njit(nogil=True)
def add_to_line(sums: FloatArray, weight: float, abscissa: float, slope: FloatArray, residual: float) -> None:
    """Add a point to the sums (2, 9) of a line, of its offset and of its slope.

    Of weights times: derivatives by the pose (6), residual, offset, slope.
    """
    for line in range(2):
        part = weight * (abscissa if line else 1.0)
        for i in range(6):
            sums[line, i] += part * slope[i]
        sums[line, 6] += part * residual
        sums[line, 7] += part
        sums[line, 8] += part * abscissa


@njit(nogil=True)
def inverse_of_line(sums: FloatArray, sigma: float) -> tuple[float, float, float]:
    """Covariance of offset and slope, of sigma beforehand, by points of so much weight: (0, 0), (0, 1) and (1, 1).

    sums : (2, 9), see :func:`add_to_line`
    """
    prior = 1.0 / (sigma * sigma)
    a, b, c = sums[0, 7] + prior, sums[0, 8], sums[1, 8] + prior
    scale = 1.0 / (a * c - b * b)
    return scale * c, -scale * b, scale * a
