"""Curves on one axis, in one plane, or in parallel ones: whether they are, and what the better known one says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.robust import outlying
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray

from . import fit_kernels, settings
from .agreement import agrees, chi_squared, likeliest
from .curve import Curve, CurveShape
from .settings import TURNED_SIGMA

# Of what :func:`off_axis_and_plane` tells: both tilts, and the offset from the plane.
IN_PLANE = np.array([0, 1, 4])


def off_axis_and_plane(known: Curve, curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far a curve is from the axis of another one, through its centre along its normal, and from its plane.

    Parameters
    ----------
    known, curve : Curve
        Left optical frame, metres.

    Returns
    -------
    off : (5,) float64
        Two tilts of the curve's normal, radians, and three offsets of its centre, metres: two from the axis, and one
        from the plane.
    slope : (5, 6) float64
        Derivatives by the curve's parameters.
    covariance : (5, 5) float64
        Of ``off`` by all that is uncertain: both curves, and how exactly parts of one thing are turned.
    """
    covariances = (np.ascontiguousarray(each.covariance, dtype=np.float64) for each in (known, curve))
    off, slope, covariance = _offsets(known.shape, curve.shape, *covariances)
    return off, slope, covariance


@njit
def _offsets(
    known: CurveShape, curve: CurveShape, of_known: FloatArray, of_curve: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of shapes and their covariances (6, 6)."""
    second, run = np.cross(known.normal, known.first), curve.centre - known.centre
    own_second = np.cross(curve.normal, curve.first)
    sign = 1.0 if (known.normal * curve.normal).sum() >= 0.0 else -1.0
    radius, away = known.radii[0], (run * run).sum()
    variance = np.array([1.0, 1.0, radius**2, radius**2, away]) * TURNED_SIGMA**2
    off, slope, known_slope = np.empty(5), np.zeros((5, 6)), np.zeros((5, 6))
    # A tilt of the known curve turns its axis about its centre, and its plane.
    known_slope[0, 4], known_slope[1, 3] = 1.0, -1.0
    off[4] = (run * known.normal).sum()
    for k in range(2):
        across = known.first if k == 0 else second
        off[k], off[2 + k] = sign * (across * curve.normal).sum(), (across * run).sum()
        slope[k, 3], slope[k, 4] = sign * (across * own_second).sum(), -sign * (across * curve.first).sum()
        slope[2 + k, :3], known_slope[2 + k, :3] = across, -across
        known_slope[2 + k, 3:5] = off[4] * known_slope[k, 3:5]
    slope[4, :3], known_slope[4, :3] = known.normal, -known.normal
    known_slope[4, 3], known_slope[4, 4] = off[3], -off[2]
    covariance = known_slope @ of_known @ known_slope.T + slope @ of_curve @ slope.T + np.diag(variance)
    return off, slope, covariance


def is_coaxial(known: Curve, curve: Curve) -> bool:
    """Whether two curves may lie on one axis, up to what makes no other curve of one."""
    off, _, covariance = (part[:4] for part in off_axis_and_plane(known, curve))
    same = (settings.SAME_RIM / BOUND_SIGMA) ** 2 * np.array([1.0, 1.0, known.radii[0] ** 2, known.radii[0] ** 2])
    return agrees(off, covariance[:, :4] + np.diag(same))


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
    off, slope, covariance = _off_each(curve, known)
    # All four numbers of an axis, else the two of its direction.
    for n in (4, 2):
        agree = np.flatnonzero(chi_squared(off[:, :n], covariance[:, :n, :n]) < outlying(n))
        if len(agree):
            best = agree[0]
            return updated(curve, off[best, :n], slope[best, :n], covariance[best, :n, :n])
    return curve


def in_plane(curve: Curve, known: Sequence[Curve]) -> Curve:
    """A circle updated by the plane of the known curve in whose plane it most likely lies; itself, where in none.

    As in :mod:`.faces`: where it has nothing to do with the known curve, its normal is any, and its offset from the
    plane uniform up to the distance of the centres.

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
    off, slope, covariance = _off_each(curve, known)
    away = np.linalg.norm(off[:, 2:], axis=1)
    off, slope, covariance = off[:, IN_PLANE], slope[:, IN_PLANE], covariance[:, IN_PLANE][:, :, IN_PLANE]
    best = likeliest(off, covariance, np.log(2.0 * np.pi * 2.0 * away))
    return curve if best is None else updated(curve, off[best], slope[best], covariance[best])


def _off_each(curve: Curve, known: Sequence[Curve]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(k, 5), (k, 5, 6), (k, 5, 5): :func:`off_axis_and_plane` of those of known curves that say something of one."""
    each = [off_axis_and_plane(other, curve) for other in _better(curve, known)]
    off, slope, covariance = ([parts[k] for parts in each] for k in range(3))
    return np.reshape(off, (-1, 5)), np.reshape(slope, (-1, 5, 6)), np.reshape(covariance, (-1, 5, 5))


def _better(curve: Curve, known: Sequence[Curve]) -> list[Curve]:
    """Those of known curves that say something of a circle, the best known normal first."""
    return sorted((c for c in known if c.tilt < curve.tilt), key=lambda c: c.tilt) if curve.is_circle else []


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
