"""Requests of the bin-picking challenge: cameras with images and the numbers of objects in, poses in the world out.

The messages are those of ibpc_interfaces, which nobody has but who takes part: whatever has their fields is taken.

References
----------
ibpc_interfaces/srv/GetPoseEstimates.srv of opencv/bpc; its issue 64 (poses are in the frame of the world, which is that
of the structured-light sensor); its tester, which hands over cam_R_w2c and cam_t_w2c as a camera's pose, millimetres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage

from msgs_py import CameraRig, PinholeCamera, Pose
from msgs_py.codecs import gray_from_image, pose_from_message, pose_to_message
from msgs_py.numeric.typed import ByteArray

from ...model.index import ModelIndex
from .answer import estimates
from .scene_folder import MM

PACKAGE = 'ibpc_interfaces'


def challenge_messages() -> tuple[Any, Any] | None:
    """The modules msg and srv of ibpc_interfaces, None where it is not installed."""
    try:
        return import_module(f'{PACKAGE}.msg'), import_module(f'{PACKAGE}.srv')
    except ImportError:
        return None


def answer_request(request: Any, models: Mapping[int, ModelIndex], estimate_type: Any) -> list[Any]:
    """Answer a request of the challenge.

    Parameters
    ----------
    request : ibpc_interfaces.srv.GetPoseEstimates.Request
        ``object_ids``, and ``cameras`` with info (k), pose (camera_T_world, millimetres) and rgb of each; depth, the
        polarised images and the structured-light sensor are not looked at.
    models : mapping of int to ModelIndex
        By the objects' numbers.
    estimate_type : type
        ibpc_interfaces.msg.PoseEstimate.

    Returns
    -------
    list of estimate_type
        obj_id, score (evidence, nats) and pose (world_T_model, millimetres); the surest first.

    Raises
    ------
    ValueError
        Names the field that cannot be used.
    """
    images, rig, first_T_world = _cameras(request.cameras)
    world_T_first = first_T_world.inverse()
    return [
        estimate_type(
            obj_id=one.object_id, score=float(one.score), pose=_in_millimetres(world_T_first.compose(one.pose))
        )
        for one in estimates(models, request.object_ids, images, rig)
    ]


def _cameras(cameras: Sequence[Any]) -> tuple[list[ByteArray], CameraRig, Pose]:
    """Images, the rig and first_T_world."""
    images, pinholes, places = [], [], []
    for number, camera in enumerate(cameras):
        try:
            image = gray_from_image(camera.rgb)
            k = np.asarray(camera.info.k, float).reshape(3, 3)
            pinhole = PinholeCamera(image.shape[1], image.shape[0], k[0, 0], k[1, 1], k[0, 2], k[1, 2])
            place = pose_from_message(camera.pose)
        except ValueError as error:
            raise ValueError(f'cameras[{number}]: {error}') from None
        images.append(image)
        pinholes.append(pinhole)
        places.append(Pose(place.rotation, MM * place.translation))
    if len(images) < 2:
        raise ValueError(f'cameras: {len(images)}, expected two or more with a distance between them')
    first = places[0]
    poses = [Pose.identity(), *(first.compose(one.inverse()) for one in places[1:])]
    return images, CameraRig(pinholes, poses), first


def _in_millimetres(pose: Pose) -> PoseMessage:
    return pose_to_message(Pose(pose.rotation, pose.translation / MM))
