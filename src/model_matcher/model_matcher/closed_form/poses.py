"""Many poses of one scene's object: a grid of views, random poses, a turntable, or one pose given by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from csg_renderer import Scene
from csg_renderer.language.values import rotation
from msgs_py import Pose

from .case import Case
from .placement import case_pose, load_case_scene, model_centre
from .settings import JITTER

SWEEPS = ('grid', 'random', 'turntable')


def sweep_cases(case: Case, sweep: str, count: int, distance: float | None = None) -> list[Case]:
    """Cases that differ in the pose of the object, each with a label and a seed of its own.

    Parameters
    ----------
    case : Case
        What they have in common.
    sweep : str
        'grid' (viewing directions spread evenly over the sphere), 'random' (any rotation, and shifted a little; seeded
        by the case) or 'turntable' (about the camera's vertical through the object's middle).
    count : int
        How many.
    distance : float, optional
        Metres, of the object's middle from the camera; that of the case when not given.

    Returns
    -------
    list of Case

    Raises
    ------
    ValueError
        Naming the argument.
    """
    if sweep not in SWEEPS:
        raise ValueError(f'sweep: expected one of {", ".join(SWEEPS)}, got {sweep!r}')
    if count < 1:
        raise ValueError(f'count: expected a whole number >= 1, got {count}')
    if distance is not None and not distance > 0.0:
        raise ValueError(f'distance: expected metres > 0, got {distance}')
    scene = load_case_scene(case)
    poses = sweep_poses(scene, case, sweep, count, distance)
    digits = len(str(count - 1))
    return [
        replace(case, pose=_flat(pose), seed=case.seed + k, label=f'{case.name}_{sweep}_{k:0{digits}d}')
        for k, pose in enumerate(poses)
    ]


def sweep_poses(scene: Scene, case: Case, sweep: str, count: int, distance: float | None = None) -> list[Pose]:
    """left_T_model of each case; arguments as for :func:`sweep_cases`."""
    start = case_pose(case, scene)
    middle, _ = model_centre(scene)
    centre = start.apply(middle)
    if distance is not None:
        centre = centre * (distance / centre[2])
    rng = np.random.default_rng([case.seed, 61])
    rotations = {'turntable': _turns, 'grid': _directions, 'random': _random}[sweep](count, start.rotation, rng)
    poses = []
    for turned in rotations:
        place = centre
        if sweep == 'random':
            place = centre + JITTER * centre[2] * rng.uniform(-1.0, 1.0, 3) * [0.5, 0.5, 1.0]
        poses.append(Pose(turned, place - turned @ middle))
    return poses


def pose_from_angles(numbers: list[float]) -> tuple[float, ...]:
    """The pose of a case from XROT, YROT, ZROT (degrees, applied in this order) and AT (mm), as in a scene file.

    Examples
    --------
    >>> pose_from_angles([0, 0, 0, 0, 0, 300])[11]
    0.3
    """
    if len(numbers) != 6:
        raise ValueError(f'pose: expected XROT YROT ZROT X Y Z, got {len(numbers)} numbers')
    turn = rotation('Z', numbers[2]) @ rotation('Y', numbers[1]) @ rotation('X', numbers[0])
    return _flat(Pose(turn[:3, :3], 1e-3 * np.asarray(numbers[3:])))


def _flat(pose: Pose) -> tuple[float, ...]:
    return tuple(float(value) for value in pose.matrix.ravel())


def _turns(count: int, start: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    angles = 2.0 * np.pi * np.arange(count) / count
    return [Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix() @ start for angle in angles]


def _directions(count: int, start: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Rotations that bring each point of a Fibonacci sphere to the front, upright as far as that can be."""
    k = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    found = []
    for front in np.column_stack([ring * np.cos(angle), height, ring * np.sin(angle)]):
        z = -front
        x = np.cross([0.0, 1.0, 0.0] if abs(front[1]) < 0.999 else [1.0, 0.0, 0.0], z)
        x /= np.linalg.norm(x)
        found.append(np.stack([x, np.cross(z, x), z]))
    return found


def _random(count: int, start: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    return [Rotation.random(random_state=rng).as_matrix() for _ in range(count)]
