"""Calibration files of a stereo camera, in three forms.

OpenCV's YAML (K1, D1, R1, P1, K2, ...), ROS camera_info YAML, and the JSON of a pair of equal cameras (width, height,
K, baseline, of raw pictures distortion_model and D) that the renderer writes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from msgs_py import StereoRig
from msgs_py.files import read_text
from msgs_py.numeric.typed import FloatArray

from .settings import ROUNDED_ROTATION

# Names under which OpenCV programs write the same matrices; {} is 1 or 2.
OPENCV_NAMES = {
    'k': ('K{}', 'M{}', 'cameraMatrix{}', 'camera_matrix_{}'),
    'd': ('D{}', 'distCoeffs{}'),
    'r': ('R{}',),
    'p': ('P{}',),
}


@dataclass(frozen=True)
class CameraFile:
    """One camera, with the field names of sensor_msgs/CameraInfo.

    Attributes
    ----------
    width, height : int
        Pixels. Of the raw image.
    distortion_model : str
        One of :data:`~stereo_recovery.cameras.settings.DISTORTION_MODELS`.
    d : list of float
        Coefficients of the distortion.
    k : list of 9 float, pixels
        Calibration matrix of the raw camera, row by row.
    r : list of 9 float
        Rotation from the raw to the rectified camera frame, row by row.
    p : list of 12 float, pixels
        Projection matrix of the rectified camera, row by row.
    """

    width: int
    height: int
    distortion_model: str
    d: list[float] = field(default_factory=list)
    k: list[float] = field(default_factory=list)
    r: list[float] = field(default_factory=list)
    p: list[float] = field(default_factory=list)


def load_cameras(path: str | Path, size: tuple[int, int]) -> tuple[CameraFile, CameraFile]:
    """Left and right camera of a calibration file.

    A ROS camera_info file describes one camera; give the left one, and the right one is looked for beside it ('left' in
    the name becomes 'right'), or give one file with both (two documents, or the keys left and right).

    Parameters
    ----------
    path : str or Path
        The file.
    size : (width, height)
        Pixels. Of the images, for files that do not say.

    Returns
    -------
    left, right : CameraFile

    Raises
    ------
    ValueError
        When something is missing or not readable; the message names the file and what it lacks.
    OSError
        When there is no such file.
    """
    path = Path(path)
    text = read_text(path, errors='replace')
    if is_opencv(text):
        left, right = opencv_cameras(path, text, size)[:2]
        return left, right
    documents = documents_of(path, text)
    if len(documents) == 1 and {'K', 'baseline'} <= set(documents[0]):
        return _ideal(path, documents[0], size)
    if len(documents) == 1 and {'left', 'right'} <= set(documents[0]):
        documents = [documents[0]['left'], documents[0]['right']]
    if len(documents) == 1:
        if not {'projection_matrix', 'camera_matrix', 'image_width'} & set(documents[0]):
            raise ValueError(
                f'{path}: no calibration of a pair: no projection_matrix; expected OpenCV YAML with P1 and P2, '
                'ROS camera_info YAML, or JSON with K and baseline'
            )
        other = path.with_name(path.name.replace('left', 'right'))
        if other == path or not other.exists():
            raise ValueError(
                f'{path}: describes one camera; expected both (two YAML documents, or keys left and '
                f'right), or a file named ...left... with ...right... beside it'
            )
        documents += documents_of(other, read_text(other, errors='replace'))
    return ros_camera(path, 'left', documents[0], size), ros_camera(path, 'right', documents[1], size)


def load_rig(path: str | Path, size: tuple[int, int]) -> StereoRig:
    """The rectified pair of a calibration file.

    Parameters
    ----------
    path : str or Path
        As for :func:`load_cameras`.
    size : (width, height)
        Pixels. Of the images, for files that do not say.

    Returns
    -------
    StereoRig
        Its unit of length is that of the file's projection matrices.

    Raises
    ------
    ValueError, OSError
        As :func:`load_cameras`, and for cameras that are no rectified pair.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, 'camera.json')
    ...     _ = file.write_text('{"K": [[100, 0, 32], [0, 100, 24], [0, 0, 1]], "baseline": 0.1}')
    ...     load_rig(file, (64, 48)).baseline
    0.1
    """
    cameras = load_cameras(path, size)
    try:
        return StereoRig.from_camera_info(*cameras)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def nearest_rotation(matrix: FloatArray) -> FloatArray | None:
    """The rotation (3, 3) that a file has written with few digits; None for a matrix that is none.

    Examples
    --------
    >>> nearest_rotation(np.diag([1.0, 1.0, 0.999])).round(12).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    >>> nearest_rotation(np.zeros((3, 3))) is None, nearest_rotation(np.diag([1.0, 1.0, -1.0])) is None
    (True, True)
    """
    u, stretch, v = np.linalg.svd(matrix)
    rotation = np.asarray(u @ v)
    return rotation if np.abs(stretch - 1.0).max() < ROUNDED_ROTATION and np.linalg.det(rotation) > 0.0 else None


def is_opencv(text: str) -> bool:
    """Whether a file's text is OpenCV's YAML."""
    return text.lstrip().startswith('%YAML:') or '!!opencv-matrix' in text


def opencv_cameras(path: Path, text: str, size: tuple[int, int]) -> list[CameraFile]:
    """The cameras of OpenCV's YAML, at least two: K1, P1, K2, P2, ...

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    text : str
    size : (width, height)
        Pixels. Of the images.

    Raises
    ------
    ValueError
        When it is not readable, or a projection matrix is missing; the message names the file.
    """
    matrices = _opencv_matrices(path, text)
    cameras = []
    for number, found in enumerate(matrices, 1):
        if 'p' not in found:
            raise ValueError(f'{path}: no matrix P{number}; expected the projection matrices of stereoRectify')
        p = np.zeros((3, 4))
        if len(found['p']) == p.size:
            p[:] = np.reshape(found['p'], p.shape)
        found.setdefault('k', p[:, :3].ravel().tolist())
        found.setdefault('r', np.eye(3).ravel().tolist())
        cameras.append(
            CameraFile(size[0], size[1], 'plumb_bob', found.get('d', []), found['k'], found['r'], found['p'])
        )
    return cameras


class _OpencvYaml(yaml.SafeLoader):  # type: ignore[misc]
    """What PyYAML makes of OpenCV's files; OpenCV's own reader writes beyond its memory where they are damaged."""


_OpencvYaml.add_multi_constructor(
    'tag:yaml.org,2002:opencv-', lambda loader, _, node: loader.construct_mapping(node, deep=True)
)


def _opencv_matrices(path: Path, text: str) -> list[dict[str, list[float]]]:
    """What the file has for each camera, by the field names of CameraFile; a third and further ones if it has P."""
    text = text.lstrip()
    if text.startswith('%YAML:'):  # no directive of YAML
        text = text.partition('\n')[2]
    try:
        document = next(iter(yaml.load_all(text, _OpencvYaml)), None)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(f'{path}: not readable as OpenCV YAML: {error}') from None
    nodes = document if isinstance(document, dict) else {}
    cameras: list[dict[str, list[float]]] = []
    while True:
        number = len(cameras) + 1
        matrices: dict[str, list[float]] = {}
        for name, spellings in OPENCV_NAMES.items():
            keys = (spelling.format(number) for spelling in spellings)
            key = next((key for key in keys if isinstance(nodes.get(key), dict)), None)
            if key is not None:
                matrices[name] = _numbers_of(path, key, nodes[key])
        if number > 2 and 'p' not in matrices:
            break
        cameras.append(matrices)
    return cameras


def _numbers_of(path: Path, name: str, matrix: dict[str, Any]) -> list[float]:
    """The numbers of a matrix of OpenCV's."""
    data = matrix.get('data')
    try:
        numbers = [float(x) for x in data] if isinstance(data, list) else []
        size = int(matrix['rows']) * int(matrix['cols'])
    except (KeyError, TypeError, ValueError, OverflowError):
        numbers, size = [], 1
    if len(numbers) != size:
        raise ValueError(f'{path}: not readable as OpenCV YAML: {name}: expected rows x cols numbers in data')
    return numbers


def documents_of(path: Path, text: str) -> list[dict[str, Any]]:
    """The YAML documents in a file's text, at least one, each a mapping.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    text : str

    Raises
    ------
    ValueError
        When there is none.
    """
    try:
        documents = [d for d in yaml.safe_load_all(text) if d is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(f'{path}: not YAML: {error}') from None
    if not documents or not all(isinstance(d, dict) for d in documents):
        raise ValueError(f'{path}: expected a calibration, OpenCV YAML or ROS camera_info YAML')
    return documents


def _ideal(path: Path, document: dict[str, Any], size: tuple[int, int]) -> tuple[CameraFile, CameraFile]:
    """Two cameras with the same K, the right one at +baseline (metres) along x."""
    try:
        k = np.asarray(document['K'], dtype=float).reshape(3, 3)
        baseline = float(document['baseline'])
        distortion = [float(number) for number in document.get('D', [])]
    except (TypeError, ValueError):
        raise ValueError(
            f'{path}: expected K, nine numbers, baseline, a number of metres, and D, if any, a list of numbers'
        ) from None
    flat = k.ravel().tolist()
    projections = [np.column_stack([k, [shift, 0.0, 0.0]]).ravel().tolist() for shift in (0.0, -k[0, 0] * baseline)]
    left, right = (
        CameraFile(
            int(document.get('width', size[0])),
            int(document.get('height', size[1])),
            str(document.get('distortion_model', 'plumb_bob')),
            distortion,
            k=flat,
            r=np.eye(3).ravel().tolist(),
            p=projection,
        )
        for projection in projections
    )
    return left, right


def ros_camera(path: Path, side: str, document: Any, size: tuple[int, int]) -> CameraFile:
    """The camera of one camera_info document.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    side : str
        What the camera is called in messages: left, right, camera_2.
    document : dict
        With the names that camera_calibration_parsers writes.
    size : (width, height)
        Pixels. Of the images, for documents that do not say.

    Raises
    ------
    ValueError
        When something is missing or no numbers; the message names file and camera.
    """

    def numbers(name: str, default: list[float] | None = None) -> list[float]:
        """The numbers of an entry, which may be a list or have them as its data."""
        entry = document.get(name) if isinstance(document, dict) else None
        if entry is None and default is not None:
            return default
        values = entry.get('data') if isinstance(entry, dict) else entry
        try:
            if values is None:
                raise ValueError
            return [float(x) for x in values]
        except (TypeError, ValueError):
            raise ValueError(f'{path}: {side} camera: {name} is missing or holds no numbers') from None

    projection = numbers('projection_matrix')
    return CameraFile(
        int(document.get('image_width', size[0])),
        int(document.get('image_height', size[1])),
        str(document.get('distortion_model', 'plumb_bob')),
        numbers('distortion_coefficients', []),
        numbers('camera_matrix'),
        numbers('rectification_matrix', np.eye(3).ravel().tolist()),
        projection,
    )
