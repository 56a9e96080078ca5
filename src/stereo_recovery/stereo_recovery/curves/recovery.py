"""Circles and ellipses in space: one curve fitted to the edgels of both images at once (thesis 3.10.1, 6.4).

Arcs that the matches pair give starts (see :mod:`.initialisation`). Then one curve in space is moved until both its
image conics lie on the edgels: six parameters of a circle, eight of an ellipse, and their covariance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.threads import spread

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from ..stopwatch import Late, never
from . import fit_kernels, settings, start_kernels
from .axis_constraint import held, in_plane, is_coaxial
from .coaxial_starts import coaxial_starts
from .curve import Curve
from .fit import bounds_surface, has_size, is_determined, of_fit
from .initialisation import ArcPair, arc_pairs
from .observations import StereoEdgels
from .spheres import without_spheres

NO_SAMPLES = np.zeros((0, 3))


class VagueCurve(NamedTuple):
    """A curve whose own edgels do not determine it.

    Attributes
    ----------
    curve : Curve
    arcs : ArcPair
        Which show it.
    placed : bool
        Whether it lies in the plane of known ones, by odds that chance does not give.
    """

    curve: Curve
    arcs: ArcPair
    placed: bool = False

    def put(self, curve: Curve) -> VagueCurve:
        """The same where a plane puts it, which says nothing where it leaves the curve itself."""
        return VagueCurve(curve, self.arcs, self.placed or curve is not self.curve)

    def held_by(self, known: Sequence[Curve]) -> VagueCurve:
        """The same as better known curves hold it: see :func:`.axis_constraint.held`."""
        return self._replace(curve=held(self.curve, known))


class Found(NamedTuple):
    """What :func:`recover_curves` finds; left optical frame, metres.

    Attributes
    ----------
    rims : list of Curve
        Curves of the object.
    contours : list of Curve
        Of spheres, which explain edgels and are no curves of the object.
    vague : list of VagueCurve
        What nothing determines.
    """

    rims: list[Curve]
    contours: list[Curve]
    vague: list[VagueCurve]


def recover_curves(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: StereoEdgels,
    late: Late = never,
) -> Found:
    """All planar curves of a pair; none shares half of its edgels with another one that was found before.

    First come those that their own edgels determine, by falling evidence, then what lies on the axes of these. In the
    end curves take the axis, the plane or the normal of better known ones, and those count that are determined then.
    Contours of spheres are told from those that their own edgels determine, and have no axis and no plane to give: a
    curve that has them from another is none.

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
        Whether it is too late to look at another arc.

    Returns
    -------
    Found
    """
    found: list[Curve] = []
    vague: list[VagueCurve] = []
    pairs = arc_pairs(matches, segments, ellipses)
    fits = spread(lambda pair: None if late() else _free_curve(pair, edgels), pairs)
    clear = [(curve, pair) for curve, pair in zip(fits, pairs) if curve is not None and _is_clear(curve, pair)]
    for curve, pair in sorted(clear, key=lambda one: -one[0].evidence):
        if _is_explained(pair, found):
            continue
        if is_determined(curve):
            found.append(curve)
        else:
            vague.append(VagueCurve(curve, pair))
    rims = without_spheres(found, edgels)
    contours = [curve for curve in found if curve not in rims]
    rims += _on_known_axes(rims, found, segments, edgels, late)
    if vague and late():
        vague = []
    placed = [each.put(in_plane(each.curve, rims)) for each in vague]
    more, vague = determined([each.held_by(rims) for each in placed], [*rims, *contours])
    return Found([held(curve, rims) for curve in rims] + more, contours, vague)


def determined(vague: Sequence[VagueCurve], found: Sequence[Curve]) -> tuple[list[Curve], list[VagueCurve]]:
    """Those of some curves that are known well enough, without what others explain, and the rest.

    What lies in a known plane is there, so that its size need not be known better than to be one.
    """
    more: list[Curve] = []
    left = []
    for each in vague:
        if not _is_explained(each.arcs, [*found, *more]):
            if is_determined(each.curve) or (each.placed and has_size(each.curve)):
                more.append(each.curve)
            else:
                left.append(each)
    return more, left


def _on_known_axes(
    rims: Sequence[Curve], found: Sequence[Curve], segments: tuple[Segments, Segments], edgels: StereoEdgels, late: Late
) -> list[Curve]:
    """Further curves on the axes of some, that their own edgels determine, beside all that were found."""
    more: list[Curve] = []
    axes: list[Curve] = []
    left, right = (np.logical_or.reduce([getattr(c, side) for c in found]) for side in ('left', 'right'))
    for known in sorted(filter(bounds_surface, rims), key=lambda curve: curve.tilt):
        if late() or not known.is_circle or any(is_coaxial(axis, known) for axis in axes):
            continue
        axes.append(known)
        for start, near in coaxial_starts(known, segments, (left, right), edgels):
            masks = edgels.masks(near)
            arcs = ArcPair((np.flatnonzero(masks[0] & ~left), np.flatnonzero(masks[1] & ~right)), [], NO_SAMPLES, True)
            if min(len(side) for side in arcs.edgels) < settings.LEAST_CURVE_EDGELS:
                continue
            curve = of_fit(fit_kernels.recovered(start, edgels.seen, arcs.index(edgels)), edgels)
            if curve is not None and is_determined(curve) and is_coaxial(known, curve) and _is_clear(curve, arcs):
                more.append(curve)
                left, right = left | curve.left, right | curve.right
    return more


def _is_explained(pair: ArcPair, curves: Iterable[Curve]) -> bool:
    """Whether one of the curves has most of the edgels, of arcs of both images in both."""
    least = min if pair.is_pair else max
    return any(least(pair.shares_on(curve)) > settings.SHARED_EDGELS for curve in curves)


def _is_clear(curve: Curve, pair: ArcPair) -> bool:
    """Whether a curve has most edgels of its arcs, and most of its own arc has edgels.

    One of which only one image shows an arc has to fit as its edgels state.
    """
    return (
        (pair.is_pair or curve.misfit < 1.0)
        and min(pair.shares_on(curve)) > settings.SHARED_EDGELS
        and 2.0 * np.pi * curve.coverage > settings.SHARED_EDGELS * curve.arc[1]
    )


def _free_curve(pair: ArcPair, edgels: StereoEdgels) -> Curve | None:
    """The curve that a pair of arcs shows."""
    if min(len(side) for side in pair.edgels) < settings.LEAST_CURVE_EDGELS or len(pair.samples) == 0:
        return None
    conics = np.stack([ellipse.conic for ellipse, _ in pair.ellipses])
    sides = np.array([int(is_right) for _, is_right in pair.ellipses])
    return of_fit(start_kernels.free_curve(conics, sides, pair.samples, pair.index(edgels), edgels.seen), edgels)
