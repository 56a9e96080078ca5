"""The scene of a closed-form case as a file of its own: the case's model at the case's pose, among clutter.

A case that changes neither pose, light nor surroundings uses the user's file. Any other gets a folder with a new scene
file and copies of what it includes, so that the folder alone is enough to run the case again, on another machine too.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from csg_renderer import Scene, load_scene, model_features
from csg_renderer.language import find_scene, read_scene
from msgs_py import FeatureSet, PinholeCamera, Pose, StereoRig

from .case import Case
from .placement import case_lights, case_pose, case_rig, load_case_scene, model_centre, stands_as_drawn
from .settings import CLUTTER_DEPTH, CLUTTER_SIZE

SCENE_FILE = 'scene.csg'


class PreparedCase(NamedTuple):
    """A case ready to be rendered.

    Attributes
    ----------
    path
        Its scene file.
    rig
        Its cameras.
    scene
        What the file says.
    name
        Of the first object, whose model features (model frame, metres) are ``model`` and whose left_T_model is
        ``true_pose``.
    """

    path: Path
    rig: StereoRig
    scene: Scene
    name: str
    model: FeatureSet
    true_pose: Pose


def prepare(case: Case, folder: Path) -> PreparedCase:
    """Read a case's scene, or write one of its own; find the object's features and its pose.

    Parameters
    ----------
    case : Case
        What to test.
    folder : Path
        Where a scene file is written when the user's own does not do.

    Returns
    -------
    PreparedCase

    Raises
    ------
    ValueError, OSError
        For a scene that cannot be used.
    """
    rig = case_rig(case)
    path = case_scene(case, rig, folder)
    scene = load_scene(path)
    first = scene.placements[0]
    true_pose = scene.camera_T_scene.compose(first.pose)
    return PreparedCase(path, rig, scene, first.name, model_features(first.model), true_pose)


def check_scene(case: Case, changed: bool = False) -> None:
    """Raise what would make a case unusable: OSError for no such scene, ValueError (a SceneError) for a bad one.

    changed : the object will be drawn at other poses
    """
    scene = load_case_scene(case)
    if changed or _changes(case, scene):
        _drawn_by_name(case, scene)


def _changes(case: Case, scene: Scene) -> bool:
    """Whether the case differs from what its file draws."""
    named = scene.placements[0].name in scene.definitions
    lit = tuple(scene.lights) == case_lights(scene, case_pose(case, scene))
    return bool(case.clutter) or not stands_as_drawn(case, scene) or (named and not lit)


def _drawn_by_name(case: Case, scene: Scene) -> str:
    name = scene.placements[0].name
    if name not in scene.definitions:
        raise ValueError(f'{case.scene}: what it draws first has no name; write "name = ...;" and "DRAW name ...;"')
    return name


def case_scene(case: Case, rig: StereoRig, folder: Path) -> Path:
    """The scene file of a case; written into ``folder`` when the user's own does not do.

    rig : the case's, written to the file. Raises ValueError when the drawn object has no name to draw it by again.
    """
    path = find_scene(case.scene)
    scene = load_case_scene(case)
    if not _changes(case, scene):
        return path
    pose = case_pose(case, scene)
    name = _drawn_by_name(case, scene)
    included = copy_scene(path, folder)
    target = folder / SCENE_FILE
    target.write_text(_text(case, scene, name, pose, rig, included), encoding='utf-8')
    return target


def copy_scene(path: Path, folder: Path) -> str:
    """Copy a scene and its includes into folder, as they lie to each other; the name of the scene's copy there."""
    found = scene_files(path)
    for name, file in found.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, folder / name)
    return next(iter(found))


def scene_files(path: Path) -> dict[str, Path]:
    """A scene's file and those it includes, by where they lie below the folder that holds all; the scene's is first.

    The scene is called original_..., so that another may be written beside it.
    """
    files = dict.fromkeys([path.resolve(), *(Path(file).resolve() for file in read_scene(str(path)).files)])
    root = Path(os.path.commonpath([file.parent for file in files]))
    names = {str(file.relative_to(root)): file for file in list(files)[1:]}
    main = path.resolve().relative_to(root)
    return {str(main.with_name(f'original_{main.name}')): path.resolve(), **names}


def _text(case: Case, scene: Scene, name: str, pose: Pose, rig: StereoRig, included: str) -> str:
    camera = rig.left
    lines = [
        f'// Closed-form case: {name} of {included}, pose and surroundings set by the harness. Metres, camera frame.',
        f'INCLUDE "{included}";',
        'UNITS M;',
        f'CAMERA SIZE ({camera.width}, {camera.height}) FOCAL ({_numbers([camera.fx, camera.fy])}) '
        f'CENTRE ({_numbers([camera.cx, camera.cy])});',
        f'STEREO ({_numbers([rig.baseline])});',
        f'AMBIENT ({_numbers(scene.ambient_light)});',
        f'BACKGROUND ({_numbers(scene.background)});',
    ]
    lines += [
        f'LIGHT ({_numbers(scene.camera_T_scene.apply(np.asarray(light.position)))}) COLOUR ({_numbers(light.colour)});'
        for light in case_lights(scene, pose)
    ]
    lines.append(f'DRAW {name} {_matrix(pose)};')
    lines += clutter_lines(clutter_of(case, scene, pose, rig))
    return '\n'.join(lines) + '\n'


def clutter_lines(clutter: Sequence[tuple[str, Pose]]) -> list[str]:
    """Statements of a scene file in metres that draw clutter, see :func:`clutter_about`."""
    return [f'DRAW {solid} COLOUR (1, 0.97, 0.9) PAINT FACES {_matrix(place)};' for solid, place in clutter]


def clutter_of(case: Case, scene: Scene, pose: Pose, rig: StereoRig) -> list[tuple[str, Pose]]:
    """Seeded blocks, notched blocks and cylinders about the object: beside or behind it in the left image."""
    rng = np.random.default_rng([case.seed, 71])
    middle, radius = model_centre(scene)
    return clutter_about(rng, [(pose.apply(middle), radius)], rig.left, case.clutter, 2.0 * radius)


def clutter_about(
    rng: np.random.Generator,
    objects: Sequence[tuple[np.ndarray, float]],
    camera: PinholeCamera,
    count: int,
    size_m: float,
) -> list[tuple[str, Pose]]:
    """Solids beside or behind objects in a camera's image, at distances like the first one's.

    Parameters
    ----------
    rng : numpy.random.Generator
    objects : sequence of (middle, radius)
        Spheres that nothing may hide or stick in: (3,) float64, metres, camera's frame, and metres.
    camera : PinholeCamera
    count : int
    size_m : float
        Metres, of an object: theirs are shares of it.

    Returns
    -------
    list of (str, Pose)
        Each as the modelling language has it, and camera_T_solid.
    """
    centre = objects[0][0]
    found: list[tuple[str, Pose]] = []
    while len(found) < count:
        depth = centre[2] * rng.uniform(*CLUTTER_DEPTH)
        pixel = rng.uniform((0.0, 0.0), (camera.width, camera.height))
        size = size_m * rng.uniform(*CLUTTER_SIZE, 3)
        long = float(np.linalg.norm(size))
        reach = camera.fx * long / 2.0 / depth
        behind = [
            middle[2] + about
            for middle, about in objects
            if np.linalg.norm(pixel - camera.project(middle)) <= camera.fx * about / middle[2] + reach
        ]
        if behind and depth < max(behind) + long:
            # Neither beside nor behind: it would hide an object, or stick in it. Far behind always is free.
            depth = max(behind) + long * rng.uniform(1.0, 2.0)
        place = Pose(Rotation.random(random_state=rng).as_matrix(), camera.rays(pixel) * depth)
        found.append((_solid(rng, size), place))
    return found


def _solid(rng: np.random.Generator, size: np.ndarray) -> str:
    x, y, z = size
    kind = rng.integers(3)
    if kind == 0:
        return f'(BLOCK ({_numbers(size)}))'
    if kind == 1:
        notch = _numbers([0.5 * x, 0.4 * y, 0.6 * z])
        return f'(BLOCK ({_numbers(size)}) DIFFERENCE (BLOCK ({_numbers(size)}) AT ({notch})))'
    return f'(CYLINDER ({_numbers([0.4 * x, 0.0, y, 0.0])}))'


def _matrix(pose: Pose) -> str:
    """Row form, as the language has it: the transpose of a column-form rotation."""
    return f'MATRIX ({_numbers([*pose.rotation.T.ravel(), *pose.translation])})'


def _numbers(values: object) -> str:
    return ', '.join(f'{value:.17g}' for value in np.asarray(values, dtype=float).ravel())
