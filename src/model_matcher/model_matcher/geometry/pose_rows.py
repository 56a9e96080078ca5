"""A pose as a row of twelve numbers, in which compiled loops take it, and back; steps between poses as six numbers."""

from __future__ import annotations

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray


def as_motion(pose: Pose) -> FloatArray:
    """A pose as a row of twelve: rotation row by row, translation in metres."""
    return np.concatenate((pose.rotation.ravel(), pose.translation))


def as_pose(motion: FloatArray) -> Pose:
    """The pose of a row of twelve."""
    return Pose(motion[:9].reshape(3, 3), motion[9:])


def step_between(pose: Pose, other: Pose) -> FloatArray:
    """How far another pose is from one, in the numbers of a covariance.

    Returns
    -------
    (6,) float64
        Shift of the origin, metres, and rotation vector, radians, both in the frame to which the poses lead.

    Examples
    --------
    >>> step_between(Pose.identity(), Pose.from_rotation_vector([0.0, 0.0, 0.25], [0.5, 0.0, 0.0])).tolist()
    [0.5, 0.0, 0.0, 0.0, 0.0, 0.25]
    """
    turn = Pose(other.rotation @ pose.rotation.T).rotation_vector
    return np.concatenate([other.translation - pose.translation, turn])
