"""A circle or ellipse in space: what it is, what a camera sees of it, and where on it a pixel lies."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig
from msgs_py.numeric.covariances import semidefinite
from msgs_py.numeric.typed import BoolArray, FloatArray


class CurveShape(NamedTuple):
    """Where a planar curve is; what the compiled least squares change.

    Attributes
    ----------
    centre : (3,) float64
        Metres. Left optical frame.
    normal, first : (3,) float64, unit
        The plane's normal, and the direction of the major radius.
    radii : (2,) float64
        Metres. Major and minor.
    """

    centre: FloatArray
    normal: FloatArray
    first: FloatArray
    radii: FloatArray


class CameraView(NamedTuple):
    """One camera of a rectified pair and where it stands.

    Attributes
    ----------
    camera : PinholeCamera
    x : float
        Metres. The camera's centre is (x, 0, 0) in the left optical frame.
    """

    camera: PinholeCamera
    x: float

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) float64: the calibration matrix."""
        return self.camera.matrix

    @property
    def centre(self) -> FloatArray:
        """(3,) float64, metres, left optical frame."""
        return np.array([self.x, 0.0, 0.0])

    @property
    def intrinsics(self) -> FloatArray:
        """(4,) float64, pixels: fx, fy, cx, cy."""
        return np.array([self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy])


def camera_views(rig: StereoRig) -> tuple[CameraView, CameraView]:
    """The two cameras of a rig, left and right."""
    return CameraView(rig.left, 0.0), CameraView(rig.right, rig.baseline)


@dataclass(frozen=True, eq=False)
class Curve:
    """A planar curve with its uncertainty, left optical frame, metres.

    Parameters
    ----------
    centre, normal, first : (3,) float64
        Centre, unit normal of the plane, unit direction of the major radius.
    radii : (2,) float64
        Metres. Major and minor; equal for a circle.
    covariance : (6, 6) float64
        Of the centre (x, y, z), of the normal's tilts about first and about normal x first (radians), and of the major
        radius.
    rms : float
        Pixels. Root mean square of the edgels' distances from the image conics.
    left, right : (n,) bool
        Which edgels of the left and of the right image belong to it.
    arc : (float, float), radians
        Start and extent of the visible part, from first about the normal.
    coverage : float
        Share of the curve that is seen.
    misfit : float
        Ratio of the residuals to what the edgels' stated sigma predicts.
    evidence : float
        Nats by which the edgels near it speak for the curve rather than for texture.
    """

    centre: FloatArray
    normal: FloatArray
    first: FloatArray
    radii: FloatArray
    covariance: FloatArray
    rms: float
    left: BoolArray
    right: BoolArray
    arc: tuple[float, float] = (0.0, 2.0 * np.pi)
    coverage: float = 1.0
    misfit: float = 1.0
    evidence: float = 0.0

    def transformed(self, pose: Pose) -> Curve:
        """The curve in another frame, which differs by a rigid motion, target_T_source."""
        turn = np.eye(6)
        turn[:3, :3] = pose.rotation
        return replace(
            self,
            centre=pose.apply(self.centre),
            normal=pose.rotate(self.normal),
            first=pose.rotate(self.first),
            covariance=turn @ self.covariance @ turn.T,
        )

    @classmethod
    def unfitted(cls, shape: CurveShape) -> Curve:
        """A curve to start a fit from: without covariance and edgels."""
        none = np.zeros(0, bool)
        return cls(*shape, np.zeros((6, 6)), np.inf, none, none)

    @property
    def second(self) -> FloatArray:
        """(3,) float64: direction of the minor radius."""
        return cross(self.normal, self.first)

    @property
    def is_circle(self) -> bool:
        """Whether both radii are one number."""
        return bool(self.radii[0] == self.radii[1])

    @cached_property
    def tilt(self) -> float:
        """Radians, one sigma of the normal in its worst direction."""
        (a, b), (_, d) = self.covariance[3:5, 3:5].tolist()
        # The larger eigenvalue.
        return math.sqrt(max(0.5 * (a + d) + math.hypot(0.5 * (a - d), b), 0.0))

    @property
    def centre_and_normal_covariance(self) -> FloatArray:
        """(6, 6) of the centre, metres, and of the unit normal: a tilt about first moves it along second."""
        moved = np.zeros((6, 5))
        moved[:3, :3] = np.eye(3)
        moved[3:, 3], moved[3:, 4] = self.second, -self.first
        return np.asarray(moved @ self.covariance[:5, :5] @ moved.T)

    @cached_property
    def shape(self) -> CurveShape:
        """Centre, normal, first and radii as the compiled functions take them."""
        parts = (self.centre, self.normal, self.first, self.radii)
        return CurveShape(*(np.ascontiguousarray(part, dtype=np.float64) for part in parts))

    def with_shape(self, shape: CurveShape) -> Curve:
        """The same curve elsewhere; everything else stays."""
        return replace(self, centre=shape.centre, normal=shape.normal, first=shape.first, radii=shape.radii)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector product of two vectors; numpy's own takes ten times as long for so few numbers.

    Parameters
    ----------
    a, b : (3,) float64

    Returns
    -------
    (3,) float64

    Examples
    --------
    >>> cross(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])).tolist()
    [0.0, 0.0, 1.0]
    """
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def perpendicular(direction: FloatArray) -> FloatArray:
    """(3,) float64: a vector square to a direction (3,), of a length between 0.8 and 1 for a unit direction."""
    return cross(direction, np.eye(3)[np.argmin(np.abs(direction))])


def image_conic(curve: Curve, view: CameraView) -> FloatArray:
    """The conic that a camera sees of a curve.

    Parameters
    ----------
    curve : Curve
        Left optical frame.
    view : CameraView
        The camera.

    Returns
    -------
    (3, 3) float64
        Symmetric matrix C of the conic x^T C x = 0 in homogeneous pixels; negative inside.

    References
    ----------
    Hartley and Zisserman, Multiple View Geometry, 2nd edition, section 8.1: a plane's points map by a homography H, a
    conic in it by H^-T C H^-1.

    Examples
    --------
    A circle of 10 mm seen face on from 0.2 m, f = 100 pixels, has a radius of 5 pixels:

    >>> camera = PinholeCamera(21, 21, 100.0, 100.0, 10.0, 10.0)
    >>> axes = np.eye(3)
    >>> curve = Curve.unfitted(CurveShape(0.2 * axes[2], axes[2], axes[0], np.full(2, 0.01)))
    >>> conic = image_conic(curve, CameraView(camera, 0.0))
    >>> edge = np.array([15.0, 10.0, 1.0])
    >>> bool(abs(edge @ conic @ edge) < 1e-12)
    True
    """
    major, minor = curve.radii[0] * curve.first, curve.radii[1] * curve.second
    a, b, c = (view.matrix @ part for part in (major, minor, curve.centre - [view.x, 0.0, 0.0]))
    # Rows of the homography's inverse, up to its determinant.
    rows = np.array([cross(b, c), cross(c, a), cross(a, b)])
    conic: FloatArray = rows[:2].T @ rows[:2] - np.outer(rows[2], rows[2])
    conic = conic / np.abs(conic).max()
    return -conic if conic[0, 0] + conic[1, 1] < 0.0 else conic


def angles(curve: Curve | CurveShape, points: FloatArray, view: CameraView) -> FloatArray:
    """Where on a curve pixels of an image lie.

    Parameters
    ----------
    curve : Curve or CurveShape
        Left optical frame.
    points : (n, 2) float64, pixels
        They are back-projected onto the curve's plane.
    view : CameraView
        Whose image it is.

    Returns
    -------
    (n,) float64, radians
        0 in the direction first, counted about the normal.
    """
    rays = view.camera.rays(points)
    origin = view.centre
    offset = origin + rays * ((curve.centre - origin) @ curve.normal / (rays @ curve.normal))[:, None] - curve.centre
    second = cross(curve.normal, curve.first)
    angle: FloatArray = np.arctan2(offset @ second / curve.radii[1], offset @ curve.first / curve.radii[0])
    return angle


def flipped(curve: Curve) -> Curve:
    """The same curve with the opposite normal; the major axis stays, so angles change sign.

    Parameters
    ----------
    curve : Curve

    Returns
    -------
    Curve

    Examples
    --------
    >>> shape = CurveShape(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.ones(2))
    >>> quarter = replace(Curve.unfitted(shape), arc=(0.0, 0.5 * np.pi))
    >>> [round(angle / np.pi, 9) for angle in flipped(quarter).arc]
    [1.5, 0.5]
    """
    start, extent = curve.arc
    arc = (0.0, extent) if extent >= 2.0 * np.pi else ((-(start + extent)) % (2.0 * np.pi), extent)
    sign = np.ones(6)
    sign[4] = -1.0
    return replace(curve, normal=-curve.normal, arc=arc, covariance=curve.covariance * np.outer(sign, sign))


def curve_features(curves: list[Curve]) -> FeatureSet:
    """Curves as features of kind CURVE.

    Parameters
    ----------
    curves : list of Curve
        Left optical frame, metres.

    Returns
    -------
    FeatureSet
        In the same order, with the covariance of centre and normal.
    """
    if not curves:
        return FeatureSet.empty()
    return FeatureSet.from_curves(
        [c.centre for c in curves],
        [c.normal for c in curves],
        [c.radii for c in curves],
        major_axis=[c.first for c in curves],
        arc=[c.arc for c in curves],
        covariance=semidefinite(np.stack([c.centre_and_normal_covariance for c in curves])),
    )
