"""Where an edge runs smoothly into an arc: it ends at the point at which it touches the circle (thesis 3.10.3).

A picture does not show the place: line and arc part by less than a pixel over many. Their geometry does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray

from ..curves.curve import Curve

# How far from the circle's plane and from touching it, in radii beside three sigma, an edge may be.
SLACK = 0.03
# An end this near to the touching point, in radii along the edge, is it; an edge that goes on past it ends elsewhere.
NEAR = 0.5


def joined_ends(
    ends: AnyArray, covariance: AnyArray, err_per: AnyArray, curves: Sequence[Curve]
) -> tuple[AnyArray, AnyArray]:
    """Ends of edges with those that run into a circle put to the touching point, and their covariance.

    Parameters
    ----------
    ends : (n, 2, 3) float64, metres
    covariance : (n, 6, 6) float64, square metres
    err_per : (n,) float64, metres
        Three sigma across.
    curves : sequence of Curve
    """
    ends, covariance = ends.copy(), covariance.copy()
    for curve in curves:
        radius = curve.radii[0]
        if radius != curve.radii[1] or len(ends) == 0:
            continue
        run = ends[:, 1] - ends[:, 0]
        length = np.maximum(np.linalg.norm(run, axis=1), NOT_ZERO)
        along = run / length[:, None]
        from_start = curve.centre - ends[:, 0]
        place = (from_start * along).sum(axis=1)
        across = np.linalg.norm(from_start - place[:, None] * along, axis=1)
        slack = SLACK * radius + err_per + 3.0 * np.sqrt(np.trace(curve.covariance[:3, :3]))
        flat = (np.abs((ends - curve.centre) @ curve.normal) < slack[:, None]).all(axis=1)
        touches = flat & (np.abs(across - radius) < slack) & (slack < 0.5 * radius)
        for k in np.flatnonzero(touches):
            which = int(place[k] > 0.5 * length[k])
            gap = abs(place[k] - which * length[k])
            # The arc has to go on from there, and the edge has to be more than its last bit.
            spoke = ends[k, 0] + place[k] * along[k] - curve.centre
            onward = spoke / across[k] + (along[k] if which else -along[k])
            if gap < NEAR * radius and length[k] > 2.0 * gap and _is_seen(curve, onward):
                ends[k, which] = ends[k, 0] + place[k] * along[k]
                own = along[k] @ covariance[k, 3 * which : 3 * which + 3, 3 * which : 3 * which + 3] @ along[k]
                on_curve = along[k] @ curve.covariance[:3, :3] @ along[k]
                covariance[k] = _moved_end(covariance[k], which, place[k] / length[k], along[k], max(own, on_curve))
    return ends, covariance


def _moved_end(covariance: AnyArray, which: int, share: float, along: AnyArray, variance: float) -> AnyArray:
    """(6, 6): covariance of both ends when end 0 or 1 is moved on their line to a share of it, known so well along."""
    here = slice(3 * which, 3 * which + 3)
    across = np.eye(3) - np.outer(along, along)
    turn = np.eye(6)
    turn[here] = across @ np.hstack([(1.0 - share) * np.eye(3), share * np.eye(3)])
    moved: AnyArray = turn @ covariance @ turn.T
    moved[here, here] += variance * np.outer(along, along)
    return moved


def _is_seen(curve: Curve, towards: AnyArray) -> bool:
    """Whether the curve's visible arc holds the point in this direction from the centre."""
    angle = np.arctan2(towards @ curve.second, towards @ curve.first)
    start, extent = curve.arc
    return bool((angle - start) % (2.0 * np.pi) < extent)
