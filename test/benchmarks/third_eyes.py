"""Pairs of cameras with a third one: the sets of OpenVGR, three eyes each, of which a pair is two."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from true_pairs import FAMILIES, TruePair

from msgs_py import CameraRig, PinholeCamera, Pose
from stereo_recovery import recover

WITH_THREE = ('openvgr',)


class Named(Protocol):
    """Whatever says which pair it is."""

    @property
    def name(self) -> str: ...

    @property
    def family(self) -> str: ...


def third_eye(data: Path, pair: Named) -> tuple[np.ndarray, PinholeCamera, Pose]:
    """The picture (h, w) uint8 of the eye that a pair does not contain, its camera, and left_T_camera."""
    folder = data / FAMILIES[pair.family].folder
    scene = pair.name.rpartition('_')[0]
    given = json.loads((folder / f'{pair.name}.json').read_text())
    number = ({0, 1, 2} - set(given['eyes'])).pop()
    eye = json.loads((folder / f'{scene}_eyes.json').read_text())['eyes'][number]
    image = cv2.imread(str(folder / f'{scene}_eye{number}.png'), cv2.IMREAD_GRAYSCALE)
    matrix = np.array(eye['K'])
    camera = PinholeCamera(image.shape[1], image.shape[0], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    if matrix[0, 1] != 0.0:
        # Our cameras have square axes.
        straight = camera.matrix @ np.linalg.inv(matrix)
        image = cv2.warpPerspective(image, straight, image.shape[::-1], flags=cv2.INTER_CUBIC)
    left_T_first = _pose(given['left_from_eye0'])
    return np.asarray(image), camera, left_T_first.compose(_pose(eye).inverse())


def _pose(given: dict[str, Any]) -> Pose:
    """R and t of a file, with as many digits as a rotation must have."""
    u, _, v = np.linalg.svd(np.array(given['R'], float))
    return Pose(u @ v, np.array(given['t'], float))


def with_third_eye(data: Path) -> Callable[[TruePair], Any]:
    """What recovers a pair from three pictures, left optical frame."""

    def recovered(pair: TruePair) -> Any:
        image, camera, pose = third_eye(data, pair)
        two = CameraRig.from_stereo(pair.rig)
        rig = CameraRig([*two.cameras, camera], [*two.poses, pose])
        return recover([pair.left, pair.right, image], rig)

    return recovered
