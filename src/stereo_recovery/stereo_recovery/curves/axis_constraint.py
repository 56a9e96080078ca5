"""Curves that take their axis, or the direction of their normal alone, from better known ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msgs_py.numeric.typed import FloatArray

from . import fit_kernels, settings
from .curve import Curve, CurveShape, cross, perpendicular
from .fit import recover_curve
from .fit_kernels import Axis
from .observations import StereoEdgels


@dataclass(frozen=True, eq=False)
class AxisConstraint:
    """An axis on which the centre of a curve lies and along which its normal points, left optical frame.

    Parameters
    ----------
    point, direction : (3,) float64
        A point of the axis, metres, and its unit direction.
    point_covariance : (3, 3) float64, m^2
        Of the point.
    tilt : float
        Radians. Sigma of the direction.
    """

    point: FloatArray
    direction: FloatArray
    point_covariance: FloatArray
    tilt: float

    @classmethod
    def of(cls, curve: Curve) -> AxisConstraint:
        """The axis of a curve: through its centre along its normal."""
        eccentricity = (settings.COAXIALITY_SIGMA * curve.radii[0]) ** 2 * np.eye(3)
        tilt = float(np.hypot(curve.tilt, settings.COAXIALITY_SIGMA))
        return cls(curve.centre, curve.normal, curve.covariance[:3, :3] + eccentricity, tilt)

    @classmethod
    def direction_of(cls, curve: Curve) -> AxisConstraint:
        """The normal of a curve, for curves that may be parallel to it: the sigma of the axis' position is a metre."""
        return cls(curve.centre, curve.normal, np.eye(3), float(np.hypot(curve.tilt, settings.PARALLELISM_SIGMA)))

    @cached_property
    def for_kernels(self) -> Axis:
        """For the compiled functions."""
        first = perpendicular(self.direction)
        first = first / np.linalg.norm(first)
        across = np.stack([first, cross(self.direction, first)])
        frame = np.concatenate([[self.point, self.direction], across])
        return Axis(frame, across @ self.point_covariance @ across.T, self.tilt)

    def innovation(self, curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What an axis says of a curve, and what the curve says of that.

        Returns
        -------
        off : (4,) float64
            Two tilts of the curve's normal, radians, and two offsets of its centre, metres.
        slope : (4, 6) float64
            Derivatives by the curve's parameters.
        covariance : (4, 4) float64
            Of ``off``, the curve's own included.
        """
        point, direction, *across = self.for_kernels.frame
        sign = np.sign(direction @ curve.normal)
        off, slope, covariance = np.zeros(4), np.zeros((4, 6)), self.tilt**2 * np.eye(4)
        off[:2], off[2:] = sign * (across @ curve.normal), across @ (curve.centre - point)
        slope[:2, 3], slope[:2, 4] = sign * (across @ curve.second), -sign * (across @ curve.first)
        slope[2:, :3] = across
        covariance[2:, 2:] *= ((curve.centre - point) @ direction) ** 2
        covariance[2:, 2:] += self.for_kernels.spread
        return off, slope, covariance + slope @ curve.covariance @ slope.T

    def chi2(self, curve: Curve) -> float:
        """How far a curve is from the axis: four degrees of freedom."""
        off, _, covariance = self.innovation(curve)
        return float(off @ np.linalg.solve(covariance, off))


def refitted_on_axes(curve: Curve, known: list[Curve], edgels: StereoEdgels) -> Curve:
    """A circle refitted on the axis of a better known curve, if it lies on one; else the curve itself."""
    best = curve
    for other in known:
        axis = AxisConstraint.of(other)
        if curve.is_circle and axis.tilt < curve.tilt and axis.chi2(curve) < settings.AXIS_CHI2:
            index = np.flatnonzero(np.concatenate([curve.left, curve.right]))
            again = recover_curve(curve, edgels, index, axis.for_kernels)
            if again is not None and again.tilt < best.tilt and again.rms < settings.ELLIPSE_GAIN * curve.rms:
                best = again
    return best


def made_parallel(curve: Curve, known: list[Curve]) -> Curve:
    """A circle updated by the normal of a better known curve to which it may be parallel.

    This is one Kalman update with the covariance, not a new fit: displacements that all its edgels share are in the
    covariance, but not in the weights of a fit.
    """
    for other in sorted(known, key=lambda c: c.tilt):
        axis = AxisConstraint.direction_of(other)
        if not curve.is_circle or axis.tilt > curve.tilt:
            break
        off, slope, innovation = (part[:2] for part in axis.innovation(curve))
        inverse = np.linalg.inv(innovation[:, :2])
        if off @ inverse @ off > settings.PARALLELISM_CHI2:
            continue
        gain = curve.covariance @ slope.T @ inverse
        step = -gain @ off
        growth = np.log1p(max(step[5] / curve.radii[0], -0.5))
        shape = fit_kernels.moved(curve.shape, np.array([*step[:5], growth, growth, 0.0]), True)
        covariance = curve.covariance - gain @ slope @ curve.covariance
        moved = curve.with_shape(CurveShape(*shape))
        return replace(moved, covariance=0.5 * (covariance + covariance.T))
    return curve
