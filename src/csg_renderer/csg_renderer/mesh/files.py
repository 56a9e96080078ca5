"""Mesh files, by trimesh."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from msgs_py.files import check_file

from .settings import LARGEST_MESH

MESH_SUFFIXES = ('.stl', '.obj', '.ply', '.off')
# What CAD programs keep parts in, exactly and each in its own way.
CAD_SUFFIXES = (
    '.step',
    '.stp',
    '.iges',
    '.igs',
    '.x_t',
    '.sldprt',
    '.ipt',
    '.prt',
    '.catpart',
    '.fcstd',
    '.3dm',
    '.3mf',
)


def cad_remedy(path: str | os.PathLike[str]) -> str:
    """What to do about a file of a CAD program, to be put after what is wrong; empty for others.

    Examples
    --------
    >>> cad_remedy('part.STEP')
    '; export the part as .stl from CAD'
    """
    return '; export the part as .stl from CAD' if Path(path).suffix.lower() in CAD_SUFFIXES else ''


def read_mesh(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a mesh file.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    vertices : (n, 3) float64
        Units of the file.
    triangles : (m, 3) int

    Raises
    ------
    FileNotFoundError, ValueError
        There is no such file; it is no mesh. The message begins with its name.
    """
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f'{path}: no such file')
    if file.suffix.lower() not in MESH_SUFFIXES:
        raise ValueError(f'{path}: expected a mesh ({", ".join(MESH_SUFFIXES)}), got {file.suffix or "no suffix"}')
    try:
        import trimesh  # optional, and half a second of import that scene files do not need
    except ImportError:
        raise ValueError(f'{path}: meshes need the optional library trimesh (pip install trimesh)') from None
    check_file(file, LARGEST_MESH)
    try:
        mesh: Any = trimesh.load(str(file), force='mesh', process=False)
        vertices, triangles = np.array(mesh.vertices, float), np.array(mesh.faces, int)
    except Exception as error:  # the loaders raise whatever a damaged file provokes
        raise ValueError(f'{path}: not a readable mesh: {error}') from error
    if not len(triangles) or not np.isfinite(vertices).all():
        raise ValueError(f'{path}: expected a mesh of finite triangles, found {len(triangles)} triangles')
    if not (triangles >= 0).all() or not (triangles < len(vertices)).all():
        raise ValueError(f'{path}: expected triangles of its {len(vertices)} vertices, found others')
    return vertices, triangles
