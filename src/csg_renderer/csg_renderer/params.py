"""Parameters of renderer_node."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import LensDistortion
from msgs_py.node_runtime.config import Config, parameter
from msgs_py.settings import LENS_COEFFICIENTS

from .raycast.engines import DISTORTING, ENGINES
from .raycast.sensor import SensorModel
from .raycast.settings import BAYER_CHANNELS, DEFAULT_PINHOLES, DEFAULT_SAMPLES, SENSOR_RANGES

# Encodings of images, and how many bits their numbers have.
ENCODINGS = {
    f'{kind}{bits}': bits for bits in (8, 16) for kind in ('mono', 'rgb', *(f'bayer_{name}' for name in BAYER_CHANNELS))
}


def _in_range(name: str, default: float, description: str, unit: str = '') -> float:
    """A parameter with the range that SensorModel has for the field of its name."""
    low, high = SENSOR_RANGES[name]
    value: float = parameter(default, description, unit=unit, minimum=low, maximum=high)
    return value


@dataclass(frozen=True)
class RendererConfig(Config):
    """Parameters of renderer_node. 0 stands for "as the scene says" in sizes and baseline."""

    scene: str = parameter('l_shape_v1', 'Scene file, or the name of a scene of this package')
    rate: float = parameter(
        1.0, 'Stereo pairs a second; 0 renders only when ~/render is called', unit='Hz', minimum=0.0, maximum=1000.0
    )
    width: int = parameter(0, 'Image width; 0: as the scene says, else 512', unit='px', minimum=0, maximum=16384)
    height: int = parameter(
        0, "Image height; 0: in the proportion of the scene's camera", unit='px', minimum=0, maximum=16384
    )
    focal: float = parameter(
        0.0, 'Focal length; 0: as the scene says, else 703 px at 512 px width', unit='px', minimum=0.0, maximum=1e6
    )
    baseline: float = parameter(
        0.0,
        'Distance of the two cameras; 0: as the scene says, else its distance / 5',
        unit='m',
        minimum=0.0,
        maximum=1e3,
    )
    encoding: str = parameter('mono8', 'Encoding of the images', choices=tuple(ENCODINGS))
    bits: int = parameter(
        0,
        'Bits of a number in the images, 8 to 16; 0: all that the encoding has. Fewer than 16 are the lower ones',
        minimum=0,
        maximum=16,
    )
    distortion_model: str = parameter(
        '',
        'Distortion of the lenses on image_raw, as camera_info names it; empty: none',
        choices=('', *LENS_COEFFICIENTS),
    )
    distortion: tuple[float, ...] = parameter(
        (), 'Its coefficients, in the order of camera_info: 5, 8 or 4', element=float
    )
    right_distortion: tuple[float, ...] = parameter(
        (), 'Those of the right lens; empty: as the left one', element=float
    )
    psf: float = parameter(0.0, 'Standard deviation of the lens blur', unit='px', minimum=0.0, maximum=20.0)
    noise: float = parameter(
        0.0, 'Standard deviation of the sensor noise', unit='grey levels', minimum=0.0, maximum=100.0
    )
    seed: int = parameter(0, 'Seed of the noise', minimum=0, maximum=2**31 - 1)
    vignetting: float = _in_range('vignetting', 0.0, 'Share of the light that is lost in the corners (cos^4)')
    exposure: float = _in_range('exposure', 1.0, 'What the light is multiplied by before it is counted')
    full_well: float = parameter(
        0.0,
        'Electrons that make white at gain 1, for shot noise; 0: so many that there is none',
        unit='electrons',
        minimum=0.0,
        maximum=1e9,
    )
    read_noise: float = parameter(
        0.0,
        'Standard deviation of what reading a pixel adds, before the gain; needs full_well',
        unit='electrons',
        minimum=0.0,
        maximum=1e6,
    )
    gain: float = _in_range('gain', 1.0, 'Amplification of the electrons')
    black_level: float = _in_range('black_level', 0.0, 'What is added to every pixel', 'grey levels')
    gamma: float = _in_range('gamma', 1.0, 'Numbers are the light to the power of 1 / gamma; 1: linear')
    srgb: bool = parameter(False, 'Numbers are those of sRGB')
    antialias: int = parameter(
        4, '0: one ray a pixel; 1: 3 x 3 rays where faces meet; n: n x n rays', minimum=0, maximum=16
    )
    levels: int = parameter(1, 'Surfaces a ray may meet one after another; 1 is ray casting', minimum=1, maximum=64)
    shadows: bool = parameter(False, 'Cast shadows')
    samples: int = parameter(
        DEFAULT_SAMPLES,
        'Directions of light that a visible place samples, where the scene has lights with a radius, metal or an '
        'environment',
        minimum=1,
        maximum=1024,
    )
    aperture: float = parameter(
        0.0, 'Diameter of the lenses; 0: pinholes, before which all is sharp', unit='m', minimum=0.0, maximum=10.0
    )
    focus: float = parameter(0.0, 'Depth that is sharp; needed with an aperture', unit='m', minimum=0.0, maximum=1e6)
    motion: tuple[float, ...] = parameter(
        (),
        'How the scene moves while it is exposed, as the left camera sees it: x, y, z (m), and a rotation vector (deg)',
        element=float,
    )
    pinholes: int = parameter(
        DEFAULT_PINHOLES,
        'Points of the lens and moments of the exposure that are averaged for these, in place of antialias',
        minimum=1,
        maximum=4096,
    )
    tiling: bool = parameter(True, 'Split the image into tiles that know their primitives')
    engine: str = parameter('native', 'Which engine renders', choices=tuple(ENGINES))
    turntable: float = parameter(
        0.0,
        'Turn of the scene about the vertical through its first object, each frame',
        unit='deg',
        minimum=-180.0,
        maximum=180.0,
    )
    frame_id: str = parameter('camera_left_optical_frame', 'Frame of all messages')
    scene_folders: tuple[str, ...] = parameter(
        (),
        'Folders that scenes may be read from when the scene is changed at run time, besides that of the scene '
        'given at the start and that of this package',
        read_only=True,
    )
    time_limit: float = parameter(
        60.0,
        'Longest time for one pair; a rendering that takes longer is stopped',
        unit='s',
        minimum=0.001,
        maximum=3600.0,
    )
    watch: bool = parameter(True, 'Read the scene again when one of its files changes')

    def validate(self) -> None:
        """Refuse bits that the encoding has not, and what no sensor and no lens can be. See Config."""
        if self.bits and (self.bits > 8) != (ENCODINGS[self.encoding] == 16):
            raise ValueError(
                f'parameter bits: {self.bits} do not go with encoding {self.encoding}, expected '
                + ('9 to 16, or 0' if ENCODINGS[self.encoding] == 16 else '8 or 0')
            )
        if self.distortion_model and self.engine not in DISTORTING:
            raise ValueError(
                f'parameter distortion_model: the engine {self.engine!r} has no lenses, expected none, or one of '
                f'{", ".join(map(repr, DISTORTING))}'
            )
        try:
            self.lenses()
        except ValueError as error:
            raise ValueError(f'parameter distortion: {error}') from None
        if len(self.motion) not in (0, 6) or not np.isfinite(self.motion).all():
            raise ValueError(f'parameter motion: expected 6 numbers or none, got {len(self.motion)}')
        if self.aperture and not self.focus:
            raise ValueError('parameter focus: expected the depth that is sharp, > 0, with an aperture')
        try:
            self.sensor(0, 0)
        except ValueError as error:
            raise ValueError(f'parameter {error}') from None

    def lenses(self) -> tuple[LensDistortion, LensDistortion] | None:
        """Of the left and the right camera; None where they do not distort."""
        if not self.distortion_model:
            return None
        right = self.right_distortion or self.distortion
        return LensDistortion(self.distortion_model, self.distortion), LensDistortion(self.distortion_model, right)

    def sensor(self, pair_index: int, side: int) -> SensorModel:
        """The sensor of a camera, with noise of its own in every pair.

        Parameters
        ----------
        pair_index : int
            Number of the pair.
        side : int
            0 for the left camera, 1 for the right one.
        """
        return SensorModel(
            self.psf,
            self.noise,
            (self.seed, pair_index, side),
            self.vignetting,
            self.exposure,
            self.full_well,
            self.read_noise,
            self.gain,
            self.black_level,
            self.gamma,
            self.srgb,
            self.bits or ENCODINGS[self.encoding],
            self.encoding.removeprefix('bayer_')[:4] if self.encoding.startswith('bayer_') else '',
        )
