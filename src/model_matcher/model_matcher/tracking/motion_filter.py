"""Where a body is and how it moves, with their covariance: a Kalman filter on rigid motions.

Errors of the state are a shift of the body's middle, a turn about it, and the errors of its velocity and angular
velocity, all in the first camera's frame. Between frames the body keeps both velocities, but for accelerations that are
constant from frame to frame and normal (Bar-Shalom, Li & Kirubarajan 2001, section 6.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray

from .settings import UNSEEN_TURN


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
    shift, turn = seconds * state.twist[:3], seconds * state.twist[3:]
    pose = placed(cv2.Rodrigues(turn)[0] @ state.pose.rotation, state.place + shift, state.middle)
    ahead = np.eye(12)
    ahead[:6, 6:] = seconds * np.eye(6)
    each = np.array([acceleration] * 3 + [angular_acceleration] * 3) ** 2
    gain = np.concatenate([0.5 * seconds**2 * np.eye(6), seconds * np.eye(6)])
    covariance = ahead @ state.covariance @ ahead.T + gain @ (each[:, None] * gain.T)
    return BodyState(pose, state.middle, state.twist, covariance)


def carried(before: BodyState, pose: Pose, covariance: FloatArray, seconds: float, velocities: FloatArray) -> BodyState:
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
    velocities : (6, 6) float64
        Covariance that the velocities would have without.
    """
    turn = cv2.Rodrigues(pose.rotation @ before.pose.rotation.T)[0][:, 0]
    twist = np.concatenate([pose.apply(before.middle) - before.place, turn]) / seconds
    whole = np.zeros((12, 12))
    whole[:6, :6] = before.covariance[:6, :6] + covariance
    # A mean velocity between two frames, and one at the end of them: both have their share.
    whole[6:, 6:] = covariance / seconds**2 + velocities
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
    innovation, spread = _innovation(state, pose, covariance)
    gain = np.linalg.solve(spread, state.covariance[:6]).T
    step = gain @ innovation
    after = state.covariance - gain @ spread @ gain.T
    twist = state.twist + step[6:]
    variances, axes = np.linalg.eigh(covariance[3:, 3:])
    for axis in axes.T[variances > UNSEEN_TURN]:
        twist[3:] -= axis * (axis @ twist[3:])
    turned = cv2.Rodrigues(step[3:6])[0] @ state.pose.rotation
    there = placed(turned, state.place + step[:3], state.middle)
    return BodyState(there, state.middle, twist, 0.5 * (after + after.T))


def mahalanobis(state: BodyState, pose: Pose, covariance: FloatArray) -> float:
    """Squared distance of a measured pose from the predicted one, in units of what is expected: six, on average."""
    innovation, spread = _innovation(state, pose, covariance)
    return float(innovation @ np.linalg.solve(spread, innovation))


def occam(before: FloatArray, measured: FloatArray) -> float:
    """Nats that a pose costs which was fitted: how many it was chosen from (MacKay 2003, section 28.1).

    A pose has six unknowns, with which an outline lays some of its edges on whatever edges there are. The likelihood of
    the object being there is the mean over all poses that were possible beforehand, of which the best has a share.

    before, measured : (6, 6) float64, covariance predicted, and that of the measurement alone
    """
    ratio = np.linalg.slogdet(np.eye(6) + np.linalg.solve(measured, before))[1]
    return float(0.5 * ratio)


def _innovation(state: BodyState, pose: Pose, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shift and turn (6,) from the predicted pose to a measured one, and their covariance (6, 6)."""
    turn = cv2.Rodrigues(pose.rotation @ state.pose.rotation.T)[0][:, 0]
    innovation = np.concatenate([pose.apply(state.middle) - state.place, turn])
    return innovation, state.covariance[:6, :6] + covariance


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
