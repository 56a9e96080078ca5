"""Occluding contours: where a curved surface's outline runs in an image, given its rim and its apex.

The outline of a cylinder lies in planes through the eye that are parallel to the axis, that of a cone in planes through
its apex; both touch the rim's picture. So it is a tangent of that conic through the picture of the apex, which for a
cylinder is the vanishing point of its axis. Outlines are no edges of the object: each eye sees other points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import StereoRig

from ..detection.segments import Segments
from ..edges.lines3d import Lines3D
from ..matching.matches import Matches
from .curve import Curve, cross, picture

# How far from the outline's line a segment may run, pixels, and how far from the rim it may start, in rim radii.
TOUCH = 1.0
REACH = 8.0
# What an uncertain axis may add to that, pixels.
MOST_TURN = 1.5
# An outline seen in both images may start farther away, where nothing is concluded from it.
FAR_REACH = 12.0
# Shorter segments, pixels, say nothing of where they run.
LEAST_LENGTH = 3.0
# A segment this near to an outline that starts this near to the rim, in one image, is one even if the other image's
# segment (which may be a neighbour's) is only so near.
SURE_TOUCH, SURE_REACH = 0.5, 0.5
LOOSE_TOUCH = 4.0
# Pixels by which an outline may pass its apex.
SHORT_OF_APEX = 3.0
# What light and a surface's shading move an outline by, pixels.
OUTLINE_SIGMA = 0.3


def tangents(conic: np.ndarray, apex: np.ndarray) -> np.ndarray:
    """(k, 3) float64, k = 0 or 2: lines through a point that touch a conic; a u + b v + c = 0 with a^2 + b^2 = 1.

    conic : (3, 3); apex : (3,) homogeneous pixels, may be at infinity.
    """
    polar = conic @ apex
    # The polar meets the conic in the touching points: two of its points, and where between them the conic is zero.
    scale = np.abs(polar).max()
    if scale == 0.0:
        return np.zeros((0, 3))
    base, away = np.linalg.svd(polar[None] / scale)[2][1:]
    a, b, c = away @ conic @ away, base @ conic @ away, base @ conic @ base
    root = b * b - a * c
    if root <= 1e-12 * b * b or a == 0.0:
        return np.zeros((0, 3))
    ends = [base + t * away for t in ((-b + np.sqrt(root)) / a, (-b - np.sqrt(root)) / a)]
    lines = np.array([conic @ end for end in ends])
    length = np.hypot(lines[:, 0], lines[:, 1])
    return lines / length[:, None] if (length > 0.0).all() else np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class _Beside:
    """How the segments of an image lie beside the two outlines of a surface: rows are outlines, columns segments.

    off : pixels off the outline's line beyond what is uncertain; inside : pixels, how far the touching point is inside
    the segment, negative beyond its end; radius : pixels, of the rim; straight : (n,) bool, segments that may be
    outlines;
    length : (n,) pixels; before : whether the segment ends before a cone's apex
    """

    off: np.ndarray
    inside: np.ndarray
    radius: float
    straight: np.ndarray
    length: np.ndarray
    before: np.ndarray

    def sides(self, touch: float, reach: float) -> np.ndarray:
        """(n,) int8, see :func:`touching`."""
        # It ends at the rim, or far from it; it does not pass it.
        near = (
            self.straight
            & (self.off < touch)
            & (-self.inside < reach * self.radius)
            & (self.inside < 0.25 * self.length)
        )
        return np.where(near[1], 2, near[0]).astype(np.int8)

    def within(self, touch: float) -> np.ndarray:
        """(n,) int8: the same for segments that end before a cone's apex, wherever."""
        near = self.straight & (self.off < touch) & (self.inside < 0.25 * self.length) & self.before
        return np.where(near[1], 2, near[0]).astype(np.int8)


def _beside(curve: Curve, apex: np.ndarray, segments: Segments, matrix: np.ndarray, eye: float) -> _Beside:
    nothing = np.full((2, len(segments)), np.inf)
    straight = (segments.arc < 0) & (segments.length > LEAST_LENGTH)
    if len(segments) == 0:
        return _Beside(nothing, nothing, 0.0, straight, segments.length, np.zeros(nothing.shape, bool))
    conic = picture(curve, matrix, eye)
    seen = matrix @ (apex[:3] - apex[3] * np.array([eye, 0.0, 0.0]))
    lines = tangents(conic, seen)
    if len(lines) == 0:
        return _Beside(nothing, nothing, 0.0, straight, segments.length, np.zeros(nothing.shape, bool))
    # The same side has the same number in both images: by the side of the axis on which the line is.
    centre = matrix @ (curve.centre - [eye, 0.0, 0.0])
    axis = cross(centre / centre[2], seen)
    contact = np.linalg.solve(conic, lines.T).T
    contact = contact[:, :2] / contact[:, 2:]
    order = np.argsort(np.column_stack([contact, np.ones(2)]) @ axis)
    lines, contact = lines[order], contact[order]
    radius = np.sqrt(np.abs(np.linalg.det(conic) / np.linalg.det(conic[:2, :2])) / np.linalg.eigvalsh(conic[:2, :2])[0])
    ends = (segments.start, segments.end)
    off = np.maximum(*(np.abs(lines[:, :2] @ end.T + lines[:, 2:]) for end in ends))
    place = contact @ segments.direction.T - (segments.centre * segments.direction).sum(axis=1)
    inside = np.minimum(place - segments.extent[:, 0], segments.extent[:, 1] - place)
    # An axis that is not quite known turns its outlines.
    far = np.maximum(place - segments.extent[:, 0], segments.extent[:, 1] - place)
    slack = np.minimum(segments.sigma[:, 0] + 0.5 * segments.length * segments.sigma[:, 1], 1.0) + np.minimum(
        3.0 * curve.tilt * far, MOST_TURN
    )
    before = np.zeros(off.shape, bool)
    if apex[3] != 0.0 and seen[2] > 0.0:
        reach = seen[:2] / seen[2] - contact
        height = np.maximum(np.hypot(reach[:, 0], reach[:, 1]), 1e-9)
        up = np.maximum(*((end[None] - contact[:, None]) @ (reach / height[:, None])[..., None] for end in ends))
        before = up[..., 0] < height[:, None] + SHORT_OF_APEX
    return _Beside(off - slack, inside, float(radius), straight, segments.length, before)


def touching(
    curve: Curve,
    apex: np.ndarray,
    segments: Segments,
    matrix: np.ndarray,
    eye: float,
    touch: float = TOUCH,
    reach: float = REACH,
) -> np.ndarray:
    """(n,) int8: 1 or 2 for straight segments that run along one or the other outline, else 0.

    apex : (4,) homogeneous, left frame, where the surface's generators meet: the axis' direction for a cylinder;
    touch : pixels off the outline's line, beside what is uncertain about a segment; reach : radii from the rim.
    """
    return _beside(curve, apex, segments, matrix, eye).sides(touch, reach)


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines of one rim in the two images: normals (k, 3) of the planes through eye and outline, their sigma (k,)
    radians, the eyes (k, 3), lines of sight (k, 2, 3) to the ends of the segments, and the sides (k,)."""

    normals: np.ndarray
    sigma: np.ndarray
    eyes: np.ndarray
    rays: np.ndarray
    sides: np.ndarray

    def places(self, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(k, 2) float64, metres: where along an axis the segments end. A line of sight passes the axis beside the
        point that it touches."""
        across = np.cross(self.rays, direction)
        square = np.maximum((across * across).sum(axis=2), 1e-12)
        return -(np.cross(self.eyes[:, None] - point, self.rays) * across).sum(axis=2) / square


def longest(touches: tuple[np.ndarray, np.ndarray], segments: tuple[Segments, Segments], rig: StereoRig) -> Outlines:
    """The longest segment on either side in either image. touches : (n,) of both images, the side or 0."""
    normals, sigma, eyes, rays, sides = [], [], [], [], []
    for touch, side, camera, eye in zip(touches, segments, (rig.left, rig.right), (0.0, rig.baseline)):
        for name in np.unique(touch[touch != 0]):
            of = np.flatnonzero(touch == name)
            k = of[np.argmax(side.length[of])]
            sight = camera.rays(np.stack([side.start[k], side.end[k]]))
            normal = np.cross(sight[0], sight[1])
            normals.append(normal / np.linalg.norm(normal))
            sigma.append(np.hypot(side.sigma[k, 1], OUTLINE_SIGMA / side.length[k]))
            eyes.append([eye, 0.0, 0.0])
            rays.append(sight)
            sides.append(name)
    return Outlines(
        np.array(normals).reshape(-1, 3),
        np.array(sigma),
        np.array(eyes).reshape(-1, 3),
        np.array(rays).reshape(-1, 2, 3),
        np.array(sides),
    )


def of_cylinder(curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig) -> Outlines:
    """The outlines that a rim has if it bounds a cylinder."""
    apex = np.append(curve.normal, 0.0)
    return longest(
        (
            touching(curve, apex, segments[0], rig.left.matrix, 0.0),
            touching(curve, apex, segments[1], rig.right.matrix, rig.baseline),
        ),
        segments,
        rig,
    )


def contours(
    lines: Lines3D | Matches,
    segments: tuple[Segments, Segments],
    surfaces: list[tuple[Curve, np.ndarray]],
    rig: StereoRig,
) -> np.ndarray:
    """(n,) bool: matched segments that are the outline of one of the surfaces (rim and apex) in both images, or beyond
    doubt in one."""
    result = np.zeros(len(lines), bool)
    for curve, apex in surfaces:
        beside = [
            _beside(curve, apex, side, camera.matrix, eye)
            for side, camera, eye in ((segments[0], rig.left, 0.0), (segments[1], rig.right, rig.baseline))
        ]
        usual, sure, loose = (
            [b.sides(touch, reach)[index] for b, index in zip(beside, (lines.left, lines.right))]
            for touch, reach in ((TOUCH, FAR_REACH), (SURE_TOUCH, SURE_REACH), (LOOSE_TOUCH, REACH))
        )
        result |= (usual[0] != 0) & (usual[0] == usual[1])
        if apex[3] != 0.0:
            one, other = (b.within(SURE_TOUCH)[index] != 0 for b, index in zip(beside, (lines.left, lines.right)))
            result |= one | other
        result |= (sure[0] != 0) & (sure[0] == loose[1]) | (sure[1] != 0) & (sure[1] == loose[0])
    return result
