"""The axis of a well-known curve as a constraint on the fit of another one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py.numeric.typed import FloatArray

from . import settings
from .curve import Curve, cross, perpendicular


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

    @property
    def table(self) -> FloatArray:
        """(4, 3) float64: point, direction, two directions across it."""
        return np.concatenate([[self.point, self.direction], self._across])

    def residual(self, curve: Curve) -> FloatArray:
        """(4,) float64: two tilts of the curve's normal, radians, and two offsets of its centre, metres."""
        across = self._across
        tilts = across @ curve.normal * np.sign(self.direction @ curve.normal)
        return np.concatenate([tilts, across @ (curve.centre - self.point)])

    def jacobian(self, normal: FloatArray, first: FloatArray) -> FloatArray:
        """(4, 5) float64: derivatives of the residual by a curve's centre and its two tilts."""
        rows = np.zeros((4, 5))
        sign = np.sign(self.direction @ normal)
        rows[:2, 3], rows[:2, 4] = sign * self._across @ cross(normal, first), -sign * self._across @ first
        rows[2:, :3] = self._across
        return rows

    def covariance(self, centre: FloatArray) -> FloatArray:
        """(4, 4) float64: covariance of the residual of a curve at this centre that the axis causes."""
        result = np.zeros((4, 4))
        result[:2, :2] = self.tilt**2 * np.eye(2)
        distance = (centre - self.point) @ self.direction
        result[2:, 2:] = self._across @ self.point_covariance @ self._across.T + (self.tilt * distance) ** 2 * np.eye(2)
        return result

    @cached_property
    def _across(self) -> FloatArray:
        """(2, 3) float64: two unit directions square to the axis and to one another."""
        first = perpendicular(self.direction)
        first = first / np.linalg.norm(first)
        return np.stack([first, cross(self.direction, first)])
