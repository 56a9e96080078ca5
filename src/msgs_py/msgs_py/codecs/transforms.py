"""Poses as transforms, for those who have tf2."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from geometry_msgs.msg import TransformStamped
from std_msgs.msg import Header

from ..pose import Pose


def transform_message_type() -> type | None:
    """tf2_msgs/TFMessage, or None where tf2 is not installed (it does not come with the wheels)."""
    try:
        message_type: type = import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None
    return message_type


def poses_to_transforms(poses: Mapping[str, Pose], header: Header) -> list[TransformStamped]:
    """Poses as transforms from the header's frame.

    Parameters
    ----------
    poses : mapping of str to Pose
        Child frame, and header's frame_T_child; scales are left out.
    header : std_msgs.msg.Header

    Returns
    -------
    list of geometry_msgs.msg.TransformStamped
    """
    return [_transform(child, pose, header) for child, pose in poses.items()]


def _transform(child: str, pose: Pose, header: Header) -> TransformStamped:
    """One pose as a transform."""
    message = TransformStamped(header=header, child_frame_id=child)
    shift: Any = message.transform.translation
    turn: Any = message.transform.rotation
    shift.x, shift.y, shift.z = (float(v) for v in pose.translation)
    turn.x, turn.y, turn.z, turn.w = (float(v) for v in pose.quaternion)
    return message
