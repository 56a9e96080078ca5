"""Circles and ellipses in space: one curve fitted to the edgels of both images at once (thesis 3.10.1, 6.4).

Arcs that the matches pair give starts (see :mod:`.initialisation`). Then one curve in space is moved until both its
image conics lie on the edgels: six parameters of a circle, eight of an ellipse, and their covariance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import FloatArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.matches import Matches
from ..stopwatch import Late, never
from . import settings
from .constrained_fit import AxisOf, axes_of, circle_on_axis, directions_of, made_parallel, refitted_on_axes
from .curve import Curve
from .curve_search import is_determined, recover_curve
from .fit import distances, refine
from .initialisation import (
    back_projected,
    circles_of_ellipse,
    edgels_of_arc,
    matched_to_arc,
    mirrored,
    paired_arcs,
    plane_disparities,
    trimmed,
)
from .inliers import visible_arc
from .observations import EdgelMasks, StereoEdgels


@dataclass(frozen=True, eq=False)
class _ArcPair:
    """Arcs of the two images that show one curve.

    Attributes
    ----------
    masks
        Their edgels, bool over all of either image.
    ellipses
        Of the two arcs.
    samples : (k, 3) float64
        Pixels: u, v, disparity.
    planes
        Candidates (3,) for the disparity that the curve's plane induces.
    """

    masks: EdgelMasks
    ellipses: tuple[Ellipse, Ellipse]
    samples: FloatArray
    planes: list[FloatArray]

    def is_explained_by(self, curves: Iterable[Curve]) -> bool:
        """Whether most of the edgels of both arcs belong to one of the curves."""
        return any(
            curve.left[self.masks[0]].mean() > settings.SHARED_EDGELS
            and curve.right[self.masks[1]].mean() > settings.SHARED_EDGELS
            for curve in curves
        )

    def share_on(self, curve: Curve) -> float:
        """Share of the arcs' edgels that belong to a curve, in the image where it is less."""
        return float(min(curve.left[self.masks[0]].mean(), curve.right[self.masks[1]].mean()))


def recover_curves(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: StereoEdgels,
    late: Late = never,
) -> list[Curve]:
    """All planar curves of a pair; none shares half of its edgels with another one that was found before.

    First come those that their own edgels determine, by falling number of edgels. Arcs that remain are tried on the
    axes of these, then arcs that only one image shows, then the remaining ones on planes parallel to a known one. In
    the end curves take the axis or the normal of better known ones.

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
    pairs = _arc_pairs(matches, segments, ellipses, edgels)
    found: list[Curve] = []
    undetermined: list[_ArcPair] = []
    for pair in sorted(pairs, key=lambda p: -int(p.masks[0].sum())):
        if late():
            break
        if pair.is_explained_by(found):
            continue
        curve = _curve_of_arcs(pair, edgels)
        if curve and is_determined(curve):
            found.append(curve)
        else:
            undetermined.append(pair)
    axes = axes_of(found)
    for pair in undetermined:
        if not late() and not pair.is_explained_by(found):
            found += _best_fit(_on_axes(pair, axes, edgels))
    for is_right in (False, True):
        arcs = segments[is_right].arc
        for arc in sorted(set(arcs[arcs >= 0].tolist())):
            if late():
                break
            found += _best_fit(
                _curves_of_one_arc(arc, is_right, ellipses[is_right][arc], matches, segments, found, edgels)
            )
    directions = directions_of(found)
    for pair in undetermined:
        if directions and not late() and not pair.is_explained_by(found):
            found += _best_fit(
                curve
                for curve in _on_axes(pair, directions, edgels)
                if curve.misfit < settings.CIRCLE_MISFIT
                and curve.rms < settings.ONE_ARC_RMS
                and pair.share_on(curve) > settings.MOST_OF_ARC
            )
    refitted = [refitted_on_axes(curve, axes, edgels) for curve in found]
    return [made_parallel(c, directions) if c.tilt > settings.VAGUE_TILT else c for c in refitted]


def _arc_pairs(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: StereoEdgels,
) -> list[_ArcPair]:
    """The arcs that show one curve in both images; parameters as of :func:`recover_curves`."""
    result = []
    for a, b, samples in paired_arcs(matches, *segments):
        masks = (edgels_of_arc(segments[0], a, len(edgels.left)), edgels_of_arc(segments[1], b, len(edgels.right)))
        both = ellipses[0][a], ellipses[1][b]
        result.append(_ArcPair(masks, both, samples, plane_disparities(*both, samples)))
    return result


def _best_fit(curves: Iterable[Curve]) -> list[Curve]:
    """The curve of least rms; none of none."""
    good = list(curves)
    return [min(good, key=lambda c: c.rms)] if good else []


def _on_axes(pair: _ArcPair, axes: list[AxisOf], edgels: StereoEdgels) -> list[Curve]:
    """Circles through the arcs on each of the axes that they fit."""
    tried = [circle_on_axis(pair.ellipses[0], pair.samples, pair.masks, axis, edgels) for _, axis in axes]
    return [curve for curve in tried if curve is not None]


def _curve_of_arcs(pair: _ArcPair, edgels: StereoEdgels) -> Curve | None:
    """The curve that a pair of arcs shows.

    Starts come from disparity and, unless those give one beyond doubt, from the circles that look like either arc to
    one camera.
    """
    curve = _best_of([recover_curve(start, edgels, pair.masks) for start in _starts(pair, edgels)], pair, edgels)
    if curve is not None and _is_beyond_doubt(curve, pair):
        return curve
    one_view = [
        start
        for ellipse, is_right in zip(pair.ellipses, (False, True))
        for start in circles_of_ellipse(ellipse, pair.samples, edgels.rig, is_right)
    ]
    others = [recover_curve(start, edgels, pair.masks) for start in _two_planes(one_view, pair, edgels)]
    return _best_of([curve, _best_of(others, pair, edgels)], pair, edgels)


def _starts(pair: _ArcPair, edgels: StereoEdgels) -> list[Curve]:
    """The best circle from the planes of the arcs and, unless that one is beyond doubt, its mirror image.

    Circles are fitted to all edgels of the arcs and, when that fits badly, to their middle parts: where an arc runs
    into a contour or an edge, the last edgels may not be its own.
    """
    best, used = None, edgels
    for share in (0.0, settings.TRIMMED_SHARE):
        curve_edgels = edgels.select((trimmed(pair.masks[0], share), trimmed(pair.masks[1], share)))
        for plane in pair.planes:
            start = back_projected(pair.ellipses[0], plane, edgels.rig)
            if start is None or (best is not None and best.rms < settings.GOOD_RMS):
                continue
            curve = _rough_circle(start, curve_edgels) or start
            if best is None or curve.rms < best.rms:
                best, used = curve, curve_edgels
    if best is None or not np.isfinite(best.rms):
        return [] if best is None else [best]
    if best.rms < settings.GOOD_RMS and visible_arc(best, used)[1] > settings.NEARLY_WHOLE:
        return [best]
    other = _rough_circle(mirrored(best), used)
    return [best] if other is None or not _competes(other, best) else [best, other]


def _rough_circle(start: Curve, curve_edgels: StereoEdgels) -> Curve | None:
    """A circle without covariance fitted to given edgels."""
    return refine(start, curve_edgels, circle=True, rounds=settings.ROUGH_ROUNDS, rough=True)


def _competes(other: Curve, best: Curve) -> bool:
    """Whether a curve in another plane fits nearly as well as the best."""
    limit = settings.COMPETITOR_FACTOR * (best.rms + settings.COMPETITOR_RMS)
    return bool(abs(other.normal @ best.normal) <= settings.SAME_PLANE_COSINE and other.rms <= limit)


def _two_planes(starts: list[Curve], pair: _ArcPair, edgels: StereoEdgels) -> list[Curve]:
    """The best circle from given starts, and the next in another plane when that fits nearly as well."""
    curve_edgels = edgels.select(pair.masks)
    tried = [_rough_circle(start, curve_edgels) for start in starts]
    good = sorted((c for c in tried if c is not None), key=lambda c: c.rms)
    others = [c for c in good[1:] if _competes(c, good[0])]
    return good[:1] + others[:1]


def _is_beyond_doubt(curve: Curve, pair: _ArcPair) -> bool:
    """Whether a curve is determined, fits as its edgels state, and has nearly all of the arcs' edgels."""
    return (
        is_determined(curve)
        and curve.misfit < settings.CIRCLE_MISFIT
        and curve.tilt < settings.SURE_TILT
        and pair.share_on(curve) > settings.MOST_OF_ARC
    )


def _best_of(curves: list[Curve | None], pair: _ArcPair, edgels: StereoEdgels) -> Curve | None:
    """The curve of least truncated residuals over the edgels of the arcs and of all the curves."""
    good = [c for c in curves if c is not None]
    if len(good) < 2:
        return good[0] if good else None
    masks = (
        pair.masks[0] | np.any([c.left for c in good], axis=0),
        pair.masks[1] | np.any([c.right for c in good], axis=0),
    )
    chosen = edgels.select(masks)
    limit = settings.COMPETITOR_SIGMA * chosen.sigma + settings.COMPETITOR_DISTANCE

    def cost(curve: Curve) -> float:
        off = [np.abs(distances(curve, side.position, view, edgels.blur)) for side, view in chosen.sides]
        return float(np.minimum(np.concatenate(off) / limit, 1.0).sum())

    return min(good, key=cost)


def _curves_of_one_arc(
    arc: int,
    is_right: bool,
    ellipse: Ellipse,
    matches: Matches,
    segments: tuple[Segments, Segments],
    found: list[Curve],
    edgels: StereoEdgels,
) -> list[Curve]:
    """Circles that are an arc in one image and straight segments, or several arcs, in the other.

    arc, is_right, ellipse : the arc's number, its image, its ellipse; found : curves already known.
    """
    masks, samples, share = matched_to_arc(matches, segments, arc, is_right, (len(edgels.left), len(edgels.right)))
    if share < settings.MATCHED_SHARE or min(int(mask.sum()) for mask in masks) < settings.GUIDED_EDGELS:
        return []
    if found:
        known = np.any([c.left for c in found], axis=0), np.any([c.right for c in found], axis=0)
        if any(of[mask].mean() > settings.SHARED_EDGELS for of, mask in zip(known, masks)):
            return []
    curve_edgels = edgels.select(masks)
    starts = [
        _rough_circle(start, curve_edgels) for start in circles_of_ellipse(ellipse, samples, edgels.rig, is_right)
    ]
    curves = [
        recover_curve(start, edgels, masks) for start in starts if start is not None and start.rms < settings.WORST_RMS
    ]
    return [
        c
        for c in curves
        if c is not None
        and is_determined(c)
        and c.misfit < settings.CIRCLE_MISFIT
        and c.coverage > settings.GUIDED_COVERAGE
        and c.rms < settings.ONE_ARC_RMS
        and np.sqrt(c.covariance[5, 5]) < settings.ONE_ARC_RADIUS_SIGMA * c.radii[0]
        and c.left[masks[0]].mean() > settings.ONE_ARC_INLIERS
        and c.right[masks[1]].mean() > settings.ONE_ARC_INLIERS
    ]
