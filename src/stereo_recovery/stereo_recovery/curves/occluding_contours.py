"""Occluding contours: where the contour of a curved surface runs in an image, given a rim of it and its apex.

The lines of sight that touch a cylinder lie in planes through the camera parallel to its axis, those of a cone in
planes through its apex; both touch the rim. So in the image the contour is a tangent of the rim's conic through the
image of the apex, which for a cylinder is the vanishing point of its axis. Contours are no edges of the object: the two
cameras see different points of the surface there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.settings import BOUND_SIGMA, NOT_ZERO
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, Int8Array, Int32Array, IntArray

from ..detection.segments import Segments
from ..detection.settings import LEAST_LENGTH
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

    @classmethod
    def through(cls, rim: Curve, other: Curve) -> CurvedSurface:
        """The cone through two coaxial rims; a cylinder, where their radii are equal."""
        taper = rim.radii[0] - other.radii[0]
        if taper == 0.0:
            return cls.cylinder(rim)
        return cls.cone(rim, rim.centre + (other.centre - rim.centre) * rim.radii[0] / taper)

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
        1 or 2 for segments along one or the other contour, from the rim on and before the apex of a cone, else 0. Both
        images number the two contours alike.
    """
    conic, apex = image_conic(surface.rim, view), surface.image_of_apex(view)
    lines = tangents(conic, apex)
    if len(segments) == 0 or len(lines) == 0:
        return np.zeros(len(segments), np.int8)
    contact = np.linalg.solve(conic, lines.T).T
    contact /= contact[:, 2:]
    order = np.argsort(contact @ _image_of_axis(surface.rim, apex, view))
    lines, contact = lines[order, :, None], contact[order, :2]
    ends = np.stack([segments.start, segments.end])
    off = np.abs(lines[:, 0] * ends[:, None, :, 0] + lines[:, 1] * ends[:, None, :, 1] + lines[:, 2]).max(axis=0)
    low, high = _from_contact(segments, contact[:, None])
    # An error of the axis' direction turns the contour about the touching point.
    turn = surface.rim.tilt * np.maximum(np.abs(low), np.abs(high))
    sigma = np.sqrt(_line_variance(segments, np.abs(segments.extent).max(axis=1)) + turn**2)
    near = off < BOUND_SIGMA * sigma
    if surface.is_cone and apex[2] > 0.0:
        tip = np.linalg.norm(apex[:2] / apex[2] - contact, axis=1)
        near &= np.maximum(np.abs(low), np.abs(high)) < tip[:, None] + BOUND_SIGMA * sigma
    return _sides(near, low, high, segments, _image_radius(conic))


def tangent_sides(curve: Curve, segments: Segments, view: CameraView) -> Int8Array:
    """Which straight segments of an image leave a curve's image at a tangent.

    Parameters
    ----------
    curve : Curve
        Left optical frame.
    segments : Segments
        Of the image.
    view : CameraView
        The camera of the image.

    Returns
    -------
    (n,) int8
        1 or 2 by the side of the curve's axis, else 0.
    """
    if len(segments) == 0:
        return np.zeros(0, np.int8)
    conic = image_conic(curve, view)
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    shape = -np.linalg.det(conic) / np.linalg.det(conic[:2, :2]) * np.linalg.inv(conic[:2, :2])
    across = segments.normal
    # Half the width of the ellipse across a segment's line; a tangent is so far from the centre.
    width = np.sqrt(np.maximum(np.einsum('ni,ij,nj->n', across, shape, across), NOT_ZERO))
    offset = ((segments.centre - centre) * across).sum(axis=1)
    touch = centre + (np.sign(offset) / width)[:, None] * (across @ shape)
    low, high = _from_contact(segments, touch[None])
    sigma = np.sqrt(_line_variance(segments, 0.5 * (low + high)[0]))
    axis = _image_of_axis(curve, view.matrix @ curve.normal, view)
    first = touch @ axis[:2] + axis[2] < 0.0
    near = np.stack([first, ~first]) & (np.abs(np.abs(offset) - width) < BOUND_SIGMA * sigma)
    return _sides(near, low, high, segments, _image_radius(conic))


def _from_contact(segments: Segments, contact: AnyArray) -> tuple[FloatArray, FloatArray]:
    """(c, n) pixels: along their line, where n segments begin and end from touching points, (c, 1, 2) or (1, n, 2)."""
    middle = ((contact - segments.centre) * segments.direction).sum(axis=2)
    return segments.extent[:, 0] - middle, segments.extent[:, 1] - middle


def _line_variance(segments: Segments, lever: FloatArray) -> FloatArray:
    """Square pixels: of a contour's distance from the lines of segments, so far from their middles, pixels."""
    return segments.variance_at(lever) + settings.CONTOUR_SIGMA**2


def _image_of_axis(rim: Curve, apex: FloatArray, view: CameraView) -> FloatArray:
    """(3,) float64: the line through the images of a rim's centre and of an apex (3,), both homogeneous."""
    centre = view.matrix @ (rim.centre - view.centre)
    return cross(centre / centre[2], apex)


def _sides(near: BoolArray, low: FloatArray, high: FloatArray, segments: Segments, radius: float) -> Int8Array:
    """(n,) int8: 1 or 2 for straight segments near (2, n) one or the other contour that begin at the rim, else 0.

    low, high : (c, n) pixels, of :func:`_from_contact`; radius : pixels, of the rim
    """
    near = near & (segments.arc < 0) & (segments.length > LEAST_LENGTH)
    near &= np.minimum(-low, high) < settings.MOST_INSIDE_SHARE * segments.length
    near &= np.maximum(low, -high) < settings.CONTOUR_GAP * radius
    return np.where(near[1], 2, near[0]).astype(np.int8)


def _image_radius(conic: FloatArray) -> float:
    """Pixels: the major radius of an image conic (3, 3); below all lengths where it is no ellipse."""
    block = conic[:2, :2]
    least = np.linalg.eigvalsh(block)[0]
    # A rim that reaches behind the camera shows a hyperbola, at which no contour can be said to begin.
    if least <= 0.0:
        return -np.inf
    return float(np.sqrt(np.abs(np.linalg.det(conic) / np.linalg.det(block)) / least))


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
        square = np.maximum((across * across).sum(axis=2), NOT_ZERO)
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


def contours_of(
    surfaces: Sequence[CurvedSurface], segments: tuple[Segments, Segments], rig: StereoRig
) -> list[tuple[Int8Array, Int8Array]]:
    """For each surface, which segments of the left and of the right image show its contours: :func:`contour_sides`."""
    left, right = camera_views(rig)
    return [
        (contour_sides(surface, segments[0], left), contour_sides(surface, segments[1], right)) for surface in surfaces
    ]


def on_contours(
    indices: tuple[IntArray | Int32Array, IntArray | Int32Array], contours: Sequence[tuple[Int8Array, Int8Array]]
) -> BoolArray:
    """Matched segments that show an occluding contour, in both images or beyond doubt in one.

    Parameters
    ----------
    indices : ((n,) int, (n,) int)
        The matched segments, left and right.
    contours : sequence of pairs of (m,) int8
        Of all segments, as of :func:`contours_of`.

    Returns
    -------
    (n,) bool
    """
    result = np.zeros(len(indices[0]), bool)
    for left, right in contours:
        here, there = left[indices[0]], right[indices[1]]
        result |= (here != 0) & (here == there)
    return result
