"""The least squares of one curve on the edgels of two images, alone or with an axis constraint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.robust import sigma_from_median
from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.settings import CORRELATION_LENGTH
from . import fit_kernels, settings
from .axis_constraint import AxisConstraint
from .curve import CameraView, Curve, CurveShape, cross
from .observations import ImagePoints, StereoEdgels


def refine(
    curve: Curve,
    edgels: StereoEdgels,
    circle: bool,
    rounds: int = settings.ROUNDS,
    axis: AxisConstraint | None = None,
    rough: bool = False,
) -> Curve | None:
    """Move a curve until both image conics lie on the edgels (Levenberg-Marquardt, Cauchy weights; thesis 3.10.1).

    Parameters
    ----------
    curve : Curve
        Where to start; left optical frame, metres.
    edgels : StereoEdgels
        Only those of the curve.
    circle : bool
        Fit six parameters of a circle; else eight of an ellipse.
    rounds : int
        Most rounds of Levenberg-Marquardt.
    axis : AxisConstraint, optional
        An axis that the curve shall lie on. The covariance then holds what the edgels and the axis together determine.
    rough : bool
        Leave the covariance of a circle as it was: this fit only compares starts.

    Returns
    -------
    Curve or None
        With covariance, rms and misfit; None when the equations cannot be solved, when there are fewer than
        LEAST_POINTS edgels, or when an ellipse cannot be told from a circle.
    """
    if circle:
        curve = replace(curve, radii=np.full(2, float(np.sqrt(curve.radii.prod()))))
    seen = edgels.points
    count = len(seen.points)
    sigma = edgels.sigma
    if count < settings.LEAST_POINTS:
        return None
    distance, bias = np.empty(count), np.empty(count)
    information = np.zeros((0, 0)) if axis is None else np.linalg.inv(axis.covariance(curve.centre))
    try:
        good, shape = fit_kernels.minimise(
            CurveShape(*(part.copy() for part in curve.shape)),
            circle,
            seen,
            sigma,
            rounds,
            np.zeros((4, 3)) if axis is None else axis.table,
            information * settings.CORRELATED_EDGELS,
        )
        if not good:
            return None
        shape = CurveShape(*shape)
        matrix, _, cost, weights, rows = fit_kernels.equations(shape, circle, seen, sigma, distance, bias)
        if not np.isfinite(cost):
            return None
        rms = float(np.sqrt(np.mean(np.minimum(distance * distance, settings.MOST_SQUARED_RESIDUAL))))
        if rough and circle:
            return replace(curve.with_shape(shape), rms=rms)
        prior = np.zeros((0, 0))
        if axis is not None:
            slope = axis.jacobian(shape.normal, shape.first)
            prior = slope.T @ information @ slope
            matrix[:5, :5] += prior * settings.CORRELATED_EDGELS
        variance_factor = max(1.0, float(weights @ (distance * distance)) / max(count - len(matrix), 1))
        covariance = _covariance(
            matrix,
            prior,
            variance_factor,
            _common_part(rows, weights, edgels.bias, sigma, fit_kernels.sectors(shape, seen)),
        )
    except np.linalg.LinAlgError:
        return None
    if not circle and not _is_oblong(shape, covariance):
        return None
    covariance = covariance[:6, :6]
    covariance[5, :] *= settings.RADIUS_SIGMA_FACTOR * shape.radii[0]
    covariance[:, 5] *= settings.RADIUS_SIGMA_FACTOR * shape.radii[0]
    if not (np.isfinite(covariance).all() and np.isfinite(rms) and (np.diag(covariance) >= 0.0).all()):
        return None
    shape, covariance = _major_first(shape, covariance)
    misfit = sigma_from_median(float(np.median(np.abs(distance) / sigma)))
    return replace(curve.with_shape(shape), covariance=covariance, rms=rms, misfit=misfit)


def _common_part(
    rows: FloatArray, weights: FloatArray, bias: FloatArray, sigma: FloatArray, sector: IntArray
) -> FloatArray:
    """(p, p) float64: variance of the normal equations' right side by displacements that neighbouring edgels share.

    Such displacements do not average out over the edgels. rows : (n, p) jacobian; weights, bias, sigma, sector : (n,).
    """
    within_sectors: FloatArray = fit_kernels.common_displacement(
        rows,
        weights,
        np.hypot(bias, settings.COMMON_SIGMA + settings.COMMON_SHARE * sigma),
        sector,
        2 * settings.SECTORS,
    )
    within_sectors += fit_kernels.common_displacement(
        rows, weights, settings.OVERALL_SIGMA + settings.OVERALL_SHARE * sigma, np.zeros(len(rows), np.int64), 1
    )
    return within_sectors


def _covariance(matrix: FloatArray, prior: FloatArray, variance_factor: float, common: FloatArray) -> FloatArray:
    """(p, p) float64: covariance of the parameters, M^-1 S M^-1 (the sandwich estimator).

    matrix : (p, p), M, normal matrix with the constraint's part CORRELATED_EDGELS * prior; prior : (5, 5) information
    of an axis constraint, or (0, 0); variance_factor : mean squared weighted residual, at least 1; common : (p, p).
    """
    inverse = np.linalg.inv(matrix)
    correlated = CORRELATION_LENGTH * variance_factor
    spread = matrix * correlated + common
    if len(prior):
        # The constraint is part of M with the factor CORRELATED_EDGELS; its own variance has that factor squared.
        size = len(matrix)
        factor = settings.CORRELATED_EDGELS
        spread -= _widened(prior * factor * correlated, size) - _widened(prior * factor**2, size)
    covariance: FloatArray = inverse @ spread @ inverse
    return covariance


def _widened(matrix: FloatArray, size: int) -> FloatArray:
    """(size, size) float64: a smaller matrix in the upper left corner, else 0."""
    result = np.zeros((size, size))
    result[: len(matrix), : len(matrix)] = matrix
    return result


def _is_oblong(shape: CurveShape, covariance: FloatArray) -> bool:
    """Whether the log ratio of an ellipse's radii differs from 0 by more than LEAST_ELLIPSE_SIGMA sigma.

    covariance : (8, 8) float64, of the parameters of :func:`.fit_kernels.moved`.
    """
    variance = max(covariance[5, 5] + covariance[6, 6] - 2.0 * covariance[5, 6], 0.0)
    return bool(abs(np.log(shape.radii[0] / shape.radii[1])) >= settings.LEAST_ELLIPSE_SIGMA * np.sqrt(variance))


def _major_first(shape: CurveShape, covariance: FloatArray) -> tuple[CurveShape, FloatArray]:
    """The same curve with the larger radius first, and its covariance (6, 6): the tilts are about the radii."""
    if shape.radii[0] >= shape.radii[1]:
        return shape, covariance
    turn = np.eye(6)
    turn[3:5, 3:5] = [[0.0, 1.0], [-1.0, 0.0]]
    other = shape._replace(first=cross(shape.normal, shape.first), radii=shape.radii[::-1].copy())
    return other, turn @ covariance @ turn.T


def distances(curve: Curve, points: FloatArray, view: CameraView, blur: float) -> FloatArray:
    """Distances of pixels from a curve's image conic, with the bias that smoothing gives edgels taken off.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    points : (n, 2) float64, pixels
        Of the image of ``view``.
    view : CameraView
        The camera.
    blur : float
        Squared pixels. Variance of the smoothing, see :class:`.observations.StereoEdgels`; 0 for points that are no
        edgels.

    Returns
    -------
    (n,) float64, pixels
        Sampson distance, positive outside.
    """
    distance, bias = np.empty(len(points)), np.empty(len(points))
    fit_kernels.residuals(curve.shape, _one_image(points, view, blur), distance, bias)
    return distance


def predicted_variance(curve: Curve, points: FloatArray, view: CameraView, blur: float) -> FloatArray:
    """Variance that a curve's covariance gives its image conic.

    Parameters
    ----------
    curve, points, view, blur
        As for :func:`distances`; pixels near the conic.

    Returns
    -------
    (n,) float64, px^2
    """
    distance, bias = np.empty(len(points)), np.empty(len(points))
    rows = fit_kernels.jacobian(curve.shape, True, _one_image(points, view, blur), distance, bias)
    rows[:, 5] /= curve.radii[0]
    variance: FloatArray = np.einsum('ni,ij,nj->n', rows, curve.covariance, rows)
    return variance


def _one_image(points: FloatArray, view: CameraView, blur: float) -> ImagePoints:
    """Pixels (n, 2) of just one of the two images, for the compiled functions."""
    count = len(points) if view.x == 0.0 else 0
    camera = view.intrinsics
    return ImagePoints(np.ascontiguousarray(points), count, camera, camera, float(view.x), float(blur))
