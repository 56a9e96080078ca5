"""A hypothesis about what the data shows: which model, which pairing, which pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ._checks import as_finite
from .numeric.typed import FloatArray, Int8Array, Int32Array, IntArray
from .pose import Pose

BIN = -1
"""The assignment of a data feature that belongs to no model feature (thesis 5.10)."""


@dataclass(frozen=True, eq=False)
class Interpretation:
    """One interpretation of a set of data features (thesis 5.3).

    Parameters
    ----------
    model : str
        The model's name.
    assignment : (n,) int32
        For each data feature the index of its model feature, or BIN (-1).
    sign : (n,) int8
        Direction of each data feature relative to its model feature: +1, -1, 0 unknown.
    pose : Pose
        camera_T_model.
    matched : int, optional
        Number of assigned data features; counted when it is not given.
    residual_rms : float
        Root mean square distance of matched data end points from their model features, metres.
    covariance : (6, 6) float64, optional
        Of (x, y, z, rx, ry, rz), metres and radians, camera frame.
    symmetric_poses : tuple of Pose
        Other poses that explain the data equally well (symmetry or ambiguity).
    proven : bool
        True when an exhaustive search has shown that no pose explains more data features within the tolerances.
    rejected_reason : str, optional
        None when accepted, otherwise why not.
    free_shift : (3,) float64, optional
        Unit direction, camera frame, along which the data leaves the pose free to move: all paired features are
        parallel to it.
    free_turn : (3,) float64, optional
        Unit direction, camera frame, of the axis about which the data leaves the pose free to turn: all paired features
        lie about one axis. The covariance then has the variance of a uniform angle, pi squared / 3, about it.
    note : str, optional
        What else is to be known of it, as a sentence.
    evidence : float
        Nats by which the data, and the images where they were looked at, speak for it more than chance would; not a
        number where it was not weighed.
    support : float
        Share of the visible outline that the images confirm, 0 to 1; not a number without images.
    chance : float
        Share of the searches for a model that is not there in which chance brings as much evidence, 0 to 1; not a
        number where the evidence was not weighed.
    ambiguous_poses : tuple of Pose
        Those of symmetric_poses at which the model does not look the same, as a box seen from behind may be the other
        way round: what was seen does not tell which of them it has.

    Raises
    ------
    ValueError
        Names the field.

    Examples
    --------
    >>> found = Interpretation('box', [2, BIN, 0], [1, 0, -1], Pose.identity())
    >>> found.matched, found.accepted, found.data_indices.tolist()
    (2, True, [0, 2])
    """

    model: str
    assignment: Int32Array
    sign: Int8Array
    pose: Pose
    matched: int = -1
    residual_rms: float = float('nan')
    covariance: FloatArray | None = None
    symmetric_poses: tuple[Pose, ...] = field(default=())
    proven: bool = False
    rejected_reason: str | None = None
    free_shift: FloatArray | None = None
    free_turn: FloatArray | None = None
    note: str | None = None
    evidence: float = float('nan')
    support: float = float('nan')
    chance: float = float('nan')
    ambiguous_poses: tuple[Pose, ...] = field(default=())

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
        for name in ('free_shift', 'free_turn'):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_finite(name, getattr(self, name), (3,)))
        for name in ('symmetric_poses', 'ambiguous_poses'):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, 'residual_rms', float(self.residual_rms))

    @property
    def accepted(self) -> bool:
        """Whether nothing speaks against it."""
        return self.rejected_reason is None

    @property
    def data_indices(self) -> IntArray:
        """Which data features are paired, (matched,) int64."""
        return np.flatnonzero(self.assignment != BIN)

    def __repr__(self) -> str:
        state = 'accepted' if self.accepted else f'rejected: {self.rejected_reason}'
        return (
            f'Interpretation({self.model!r}, matched={self.matched}/{len(self.assignment)}, '
            f'residual_rms={self.residual_rms:.3g} m, {self.pose!r}, {state})'
        )
