"""What a render returns: the picture, and the truth behind every pixel of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from msgs_py import PinholeCamera, Pose

from .settings import OPTION_LIMITS

# A hit is one int32: leaf index * FACE_SLOTS + face index; MISS where there is none. No primitive has more faces.
FACE_SLOTS = 8
MISS = -1


@dataclass
class RenderStats:
    """Work done for one frame, counted alike by every engine (thesis 4.13).

    intersections : ray-surface tests (a block costs six, a cylinder three, a cone two, a sphere or half-space one)
    nodes : tree nodes visited, summed over rays; combines : operators applied, summed over rays
    tiles : tiles that were not empty (1 for the whole image when tiling is off)
    dap_cycles : machine cycles of the array machine, 0 for the other engines; seconds : wall time
    """

    intersections: int = 0
    nodes: int = 0
    combines: int = 0
    tiles: int = 0
    dap_cycles: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class RenderOptions:
    """How to render; the keyword arguments of :func:`csg_renderer.render`, checked.

    tiling : split the image into tiles that know their primitives, or test every primitive on every ray
    tile_size : pixels a side, 4..256
    levels : how many surfaces a ray may meet one after another; 1 is ray casting
    antialias : False (or 0); True (or 1) for 3 x 3 weighted samples where neighbouring faces differ (thesis 4.6); an
        integer n >= 2 for the mean of n x n samples in every pixel
    shadows : send a feeler from every visible point to every light
    threads : worker threads, 0 for one a core
    Raises ValueError, naming the argument.
    """

    tiling: bool = True
    tile_size: int = 32
    levels: int = 1
    antialias: int = 0
    shadows: bool = False
    threads: int = 0

    def __post_init__(self) -> None:
        for name, (low, high) in OPTION_LIMITS.items():
            value = getattr(self, name)
            if int(value) != value or not low <= value <= high:
                raise ValueError(f'{name}: expected a whole number in {low}..{high}, got {value}')
            object.__setattr__(self, name, int(value))

    @property
    def box(self) -> int:
        """n of the n x n box mode, or 0."""
        return self.antialias if self.antialias > 1 else 0

    @property
    def adaptive(self) -> bool:
        """3 x 3 weighted samples where faces differ."""
        return self.antialias == 1


@dataclass(eq=False)
class Frame:
    """One rendered image with its ground truth, all arrays row-major (h, w).

    image : (h, w, 3) uint8, RGB, linear (no gamma)
    depth : (h, w) float32, camera z in metres, NaN = background
    primitive_id, face_id, object_id : (h, w) int32, -1 = background. primitive_id indexes Scene.primitives; on a cut
        face it is the leaf of the subtracted primitive. face_id is in the order of thesis Table 4.1
        (csg_renderer.scene.solid.FACES). object_id indexes Scene.solids.
    normal : (h, w, 3) float32, outward unit normal of the resulting solid, scene frame, NaN = background
    camera, camera_T_scene : the view; stats : RenderStats
    Ids, depth and normals belong to the ray through the pixel's centre, whatever the anti-aliasing.
    """

    image: np.ndarray
    depth: np.ndarray
    primitive_id: np.ndarray
    face_id: np.ndarray
    object_id: np.ndarray
    normal: np.ndarray
    camera: PinholeCamera
    camera_T_scene: Pose = field(default_factory=Pose)
    stats: RenderStats = field(default_factory=RenderStats)

    @property
    def mask(self) -> np.ndarray:
        """(h, w) bool: something is seen."""
        return self.primitive_id >= 0

    @cached_property
    def camera_normal(self) -> np.ndarray:
        """(h, w, 3) float32: outward unit normal in the camera's optical frame, NaN = background."""
        return (self.normal @ self.camera_T_scene.rotation.T.astype(np.float32)).astype(np.float32)

    @property
    def points(self) -> np.ndarray:
        """(h, w, 3) float64, metres, camera frame: the visible points, NaN = background."""
        return self.camera.rays(self.camera.pixel_grid()) * self.depth[..., None].astype(np.float64)
