"""How far the right camera of a rectified pair has turned since it was calibrated, from the rows of the pair itself.

A camera that turns by small angles (a, b, c) about its axes x, y and z moves what it sees at (x, y), in focal lengths
from its principal point, by a (1 + y^2) - b x y - c x focal lengths downwards (Longuet-Higgins and Prazdny 1980, of a
camera that only turns). So the rows tell pitch and roll at first order; yaw shows in them at second order only, in the
corners of the image, and otherwise as a disparity that no pair can tell from a depth. A lens that has changed its focal
length adds a share of y. A camera that has moved up or down by a little of the baseline looks as if it had pitched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import FloatArray

from .row_error import RowWitnesses, information, near_rows
from .row_kernels import robust_fit
from .settings import CALIBRATION_ROW_SIGMA, DRIFT_FALSE_ALARM, ROW_CELL, ROW_SHIFT_MOST, ROW_TURN_SIGMA

AXES = ('pitch', 'yaw', 'roll')
"""Turns about the camera's x (up is positive), y (to the right) and z (clockwise, as seen from behind)."""


@dataclass(frozen=True, eq=False)
class RigError:
    """The residual rotation of the right camera, calibrated_R_actual, and what its rows are off by.

    Attributes
    ----------
    rotation : (3,) float64, radians
        About the right camera's x, y and z: pitch, yaw, roll.
    stretch : float
        Relative change of its focal length.
    covariance : (4, 4) float64
        Of both.
    row_sigma : float, pixels
        What single rows differ by from that.
    count : int
        Corners, edges along the rows and strips of texture that tell it.
    rig : StereoRig
        As it was calibrated.
    """

    rotation: FloatArray
    stretch: float
    covariance: FloatArray
    row_sigma: float
    count: int
    rig: StereoRig

    @property
    def sigma(self) -> FloatArray:
        """(3,) float64, radians: of the rotation."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))

    def rows_at(self, points: FloatArray) -> FloatArray:
        """(k,) float64, pixels: how much lower than calibrated points (k, 2) of the right image are."""
        return np.asarray(_columns(points, self.rig) @ np.append(self.rotation, self.stretch))

    @property
    def offset_px(self) -> float:
        """Pixels by which rows are off in the middle of the image."""
        camera = self.rig.right
        return float(self.rows_at(0.5 * np.array([[camera.width - 1.0, camera.height - 1.0]]))[0])

    @property
    def most_px(self) -> float:
        """Pixels by which rows are off in the worst corner of the image."""
        u, v = self.rig.right.width - 1.0, self.rig.right.height - 1.0
        return float(np.abs(self.rows_at(np.array([[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]]))).max())

    @property
    def tells(self) -> bool:
        """Whether it would show if the camera had turned as far as pairs can be matched."""
        return bool(FARTHEST * self.sigma[0] * self.rig.right.fy < ROW_SHIFT_MOST)

    def distance(self, calibration_sigma: float = CALIBRATION_ROW_SIGMA) -> float:
        """Mahalanobis distance of pitch and roll from those of a rig as good as it was calibrated.

        Parameters
        ----------
        calibration_sigma : float, pixels
            What a calibration leaves the rows off by, in the middle and from there to the border.
        """
        camera = self.rig.right
        fresh = calibration_sigma * np.array([1.0 / camera.fy, 2.0 / camera.width])
        covariance = self.covariance[np.ix_([0, 2], [0, 2])] + np.diag(fresh**2)
        turn = self.rotation[[0, 2]]
        return float(np.sqrt(turn @ np.linalg.solve(covariance, turn)))

    def has_drifted(self, calibration_sigma: float = CALIBRATION_ROW_SIGMA) -> bool:
        """Whether pitch and roll are farther from zero than chance and a fresh calibration explain."""
        return self.distance(calibration_sigma) > FARTHEST

    def verdict(self, calibration_sigma: float = CALIBRATION_ROW_SIGMA) -> str:
        """One line for people: whether the rig has drifted, and by how much."""
        if not self.tells:
            return f'too little is seen at one height in both images to tell whether the rig has drifted ({self})'
        said = 'the rig has drifted since it was calibrated' if self.has_drifted(calibration_sigma) else 'no drift'
        return f'{said}: {self}; {self.distance(calibration_sigma):.1f} sigma, of which {FARTHEST:.1f} are chance'

    def __str__(self) -> str:
        angles = ', '.join(
            f'{name} {turn:+.3f} +- {sigma:.3f}'
            for name, turn, sigma in zip(AXES, np.degrees(self.rotation), np.degrees(self.sigma))
        )
        return f'{angles} deg; rows off by {self.offset_px:+.2f} px in the middle, at most {self.most_px:.2f} px'


# Mahalanobis distance of two numbers beyond which a rig in order is found once in so many: chi-squared of two degrees.
FARTHEST = float(np.sqrt(-2.0 * np.log(DRIFT_FALSE_ALARM)))


class PairRows(NamedTuple):
    """What a pair shows of its rows: witnesses of a rectified pair of this rig, and the least sigma of rows, pixels."""

    witnesses: RowWitnesses
    rig: StereoRig
    least: float


def rig_error(witnesses: RowWitnesses, rig: StereoRig, least: float) -> RigError:
    """The residual rotation of the right camera of a pair.

    Parameters
    ----------
    witnesses : RowWitnesses
        Places that both images show; some may be none.
    rig : StereoRig
    least : float, pixels
        Least sigma of single rows.
    """
    point, off, sigma = near_rows(witnesses)
    columns = _columns(point, rig)
    camera = rig.right
    # A rig that has turned farther is not matched; a lens changes its rows no more than rigs are seen to.
    widest = np.array([*[ROW_SHIFT_MOST / camera.fy] * 3, 2.0 * ROW_TURN_SIGMA / camera.height])
    prior = np.diag(widest**-2.0)
    value, single = robust_fit(columns, off, sigma, prior, least)
    # What single rows differ by is the same for neighbours (a lens, a strip of one texture), who repeat one another.
    _, cell, count = np.unique((point // ROW_CELL).astype(int), axis=0, return_inverse=True, return_counts=True)
    shared = single * np.sqrt(count[cell.ravel()])
    told = information(columns, off - columns @ value, sigma, shared) + prior
    covariance = np.asarray(np.linalg.inv(told), np.float64)
    return RigError(value[:3], float(value[3]), covariance, single, len(off), rig)


def mean_error(errors: Sequence[RigError]) -> RigError:
    """What several pairs of one rig say together, with counts of the last one.

    Pairs of one scene repeat one another's errors: their mean is taken, and is no more certain than one of them.
    """
    told = np.linalg.inv(np.stack([error.covariance for error in errors]))
    values = np.stack([np.append(error.rotation, error.stretch) for error in errors])
    total = told.sum(axis=0)
    value = np.asarray(np.linalg.solve(total, np.einsum('kij,kj->i', told, values)), np.float64)
    covariance = np.asarray(np.linalg.inv(total / len(errors)), np.float64)
    return replace(errors[-1], rotation=value[:3], stretch=float(value[3]), covariance=covariance)


def _columns(point: FloatArray, rig: StereoRig) -> FloatArray:
    """(k, 4) float64: pixels downwards at points (k, 2) for a radian about each axis, and a doubled focal length."""
    camera = rig.right
    x, y = (point[:, 0] - camera.cx) / camera.fx, (point[:, 1] - camera.cy) / camera.fy
    return np.asarray(camera.fy * np.stack([1.0 + y**2, -x * y, -x, y], axis=1))
