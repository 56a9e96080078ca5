"""A hypothesis about what the data shows: which model, which pairing, which pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ._checks import as_finite
from .pose import Pose

BIN = -1  # the assignment of a data feature that belongs to no model feature (thesis 5.10)


@dataclass(frozen=True, eq=False)
class Interpretation:
    """One interpretation of a set of data features (thesis 5.3).

    model : str, the model's name
    assignment : (n,) int32, for each data feature the index of its model feature, or BIN (-1)
    sign : (n,) int8, direction of each data feature relative to its model feature: +1, -1, 0 unknown
    pose : camera_T_model
    matched : int, number of assigned data features (taken from the assignment when not given)
    residual_rms : float, metres, distance of matched data end points from their model features
    covariance : (6, 6) float64 or None, of (x, y, z, rx, ry, rz), metres and radians, camera frame
    symmetric_poses : other poses that explain the data equally well (symmetry or ambiguity)
    proven : True when an exhaustive search has shown that no pose explains more data features within the tolerances
    rejected_reason : None when accepted, otherwise why not
    free_shift : (3,) float64 or None, camera frame, unit direction along which the data leaves the pose free to move:
        all paired features are parallel to it
    """

    model: str
    assignment: np.ndarray
    sign: np.ndarray
    pose: Pose
    matched: int = -1
    residual_rms: float = float('nan')
    covariance: np.ndarray | None = None
    symmetric_poses: tuple[Pose, ...] = field(default=())
    proven: bool = False
    rejected_reason: str | None = None
    free_shift: np.ndarray | None = None

    def __post_init__(self) -> None:
        assignment = np.array(self.assignment, dtype=np.int32)
        sign = np.array(self.sign, dtype=np.int8)
        if assignment.ndim != 1:
            raise ValueError(f'assignment: expected shape (n,), got {assignment.shape}')
        if sign.shape != assignment.shape:
            raise ValueError(f'sign: expected shape {assignment.shape} as assignment has, got {sign.shape}')
        if (assignment < BIN).any():
            raise ValueError(f'assignment: {assignment.min()} is neither a model feature nor the bin (-1)')
        if (np.abs(sign) > 1).any():
            raise ValueError('sign: expected +1, -1 or 0')
        object.__setattr__(self, 'assignment', assignment)
        object.__setattr__(self, 'sign', sign)
        count = int((assignment != BIN).sum())
        if self.matched < 0:
            object.__setattr__(self, 'matched', count)
        elif self.matched != count:
            raise ValueError(f'matched: {self.matched} given, but the assignment pairs {count} features')
        if self.covariance is not None:
            object.__setattr__(self, 'covariance', as_finite('covariance', self.covariance, (6, 6)))
        if self.free_shift is not None:
            object.__setattr__(self, 'free_shift', as_finite('free_shift', self.free_shift, (3,)))
        object.__setattr__(self, 'symmetric_poses', tuple(self.symmetric_poses))
        object.__setattr__(self, 'residual_rms', float(self.residual_rms))

    @property
    def accepted(self) -> bool:
        return self.rejected_reason is None

    @property
    def data_indices(self) -> np.ndarray:
        """(matched,) int64: which data features are paired."""
        return np.flatnonzero(self.assignment != BIN)

    def __repr__(self) -> str:
        state = 'accepted' if self.accepted else f'rejected: {self.rejected_reason}'
        return (
            f'Interpretation({self.model!r}, matched={self.matched}/{len(self.assignment)}, '
            f'residual_rms={self.residual_rms:.3g} m, {self.pose!r}, {state})'
        )
