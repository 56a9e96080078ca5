"""What a closed-form test is: the case and the limits of a pass. Plain values."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

# Stages of one run, in order; a progress callback is called with each name when that stage is over. A run through the
# libraries has no nodes and does not ask the emulator.
STAGES = ('scene', 'nodes', 'image', 'features', 'pose', 'emulator', 'comparison')


@dataclass(frozen=True)
class Limits:
    """The largest errors of a pose that counts as recognised.

    Attributes
    ----------
    rotation_deg : float
        Angle between the found and the true rotation, degrees.
    translation_m : float
        Distance between the found and the true origin of the model, metres.
    """

    rotation_deg: float = 0.5
    translation_m: float = 0.001


@dataclass(frozen=True)
class Case:
    """One closed-form test.

    Attributes
    ----------
    scene : str
        Path of a scene file, or the name of one in csg_renderer's models.
    width, height, focal : optional
        Image size and focal length, pixels; None: what the scene says, or 512 x 512 and 703.
    baseline : float, optional
        Distance of the cameras, metres; None: what the scene says, or a fifth of the object's distance.
    antialias : int
        Samples along each side of a pixel.
    psf, noise : float
        Blur of the sensor (pixels) and its noise (grey levels), standard deviations.
    seed : int
        Of noise, clutter and random poses.
    pose : tuple of 16 floats, optional
        left_T_model of the first object, its 4 x 4 matrix row by row, metres; None: where the scene draws it.
    clutter : int
        Number of further solids beside or behind the object.
    time_limit_s : float
        Of the search, seconds.
    camera : tuple of str
        What else its camera does to a picture: parameters of renderer_node, NAME=VALUE each (:mod:`.camera_options`).
    label : str, optional
        Name of the case; None: that of the scene. Folders are named by it.

    Raises
    ------
    ValueError
        The label is no name of a folder.

    Examples
    --------
    >>> Case('scenes/bracket.csg').name
    'bracket'
    """

    scene: str
    width: int | None = None
    height: int | None = None
    focal: float | None = None
    baseline: float | None = None
    antialias: int = 4
    psf: float = 0.5
    noise: float = 2.0
    seed: int = 0
    pose: tuple[float, ...] | None = None
    clutter: int = 0
    time_limit_s: float = 2.0
    label: str | None = None
    camera: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.label is not None and not is_plain_name(self.label):
            raise ValueError(f'label: expected the name of a folder, got {self.label!r}')

    @property
    def name(self) -> str:
        """Its label, or the name of its scene's file."""
        return self.label or Path(self.scene).stem


def is_plain_name(name: object) -> bool:
    """Whether something names a file or folder in a folder, and leads nowhere else.

    Examples
    --------
    >>> [is_plain_name(name) for name in ('l_shape, 3', '..', '../x', 'a/b', '/etc', '', 3)]
    [True, False, False, False, False, False, False]
    """
    if not isinstance(name, str) or not name.strip() or len(name.encode()) > os.pathconf('/', 'PC_NAME_MAX'):
        return False
    return name not in ('.', '..') and not any(mark in name for mark in ('/', '\\', '\0'))
