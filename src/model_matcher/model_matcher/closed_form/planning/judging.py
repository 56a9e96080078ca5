"""Answers against the truth: which part each one is, and how far off; symmetric poses are equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py import Pose

from ...model.settings import SAME_POSE
from .part import PlannedPart


@dataclass(frozen=True)
class Off:
    """How far an answer is from a truth: metres at the part's middle, degrees."""

    position: float
    rotation: float

    def within(self, position: float, rotation: float) -> bool:
        """Whether both are no more than this."""
        return self.position <= position and self.rotation <= rotation


def off_by(part: PlannedPart, true: Pose, found: Pose) -> Off:
    """The error of a pose, from that of the equal true ones that is nearest in rotation."""
    alike = [true.compose(motion) for motion in part.motions]
    if part.axis is not None:
        alike = [_turned_to(part, one, found) for one in alike]
    middle = part.ball[0]
    nearest = min(alike, key=lambda one: one.error_to(found).rotation)
    shift = float(np.linalg.norm(nearest.apply(middle) - found.apply(middle)))
    return Off(shift, nearest.error_to(found).rotation_deg)


def judged(part: PlannedPart, true: Sequence[Pose], found: Sequence[Pose]) -> tuple[list[Off | None], int]:
    """The error of the best answer about each part in a picture, None where there is none; and how many are wrong.

    An answer is about a part when it moves the ends of it by less than poses that a search takes for one.
    """
    taken: list[Off | None] = [None] * len(true)
    wrong, radius = 0, part.ball[1]
    most = SAME_POSE * 2.0 * radius
    for pose in found:
        offs = [off_by(part, one, pose) for one in true]
        near = [k for k, off in enumerate(offs) if np.hypot(off.position, np.radians(off.rotation) * radius) < most]
        free = [k for k in near if taken[k] is None]
        if free:
            best = min(free, key=lambda k: offs[k].position)
            taken[best] = offs[best]
        else:
            wrong += 1
    return taken, wrong


def _turned_to(part: PlannedPart, true: Pose, found: Pose) -> Pose:
    """A true pose after the turn about the part's axis that brings it nearest to another."""
    assert part.axis is not None
    direction = part.axis.direction
    left = true.rotation.T @ found.rotation
    odd = np.array([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]])
    # The trace of R(angle)^T left is greatest where the rotation left over is least.
    angle = np.arctan2(direction @ odd, np.trace(left) - direction @ left @ direction)
    return true.compose(part.axis.turn(angle))
