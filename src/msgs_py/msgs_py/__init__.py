"""The vocabulary of the object recognition graph: plain types, and (in ``codecs``) their ROS messages.

Importing this package imports no ROS. ``msgs_py.codecs`` imports message classes, ``msgs_py.runtime`` rclpy.
"""

from .camera import PinholeCamera, StereoRig
from .camera_rig import CameraRig
from .features import FeatureKind, FeatureSet
from .interpretation import BIN, Interpretation
from .lens import LensDistortion
from .pose import Pose, PoseError

__all__ = [
    'BIN',
    'CameraRig',
    'FeatureKind',
    'FeatureSet',
    'Interpretation',
    'LensDistortion',
    'PinholeCamera',
    'Pose',
    'PoseError',
    'StereoRig',
]
