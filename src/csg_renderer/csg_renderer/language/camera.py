"""CAMERA, STEREO and DISPARITY to a PinholeCamera, its place, and a baseline."""

from __future__ import annotations

import math

import numpy as np

from msgs_py import PinholeCamera, Pose

from .settings import DEFAULT_SIDE, LARGEST_VIEW, LEAST_VIEW, MAX_SIDE, PARALLEL_UP
from .values import length

# Clauses of CAMERA and how many numbers each takes.
CLAUSES: dict[str, tuple[tuple[int, ...], str]] = {
    'SIZE': ((2,), 'width and height in pixels'),
    'FOCAL': ((1, 2), 'focal length in pixels, or one for x and one for y'),
    'FOV': ((1,), 'horizontal field of view in degrees'),
    'CENTRE': ((2,), 'principal point in pixels'),
    'K': ((9,), 'rows of the calibration matrix'),
    'RT': ((12,), 'rows of [R|t], camera from scene'),
    'FROM': ((3,), 'position of the camera'),
    'TO': ((3,), 'point looked at'),
    'UP': ((3,), 'direction that is up in the picture'),
}


def camera_of(clauses: dict[str, list[float]], per_metre: float) -> tuple[PinholeCamera, Pose, float | None]:
    """The camera, camera_T_scene, and the distance of the point looked at (None without TO), metres.

    Raises ValueError with a message for the user.
    """
    _exclude(clauses, 'K', ('FOCAL', 'FOV', 'CENTRE'))
    _exclude(clauses, 'RT', ('FROM', 'TO', 'UP'))
    _exclude(clauses, 'FOV', ('FOCAL',))
    width, height = clauses.get('SIZE', [DEFAULT_SIDE, DEFAULT_SIDE])
    for name, value in (('width', width), ('height', height)):
        if value != round(value) or not 1 <= value <= MAX_SIDE:
            raise ValueError(f'SIZE: {name} is {value:g}, expected a whole number of pixels in 1..{MAX_SIDE}')
    if 'K' in clauses:
        k = np.reshape(clauses['K'], (3, 3))
        if (k[[0, 1, 2, 2], [1, 0, 0, 1]] != 0.0).any() or k[2, 2] != 1.0:
            raise ValueError('K: expected fx, 0, cx, 0, fy, cy, 0, 0, 1 (no skew)')
        fx, fy, cx, cy = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
    else:
        if 'FOV' in clauses:
            (angle,) = clauses['FOV']
            if not LEAST_VIEW <= angle <= LARGEST_VIEW:
                raise ValueError(f'FOV is {angle:g}, expected degrees in {LEAST_VIEW:g}..{LARGEST_VIEW:g}')
            fx = fy = width / (2.0 * math.tan(math.radians(angle) / 2.0))
        elif 'FOCAL' in clauses:
            fx, fy = clauses['FOCAL'][0], clauses['FOCAL'][-1]
        else:
            raise ValueError('CAMERA needs FOCAL(pixels), FOV(degrees) or K(...)')
        cx, cy = clauses.get('CENTRE', [(width - 1) / 2, (height - 1) / 2])
    camera = PinholeCamera(int(width), int(height), fx, fy, cx, cy)
    if 'RT' in clauses:
        rows = np.reshape(clauses['RT'], (3, 4))
        return camera, Pose(rows[:, :3], np.array([length(t, per_metre, 'position') for t in rows[:, 3]])), None
    if 'FROM' not in clauses and 'TO' not in clauses:
        if 'UP' in clauses:
            raise ValueError('UP goes with TO(x, y, z)')
        return camera, Pose(), None
    viewpoint, target = (
        [length(n, per_metre, 'position') for n in clauses.get(name, [0.0, 0.0, 0.0])] for name in ('FROM', 'TO')
    )
    if 'TO' not in clauses:
        if 'UP' in clauses:
            raise ValueError('UP goes with TO(x, y, z)')
        return camera, Pose(np.eye(3), -np.asarray(viewpoint)), None
    distance = float(np.linalg.norm(np.subtract(target, viewpoint)))
    return camera, look_at(viewpoint, target, clauses.get('UP', [0.0, -1.0, 0.0])), distance


def look_at(viewpoint: list[float], target: list[float], up: list[float]) -> Pose:
    """The pose of a camera that sees a point in the middle of its image.

    Parameters
    ----------
    viewpoint, target : (3,) sequence of float
        Where the camera is, and what it looks at, metres, scene frame.
    up : (3,) sequence of float
        Direction that points upwards in the image (whose y points down), scene frame.

    Returns
    -------
    Pose
        camera_T_scene.

    Raises
    ------
    ValueError
        The directions are none, or are parallel.

    Examples
    --------
    >>> look_at([0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0]).translation.tolist()
    [0.0, 0.0, 1.0]
    """
    forward = np.subtract(target, viewpoint)
    distance = np.linalg.norm(forward)
    if not distance > 0.0:
        raise ValueError('CAMERA: FROM and TO are the same point')
    forward = forward / distance
    tallness = np.linalg.norm(up)
    if not tallness > 0.0:
        raise ValueError('CAMERA: UP has no length')
    right = np.cross(forward, np.asarray(up) / tallness)
    if np.linalg.norm(right) < PARALLEL_UP:
        raise ValueError('CAMERA: UP is parallel to the viewing direction')
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pose(rotation, -rotation @ np.asarray(viewpoint, dtype=np.float64))


def _exclude(clauses: dict[str, list[float]], word: str, others: tuple[str, ...]) -> None:
    for other in others:
        if word in clauses and other in clauses:
            raise ValueError(f'CAMERA: {word} and {other} say the same thing, use one')
