"""Engines by name: the one place that imports an engine.

An engine is imported when it is first asked for: the native one loads numba's compiled code (0.4 s), the one of the
array machine loads the emulator, and most callers need one of them.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Protocol, cast

from msgs_py import PinholeCamera, Pose

from ..scene.scene import Scene
from .frame import Frame, RenderOptions
from .stop import Stop

# Name of each engine: its module in this room.
ENGINES = {'native': 'engine_native', 'reference': 'engine_reference', 'dap': 'engine_dap'}
# Options that only some engines have; no option changes a picture from one engine to another.
ONLY = {'early_outs': ('dap',), 'left_heavy': ('dap',)}
# A camera, and camera_T_scene.
ViewPose = tuple[PinholeCamera, Pose]


class Engine(Protocol):
    """What the module of an engine provides."""

    def render_views(
        self, scene: Scene, views: Sequence[ViewPose], options: RenderOptions, stop: Stop | None = None
    ) -> list[Frame]:
        """A frame for each view of the scene; raises RenderStopped when it was ended."""


def refuse_options(name: str, options: RenderOptions) -> None:
    """Refuse what an engine cannot do.

    Parameters
    ----------
    name : str
        Of the engine.
    options : RenderOptions

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
