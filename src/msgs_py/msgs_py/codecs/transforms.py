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
        return import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None


def poses_to_transforms(poses: Mapping[str, Pose], header: Header) -> list[TransformStamped]:
    """One transform a pose: from the header's frame to the child frame it is listed under. Scales are left out."""
    return [_transform(child, pose, header) for child, pose in poses.items()]


def _transform(child: str, pose: Pose, header: Header) -> TransformStamped:
    message = TransformStamped(header=header, child_frame_id=child)
    shift: Any = message.transform.translation
    turn: Any = message.transform.rotation
    shift.x, shift.y, shift.z = (float(v) for v in pose.translation)
    turn.x, turn.y, turn.z, turn.w = (float(v) for v in pose.quaternion)
    return message
