"""Where an edge runs smoothly into an arc: it ends at the point at which it touches the circle (thesis 3.10.3).

A picture does not show the place: line and arc part by less than a pixel over many. Their geometry does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..curves.curve import Curve

# How far from the circle's plane and from touching it, in radii beside three sigma, an edge may be.
SLACK = 0.03
# An end this near to the touching point, in radii along the edge, is it; an edge that goes on past it ends elsewhere.
NEAR = 0.5


def joined_ends(
    ends: AnyArray, err_par: AnyArray, err_per: AnyArray, curves: Sequence[Curve]
) -> tuple[AnyArray, AnyArray]:
    """Ends of edges (n, 2, 3), metres, with those that run into a circle put to the touching point, and err_par (n,).

    err_par, err_per : (n,) metres, three sigma along and across.
    """
    ends, err_par = ends.copy(), err_par.copy()
    for curve in curves:
        radius = curve.radii[0]
        if radius != curve.radii[1] or len(ends) == 0:
            continue
        run = ends[:, 1] - ends[:, 0]
        length = np.maximum(np.linalg.norm(run, axis=1), 1e-12)
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
                err_par[k] = max(err_par[k], 3.0 * float(np.sqrt(along[k] @ curve.covariance[:3, :3] @ along[k])))
    return ends, err_par


def _is_seen(curve: Curve, towards: AnyArray) -> bool:
    """Whether the curve's visible arc holds the point in this direction from the centre."""
    angle = np.arctan2(towards @ curve.second, towards @ curve.first)
    start, extent = curve.arc
    return bool((angle - start) % (2.0 * np.pi) < extent)
