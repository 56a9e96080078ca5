"""What a scene's pictures, metals, luminous balls and surroundings are to an engine: flat arrays, None without any."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, Float32Array, FloatArray, IntArray

from ...scene.scene import Scene
from ...scene.solid import Primitive
from ...scene.textures import ATLAS, Environment, Laid
from ..settings import ALBEDO_SAMPLES, ALBEDO_STEPS, LEAST_ROUGHNESS

PLANAR, BOX, SIDES, CYLINDRICAL = range(4)
NO_PICTURE = -1


class SurfaceData(NamedTuple):
    """Pictures and metals of a program. n leaves, p pictures, l lights.

    Attributes
    ----------
    texels : (k, 3) float32
        Of all pictures, each halved again and again down to one pixel, row by row.
    level_start : (p + 1,)
        Into the three that follow: the levels of each picture.
    texel_start, columns, rows : (levels of all,)
    clamped : (p,)
        Whether a picture ends at its borders instead of being repeated. An environment is repeated across only.
    picture : (n,)
        The (first) picture of each leaf, or NO_PICTURE.
    mapping : (n,)
    size : (n, 3)
        Of the texture, metres; of SIDES signed.
    to_texture : (n, 3, 4)
        Texture frame from the scene.
    normal_to_texture : (n, 3, 3)
        The same for normals, which become of any length.
    roughness : (n,)
        Of metals, else -1.
    radius : (l,)
        Of the lights, metres.
    environment : int
        Its picture, or NO_PICTURE.
    axes : (3, 3)
        Environment.axes.
    albedo : (ALBEDO_STEPS, ALBEDO_STEPS)
        See :func:`albedo_table`.
    """

    texels: Float32Array
    level_start: IntArray
    texel_start: IntArray
    columns: IntArray
    rows: IntArray
    clamped: BoolArray
    picture: IntArray
    mapping: IntArray
    size: FloatArray
    to_texture: FloatArray
    normal_to_texture: FloatArray
    roughness: FloatArray
    radius: FloatArray
    environment: int
    axes: FloatArray
    albedo: FloatArray


def surface_data(scene: Scene, leaves: Sequence[Primitive]) -> SurfaceData | None:
    """The data of a scene, or None where Phong's model and lights that are points say all.

    Parameters
    ----------
    scene : Scene
    leaves : sequence of Primitive
        Those of the scene; a terrain is one, too.

    Returns
    -------
    SurfaceData or None
    """
    plain = all(leaf.laid is None and leaf.surface.roughness is None for leaf in leaves)
    if plain and scene.environment is None and all(light.radius == 0.0 for light in scene.lights):
        return None
    pictures = _Pictures()
    n = len(leaves)
    picture, mapping = np.full(n, NO_PICTURE, dtype=np.int64), np.zeros(n, dtype=np.int64)
    size, roughness = np.ones((n, 3)), np.full(n, -1.0)
    to_texture, normal_to_texture = np.zeros((n, 3, 4)), np.zeros((n, 3, 3))
    for index, leaf in enumerate(leaves):
        if leaf.surface.roughness is not None:
            roughness[index] = max(leaf.surface.roughness, LEAST_ROUGHNESS)
        if leaf.laid is not None:
            picture[index], mapping[index] = pictures.laid(leaf.laid)
            size[index, : len(leaf.laid.texture.size)] = leaf.laid.texture.size
            matrix = leaf.laid.frame @ np.linalg.inv(leaf.own_frame)
            to_texture[index], normal_to_texture[index] = matrix[:3], np.linalg.inv(matrix[:3, :3]).T
    environment, axes = NO_PICTURE, np.eye(3)
    if scene.environment is not None:
        environment, axes = pictures.environment(scene.environment), np.ascontiguousarray(scene.environment.axes)
    return SurfaceData(
        *pictures.arrays(),
        picture,
        mapping,
        size,
        to_texture,
        normal_to_texture,
        roughness,
        np.array([light.radius for light in scene.lights]).reshape(-1),
        environment,
        axes,
        albedo_table(),
    )


class _Pictures:
    """Pictures one after another, each once, with all that they are reduced to."""

    def __init__(self) -> None:
        self.known: dict[tuple[int, bool], int] = {}
        self.levels: list[list[Float32Array]] = []
        self.clamped: list[bool] = []

    def laid(self, laid: Laid) -> tuple[int, int]:
        """The first picture of a texture, and its mapping."""
        texture = laid.texture
        sides = len(texture.size) == 3
        key = id(texture.image), sides
        if key not in self.known:
            parts: list[AnyArray] = [texture.image]
            if sides:
                across, down = ATLAS
                rows = np.array_split(texture.image, down, axis=0)
                parts = [part for row in rows for part in np.array_split(row, across, axis=1)]
            self.known[key] = len(self.levels)
            for part in parts:
                self._add(np.asarray(part, dtype=np.float32), sides)
        names = {'planar': PLANAR, 'box': SIDES if sides else BOX, 'cylindrical': CYLINDRICAL}
        return self.known[key], names[texture.mapping]

    def environment(self, environment: Environment) -> int:
        """The picture of an environment."""
        self._add(environment.image * np.float32(environment.brightness), False, True)
        return len(self.levels) - 1

    def _add(self, picture: Float32Array, clamped: bool, sphere: bool = False) -> None:
        self.levels.append(halved(picture, sphere))
        self.clamped.append(clamped)

    def arrays(self) -> tuple[Float32Array, IntArray, IntArray, IntArray, IntArray, BoolArray]:
        """The first six of SurfaceData."""
        levels = [level for picture in self.levels for level in picture]
        counts = [level.shape[0] * level.shape[1] for level in levels]
        return (
            np.concatenate([level.reshape(-1, 3) for level in levels] or [np.zeros((1, 3), dtype=np.float32)]),
            np.cumsum([0, *(len(picture) for picture in self.levels)]),
            np.cumsum([0, *counts[:-1]]) if counts else np.zeros(0, dtype=np.int64),
            np.array([level.shape[1] for level in levels], dtype=np.int64),
            np.array([level.shape[0] for level in levels], dtype=np.int64),
            np.array(self.clamped, dtype=bool),
        )


def halved(picture: Float32Array, sphere: bool = False) -> list[Float32Array]:
    """A picture, halved again and again down to one pixel.

    Parameters
    ----------
    picture : (h, w, 3) float32
    sphere : bool
        It goes around a sphere: its rows count as much as they cover there.

    Returns
    -------
    list of (h, w, 3) float32
    """
    levels = [picture]
    while max(levels[-1].shape[:2]) > 1:
        last = levels[-1]
        h, w = last.shape[:2]
        small = max(1, w // 2), max(1, h // 2)
        if not sphere:
            levels.append(np.asarray(cv2.resize(last, small, interpolation=cv2.INTER_AREA), dtype=np.float32))
            continue
        weight = np.sin((np.arange(h) + 0.5) * (np.pi / h)).astype(np.float32)[:, None, None]
        total = cv2.resize(last * weight, small, interpolation=cv2.INTER_AREA)
        share = cv2.resize(np.broadcast_to(weight, (h, w, 1)).copy(), small, interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(total / share[:, :, None], dtype=np.float32))
    return levels


@lru_cache(maxsize=1)
def albedo_table() -> FloatArray:
    """How much of the light from all around one reflection on the facets of a rough white metal returns.

    The rest would be reflected between the facets; Turquin's factor (2019) gives it back, so that a white metal in
    white surroundings is white.

    Returns
    -------
    (ALBEDO_STEPS, ALBEDO_STEPS) float64
        By roughness and by cosine of the viewing direction to the normal, both from 0 to 1 in equal steps; the mean
        over ALBEDO_SAMPLES^2 visible facets (Heitz 2018) of G2 / G1.
    """
    grid = (np.arange(ALBEDO_SAMPLES) + 0.5) / ALBEDO_SAMPLES
    first, rest = (axis.ravel() for axis in np.meshgrid(grid, grid))
    # Steeper facets are rarer and hide more: more samples of them, which count less.
    second, weight = 1.0 - rest**2, 2.0 * rest
    table = np.ones((ALBEDO_STEPS, ALBEDO_STEPS))
    steps = np.linspace(0.0, 1.0, ALBEDO_STEPS)
    for i, alpha in enumerate(np.maximum(steps, LEAST_ROUGHNESS)):
        for j, cosine in enumerate(np.maximum(steps, 0.5 / ALBEDO_STEPS)):
            view = np.array([np.sqrt(1.0 - cosine * cosine), 0.0, cosine])
            stretched = view * [alpha, alpha, 1.0]
            stretched /= np.linalg.norm(stretched)
            z = (1.0 - second) * (1.0 + stretched[2]) - stretched[2]
            across, turn = np.sqrt(np.maximum(1.0 - z * z, 0.0)), 2.0 * np.pi * first
            facet = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1) + stretched
            facet *= [alpha, alpha, 1.0]
            facet /= np.linalg.norm(facet, axis=1, keepdims=True)
            out = 2.0 * (facet @ view) * facet[:, 2] - cosine

            def masking(c: AnyArray, alpha: float = float(alpha)) -> FloatArray:
                square = np.maximum(np.asarray(c, dtype=np.float64), 1e-9) ** 2
                return np.asarray(0.5 * (np.sqrt(1.0 + alpha * alpha * (1.0 / square - 1.0)) - 1.0))

            seen = masking(np.array(cosine))
            returned = np.where(out > 0.0, (1.0 + seen) / (1.0 + seen + masking(out)), 0.0)
            table[i, j] = (weight * returned).mean()
    return table
