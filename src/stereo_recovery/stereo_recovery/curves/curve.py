"""A circle or ellipse in space: what it is, what a camera sees of it, and where on it a pixel lies."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py import PinholeCamera


@dataclass(frozen=True, eq=False)
class Curve:
    """A planar curve, left optical frame, metres.

    centre, normal, first : (3,) float64; first is the unit direction of the major radius; radii : (2,) major, minor
    covariance : (6, 6) of centre (x, y, z) and of the normal's two tilts (about first and normal x first), and the
        major radius; rms : pixels; left, right : bool over the edgels of the two images; arc : start and extent,
        radians from first about the normal; coverage : share of the curve that is seen; misfit : how many times
        larger the residuals are than the edgels state
    """

    centre: np.ndarray
    normal: np.ndarray
    first: np.ndarray
    radii: np.ndarray
    covariance: np.ndarray
    rms: float
    left: np.ndarray
    right: np.ndarray
    arc: tuple[float, float] = (0.0, 2.0 * np.pi)
    coverage: float = 1.0
    misfit: float = 1.0

    @property
    def second(self) -> np.ndarray:
        return cross(self.normal, self.first)

    @property
    def tilt(self) -> float:
        """Radians, one sigma of the normal in its worst direction."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[3:5, 3:5])[-1], 0.0)))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3,) vector product of two vectors (3,); numpy's own takes ten times as long for so few numbers."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def picture(curve: Curve, matrix: np.ndarray, eye: float) -> np.ndarray:
    """(3, 3) float64: the conic that a camera at (eye, 0, 0) with calibration matrix sees, negative inside."""
    return _conic(curve.centre, curve.radii[0] * curve.first, curve.radii[1] * curve.second, matrix, eye)


def _conic(centre: np.ndarray, major: np.ndarray, minor: np.ndarray, matrix: np.ndarray, eye: float) -> np.ndarray:
    plane = matrix @ np.stack([major, minor, centre - [eye, 0.0, 0.0]], axis=1)
    inverse = np.linalg.inv(plane)
    conic = inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse
    conic = conic / np.abs(conic).max()
    return -conic if np.trace(conic[:2, :2]) < 0.0 else conic


def angles(
    centre: np.ndarray,
    normal: np.ndarray,
    first: np.ndarray,
    radii: np.ndarray,
    points: np.ndarray,
    camera: PinholeCamera,
    eye: float,
) -> np.ndarray:
    """(n,) radians: where on a curve pixels (n, 2) of an image lie (0 at first, about the normal)."""
    rays = camera.rays(points)
    origin = np.array([eye, 0.0, 0.0])
    offset = origin + rays * ((centre - origin) @ normal / (rays @ normal))[:, None] - centre
    return np.arctan2(offset @ cross(normal, first) / radii[1], offset @ first / radii[0])


def turned(curve: Curve) -> Curve:
    """The same curve with the opposite normal; the major axis stays, so angles change sign."""
    start, extent = curve.arc
    flipped = (0.0, extent) if extent >= 2.0 * np.pi else ((-(start + extent)) % (2.0 * np.pi), extent)
    sign = np.ones(6)
    sign[4] = -1.0
    return replace(curve, normal=-curve.normal, arc=flipped, covariance=curve.covariance * np.outer(sign, sign))
