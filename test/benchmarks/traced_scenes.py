"""The scenes of the path tracer's pairs, built again for our renderer: the same things in the same places and lights.

Beside the pairs stands the script that made them (make_scenes.py). It builds a scene with random numbers of its seed
and hands shapes, materials and lights to the path tracer one by one; here they are written down instead, and made of
our solids, surfaces and lights. Poses come out as they are stated in the pair's truth, to rounding.

The script drops parts without interpenetration and finds how they rest, for which it needs manifold3d, trimesh and
networkx; without them nothing is built.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from csg_renderer import Environment, Light, Scene, Solid, Surface, Texture, load_models, render_stereo
from msgs_py import PinholeCamera, Pose, StereoRig

NEEDED = ('manifold3d', 'trimesh', 'networkx', 'scipy')
# The script's side of a texture on parts and things, metres.
TEXTURE_SIDE = 0.12
# Sheets of paper and the ground have this thickness, metres.
THIN = 1e-4
# Of the plastic's clear coat (index 1.49): what passes it twice, 0.92 / 1.49^2; what is reflected inside; and what
# comes straight back.
PASSES, INSIDE, COAT = 0.414, 0.596, 0.04
# All light is dimmed by this, so that highlights are not clipped before the sensor, which sets its own white.
DIM = 0.1


class Unbuilt(Exception):
    """A scene that cannot be built again; says why."""


@dataclass
class Built:
    """What the script made of a family and seed.

    Attributes
    ----------
    scene : Scene
        World frame, metres.
    rig : StereoRig
    left_T_world : Pose
    sensor : dict of str to float
        For the script's ``develop``.
    random : numpy.random.Generator
        In the state in which the script developed its pictures.
    instances : list of (4, 4) array
        left_T_part of the parts.
    develop : callable
        The script's camera: radiance of both pictures to grey values.
    metal : bool
        Whether light has a longer way there: metal, bins.
    """

    scene: Scene
    rig: StereoRig
    left_T_world: Pose
    sensor: dict[str, float]
    random: np.random.Generator
    instances: list[np.ndarray]
    develop: Any
    metal: bool


@dataclass
class _World:
    """What is written down."""

    solids: list[Solid] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    around: np.ndarray | None = None


def script_of(folder: Path) -> ModuleType:
    """The script beside the pairs. Raises Unbuilt when it, or what it needs, is not there."""
    for name in NEEDED:
        if importlib.util.find_spec(name) is None:
            raise Unbuilt(f'{name} is not installed')
    path = folder / 'make_scenes.py'
    if not path.is_file():
        raise Unbuilt(f'{path}: no such file')
    spec = importlib.util.spec_from_file_location('make_scenes', path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules['make_scenes'] = module
    spec.loader.exec_module(module)
    return module


def build(folder: Path, family: str, seed: int) -> Built:
    """The scene of a pair.

    Parameters
    ----------
    folder : Path
        photoreal/.
    family : str
    seed : int

    Returns
    -------
    Built

    Raises
    ------
    Unbuilt
        What is needed is not there.
    """
    script = script_of(folder)
    models = script.read_models(folder / 'models.npz')
    parts = {name: next(iter(load_models(folder / 'parts' / f'{name}.csg').values())) for name in models}
    world = _World()
    script.Builder = _recorder(script, parts, world)
    builder, camera, world_T_left, _, _, sensor, random = script.build(family, seed, models, sorted(models))
    left = PinholeCamera(camera['width'], camera['height'], camera['fx'], camera['fy'], camera['cx'], camera['cy'])
    left_T_world = np.linalg.inv(world_T_left)
    around = np.zeros((2, 4)) if world.around is None else world.around
    return Built(
        Scene(world.solids, world.lights, environment=Environment(DIM * around, up=(0.0, 0.0, 1.0))),
        StereoRig(left, left, camera['baseline']),
        Pose.from_matrix(left_T_world),
        sensor,
        random,
        [left_T_world @ matrix for _, matrix in builder.instances],
        script.develop,
        family in ('metal', 'bin'),
    )


def pictures(built: Built, antialias: int = 2, samples: int = 4) -> list[np.ndarray]:
    """Both pictures of a scene as the script's camera develops them, (h, w) uint8."""
    frames = render_stereo(
        built.scene,
        built.rig,
        built.left_T_world,
        levels=3 if built.metal else 2,
        shadows=True,
        antialias=antialias,
        samples=samples,
        radiance=True,
    )
    light = [np.asarray(frame.radiance[..., 0], dtype=np.float64) for frame in frames if frame.radiance is not None]
    return [noisy for noisy, _ in built.develop(light, built.sensor, built.random)]


# -- what the script hands over -------------------------------------------------------------------------------------


def _recorder(script: ModuleType, parts: dict[str, Solid], world: _World) -> type:
    """The script's builder, which writes into ``world`` instead of making shapes of the path tracer."""

    class Recorder(script.Builder):  # type: ignore[name-defined, misc]
        """The script's builder."""

        def __init__(self, models: Any, rng: np.random.Generator) -> None:
            self.models, self.rng = models, rng
            self.shapes: dict[str, None] = {}
            self.instances: list[tuple[str, np.ndarray]] = []
            self.lights: dict[str, Any] = {}
            still = SimpleNamespace(rotate=lambda axis, degrees: None)
            self.mi = SimpleNamespace(Bitmap=lambda pixels: pixels, ScalarTransform4f=lambda: still)

        def bitmap(self, values: np.ndarray) -> np.ndarray:
            return np.clip(np.asarray(values, dtype=np.float32), 0.005, 0.92)

        def part(self, name: str, matrix: np.ndarray, skin: Any, uv: str = 'box') -> None:
            corners = self.models[name]['v']
            self._put(skinned(parts[name], skin, uv, corners.min(axis=0), np.ptp(corners, axis=0)), matrix)
            self.instances.append((name, matrix))

        def solid(self, mesh: Any, matrix: np.ndarray, skin: Any, uv: str = 'box') -> None:
            corners = np.asarray(mesh.vertices)
            self._put(skinned(primitive_of(corners), skin, uv, corners.min(axis=0), np.ptp(corners, axis=0)), matrix)

        def plane(self, matrix: np.ndarray, size: Any, skin: Any) -> None:
            low = np.array([-0.5 * size[0], -0.5 * size[1], -THIN])
            sheet = Solid.block(size[0], size[1], THIN).transformed(Pose(np.eye(3), low))
            self._put(skinned(sheet, skin, 'plane', low, np.array([*size, THIN])), matrix)

        def area(self, at: Any, to: Any, size: Any, power: float) -> None:
            # A matt white surface straight before the light returns power / pi.
            grey = DIM * power / np.pi
            world.lights.append(Light(tuple(at), (grey, grey, grey), float(np.sqrt(size[0] * size[1] / np.pi))))

        def ambient(self, radiance: float) -> None:
            world.around = np.full((2, 4), radiance)

        def room(self, level: float) -> None:
            super().room(level)
            # The script's picture begins with what lies along y; ours has what lies along x in its middle.
            picture = np.asarray(self.lights['env']['bitmap'])
            world.around = np.roll(picture, picture.shape[1] // 4, axis=1)

        def _put(self, solid: Solid, matrix: np.ndarray) -> None:
            self.shapes[f's{len(self.shapes)}'] = None
            world.solids.append(solid.transformed(matrix))

    return Recorder


def primitive_of(corners: np.ndarray) -> Solid:
    """The box, cylinder or tube that a mesh of the script approximates, from its corners (n, 3)."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    if len(corners) == 8:
        return Solid.block(*(high - low)).transformed(Pose(np.eye(3), low))
    size = high - low
    # Round about the axis whose extent differs from the two others.
    axis = max(range(3), key=lambda k: abs(size[k] - size[k - 1]) + abs(size[k] - size[k - 2]))
    others = [k for k in range(3) if k != axis]
    middle = 0.5 * (low + high)
    away = np.linalg.norm((corners - middle)[:, others], axis=1)
    start, along = middle.copy(), np.zeros(3)
    start[axis], along[axis] = low[axis], size[axis]
    solid: Solid = Solid.cylinder(float(away.max()), along)
    if away.min() > 0.01 * away.max():
        solid = solid - Solid.cylinder(float(away.min()), 1.2 * along).transformed(Pose(np.eye(3), -0.1 * along))
    return solid.transformed(Pose(np.eye(3), start))


def skinned(solid: Solid, skin: dict[str, Any], uv: str, low: np.ndarray, size: np.ndarray) -> Solid:
    """A solid with a material of the script.

    Parameters
    ----------
    solid : Solid
        In its own frame.
    skin : dict
        Of the path tracer.
    uv : str
        'box': repeated on all sides; 'atlas': a picture for each side; 'plane': one picture from corner to corner.
    low, size : (3,) array of float64
        Of the box about it, metres.
    """
    surface, picture = material(skin)
    solid = solid.painted(surface)
    if picture is None:
        return solid
    corner = Pose(np.eye(3), -low)
    if uv == 'atlas':
        return solid.textured(Texture(picture, 'box', tuple(size)), corner)
    if uv == 'plane':
        return solid.textured(Texture(picture, 'planar', (size[0], size[1])), corner)
    return solid.textured(Texture(picture, 'box', (TEXTURE_SIDE, TEXTURE_SIDE)))


def material(skin: dict[str, Any]) -> tuple[Surface, np.ndarray | None]:
    """Our nearest surface to a material of the script, and its picture."""
    if skin['type'] == 'twosided':
        metal = skin['b']
        eta, k = metal['eta'], metal['k']
        straight = ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)
        # Its roughness varies from place to place; ours is its mean.
        return Surface((straight,) * 3, roughness=float(np.mean(metal['alpha']))), metal['specular_reflectance']
    if skin['type'] == 'diffuse':
        return _matt(Surface(), skin['reflectance'])
    alpha = skin['alpha']
    # The lobe of the coat: its height at right angles, and the exponent of about its width.
    shiny = Surface(specular=min(1.0, COAT / (4.0 * alpha**2)), shininess=max(0.5 / alpha**2 - 0.5, 1.0))
    diffuse = np.asarray(skin['diffuse_reflectance'])
    return _matt(shiny, PASSES * diffuse / (1.0 - INSIDE * diffuse))


def _matt(surface: Surface, reflectance: Any) -> tuple[Surface, np.ndarray | None]:
    values = np.asarray(reflectance)
    if values.ndim == 2:
        return replace(surface, colour=(1.0, 1.0, 1.0)), values
    return replace(surface, colour=(float(values),) * 3), None
