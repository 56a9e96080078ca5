"""Lenses that distort, as sensor_msgs/CameraInfo names them: where a raw camera sees what an ideal one would see.

Places in the image plane are (x, y) = (X / Z, Y / Z), without unit; K makes pixels of them.

References
----------
OpenCV, "Camera calibration and 3D reconstruction", detailed description (the polynomials of plumb_bob and
rational_polynomial); Kannala and Brandt, IEEE PAMI 28(8), 2006 (equidistant, OpenCV's fisheye); D. C. Brown,
"Decentering distortion of lenses", Photogrammetric Engineering 32, 1966.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .camera import PinholeCamera
from .numeric.typed import FloatArray
from .settings import LENS_COEFFICIENTS, LENS_ROUNDING, LENS_STEPS, LENS_TABLE, WIDEST_RAY


@dataclass(frozen=True)
class LensDistortion:
    """The distortion of one lens.

    Parameters
    ----------
    model : str
        'plumb_bob' (k1, k2, p1, p2, k3), 'rational_polynomial' (k1, k2, p1, p2, k3, k4, k5, k6) or 'equidistant'
        (k1, k2, k3, k4).
    coefficients : sequence of float
        As many as the model has.

    Raises
    ------
    ValueError
        Names the field.

    Examples
    --------
    A barrel, which draws the corners inwards:

    >>> lens = LensDistortion('plumb_bob', (-0.2, 0.0, 0.0, 0.0, 0.0))
    >>> lens.distort([0.5, 0.0]).round(3).tolist()
    [0.475, 0.0]
    >>> lens.undistort([0.475, 0.0]).round(9).tolist()
    [0.5, 0.0]
    """

    model: str
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in LENS_COEFFICIENTS:
            raise ValueError(f'model: expected one of {", ".join(LENS_COEFFICIENTS)}, got {self.model!r}')
        values = tuple(float(value) for value in self.coefficients)
        if len(values) != LENS_COEFFICIENTS[self.model] or not np.isfinite(values).all():
            raise ValueError(
                f'coefficients: {self.model} has {LENS_COEFFICIENTS[self.model]} finite numbers, got {list(values)}'
            )
        object.__setattr__(self, 'coefficients', values)

    @cached_property
    def _radial(self) -> tuple[np.poly1d, np.poly1d]:
        """Numerator and denominator of the radial factor, in the square of the radius (or of the angle)."""
        if self.model == 'equidistant':
            k1, k2, k3, k4 = self.coefficients
            return np.poly1d([k4, k3, k2, k1, 1.0]), np.poly1d([1.0])
        k1, k2, _, _, k3, *below = self.coefficients
        k4, k5, k6 = below or (0.0, 0.0, 0.0)
        return np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])

    @cached_property
    def widest(self) -> float:
        """The radius of the image plane up to which the lens maps one to one; beyond, it folds back, or ends."""
        above, below = self._radial
        square = np.poly1d([1.0, 0.0])
        # Where d/dr (r above / below) is not positive any more, or below vanishes.
        slope = above * below + 2.0 * square * (above.deriv() * below - above * below.deriv())
        roots = np.concatenate([slope.roots, below.roots])
        folds = [root.real for root in roots if root.real > 0.0 and abs(root.imag) <= LENS_ROUNDING * abs(root)]
        limit = np.sqrt(min(folds, default=np.inf))
        if self.model == 'equidistant':
            limit = np.tan(min(limit, np.arctan(WIDEST_RAY)))
        return float(min(limit, WIDEST_RAY))

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Radii (of equidistant: angles) at which the lens maps one to one, and where it puts them."""
        most = np.arctan(self.widest)
        # Even steps of the angle: the radius goes far out.
        angle = np.linspace(0.0, most, LENS_TABLE)
        inner = angle if self.model == 'equidistant' else np.tan(angle)
        above, below = self._radial
        return inner, inner * above(inner**2) / below(inner**2)

    def distort(self, points: ArrayLike) -> FloatArray:
        """Where the raw camera sees what an ideal one sees at some places.

        Parameters
        ----------
        points : (..., 2) array_like of float64
            (x, y) of the image plane.

        Returns
        -------
        (..., 2) float64
            NaN beyond :attr:`widest`.
        """
        p = np.asarray(points, dtype=np.float64)
        square = (p * p).sum(axis=-1)
        with np.errstate(invalid='ignore'):
            seen = square <= self.widest**2
        p = np.where(seen[..., None], p, np.nan)
        return self._mapped(p)[0]

    def undistort(self, points: ArrayLike) -> FloatArray:
        """The inverse of :meth:`distort`, by Newton's method.

        Parameters
        ----------
        points : (..., 2) array_like of float64
            (x, y) where the raw camera sees something: its pixels, of which K is taken away.

        Returns
        -------
        (..., 2) float64
            NaN where no ray arrives: beyond the circle that the lens fills, and beyond 89 degrees.
        """
        there = np.asarray(points, dtype=np.float64)
        radius = np.hypot(there[..., 0], there[..., 1])
        inner, outer = self._table
        with np.errstate(invalid='ignore', divide='ignore'):
            start = np.interp(radius, outer, inner)
            if self.model == 'equidistant':
                stretch = np.tan(self._angle(radius, start)) / np.where(radius > 0.0, radius, 1.0)
                result: FloatArray = there * np.where(radius == 0.0, 1.0, stretch)[..., None]
                return result
            p = there * (start / np.where(radius > 0.0, radius, 1.0))[..., None]
            for _ in range(LENS_STEPS):
                mapped, (xx, xy, yy) = self._mapped(p)
                left = there - mapped
                determinant = xx * yy - xy * xy
                step = np.stack([yy * left[..., 0] - xy * left[..., 1], xx * left[..., 1] - xy * left[..., 0]], axis=-1)
                step /= np.where(determinant > 0.0, determinant, np.nan)[..., None]
                p = p + step
                if not np.nanmax(np.abs(step), initial=0.0) > LENS_ROUNDING**2:
                    break
            far = np.abs(self._mapped(p)[0] - there).max(axis=-1) > LENS_ROUNDING
            outside = far | ~((p * p).sum(axis=-1) <= self.widest**2)
        result = np.where(outside[..., None], np.nan, p)
        return result

    def project(self, camera: PinholeCamera, points: ArrayLike) -> FloatArray:
        """Raw pixels where a camera behind the lens sees points.

        Parameters
        ----------
        camera : PinholeCamera
            Its calibration matrix is that of the raw camera.
        points : (..., 3) array_like of float64
            Metres, camera frame.

        Returns
        -------
        (..., 2) float64
            (u, v), pixels; NaN for what the lens does not show.
        """
        return self._pixels(camera, self.distort(camera.rays(camera.project(points))[..., :2]))

    def rays(self, camera: PinholeCamera, pixels: ArrayLike) -> FloatArray:
        """The viewing directions of raw pixels.

        Parameters
        ----------
        camera : PinholeCamera
            Its calibration matrix is that of the raw camera.
        pixels : (..., 2) array_like of float64
            (u, v), pixels.

        Returns
        -------
        (..., 3) float64
            Directions with z = 1, camera frame; NaN where no ray arrives.
        """
        xy = self.undistort(camera.rays(pixels)[..., :2])
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)

    @staticmethod
    def _pixels(camera: PinholeCamera, xy: FloatArray) -> FloatArray:
        return np.stack([camera.fx * xy[..., 0] + camera.cx, camera.fy * xy[..., 1] + camera.cy], axis=-1)

    def _angle(self, radius: FloatArray, start: FloatArray) -> FloatArray:
        """Angles from the axis of what a fisheye shows at some radii."""
        above, _ = self._radial
        slope = above + 2.0 * np.poly1d([1.0, 0.0]) * above.deriv()
        angle = start
        for _ in range(LENS_STEPS):
            angle = angle - (angle * above(angle**2) - radius) / slope(angle**2)
        arrived = np.abs(angle * above(angle**2) - radius) <= LENS_ROUNDING
        result: FloatArray = np.where(arrived & (angle <= np.arctan(self.widest)), angle, np.nan)
        return result

    def _mapped(self, p: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Where places are seen, and of the polynomials the derivative there: symmetric, (xx, xy, yy)."""
        x, y = p[..., 0], p[..., 1]
        square = x * x + y * y
        above, below = self._radial
        if self.model == 'equidistant':
            radius = np.sqrt(square)
            angle = np.arctan(radius)
            factor = angle * above(angle**2) / np.where(radius > 0.0, radius, 1.0)
            mapped = p * np.where(radius > 0.0, factor, 1.0)[..., None]
            return mapped, (factor, factor, factor)
        _, _, p1, p2, *_ = self.coefficients
        radial = above(square) / below(square)
        growth = (above.deriv()(square) - radial * below.deriv()(square)) / below(square)
        mapped = np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )
        xx = radial + 2.0 * x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * growth + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + 2.0 * y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x
        return mapped, (xx, xy, yy)
