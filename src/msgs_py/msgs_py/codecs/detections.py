"""What was found as vision_msgs/Detection3DArray, for those who have vision_msgs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import Vector3
from std_msgs.msg import Header

from ..numeric.typed import FloatArray
from ..pose import Pose
from .poses import pose_to_message, pose_with_covariance


@dataclass(frozen=True, eq=False)
class Detection:
    """One object that was found.

    Attributes
    ----------
    model : str
        What it is.
    instance : str
        Which one of them it is: the same from frame to frame.
    score : float
        0 to 1.
    pose : Pose
        header's frame_T_model.
    covariance : (6, 6) float64, optional
        As in :func:`.poses.pose_with_covariance`.
    low, high : (3,) float64
        Corners of the model's bounding box, model frame, metres.
    others : tuple of Pose
        Poses that it may have instead; which is likelier is not known.
    """

    model: str
    instance: str
    score: float
    pose: Pose
    covariance: FloatArray | None
    low: FloatArray
    high: FloatArray
    others: tuple[Pose, ...] = ()


def detection_messages() -> Any | None:
    """The module vision_msgs.msg, or None where it is not installed (it does not come with the wheels)."""
    try:
        return import_module('vision_msgs.msg')
    except ImportError:
        return None


def detections_to_message(detections: Iterable[Detection], header: Header, messages: Any) -> Any:
    """The vision_msgs/Detection3DArray of what was found.

    Parameters
    ----------
    detections : iterable of Detection
    header : std_msgs.msg.Header
        Of the array and of each detection.
    messages : module
        :func:`detection_messages`; version 4 of vision_msgs, that of ROS 2 Humble and later.

    Returns
    -------
    vision_msgs.msg.Detection3DArray
        One hypothesis for each pose that a detection may have; they share its score. A pose is that of the model's
        origin, the box has the axes of the model at the first.
    """
    return messages.Detection3DArray(
        header=header, detections=[_detection(one, header, messages) for one in detections]
    )


def _detection(one: Detection, header: Header, messages: Any) -> Any:
    """One detection; a scale is none of the pose, so it goes into the size of the box."""
    middle = Pose(one.pose.rotation, one.pose.apply(0.5 * (one.low + one.high)))
    size = one.pose.scale * (one.high - one.low)
    score = float(np.clip(one.score, 0.0, 1.0)) / (1 + len(one.others))
    covariances = one.covariance, *(None for _ in one.others)
    results = [
        messages.ObjectHypothesisWithPose(
            hypothesis=messages.ObjectHypothesis(class_id=one.model, score=score),
            pose=pose_with_covariance(pose, covariance),
        )
        for pose, covariance in zip((one.pose, *one.others), covariances)
    ]
    box = messages.BoundingBox3D(center=pose_to_message(middle), size=Vector3(x=size[0], y=size[1], z=size[2]))
    return messages.Detection3D(header=header, results=results, bbox=box, id=one.instance)
