"""The opposite rim of a cylinder of which one rim was found: looked for where its occluding contours end.

A rim seen nearly edge-on, or in short pieces, gives no arc to start from. One rim of a cylinder gives the shape of the
other, up to its position along the axis, and the contours end there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py.numeric.typed import BoolArray

from ..detection.edgels import Edgels
from ..detection.segments import Segments
from . import settings
from .axis_constraint import AxisConstraint
from .curve import CameraView, Curve, image_conic
from .curve_search import is_determined, recover_curve
from .inlier_kernels import on_conic
from .observations import StereoEdgels
from .occluding_contours import cylinder_contours


def with_opposite_rims(curves: list[Curve], segments: tuple[Segments, Segments], edgels: StereoEdgels) -> list[Curve]:
    """The curves, and rims found at the far ends of the contours of those that bound a cylinder.

    Parameters
    ----------
    curves : list of Curve
        Left optical frame, metres.
    segments : (Segments, Segments)
        Of the two images.
    edgels : StereoEdgels
        All edgels of chains.

    Returns
    -------
    list of Curve
        The given ones first.
    """
    result = list(curves)
    for curve in curves:
        if curve.tilt > settings.AXIS_TILT or not curve.is_circle:
            continue
        contours = cylinder_contours(curve, segments, edgels.rig)
        if len(contours.sides) < 2:
            continue
        if any(_is_opposite(curve, c) for c in result):
            continue
        radius = curve.radii[0]
        ends = contours.abscissae(curve.centre, curve.normal).ravel()
        ends = ends[np.argsort(-np.abs(ends))]
        tried: list[float] = []
        for height in ends:
            known = [
                float((c.centre - curve.centre) @ curve.normal)
                for c in result
                if np.linalg.norm(np.cross(c.centre - curve.centre, curve.normal)) < settings.APART * radius
            ]
            if min(abs(height - other) for other in [*known, *tried, 0.0]) < settings.APART * radius:
                continue
            tried.append(float(height))
            found = _rim_at(curve, float(height), result, edgels)
            if found is not None:
                result.append(found)
                break
    return result


def _is_opposite(curve: Curve, other: Curve) -> bool:
    """Whether another rim is the other end of a curve's cylinder."""
    run = other.centre - curve.centre
    along = float(run @ curve.normal)
    radius = curve.radii[0]
    return bool(
        abs(along) > settings.APART * radius
        and abs(other.radii[0] / radius - 1.0) < settings.SAME_RADIUS
        and np.linalg.norm(run - along * curve.normal) < settings.APART * radius
    )


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
            near = settings.SAME_RIM * other.radii[0]
            if (
                np.linalg.norm(curve.centre - other.centre) < near
                and np.abs(curve.radii - other.radii).max() < near
                and abs(curve.normal @ other.normal) > settings.SAME_PLANE_COSINE
            ):
                kept[k] = replace(other, left=other.left | curve.left, right=other.right | curve.right)
                break
        else:
            kept.append(curve)
    return kept


def _rim_at(curve: Curve, height: float, others: list[Curve], edgels: StereoEdgels) -> Curve | None:
    """The rim of a curve's cylinder at a height (metres along its normal), from edgels that no other curve has."""
    expected = replace(curve, centre=curve.centre + height * curve.normal)
    if expected.centre[2] <= 0.0:
        return None
    taken = np.any([c.left for c in others], axis=0), np.any([c.right for c in others], axis=0)
    left, right = (_near(expected, side, view) & ~mask for (side, view), mask in zip(edgels.sides, taken))
    if min(int(left.sum()), int(right.sum())) < settings.GUIDED_EDGELS:
        return None
    found = recover_curve(expected, edgels, (left, right), AxisConstraint.of(curve))
    if (
        found is None
        or not is_determined(found)
        or found.misfit > settings.CONSTRAINED_MISFIT
        or found.coverage < settings.GUIDED_COVERAGE
        or abs(found.radii[0] / curve.radii[0] - 1.0) > settings.SAME_RADIUS
        or taken[0][found.left].mean() > settings.MOST_TAKEN
    ):
        return None
    return found


def _near(curve: Curve, edgels: Edgels, view: CameraView) -> BoolArray:
    """(n,) bool: edgels near the expected image of a curve, with gradients across it."""
    near: BoolArray = on_conic(image_conic(curve, view), edgels.position, edgels.direction, settings.EXPECTED_DISTANCE)
    return near
