"""Ends of edges that a curved surface hides: each camera sees another point there.

An edge that stops at an outline, or at a rim it has nothing to do with, goes on behind it. Such an end is no corner: it
says nothing about depth. Edges that do end on a rim lie in its plane or run along its axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray, Int8Array

from ..curves.curve import CameraView, Curve, angles, camera_views, image_conic
from ..detection.conics import sampson
from ..detection.junctions import Junctions
from ..detection.segments import Segments
from ..matching.matches import Matches

# An end this near to an outline's line or a rim's picture, pixels, and to the outline's segment along it, stops there.
NEAR, ALONG = 2.5, 8.0
# Disparity by which the ends of an edge in a rim's plane may miss that plane, pixels and as a share of disparity.
IN_PLANE, PLANE_SHARE = 1.5, 0.01
# Sine up to which an edge runs along a rim's axis; radians by which a rim may be longer than what is seen of it.
ALONG_AXIS = 0.06
MORE_ARC = 0.2


def hidden_ends(
    matches: Matches,
    segments: tuple[Segments, Segments],
    junctions: tuple[Junctions, Junctions],
    curves: Sequence[Curve],
    contours: Sequence[tuple[Int8Array, Int8Array]],
    rig: StereoRig,
) -> tuple[Junctions, Junctions]:
    """The corners of both images, those that are none marked as ``through``.

    matches, segments, junctions : of the pair; curves : its planar curves; contours : which segments show the contours
    of the surfaces that these may bound, as of :func:`.occluding_contours.contours_of`.
    """
    if not contours and not curves:
        return junctions
    result = []
    pairs = (matches.left, matches.right)
    in_planes = [_in_plane(curve, matches, segments[0], rig) for curve in curves]
    for side, view in enumerate(camera_views(rig)):
        own, found = segments[side], junctions[side]
        places = own.centre[:, None] + found.abscissa[..., None] * own.direction[:, None]
        hidden = np.zeros(places.shape[:2], bool)
        of_surface = np.zeros(len(own), bool)
        for both in contours:
            of_surface |= both[side] != 0
        for k in np.flatnonzero(of_surface):
            away = places - own.centre[k]
            along = away @ own.direction[k]
            off = np.abs(away @ [-own.direction[k, 1], own.direction[k, 0]])
            stops = (off < NEAR) & (along > own.extent[k, 0] - ALONG) & (along < own.extent[k, 1] + ALONG)
            stops[of_surface] = False
            hidden |= stops
        for curve, in_plane in zip(curves, in_planes):
            at = _on_rim(curve, places.reshape(-1, 2), view).reshape(hidden.shape)
            # Of edges that end on the rim those are left that may belong to its face or to its surface.
            allowed = np.zeros(len(own), bool)
            allowed[pairs[side][in_plane]] = True
            allowed = allowed[:, None] | _along_axis(curve, own, places, view)
            hidden |= at & ~allowed & (own.arc < 0)[:, None]
        result.append(replace(found, t_junction=found.t_junction | hidden))
    return result[0], result[1]


def _on_rim(curve: Curve, points: AnyArray, view: CameraView) -> AnyArray:
    """(n,) bool: pixels that lie on what is seen of a curve."""
    near = np.abs(sampson(image_conic(curve, view), points)) < NEAR
    if near.any():
        angle = angles(curve, points[near], view)
        start, extent = curve.arc
        near[near] = (angle - start + MORE_ARC) % (2.0 * np.pi) < extent + 2.0 * MORE_ARC
    return near


def _in_plane(curve: Curve, matches: Matches, left: Segments, rig: StereoRig) -> AnyArray:
    """(n,) bool: pairs both of whose ends are where the curve's plane has them."""
    ends = np.stack([left.start, left.end], axis=1)[matches.left]
    rays = np.stack([rig.left.rays(ends[:, k]) for k in (0, 1)], axis=1)
    depth = float(curve.centre @ curve.normal)
    if abs(depth) < NOT_ZERO:
        return np.zeros(len(matches), bool)
    disparity = rig.left.fx * rig.baseline * (rays @ curve.normal) / depth
    told = matches.disparity[:, [0, 2]] - (rig.left.cx - rig.right.cx)
    near: AnyArray = np.abs(disparity - told) < IN_PLANE + PLANE_SHARE * np.abs(told)
    both: AnyArray = near[:, 0] & near[:, 1]
    return both


def _along_axis(curve: Curve, own: Segments, places: AnyArray, view: CameraView) -> AnyArray:
    """(n, 2) bool: segments that run at their ends as a line along the curve's axis does."""
    vanishing = view.matrix @ curve.normal
    # All lines along the axis meet in its vanishing point, which may be at infinity.
    towards = vanishing[:2] - places * vanishing[2]
    length = np.maximum(np.hypot(towards[..., 0], towards[..., 1]), NOT_ZERO)
    sine = (own.direction[:, None, 0] * towards[..., 1] - own.direction[:, None, 1] * towards[..., 0]) / length
    result: AnyArray = (np.abs(sine) < ALONG_AXIS) & (curve.centre[2] > 0.0)
    return result
