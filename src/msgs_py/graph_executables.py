"""The executables of the nodes, and what must be set before numpy is imported, which every package of the graph does.

OpenBLAS starts a thread for each core when it is loaded, and each spins for a while: a fifth of a node's start, taken
from the nodes that start beside it. No node multiplies matrices so large that more than one thread would help.
"""

from __future__ import annotations

import os
from importlib import import_module


def start(module: str) -> int:
    """Run a node's module; ``OPENBLAS_NUM_THREADS`` of the user's own is left alone."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    code: int = import_module(module).main()
    return code


def emulator_node() -> int:
    """Run emulator_node."""
    return start('dap_emulator.node')


def renderer_node() -> int:
    """Run renderer_node."""
    return start('csg_renderer.node')


def recovery_node() -> int:
    """Run recovery_node."""
    return start('stereo_recovery.node')


def matcher_node() -> int:
    """Run matcher_node."""
    return start('model_matcher.node')


def tracker_node() -> int:
    """Run tracker_node."""
    return start('model_matcher.tracker_node')


def merger_node() -> int:
    """Run merger_node."""
    return start('model_matcher.merger_node')


def viewer_node() -> int:
    """Run viewer_node."""
    return start('model_matcher.viewer_node')


def bpc_node() -> int:
    """Run bpc_node."""
    return start('model_matcher.closed_form.bop.bpc_node')


def recognise() -> int:
    """Run recovery_node, matcher_node and tracker_node in one process."""
    return start('model_matcher.closed_form.recognise_node')
