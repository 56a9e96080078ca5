"""Plain types to and from ROS messages. Imports message classes, never rclpy.

Every decoder checks what it is given and raises :class:`CodecError`, naming the field and what was expected.
"""

from .camera_info import camera_infos_from_rig, rig_from_camera_infos
from .collision import (
    SceneObject,
    collision_messages,
    collision_object,
    objects_to_markers,
    removal,
    shapes_to_messages,
)
from .detections import Detection, detection_messages, detections_to_message
from .errors import CodecError
from .features import cloud_to_features, features_to_cloud
from .images import array_to_image, image_to_array
from .markers import DEFAULT_COLOURS, features_to_markers
from .pictures import gray_from_image, grey_picture, in_eight_bits
from .poses import (
    array_to_poses,
    pose_from_message,
    pose_to_message,
    pose_to_stamped,
    pose_with_covariance,
    pose_with_covariance_stamped,
    poses_to_array,
)
from .reports import interpretations_from_report, report_from_interpretations
from .transforms import poses_to_transforms, transform_message_type

__all__ = [
    'CodecError',
    'DEFAULT_COLOURS',
    'Detection',
    'SceneObject',
    'array_to_image',
    'array_to_poses',
    'camera_infos_from_rig',
    'cloud_to_features',
    'collision_messages',
    'collision_object',
    'detection_messages',
    'detections_to_message',
    'features_to_cloud',
    'features_to_markers',
    'gray_from_image',
    'grey_picture',
    'image_to_array',
    'in_eight_bits',
    'interpretations_from_report',
    'objects_to_markers',
    'pose_from_message',
    'pose_to_message',
    'pose_to_stamped',
    'pose_with_covariance',
    'pose_with_covariance_stamped',
    'poses_to_array',
    'poses_to_transforms',
    'removal',
    'report_from_interpretations',
    'rig_from_camera_infos',
    'shapes_to_messages',
    'transform_message_type',
]
