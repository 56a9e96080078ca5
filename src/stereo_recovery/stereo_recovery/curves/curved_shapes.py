"""Everything round in a pair: curves, the surfaces that they bound, and axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from ..stopwatch import Late, never
from . import settings
from .axes import Axis, find_axes
from .curve import Curve, cross
from .faces import in_face
from .fit import bounds_surface, relative_sigma
from .observations import StereoEdgels
from .occluding_contours import CurvedSurface
from .recovery import VagueCurve, determined, recover_curves


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
    vague : list of VagueCurve
        Which may be curves, but are not known well enough.
    """

    curves: list[Curve]
    reported: list[Curve]
    axes: list[Axis]
    surfaces: list[CurvedSurface]
    vague: list[VagueCurve]

    def in_faces(self, edges: tuple[FloatArray, FloatArray]) -> list[Curve]:
        """The curves of the object, with those that straight edges determine in whose plane they lie.

        Parameters
        ----------
        edges : ((n, 2, 3), (n, 6, 6)) float64
            Ends, metres, and their covariance.
        """
        placed = [each.put(in_face(each.curve, *edges)) for each in self.vague]
        more, rest = determined(sorted(placed, key=lambda each: relative_sigma(each.curve)), self.curves)
        more += determined([each.held_by(more) for each in rest], [*self.curves, *more])[0]
        return distinct([*self.reported, *more])


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
    found = recover_curves(matches, segments, ellipses, edgels, late)
    rims = distinct(found.rims)
    axes, surfaces = find_axes([rim for rim in rims if bounds_surface(rim)], segments, edgels.rig)
    return CurvedShapes([*rims, *found.contours], rims, axes, surfaces, found.vague)


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
        edgels = np.flatnonzero(curve.left), np.flatnonzero(curve.right)
        for k, other in enumerate(kept):
            if _shared(edgels, other) > settings.SHARED_EDGELS or _is_same_rim(curve, other):
                kept[k] = replace(other, left=other.left | curve.left, right=other.right | curve.right)
                break
        else:
            kept.append(curve)
    return kept


def _shared(edgels: tuple[IntArray, IntArray], other: Curve) -> float:
    """Share of a curve's edgels of the two images that another one has as well, in the image where that is larger."""
    masks = other.left, other.right
    return max(float(np.count_nonzero(its[own]) / max(len(own), 1)) for own, its in zip(edgels, masks))


def _is_same_rim(curve: Curve, other: Curve) -> bool:
    """Whether two curves differ by nothing: centres and radii in radii, normals in radians."""
    most = settings.SAME_RIM * float(other.radii[0])
    return (
        math.dist(curve.centre, other.centre) < most
        and float(np.abs(curve.radii - other.radii).max()) < most
        and float(np.linalg.norm(cross(curve.normal, other.normal))) < settings.SAME_RIM
    )
