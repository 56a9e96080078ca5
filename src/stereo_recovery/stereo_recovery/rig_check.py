"""How far the right camera of a rig has turned since its calibration: recovered, turned back, recovered again."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from msgs_py import Pose, StereoRig
from msgs_py.numeric.typed import AnyArray, FloatArray

from .matching.rig_error import RigError
from .params import RecoveryParams
from .pipeline import recover


def check_rig(
    left: AnyArray, right: AnyArray, rig: StereoRig, params: RecoveryParams | None = None
) -> tuple[RigError | None, str]:
    """The residual rotation of the right camera of a rectified pair.

    What lies too far off is not matched, so that what is matched of a rig that has turned far tells too little of it.
    Therefore the right image is turned back by what was found, and looked at once more.

    Parameters
    ----------
    left, right : (h, w) or (h, w, 3) uint8, uint16 or float
        Images of a rectified pair, of the rig's size.
    rig : StereoRig
        As it was calibrated.
    params : RecoveryParams, optional

    Returns
    -------
    RigError or None
        None when nothing is matched.
    str
        Why, else empty.

    Raises
    ------
    TypeError, ValueError
        As :func:`.pipeline.recover`.
    """
    first = recover(left, right, rig, params)
    if first.rig_error is None or not first.rig_error.tells:
        return first.rig_error, first.reason
    turn = Pose.from_rotation_vector(first.rig_error.rotation).rotation
    again = recover(left, turned_back(right, rig, turn), rig, params).rig_error
    if again is None:
        return first.rig_error, ''
    rest = Pose.from_rotation_vector(again.rotation).rotation
    return replace(again, rotation=Pose(rest @ turn).rotation_vector), ''


def turned_back(image: AnyArray, rig: StereoRig, rotation: FloatArray) -> AnyArray:
    """The right image as the camera would have taken it where it was calibrated.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    rig : StereoRig
    rotation : (3, 3) float64
        calibrated_R_actual.
    """
    camera = rig.right
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    homography = matrix @ rotation @ np.linalg.inv(matrix)
    size = camera.width, camera.height
    kept = cv2.INTER_LANCZOS4  # as rectification does: linear interpolation would blur edges by where they are
    return np.asarray(cv2.warpPerspective(image, homography, size, flags=kept, borderMode=cv2.BORDER_REPLICATE))
