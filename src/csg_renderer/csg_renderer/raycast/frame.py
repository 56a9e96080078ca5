"""What a render returns: the picture, and the truth behind every pixel of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from msgs_py import LensDistortion, PinholeCamera, Pose

from .settings import DEFAULT_PINHOLES, DEFAULT_SAMPLES, OPTION_LIMITS

# A hit is one int32: leaf index * FACE_SLOTS + face index; MISS where there is none. No primitive has more faces.
FACE_SLOTS = 8
MISS = -1


@dataclass
class RenderStats:
    """Work done for one frame, counted alike by every engine (thesis 4.13).

    Attributes
    ----------
    intersections : int
        Ray-surface tests: a block costs six, a cylinder three, a cone two, a sphere or half-space one.
    nodes, combines : int
        Tree nodes visited, and operators applied, summed over rays.
    tiles : int
        Tiles that were not empty; 1 for the whole image when tiling is off.
    dap_cycles, dap_planes : int
        Machine cycles of the array machine, and the most bit-planes of its store in use; 0 for the other engines.
    seconds : float
        Wall time.
    """

    intersections: int = 0
    nodes: int = 0
    combines: int = 0
    tiles: int = 0
    dap_cycles: int = 0
    dap_planes: int = 0
    seconds: float = 0.0

    def add(self, other: RenderStats) -> None:
        """Count the rays and tiles of another picture too."""
        self.intersections += other.intersections
        self.nodes += other.nodes
        self.combines += other.combines
        self.tiles += other.tiles


@dataclass(frozen=True)
class RenderOptions:
    """How to render; the keyword arguments of :func:`csg_renderer.render`, checked.

    Parameters
    ----------
    tiling : bool
        Split the image into tiles that know their primitives, or test every primitive on every ray.
    tile_size : int
        Pixels a side, 4..256.
    levels : int
        How many surfaces a ray may meet one after another, 1..64; 1 is ray casting.
    antialias : int
        0 (or False): one ray a pixel. 1 (or True): 3 x 3 weighted samples where neighbouring faces differ (thesis 4.6).
        n >= 2: the mean of n x n samples in a pixel, up to 16.
    every_pixel : bool
        antialias >= 2: take all samples in pixels, too, where they cannot differ by more than half a grey level. The
        native engine leaves those to the ray of the centre, without shadows, further levels, surfaces, terrains, lenses
        and radiance; the other engines never do.
    shadows : bool
        Send a feeler from every visible point to every light.
    threads : int
        Worker threads, 0..64; 0 for one a core.
    early_outs : bool
        engine='dap': leave out the right operand of an INTERSECT or DIFFERENCE when no ray of the tile is in the left
        one (thesis 4.8). The other engines have an order of work of their own.
    left_heavy : bool
        engine='dap': evaluate the operand first that needs the deeper stack (thesis 4.8), to save store.
    radiance : bool
        Keep what the image rounds to bytes, for sensors of more than 8 bits.
    samples : int
        Directions of light that each place of the first surface on a ray samples, 1..1024: of a light with a radius, of
        the environment, and of what a rough metal mirrors. Scenes without these need none.
    aperture : float
        Diameter of the lens, metres; 0 is a pinhole, before which everything is sharp.
    focus : float
        Depth at which everything is sharp, metres; needed with an aperture.
    motion : sequence of Pose
        camera_T_scene (of a stereo pair the left one's) from the beginning of the exposure to its end, in equal steps
        of time with screws between them, two or more; () where nothing moves. Depth, ids and normals are those of the
        camera's own pose.
    pinholes : int
        How many points of the lens and moments of the exposure are averaged, 1..4096, in place of ``antialias``.
    psf : float
        Standard deviation of the Gaussian by which the lens spreads light before pixels count it, pixels. The picture
        is rendered finer first, by n pixels along each side of a pixel, where n psf is 2 or n is 8, each of them as
        ``antialias`` says; where all pixels take all samples, they share those out.

    Raises
    ------
    ValueError
        An option is out of its range; the message begins with its name.

    Examples
    --------
    >>> RenderOptions(antialias=True).adaptive, RenderOptions(antialias=3).box
    (True, 3)
    """

    tiling: bool = True
    tile_size: int = 32
    levels: int = 1
    antialias: int = 0
    shadows: bool = False
    threads: int = 0
    early_outs: bool = False
    left_heavy: bool = False
    radiance: bool = False
    samples: int = DEFAULT_SAMPLES
    aperture: float = 0.0
    focus: float = 0.0
    motion: tuple[Pose, ...] = ()
    pinholes: int = DEFAULT_PINHOLES
    every_pixel: bool = False
    psf: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in OPTION_LIMITS.items():
            value = getattr(self, name)
            if int(value) != value or not low <= value <= high:
                raise ValueError(f'{name}: expected a whole number in {low}..{high}, got {value}')
            object.__setattr__(self, name, int(value))
        for name in ('aperture', 'focus', 'psf'):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f'{name}: expected a length >= 0, got {getattr(self, name):g}')
        if self.aperture and not self.focus:
            raise ValueError('focus: expected the depth that is sharp, > 0, with an aperture')
        object.__setattr__(self, 'motion', tuple(self.motion))
        if len(self.motion) == 1 or not all(isinstance(pose, Pose) for pose in self.motion):
            raise ValueError('motion: expected two poses or more')

    @property
    def averaged(self) -> bool:
        """Whether a picture is the mean of those of pinholes."""
        return self.aperture > 0.0 or len(self.motion) > 0

    @property
    def box(self) -> int:
        """Samples along a side of each pixel in the n x n mode, or 0."""
        return self.antialias if self.antialias > 1 else 0

    @property
    def sparse(self) -> bool:
        """Whether the n x n samples may be left to the pixels in which they differ."""
        plain = self.tiling and self.levels == 1 and not self.shadows and not self.radiance
        return self.box > 0 and plain and not self.every_pixel

    @property
    def adaptive(self) -> bool:
        """Whether 3 x 3 weighted samples are taken where faces differ."""
        return self.antialias == 1


@dataclass(eq=False)
class Frame:
    """One rendered image with its ground truth, all arrays row-major (h, w).

    Ids, depth and normals belong to the ray through the pixel's centre, whatever the anti-aliasing.

    Attributes
    ----------
    image : (h, w, 3) uint8
        RGB, linear (no gamma).
    depth : (h, w) float32
        Camera z in metres, NaN for background.
    primitive_id : (h, w) int32
        Index into Scene.primitives, -1 for background; on a cut face it is the leaf of the subtracted primitive.
    face_id : (h, w) int32
        In the order of thesis Table 4.1 (csg_renderer.scene.solid.FACES), -1 for background.
    object_id : (h, w) int32
        Index into Scene.solids, -1 for background.
    normal : (h, w, 3) float32
        Outward unit normal of the resulting solid, scene frame, NaN for background.
    camera : PinholeCamera
    camera_T_scene : Pose
    stats : RenderStats
    radiance : (h, w, 3) float32, optional
        Linear RGB, 0..1: what the image rounds to bytes. None where nobody asked for it.
    psf : float
        Pixels, the lens' blur that is in the image.
    lens : LensDistortion, optional
        Of a raw picture: pixels, and the truth behind them, are those of the raw camera, whose matrix ``camera`` has.
        Pixels that no light reaches are black, and their truth is that of background.
    """

    image: np.ndarray = field(repr=False)
    depth: np.ndarray = field(repr=False)
    primitive_id: np.ndarray = field(repr=False)
    face_id: np.ndarray = field(repr=False)
    object_id: np.ndarray = field(repr=False)
    normal: np.ndarray = field(repr=False)
    camera: PinholeCamera
    camera_T_scene: Pose = field(default_factory=Pose)
    stats: RenderStats = field(default_factory=RenderStats)
    radiance: np.ndarray | None = field(default=None, repr=False)
    lens: LensDistortion | None = None
    psf: float = 0.0

    @property
    def mask(self) -> np.ndarray:
        """Where something is seen, (h, w) bool."""
        return self.primitive_id >= 0

    @cached_property
    def camera_normal(self) -> np.ndarray:
        """Outward unit normals in the camera's optical frame, (h, w, 3) float32, NaN for background."""
        return (self.normal @ self.camera_T_scene.rotation.T.astype(np.float32)).astype(np.float32)

    @property
    def points(self) -> np.ndarray:
        """The visible points, (h, w, 3) float64, metres, camera frame, NaN for background."""
        pixels = self.camera.pixel_grid()
        rays = self.camera.rays(pixels) if self.lens is None else self.lens.rays(self.camera, pixels)
        return rays * self.depth[..., None].astype(np.float64)
