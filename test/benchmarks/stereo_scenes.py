"""Random scenes of straight edges for the evaluation of stereo recovery, with the truth from the solids themselves.

A seed decides everything: the solid (block, L-shape, wedge, chipped block, stacked boxes; 60 to 70 mm in its longest
direction), its pose (180 to 330 mm away), the greys of its faces, the lights, the rig (baseline about a fifth of the
distance) and the noise. 512 x 512 pixels, f = 703 px, point spread 0.5 px, noise of 2 grey levels, unless another
Imaging is asked for. A third camera stands above the pair and looks down a little.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from csg_renderer import Light, Scene, Solid, Surface, model_features, render, render_stereo
from csg_renderer.raycast.sensor import SensorModel, grey
from csg_renderer.visibility.hidden_lines import stereo_fragments, visible_features
from msgs_py import CameraRig, FeatureKind, FeatureSet, PinholeCamera, Pose, StereoRig

MM = 1e-3
CAMERA = PinholeCamera.centred(512, 512, 703.0)
SHAPES = ('block', 'l-shape', 'wedge', 'chipped', 'stacked')
KINDS = ('any', 'flat')
# An edge is flat within this angle of the rows; a flat view has so much of its visible length in flat edges.
FLAT_SINE = np.sin(np.radians(8.0))
FLAT_SHARE = 0.47
# Edges shorter than this, metres, are no truth; edges with less contrast, grey levels, are in no picture.
SHORTEST = 4.0 * MM
LEAST_CONTRAST = 6.0
# Where a third camera stands, baselines from the left one, and how it is turned, radians about x, y, z.
ABOVE, LOOKING_DOWN = (0.45, -0.9, 0.05), (-0.16, 0.02, 0.05)


@dataclass(frozen=True)
class Imaging:
    """How pictures are taken.

    camera : of both eyes; the object is moved away as far as it takes to look as large in it as in the usual one
    depth_ratio : distance over baseline, give or take 15 %; blur : pixels, one sigma; noise : grey levels
    cameras : 2, or 3 with one above the pair
    """

    camera: PinholeCamera = CAMERA
    depth_ratio: float = 5.0
    blur: float = 0.5
    noise: float = 2.0
    cameras: int = 2

    @property
    def remoteness(self) -> float:
        """How many times further away than usual objects are."""
        usual = CAMERA.fx / min(CAMERA.width, CAMERA.height)
        return self.camera.fx / min(self.camera.width, self.camera.height) / usual


USUAL = Imaging()


@dataclass(frozen=True, eq=False)
class StereoScene:
    """A rendered pair and its truth.

    left, right : (h, w) uint8; rig : StereoRig
    edges : (n, 2, 3) float64, metres, left frame: edges that both eyes see; faint : (n,) bool: without contrast
    model_index : (n,) int, the edge of the model each is a part of; model : FeatureSet of edges, model frame
    pose : left_T_model; nearest : (n,) float64, pixels: in either picture, how near its middle half is to another edge
    cameras : CameraRig; images : of each of its cameras, the pair's first; left_sees : (k, 2, 3), of three cameras, all
        edges that the left eye sees: the third one may see them too
    """

    name: str
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    edges: np.ndarray
    faint: np.ndarray
    model_index: np.ndarray
    model: FeatureSet
    pose: Pose
    nearest: np.ndarray
    cameras: CameraRig
    images: tuple[np.ndarray, ...]
    left_sees: np.ndarray


def random_scene(seed: int, kind: str = 'any', rays: int = 4, imaging: Imaging = USUAL) -> StereoScene:
    """kind : 'any', or 'flat' for a view with nearly half of its visible length along the rows; rays : 4 for 4 x 4 rays
    a pixel; 0 for one ray, no blur and no noise (the pictures of 1992); imaging : camera, rig and noise."""
    if kind not in KINDS:
        raise ValueError(f'kind: expected one of {", ".join(KINDS)}, got {kind!r}')
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    shape = SHAPES[seed % len(SHAPES)]
    solid = _solid(shape, rng)
    model = model_features(solid).of_kind(FeatureKind.EDGE)
    centre = 0.5 * (model.start.min(axis=0) + model.start.max(axis=0))
    while True:
        distance = rng.uniform(180.0, 330.0) * MM * imaging.remoteness
        rig = StereoRig.symmetric(imaging.camera, distance / imaging.depth_ratio * rng.uniform(0.85, 1.15))
        turn = _flat_turn(rng) if kind == 'flat' else _any_turn(rng)
        aim = np.array([0.5 * rig.baseline + rng.uniform(-10, 10) * MM, rng.uniform(-15, 15) * MM, distance])
        pose = Pose(turn, aim - turn @ centre)
        ((features, index),) = stereo_fragments([(solid, pose)], rig)
        edge = (features.kind == FeatureKind.EDGE) & (features.lengths >= SHORTEST)
        seen = features.select(edge)
        # The object must be in both pictures as a whole.
        corners = pose.apply(np.concatenate([model.start, model.end]))
        whole = all(imaging.camera.contains(pixels).all() for pixels in rig.project(corners))
        if whole and (kind == 'any' or flat_share(seen) >= FLAT_SHARE):
            break
    light = [
        Light(tuple(rng.uniform((-0.5, -0.7, -0.5), (0.5, 0.1, 0.1))), (strength,) * 3)
        for strength in (rng.uniform(0.6, 0.9), rng.uniform(0.1, 0.4))
    ]
    scene = Scene([solid.transformed(pose)], light, (rng.uniform(0.1, 0.3),) * 3, (rng.uniform(0.0, 0.7),) * 3)
    frames = render_stereo(scene, rig, antialias=rays)
    clean = [grey(frame.image) for frame in frames]
    cameras = CameraRig.from_stereo(rig)
    if imaging.cameras > 2:
        cameras = with_third(rig)
        third = render(scene, cameras.cameras[2], cameras.poses[2].inverse(), antialias=rays)
        clean.append(grey(third.image))
    by_each = _seen_by_each(solid, pose, rig)
    edges = np.stack([seen.start, seen.end], axis=1)
    faint = (
        np.minimum(*(_contrast(image, pixels) for image, pixels in zip(clean[:2], rig.project(edges)))) < LEAST_CONTRAST
    )
    images = [
        SensorModel(imaging.blur, imaging.noise, (seed, eye)).apply(image) if rays else np.rint(image).astype(np.uint8)
        for eye, image in enumerate(clean)
    ]
    nearest = np.minimum(
        *(
            _nearest(pixels, eye.project(one.start), eye.project(one.end))
            for eye, pixels, one in zip((rig.left, rig.right), rig.project(edges), by_each)
        )
    )
    return StereoScene(
        f'{shape} {seed} {kind}',
        images[0],
        images[1],
        rig,
        edges,
        faint,
        index[edge],
        model,
        pose,
        nearest,
        cameras,
        tuple(images),
        np.stack([by_each[0].start, by_each[0].end], axis=1)[: None if len(cameras) > 2 else 0],
    )


def with_third(rig: StereoRig) -> CameraRig:
    """The pair, and a third camera like its left one above it."""
    pair = CameraRig.from_stereo(rig)
    above = Pose.from_rotation_vector(LOOKING_DOWN, rig.baseline * np.array(ABOVE))
    return CameraRig([*pair.cameras, rig.left], [*pair.poses, above])


def _seen_by_each(solid: Solid, pose: Pose, rig: StereoRig) -> list[FeatureSet]:
    """The edges that the left and the right eye see, each in its own camera's frame."""
    right = Pose(pose.rotation, pose.translation + rig.right_T_left)
    return [
        visible_features(solid, eye, camera).of_kind(FeatureKind.EDGE)
        for eye, camera in ((pose, rig.left), (right, rig.right))
    ]


def _nearest(lines: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(n,) float64, pixels: how near the middle half of lines (n, 2, 2) comes to others, start and end (m, 2)."""
    share = np.linspace(0.25, 0.75, 11)[:, None]
    result = np.full(len(lines), np.inf)
    run = end - start
    length = np.maximum(np.hypot(*run.T), 1e-9)
    for k, (a, b) in enumerate(lines):
        points = a + share * (b - a)
        away = points[:, None] - start
        place = np.clip((away * run).sum(axis=2) / length**2, 0.0, 1.0)
        distance = np.linalg.norm(away - place[..., None] * run, axis=2)
        own = (distance[[0, -1]] < 0.01).all(axis=0)
        if (~own).any():
            result[k] = distance[:, ~own].min()
    return result


def flat_share(seen: FeatureSet) -> float:
    """How much of the visible length lies within 8 degrees of the rows, by length in space."""
    lengths = seen.lengths
    flat = is_flat(np.stack([seen.start, seen.end], axis=1))
    return float(lengths[flat].sum() / max(lengths.sum(), 1e-12))


def is_flat(edges: np.ndarray) -> np.ndarray:
    """(n,) bool, for edges (n, 2, 3) in the left frame."""
    pixels = CAMERA.project(edges)
    run = pixels[:, 1] - pixels[:, 0]
    return np.abs(run[:, 1]) < FLAT_SINE * np.hypot(run[:, 0], run[:, 1])


def _any_turn(rng: np.random.Generator) -> np.ndarray:
    return Pose.from_quaternion(_unit(rng.normal(size=4))).rotation


def _flat_turn(rng: np.random.Generator) -> np.ndarray:
    """One axis of the solid, any, nearly along the rows; any angle about it."""

    def about(axis: int, angle: float) -> np.ndarray:
        vector = np.zeros(3)
        vector[axis] = angle
        return Pose.from_rotation_vector(vector).rotation

    order = np.roll(np.eye(3), rng.integers(3), axis=0) * rng.choice([-1.0, 1.0])
    order *= np.sign(np.linalg.det(order))
    small = np.radians(5.0)
    return (
        about(2, rng.uniform(-small, small))
        @ about(1, rng.uniform(-small, small))
        @ about(0, rng.uniform(-np.pi, np.pi))
        @ order
    )


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _solid(shape: str, rng: np.random.Generator) -> Solid:
    longest = rng.uniform(60, 70) * MM
    second, third = rng.uniform(0.5, 0.9) * longest, rng.uniform(0.35, 0.7) * longest
    box = _block(longest, second, third, rng)
    if shape == 'l-shape':
        notch = _block(rng.uniform(0.3, 0.7) * longest, rng.uniform(0.3, 0.7) * second, 2.0 * third, rng)
        return box - notch.transformed(_shift(0.0, 0.0, -0.5 * third))
    if shape == 'wedge':
        normal = np.array([second, longest * rng.uniform(0.6, 1.0), 0.0])
        return box & _cutter(normal, second * longest * rng.uniform(0.9, 1.0), rng)
    if shape == 'chipped':
        # The plane cuts off one corner, at these depths along the three edges.
        normal = 1.0 / (rng.uniform(0.3, 0.7, 3) * (longest, second, third))
        return box & _cutter(normal, normal @ (longest, second, third) - 1.0, rng)
    if shape == 'stacked':
        width, length = rng.uniform(0.4, 0.7, 2) * (longest, second)
        upper = _block(width, length, rng.uniform(0.3, 0.6) * longest, rng)
        return box | upper.transformed(
            _shift(rng.uniform(0.1, 0.9) * (longest - width), rng.uniform(0.1, 0.9) * (second - length), third)
        )
    return box


def _shift(x: float, y: float, z: float) -> Pose:
    return Pose(np.eye(3), (x, y, z))


def _block(x: float, y: float, z: float, rng: np.random.Generator) -> Solid:
    """Every face has its own grey."""
    greys = np.repeat(rng.uniform(0.35, 1.0, (6, 1)), 3, axis=1)
    return replace(Solid.block(x, y, z), face_colours=greys)


def _cutter(normal: np.ndarray, offset: float, rng: np.random.Generator) -> Solid:
    return Solid.plane(normal, offset).painted(Surface((rng.uniform(0.35, 1.0),) * 3))


def _contrast(image: np.ndarray, pixels: np.ndarray, offset: float = 1.5) -> np.ndarray:
    """(n,) float64: median difference of grey levels across each line (n, 2, 2)."""
    share = np.linspace(0.1, 0.9, 17)[:, None]
    result = []
    for a, b in pixels:
        across = offset * np.array([a[1] - b[1], b[0] - a[0]]) / max(np.linalg.norm(b - a), 1e-9)
        sides = [np.rint((1 - share) * a + share * b + sign * across).astype(int) for sign in (1, -1)]
        sides = [np.clip(p, 0, [image.shape[1] - 1, image.shape[0] - 1]) for p in sides]
        values = [image[p[:, 1], p[:, 0]] for p in sides]
        result.append(float(np.median(np.abs(values[0] - values[1]))))
    return np.array(result)
