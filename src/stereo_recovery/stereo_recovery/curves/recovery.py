"""Circles and ellipses in space: one curve fitted to the edgels of both images at once (thesis 3.10.1, 6.4).

Arcs that the matches pair give starts (see :mod:`.initialisation`). Then one curve in space is moved until both its
image conics lie on the edgels: six parameters of a circle, eight of an ellipse, and their covariance.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from msgs_py.numeric.typed import IntArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from ..stopwatch import Late, never
from . import settings
from .axis_constraint import made_parallel, refitted_on_axes
from .curve import Curve, camera_views
from .fit import distances, is_determined, recover_curve, refine
from .initialisation import ArcPair, arc_pairs, back_projected, circles_of_ellipse, plane_of_samples
from .observations import StereoEdgels


def recover_curves(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: StereoEdgels,
    late: Late = never,
) -> list[Curve]:
    """All planar curves of a pair; none shares half of its edgels with another one that was found before.

    First come those that their own edgels determine, by falling number of edgels, first of arcs in both images, then of
    arcs that only one image shows. In the end curves take the axis or the normal of better known ones, and those count
    that are determined then.

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
    list of Curve
        Left optical frame, metres.
    """
    found: list[Curve] = []
    vague: list[tuple[Curve, ArcPair]] = []
    for pair in arc_pairs(matches, segments, ellipses):
        if late():
            break
        curve = None if _is_explained(pair, found) else _free_curve(pair, edgels)
        if curve is None or not _is_clear(curve, pair):
            continue
        if is_determined(curve):
            found.append(curve)
        else:
            vague.append((curve, pair))
    known = [curve for curve in found if curve.tilt < settings.AXIS_TILT]
    found = [refitted_on_axes(curve, known, edgels) for curve in found]
    for curve, pair in vague:
        if not (late() or _is_explained(pair, found)):
            curve = refitted_on_axes(curve, known, edgels)
            if is_determined(curve) and _is_clear(curve, pair):
                found.append(curve)
    return [made_parallel(curve, known) for curve in found]


def _is_explained(pair: ArcPair, curves: Iterable[Curve]) -> bool:
    """Whether one of the curves has most of the edgels, of arcs of both images in both."""
    least = min if pair.is_pair else max
    return any(least(pair.shares_on(curve)) > settings.SHARED_EDGELS for curve in curves)


def _is_clear(curve: Curve, pair: ArcPair) -> bool:
    """Whether a curve has most edgels of its arcs, and one of which only one image shows an arc fits as these state."""
    return (
        (pair.is_pair or (curve.misfit < settings.CIRCLE_MISFIT and curve.rms < settings.GOOD_RMS))
        and curve.coverage > settings.LEAST_COVERAGE
        and min(pair.shares_on(curve)) > settings.MOST_OF_ARC
    )


def _free_curve(pair: ArcPair, edgels: StereoEdgels) -> Curve | None:
    """The curve that a pair of arcs shows, from the best of the starts and from the best in another plane.

    Two planes may fit one arc alike; all the edgels that either curve has decide between them.
    """
    index = _index(pair, edgels)
    if min(len(side) for side in pair.edgels) < settings.LEAST_CURVE_EDGELS:
        return None
    starts = [
        start
        for ellipse, is_right in pair.ellipses
        for start in circles_of_ellipse(ellipse, pair.samples, edgels.rig, is_right)
    ]
    if pair.is_pair:
        plane = plane_of_samples(pair.samples, edgels.rig)
        seen = back_projected(pair.ellipses[0][0], plane, camera_views(edgels.rig)[0])
        starts += [] if seen is None else [seen]
    tried = [refine(start, edgels, index=index, rough=True) for start in starts]
    good = sorted((c for c in tried if c is not None), key=lambda c: c.rms)
    good = [c for c in good if c.rms < settings.INLIER_DISTANCE]
    others = [c for c in good[1:] if abs(c.normal @ good[0].normal) < settings.SAME_PLANE_COSINE]
    curves = [recover_curve(start, edgels, index) for start in good[:1] + others[:1]]
    return _likelier([c for c in curves if c is not None], index, edgels)


def _index(pair: ArcPair, edgels: StereoEdgels) -> IntArray:
    """(k,) int64: the edgels of a pair of arcs by their numbers in ``edgels.seen``."""
    return np.concatenate([pair.edgels[0], pair.edgels[1] + len(edgels.left)])


def _likelier(curves: list[Curve], index: IntArray, edgels: StereoEdgels) -> Curve | None:
    """The curve of least truncated residuals over given edgels and those of all the curves."""
    if len(curves) < 2:
        return curves[0] if curves else None
    masks = [np.concatenate([curve.left, curve.right]) for curve in curves]
    chosen = np.union1d(index, np.flatnonzero(np.any(masks, axis=0)))
    limit = settings.INLIER_SIGMA * np.hypot(edgels.seen.sigma, edgels.seen.bias)[chosen] + settings.GOOD_RMS

    def cost(curve: Curve) -> float:
        return float(np.minimum(np.abs(distances(curve, edgels, chosen)) / limit, 1.0).sum())

    return min(curves, key=cost)
