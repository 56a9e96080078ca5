"""Pictures on surfaces and around a scene: what a TEXTURE or an ENVIRONMENT says, and the files they come from."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from msgs_py.files import check_image
from msgs_py.numeric.typed import Float32Array

from .settings import MAX_TEXELS

# What each mapping wants to know, by the number of its sizes.
MAPPINGS: dict[str, dict[int, str]] = {
    'planar': {2: "the picture's width and height"},
    'box': {2: "the picture's width and height on each side", 3: 'the sizes of the box, a picture for each side'},
    'cylindrical': {1: "the picture's height"},
}
TEXTURE_SUFFIXES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm')
ENVIRONMENT_SUFFIXES = (*TEXTURE_SUFFIXES, '.hdr')
# Columns and rows of the pictures in the file of a box with a picture for each side.
ATLAS = (3, 2)
# Where the header of a Radiance picture says its size, and how much of the file is searched for it.
_RADIANCE_SIZE = re.compile(rb'\n-Y (\d+) \+X (\d+)\n')
_RADIANCE_HEADER = 4096


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture laid on surfaces, which multiplies their colour.

    It lies in the frame in which the solid stands when the texture is put on (:meth:`Solid.textured`), and moves with
    the solid afterwards. Looked at from outside with that frame's z up, pictures are the right way round.

    Parameters
    ----------
    image : (h, w), (h, w, 3) array_like of uint8, or of floats in 0..1
        Grey or RGB, linear as all colours here: 255 is a colour of 1.
    mapping : str
        'planar': along z, x to the right and y up; repeated. 'box': on each face along the axis that its normal is
        nearest to; repeated for two sizes. For three sizes the image holds six pictures, one for each side of a box
        with one corner at the origin: +x, +y, +z above -x, -y, -z. 'cylindrical': once around z, from x over y, and
        repeated along z; faces that look along z are left as they are.
    size : tuple of floats
        Metres: planar (width, height); box (width, height) or the signed sizes (x, y, z) of a box; cylindrical
        (height,).
    file : str
        Path of the image as a scene file names it, for scenes that are written as text.

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.

    Examples
    --------
    >>> Texture(np.array([[0, 255], [255, 0]], dtype=np.uint8), 'planar', (0.1, 0.1)).image.shape
    (2, 2, 3)
    """

    image: np.ndarray
    mapping: str
    size: tuple[float, ...]
    file: str = ''

    def __post_init__(self) -> None:
        object.__setattr__(self, 'image', _checked_image(self.image))
        if self.mapping not in MAPPINGS:
            raise ValueError(f'mapping: expected one of {", ".join(MAPPINGS)}, got {self.mapping!r}')
        counts = MAPPINGS[self.mapping]
        size = tuple(float(x) for x in self.size)
        if len(size) not in counts:
            wanted = ' or '.join(f'{n} ({meaning})' for n, meaning in counts.items())
            raise ValueError(f'size: a {self.mapping} texture takes {wanted}, got {len(size)} numbers')
        signed = len(size) == 3
        if not all(np.isfinite(x) and (x > 0.0 or (signed and x < 0.0)) for x in size):
            raise ValueError(f'size: expected lengths {"other than 0" if signed else "> 0"}, got {size}')
        object.__setattr__(self, 'size', size)
        if signed and (self.image.shape[1] < ATLAS[0] or self.image.shape[0] < ATLAS[1]):
            raise ValueError(
                f'image: expected 3 x 2 pictures, got {self.image.shape[1]} x {self.image.shape[0]} pixels'
            )

    @classmethod
    def load(cls, path: str | Path, mapping: str, size: tuple[float, ...]) -> Texture:
        """A texture from a file.

        Parameters
        ----------
        path : str or Path
            A .png, .jpg, .bmp, .tif, .pgm or .ppm picture.
        mapping, size
            As in the constructor.

        Returns
        -------
        Texture

        Raises
        ------
        FileNotFoundError
            There is no such file.
        ValueError
            It holds no picture, or one that is too large; the message begins with its name.
        """
        return cls(read_picture(path), mapping, size)


@dataclass(frozen=True, eq=False)
class Laid:
    """A texture on one leaf.

    Attributes
    ----------
    texture : Texture
    frame : (4, 4) float64
        The texture's frame from the leaf's own frame (``own_frame``), metres.
    """

    texture: Texture
    frame: np.ndarray


@dataclass(frozen=True, eq=False)
class Environment:
    """What surrounds a scene, infinitely far: it lights matt surfaces, and is seen in metal, in mirrors and behind all.

    It takes the place of the ambient light and of the background.

    Parameters
    ----------
    image : (h, w), (h, w, 3) array_like of uint8, or of floats >= 0
        Equirectangular: the columns go once around the vertical, to the right, and the rows from straight up to
        straight down. In its middle is what a camera sees that looks along z with ``up`` upwards (along x, where up is
        z). 255 is a light of 1; floats may be larger.
    brightness : float
        Factor of it all, > 0.
    up : (3,) array_like of float64
        Scene frame; of any length but zero.
    file : str
        As in :class:`Texture`.

    Raises
    ------
    ValueError
        An argument is out of its range; the message begins with its name.
    """

    image: np.ndarray
    brightness: float = 1.0
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)
    file: str = field(default='', kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'image', _checked_image(self.image, np.inf))
        if not 0.0 < self.brightness < np.inf:
            raise ValueError(f'brightness: expected a number > 0, got {self.brightness:g}')
        up = np.asarray(self.up, dtype=np.float64)
        if up.shape != (3,) or not np.isfinite(up).all() or not np.linalg.norm(up) > 0.0:
            raise ValueError(f'up: expected three numbers, not all zero, got {self.up}')
        object.__setattr__(self, 'up', tuple(float(x) for x in up))

    @classmethod
    def load(
        cls, path: str | Path, brightness: float = 1.0, up: tuple[float, float, float] = (0.0, -1.0, 0.0)
    ) -> Environment:
        """An environment from a file.

        Parameters
        ----------
        path : str or Path
            A picture as of :meth:`Texture.load`, or a Radiance .hdr.
        brightness, up
            As in the constructor.

        Returns
        -------
        Environment

        Raises
        ------
        FileNotFoundError, ValueError
            As :meth:`Texture.load`.
        """
        return cls(read_picture(path, ENVIRONMENT_SUFFIXES), brightness, up)

    @property
    def axes(self) -> np.ndarray:
        """Rows: the directions (unit, scene frame) of the image's middle, of its right and of its top, (3, 3)."""
        up = np.asarray(self.up) / np.linalg.norm(self.up)
        ahead = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        ahead = ahead - up * (up @ ahead)
        ahead /= np.linalg.norm(ahead)
        return np.stack([ahead, np.cross(ahead, up), up])


def read_picture(path: str | Path, suffixes: tuple[str, ...] = TEXTURE_SUFFIXES) -> Float32Array:
    """Read a picture whose size is known before it is unpacked.

    Parameters
    ----------
    path : str or Path
    suffixes : tuple of str
        Of the formats that are read.

    Returns
    -------
    (h, w, 3) float32
        RGB; the largest number of the file's integers is 1.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        It holds no picture, or one that is too large; the message begins with its name.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise ValueError(f'{path}: expected a picture ({", ".join(suffixes)})')
    check_image(path)
    if path.suffix.lower() == '.hdr':
        _check_radiance(path)
    try:
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise ValueError(f'{path}: not a whole picture')
    if pixels.shape[0] * pixels.shape[1] > MAX_TEXELS:
        raise ValueError(f'{path}: {pixels.shape[1]} x {pixels.shape[0]} pixels, at most {MAX_TEXELS} are read')
    scale = {'uint8': 1.0 / 255.0, 'uint16': 1.0 / 65535.0}.get(pixels.dtype.name, 1.0)
    colours = pixels[:, :, None] if pixels.ndim == 2 else pixels[:, :, 2::-1]
    if not np.isfinite(colours).all() or colours.min() < 0:
        raise ValueError(f'{path}: it has values that are no light')
    return np.ascontiguousarray(np.broadcast_to(colours * np.float32(scale), (*colours.shape[:2], 3)), np.float32)


def _check_radiance(path: Path) -> None:
    with path.open('rb') as file:
        size = _RADIANCE_SIZE.search(file.read(_RADIANCE_HEADER))
    if size is None:
        raise ValueError(f'{path}: not a Radiance picture with rows from top to bottom')
    rows, columns = int(size[1]), int(size[2])
    if rows * columns > MAX_TEXELS:
        raise ValueError(f'{path}: {columns} x {rows} pixels, at most {MAX_TEXELS} are read')


def _checked_image(image: ArrayLike, most: float = 1.0) -> Float32Array:
    """(h, w, 3) float32, not to be written to; a float32 picture that was checked before is kept."""
    pixels = np.asarray(image)
    if pixels.dtype == np.float32 and not pixels.flags.writeable and pixels.ndim == 3:
        return pixels
    if pixels.dtype == np.uint8:
        pixels = pixels * np.float32(1.0 / 255.0)
    if pixels.ndim == 2:
        pixels = pixels[:, :, None]
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3) or min(pixels.shape) < 1 or pixels.dtype.kind not in 'fiub':
        raise ValueError(f'image: expected (h, w) or (h, w, 3) grey values or colours, got shape {pixels.shape}')
    if not ((pixels >= 0.0) & (pixels <= most) & np.isfinite(pixels)).all():
        raise ValueError(f'image: expected uint8, or numbers {"in 0..1" if most == 1.0 else ">= 0"}')
    if pixels.shape[0] * pixels.shape[1] > MAX_TEXELS:
        raise ValueError(f'image: {pixels.shape[1]} x {pixels.shape[0]} pixels, at most {MAX_TEXELS} are taken')
    whole = np.array(np.broadcast_to(pixels, (*pixels.shape[:2], 3)), dtype=np.float32)
    whole.flags.writeable = False
    return whole
