"""Plain types to and from ROS messages. Imports message classes, never rclpy.

Every decoder checks what it is given and raises :class:`CodecError`, naming the field and what was expected.
"""

from .camera_info import camera_infos_from_rig, rig_from_camera_infos
from .errors import CodecError
from .features import cloud_to_features, features_to_cloud
from .images import array_to_image, gray_from_image, image_to_array
from .markers import DEFAULT_COLOURS, features_to_markers
from .poses import array_to_poses, pose_from_message, pose_to_message, pose_to_stamped, poses_to_array
from .reports import interpretations_from_report, report_from_interpretations
from .transforms import poses_to_transforms, transform_message_type

__all__ = [
    'CodecError',
    'DEFAULT_COLOURS',
    'array_to_image',
    'array_to_poses',
    'camera_infos_from_rig',
    'cloud_to_features',
    'features_to_cloud',
    'features_to_markers',
    'gray_from_image',
    'image_to_array',
    'interpretations_from_report',
    'pose_from_message',
    'pose_to_message',
    'pose_to_stamped',
    'poses_to_array',
    'poses_to_transforms',
    'report_from_interpretations',
    'rig_from_camera_infos',
    'transform_message_type',
]
