"""Axes of cylinders and cones, found without help (the thesis, 6.4, found them by hand).

Two planar curves on one axis give it directly. So does one curve with the occluding contours beside it (see
:mod:`.occluding_contours`): they lie in planes that hold the axis' direction, or the apex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, StereoRig
from msgs_py.numeric.covariances import semidefinite
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import FloatArray

from ..detection.segments import Segments
from . import settings
from .agreement import agrees
from .axis_constraint import is_coaxial
from .curve import Curve, camera_views
from .occluding_contours import Contours, CurvedSurface, contour_sides, longest_contours, tangent_sides


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
            covariance = np.zeros((6, 6))
            covariance[:3, :3], covariance[3:, 3:] = a.covariance[:3, :3], b.covariance[:3, :3]
            found.append(Axis(a.centre, b.centre, covariance))
            used |= {*low, *high}
            # Of several rims at an end, the surface between the ends joins the two whose radii differ least.
            i, j = min(
                ((i, j) for i in low for j in high), key=lambda p: abs(curves[p[0]].radii[0] - curves[p[1]].radii[0])
            )
            surfaces.append(CurvedSurface.through(curves[i], curves[j]))
    for i, curve in enumerate(curves):
        if i not in used:
            axis, cone = _axis_of_contours(curve, segments, rig)
            found += [] if axis is None else [axis]
            surfaces += [] if cone is None else [cone]
    return found, surfaces


def _coaxial(curves: list[Curve]) -> list[list[int]]:
    """Groups of curves on one axis, each of two or more; the best known curve first."""
    groups: list[list[int]] = []
    for i in sorted(range(len(curves)), key=lambda k: curves[k].tilt):
        group = next((group for group in groups if is_coaxial(curves[group[0]], curves[i])), None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    return [group for group in groups if len(group) > 1]


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


def _axis_of_contours(
    curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig
) -> tuple[Axis | None, CurvedSurface | None]:
    """The axis of a cylinder or else a cone from its one visible rim and the contours beside it; and the cone."""
    views = camera_views(rig)
    cylinder = CurvedSurface.cylinder(curve)
    for is_cone in (False, True):
        left, right = (
            tangent_sides(curve, side, view) if is_cone else contour_sides(cylinder, side, view)
            for side, view in zip(segments, views)
        )
        # What one eye alone shows of a surface is no contour yet.
        if left.any() and right.any() and (curve.is_circle or not is_cone):
            axis = _fitted(curve, longest_contours((left, right), segments, rig), is_cone)
            if axis is not None:
                return axis, CurvedSurface.cone(curve, axis.start) if is_cone else None
    return None, None


def _fitted(curve: Curve, contours: Contours, is_cone: bool) -> Axis | None:
    """The axis on which the planes of all contours agree with a rim, a cone's from its apex; None where they do not.

    All planes hold the apex, which is on the axis of the rim, at infinity for a cylinder. So each is an equation of
    three unknowns: two tilts of the normal, of which the rim itself says something, and the radius over the height of
    the apex, which is zero for a cylinder.
    """
    radius, of_rim, taper = float(curve.radii[0]), curve.covariance[3:5, 3:5], 0.0
    towards = (curve.centre - contours.cameras) / radius
    turns = np.stack([curve.second, -curve.first])
    rows = np.column_stack([contours.normals @ turns.T, (contours.normals * towards).sum(axis=1)])
    rows = rows if is_cone else rows[:, :2]
    for _ in range(2):
        # What an error of a plane's normal moves grows with the distance of the apex.
        sigma = contours.sigma * np.linalg.norm(curve.normal + taper * towards, axis=1)
        weighted = rows / sigma[:, None] ** 2
        information = weighted.T @ rows
        information[:2, :2] += np.linalg.inv(of_rim)
        spread = np.linalg.inv(information)
        found = -spread @ weighted.T @ (contours.normals @ curve.normal)
        taper = float(found[2]) if is_cone else 0.0
    residual = np.concatenate([contours.normals @ curve.normal + rows @ found, found[:2]])
    covariance = np.zeros((len(residual), len(residual)))
    covariance[:-2, :-2], covariance[-2:, -2:] = np.diag(sigma**2), of_rim
    if not agrees(residual, covariance, len(rows) - is_cone) or (is_cone and agrees(found[2:], spread[2:, 2:])):
        return None
    direction = curve.normal + found[:2] @ turns
    direction /= np.linalg.norm(direction)
    if is_cone:
        height, variance = radius / taper, (radius / taper**2) ** 2 * float(spread[2, 2])
    else:
        height, variance = _height(curve, direction, contours)
    if abs(height) < settings.LEAST_AXIS * radius:
        return None
    # The far end goes with the rim, turns about it, and is as well known along the axis as the contours show it.
    end, far = curve.centre + height * direction, slice(0, 3) if is_cone else slice(3, 6)
    ends = np.tile(curve.covariance[:3, :3], (2, 2))
    ends[far, far] += height**2 * turns.T @ spread[:2, :2] @ turns + variance * np.outer(direction, direction)
    return Axis(end, curve.centre, ends) if is_cone else Axis(curve.centre, end, ends)


def _height(curve: Curve, direction: FloatArray, contours: Contours) -> tuple[float, float]:
    """How far along its axis a cylinder goes from its rim, metres, and the variance of that.

    The far end is where the contours of both sides end; where these differ, or only one is seen, something hides it.
    """
    heights = contours.abscissae(curve.centre, direction)
    farthest = heights[np.arange(len(heights)), np.abs(heights).argmax(axis=1)]
    height = float(farthest[np.abs(farthest).argmax()])
    reached = [np.abs(farthest[contours.sides == name]).max() for name in np.unique(contours.sides)]
    missing = max(reached) - min(reached) if len(reached) > 1 else abs(height)
    # Ends so near to each other are one.
    return height, (missing**2 + (settings.SAME_END * curve.radii[0]) ** 2) / BOUND_SIGMA**2


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
