"""Axes of cylinders and cones, found without help (the thesis, 6.4, found them by hand).

Two planar curves on one axis give it directly. So does one curve with the occluding contours beside it (see
:mod:`.occluding_contours`): they lie in planes that hold the axis' direction, or the apex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, StereoRig
from msgs_py.numeric.covariances import semidefinite
from msgs_py.numeric.typed import FloatArray, Int8Array

from ..detection.segments import Segments
from ..detection.settings import LEAST_DIVISOR
from . import settings
from .curve import CameraView, Curve, camera_views, image_conic
from .occluding_contours import Contours, CurvedSurface, cylinder_contours, longest_contours


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of rotation between two ends.

    Attributes
    ----------
    start, end : (3,) float64
        Metres. Left optical frame.
    covariance : (6, 6) float64
        Square metres. Of both ends.
    """

    start: FloatArray
    end: FloatArray
    covariance: FloatArray


def find_axes(
    curves: list[Curve], segments: tuple[Segments, Segments], rig: StereoRig
) -> tuple[list[Axis], list[CurvedSurface]]:
    """Axes between neighbouring coaxial curves, then of single curves with occluding contours.

    Parameters
    ----------
    curves : list of Curve
        Left optical frame, metres.
    segments : (Segments, Segments)
        Of the two images.
    rig : StereoRig
        The cameras.

    Returns
    -------
    axes : list of Axis
        Left optical frame, metres.
    surfaces : list of CurvedSurface
        Curved surfaces that the curves may bound: a cylinder on every curve, and the cones that were found.
    """
    found: list[Axis] = []
    surfaces = [CurvedSurface.cylinder(c) for c in curves]
    used: set[int] = set()
    for members in _coaxial(curves):
        ends = _ends(curves, members)
        for low, high in zip(ends, ends[1:]):
            a, b = (
                min((curves[k] for k in end), key=lambda c: float(np.trace(c.covariance[:3, :3])))
                for end in (low, high)
            )
            found.append(Axis(a.centre, b.centre, _independent(a.covariance, b.covariance)))
            used |= {*low, *high}
            # Of several rims at an end, the surface between the ends joins the two whose radii differ least.
            i, j = min(
                ((i, j) for i in low for j in high), key=lambda p: abs(curves[p[0]].radii[0] - curves[p[1]].radii[0])
            )
            surfaces += _cone_between(curves[i], curves[j])
    for i, curve in enumerate(curves):
        if i in used:
            continue
        axis = _cylinder_axis(curve, segments, rig)
        if axis is None:
            axis, apex = _cone_axis(curve, segments, rig)
            surfaces += [] if apex is None else [CurvedSurface.cone(curve, apex)]
        found += [] if axis is None else [axis]
    return found, surfaces


def _coaxial(curves: list[Curve]) -> list[list[int]]:
    """Groups of curves on one axis, each of two or more; the best known curve first."""
    groups: list[list[int]] = []
    for i in sorted(range(len(curves)), key=lambda k: curves[k].tilt):
        for group in groups:
            if _on_axis(curves[group[0]], curves[i]):
                group.append(i)
                break
        else:
            groups.append([i])
    return [group for group in groups if len(group) > 1]


def _on_axis(known: Curve, other: Curve) -> bool:
    """Whether a curve lies on the axis of one that is known better."""
    limit = settings.COAXIAL_TILT + settings.BOUND_SIGMA * min(other.tilt, settings.COAXIAL_TILT)
    if abs(known.normal @ other.normal) < np.cos(limit):
        return False
    run = other.centre - known.centre
    along = run @ known.normal
    off = np.linalg.norm(run - along * known.normal)
    spread = settings.BOUND_SIGMA * np.sqrt(np.trace(known.covariance[:3, :3]) + np.trace(other.covariance[:3, :3]))
    small = min(known.radii[0], other.radii[0])
    return bool(off < max(settings.OFF_AXIS * small, spread) + settings.BOUND_SIGMA * known.tilt * abs(along))


def _ends(curves: list[Curve], members: list[int]) -> list[list[int]]:
    """The curves of one axis in order along it, those that bound one end together."""
    best = curves[members[0]]
    height = {k: float((curves[k].centre - best.centre) @ best.normal) for k in members}
    ends: list[list[int]] = []
    for k in sorted(members, key=lambda k: height[k]):
        near = settings.SAME_END * max(curves[k].radii[0], curves[ends[-1][-1]].radii[0]) if ends else 0.0
        if ends and height[k] - height[ends[-1][-1]] < near:
            ends[-1].append(k)
        else:
            ends.append([k])
    return ends


def _cone_between(a: Curve, b: Curve) -> list[CurvedSurface]:
    """The cone through two rims; none when they bound a cylinder, which every rim is taken for anyway."""
    larger, difference = max(a.radii[0], b.radii[0]), a.radii[0] - b.radii[0]
    if abs(difference) < settings.CYLINDER_TAPER * larger:
        return []
    return [CurvedSurface.cone(a, a.centre + (b.centre - a.centre) * a.radii[0] / difference)]


def _independent(of_start: FloatArray, of_end: FloatArray) -> FloatArray:
    """(6, 6), square metres: of two ends, from covariances (3 or more, ...) that have x, y, z first."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = of_start[:3, :3], of_end[:3, :3]
    return settings.AXIS_VARIANCE_FACTOR * covariance


def _cylinder_axis(curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig) -> Axis | None:
    """A cylinder's axis from its one visible rim and its contours, which improve its direction."""
    contours = cylinder_contours(curve, segments, rig)
    if len(contours.normals) < 2:
        return None
    # Each contour's plane holds the axis: one linear equation in the two tilts of the normal, beside the rim's own.
    frame = np.stack([curve.second, -curve.first])
    of_rim = np.linalg.inv(curve.covariance[3:5, 3:5] + settings.LEAST_TILT_VARIANCE * np.eye(2))
    slopes = contours.normals @ frame.T
    information = of_rim + slopes.T @ (slopes / contours.sigma[:, None] ** 2)
    step = -np.linalg.solve(information, slopes.T @ ((contours.normals @ curve.normal) / contours.sigma**2))
    direction = curve.normal + step @ frame
    direction /= np.linalg.norm(direction)
    heights = contours.abscissae(curve.centre, direction)
    farthest = heights[np.arange(len(heights)), np.abs(heights).argmax(axis=1)]
    height = float(farthest[np.abs(farthest).argmax()])
    if abs(height) < settings.LEAST_AXIS * curve.radii[0]:
        return None
    # The far end is where the contours of both sides end; where these differ, something hides it.
    reached = [np.abs(farthest[contours.sides == name]).max() for name in np.unique(contours.sides)]
    end_error = max(reached) - min(reached) if len(reached) > 1 else settings.ONE_SIDED_ERROR * abs(height)
    # The far end goes with the rim, turns about it, and is as well known along the axis as the contours show it.
    covariance = np.tile(settings.AXIS_VARIANCE_FACTOR * curve.covariance[:3, :3], (2, 2))
    covariance[3:, 3:] += height**2 * frame.T @ np.linalg.inv(information) @ frame
    length_sigma = (end_error + settings.AXIS_LENGTH_ERROR * abs(height)) / settings.BOUND_SIGMA
    covariance[3:, 3:] += length_sigma**2 * np.outer(direction, direction)
    return Axis(curve.centre, curve.centre + height * direction, covariance)


def _cone_axis(
    curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig
) -> tuple[Axis | None, FloatArray | None]:
    """A cone's axis from its base and its contours, which meet in the apex; and the apex (3,), metres."""
    left, right = (_tangent_sides(curve, side, view) for side, view in zip(segments, camera_views(rig)))
    contours = longest_contours((left, right), segments, rig)
    # Three planes meet in the apex; two are enough where it lies on a circle's axis.
    if len(contours.normals) < (2 if curve.is_circle else 3):
        return None, None
    apex, information = _apex(curve, contours)
    if len(contours.normals) < 3 and not _end_at(apex, contours):
        return None, None
    miss = float(np.abs(((apex - contours.cameras) * contours.normals).sum(axis=1)).max())
    run = apex - curve.centre
    height = float(run @ curve.normal)
    off = float(np.linalg.norm(run - height * curve.normal))
    radius = float(curve.radii[0])
    if (
        miss > settings.APEX_MISS * radius
        or not settings.LEAST_AXIS * radius < abs(height) < settings.LONGEST_CONE * radius
        or off > settings.APEX_OFF_AXIS * radius
    ):
        return None, None
    # The planes' distance from the apex is taken for three sigma of what their stated errors leave out.
    spread = np.linalg.inv(information) + (miss / settings.BOUND_SIGMA) ** 2 * np.eye(3)
    return Axis(apex, curve.centre, _independent(spread, curve.covariance)), apex


def _apex(curve: Curve, contours: Contours) -> tuple[FloatArray, FloatArray]:
    """(3,) metres: the point nearest to all contours' planes, and its information matrix (3, 3), m^-2.

    With two planes only, the rim's axis is a constraint, as well as it is known.
    """
    frame = np.stack([curve.first, curve.second])
    offset = ((contours.cameras - curve.centre) * contours.normals).sum(axis=1)
    far = float(
        np.median(np.abs(offset) / np.maximum(np.abs(contours.normals @ curve.normal), settings.LEAST_CONTOUR_COSINE))
    )
    weight = 1.0 / (np.median(contours.sigma) * np.linalg.norm(curve.centre))
    on_axis = 1.0 / (settings.APEX_AXIS_SIGMA * curve.radii[0] + curve.tilt * far)
    if len(contours.normals) > 2:
        on_axis = 0.0
    rows = np.concatenate([weight * contours.normals, on_axis * frame])
    sides = np.concatenate(
        [weight * (contours.normals * contours.cameras).sum(axis=1), on_axis * (frame @ curve.centre)]
    )
    apex, *_ = np.linalg.lstsq(rows, sides, rcond=None)
    distance = np.linalg.norm(apex - contours.cameras, axis=1)
    of_planes = contours.normals.T @ (contours.normals / (contours.sigma * distance)[:, None] ** 2)
    return apex, of_planes + on_axis**2 * frame.T @ frame


def _end_at(apex: FloatArray, contours: Contours) -> bool:
    """Whether all contours end at an apex (3,), metres."""
    sight = (apex - contours.cameras) / np.linalg.norm(apex - contours.cameras, axis=1, keepdims=True)
    rays = contours.rays / np.linalg.norm(contours.rays, axis=2, keepdims=True)
    length = np.linalg.norm(rays[:, 1] - rays[:, 0], axis=1)
    return bool((np.linalg.norm(rays - sight[:, None], axis=2).min(axis=1) < settings.APEX_GAP * length).all())


def _tangent_sides(curve: Curve, segments: Segments, view: CameraView) -> Int8Array:
    """(n,) int8: +1 or -1 for straight segments that leave a curve's image at a tangent on either side, else 0."""
    side = np.zeros(len(segments), np.int8)
    if len(segments) == 0:
        return side
    conic = image_conic(curve, view)
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    level = -np.linalg.det(conic) / np.linalg.det(conic[:2, :2])
    shape = level * np.linalg.inv(conic[:2, :2])
    across = np.stack([-segments.direction[:, 1], segments.direction[:, 0]], axis=1)
    # Half the width of the ellipse across a segment's line; a tangent is so far from the centre.
    width = np.sqrt(np.maximum(np.einsum('ni,ij,nj->n', across, shape, across), LEAST_DIVISOR))
    offset = ((segments.centre - centre) * across).sum(axis=1)
    sign = np.sign(offset)
    touch = centre + sign[:, None] * (across @ shape) / width[:, None]
    abscissa = ((touch - segments.centre) * segments.direction).sum(axis=1)
    # The sigma of a segment's line grows with the distance from the segment.
    sigma = np.hypot(segments.sigma[:, 0], segments.sigma[:, 1] * abscissa)
    radius = np.sqrt(np.linalg.eigvalsh(shape)[-1])
    gap = np.maximum(np.maximum(segments.extent[:, 0] - abscissa, abscissa - segments.extent[:, 1]), 0.0)
    limit = np.minimum(settings.TANGENT_DISTANCE + sigma, settings.MOST_TANGENT_DISTANCE)
    near = (np.abs(np.abs(offset) - width) < limit) & (gap < settings.TANGENT_GAP * radius)
    # The segment starts near the touching point; it does not pass it.
    inside = np.minimum(abscissa - segments.extent[:, 0], segments.extent[:, 1] - abscissa)
    near &= (inside < settings.MOST_INSIDE_SHARE * segments.length) & (segments.arc < 0)
    near &= segments.length > settings.LEAST_TANGENT_LENGTH
    # Sides are numbered by the side of the axis, so that a segment's direction makes no difference.
    side[near] = np.where(((touch - centre)[near] @ _across_axis(curve, view)) > 0.0, 1, -1)
    return side


def _across_axis(curve: Curve, view: CameraView) -> FloatArray:
    """(2,) float64: direction in the image square to the image of the curve's normal."""
    centre = curve.centre - view.centre
    tip = centre + settings.AXIS_STEP * curve.radii[0] * curve.normal
    a, b = (view.matrix @ p for p in (centre, tip))
    run = b[:2] / b[2] - a[:2] / a[2]
    return np.array([-run[1], run[0]])


def axis_features(axes: list[Axis]) -> FeatureSet:
    """Axes as features of kind AXIS.

    Parameters
    ----------
    axes : list of Axis
        Left optical frame, metres.

    Returns
    -------
    FeatureSet
        In the same order.
    """
    if not axes:
        return FeatureSet.empty()
    covariance = semidefinite(np.stack([a.covariance for a in axes]))
    return FeatureSet.from_axes([a.start for a in axes], [a.end for a in axes], covariance=covariance)
