"""Curves that take their axis, or the direction of their normal, from better known ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import FloatArray

from ..detection.conics import Ellipse
from . import fit_kernels, settings
from .axis_constraint import AxisConstraint
from .curve import Curve
from .curve_search import is_determined, recover_curve
from .fit import refine
from .initialisation import back_projected, disparity_of_parallel_plane, trimmed
from .inliers import inliers
from .observations import EdgelMasks, StereoEdgels

# A curve and the axis or direction that it gives to others.
AxisOf = tuple[Curve, AxisConstraint]


def axes_of(curves: list[Curve]) -> list[AxisOf]:
    """The axes of the curves whose normal is known well enough (AXIS_TILT).

    Parameters
    ----------
    curves : list of Curve

    Returns
    -------
    list of (Curve, AxisConstraint)
    """
    return [(curve, AxisConstraint.of(curve)) for curve in curves if curve.tilt < settings.AXIS_TILT]


def directions_of(curves: list[Curve]) -> list[AxisOf]:
    """The different normals of the curves whose normal is known well enough (AXIS_TILT).

    Parameters
    ----------
    curves : list of Curve

    Returns
    -------
    list of (Curve, AxisConstraint)
        The best known first.
    """
    result: list[AxisOf] = []
    for curve in sorted(curves, key=lambda c: c.tilt):
        if curve.tilt < settings.AXIS_TILT and all(
            abs(curve.normal @ other.normal) < settings.SAME_DIRECTION_COSINE for other, _ in result
        ):
            result.append((curve, AxisConstraint.direction_of(curve)))
    return result


def circle_on_axis(
    ellipse: Ellipse, samples: FloatArray, masks: EdgelMasks, axis: AxisConstraint, edgels: StereoEdgels
) -> Curve | None:
    """A circle on an axis through arcs that do not determine one by themselves.

    Parameters
    ----------
    ellipse : Ellipse
        The arc of the left image.
    samples : (k, 3) float64, pixels
        u, v, disparity of its matched segments.
    masks : two bool arrays
        The edgels of the arcs.
    axis : AxisConstraint
        The axis.
    edgels : StereoEdgels
        All of both images.

    Returns
    -------
    Curve or None
        None when the edgels contradict the axis.
    """
    start = _start_on_axis(ellipse, samples, axis, edgels.rig)
    if start is None:
        return None
    inner = edgels.select((trimmed(masks[0], settings.TRIMMED_SHARE), trimmed(masks[1], settings.TRIMMED_SHARE)))
    start = refine(start, inner, circle=True, rounds=settings.ROUGH_ROUNDS, axis=axis)
    if start is None or start.rms > settings.WORST_RMS:
        return None
    curve = recover_curve(start, edgels, masks, axis)
    if curve is None or not is_determined(curve) or curve.misfit > settings.CONSTRAINED_MISFIT:
        return None
    off = axis.residual(curve)
    chi2 = off @ np.linalg.solve(axis.covariance(curve.centre), off)
    return curve if chi2 < settings.AXIS_CHI2 else None


def _start_on_axis(ellipse: Ellipse, samples: FloatArray, axis: AxisConstraint, rig: StereoRig) -> Curve | None:
    """The left ellipse on the plane square to an axis, at the samples' disparity."""
    plane = disparity_of_parallel_plane(axis.direction, samples, rig)
    return None if plane is None else back_projected(ellipse, plane, rig)


def refitted_on_axes(curve: Curve, axes: list[AxisOf], edgels: StereoEdgels) -> Curve:
    """A circle refitted on the axis of a better known one, if its own covariance allows that; else the curve.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    axes : list of (Curve, AxisConstraint)
        Curves and their axes; its own is not used.
    edgels : StereoEdgels
        All of both images.
    """
    if not curve.is_circle:
        return curve
    best = curve
    for other, axis in axes:
        if other is curve or axis.tilt > settings.BETTER_TILT_SHARE * curve.tilt:
            continue
        off = axis.residual(curve)
        slope = axis.jacobian(curve.normal, curve.first)
        covariance = axis.covariance(curve.centre) + slope @ curve.covariance[:5, :5] @ slope.T
        if off @ np.linalg.solve(covariance, off) > settings.AXIS_CHI2:
            continue
        (on_left, fit_left), (on_right, fit_right) = (
            inliers(curve, side, view, edgels.blur) for side, view in edgels.sides
        )
        again = refine(curve, edgels.select((fit_left, fit_right)), True, settings.REFIT_ROUNDS, axis)
        if (
            again is not None
            and again.tilt < best.tilt
            and again.rms < settings.CONSTRAINED_RMS_FACTOR * curve.rms + settings.CONSTRAINED_RMS
        ):
            best = replace(again, left=on_left, right=on_right)
    return best


def made_parallel(curve: Curve, directions: list[AxisOf]) -> Curve:
    """A circle whose normal is vague, updated by the normal of a better known curve to which it may be parallel.

    This is one Kalman update with the covariance, not a new fit: displacements that all its edgels share are in the
    covariance, but not in the weights of a fit.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    directions : list of (Curve, AxisConstraint)
        See :func:`directions_of`.

    Returns
    -------
    Curve
        The same when no direction is compatible.
    """
    if not curve.is_circle:
        return curve
    for other, axis in sorted(directions, key=lambda pair: pair[1].tilt):
        if other is curve or axis.tilt > settings.BETTER_TILT_SHARE * curve.tilt:
            continue
        off, slope = axis.residual(curve)[:2], np.zeros((2, 6))
        slope[:, :5] = axis.jacobian(curve.normal, curve.first)[:2]
        innovation = slope @ curve.covariance @ slope.T + axis.tilt**2 * np.eye(2)
        if off @ np.linalg.solve(innovation, off) > settings.PARALLELISM_CHI2:
            continue
        gain = np.linalg.solve(innovation, slope @ curve.covariance).T
        step = -gain @ off
        growth = float(np.log1p(max(step[5] / curve.radii[0], -settings.MOST_SHRINKING)))
        shape = fit_kernels.moved(curve.shape, np.array([*step[:5], growth, growth, 0.0]), True)
        covariance = curve.covariance - gain @ slope @ curve.covariance
        return replace(curve.with_shape(shape), covariance=0.5 * (covariance + covariance.T))
    return curve
