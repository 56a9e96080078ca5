"""From a rough curve in space to the final one: fit, collect inliers, fit again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import settings
from .axis_constraint import AxisConstraint
from .curve import CameraView, Curve
from .fit import refine
from .inliers import inliers, visible_arc
from .observations import EdgelMasks, StereoEdgels
from .orientation import outward


def recover_curve(
    start: Curve, edgels: StereoEdgels, chosen: EdgelMasks, axis: AxisConstraint | None = None
) -> Curve | None:
    """Fit a curve to chosen edgels, then to all its inliers, until these hardly change.

    Parameters
    ----------
    start : Curve
        Rough; left optical frame, metres.
    edgels : StereoEdgels
        All of both images.
    chosen : two bool arrays
        Edgels of the two images that certainly belong to it.
    axis : AxisConstraint, optional
        An axis that it lies on; it is a circle then.

    Returns
    -------
    Curve or None
        With its edgels, arc, coverage and a normal out of its face; None when it does not fit, or looks like a line.
    """
    curve_edgels = edgels.select(chosen)
    curve = _first_fit(start, curve_edgels, axis)
    if curve is None or curve.rms > settings.WORST_RMS or curve.centre[2] <= 0.0:
        return None
    fitted: EdgelMasks = (np.zeros(0, bool), np.zeros(0, bool))
    for turn in range(settings.CIRCLE_ROUNDS if curve.is_circle else settings.ELLIPSE_ROUNDS):
        wide = turn == 0 or not curve.is_circle
        (on_left, fit_left), (on_right, fit_right) = (
            inliers(curve, side, view, edgels.blur, wide) for side, view in edgels.sides
        )
        if min(fit_left.sum(), fit_right.sum()) < settings.LEAST_CURVE_EDGELS:
            return None
        changed = sum(int((a != b).sum()) for a, b in zip(fitted, (fit_left, fit_right))) if turn else len(edgels.left)
        if changed < settings.SETTLED_SHARE * (fit_left.sum() + fit_right.sum()):
            break
        fitted = (fit_left, fit_right)
        curve_edgels = edgels.select(fitted)
        again = refine(curve, curve_edgels, curve.is_circle, settings.REFIT_ROUNDS, axis)
        if again is None:
            return None
        curve = replace(again, left=on_left, right=on_right)
        if axis is None and curve.is_circle:
            curve = _perhaps_ellipse(curve, curve_edgels)
    if curve.rms > settings.WORST_RMS or any(is_line(curve, view) for _, view in edgels.sides):
        return None
    arc, coverage = visible_arc(curve, curve_edgels)
    return outward(replace(curve, arc=arc, coverage=coverage))


def _first_fit(start: Curve, curve_edgels: StereoEdgels, axis: AxisConstraint | None) -> Curve | None:
    """A circle or, without an axis constraint, the ellipse that fits much better than a circle that fits badly."""
    curve = refine(start, curve_edgels, circle=True, axis=axis)
    if axis is None and (curve is None or curve.rms > settings.GOOD_RMS):
        ellipse = refine(start, curve_edgels, circle=False)
        if ellipse is not None and (curve is None or ellipse.rms * np.sqrt(settings.ELLIPSE_GAIN) < curve.rms):
            return ellipse
    return curve


def _perhaps_ellipse(circle: Curve, curve_edgels: StereoEdgels) -> Curve:
    """An ellipse instead of a circle that fits badly, if the ellipse fits much better and is not nearly round."""
    if circle.rms <= settings.CIRCLE_RMS and circle.misfit <= settings.CIRCLE_MISFIT:
        return circle
    ellipse = refine(circle, curve_edgels, circle=False, rounds=settings.REFIT_ROUNDS)
    if (
        ellipse is not None
        and ellipse.rms**2 * settings.ELLIPSE_GAIN < circle.rms**2
        and ellipse.radii[1] < settings.ELLIPSE_RATIO * ellipse.radii[0]
    ):
        return ellipse
    return circle


def is_line(curve: Curve, view: CameraView) -> bool:
    """Whether a camera sees a curve so flat that all edgels of a straight line would belong to it.

    Parameters
    ----------
    curve : Curve
    view : CameraView

    Returns
    -------
    bool
    """
    sight = curve.centre - view.centre
    distance = float(np.linalg.norm(sight))
    width = view.camera.fx * curve.radii[0] * abs(float(curve.normal @ sight)) / distance**2
    return bool(width < settings.INLIER_DISTANCE)


def is_determined(curve: Curve) -> bool:
    """Whether a curve's own edgels determine its plane and its radius.

    Parameters
    ----------
    curve : Curve

    Returns
    -------
    bool
    """
    return bool(
        curve.coverage > settings.LEAST_COVERAGE
        and curve.tilt < settings.DETERMINED_TILT
        and np.sqrt(curve.covariance[5, 5]) < settings.DETERMINED_RADIUS_SIGMA * curve.radii[0]
    )


def is_reported(curve: Curve) -> bool:
    """Whether a curve is known well enough to be a feature. Others only explain edgels.

    Parameters
    ----------
    curve : Curve

    Returns
    -------
    bool
    """
    most = settings.REPORTED_TILT if curve.coverage > settings.MOSTLY_SEEN else settings.ARC_TILT
    return bool(curve.tilt < most and curve.misfit < settings.REPORTED_MISFIT)
