"""A pose laid on steps found along the normals of its outline: robust Gauss-Newton on rigid motions, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array

from ..geometry.least_squares import damp, solve_positive
from ..geometry.rigid_motion import compose_small, transform
from ..geometry.settings import UNIFORM_ANGLE
from .settings import OF_IMAGE


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
    slope : (n, 6 + 2 (v - 1)) float64
        How far each moves along its normal by a turn about the middle of the model and a shift, at the pose where it
        was drawn: pixels a radian, and a metre. And by what the image of each of v cameras but the first is off, to the
        right and down.
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


class ModelError(NamedTuple):
    """Sigmas, pixels, of what an outline is off besides noise; see :mod:`.model_error`.

    Attributes
    ----------
    curve : float
        Of the offset, and of the slope (over half the length), of a whole curve in all views.
    view : float
        Of those that it has in one view besides.
    point : float
        Of a point on its curve, beyond what its step is stated to be off.
    image : float
        Of each of the unknowns of the whole image of a camera but the first, see :attr:`Placed.slope`. Of a
        pair the rows tell it; its columns, in which an error is one of the depth, are taken to be off by as much.
    """

    curve: float
    view: float
    point: float
    image: float


class Prior(NamedTuple):
    """What is known of a pose beforehand.

    Attributes
    ----------
    information : (6, 6) float64
        On its turn, about the middle of the model, and shift; zeros where nothing is known.
    moved : (m,) float64
        How far the pose is from where it is believed to be, and then by how many pixels the images of further cameras
        are off, see :attr:`Placed.slope`: changed in place with the pose.
    """

    information: FloatArray
    moved: FloatArray


class Equations(NamedTuple):
    """Normal equations of a step to the m unknowns of :attr:`Placed.slope`, without what is known beforehand.

    Attributes
    ----------
    normal : (m, m) float64
    right : (m,) float64
    """

    normal: FloatArray
    right: FloatArray


class Fit(NamedTuple):
    """What is known before a pose is laid on steps, and what is known then: filled in place.

    Attributes
    ----------
    prior : Prior
        Of the pose.
    residual, weight : (n,) float64
        What remains at each point (not a number without step) and what it counts: the chance that the step is the
        point's, over its variance.
    equations : Equations
        At the pose that is found.
    """

    prior: Prior
    residual: FloatArray
    weight: FloatArray
    equations: Equations


@njit(nogil=True)
def new_fit(placed: Placed, information: FloatArray) -> Fit:
    """A fit that is to be made, of a pose of which so much (6, 6) is known beforehand."""
    n, unknowns = placed.slope.shape
    equations = Equations(np.zeros((unknowns, unknowns)), np.zeros(unknowns))
    return Fit(Prior(information, np.zeros(unknowns)), np.empty(n), np.empty(n), equations)


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
    error: ModelError,
    fit: Fit,
) -> None:
    """Lay a pose on steps, in place: each is that of the point, with normal errors, or lies anywhere.

    Expectation-maximisation of that mixture, one Gauss-Newton step a width. A whole curve is off besides, by a straight
    line along it, the same in all views, and by another one in each view: their unknowns, two each, are eliminated from
    the normal equations. What the image of a camera is off as a whole, for it is not quite where it is said to be, is
    found with the pose.

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
    error : ModelError
    fit : Fit
        Filled in place; its prior moves with the pose.
    """
    prior, residual, weight, equations = fit
    normal, right = equations
    unknowns = len(right)
    step, centre = np.zeros(unknowns), np.zeros(3)
    moved = prior.moved
    curve, view, point, image = error
    n, with_lines = len(placed.eye), curve > 0.0 or view > 0.0
    of_group = np.empty((placed.group.max() + 1 if n else 0, 2, 3 + unknowns))
    of_curve = np.empty((placed.curve.max() + 1 if n else 0, 2, 3 + unknowns))
    if image <= 0.0:
        moved[6:] = 0.0
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
            # By what the images of later cameras are off, it does not move.
            known = min(6 + OF_IMAGE * placed.eye[k], unknowns)
            for i in range(6, known):
                at += row[i] * moved[i]
            variance = steps.variance[k] + point**2 + width * width
            spread = variance + curve**2 + view**2
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
            for i in range(known):
                right[i] += weight[k] * row[i] * residual[k]
                for j in range(i + 1):
                    normal[i, j] += weight[k] * row[i] * row[j]
        if with_lines:
            _without_lines(normal, right, placed, of_group, of_curve, error)
        for i in range(unknowns):
            for j in range(i):
                normal[j, i] = normal[i, j]
        if last:
            break
        damped, towards = with_prior(equations, prior, image)
        for i in range(3):
            # What nothing tells of a turn: any is as likely.
            damped[i, i] += 1.0 / UNIFORM_ANGLE**2
        damp(damped)
        if not solve_positive(damped, towards, step):
            break
        compose_small(motion, centre, step)
        step[6:] *= image
        moved += step


@njit(nogil=True)
def with_prior(equations: Equations, prior: Prior, image: float) -> tuple[FloatArray, FloatArray]:
    """Equations (m, m), (m,) with what is known beforehand.

    What images are off is in units of their sigma, so that they may well be off by nothing.
    """
    normal, right = equations.normal.copy(), equations.right.copy()
    normal[:6, :6] += prior.information
    right[:6] -= prior.information @ prior.moved[:6]
    for i in range(6, len(right)):
        normal[i, :] *= image
        normal[:, i] *= image
        right[i] *= image
        normal[i, i] += 1.0
        if image > 0.0:
            right[i] -= prior.moved[i] / image
    return normal, right


@njit(nogil=True)
def _without_lines(
    normal: FloatArray, right: FloatArray, placed: Placed, of_group: FloatArray, of_curve: FloatArray, error: ModelError
) -> None:
    """Take the lines by which curves are off out of normal equations of which the lower half is filled.

    of_group, of_curve : (g, 2, 3 + m) and (c, 2, 3 + m) zeros, see :func:`_eliminate`
    """
    whole, in_view, _, _ = error
    for k in range(len(placed.eye)):
        if k == 0 or placed.group[k] != placed.group[k - 1]:
            _eliminate(normal, right, of_group[placed.group[k]], in_view)
            of_curve[placed.curve[k]] += of_group[placed.group[k]]
    for curve in range(len(of_curve)):
        _eliminate(normal, right, of_curve[curve], whole)


@njit(nogil=True)
def _eliminate(normal: FloatArray, right: FloatArray, sums: FloatArray, sigma: float) -> None:
    """Take a line by which points are off, of sigma, out of the lower half of the normal equations, and of its sums.

    sums : (2, 3 + m), see :func:`add_to_line`; in place
    """
    if sigma <= 0.0 or sums[0, 1] <= 0.0:
        return
    given = line_of(sums, sigma)
    for i in range(len(right)):
        right[i] -= given[0, 3 + i] * sums[0, 0] + given[1, 3 + i] * sums[1, 0]
        for j in range(i + 1):
            normal[i, j] -= given[0, 3 + i] * sums[0, 3 + j] + given[1, 3 + i] * sums[1, 3 + j]
    take_line(sums, given)


@njit(nogil=True)
def line_of(sums: FloatArray, sigma: float) -> FloatArray:
    """The line of sigma, offset and slope, that sums (2, 3 + m) make, and what it has of each of them: (2, 3 + m)."""
    p, q, r = inverse_of_line(sums, sigma)
    given = np.empty_like(sums)
    for i in range(sums.shape[1]):
        given[0, i] = p * sums[0, i] + q * sums[1, i]
        given[1, i] = q * sums[0, i] + r * sums[1, i]
    return given


@njit(nogil=True)
def take_line(sums: FloatArray, given: FloatArray) -> None:
    """Take a line out of sums (2, 3 + m), in place; see :func:`line_of`."""
    a, b, c = sums[0, 1], sums[0, 2], sums[1, 2]
    for i in range(sums.shape[1]):
        sums[0, i] -= a * given[0, i] + b * given[1, i]
        sums[1, i] -= b * given[0, i] + c * given[1, i]


@njit(nogil=True)
def add_to_line(sums: FloatArray, weight: float, abscissa: float, slope: FloatArray, residual: float) -> None:
    """Add a point to the sums (2, 3 + m) of a line, of its offset and of its slope.

    Of weights times: residual, offset, slope, derivatives by the m unknowns of :attr:`Placed.slope`.
    """
    for line in range(2):
        part = weight * (abscissa if line else 1.0)
        sums[line, 0] += part * residual
        sums[line, 1] += part
        sums[line, 2] += part * abscissa
        for i in range(len(slope)):
            sums[line, 3 + i] += part * slope[i]


@njit(nogil=True)
def inverse_of_line(sums: FloatArray, sigma: float) -> tuple[float, float, float]:
    """Covariance of offset and slope, of sigma beforehand, by points of so much weight: (0, 0), (0, 1) and (1, 1).

    sums : see :func:`add_to_line`
    """
    prior = 1.0 / (sigma * sigma)
    a, b, c = sums[0, 1] + prior, sums[0, 2], sums[1, 2] + prior
    scale = 1.0 / (a * c - b * b)
    return scale * c, -scale * b, scale * a
