"""Curves on one axis, or in parallel planes: whether they are, and what the better known one says of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray

from . import fit_kernels, settings
from .agreement import agrees
from .curve import Curve, CurveShape


def off_axis(known: Curve, curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far a curve is from the axis of another one: through its centre, along its normal.

    Parameters
    ----------
    known, curve : Curve
        Left optical frame, metres.

    Returns
    -------
    off : (4,) float64
        Two tilts of the curve's normal, radians, and two offsets of its centre, metres.
    slope : (4, 6) float64
        Derivatives by the curve's parameters.
    covariance : (4, 4) float64
        Of ``off`` by all that is uncertain: both curves, and how exactly parts of one thing are turned.
    """
    across, run = np.stack([known.first, known.second]), curve.centre - known.centre
    sign = 1.0 if known.normal @ curve.normal >= 0.0 else -1.0
    off = np.concatenate([sign * (across @ curve.normal), across @ run])
    slope, of_known = np.zeros((4, 6)), np.zeros((4, 6))
    slope[:2, 3], slope[:2, 4] = sign * (across @ curve.second), -sign * (across @ curve.first)
    slope[2:, :3] = across
    # A tilt of the known curve turns its axis about its centre.
    of_known[0, 4], of_known[1, 3] = 1.0, -1.0
    of_known[2:, 3:5] = (run @ known.normal) * of_known[:2, 3:5]
    of_known[2:, :3] = -across
    turned = settings.TURNED_SIGMA**2 * np.array([1.0, 1.0, known.radii[0] ** 2, known.radii[0] ** 2])
    return off, slope, of_known @ known.covariance @ of_known.T + slope @ curve.covariance @ slope.T + np.diag(turned)


def is_coaxial(known: Curve, curve: Curve) -> bool:
    """Whether two curves may lie on one axis, up to what makes no other curve of one."""
    off, _, covariance = off_axis(known, curve)
    same = (settings.SAME_RIM / BOUND_SIGMA) ** 2 * np.array([1.0, 1.0, known.radii[0] ** 2, known.radii[0] ** 2])
    return agrees(off, covariance + np.diag(same))


def held(curve: Curve, known: Sequence[Curve]) -> Curve:
    """A circle updated by the axis, else by the normal, of the best known curve that may share it.

    This is one Kalman update with the covariance, not a new fit: displacements that all its edgels share are in the
    covariance, but not in the weights of a fit.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    known : sequence of Curve
        Those that are not as well known as the curve itself, say nothing of it.

    Returns
    -------
    Curve
    """
    better = [] if not curve.is_circle else sorted((c for c in known if c.tilt < curve.tilt), key=lambda c: c.tilt)
    # All four numbers of an axis, else the two of its direction.
    for numbers in (4, 2):
        for other in better:
            off, slope, covariance = (part[:numbers] for part in off_axis(other, curve))
            if agrees(off, covariance[:, :numbers]):
                return updated(curve, off, slope, covariance[:, :numbers])
    return curve


def updated(curve: Curve, off: FloatArray, slope: FloatArray, covariance: FloatArray) -> Curve:
    """A curve moved by one Kalman update; the ratio of its radii stays.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    off : (m,) float64
        What should be zero.
    slope : (m, 6) float64
        Derivatives by the curve's parameters.
    covariance : (m, m) float64
        Of ``off``, by the curve's own error and by all others.

    Returns
    -------
    Curve
    """
    gain = curve.covariance @ slope.T @ np.linalg.inv(covariance)
    step = -gain @ off
    growth = step[5] / curve.radii[0]
    shape = fit_kernels.moved(curve.shape, np.array([*step[:5], growth, growth, 0.0]), True)
    spread = curve.covariance - gain @ slope @ curve.covariance
    return replace(curve.with_shape(CurveShape(*shape)), covariance=0.5 * (spread + spread.T))
