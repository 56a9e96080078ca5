"""Engines by name: the one place that imports an engine.

An engine is imported when it is first asked for: the native one loads numba's compiled code (0.4 s), the one of the
array machine loads the emulator, and most callers need one of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import NamedTuple, Protocol, cast

from msgs_py import LensDistortion, PinholeCamera, Pose

from ..scene.scene import Scene
from .frame import Frame, RenderOptions
from .programs.program import Program
from .stop import Stop

# Name of each engine: its module in this room.
ENGINES = {'native': 'engine_native', 'reference': 'engine_reference', 'dap': 'engine_dap'}
# Options that only some engines have; no option changes a picture from one engine to another.
ONLY = {'early_outs': ('dap',), 'left_heavy': ('dap',)}
# Engines that follow rays of any directions; the array machine's are those of rows and columns.
DISTORTING = ('native', 'reference')
# Engines that leave samples out where they cannot differ, see RenderOptions.every_pixel.
SPARING = ('native',)
# Engines that know Phong's model and lights that are points, and nothing else.
PHONG_ONLY = ('dap',)


class ViewPose(NamedTuple):
    """A camera, camera_T_scene, and the distortion of the lens before it; the camera's matrix is then the raw one's."""

    camera: PinholeCamera
    camera_T_scene: Pose
    lens: LensDistortion | None = None


class Engine(Protocol):
    """What the module of an engine provides."""

    def render_views(
        self, scene: Scene, views: Sequence[ViewPose], options: RenderOptions, stop: Stop | None = None
    ) -> list[Frame]:
        """A frame for each view of the scene; raises RenderStopped when it was ended."""


def refuse_options(name: str, options: RenderOptions, views: Sequence[ViewPose] = ()) -> None:
    """Refuse what an engine cannot do.

    Parameters
    ----------
    name : str
        Of the engine.
    options : RenderOptions
    views : sequence of ViewPose

    Raises
    ------
    ValueError
        It lacks an option that is asked for; the message begins with the option's name.
    """
    for option, engines in ONLY.items():
        if getattr(options, option) and name not in engines:
            raise ValueError(
                f'{option}: the engine {name!r} has no such option, only {", ".join(map(repr, engines))} has'
            )
    if name not in DISTORTING and any(view.lens is not None for view in views):
        raise ValueError(f'lens: the engine {name!r} has none, only {", ".join(map(repr, DISTORTING))} have')


def refuse_surfaces(name: str, program: Program) -> None:
    """Refuse what an engine cannot show.

    Parameters
    ----------
    name : str
        Of the engine.
    program : Program

    Raises
    ------
    ValueError
        The scene has a TEXTURE, METAL, an ENVIRONMENT or a LIGHT with a RADIUS, and the engine shows none of these; the
        message begins with "engine".
    """
    if name in PHONG_ONLY and program.surfaces is not None:
        raise ValueError(
            f'engine: {name!r} shows no TEXTURE, METAL, ENVIRONMENT or RADIUS of a LIGHT, and the scene has one; '
            f'{", ".join(repr(other) for other in ENGINES if other not in PHONG_ONLY)} do'
        )


def spares(options: RenderOptions, program: Program, view: ViewPose) -> bool:
    """Whether an engine that spares takes the n x n samples of a pixel only where they may differ.

    Parameters
    ----------
    options : RenderOptions
    program : Program
    view : ViewPose

    Returns
    -------
    bool
    """
    return options.sparse and view.lens is None and not program.terrains and program.surfaces is None


def engine_named(name: str) -> Engine:
    """The engine of a name in ENGINES.

    Raises
    ------
    ValueError
        For another name, and where the engine's module is not installed.
    """
    if name not in ENGINES:
        raise ValueError(f'engine: expected one of {", ".join(ENGINES)}, got {name!r}')
    module = f'{__package__}.{ENGINES[name]}'
    try:
        return cast(Engine, importlib.import_module(module))
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise ValueError(f'engine: {name!r} is not part of this installation') from None
