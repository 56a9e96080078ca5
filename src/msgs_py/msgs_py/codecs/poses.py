"""Poses to and from geometry_msgs."""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseArray, PoseStamped
from std_msgs.msg import Header

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
