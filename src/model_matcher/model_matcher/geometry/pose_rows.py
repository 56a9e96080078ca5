"""A pose as a row of twelve numbers, in which compiled loops take it, and back."""

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
