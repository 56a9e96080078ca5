"""The least squares of one curve on the edgels of two images, alone or with an axis constraint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.robust import sigma_from_median
from msgs_py.numeric.typed import FloatArray

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
    sigma = edgels.sigma
    if len(seen.points) < settings.LEAST_POINTS:
        return None
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
        if rough and circle:
            rms = fit_kernels.truncated_rms(shape, seen)
            return replace(curve.with_shape(shape), rms=rms) if np.isfinite(rms) else None
        prior = np.zeros((0, 0))
        if axis is not None:
            slope = axis.jacobian(shape.normal, shape.first)
            prior = slope.T @ information @ slope
        covariance, rms, off = fit_kernels.fitted(shape, circle, seen, sigma, edgels.bias, prior)
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
    return replace(curve.with_shape(shape), covariance=covariance, rms=rms, misfit=sigma_from_median(off))


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
