"""What a case says of its camera beyond noise and blur: parameters of renderer_node, by their names.

``full_well=9000``, ``distortion_model=plumb_bob``, ``distortion=-0.3,0.1,0,0,0``, ``aperture=0.01``: whatever makes a
picture that of a camera (csg_renderer's docs/camera.md).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from csg_renderer import Scene
from csg_renderer.params import RendererConfig
from csg_renderer.stereo_pictures import Wanted, rendered
from msgs_py import LensDistortion, PinholeCamera, StereoRig
from msgs_py.numeric.typed import AnyArray, FloatArray
from stereo_recovery.cameras.calibration import CameraFile
from stereo_recovery.cameras.rectification import Rectifier

from .case import Case

# Parameters that are said by options of their own, or are those of a node and of no camera.
NOT_OF_THE_CAMERA = frozenset(
    (
        *('scene', 'rate', 'width', 'height', 'focal', 'baseline', 'antialias', 'psf', 'noise', 'seed', 'turntable'),
        *('frame_id', 'scene_folders', 'time_limit', 'watch'),
    )
)


def camera_values(texts: Iterable[str]) -> dict[str, Any]:
    """Parameters of renderer_node.

    Parameters
    ----------
    texts : iterable of str
        Each NAME=VALUE; the numbers of a list with commas between them.

    Raises
    ------
    ValueError
        Begins with "camera", and names what is wrong.

    Examples
    --------
    >>> camera_values(['full_well=9000', 'distortion=-0.3,0.1,0,0,0'])
    {'full_well': 9000.0, 'distortion': (-0.3, 0.1, 0.0, 0.0, 0.0)}
    """
    specs = {spec.name: spec for spec in RendererConfig.parameters() if spec.name not in NOT_OF_THE_CAMERA}
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition('=')
        if name not in specs or not equals:
            raise ValueError(f'camera: {text!r}: expected NAME=VALUE with one of {", ".join(sorted(specs))}')
        spec = specs[name]
        try:
            if spec.kind is tuple:
                values[name] = spec.check([float(item) for item in value.split(',')])
            else:
                values[name] = spec.check(value if spec.kind is str else json.loads(value))
        except ValueError as error:
            raise ValueError(f'camera: {text!r}: {error}') from None
    return values


def camera_config(case: Case) -> RendererConfig:
    """All of what a case says of its camera, as renderer_node has it.

    Raises
    ------
    ValueError
        Begins with "camera", and names what is wrong.
    """
    own = {'antialias': case.antialias, 'psf': case.psf, 'noise': case.noise, 'seed': case.seed}
    values = camera_values(case.camera)
    try:
        return RendererConfig.from_parameters({**own, **values})
    except ValueError as error:
        raise ValueError(f'camera: {error}') from None


def camera_pictures(case: Case, scene: Scene, rig: StereoRig, number: int = 0) -> tuple[AnyArray, AnyArray]:
    """The pair as recovery takes it from files: rectified, if its lenses distort.

    Parameters
    ----------
    case : Case
    scene : Scene
    rig : StereoRig
    number : int
        Of the pair.

    Returns
    -------
    left, right : (h, w) uint8, or float64 of more than 8 bits
        Grey levels of 255.

    Raises
    ------
    ValueError
        Its encoding is one that only nodes take.
    """
    config = camera_config(case)
    if not config.encoding.startswith('mono'):
        raise ValueError(f'camera: encoding {config.encoding}: only nodes take it (--nodes); expected mono8 or mono16')
    lenses = config.lenses()
    seen = rendered(scene, rig, config, number, Wanted(lenses is None, lenses is not None, False, False))
    left, right = seen.rectified or seen.raw
    if lenses is not None:
        infos = [
            _raw_camera(camera, lens, offset)
            for camera, lens, offset in zip((rig.left, rig.right), lenses, (0.0, -rig.right.fx * rig.baseline))
        ]
        left, right = Rectifier(*infos).apply(left, right)
    if left.dtype == np.uint8:
        return left, right
    levels = 255.0 / config.sensor(0, 0).white
    return _levels(left, levels), _levels(right, levels)


def _levels(picture: AnyArray, factor: float) -> FloatArray:
    return np.asarray(picture * factor, dtype=np.float64)


def _raw_camera(camera: PinholeCamera, lens: LensDistortion, offset: float) -> CameraFile:
    """One raw camera with the fields of a camera_info; offset is P[0,3], pixel-metres."""
    projection = np.column_stack([camera.matrix, [offset, 0.0, 0.0]])
    return CameraFile(
        camera.width,
        camera.height,
        lens.model,
        list(lens.coefficients),
        camera.matrix.ravel().tolist(),
        np.eye(3).ravel().tolist(),
        projection.ravel().tolist(),
    )
