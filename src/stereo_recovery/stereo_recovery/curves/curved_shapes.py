"""Everything round in a pair: curves, the surfaces that they bound, and axes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from ..stopwatch import Late, never
from . import settings
from .axes import Axis, find_axes
from .curve import Curve, cross
from .fit import bounds_surface
from .observations import StereoEdgels
from .occluding_contours import CurvedSurface
from .recovery import recover_curves
from .spheres import without_spheres


@dataclass(frozen=True, eq=False)
class CurvedShapes:
    """Curves, axes and curved surfaces of a pair, left optical frame, metres.

    Attributes
    ----------
    curves : list of Curve
        All that were found, contours of spheres included, which explain edgels.
    reported : list of Curve
        Those that are curves of the object.
    axes : list of Axis
        Of those that are known well enough.
    surfaces : list of CurvedSurface
        That any of these may bound.
    """

    curves: list[Curve]
    reported: list[Curve]
    axes: list[Axis]
    surfaces: list[CurvedSurface]


def recover_curved_shapes(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: StereoEdgels,
    late: Late = never,
) -> CurvedShapes:
    """Find all curves, their axes and surfaces.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the left and of the right image.
    ellipses : (list of Ellipse, list of Ellipse)
        The arcs of the images, by the numbers in the segments' field ``arc``.
    edgels : StereoEdgels
        All edgels of chains, in the order to which the segments refer.
    late : callable
        Whether it is too late to look for another curve.

    Returns
    -------
    CurvedShapes
    """
    curves = distinct(recover_curves(matches, segments, ellipses, edgels, late))
    rims = without_spheres(curves, edgels)
    axes, surfaces = find_axes([rim for rim in rims if bounds_surface(rim)], segments, edgels.rig)
    return CurvedShapes(curves, rims, axes, surfaces)


def distinct(curves: list[Curve]) -> list[Curve]:
    """The curves without those that are another one again, found from another part of it.

    The one on more edgels stays and takes the other's edgels, so that no segment on them counts as an edge.

    Parameters
    ----------
    curves : list of Curve

    Returns
    -------
    list of Curve
        By falling number of edgels.
    """
    kept: list[Curve] = []
    for curve in sorted(curves, key=lambda c: -int(c.left.sum() + c.right.sum())):
        for k, other in enumerate(kept):
            turn = np.linalg.norm(cross(curve.normal, other.normal))
            apart = np.append(np.linalg.norm(curve.centre - other.centre), np.abs(curve.radii - other.radii))
            if max(turn, apart.max() / other.radii[0]) < settings.SAME_RIM:
                kept[k] = replace(other, left=other.left | curve.left, right=other.right | curve.right)
                break
        else:
            kept.append(curve)
    return kept
