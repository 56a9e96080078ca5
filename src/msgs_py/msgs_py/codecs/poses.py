"""Poses to and from geometry_msgs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped
from std_msgs.msg import Header

from ..numeric.typed import FloatArray
from ..pose import Pose
from .errors import CodecError


def pose_to_message(pose: Pose) -> PoseMessage:
    """The geometry_msgs/Pose of a pose; its quaternion has w >= 0. A scale has no place there and is left out."""
    message = PoseMessage()
    position, orientation = message.position, message.orientation
    position.x, position.y, position.z = (float(v) for v in pose.translation)
    orientation.x, orientation.y, orientation.z, orientation.w = (float(v) for v in pose.quaternion)
    return message


def pose_from_message(message: PoseMessage) -> Pose:
    """The pose of a geometry_msgs/Pose.

    Raises
    ------
    CodecError
        For a quaternion of norm zero and for numbers that are not finite.

    Examples
    --------
    >>> pose_from_message(pose_to_message(Pose.identity())) == Pose.identity()
    True
    """
    p, q = message.position, message.orientation
    try:
        return Pose.from_quaternion((q.x, q.y, q.z, q.w), (p.x, p.y, p.z))
    except ValueError as error:
        raise CodecError(f'pose.{error}') from None


def pose_to_stamped(pose: Pose, header: Header | None = None) -> PoseStamped:
    """The geometry_msgs/PoseStamped of a pose.

    Parameters
    ----------
    pose : Pose
    header : std_msgs.msg.Header, optional
        Stamp, and the frame that the pose leads to.
    """
    message = PoseStamped(pose=pose_to_message(pose))
    if header is not None:
        message.header = header
    return message


def pose_with_covariance(pose: Pose, covariance: FloatArray | None) -> PoseWithCovariance:
    """The geometry_msgs/PoseWithCovariance of a pose.

    Parameters
    ----------
    pose : Pose
    covariance : (6, 6) float64, optional
        Of (x, y, z, rx, ry, rz), metres and radians, in the frame that the pose leads to: the order and the fixed axes
        of the message. None, where it is not known, becomes zeros.
    """
    message = PoseWithCovariance(pose=pose_to_message(pose))
    if covariance is not None:
        message.covariance = np.asarray(covariance, np.float64).ravel()
    return message


def pose_with_covariance_stamped(
    pose: Pose, covariance: FloatArray | None, header: Header | None = None
) -> PoseWithCovarianceStamped:
    """The geometry_msgs/PoseWithCovarianceStamped of a pose.

    Parameters
    ----------
    pose, covariance
        As for :func:`pose_with_covariance`.
    header : std_msgs.msg.Header, optional
        Stamp, and the frame that the pose leads to.
    """
    message = PoseWithCovarianceStamped(pose=pose_with_covariance(pose, covariance))
    if header is not None:
        message.header = header
    return message


def poses_to_array(poses: Iterable[Pose], header: Header | None = None) -> PoseArray:
    """The geometry_msgs/PoseArray of several poses.

    Parameters
    ----------
    poses : iterable of Pose
    header : std_msgs.msg.Header, optional
        Stamp, and the frame that the poses lead to.
    """
    message = PoseArray(poses=[pose_to_message(pose) for pose in poses])
    if header is not None:
        message.header = header
    return message


def array_to_poses(message: PoseArray) -> list[Pose]:
    """The poses of a geometry_msgs/PoseArray; raises as :func:`pose_from_message`."""
    return [pose_from_message(pose) for pose in message.poses]
