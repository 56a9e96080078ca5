"""Change every leaf of any solid, be it a tree, one primitive or nothing."""

from __future__ import annotations

from collections.abc import Callable

from ..solid import Operation, Primitive, Solid


def map_leaves(solid: Solid, change: Callable[[Primitive], Primitive]) -> Solid:
    """The same solid with ``change(leaf)`` in place of every leaf, called left to right."""
    if isinstance(solid, Operation):
        return solid.map_leaves(lambda leaf: change(leaf) if isinstance(leaf, Primitive) else leaf)
    return change(solid) if isinstance(solid, Primitive) else solid
