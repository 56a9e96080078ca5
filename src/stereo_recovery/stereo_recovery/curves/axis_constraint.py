"""Curves on one axis, in one plane, or in parallel ones: whether they are, and what the better known one says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray

from . import fit_kernels, settings
from .agreement import agrees
from .curve import Curve, CurveShape


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
    across, run = np.stack([known.first, known.second]), curve.centre - known.centre
    sign = 1.0 if known.normal @ curve.normal >= 0.0 else -1.0
    off = np.concatenate([sign * (across @ curve.normal), across @ run, [run @ known.normal]])
    slope, of_known = np.zeros((5, 6)), np.zeros((5, 6))
    slope[:2, 3], slope[:2, 4] = sign * (across @ curve.second), -sign * (across @ curve.first)
    slope[2:4, :3], slope[4, :3] = across, known.normal
    # A tilt of the known curve turns its axis about its centre, and its plane.
    of_known[0, 4], of_known[1, 3] = 1.0, -1.0
    of_known[2:4, 3:5] = off[4] * of_known[:2, 3:5]
    of_known[4, 3], of_known[4, 4] = off[3], -off[2]
    of_known[2:, :3] = -slope[2:, :3]
    radius = known.radii[0]
    turned = settings.TURNED_SIGMA**2 * np.array([1.0, 1.0, radius**2, radius**2, run @ run])
    return off, slope, of_known @ known.covariance @ of_known.T + slope @ curve.covariance @ slope.T + np.diag(turned)


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
    better = _better(curve, known)
    # All four numbers of an axis, else the two of its direction.
    for numbers in (4, 2):
        for other in better:
            off, slope, covariance = (part[:numbers] for part in off_axis_and_plane(other, curve))
            if agrees(off, covariance[:, :numbers]):
                return updated(curve, off, slope, covariance[:, :numbers])
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
    numbers = np.array([0, 1, 4])
    best, result = settings.FACE_LOG_ODDS, curve
    for other in _better(curve, known):
        off, slope, covariance = off_axis_and_plane(other, curve)
        off, slope, covariance = off[numbers], slope[numbers], covariance[np.ix_(numbers, numbers)]
        in_it = -0.5 * (off @ np.linalg.solve(covariance, off) + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
        anywhere = np.log(2.0 * np.pi * 2.0 * np.linalg.norm(curve.centre - other.centre))
        log_odds = in_it + anywhere + np.log(settings.FACE_PRIOR / len(known))
        if log_odds > best and agrees(off, covariance):
            best, result = log_odds, updated(curve, off, slope, covariance)
    return result


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
