"""Solids to triangle meshes for other programs (STL, glTF, OBJ, PLY), through manifold3d and trimesh.

Both are optional: install them with ``pip install manifold3d trimesh``. Curved faces become facets.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from .scene import Scene
from .settings import ENDLESS, SEGMENTS
from .solid import Empty, Operation, Primitive, Solid
from .terrain import Terrain, sheets, tint

FORMATS = ('.stl', '.glb', '.gltf', '.obj', '.ply')


class ExportError(RuntimeError):
    """An optional library is missing, or the solid has no mesh."""


def export_mesh(scene: Scene, path: Path, segments: int = SEGMENTS) -> int:
    """Write a scene's solids as one mesh file.

    Parameters
    ----------
    scene : Scene
    path : Path
        The suffix says the format: .stl, .glb, .gltf, .obj or .ply. Vertices are metres, scene frame.
    segments : int
        Facets around a circle.

    Returns
    -------
    int
        Number of triangles.

    Raises
    ------
    ExportError
        A library is missing, or there is nothing to write.
    ValueError
        The suffix is unknown.
    """
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f'export: unknown format {path.suffix!r}, expected one of {", ".join(FORMATS)}')
    manifold, trimesh = _library('manifold3d'), _library('trimesh')
    pieces = trimesh.Scene()
    triangles = 0
    for placement, solid in zip(scene.placements, scene.solids):
        vertices, faces, colours = mesh_of(solid, segments, manifold)
        if not len(faces):
            continue
        mesh = trimesh.Trimesh(vertices, faces, face_colors=colours, process=False)
        pieces.add_geometry(mesh, node_name=placement.name, geom_name=placement.name)
        triangles += len(faces)
    if not triangles:
        raise ExportError('export: there is nothing to write, every solid is empty')
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() in ('.stl', '.ply'):
        trimesh.util.concatenate(list(pieces.geometry.values())).export(str(path))
    else:
        pieces.export(str(path))
    return triangles


def mesh_of(solid: Solid, segments: int = SEGMENTS, manifold: Any = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles of a solid.

    Parameters
    ----------
    solid : Solid
    segments : int
        Facets around a circle.
    manifold : module, optional
        manifold3d, imported by default.

    Returns
    -------
    vertices : (n, 3) float64
        Metres.
    faces : (m, 3) int
        Vertices of each triangle, anticlockwise seen from outside.
    colours : (m, 4) uint8
        Of each triangle.
    """
    manifold = manifold or _library('manifold3d')
    leaves = tuple(leaf for leaf in solid.primitives if not isinstance(leaf, Terrain))
    size = _size(leaves)
    colours: dict[int, np.ndarray] = {}
    made: list[Any] = []
    # The tree without recursion: unions grow thousands deep.
    pending: list[tuple[Solid, bool]] = [(solid, False)]
    while pending:
        node, ready = pending.pop()
        if isinstance(node, Operation) and not ready:
            pending += [(node, True), (node.right, False), (node.left, False)]
        elif isinstance(node, Operation):
            right, left = made.pop(), made.pop()
            combine = {'UNION': left.__add__, 'INTERSECT': left.__xor__, 'DIFFERENCE': left.__sub__}[node.operator]
            made.append(combine(right))
        elif isinstance(node, Primitive):
            piece = _primitive(node, segments, size, manifold).as_original()
            rgba = np.append(node.surface.colour, 1.0 - node.surface.transparency)
            colours[piece.original_id()] = np.rint(255.0 * rgba).astype(np.uint8)
            made.append(piece)
        elif isinstance(node, Empty | Terrain):
            made.append(manifold.Manifold())
    mesh = made[0].to_mesh64()
    faces = np.asarray(mesh.tri_verts, dtype=np.int64)
    paint = np.full((len(faces), 4), 200, dtype=np.uint8)
    starts = np.asarray(mesh.run_index) // 3
    for first, last, original in zip(starts[:-1], starts[1:], mesh.run_original_id):
        paint[first:last] = colours.get(int(original), paint[0] if len(paint) else 0)
    parts = [(np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3], faces, paint)]
    parts += [_sheet(terrain) for terrain in sheets(solid)]
    counts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate([faces + first for (_, faces, _), first in zip(parts, counts)]),
        np.concatenate([paint for _, _, paint in parts]),
    )


def _sheet(terrain: Terrain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles of a terrain, an open sheet, and their colours."""
    vertices, faces = terrain.mesh()
    colour = np.tile(terrain.surface.colour, (len(faces), 1))
    if terrain.tints is not None:
        inverse = np.linalg.inv(terrain.matrix)
        colour = tint(terrain.tints, vertices[faces].mean(axis=1) @ inverse[2, :3] + inverse[2, 3])
    opacity = np.full((len(faces), 1), 1.0 - terrain.surface.transparency)
    return vertices, faces, np.rint(255.0 * np.hstack([colour, opacity])).astype(np.uint8)


def _primitive(leaf: Primitive, segments: int, size: float, manifold: Any) -> Any:
    """A primitive as a manifold, placed."""
    kind = manifold.Manifold
    if leaf.kind == 'BLOCK':
        body = kind.cube([1.0, 1.0, 1.0])
    elif leaf.kind == 'CYLINDER':
        body = kind.cylinder(1.0, 1.0, 1.0, segments)
    elif leaf.kind == 'CONE':
        body = kind.cylinder(1.0, 0.0, 1.0, segments)
    elif leaf.kind == 'SPHERE':
        body = kind.sphere(1.0, segments)
    else:
        reach = ENDLESS * size / float(np.linalg.norm(leaf.matrix[:3, :3], axis=0).min())
        body = kind.cube([2.0 * reach, 2.0 * reach, reach]).translate([-reach, -reach, -reach])
    return body.transform(leaf.matrix[:3])


def _size(leaves: tuple[Primitive, ...]) -> float:
    """A length that holds everything bounded, metres."""
    bounded = [np.abs(leaf.matrix[:3]).sum(axis=1).max() for leaf in leaves if leaf.kind != 'PLANE']
    return 2.0 * float(max(bounded, default=1.0))


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ExportError(f'export: the optional library {name} is missing (pip install manifold3d trimesh)') from None
