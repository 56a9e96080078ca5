"""Recovers 3D edges, curves and axes with stated uncertainty from a stereo pair."""

from .camera_measurement import CameraMeasurement, measure_camera
from .matching.rig_error import RigError
from .params import RecoveryParams
from .pipeline import Recovery, recover
from .rig_check import check_rig

__all__ = ['CameraMeasurement', 'Recovery', 'RecoveryParams', 'RigError', 'check_rig', 'measure_camera', 'recover']
