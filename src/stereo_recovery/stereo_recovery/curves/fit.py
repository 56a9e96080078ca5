"""The least squares of one curve on the edgels of two images, alone or held by the axis of another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.vectors import perpendicular

from ..detection.edgels import Edgels
from ..detection.segments import CORRELATION_LENGTH
from . import fit_kernels
from .curve import Curve, angles, cross

# The light displaces edgels by so much (pixels, one sigma) that is the same all over one of so many sectors.
COMMON_SHIFT = 0.02
SECTORS = 12
# The same for what is the same all round (how far a lens blurs is guessed), and shares of an edgel's own sigma that
# behave so: stairs of pictures without anti-aliasing.
EVERYWHERE_SHIFT = 0.01
COMMON_SHARE = 0.5
EVERYWHERE_SHARE = 0.2
# Times the sigma of the radius: an edge, a contour or a second rim a few pixels beside a rim pulls it in or out as a
# whole, and the edgels do not tell.
RADIUS_WIDER = 1.25
# An ellipse whose radii differ by less than so many sigma cannot be told from a circle.
OBLONG = 4.0


@dataclass(frozen=True, eq=False)
class Axle:
    """The axis of a curve that is well known, on which another one may lie.

    point, direction : (3,) float64, metres; spread : (3, 3) float64 of the point; tilt : radians, one sigma
    """

    point: np.ndarray
    direction: np.ndarray
    spread: np.ndarray
    tilt: float

    @property
    def table(self) -> np.ndarray:
        """(4, 3) float64: point, direction, two directions across it."""
        return np.concatenate([[self.point, self.direction], self._across])

    def residual(self, centre: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(4,): the normal's tilt against the axis, and the centre's offset from it."""
        across = self._across
        return np.concatenate([across @ normal * np.sign(self.direction @ normal), across @ (centre - self.point)])

    def jacobian(self, normal: np.ndarray, first: np.ndarray) -> np.ndarray:
        """(4, 5): of the residual by a curve's centre and its two tilts."""
        rows = np.zeros((4, 5))
        sign = np.sign(self.direction @ normal)
        rows[:2, 3], rows[:2, 4] = sign * self._across @ cross(normal, first), -sign * self._across @ first
        rows[2:, :3] = self._across
        return rows

    def covariance(self, centre: np.ndarray) -> np.ndarray:
        """(4, 4) float64 of the residual, as far as the axle is its cause."""
        result = np.zeros((4, 4))
        result[:2, :2] = self.tilt**2 * np.eye(2)
        reach = (centre - self.point) @ self.direction
        result[2:, 2:] = self._across @ self.spread @ self._across.T + (self.tilt * reach) ** 2 * np.eye(2)
        return result

    @cached_property
    def _across(self) -> np.ndarray:
        first = perpendicular(self.direction)
        return np.stack([first, cross(self.direction, first)])


def refine(
    curve: Curve,
    left: Edgels,
    right: Edgels,
    rig: StereoRig,
    blur: float,
    circle: bool,
    rounds: int = 12,
    axle: Axle | None = None,
    rough: bool = False,
) -> Curve | None:
    """Move the curve until both pictures lie on the edgels (Levenberg-Marquardt, Cauchy weights).

    left, right : edgels of the curve; blur : variance, px^2, of the smoothing that edgels have gone through: it pulls
    them towards the centre of curvature by blur / (2 R), which is taken off (exact for a blurred disc, to first order).
    axle : hold the curve to an axis; its covariance then must be the one it has without. rough : a circle whose
    covariance nobody needs yet; it is left as it was.
    Returns it with covariance and rms, or None when the fit does not settle, or when an ellipse is none.
    """
    if circle:
        curve = replace(curve, radii=np.full(2, float(np.sqrt(curve.radii.prod()))))
    points = np.concatenate([left.position, right.position])
    shift = np.concatenate([left.bias, right.bias])
    sigma = np.hypot(np.concatenate([left.sigma_position, right.sigma_position]), shift)
    if len(points) < 10:
        return None
    cameras = [np.array([c.fx, c.fy, c.cx, c.cy]) for c in (rig.left, rig.right)]
    r, bend = np.empty(len(points)), np.empty(len(points))
    size = 6 if circle else 8
    # How many times the edgels' own covariance the true one is; the axle has to be weighed against that.
    freedom = 2.0 * CORRELATION_LENGTH
    hold = np.zeros((0, 0)) if axle is None else np.linalg.inv(axle.covariance(curve.centre))
    told = points, len(left), cameras[0], cameras[1], float(rig.baseline), float(blur), sigma
    try:
        good, *state = fit_kernels.settle(
            curve.centre.copy(),
            curve.normal.copy(),
            curve.first.copy(),
            curve.radii.astype(float),
            circle,
            *told,
            rounds,
            np.zeros((4, 3)) if axle is None else axle.table,
            hold * freedom,
        )
        if not good:
            return None
        matrix, _, cost, weights, rows = fit_kernels.equations(*state, circle, *told, r, bend)
        if not np.isfinite(cost):
            return None
        if rough and circle:
            return replace(
                curve,
                centre=state[0],
                normal=state[1],
                first=state[2],
                radii=state[3],
                rms=float(np.sqrt(np.mean(np.minimum(r * r, 4.0)))),
            )
        if axle is not None:
            slope = axle.jacobian(state[1], state[2])
            matrix[:5, :5] += slope.T @ hold @ slope * freedom
        inverse = np.linalg.inv(matrix)
        # Edgels side by side are moved together by the light: such a displacement does not average out.
        sector = _sectors(state, points, len(left), rig)
        shared = fit_kernels.common(
            rows, weights, np.hypot(shift, COMMON_SHIFT + COMMON_SHARE * sigma), sector, 2 * SECTORS
        )
        shared += fit_kernels.common(
            rows, weights, EVERYWHERE_SHIFT + EVERYWHERE_SHARE * sigma, np.zeros(len(r), np.int64), 1
        )
        together = CORRELATION_LENGTH * max(1.0, float(weights @ (r * r)) / max(len(r) - size, 1))
        spread = matrix * together + shared
        if axle is not None:
            # What the axle says weighs as it does in the matrix, and is as uncertain as it says.
            slope = axle.jacobian(state[1], state[2])
            says = slope.T @ hold @ slope
            spread -= _widened(says * freedom * together, size) - _widened(says * freedom**2, size)
        covariance = inverse @ spread @ inverse
    except np.linalg.LinAlgError:
        return None
    centre, normal, first, radii = state
    if not circle and abs(np.log(radii[0] / radii[1])) < OBLONG * np.sqrt(
        max(covariance[5, 5] + covariance[6, 6] - 2.0 * covariance[5, 6], 0.0)
    ):
        return None
    covariance = covariance[:6, :6]
    covariance[5, :] *= RADIUS_WIDER * radii[0]
    covariance[:, 5] *= RADIUS_WIDER * radii[0]
    rms = float(np.sqrt(np.mean(np.minimum(r * r, 4.0))))
    if not (np.isfinite(covariance).all() and np.isfinite(rms) and (np.diag(covariance) >= 0.0).all()):
        return None
    if radii[0] < radii[1]:
        # The tilts are about the radii.
        first, radii = cross(normal, first), radii[::-1].copy()
        turn = np.eye(6)
        turn[3:5, 3:5] = [[0.0, 1.0], [-1.0, 0.0]]
        covariance = turn @ covariance @ turn.T
    misfit = float(np.median(np.abs(r) / sigma)) / 0.6745
    return replace(
        curve, centre=centre, normal=normal, first=first, radii=radii, covariance=covariance, rms=rms, misfit=misfit
    )


def _widened(matrix: np.ndarray, size: int) -> np.ndarray:
    result = np.zeros((size, size))
    result[: len(matrix), : len(matrix)] = matrix
    return result


def _sectors(state: tuple, points: np.ndarray, count: int, rig: StereoRig) -> np.ndarray:
    """(n,) int64: which image and which sector of the curve edgels are of; the first ``count`` are the left image's."""
    around = np.concatenate(
        [
            angles(state[0], state[1], state[2], state[3], p, camera, eye)
            for p, camera, eye in ((points[:count], rig.left, 0.0), (points[count:], rig.right, rig.baseline))
        ]
    )
    sector = np.floor(around / (2.0 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    sector[count:] += SECTORS
    return sector
