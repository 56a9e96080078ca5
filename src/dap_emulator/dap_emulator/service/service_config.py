"""Parameters of emulator_node."""

from __future__ import annotations

from dataclasses import dataclass

from msgs_py.node_runtime.config import Config, parameter

from ..machine.machine import MODELS
from .settings import CLIENTS, PROGRAM_BYTES, RUN_SECONDS, STORE_BYTES, TOTAL_BYTES


@dataclass(frozen=True)
class EmulatorConfig(Config):
    """Parameters of emulator_node; each field's description is what a user reads."""

    max_program_bytes: int = parameter(
        PROGRAM_BYTES, 'Largest program text accepted', unit='bytes', minimum=100, maximum=10_000_000
    )
    max_store_bytes: int = parameter(
        STORE_BYTES,
        'Most data one client may store, names included, and largest result of a run',
        unit='bytes',
        minimum=1000,
        maximum=1_000_000_000,
    )
    max_total_bytes: int = parameter(
        TOTAL_BYTES,
        'Most that all clients together hold: stored, waiting and as results',
        unit='bytes',
        minimum=1000,
        maximum=100_000_000_000,
    )
    max_run_seconds: float = parameter(
        RUN_SECONDS, 'A run, or compiling a program, is stopped after this time', unit='s', minimum=0.05, maximum=3600.0
    )
    max_clients: int = parameter(
        CLIENTS, 'Workspaces kept; the one idle for longest makes room', minimum=1, maximum=1000
    )
    image_program: str = parameter('', 'Library program or file that turns image_in into image_out; empty: none')
    program_folders: tuple[str, ...] = parameter(
        (),
        'Folders that image_program may be read from when it is changed at run time, besides that of the program '
        'given at the start',
        read_only=True,
    )
    image_entry: str = parameter('', 'Its entry; empty: the only one')
    image_model: str = parameter('510', 'Machine that images are processed on', choices=tuple(MODELS))
