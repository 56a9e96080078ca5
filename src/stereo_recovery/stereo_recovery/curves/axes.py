"""Axes of cylinders and cones, found without help (the thesis, 6.4, found them by hand).

Planar curves on one axis give it directly. One curve and the outlines beside it do as well (see :mod:`.outlines`): they
lie in planes that hold the axis' direction, or the apex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, StereoRig

from ..detection.segments import Segments
from .curve import Curve, picture
from .occluding_contours import Outlines, longest, of_cylinder

# Normals of two ends of one axis agree within this; their centres are off the axis by less than this share of a radius.
PARALLEL = np.radians(2.0)
OFF_AXIS = 0.06
# Curves on one axis nearer than this share of their radius bound one end.
LEAST_LENGTH = 0.08
# Two rims of one surface whose radii differ by less than this share bound a cylinder.
SAME_RADIUS = 0.03
# How far from touching a rim's picture the outline of a cone may pass, pixels, and how far from it it may start, radii.
TOUCH = 1.2
CONTOUR_REACH = 3.0
# A cone's outlines meet within this share of the base's radius, on its axis within this one.
MEET, CENTRED = 0.05, 0.1
# How far, in radii, a cone's apex may lie off its rim's axis, one sigma, beside what is uncertain about that.
TRUE_AXIS = 0.01
# Two outlines are enough where they end this near to the apex, as a share of their lengths.
AT_APEX = 0.1
# Three sigma of a rim's centre, and a fifth more.
BOUND = 3.6


@dataclass(frozen=True, eq=False)
class Axis:
    """start, end : (3,) float64, metres, left optical frame; err_par, err_per : metres, three sigma."""

    start: np.ndarray
    end: np.ndarray
    err_par: float
    err_per: float


# A rim and where its surface's generators meet: (4,) homogeneous, left frame; the axis' direction for a cylinder.
Surface = tuple[Curve, np.ndarray]


def find_axes(
    curves: list[Curve], segments: tuple[Segments, Segments], rig: StereoRig
) -> tuple[list[Axis], list[Surface]]:
    """Axes between neighbouring coaxial curves, then of curves that have only outlines; and the curved surfaces, of
    which every curve may bound a cylinder."""
    found: list[Axis] = []
    surfaces: list[Surface] = [(c, np.append(c.normal, 0.0)) for c in curves]
    used: set[int] = set()
    for members in _coaxial(curves):
        ends = _ends(curves, members)
        for low, high in zip(ends, ends[1:]):
            a, b = (
                min((curves[k] for k in end), key=lambda c: float(np.trace(c.covariance[:3, :3])))
                for end in (low, high)
            )
            direction = (b.centre - a.centre) / np.linalg.norm(b.centre - a.centre)
            spread = [_along_and_across(c.covariance[:3, :3], direction) for c in (a, b)]
            found.append(Axis(a.centre, b.centre, max(s[0] for s in spread), max(s[1] for s in spread)))
            used |= {*low, *high}
            # The two rims that are most alike bound the surface between the ends.
            i, j = min(
                ((i, j) for i in low for j in high), key=lambda p: abs(curves[p[0]].radii[0] - curves[p[1]].radii[0])
            )
            surfaces += _between(curves[i], curves[j])
    for i, curve in enumerate(curves):
        if i in used:
            continue
        axis = _cylinder(curve, segments, rig)
        if axis is None:
            axis, apex = _cone(curve, segments, rig)
            surfaces += [] if apex is None else [(curve, np.append(apex, 1.0))]
        found += [] if axis is None else [axis]
    return found, surfaces


def _coaxial(curves: list[Curve]) -> list[list[int]]:
    """Groups of curves on one axis, each of two or more."""
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
    slack = PARALLEL + 3.0 * min(other.tilt, PARALLEL)
    if abs(known.normal @ other.normal) < np.cos(slack):
        return False
    run = other.centre - known.centre
    along = run @ known.normal
    off = np.linalg.norm(run - along * known.normal)
    spread = 3.0 * np.sqrt(np.trace(known.covariance[:3, :3]) + np.trace(other.covariance[:3, :3]))
    small = min(known.radii[0], other.radii[0])
    return bool(off < max(OFF_AXIS * small, spread) + 3.0 * known.tilt * abs(along))


def _ends(curves: list[Curve], members: list[int]) -> list[list[int]]:
    """The curves of one axis in order along it, those that bound one end together."""
    best = curves[members[0]]
    place = {k: float((curves[k].centre - best.centre) @ best.normal) for k in members}
    ends: list[list[int]] = []
    for k in sorted(members, key=lambda k: place[k]):
        near = LEAST_LENGTH * max(curves[k].radii[0], curves[ends[-1][-1]].radii[0]) if ends else 0.0
        if ends and place[k] - place[ends[-1][-1]] < near:
            ends[-1].append(k)
        else:
            ends.append([k])
    return ends


def _between(a: Curve, b: Curve) -> list[Surface]:
    """The surface of two rims, unless it is a cylinder (which every rim is taken for anyway)."""
    larger, difference = max(a.radii[0], b.radii[0]), a.radii[0] - b.radii[0]
    if abs(difference) < SAME_RADIUS * larger:
        return []
    return [(a, np.append(a.centre + (b.centre - a.centre) * a.radii[0] / difference, 1.0))]


def _along_and_across(covariance: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    """Three sigma along a direction and across it, metres, with room for what moves a rim as a whole."""
    rest = np.eye(3) - np.outer(direction, direction)
    return (
        BOUND * float(np.sqrt(direction @ covariance @ direction)),
        BOUND * float(np.sqrt(np.linalg.eigvalsh(rest @ covariance @ rest)[-1])),
    )


def _cylinder(curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig) -> Axis | None:
    """A cylinder's axis from its one visible rim and its outlines, which also tell its direction."""
    seen = of_cylinder(curve, segments, rig)
    if len(seen.normals) < 2:
        return None
    # The rim's normal and the outlines' planes together, as tilts of the normal.
    frame = np.stack([curve.second, -curve.first])
    information = np.linalg.inv(curve.covariance[3:5, 3:5] + 1e-12 * np.eye(2))
    slopes = seen.normals @ frame.T
    told = information + slopes.T @ (slopes / seen.sigma[:, None] ** 2)
    step = -np.linalg.solve(told, slopes.T @ ((seen.normals @ curve.normal) / seen.sigma**2))
    direction = curve.normal + step @ frame
    direction /= np.linalg.norm(direction)
    tilt = float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv(told))[-1]))
    place = seen.places(curve.centre, direction)
    farthest = place[np.arange(len(place)), np.abs(place).argmax(axis=1)]
    other = float(farthest[np.abs(farthest).argmax()])
    if abs(other) < 0.2 * curve.radii[0]:
        return None
    # Where the outlines of both sides end at one height, that is the other end; else something hides it.
    reached = [np.abs(farthest[seen.sides == name]).max() for name in np.unique(seen.sides)]
    doubt = max(reached) - min(reached) if len(reached) > 1 else 0.5 * abs(other)
    along, beside = _along_and_across(curve.covariance[:3, :3], direction)
    return Axis(
        curve.centre,
        curve.centre + other * direction,
        along + doubt + 0.03 * abs(other),
        beside + 3.0 * tilt * abs(other),
    )


def _cone(curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig) -> tuple[Axis | None, np.ndarray | None]:
    """A cone's axis from its base and its outlines, which meet in the apex; and the apex."""
    seen = longest(
        (
            _touching_anywhere(curve, segments[0], rig.left.matrix, 0.0),
            _touching_anywhere(curve, segments[1], rig.right.matrix, rig.baseline),
        ),
        segments,
        rig,
    )
    # Three planes tell the apex; two do because it lies on the rim's axis, as well as that is known.
    if len(seen.normals) < (2 if curve.radii[0] == curve.radii[1] else 3):
        return None, None
    frame = np.stack([curve.first, curve.second])
    far = float(
        np.median(
            np.abs(((seen.eyes - curve.centre) * seen.normals).sum(axis=1))
            / np.maximum(np.abs(seen.normals @ curve.normal), 1e-3)
        )
    )
    weight = 1.0 / (np.median(seen.sigma) * np.linalg.norm(curve.centre))
    hold = 0.0 if len(seen.normals) > 2 else 1.0 / (TRUE_AXIS * curve.radii[0] + curve.tilt * far)
    rows = np.concatenate([weight * seen.normals, hold * frame])
    sides = np.concatenate([weight * (seen.normals * seen.eyes).sum(axis=1), hold * (frame @ curve.centre)])
    apex, *_ = np.linalg.lstsq(rows, sides, rcond=None)
    if len(seen.normals) < 3 and not _run_to(apex, seen):
        return None, None
    miss = float(np.abs(((apex - seen.eyes) * seen.normals).sum(axis=1)).max())
    run = apex - curve.centre
    height = float(run @ curve.normal)
    off = float(np.linalg.norm(run - height * curve.normal))
    radius = float(curve.radii[0])
    if miss > MEET * radius or not 0.2 * radius < abs(height) < 20.0 * radius or off > CENTRED * radius:
        return None, None
    # How well planes that cross at these angles place their common point.
    distance = np.linalg.norm(apex - seen.eyes, axis=1)
    told = seen.normals.T @ (seen.normals / (seen.sigma * distance)[:, None] ** 2) + hold**2 * frame.T @ frame
    spread = np.linalg.inv(told) + (miss / 3.0) ** 2 * np.eye(3)
    errors = [_along_and_across(c, run / np.linalg.norm(run)) for c in (spread, curve.covariance[:3, :3])]
    return Axis(apex, curve.centre, max(e[0] for e in errors), max(e[1] for e in errors)), apex


def _run_to(apex: np.ndarray, seen: Outlines) -> bool:
    """Whether all outlines end at an apex."""
    sight = (apex - seen.eyes) / np.linalg.norm(apex - seen.eyes, axis=1, keepdims=True)
    rays = seen.rays / np.linalg.norm(seen.rays, axis=2, keepdims=True)
    length = np.linalg.norm(rays[:, 1] - rays[:, 0], axis=1)
    return bool((np.linalg.norm(rays - sight[:, None], axis=2).min(axis=1) < AT_APEX * length).all())


def _touching_anywhere(curve: Curve, segments: Segments, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(n,) int8: +1 or -1 for straight segments that leave the curve's picture at a tangent on either side, else 0."""
    side = np.zeros(len(segments), np.int8)
    if len(segments) == 0:
        return side
    conic = picture(curve, matrix, eye)
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    level = -np.linalg.det(conic) / np.linalg.det(conic[:2, :2])
    shape = level * np.linalg.inv(conic[:2, :2])
    across = np.stack([-segments.direction[:, 1], segments.direction[:, 0]], axis=1)
    width = np.sqrt(np.maximum(np.einsum('ni,ij,nj->n', across, shape, across), 1e-12))
    offset = ((segments.centre - centre) * across).sum(axis=1)
    sign = np.sign(offset)
    # A short segment's line is only known near it.
    touch = centre + sign[:, None] * (across @ shape) / width[:, None]
    along = ((touch - segments.centre) * segments.direction).sum(axis=1)
    sigma = np.hypot(segments.sigma[:, 0], segments.sigma[:, 1] * along)
    reach = np.sqrt(np.linalg.eigvalsh(shape)[-1])
    gap = np.maximum(np.maximum(segments.extent[:, 0] - along, along - segments.extent[:, 1]), 0.0)
    near = (np.abs(np.abs(offset) - width) < np.minimum(TOUCH + sigma, 2.5)) & (gap < CONTOUR_REACH * reach)
    # It leaves the curve at the touching point rather than passing it.
    inside = np.minimum(along - segments.extent[:, 0], segments.extent[:, 1] - along)
    near &= (inside < 0.25 * segments.length) & (segments.arc < 0) & (segments.length > 5.0)
    # Which side of the axis the contour is on must not depend on the way the segment runs.
    side[near] = np.where(((touch - centre)[near] @ _across_axis(curve, matrix, eye)) > 0.0, 1, -1)
    return side


def _across_axis(curve: Curve, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(2,) float64: direction in the image square to the picture of the curve's normal."""
    centre = curve.centre - np.array([eye, 0.0, 0.0])
    tip = centre + 0.01 * curve.radii[0] * curve.normal
    a, b = (matrix @ p for p in (centre, tip))
    run = b[:2] / b[2] - a[:2] / a[2]
    return np.array([-run[1], run[0]])


def axis_features(axes: list[Axis]) -> FeatureSet:
    """As features."""
    if not axes:
        return FeatureSet.empty()
    return FeatureSet.from_axes(
        [a.start for a in axes], [a.end for a in axes], [a.err_par for a in axes], [a.err_per for a in axes]
    )
