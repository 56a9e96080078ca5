"""Where a body is and how it moves, with their covariance: a Kalman filter on rigid motions.

Errors of the state are a shift of the body's middle, a turn about it, and the errors of its velocity and angular
velocity, all in the first camera's frame. Between frames the body keeps both velocities, but for accelerations that are
constant from frame to frame and normal (Bar-Shalom, Li & Kirubarajan 2001, section 6.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray

from ..geometry.least_squares import cholesky
from ..geometry.pose_rows import as_motion, as_pose
from ..geometry.rigid_motion import compose_small, transform
from ..image_pose.settings import UNSEEN_TURN


@dataclass(frozen=True, eq=False)
class BodyState:
    """Estimate of a moving body.

    Attributes
    ----------
    pose : Pose
        first_T_model.
    middle : (3,) float64
        Metres, model frame, about which it turns.
    twist : (6,) float64
        Velocity of the middle, metres a second, and angular velocity, radians a second; first camera's frame.
    covariance : (12, 12) float64
        Of middle, turn, velocity and angular velocity; metres, radians, seconds.
    """

    pose: Pose
    middle: FloatArray
    twist: FloatArray
    covariance: FloatArray

    @property
    def place(self) -> FloatArray:
        """Where the middle is, (3,) float64, metres, first camera's frame."""
        return np.asarray(self.pose.apply(self.middle), float)

    @property
    def pose_covariance(self) -> FloatArray:
        """Of the pose, (6, 6) float64: (x, y, z, rx, ry, rz) as ROS has them, metres and radians."""
        return about_origin(self.covariance[:6, :6], self.pose, self.middle)


def at_rest(pose: Pose, middle: FloatArray, covariance: FloatArray, speed: float, angular_speed: float) -> BodyState:
    """A body of which a pose is known, and of its velocities only their sigmas.

    Parameters
    ----------
    pose : Pose
    middle : (3,) float64
    covariance : (6, 6) float64
        Of middle and turn.
    speed, angular_speed : float
        Metres and radians a second.
    """
    whole = np.zeros((12, 12))
    whole[:6, :6] = covariance
    whole[6:, 6:] = np.diag([speed**2] * 3 + [angular_speed**2] * 3)
    return BodyState(pose, middle, np.zeros(6), whole)


def moved_camera(state: BodyState, new_T_old: Pose) -> BodyState:
    """The same body as the first camera sees it after a motion of its own."""
    turn = np.kron(np.eye(4), new_T_old.rotation)
    covariance = turn @ state.covariance @ turn.T
    return BodyState(new_T_old.compose(state.pose), state.middle, turn[:6, :6] @ state.twist, covariance)


def predicted(state: BodyState, seconds: float, acceleration: float, angular_acceleration: float) -> BodyState:
    """The body some time later.

    Parameters
    ----------
    state : BodyState
    seconds : float
    acceleration, angular_acceleration : float
        Sigmas, metres and radians a second squared.
    """
    motion, covariance = _predicted(
        as_motion(state.pose), state.middle, state.twist, state.covariance, seconds, acceleration, angular_acceleration
    )
    return BodyState(as_pose(motion), state.middle, state.twist, covariance)


@njit(nogil=True)
def _predicted(
    motion: FloatArray,
    middle: FloatArray,
    twist: FloatArray,
    covariance: FloatArray,
    seconds: float,
    acceleration: float,
    angular_acceleration: float,
) -> tuple[FloatArray, FloatArray]:
    """As :func:`predicted`: the pose (12,), changed in place, and the covariance (12, 12)."""
    move_middle(motion, middle, seconds * twist)
    out = covariance.copy()
    for i in range(6):
        for j in range(6):
            both = covariance[i, 6 + j] + covariance[6 + i, j]
            out[i, j] += seconds * (both + seconds * covariance[6 + i, 6 + j])
            out[i, 6 + j] += seconds * covariance[6 + i, 6 + j]
            out[6 + i, j] += seconds * covariance[6 + i, 6 + j]
    for i in range(6):
        variance = acceleration**2 if i < 3 else angular_acceleration**2
        out[i, i] += 0.25 * seconds**4 * variance
        out[i, 6 + i] += 0.5 * seconds**3 * variance
        out[6 + i, i] += 0.5 * seconds**3 * variance
        out[6 + i, 6 + i] += seconds**2 * variance
    return motion, out


@njit(nogil=True)
def move_middle(motion: FloatArray, middle: FloatArray, step: FloatArray) -> None:
    """Shift the middle of a body at a motion (12,) by step[:3], and turn it about there by step[3:]; in place."""
    centre, turn_first = np.empty(3), np.empty(6)
    centre[0], centre[1], centre[2] = transform(motion, middle[0], middle[1], middle[2])
    turn_first[:3], turn_first[3:] = step[3:], step[:3]
    compose_small(motion, centre, turn_first)


def carried(before: BodyState, pose: Pose, covariance: FloatArray, seconds: float, change: FloatArray) -> BodyState:
    """The body after a motion that was seen: its pose is as uncertain as before, and by what the motion is.

    Parameters
    ----------
    before : BodyState
        In the frame before.
    pose : Pose
        first_T_model after the motion.
    covariance : (6, 6) float64
        Of the motion, as shift of the middle and turn.
    seconds : float
    change : (6, 6) float64
        Covariance of what the velocities may have changed by between the frames.
    """
    turn = cv2.Rodrigues(pose.rotation @ before.pose.rotation.T)[0][:, 0]
    twist = np.concatenate([pose.apply(before.middle) - before.place, turn]) / seconds
    whole = np.zeros((12, 12))
    whole[:6, :6] = before.covariance[:6, :6] + covariance
    # What the motion is off, pose and velocity are off together. A mean velocity between two frames, and one at the end
    # of them, differ by half of a steady change.
    whole[:6, 6:] = whole[6:, :6] = covariance / seconds
    whole[6:, 6:] = covariance / seconds**2 + 0.25 * change
    return BodyState(pose, before.middle, twist, whole)


def corrected(state: BodyState, pose: Pose, covariance: FloatArray) -> BodyState:
    """The body after its pose was measured.

    A turn that the measurement leaves open stays where it was predicted, and the body is said not to turn that way: so
    that nothing begins to spin that nobody sees spin.

    Parameters
    ----------
    state : BodyState
        Predicted.
    pose : Pose
        first_T_model.
    covariance : (6, 6) float64
        Of middle and turn.
    """
    motion, twist, after = _corrected(
        as_motion(state.pose), state.middle, state.twist, state.covariance, as_motion(pose), covariance
    )
    return BodyState(as_pose(motion), state.middle, twist, after)


@njit(nogil=True)
def _corrected(
    motion: FloatArray,
    middle: FloatArray,
    twist: FloatArray,
    covariance: FloatArray,
    measured: FloatArray,
    measured_covariance: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As :func:`corrected`: pose (12,), changed in place, twist (6,) and covariance (12, 12)."""
    innovation, low = _innovation(motion, middle, measured, covariance, measured_covariance)
    # Columns of the root of what the measurement takes away.
    root, step = np.empty((12, 6)), np.zeros(12)
    _substitute(low, innovation)
    for i in range(12):
        for j in range(6):
            root[i, j] = covariance[i, j]
        _substitute(low, root[i])
        for j in range(6):
            step[i] += root[i, j] * innovation[j]
    after = covariance.copy()
    for i in range(12):
        for j in range(i + 1):
            for q in range(6):
                after[i, j] -= root[i, q] * root[j, q]
            after[j, i] = after[i, j]
    twist = twist + step[6:]
    variances, axes = np.linalg.eigh(np.ascontiguousarray(measured_covariance[3:, 3:]))
    for q in range(3):
        if variances[q] > UNSEEN_TURN:
            along = axes[0, q] * twist[3] + axes[1, q] * twist[4] + axes[2, q] * twist[5]
            for i in range(3):
                twist[3 + i] -= along * axes[i, q]
    move_middle(motion, middle, step[:6])
    return motion, twist, after


@njit(nogil=True)
def _substitute(low: FloatArray, x: FloatArray) -> None:
    """Solve L x = right (6,) in place."""
    for i in range(6):
        for k in range(i):
            x[i] -= low[i, k] * x[k]
        x[i] /= low[i, i]


def mahalanobis(state: BodyState, pose: Pose, covariance: FloatArray) -> float:
    """Squared distance of a measured pose from the predicted one, in units of what is expected: six, on average."""
    distance: float = _mahalanobis(as_motion(state.pose), state.middle, as_motion(pose), state.covariance, covariance)
    return distance


@njit(nogil=True)
def _mahalanobis(
    motion: FloatArray, middle: FloatArray, measured: FloatArray, covariance: FloatArray, own: FloatArray
) -> float:
    """As :func:`mahalanobis`."""
    innovation, low = _innovation(motion, middle, measured, covariance, own)
    _substitute(low, innovation)
    distance: float = (innovation**2).sum()
    return distance


@njit(nogil=True)
def occam(before: FloatArray, measured: FloatArray) -> float:
    """Nats that a pose costs which was fitted: how many it was chosen from (MacKay 2003, section 28.1).

    A pose has six unknowns, with which an outline lays some of its edges on whatever edges there are. The likelihood of
    the object being there is the mean over all poses that were possible beforehand, of which the best has a share.

    before, measured : (6, 6) float64, covariance predicted, and that of what the likelihood tells of the pose
    """
    nats = 0.0
    low = np.empty((6, 6))
    for covariance, sign in ((before + measured, 1.0), (measured, -1.0)):
        if not cholesky(covariance, 6, low):
            raise ValueError('measured: not positive definite')
        for i in range(6):
            nats += sign * math.log(low[i, i])
    return nats


@njit(nogil=True)
def _innovation(
    motion: FloatArray, middle: FloatArray, measured: FloatArray, covariance: FloatArray, own: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Shift and turn (6,) from a predicted motion (12,) to a measured one, and the root (6, 6) of their covariance."""
    out, low = np.empty(6), np.empty((6, 6))
    x, y, z = transform(motion, middle[0], middle[1], middle[2])
    u, v, w = transform(measured, middle[0], middle[1], middle[2])
    out[0], out[1], out[2] = u - x, v - y, w - z
    # Of the turn from one to the other, sine and cosine; it is small, or the outline would not have been found.
    cosine = -0.5
    for i in range(9):
        cosine += 0.5 * measured[i] * motion[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[3 + i] = 0.0
        for q in range(3):
            up, down = measured[3 * k + q] * motion[3 * j + q], measured[3 * j + q] * motion[3 * k + q]
            out[3 + i] += 0.5 * (up - down)
    sine = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    if sine > 0.0:
        out[3:] *= math.atan2(sine, cosine) / sine
    if not cholesky(covariance[:6, :6] + own, 6, low):
        raise ValueError('covariance: not positive definite')
    return out, low


def placed(rotation: FloatArray, place: FloatArray, middle: FloatArray) -> Pose:
    """The pose of this rotation (3, 3) that puts the middle (3,) at a place (3,)."""
    return Pose(rotation, place - rotation @ middle)


def about_middle(covariance: FloatArray, pose: Pose, middle: FloatArray) -> FloatArray:
    """Covariance (6, 6) of middle and turn, from that of a pose's translation and turn."""
    return _at(covariance, pose.rotate(middle))


def about_origin(covariance: FloatArray, pose: Pose, middle: FloatArray) -> FloatArray:
    """Covariance (6, 6) of a pose's translation and turn, from that of middle and turn."""
    return _at(covariance, -pose.rotate(middle))


def _at(covariance: FloatArray, arm: FloatArray) -> FloatArray:
    """Covariance of the shift of a point, and the turn, from that of another point, an arm (3,) away."""
    x, y, z = arm
    change = np.eye(6)
    change[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return np.asarray(change @ covariance @ change.T)
