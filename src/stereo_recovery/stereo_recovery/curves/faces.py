"""Curves in the faces of an object: what the straight edges of a face say of a curve that lies in it.

Of a bore that is seen in part the edgels may tell the centre and leave the normal open; two edges of the face that it
is in tell the normal. Whether it is in their plane is a question of likelihoods: of how far the edges' middles are from
the curve's plane, and how far their ends are beside that. If the curve has nothing to do with them, the component along
any direction of a vector of length d is uniform between -d and d (Archimedes); if it is in their plane, it is normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import FloatArray, IntArray

from . import settings
from .agreement import likeliest
from .axis_constraint import updated
from .curve import Curve


class Offsets(NamedTuple):
    """How far n edges are from a curve's plane.

    Attributes
    ----------
    off : (n, 2) float64, metres
        Of their middles, and half the difference of their ends'.
    slope : (n, 2, 6) float64
        Derivatives by the curve's parameters.
    covariance : (n, 2, 2) float64
        By the edges' own errors, and by what keeps faces from being planes.
    """

    off: FloatArray
    slope: FloatArray
    covariance: FloatArray


def in_face(curve: Curve, ends: FloatArray, covariance: FloatArray) -> Curve:
    """A curve updated by the two edges in whose plane it most likely lies; itself, where it lies in no such plane.

    Parameters
    ----------
    curve : Curve
        Left optical frame, metres.
    ends : (n, 2, 3) float64, metres
        Straight edges.
    covariance : (n, 6, 6) float64, square metres
        Of both ends together.

    Returns
    -------
    Curve
    """
    near = _nearest(curve, ends)
    if len(near) < 2:
        return curve
    ends, offsets = ends[near], offsets_of(curve, ends[near], covariance[near])
    first, second = np.triu_indices(len(near), 1)
    off = np.concatenate([offsets.off[first], offsets.off[second]], axis=1)
    slope = np.concatenate([offsets.slope[first], offsets.slope[second]], axis=1)
    spread = slope @ curve.covariance @ slope.swapaxes(1, 2)
    spread[:, :2, :2] += offsets.covariance[first]
    spread[:, 2:, 2:] += offsets.covariance[second]
    best = likeliest(off, spread, _log_ranges(curve, ends, (first, second), np.linalg.inv(spread)[:, 3, 3]))
    return curve if best is None else updated(curve, off[best], slope[best], spread[best])


def offsets_of(curve: Curve, ends: FloatArray, covariance: FloatArray) -> Offsets:
    """How far edges (n, 2, 3), metres, with the covariance (n, 6, 6) of their ends, are from a curve's plane."""
    run = ends - curve.centre
    slope = np.zeros((len(ends), 2, 6))
    slope[..., :3] = -curve.normal
    slope[..., 3], slope[..., 4] = run @ curve.second, -run @ curve.first
    along = np.zeros((2, 6))
    along[0, :3] = along[1, 3:] = curve.normal
    flat = (settings.TURNED_SIGMA * np.linalg.norm(run, axis=2)) ** 2
    own = along @ covariance @ along.T + flat[..., None] * np.eye(2)
    middle_and_half = np.array([[0.5, 0.5], [-0.5, 0.5]])
    off = (run @ curve.normal) @ middle_and_half.T
    return Offsets(off, middle_and_half @ slope, middle_and_half @ own @ middle_and_half.T)


def _nearest(curve: Curve, ends: FloatArray) -> IntArray:
    """(k,) int64: the edges that come nearest to a curve's centre, MOST_FACE_EDGES at most."""
    distance = _distance(curve.centre[None, None], ends)[0]
    return np.sort(np.argsort(distance, kind='stable')[: settings.MOST_FACE_EDGES])


def _distance(points: FloatArray, ends: FloatArray) -> FloatArray:
    """(m, n) float64, metres: from points (m, 1, 3) to edges (n, 2, 3)."""
    run = ends[:, 1] - ends[:, 0]
    share = ((points - ends[:, 0]) * run).sum(axis=2) / np.maximum((run**2).sum(axis=1), NOT_ZERO)
    foot = ends[:, 0] + np.clip(share, 0.0, 1.0)[..., None] * run
    return np.asarray(np.linalg.norm(points - foot, axis=2))


def _log_ranges(curve: Curve, ends: FloatArray, pairs: tuple[IntArray, IntArray], precision: FloatArray) -> FloatArray:
    """(p,) float64: logarithm of the volume of offsets that pairs of edges may have from a plane that is not theirs.

    The second edge's middle is no farther from it than the first edge is, or its own distance from the first. Its ends
    tell as much more as it is turned against the first, and a parallel edge's tell nothing: their offset is that which
    is expected, up to its own error. precision : (p,) of that offset, where all others are given
    """
    first, second = pairs
    middle, run = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(run, axis=1)
    away = np.linalg.norm(middle - curve.centre, axis=1)
    apart = np.minimum(away[second], _distance(middle[:, None], ends)[second, first])
    turned = np.linalg.norm(np.cross(run[first], run[second]), axis=1) / np.maximum(length[first], NOT_ZERO)
    ranges = np.stack(
        [2.0 * away[first], length[first], 2.0 * apart, np.maximum(turned, np.sqrt(2.0 * np.pi / precision))]
    )
    return np.asarray(np.log(np.maximum(ranges, NOT_ZERO)).sum(axis=0))
