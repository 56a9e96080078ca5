"""A small data set in the folders of BOP, rendered from known poses: three cameras above a table, three parts.

Part 1 is an L and has no symmetry, part 2 a box with three half turns, part 3 a cylinder with an axis of revolution.
The images are rendered from solids; the models are meshes of the same measures, as the benchmark has them.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from csg_renderer import Light, Placement, Scene, Solid, parse_scene, render
from csg_renderer.raycast.sensor import SensorModel, grey
from msgs_py import PinholeCamera, Pose

CAMERAS = ('cam1', 'cam2', 'cam3')
CAMERA = PinholeCamera.centred(640, 480, 900.0)
DEPTH_SCALE = 0.1  # millimetres a step of a depth image
FACETS = 48
L_OUTLINE = np.array([(0, 0), (60, 0), (60, 20), (20, 20), (20, 50), (0, 50)], float)
BOX = np.array([56.0, 34.0, 22.0])
RADIUS, HEIGHT = 18.0, 45.0
# The solids, millimetres, the middle of each one's box at the origin.
SOLIDS = {
    1: '(BLOCK (60, 20, 30) UNION BLOCK (20, 50, 30)) AT (-30, -25, -15)',
    2: f'BLOCK ({BOX[0]}, {BOX[1]}, {BOX[2]}) AT ({-BOX[0] / 2}, {-BOX[1] / 2}, {-BOX[2] / 2})',
    3: f'CYLINDER ({RADIUS}, 0, 0, {HEIGHT}) AT (0, 0, {-HEIGHT / 2})',
}
HALF_TURNS = [np.diag([1.0, -1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, -1.0, 1.0]), np.diag([-1.0, -1.0, 1.0, 1.0])]
SYMMETRIES = {
    1: {},
    2: {'symmetries_discrete': [turn.ravel().tolist() for turn in HALF_TURNS]},
    3: {
        'symmetries_discrete': [HALF_TURNS[0].ravel().tolist()],
        'symmetries_continuous': [{'axis': [0, 0, 1], 'offset': [0, 0, 0]}],
    },
}


def prism(outline: np.ndarray, height: float, hub: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (2n, 3) and triangles of an outline (n, 2) drawn up; ``hub`` is a corner that sees all the others."""
    n = len(outline)
    flat = outline - 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    vertices = np.concatenate([np.column_stack([flat, np.full(n, z)]) for z in (-0.5 * height, 0.5 * height)])
    fan = [(hub, (hub + k) % n, (hub + k + 1) % n) for k in range(1, n - 1)]
    faces = [(a, c, b) for a, b, c in fan] + [(a + n, b + n, c + n) for a, b, c in fan]
    for k in range(n):
        other = (k + 1) % n
        faces += [(k, other, other + n), (k, other + n, k + n)]
    return vertices, np.array(faces)


def meshes() -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Vertices (n, 3), millimetres, and triangles (m, 3) of the parts."""
    turn = 2.0 * np.pi * np.arange(FACETS) / FACETS
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * BOX[:2]
    return {
        1: prism(L_OUTLINE, 30.0, hub=3),
        2: prism(corners, BOX[2]),
        3: prism(RADIUS * np.column_stack([np.cos(turn), np.sin(turn)]), HEIGHT),
    }


def diameter(vertices: np.ndarray) -> float:
    """The largest distance of two vertices."""
    return float(np.linalg.norm(vertices[:, None] - vertices[None], axis=2).max())


def write_models(folder: Path) -> None:
    """obj_000001.ply, ... and models_info.json."""
    folder.mkdir(parents=True, exist_ok=True)
    info = {}
    for number, (vertices, faces) in meshes().items():
        head = [
            *('ply', 'format ascii 1.0', f'element vertex {len(vertices)}'),
            *(f'property float {axis}' for axis in 'xyz'),
            *(f'element face {len(faces)}', 'property list uchar int vertex_indices', 'end_header'),
        ]
        rows = [' '.join(f'{v:.6f}' for v in row) for row in vertices] + [f'3 {a} {b} {c}' for a, b, c in faces]
        (folder / f'obj_{number:06d}.ply').write_text('\n'.join([*head, *rows]) + '\n', encoding='ascii')
        info[number] = {'diameter': diameter(vertices), **SYMMETRIES[number]}
    (folder / 'models_info.json').write_text(json.dumps(info, indent=1), encoding='utf-8')


def camera_poses() -> list[Pose]:
    """camera_T_world of the three: half a metre above the table, looking at its middle; metres."""
    found = []
    for x, y in ((-0.06, 0.0), (0.06, 0.0), (0.0, 0.1)):
        eye = np.array([x, y, 0.5])
        forward = -eye / np.linalg.norm(eye)
        right = np.cross([0.0, 1.0, 0.0], forward)
        right = -right / np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        found.append(Pose(rotation, -rotation @ eye))
    return found


def object_poses(seed: int) -> dict[int, Pose]:
    """world_T_model of the parts, apart from one another; metres."""
    rng = np.random.default_rng(seed)
    places = {1: (-0.05, -0.03), 2: (0.05, -0.02), 3: (0.0, 0.05)}
    found = {}
    for number, (x, y) in places.items():
        tilt = Pose.from_rotation_vector(rng.uniform(-0.5, 0.5, 3) * [1, 1, 0])
        spin = Pose.from_rotation_vector([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        found[number] = Pose(tilt.compose(spin).rotation, [x, y, rng.uniform(0.0, 0.02)])
    return found


def solid(number: int) -> Solid:
    """A part, its faces of different greys."""
    return parse_scene(f'DRAW {SOLIDS[number]} COLOUR (1, 0.95, 0.9) PAINT FACES;').placements[0].solid


def write_scene(folder: Path, images: int = 1, one_camera: bool = False, noise: float = 1.0) -> None:
    """Images, depth, cameras and true poses.

    Parameters
    ----------
    folder : Path
        Named by the scene's number.
    images : int
        Of different poses of the parts.
    one_camera : bool
        Instead, one camera stands where the three do, one after the other, and the parts lie still.
    noise : float
        Grey levels.
    """
    solids = {number: solid(number) for number in SOLIDS}
    shots: dict[str, list[tuple[Pose, dict[int, Pose]]]] = {}
    if one_camera:
        still = object_poses(0)
        shots[''] = [(place, still) for place in camera_poses()]
    else:
        for name, place in zip(CAMERAS, camera_poses()):
            shots[name] = [(place, object_poses(seed)) for seed in range(images)]
    for name, views in shots.items():
        ending = f'_{name}' if name else ''
        for kind in ('rgb', 'depth'):
            (folder / f'{kind}{ending}').mkdir(parents=True, exist_ok=True)
        cameras, truth = {}, {}
        for number, (place, poses) in enumerate(views):
            placed = [Placement(f'part{k}', solids[k], pose.matrix) for k, pose in poses.items()]
            lights = [Light((0.3, 0.2, 1.0), (0.35, 0.35, 0.35))]
            scene = Scene(placed, lights, (0.55, 0.55, 0.55))
            frame = render(scene, CAMERA, place, antialias=3)
            sensor = SensorModel(0.5, noise, (number, len(name), 7))
            picture = sensor.apply(grey(frame.image).astype(float))
            cv2.imwrite(str(folder / f'rgb{ending}' / f'{number:06d}.png'), picture)
            depth = np.nan_to_num(frame.depth * 1e3 / DEPTH_SCALE)
            cv2.imwrite(str(folder / f'depth{ending}' / f'{number:06d}.png'), np.rint(depth).astype(np.uint16))
            k = [CAMERA.fx, 0, CAMERA.cx, 0, CAMERA.fy, CAMERA.cy, 0, 0, 1]
            cameras[number] = {'cam_K': k, 'depth_scale': DEPTH_SCALE, **_transform(place, 'w2c')}
            truth[number] = [{'obj_id': part, **_transform(place.compose(pose), 'm2c')} for part, pose in poses.items()]
        (folder / f'scene_camera{ending}.json').write_text(json.dumps(cameras), encoding='utf-8')
        (folder / f'scene_gt{ending}.json').write_text(json.dumps(truth), encoding='utf-8')


def _transform(pose: Pose, what: str) -> dict[str, list[float]]:
    return {f'cam_R_{what}': pose.rotation.ravel().tolist(), f'cam_t_{what}': (1e3 * pose.translation).tolist()}
