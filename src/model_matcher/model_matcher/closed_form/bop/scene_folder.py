"""Folders of the BOP benchmark: images, cameras and true poses of a scene, and models with what is known of them.

Lengths in these files are millimetres; here they are metres, but for those of :class:`ModelInfo`.

References
----------
docs/bop_datasets_format.md of thodan/bop_toolkit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from csg_renderer.features.library import MODEL_SUFFIXES
from csg_renderer.mesh.units import METRES
from msgs_py import CameraRig, PinholeCamera, Pose
from msgs_py.files import check_image, read_json
from msgs_py.numeric.typed import ByteArray, FloatArray

MM = METRES['mm']
# The sensors whose images are grey, in the order in which a scene's folders are looked for.
IMAGE_FOLDERS = ('rgb', 'gray')
IMAGE_SUFFIXES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff')
# The structured-light sensor of the challenge's bin stands where its world does; it is no camera to recover from.
NO_CAMERAS = ('photoneo',)


@dataclass(frozen=True, eq=False)
class TruePose:
    """One annotated object in one image.

    Attributes
    ----------
    object_id : int
    pose : Pose
        camera_T_model, metres.
    """

    object_id: int
    pose: Pose


@dataclass(frozen=True, eq=False)
class SceneImage:
    """One image of one camera.

    Attributes
    ----------
    path : Path
    matrix : (3, 3) float64
        K, pixels; whole coordinates are the middles of pixels.
    camera_T_world : Pose, optional
        Where the file says it, metres.
    """

    path: Path
    matrix: FloatArray
    camera_T_world: Pose | None

    def read(self) -> ByteArray:
        """Grey levels, (h, w) uint8. Raises OSError."""
        image = cv2.imread(str(check_image(self.path)), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise OSError(f'{self.path}: not a readable image')
        return np.asarray(image, np.uint8)


@dataclass(frozen=True, eq=False)
class BopScene:
    """A scene.

    Attributes
    ----------
    folder : Path
    images : dict of str to dict of int to SceneImage
        By the camera's name ('' where there is one camera, which may have moved) and the image's number.
    truth : dict of str to dict of int to list of TruePose
        The same, where the folder has it.
    """

    folder: Path
    images: dict[str, dict[int, SceneImage]]
    truth: dict[str, dict[int, list[TruePose]]]

    @property
    def number(self) -> int:
        """The scene's number, of the folder's name. Raises ValueError."""
        try:
            return int(self.folder.name)
        except ValueError:
            raise ValueError(f'{self.folder}: expected a folder named by the number of its scene, as 000001') from None

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(self.images)


@dataclass(frozen=True)
class ModelInfo:
    """What models_info.json says of a model, in its own unit, millimetres.

    Attributes
    ----------
    diameter : float
        Largest distance of two vertices.
    discrete : tuple of Pose
        model_T_model that lay it on itself, without the identity.
    continuous : tuple of (axis (3,), offset (3,))
        Axes about which every turn does.
    """

    diameter: float
    discrete: tuple[Pose, ...] = ()
    continuous: tuple[tuple[FloatArray, FloatArray], ...] = field(default=())


def read_scene(folder: Path) -> BopScene:
    """Read the files of a scene's folder, but no image.

    Parameters
    ----------
    folder : Path
        With scene_camera.json and rgb/ or gray/, or, of several cameras, scene_camera_NAME.json and rgb_NAME/ or
        gray_NAME/ for each; scene_gt.json or scene_gt_NAME.json may be there.

    Raises
    ------
    OSError, ValueError
        Names the file, the image and the field that is missing or wrong.
    """
    if not folder.is_dir():
        raise ValueError(f'{folder}: no such folder, expected one of a scene')
    files = sorted(folder.glob('scene_camera*.json'))
    names = [file.stem.removeprefix('scene_camera').removeprefix('_') for file in files]
    images, truth = {}, {}
    for name, file in zip(names, files):
        if name in NO_CAMERAS:
            continue
        images[name] = _images(folder, name, file)
        annotated = folder / (f'scene_gt_{name}.json' if name else 'scene_gt.json')
        if annotated.exists():
            truth[name] = _truth(annotated)
    if not images:
        raise ValueError(f'{folder}: has no scene_camera.json, and no scene_camera_NAME.json of several cameras')
    return BopScene(folder, images, truth)


def read_models_info(path: Path) -> dict[int, ModelInfo]:
    """What models_info.json says, by the objects' numbers. Raises OSError or ValueError."""
    found = {}
    for key, record in _entries(path):
        try:
            found[key] = ModelInfo(
                float(record['diameter']),
                tuple(Pose.from_matrix(np.reshape(one, (4, 4))) for one in record.get('symmetries_discrete', ())),
                tuple(
                    (np.asarray(one['axis'], float).reshape(3), np.asarray(one['offset'], float).reshape(3))
                    for one in record.get('symmetries_continuous', ())
                ),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f'{path}: object {key}: {_reason(error)}') from None
    return found


def read_targets(path: Path) -> dict[int, dict[int, list[int]]]:
    """What a file of targets (test_targets_bop19.json, ...) asks for.

    Returns
    -------
    dict of int to dict of int to list of int
        By the scene's and the image's number: the objects; none where the task is to find whatever there is.

    Raises
    ------
    OSError, ValueError
        Names the file and the entry.
    """
    try:
        records = read_json(path)
    except ValueError as error:
        raise ValueError(f'{path}: not JSON: {error}') from None
    found: dict[int, dict[int, list[int]]] = {}
    for place, record in enumerate(records if isinstance(records, list) else [records]):
        try:
            objects = found.setdefault(int(record['scene_id']), {}).setdefault(int(record['im_id']), [])
            if 'obj_id' in record:
                objects.append(int(record['obj_id']))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f'{path}: entry {place}: {_reason(error)}') from None
    return found


def model_files(folder: Path) -> dict[int, Path]:
    """Model files of a folder by their objects' numbers: obj_000001.ply, or beside it .csg or .npz, which say more.

    Raises
    ------
    ValueError
        The folder holds no such file.
    """
    found: dict[int, Path] = {}
    for path in sorted(folder.glob('obj_*')) if folder.is_dir() else ():
        number = path.stem.removeprefix('obj_')
        if path.suffix.lower() in MODEL_SUFFIXES and number.isdigit():
            best = found.get(int(number))
            if best is None or _rank(path) < _rank(best):
                found[int(number)] = path
    if not found:
        raise ValueError(f'{folder}: holds no models, expected obj_000001.ply, obj_000002.ply, ...')
    return found


def rig_of(images: Mapping[str, SceneImage], sizes: Sequence[tuple[int, int]]) -> tuple[CameraRig, Pose]:
    """The cameras of images of one moment, and where the first stands.

    Parameters
    ----------
    images : mapping of str to SceneImage
        In the order of the cameras; names are for messages.
    sizes : sequence of (int, int)
        Width and height of each, pixels.

    Returns
    -------
    rig : CameraRig
    first_T_world : Pose
        Metres.

    Raises
    ------
    ValueError
        Fewer than two cameras, one whose place is not known, or two at one place.
    """
    cameras, poses = [], []
    for (name, image), size in zip(images.items(), sizes):
        k, place = image.matrix, image.camera_T_world
        if place is None:
            raise ValueError(
                f'{image.path}: {name or "the camera"} has no cam_R_w2c and cam_t_w2c; expected to know where it stands'
            )
        cameras.append(PinholeCamera(*size, k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
        poses.append(place)
    if len(cameras) < 2:
        raise ValueError(f'{len(cameras)} image: recovery needs two or more, of cameras with a distance between them')
    first = poses[0]
    relative = [Pose.identity(), *(first.compose(one.inverse()) for one in poses[1:])]
    return CameraRig(cameras, relative), first


def _images(folder: Path, name: str, file: Path) -> dict[int, SceneImage]:
    found = {}
    for number, record in _entries(file):
        try:
            matrix = np.asarray(record['cam_K'], float).reshape(3, 3)
            place = _pose(record, 'w2c') if 'cam_R_w2c' in record else None
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f'{file}: image {number}: {_reason(error)}') from None
        if matrix[0, 1] or matrix[1, 0] or not (np.isfinite(matrix).all() and matrix[0, 0] > 0.0 < matrix[1, 1]):
            raise ValueError(
                f'{file}: image {number}: cam_K: expected focal lengths > 0 and no skew, got {matrix.tolist()}'
            )
        found[number] = SceneImage(_image_path(folder, name, number), matrix, place)
    return found


def _image_path(folder: Path, name: str, number: int) -> Path:
    places = [folder / (f'{kind}_{name}' if name else kind) for kind in IMAGE_FOLDERS]
    for place in places:
        for suffix in IMAGE_SUFFIXES:
            path = place / f'{number:06d}{suffix}'
            if path.exists():
                return path
    raise ValueError(f'{places[0] / f"{number:06d}.png"}: no such image, nor in {places[1].name}/')


def _truth(file: Path) -> dict[int, list[TruePose]]:
    found = {}
    for number, records in _entries(file):
        try:
            found[number] = [TruePose(int(one['obj_id']), _pose(one, 'm2c')) for one in records]
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f'{file}: image {number}: {_reason(error)}') from None
    return found


def _pose(record: dict[str, Any], what: str) -> Pose:
    """The transform cam_R_..., cam_t_... of a record, metres; its rotation is rounded in the files."""
    rotation = np.asarray(record[f'cam_R_{what}'], float).reshape(3, 3)
    u, _, v = np.linalg.svd(rotation)
    if not np.allclose(u @ v, rotation, atol=1e-3) or np.linalg.det(u @ v) < 0.0:
        raise ValueError(f'cam_R_{what}: no rotation: {rotation.tolist()}')
    return Pose(u @ v, MM * np.asarray(record[f'cam_t_{what}'], float).reshape(3))


def _entries(path: Path) -> list[tuple[int, Any]]:
    """What a JSON file has under numbers. Raises OSError or ValueError."""
    try:
        return [(int(key), record) for key, record in read_json(path).items()]
    except (AttributeError, ValueError) as error:
        raise ValueError(f'{path}: expected a JSON object with numbers as keys: {error}') from None


def _reason(error: Exception) -> str:
    return f'no field {error}' if isinstance(error, KeyError) else str(error)


def _rank(path: Path) -> int:
    return MODEL_SUFFIXES.index(path.suffix.lower())
