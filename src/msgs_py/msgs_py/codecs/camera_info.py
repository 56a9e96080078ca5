"""sensor_msgs/CameraInfo of a rectified pair, to and from a StereoRig."""

from __future__ import annotations

from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from ..camera import PinholeCamera, StereoRig
from ..lens import LensDistortion
from .errors import CodecError


def camera_infos_from_rig(
    rig: StereoRig,
    header: Header | None = None,
    lenses: tuple[LensDistortion | None, LensDistortion | None] = (None, None),
) -> tuple[CameraInfo, CameraInfo]:
    """The camera_info messages of a rig.

    Parameters
    ----------
    rig : StereoRig
    header : std_msgs.msg.Header, optional
        Stamp and frame of both.
    lenses : tuple of two LensDistortion or None
        Of the raw cameras, whose calibration matrices are those of the rig; by default their pictures are the rectified
        ones.

    Returns
    -------
    left, right : sensor_msgs.msg.CameraInfo
        P[0,3] is -fx * baseline on the right, as the comments in CameraInfo.msg say.
    """
    return (_info(rig.left, 0.0, header, lenses[0]), _info(rig.right, -rig.right.fx * rig.baseline, header, lenses[1]))


def rig_from_camera_infos(left: CameraInfo, right: CameraInfo) -> StereoRig:
    """The rig that two camera_info messages describe.

    Parameters
    ----------
    left, right : sensor_msgs.msg.CameraInfo
        P[0,3] of the right one is -fx * baseline, pixel-metres.

    Raises
    ------
    CodecError
        Names message and field.
    """
    try:
        return StereoRig.from_camera_info(left, right)
    except CodecError:
        raise
    except ValueError as error:
        text = str(error)
        raise CodecError(text if 'camera_info' in text else f'camera_info: {text}') from None


def _info(camera: PinholeCamera, offset: float, header: Header | None, lens: LensDistortion | None) -> CameraInfo:
    """One camera's message; offset is P[0,3], pixel-metres."""
    info = CameraInfo()
    if header is not None:
        info.header = header
    info.width, info.height = camera.width, camera.height
    info.distortion_model = 'plumb_bob' if lens is None else lens.model
    info.d = [0.0] * 5 if lens is None else list(lens.coefficients)
    info.k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [camera.fx, 0.0, camera.cx, offset, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info
