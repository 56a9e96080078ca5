"""Axes of cylinders and cones, found without help (the thesis, 6.4, found them by hand), and occluding contours.

Two planar curves on one axis give it directly. One curve and the two contours beside it do as well: the contour of a
cylinder lies in planes through the eyes that are parallel to the axis, that of a cone in planes through its apex. The
contours themselves are no edges of the object (each eye sees other points), so they leave the set of edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import FeatureSet, StereoRig

from .curve import Curve, picture
from .lines3d import Lines3D
from .segmentation import Pieces

# How far from touching the curve's picture a contour may pass, pixels, and how far from it it may start, radii.
TOUCH = 1.2
CONTOUR_REACH = 3.0
# Normals of two ends of one axis agree within this; their centres are off the axis by less than this share of a radius.
PARALLEL = np.radians(2.0)
OFF_AXIS = 0.06
# Two curves nearer than this share of their radius are one face's rings, not two ends.
LEAST_LENGTH = 0.08


@dataclass(frozen=True, eq=False)
class Axis:
    """start, end : (3,) float64, metres, left optical frame; err_par, err_per : metres, three sigma."""

    start: np.ndarray
    end: np.ndarray
    err_par: float
    err_per: float


def tangents(curve: Curve, pieces: Pieces, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(n,) int8: +1 or -1 for straight pieces that touch the curve's picture on one side or the other, else 0."""
    side = np.zeros(len(pieces), np.int8)
    if len(pieces) == 0:
        return side
    conic = picture(curve, matrix, eye)
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    level = -np.linalg.det(conic) / np.linalg.det(conic[:2, :2])
    shape = level * np.linalg.inv(conic[:2, :2])
    across = np.stack([-pieces.direction[:, 1], pieces.direction[:, 0]], axis=1)
    width = np.sqrt(np.maximum(np.einsum('ni,ij,nj->n', across, shape, across), 1e-12))
    offset = ((pieces.centre - centre) * across).sum(axis=1)
    sign = np.sign(offset)
    # A short piece's line is only known near it.
    touch = centre + sign[:, None] * (across @ shape) / width[:, None]
    along = ((touch - pieces.centre) * pieces.direction).sum(axis=1)
    sigma = np.hypot(pieces.sigma[:, 0], pieces.sigma[:, 1] * along)
    reach = np.sqrt(np.linalg.eigvalsh(shape)[-1])
    gap = np.maximum(np.maximum(pieces.reach[:, 0] - along, along - pieces.reach[:, 1]), 0.0)
    near = (np.abs(np.abs(offset) - width) < np.minimum(TOUCH + sigma, 2.5)) & (gap < CONTOUR_REACH * reach)
    # It leaves the curve at the touching point rather than passing it.
    inside = np.minimum(along - pieces.reach[:, 0], pieces.reach[:, 1] - along)
    near &= (inside < 0.25 * pieces.length) & (pieces.arc < 0) & (pieces.length > 5.0)
    # Which side of the axis the contour is on must not depend on the way the piece runs.
    side[near] = np.where(((touch - centre)[near] @ _across_axis(curve, matrix, eye)) > 0.0, 1, -1)
    return side


def _across_axis(curve: Curve, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(2,) float64: direction in the image square to the picture of the curve's normal."""
    centre = curve.centre - np.array([eye, 0.0, 0.0])
    tip = centre + 0.01 * curve.radii[0] * curve.normal
    a, b = (matrix @ p for p in (centre, tip))
    run = b[:2] / b[2] - a[:2] / a[2]
    return np.array([-run[1], run[0]])


def contours(lines: Lines3D, pieces: tuple[Pieces, Pieces], curves: list[Curve], rig: StereoRig) -> np.ndarray:
    """(n,) bool: matched pieces that are a curved surface's outline in both images."""
    result = np.zeros(len(lines), bool)
    for curve in curves:
        left = tangents(curve, pieces[0], rig.left.matrix, 0.0)[lines.left]
        right = tangents(curve, pieces[1], rig.right.matrix, rig.baseline)[lines.right]
        result |= (left != 0) & (left == right)
    return result


def find_axes(curves: list[Curve], pieces: tuple[Pieces, Pieces], rig: StereoRig) -> list[Axis]:
    """Axes between neighbouring coaxial curves, then of curves that have only contours."""
    found: list[Axis] = []
    used: set[int] = set()
    links = []
    for i, a in enumerate(curves):
        for j in range(i):
            b = curves[j]
            if abs(a.normal @ b.normal) < np.cos(PARALLEL):
                continue
            run = b.centre - a.centre
            length = float(np.linalg.norm(run))
            # The better seen of the two knows the direction better.
            normal = a.normal if a.coverage >= b.coverage else b.normal
            off = np.linalg.norm(run - normal * (run @ normal))
            slack = 3.0 * np.sqrt(np.trace(a.covariance[:3, :3]) + np.trace(b.covariance[:3, :3]))
            small, large = sorted((a.radii[0], b.radii[0]))
            if length > LEAST_LENGTH * large and off < max(OFF_AXIS * small, slack) + np.sin(PARALLEL) * 0.2 * length:
                links.append((length, j, i))
    for _, i, j in sorted(links):
        if _joined(i, j, links):
            continue
        a, b = curves[i], curves[j]
        direction = (b.centre - a.centre) / np.linalg.norm(b.centre - a.centre)
        spread = [_along_and_across(c.covariance[:3, :3], direction) for c in (a, b)]
        found.append(Axis(a.centre, b.centre, max(s[0] for s in spread), max(s[1] for s in spread)))
        used |= {i, j}
    for i, curve in enumerate(curves):
        if i not in used:
            axis = _from_contours(curve, pieces, rig)
            if axis is not None:
                found.append(axis)
    return found


def _joined(i: int, j: int, links: list[tuple[float, int, int]]) -> bool:
    """Whether a third curve lies between two: then they are no neighbours."""
    length = {frozenset(pair): distance for distance, *pair in links}
    whole = length[frozenset((i, j))]
    return any(frozenset((i, k)) in length and frozenset((k, j)) in length
               and max(length[frozenset((i, k))], length[frozenset((k, j))]) < whole
               for k in {n for _, *pair in links for n in pair} - {i, j})


def _along_and_across(covariance: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    """Three sigma along a direction and across it, metres."""
    rest = np.eye(3) - np.outer(direction, direction)
    return (3.0 * float(np.sqrt(direction @ covariance @ direction)),
            3.0 * float(np.sqrt(np.linalg.eigvalsh(rest @ covariance @ rest)[-1])))


def _from_contours(curve: Curve, pieces: tuple[Pieces, Pieces], rig: StereoRig) -> Axis | None:
    """A cylinder's or cone's axis from its one visible rim and its outline."""
    planes, eyes, far = [], [], []
    for side, camera, eye in ((pieces[0], rig.left, 0.0), (pieces[1], rig.right, rig.baseline)):
        touching = tangents(curve, side, camera.matrix, eye)
        for sign in (1, -1):
            of = np.flatnonzero(touching == sign)
            if len(of) == 0:
                continue
            k = of[np.argmax(side.length[of])]
            ends = np.stack([side.start[k], side.end[k]])
            normal = np.cross(camera.rays(ends[0]), camera.rays(ends[1]))
            planes.append(normal / np.linalg.norm(normal))
            eyes.append(np.array([eye, 0.0, 0.0]))
            far.append(camera.rays(ends))
    if len(planes) < 2:
        return None
    normals, origins = np.array(planes), np.array(eyes)
    spread = _along_and_across(curve.covariance[:3, :3], curve.normal)
    if (np.abs(normals @ curve.normal) < np.sin(PARALLEL)).all():
        places = []
        for origin, rays in zip(origins, far):
            for ray in rays:
                # Where the line of sight passes the axis is beside the point it touches.
                across = np.cross(ray, curve.normal)
                place = np.cross(origin - curve.centre, ray) @ across / (across @ across)
                places.append(-float(place))
        other = max(places, key=abs)
        if abs(other) < 0.2 * curve.radii[0]:
            return None
        return Axis(curve.centre, curve.centre + other * curve.normal, spread[0] + 0.05 * abs(other),
                    spread[1] + 0.01 * abs(other))
    if len(planes) < 3:
        return None
    apex, *_ = np.linalg.lstsq(normals, (normals * origins).sum(axis=1), rcond=None)
    miss = np.abs(((apex - origins) * normals).sum(axis=1)).max()
    run = apex - curve.centre
    height = run @ curve.normal
    off = np.linalg.norm(run - height * curve.normal)
    if miss > 0.05 * curve.radii[0] or abs(height) < 0.2 * curve.radii[0] or off > 0.1 * curve.radii[0]:
        return None
    return Axis(apex, curve.centre, spread[0] + 3.0 * miss + 0.01 * abs(height), spread[1] + 3.0 * miss)


def axis_features(axes: list[Axis]) -> FeatureSet:
    """As features."""
    if not axes:
        return FeatureSet.empty()
    return FeatureSet.from_axes([a.start for a in axes], [a.end for a in axes], [a.err_par for a in axes],
                                [a.err_per for a in axes])
