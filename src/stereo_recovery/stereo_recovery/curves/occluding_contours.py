"""Occluding contours: where the contour of a curved surface runs in an image, given a rim of it and its apex.

The lines of sight that touch a cylinder lie in planes through the camera parallel to its axis, those of a cone in
planes through its apex; both touch the rim. So in the image the contour is a tangent of the rim's conic through the
image of the apex, which for a cylinder is the vanishing point of its axis. Contours are no edges of the object: the two
cameras see different points of the surface there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray, Int8Array, Int32Array, IntArray

from ..detection.segments import Segments
from ..detection.settings import LEAST_CHORD, LEAST_DIVISOR, LEAST_LENGTH
from . import settings
from .curve import CameraView, Curve, camera_views, cross, image_conic


class CurvedSurface(NamedTuple):
    """A cylinder or cone: a rim of it, and where its generators meet.

    Attributes
    ----------
    rim : Curve
    apex : (4,) float64
        Homogeneous, left optical frame, metres; the axis' direction and 0 for a cylinder.
    """

    rim: Curve
    apex: FloatArray

    @classmethod
    def cylinder(cls, rim: Curve) -> CurvedSurface:
        """The cylinder that stands on a rim."""
        return cls(rim, np.append(rim.normal, 0.0))

    @classmethod
    def cone(cls, rim: Curve, apex: FloatArray) -> CurvedSurface:
        """The cone over a rim with an apex (3,), metres."""
        return cls(rim, np.append(apex, 1.0))

    @property
    def is_cone(self) -> bool:
        """Whether the apex is a point at a finite distance."""
        return bool(self.apex[3] != 0.0)

    def image_of_apex(self, view: CameraView) -> FloatArray:
        """(3,) float64: homogeneous pixels."""
        image: FloatArray = view.matrix @ (self.apex[:3] - self.apex[3] * view.centre)
        return image


def tangents(conic: FloatArray, point: FloatArray) -> FloatArray:
    """The lines through a point that touch a conic.

    Parameters
    ----------
    conic : (3, 3) float64
        Symmetric matrix, in pixels.
    point : (3,) float64
        Homogeneous pixels; it may be at infinity.

    Returns
    -------
    (k, 3) float64
        k = 2 lines a u + b v + c = 0 with a^2 + b^2 = 1, or k = 0 for a point inside the conic.

    Examples
    --------
    The tangents of the unit circle that run along v touch it at u = 1 and u = -1:

    >>> lines = tangents(np.diag([1.0, 1.0, -1.0]), np.array([0.0, 1.0, 0.0]))
    >>> sorted((-lines[:, 2] / lines[:, 0]).round(6).tolist())
    [-1.0, 1.0]
    """
    polar = conic @ point
    scale = np.abs(polar).max()
    if scale == 0.0:
        return np.zeros((0, 3))
    # The polar meets the conic in the touching points. base + t away runs along it; a t^2 + 2 b t + c = 0 is the conic.
    base, away = np.linalg.svd(polar[None] / scale)[2][1:]
    a, b, c = away @ conic @ away, base @ conic @ away, base @ conic @ base
    root = b * b - a * c
    if root <= settings.LEAST_TANGENT_SHARE * b * b or a == 0.0:
        return np.zeros((0, 3))
    ends = [base + t * away for t in ((-b + np.sqrt(root)) / a, (-b - np.sqrt(root)) / a)]
    lines = np.array([conic @ end for end in ends])
    length = np.hypot(lines[:, 0], lines[:, 1])
    return lines / length[:, None] if (length > 0.0).all() else np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class _ContourDistances:
    """How the n segments of an image lie to the two contours of a surface: rows are contours, columns segments.

    Attributes
    ----------
    off : (2, n) float64
        Pixels: distance from the contour's line beyond what is uncertain.
    inside : (2, n) float64
        Pixels: how far inside the segment the touching point is, negative beyond its end.
    radius
        Pixels, of the rim's image.
    straight : (n,) bool
        Segments that are long enough and no arcs.
    length : (n,)
        Pixels, of the segments.
    before_apex : (2, n) bool
        Whether the segment ends before a cone's apex.
    """

    off: FloatArray
    inside: FloatArray
    radius: float
    straight: BoolArray
    length: FloatArray
    before_apex: BoolArray

    def sides(self, distance: float, gap: float) -> Int8Array:
        """(n,) int8: 1 or 2 for segments on one or the other contour, else 0; see :func:`contour_sides`."""
        near = self._near(distance) & (-self.inside < gap * self.radius)
        return np.where(near[1], 2, near[0]).astype(np.int8)

    def sides_below_apex(self, distance: float) -> Int8Array:
        """(n,) int8: the same for segments anywhere between the rim and the apex of a cone."""
        near = self._near(distance) & self.before_apex
        return np.where(near[1], 2, near[0]).astype(np.int8)

    def _near(self, distance: float) -> BoolArray:
        """(2, n) bool: segments along the contour's line that do not pass the touching point."""
        return self.straight & (self.off < distance) & (self.inside < settings.MOST_INSIDE_SHARE * self.length)


def _contour_distances(surface: CurvedSurface, segments: Segments, view: CameraView) -> _ContourDistances:
    curve = surface.rim
    straight = (segments.arc < 0) & (segments.length > LEAST_LENGTH)
    none = np.full((2, len(segments)), np.inf)
    nothing = _ContourDistances(none, none, 0.0, straight, segments.length, np.zeros(none.shape, bool))
    if len(segments) == 0:
        return nothing
    conic = image_conic(curve, view)
    apex = surface.image_of_apex(view)
    lines = tangents(conic, apex)
    if len(lines) == 0:
        return nothing
    # Contours are numbered by the side of the axis on which they are, so that both images number them alike.
    centre = view.matrix @ (curve.centre - [view.x, 0.0, 0.0])
    axis = cross(centre / centre[2], apex)
    contact = np.linalg.solve(conic, lines.T).T
    contact = contact[:, :2] / contact[:, 2:]
    order = np.argsort(np.column_stack([contact, np.ones(2)]) @ axis)
    lines, contact = lines[order], contact[order]
    radius = np.sqrt(np.abs(np.linalg.det(conic) / np.linalg.det(conic[:2, :2])) / np.linalg.eigvalsh(conic[:2, :2])[0])
    ends = (segments.start, segments.end)
    off = np.maximum(*(np.abs(lines[:, :2] @ end.T + lines[:, 2:]) for end in ends))
    abscissa = contact @ segments.direction.T - (segments.centre * segments.direction).sum(axis=1)
    inside = np.minimum(abscissa - segments.extent[:, 0], segments.extent[:, 1] - abscissa)
    # An error of the axis' direction turns the contour about the touching point.
    far = np.maximum(abscissa - segments.extent[:, 0], segments.extent[:, 1] - abscissa)
    line_sigma = segments.sigma[:, 0] + 0.5 * segments.length * segments.sigma[:, 1]
    slack = np.minimum(line_sigma, settings.MOST_LINE_SIGMA) + np.minimum(
        settings.BOUND_SIGMA * curve.tilt * far, settings.MOST_TURN
    )
    before = np.zeros(off.shape, bool)
    if surface.is_cone and apex[2] > 0.0:
        to_apex = apex[:2] / apex[2] - contact
        height = np.maximum(np.hypot(to_apex[:, 0], to_apex[:, 1]), LEAST_CHORD)
        up = np.maximum(*((end[None] - contact[:, None]) @ (to_apex / height[:, None])[..., None] for end in ends))
        before = up[..., 0] < height[:, None] + settings.PAST_APEX
    return _ContourDistances(off - slack, inside, float(radius), straight, segments.length, before)


def contour_sides(surface: CurvedSurface, segments: Segments, view: CameraView) -> Int8Array:
    """Which straight segments of an image may show an occluding contour of a surface.

    Parameters
    ----------
    surface : CurvedSurface
        Left optical frame.
    segments : Segments
        Of the image.
    view : CameraView
        The camera of the image.

    Returns
    -------
    (n,) int8
        1 or 2 for segments along one or the other contour that start near the rim, else 0. Both images number the two
        contours alike.
    """
    distances = _contour_distances(surface, segments, view)
    return distances.sides(settings.CONTOUR_DISTANCE, settings.CONTOUR_GAP)


@dataclass(frozen=True, eq=False)
class Contours:
    """k segments that show occluding contours of one rim, in either image.

    Attributes
    ----------
    normals : (k, 3) float64, unit
        Normals of the planes through camera and segment.
    sigma : (k,) float64, radians
        Of the normals.
    cameras : (k, 3) float64, metres
        The cameras' centres.
    rays : (k, 2, 3) float64
        Lines of sight to the ends of the segments.
    sides : (k,) int8
        Which contour of its image a segment shows.
    """

    normals: FloatArray
    sigma: FloatArray
    cameras: FloatArray
    rays: FloatArray
    sides: Int8Array

    def abscissae(self, point: FloatArray, direction: FloatArray) -> FloatArray:
        """(k, 2) float64, metres: where along an axis (point (3,), unit direction (3,)) the segments' ends are.

        A line of sight touches the surface beside the point where it passes the axis.
        """
        across = np.cross(self.rays, direction)
        square = np.maximum((across * across).sum(axis=2), LEAST_DIVISOR)
        abscissae: FloatArray = -(np.cross(self.cameras[:, None] - point, self.rays) * across).sum(axis=2) / square
        return abscissae


def longest_contours(
    sides: tuple[Int8Array, Int8Array], segments: tuple[Segments, Segments], rig: StereoRig
) -> Contours:
    """The longest segment on either contour in either image.

    Parameters
    ----------
    sides : ((n,) int8, (m,) int8)
        For the segments of the two images, the number of a contour or 0.
    segments : (Segments, Segments)
        Of the two images.
    rig : StereoRig
        The cameras.

    Returns
    -------
    Contours
        Four or fewer.
    """
    normals, sigma, cameras, rays, names = [], [], [], [], []
    for numbers, side, view in zip(sides, segments, camera_views(rig)):
        for name in np.unique(numbers[numbers != 0]):
            of = np.flatnonzero(numbers == name)
            k = of[np.argmax(side.length[of])]
            sight = view.camera.rays(np.stack([side.start[k], side.end[k]]))
            normal = np.cross(sight[0], sight[1])
            normals.append(normal / np.linalg.norm(normal))
            sigma.append(np.hypot(side.sigma[k, 1], settings.CONTOUR_SIGMA / side.length[k]))
            cameras.append(view.centre)
            rays.append(sight)
            names.append(name)
    return Contours(
        np.array(normals).reshape(-1, 3),
        np.array(sigma),
        np.array(cameras).reshape(-1, 3),
        np.array(rays).reshape(-1, 2, 3),
        np.array(names),
    )


def cylinder_contours(curve: Curve, segments: tuple[Segments, Segments], rig: StereoRig) -> Contours:
    """The contours of the cylinder that a rim may bound.

    Parameters
    ----------
    curve : Curve
        The rim.
    segments : (Segments, Segments)
        Of the two images.
    rig : StereoRig
        The cameras.

    Returns
    -------
    Contours
        The longest segment on either contour in either image.
    """
    surface = CurvedSurface.cylinder(curve)
    left, right = (contour_sides(surface, side, view) for side, view in zip(segments, camera_views(rig)))
    return longest_contours((left, right), segments, rig)


def on_contours(
    indices: tuple[IntArray | Int32Array, IntArray | Int32Array],
    segments: tuple[Segments, Segments],
    surfaces: list[CurvedSurface],
    rig: StereoRig,
) -> BoolArray:
    """Matched segments that show an occluding contour, in both images or beyond doubt in one.

    Parameters
    ----------
    indices : ((n,) int, (n,) int)
        The matched segments, left and right.
    segments : (Segments, Segments)
        Of the two images.
    surfaces : list of CurvedSurface
        Left optical frame.
    rig : StereoRig
        The cameras.

    Returns
    -------
    (n,) bool
    """
    result = np.zeros(len(indices[0]), bool)
    for surface in surfaces:
        both = [_contour_distances(surface, side, view) for side, view in zip(segments, camera_views(rig))]
        usual, sure, loose = (
            [distances.sides(distance, gap)[index] for distances, index in zip(both, indices)]
            for distance, gap in (
                (settings.CONTOUR_DISTANCE, settings.CONTOUR_GAP_BOTH),
                (settings.SURE_CONTOUR_DISTANCE, settings.SURE_CONTOUR_GAP),
                (settings.LOOSE_CONTOUR_DISTANCE, settings.CONTOUR_GAP),
            )
        )
        result |= (usual[0] != 0) & (usual[0] == usual[1])
        if surface.is_cone:
            for distances, index in zip(both, indices):
                result |= distances.sides_below_apex(settings.SURE_CONTOUR_DISTANCE)[index] != 0
        result |= (sure[0] != 0) & (sure[0] == loose[1]) | (sure[1] != 0) & (sure[1] == loose[0])
    return result
