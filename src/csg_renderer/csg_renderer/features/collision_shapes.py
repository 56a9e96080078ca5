"""Solids to the shapes that motion planners take."""

from __future__ import annotations

import numpy as np

from msgs_py import Pose
from msgs_py.numeric.typed import FloatArray
from msgs_py.shapes import CollisionShapes, MeshShape, PrimitiveShape

from ..brep.surfaces import solid_box
from ..scene.mesh_export import ExportError, mesh_of
from ..scene.settings import SEGMENTS
from ..scene.solid import Operation, Primitive, Solid
from .settings import SAME_SHAPE

# The middle of the bounding box of each unit primitive.
_MIDDLES = {'BLOCK': (0.5, 0.5, 0.5), 'SPHERE': (0.0, 0.0, 0.0), 'CYLINDER': (0.0, 0.0, 0.5), 'CONE': (0.0, 0.0, 0.5)}


def planning_scene(solid: Solid, segments: int = SEGMENTS) -> CollisionShapes:
    """The space that a solid takes, in the shapes that motion planners take.

    A union of primitives that are neither sheared nor squeezed becomes the same primitives, one to one; any other solid
    a mesh, which needs manifold3d. Where that is not installed, it becomes primitives that hold it: what is taken away
    is left there, and an intersection is its bounding box; ``note`` says so.

    Parameters
    ----------
    solid : Solid
    segments : int
        Facets around a circle of a mesh.

    Returns
    -------
    CollisionShapes
        Model frame, metres.

    Raises
    ------
    ValueError
        The solid has no bounds.

    Examples
    --------
    >>> step = Solid.block(0.2, 0.1, 0.1) | Solid.cylinder(0.05, (0, 0, 0.3))
    >>> [(shape.kind, shape.dimensions) for shape in planning_scene(step).primitives]
    [('BOX', (0.2, 0.1, 0.1)), ('CYLINDER', (0.3, 0.05))]
    """
    low, high = solid_box(solid)
    if (high < low).any():
        return CollisionShapes(())
    if not np.isfinite([low, high]).all():
        raise ValueError('solid: it has no bounds, which a planner cannot hold')
    leaves = _union(solid)
    exact = [primitive_shape(leaf) for leaf in leaves or ()]
    shapes = tuple(shape for shape in exact if shape is not None)
    if exact and len(shapes) == len(exact):
        return CollisionShapes(shapes)
    try:
        vertices, faces, _ = mesh_of(solid, segments)
        return CollisionShapes((), (MeshShape(vertices, faces),))
    except ExportError:
        return CollisionShapes(tuple(_covering(solid)), note='larger than the object: a mesh needs manifold3d (pip)')


def box_shape(low: FloatArray, high: FloatArray) -> PrimitiveShape:
    """The box between two corners (3,), metres."""
    x, y, z = (high - low).tolist()
    return PrimitiveShape('BOX', (x, y, z), Pose(np.eye(3), 0.5 * (low + high)))


def primitive_shape(leaf: Primitive) -> PrimitiveShape | None:
    """A placed primitive as planners know it; None of a half space, and of what is sheared or squeezed."""
    if leaf.kind not in _MIDDLES:
        return None
    linear = leaf.matrix[:3, :3]
    sizes = np.linalg.norm(linear, axis=0)
    axes = linear / sizes
    if np.abs(axes.T @ axes - np.eye(3)).max() > SAME_SHAPE:
        return None
    round_axes = {'BLOCK': 1, 'SPHERE': 3}.get(leaf.kind, 2)
    if np.ptp(sizes[:round_axes]) > SAME_SHAPE * sizes.max():
        return None
    if leaf.kind == 'CONE':
        axes[:, 2] *= -1.0  # ours has its tip in the origin, theirs on +z
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0  # each is its own mirror image
    u, _, v = np.linalg.svd(axes)
    pose = Pose(u @ v, linear @ _MIDDLES[leaf.kind] + leaf.matrix[:3, 3])
    x, y, z = sizes.tolist()
    if leaf.kind == 'BLOCK':
        return PrimitiveShape('BOX', (x, y, z), pose)
    if leaf.kind == 'SPHERE':
        return PrimitiveShape('SPHERE', (x,), pose)
    return PrimitiveShape('CYLINDER' if leaf.kind == 'CYLINDER' else 'CONE', (z, x), pose)


def _union(solid: Solid) -> list[Primitive] | None:
    """The primitives of a union, None of what has other operators. Without recursion: unions grow thousands deep."""
    leaves: list[Primitive] = []
    pending = [solid]
    while pending:
        node = pending.pop()
        if isinstance(node, Operation):
            if node.operator != 'UNION':
                return None
            pending += [node.right, node.left]
        elif isinstance(node, Primitive):
            leaves.append(node)
    return leaves


def _covering(solid: Solid) -> list[PrimitiveShape]:
    """Primitives whose union holds a bounded solid."""
    found: list[PrimitiveShape] = []
    pending = [solid]
    while pending:
        node = pending.pop()
        low, high = solid_box(node)
        if (high < low).any():
            continue
        shape = primitive_shape(node) if isinstance(node, Primitive) else None
        if shape is not None:
            found.append(shape)
        elif isinstance(node, Operation) and node.operator == 'UNION':
            pending += [node.right, node.left]
        elif isinstance(node, Operation) and node.operator == 'DIFFERENCE':
            pending.append(node.left)
        elif isinstance(node, Primitive | Operation):
            found.append(box_shape(low, high))
    return found
