"""Calibration files of any number of cameras.

Our own form, JSON or YAML, has a list ``cameras``, each with width, height, K (nine numbers) and, but for the first, R
and t, so that R p + t is a point p of the first camera's frame in its own, as OpenCV's stereoCalibrate gives them.
Kalibr's camchain (cam0, cam1, ...), OpenCV's YAML with P1, P2, P3, ..., and ROS camera_info in one document a camera
are read as well, and every file of a pair (:mod:`.calibration`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from msgs_py import CameraRig, PinholeCamera, Pose
from msgs_py.files import read_text
from msgs_py.numeric.typed import FloatArray

from .calibration import documents_of, is_opencv, load_cameras, nearest_rotation, opencv_cameras, ros_camera


def load_camera_rig(path: str | Path, size: tuple[int, int]) -> CameraRig:
    """The cameras of a calibration file and where they stand.

    Parameters
    ----------
    path : str or Path
        The file, in one of the forms above.
    size : (width, height)
        Pixels. Of the images, for files that do not say.

    Returns
    -------
    CameraRig
        Its unit of length is that of the file.

    Raises
    ------
    ValueError
        When something is missing or not readable; the message names the file, the camera and what it lacks.
    OSError
        When there is no such file.

    Examples
    --------
    >>> import tempfile
    >>> k = [100, 0, 32, 0, 100, 24, 0, 0, 1]
    >>> above = {'K': k, 'R': [1, 0, 0, 0, 1, 0, 0, 0, 1], 't': [0, 0.1, 0]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, 'rig.yaml')
    ...     _ = file.write_text(str({'cameras': [{'K': k}, above]}))
    ...     (load_camera_rig(file, (64, 48)).poses[1].translation + 0.0).tolist()
    [0.0, -0.1, 0.0]
    """
    path = Path(path)
    text = read_text(path, errors='replace')
    try:
        if is_opencv(text):
            return CameraRig.from_camera_info(opencv_cameras(path, text, size))
        documents = documents_of(path, text)
        first = documents[0]
        if isinstance(first.get('cameras'), list):
            return _own(first['cameras'], size)
        if 'cam0' in first:
            return _kalibr(first, size)
        if len(documents) > 2:
            return CameraRig.from_camera_info(
                [ros_camera(path, f'camera_{k}', document, size) for k, document in enumerate(documents)]
            )
        return CameraRig.from_camera_info(load_cameras(path, size))
    except ValueError as error:
        named = str(error).startswith(str(path))
        raise ValueError(str(error) if named else f'{path}: {error}') from None


def _own(entries: list[Any], size: tuple[int, int]) -> CameraRig:
    """The list of cameras of our own form."""
    cameras, poses = [], []
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise ValueError(f'camera {k}: expected width, height, K, R and t, got {entry!r}')
        matrix = _numbers(entry, 'K', k, (3, 3))
        if matrix[0, 1] != 0.0:
            raise ValueError(f'camera {k}: K has skew {matrix[0, 1]:g}, expected 0: turn the images to square axes')
        cameras.append(_camera(entry.get('width', size[0]), entry.get('height', size[1]), matrix, k))
        if k == 0 and 'R' not in entry and 't' not in entry:
            poses.append(Pose.identity())
            continue
        poses.append(_pose(_numbers(entry, 'R', k, (3, 3)), _numbers(entry, 't', k, (3,)), k))
    return CameraRig(cameras, poses)


def _kalibr(document: dict[str, Any], size: tuple[int, int]) -> CameraRig:
    """The chain of cameras that Kalibr writes: each with T_cn_cnm1, from the frame of the one before it."""
    cameras: list[PinholeCamera] = []
    poses: list[Pose] = []
    while f'cam{len(cameras)}' in document:
        k = len(cameras)
        entry = document[f'cam{k}']
        if not isinstance(entry, dict) or entry.get('camera_model', 'pinhole') != 'pinhole':
            raise ValueError(f'camera {k}: expected camera_model pinhole')
        fx, fy, cx, cy = _numbers(entry, 'intrinsics', k, (4,))
        width, height = entry.get('resolution', size)
        cameras.append(_camera(width, height, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), k))
        if k == 0:
            poses.append(Pose.identity())
            continue
        step = _numbers(entry, 'T_cn_cnm1', k, (4, 4))
        poses.append(poses[-1].compose(_pose(step[:3, :3], step[:3, 3], k)))
    return CameraRig(cameras, poses)


def _camera(width: Any, height: Any, matrix: FloatArray, k: int) -> PinholeCamera:
    """The camera of a calibration matrix; k is for messages."""
    try:
        return PinholeCamera(width, height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    except (TypeError, ValueError) as error:
        raise ValueError(f'camera {k}: {error}') from None


def _pose(rotation: FloatArray, translation: FloatArray, k: int) -> Pose:
    """first_T_camera (or that of the camera before) of camera_T_first; k is for messages."""
    try:
        nearest = nearest_rotation(rotation)
        return Pose(rotation if nearest is None else nearest, translation).inverse()
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f'camera {k}: {error}') from None


def _numbers(entry: dict[str, Any], name: str, k: int, shape: tuple[int, ...]) -> FloatArray:
    """An entry of camera k as an array of this shape."""
    if name not in entry:
        raise ValueError(f'camera {k}: {name} is missing')
    try:
        return np.asarray(entry[name], np.float64).reshape(shape)
    except (TypeError, ValueError):
        count = int(np.prod(shape))
        raise ValueError(f'camera {k}: {name} is {entry[name]!r}, expected {count} numbers') from None
