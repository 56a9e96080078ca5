"""Any number of calibrated cameras that look at one scene at one moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .camera import ImageWindow, PinholeCamera, StereoRig, projection_of
from .numeric.typed import FloatArray
from .pose import Pose


@dataclass(frozen=True, eq=False)
class CameraRig:
    """Two or more pinhole cameras and where they stand.

    Parameters
    ----------
    cameras : sequence of PinholeCamera
        Their images are free of distortion.
    poses : sequence of Pose
        Of each, first_T_camera: a translation is where a camera stands in the first one's optical frame, metres, and
        the columns of a rotation are its axes there. The first one's is the identity.

    Raises
    ------
    ValueError
        For fewer than two cameras, a camera without pose, a first pose that is not the identity, poses with a scale and
        cameras at one place; the message names the camera.

    Examples
    --------
    A third camera above a pair of two:

    >>> pair = StereoRig.symmetric(PinholeCamera.centred(640, 480, 800.0), baseline=0.1)
    >>> above = Pose(translation=[0.0, -0.1, 0.0])
    >>> rig = CameraRig([pair.left, pair.right, pair.left], [*CameraRig.from_stereo(pair).poses, above])
    >>> [pixels.tolist() for pixels in rig.project([0.0, 0.0, 0.5])]
    [[319.5, 239.5], [159.5, 239.5], [319.5, 399.5]]
    """

    cameras: Sequence[PinholeCamera]
    poses: Sequence[Pose]

    def __post_init__(self) -> None:
        cameras, poses = tuple(self.cameras), tuple(self.poses)
        if len(cameras) < 2:
            raise ValueError(f'cameras: expected two or more, got {len(cameras)}')
        if len(poses) != len(cameras):
            raise ValueError(f'poses: expected one for each of {len(cameras)} cameras, got {len(poses)}')
        for k, (camera, pose) in enumerate(zip(cameras, poses)):
            if not isinstance(camera, PinholeCamera):
                raise ValueError(f'cameras: camera {k} is a {type(camera).__name__}, expected a PinholeCamera')
            if not isinstance(pose, Pose):
                raise ValueError(f'poses: camera {k} has no pose but a {type(pose).__name__}, expected a Pose')
            if pose.scale != 1.0:
                raise ValueError(f'poses: that of camera {k} has scale {pose.scale:g}, expected 1')
        if poses[0] != Pose.identity():
            raise ValueError(f'poses: that of camera 0 is {poses[0]!r}, expected the identity: all are in its frame')
        for k, pose in enumerate(poses):
            for other in range(k):
                if not np.linalg.norm(pose.translation - poses[other].translation) > 0.0:
                    raise ValueError(
                        f'poses: cameras {other} and {k} stand at one place, {pose.translation.tolist()}; '
                        'depth needs a distance between them'
                    )
        object.__setattr__(self, 'cameras', cameras)
        object.__setattr__(self, 'poses', poses)

    def __len__(self) -> int:
        return len(self.cameras)

    @classmethod
    def from_stereo(cls, rig: StereoRig) -> CameraRig:
        """The two cameras of a rectified pair, the left one first."""
        return cls((rig.left, rig.right), (Pose.identity(), Pose(translation=np.array([rig.baseline, 0.0, 0.0]))))

    @classmethod
    def from_camera_info(cls, infos: Sequence[Any], poses: Sequence[Pose] | None = None) -> CameraRig:
        """The rig that camera_info messages describe.

        Parameters
        ----------
        infos : sequence of sensor_msgs.msg.CameraInfo
            Or of any objects with width, height (pixels) and the 12 elements p of P.
        poses : sequence of Pose, optional
            first_T_camera, one for each; by default parallel cameras at (Tx, Ty, 0), as P has them: P[0,3] = -fx * Tx
            and P[1,3] = -fy * Ty, pixel-metres.

        Raises
        ------
        ValueError
            For a P that is unusable or says nothing of where its camera stands; the message names the camera.

        References
        ----------
        The comments in sensor_msgs/CameraInfo.msg.
        """
        projections = [projection_of(f'camera_{k}', info) for k, info in enumerate(infos)]
        cameras = [
            PinholeCamera(window.width, window.height, p[0, 0], p[1, 1], p[0, 2], p[1, 2])
            for window, p in zip((ImageWindow.of(f'camera_{k}', info) for k, info in enumerate(infos)), projections)
        ]
        if poses is None:
            poses = [_parallel_pose(k, p) for k, p in enumerate(projections)]
        return cls(cameras, poses)

    def project(self, points: ArrayLike) -> list[FloatArray]:
        """Pixels where each camera sees points.

        Parameters
        ----------
        points : (..., 3) array_like of float64
            Metres, the first camera's optical frame.

        Returns
        -------
        list of (..., 2) float64
            (u, v), pixels; NaN for points that do not lie before a camera.
        """
        p = np.asarray(points, dtype=np.float64)
        return [camera.project(pose.inverse().apply(p)) for camera, pose in zip(self.cameras, self.poses)]


def _parallel_pose(k: int, projection: FloatArray) -> Pose:
    """Where camera k stands by its P (3, 4), if all look the same way."""
    x, y = (-projection[axis, 3] / projection[axis, axis] for axis in (0, 1))
    if k == 0 and (x, y) != (0.0, 0.0):
        raise ValueError(
            f'camera_0 camera_info: P[0,3] and P[1,3] are {projection[0, 3]:g} and {projection[1, 3]:g}, expected 0: '
            f'the other cameras stand where they do from this one; P =\n{projection}'
        )
    if k > 0 and (x, y) == (0.0, 0.0):
        raise ValueError(
            f'camera_{k} camera_info: P[0,3] and P[1,3] are 0, so the camera has no pose; expected -fx * Tx and '
            f'-fy * Ty, or a calibration file with poses; P =\n{projection}'
        )
    return Pose(translation=np.array([x, y, 0.0]) + 0.0)
