"""The cameras of a plan: where they stand, what they see with, and what they would be with other lenses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from csg_renderer.raycast.sensor import SensorModel
from msgs_py import CameraRig, PinholeCamera, Pose, StereoRig
from msgs_py.files import read_json
from msgs_py.numeric.typed import FloatArray

from ...geometry.settings import UNIFORM_VARIANCE
from ...image_pose.settings import WALKS


@dataclass(frozen=True)
class Sensor:
    """What a camera does to a perfect picture.

    Parameters
    ----------
    noise : float
        Grey levels of 255, standard deviation in every pixel, whatever its light.
    psf : float
        Pixels, standard deviation of the blur of lens and focus.
    gain : float
        Grey levels an electron: shot noise has the variance gain times level, besides.

    Raises
    ------
    ValueError
        A field is out of its range; the message begins with its name.
    """

    noise: float = 2.0
    psf: float = 0.5
    gain: float = 0.0

    def __post_init__(self) -> None:
        for name, most in (('noise', 100.0), ('psf', 20.0), ('gain', 100.0)):
            if not 0.0 <= getattr(self, name) <= most:
                raise ValueError(f'{name}: expected a number in 0..{most:g}, got {getattr(self, name)}')

    def pixel_noise(self, level: FloatArray | float) -> FloatArray:
        """Standard deviation of pixels of so many grey levels: with rounding to whole ones.

        Examples
        --------
        >>> Sensor(noise=3.0, gain=0.16).pixel_noise(np.array([0.0, 100.0])).round(1).tolist()
        [3.0, 5.0]
        """
        return np.asarray(np.sqrt(self.noise**2 + self.gain * np.maximum(level, 0.0) + UNIFORM_VARIANCE))

    def model(self, seed: Sequence[int]) -> SensorModel:
        """Its chip, for pictures that the lens has blurred."""
        well = 255.0 / self.gain if self.gain > 0.0 else 0.0
        return SensorModel(noise_sigma=self.noise, seed=seed, full_well=well)

    def with_noise(self, factor: float) -> Sensor:
        """The same with so many times the noise."""
        return Sensor(factor * self.noise, self.psf, factor**2 * self.gain)


def read_sensor(path: Path) -> Sensor:
    """Noise and blur as ``measure_camera`` writes them: a JSON file with ``noise`` (grey levels) and ``psf`` (pixels).

    With ``gain`` and ``read_noise`` in it, noise depends on the light.

    Raises
    ------
    OSError
        There is no such file.
    ValueError
        It does not say both; the message begins with its name.
    """
    try:
        record = read_json(path)
    except ValueError as error:
        raise ValueError(f'{path}: expected a JSON file with noise and psf: {error}') from None
    if not isinstance(record, Mapping):
        raise ValueError(f'{path}: expected an object with noise and psf, got {type(record).__name__}')
    lit = record.get('gain') is not None and record.get('read_noise') is not None
    names = {'noise': 'read_noise' if lit else 'noise', 'psf': 'psf', **({'gain': 'gain'} if lit else {})}
    values: dict[str, Any] = {}
    for field, name in names.items():
        value = record.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f'{path}: {name}: expected a number, got {value!r}')
        values[field] = float(value)
    try:
        return Sensor(**values)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


@dataclass(frozen=True, eq=False)
class PlannedRig:
    """Cameras and their sensor.

    Parameters
    ----------
    pair : StereoRig
        Metres.
    third : (3,) float64, optional
        Where a third camera stands, with the axes and the lens of the left one; metres, left optical frame.
    sensor : Sensor
    outline_px : float
        Pixels, standard deviation of what a visible line of the part is off besides noise, in all images and again in
        each: tolerances and rounded edges of parts, what is left of a lens' distortion.
    calibration_px : float
        Pixels, standard deviation of what the whole image of a camera is off against the first one's: along the rows,
        across them, by a turn and by a larger scale (at its border). What calibration leaves, and drift adds;
        ``check_rig`` shows it across the rows.
    walk : float
        Grey levels for a root of a pixel, by which levels wander beside an edge: print, grain, uneven light. Plain
        rendered faces have next to none, pictures of cameras 1 to 8.
    """

    pair: StereoRig
    third: FloatArray | None = None
    sensor: Sensor = Sensor()
    outline_px: float = 0.0
    calibration_px: float = 0.0
    walk: float = WALKS[0]

    @property
    def cameras(self) -> CameraRig:
        """All of them, the left one first."""
        two = CameraRig.from_stereo(self.pair)
        if self.third is None:
            return two
        return CameraRig((*two.cameras, self.pair.left), (*two.poses, Pose(translation=self.third)))

    @property
    def middle(self) -> FloatArray:
        """Between the two, (3,) float64, metres, left optical frame."""
        return np.array([0.5 * self.pair.baseline, 0.0, 0.0])

    def with_baseline(self, factor: float) -> PlannedRig:
        """The same with the cameras so many times as far apart; a third one with them."""
        pair = StereoRig(self.pair.left, self.pair.right, factor * self.pair.baseline)
        return replace(self, pair=pair, third=None if self.third is None else factor * self.third)

    def with_focal(self, factor: float) -> PlannedRig:
        """The same with lenses of so many times the focal length, on the same chips."""
        left, right = (
            PinholeCamera(one.width, one.height, factor * one.fx, factor * one.fy, one.cx, one.cy)
            for one in (self.pair.left, self.pair.right)
        )
        return replace(self, pair=StereoRig(left, right, self.pair.baseline))

    def with_third(self) -> PlannedRig:
        """The same with a third camera: a baseline below the middle of the pair."""
        return replace(self, third=np.array([0.5, 1.0, 0.0]) * self.pair.baseline)


def rig_of_numbers(size: tuple[int, int], focal_px: float, baseline: float) -> StereoRig:
    """A rectified pair whose optical axes go through the middles of the images.

    Parameters
    ----------
    size : (width, height)
        Pixels.
    focal_px : float
        Focal length, pixels.
    baseline : float
        Metres.
    """
    return StereoRig.symmetric(PinholeCamera.centred(size[0], size[1], focal_px), baseline)
