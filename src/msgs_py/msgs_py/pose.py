"""Rigid (or similarity) transforms between frames.

A :class:`Pose` named ``camera_T_model`` takes points of the model frame to the camera frame:
``p_camera = scale * R p_model + t``. Column form throughout; a matrix printed in the thesis
(row vectors, p' = p R) is the transpose of ``rotation``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._checks import as_finite
from .numeric.spatial import rotations
from .numeric.typed import FloatArray
from .settings import ORTHONORMAL_TOLERANCE, SHORTEST_QUATERNION


class PoseError(NamedTuple):
    """How far one pose is from another.

    Attributes
    ----------
    rotation : float
        Angle, radians.
    translation : float
        Distance of the origins, metres.
    scale : float
        Ratio of the scales minus one.

    Examples
    --------
    >>> round(PoseError(rotation=0.01, translation=0.0, scale=0.0).rotation_deg, 3)
    0.573
    """

    rotation: float
    translation: float
    scale: float

    @property
    def rotation_deg(self) -> float:
        """The angle in degrees."""
        return float(np.degrees(self.rotation))


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion, with a uniform scale for data of unknown size.

    Parameters
    ----------
    rotation : (3, 3) float64
        Orthonormal, determinant +1 (column form).
    translation : (3,) float64
        Metres, target frame.
    scale : float
        Above 0; 1 unless the data's size is unknown.

    Raises
    ------
    ValueError
        Names the argument: a wrong shape, a value that is not finite, no rotation.

    Examples
    --------
    >>> camera_T_model = Pose.from_rotation_vector([0, 0, np.pi / 2], translation=[0, 0, 0.5])
    >>> camera_T_model.apply([0.1, 0.0, 0.0]).round(6).tolist()
    [0.0, 0.1, 0.5]
    >>> camera_T_model.compose(camera_T_model.inverse()) == Pose.identity()
    True
    """

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0

    def __post_init__(self) -> None:
        rotation = as_finite('rotation', self.rotation, (3, 3))
        translation = as_finite('translation', self.translation, (3,))
        scale = float(self.scale)
        if not np.isfinite(scale) or scale <= 0.0:
            raise ValueError(f'scale: expected a finite number > 0, got {scale}')
        departure, determinant = _departure(rotation)
        if departure > ORTHONORMAL_TOLERANCE:
            raise ValueError(f'rotation: not orthonormal, R R^T differs from the identity by {departure:.2g}')
        if determinant < 0.0:
            raise ValueError('rotation: determinant is -1, a reflection, expected +1')
        object.__setattr__(self, 'rotation', rotation)
        object.__setattr__(self, 'translation', translation)
        object.__setattr__(self, 'scale', scale)

    @classmethod
    def identity(cls) -> Pose:
        """The motion that changes nothing."""
        return cls()

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Pose:
        """The pose of a homogeneous matrix.

        Parameters
        ----------
        matrix : (4, 4) array_like of float64
            Column form, metres; its upper left block is a positive multiple of a rotation.

        Raises
        ------
        ValueError
            When it is not of that form.
        """
        m = as_finite('matrix', matrix, (4, 4))
        if np.abs(m[3] - [0, 0, 0, 1]).max() > ORTHONORMAL_TOLERANCE:
            raise ValueError(f'matrix: last row is {m[3]}, expected 0 0 0 1')
        determinant = np.linalg.det(m[:3, :3])
        if determinant <= 0.0:
            raise ValueError(f'matrix: determinant {determinant:.3g} of the upper left block, expected > 0')
        scale = np.cbrt(determinant)
        return cls(m[:3, :3] / scale, m[:3, 3], scale)

    @classmethod
    def from_quaternion(cls, xyzw: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """The pose of a quaternion and a translation.

        Parameters
        ----------
        xyzw : (4,) array_like of float64
            Quaternion in the order of ROS; it is normalised.
        translation : (3,) array_like of float64
            Metres, target frame.

        Raises
        ------
        ValueError
            When the quaternion's norm is zero.
        """
        q = as_finite('quaternion', xyzw, (4,))
        norm = np.linalg.norm(q)
        if norm < SHORTEST_QUATERNION:
            raise ValueError('quaternion: norm is zero; an unset message field?')
        return cls(rotations().from_quat(q / norm).as_matrix(), np.asarray(translation, float))

    @classmethod
    def from_rotation_vector(cls, rotation_vector: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """The pose of a rotation vector and a translation.

        Parameters
        ----------
        rotation_vector : (3,) array_like of float64
            Axis times angle, radians, as OpenCV's rvec.
        translation : (3,) array_like of float64
            Metres, target frame.
        """
        vector = as_finite('rotation_vector', rotation_vector, (3,))
        return cls(rotations().from_rotvec(vector).as_matrix(), np.asarray(translation, float))

    @property
    def matrix(self) -> FloatArray:
        """The homogeneous matrix, (4, 4) float64, column form, scale included."""
        m = np.eye(4)
        m[:3, :3] = self.scale * self.rotation
        m[:3, 3] = self.translation
        return m

    @property
    def quaternion(self) -> FloatArray:
        """The unit quaternion, (4,) float64, in the order of ROS (x, y, z, w), w >= 0 (Shepperd 1978)."""
        m = self.rotation.tolist()
        trace = m[0][0] + m[1][1] + m[2][2]
        # Four times the squares of the components, less 1: by the largest of them the others are divided.
        squares = [2.0 * m[k][k] - trace for k in range(3)] + [trace]
        i = squares.index(max(squares))
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        if i == 3:
            q[:] = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + trace
        else:
            q[[i, j, k, 3]] = 1.0 + squares[i], m[j][i] + m[i][j], m[k][i] + m[i][k], m[k][j] - m[j][k]
        q /= -math.sqrt(q @ q) if q[3] < 0.0 else math.sqrt(q @ q)
        return q

    @property
    def rotation_vector(self) -> FloatArray:
        """Axis times angle, (3,) float64, radians."""
        vector: FloatArray = rotations().from_matrix(self.rotation).as_rotvec()
        return vector

    def apply(self, points: ArrayLike) -> FloatArray:
        """Points in the target frame.

        Parameters
        ----------
        points : (..., 3) array_like of float64
            Metres, source frame.

        Returns
        -------
        (..., 3) float64
            Metres, target frame.
        """
        p = np.asarray(points, dtype=np.float64)
        moved: FloatArray = self.scale * (p @ self.rotation.T) + self.translation
        return moved

    def rotate(self, directions: ArrayLike) -> FloatArray:
        """Directions in the target frame.

        Parameters
        ----------
        directions : (..., 3) array_like of float64
            Source frame.

        Returns
        -------
        (..., 3) float64
            Target frame, of the same lengths.
        """
        rotated: FloatArray = np.asarray(directions, dtype=np.float64) @ self.rotation.T
        return rotated

    def inverse(self) -> Pose:
        """The pose that takes points back: ``target_T_source.inverse()`` is ``source_T_target``."""
        rotation = self.rotation.T.copy()
        return _made(rotation, -(rotation @ self.translation) / self.scale, 1.0 / self.scale)

    def compose(self, other: Pose) -> Pose:
        """``a_T_b.compose(b_T_c)`` is ``a_T_c``: other is applied first."""
        rotation = self.rotation @ other.rotation
        # Long chains would drift away from orthonormal; one step of Newton's polar iteration holds them there.
        rotation = 1.5 * rotation - 0.5 * rotation @ rotation.T @ rotation
        return _made(rotation, self.apply(other.translation), self.scale * other.scale)

    def error_to(self, other: Pose) -> PoseError:
        """How far ``other`` is from this pose; angle and distance are the same in both directions."""
        relative = self.rotation.T @ other.rotation
        sine = 0.5 * np.linalg.norm(
            [relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0], relative[1, 0] - relative[0, 1]]
        )
        # atan2 keeps full precision near 0 and pi, where arccos of the trace loses half the digits.
        angle = float(np.arctan2(sine, 0.5 * (np.trace(relative) - 1.0)))
        distance = float(np.linalg.norm(self.translation - other.translation))
        return PoseError(angle, distance, other.scale / self.scale - 1.0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Pose):
            return NotImplemented
        return (
            self.scale == other.scale
            and np.array_equal(self.rotation, other.rotation)
            and np.array_equal(self.translation, other.translation)
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        rv = np.degrees(self.rotation_vector)
        t = self.translation
        scale = '' if self.scale == 1.0 else f', scale={self.scale:.6g}'
        return (
            f'Pose(rotation_vector_deg=[{rv[0]:.4g}, {rv[1]:.4g}, {rv[2]:.4g}], '
            f'translation=[{t[0]:.6g}, {t[1]:.6g}, {t[2]:.6g}]{scale})'
        )


def _made(rotation: FloatArray, translation: FloatArray, scale: float) -> Pose:
    """A pose made of poses: that it is one need not be looked at again, which takes as long as all the rest."""
    pose = object.__new__(Pose)
    object.__setattr__(pose, 'rotation', rotation)
    object.__setattr__(pose, 'translation', translation)
    object.__setattr__(pose, 'scale', scale)
    return pose


def _departure(rotation: FloatArray) -> tuple[float, float]:
    """Largest element of R R^T - I, and the determinant; a tenth of the time that numpy needs for 3 x 3."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    departure = max(
        abs(a * a + b * b + c * c - 1.0),
        abs(d * d + e * e + f * f - 1.0),
        abs(g * g + h * h + i * i - 1.0),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
    )
    return departure, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
