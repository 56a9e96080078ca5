"""What colour a surface point has: ambient, diffuse and specular light, in plain numpy (thesis 4.5).

For every light whose direction L has N . L > 0:
diffuse (N . L) colour light + specular (R . L)^shininess light; plus ambient colour ambient_light.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from msgs_py.numeric.typed import ByteArray, FloatArray

from ..scene.terrain import Terrain, tint
from .frame import FACE_SLOTS
from .programs.program import Program


def illuminate(
    program: Program,
    hit: np.ndarray,
    points: np.ndarray,
    normal: np.ndarray,
    direction: np.ndarray,
    transmitted: np.ndarray | None = None,
) -> np.ndarray:
    """Light of points in their lights, without shadows of its own and without mirrors (thesis 4.5).

    Parameters
    ----------
    program : Program
    hit : (n,) array of int64
        leaf * FACE_SLOTS + face.
    points : (n, 3) array of float64
        Metres, scene frame.
    normal : (n, 3) array of float64
        Unit, towards the viewer, scene frame.
    direction : (n, 3) array of float64
        Of the viewing rays, scene frame.
    transmitted : (n, lights) array of float64, optional
        How much of each light arrives, 0..1; all of it by default.

    Returns
    -------
    (n, 3) float64
        Linear RGB, not clipped.
    """
    leaf = hit // FACE_SLOTS
    colour = face_colours(program, hit, points)
    ambient, diffuse, specular, shininess = program.material[leaf, :4].T
    result: FloatArray = ambient[:, None] * colour * program.ambient_light
    mirrored = reflect(direction, normal)
    for index, (position, light) in enumerate(zip(program.lights, program.light_colours)):
        to_light = unit(position - points)
        facing = np.einsum('ni,ni->n', normal, to_light)
        arriving = np.where(facing > 0.0, 1.0 if transmitted is None else transmitted[:, index], 0.0)
        highlight = np.einsum('ni,ni->n', mirrored, to_light)
        highlight = np.where(highlight > 0.0, np.maximum(highlight, 0.0) ** shininess, 0.0)
        result += (arriving * diffuse * facing)[:, None] * colour * light
        result += (arriving * specular * highlight)[:, None] * light
    return result


def face_colours(program: Program, hit: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Colours of points on faces: those of the faces, or of a terrain's height there.

    Parameters
    ----------
    program : Program
    hit : (n,) array of int64
        leaf * FACE_SLOTS + face.
    points : (n, 3) array of float64
        Metres, scene frame.

    Returns
    -------
    (n, 3) float64
        Linear RGB.
    """
    colours: FloatArray = program.colours[hit // FACE_SLOTS, hit % FACE_SLOTS]
    for leaf in program.terrains:
        tints = cast(Terrain, program.leaves[leaf]).tints
        mine = hit // FACE_SLOTS == leaf
        if tints is not None and mine.any():
            up = program.inverse[leaf, 2]
            colours[mine] = tint(tints, points[mine] @ up[:3] + up[3])
    return colours


def reflect(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Viewing rays mirrored at a surface.

    Parameters
    ----------
    direction : (n, 3) array of float64
        Of any length.
    normal : (n, 3) array of float64
        Unit.

    Returns
    -------
    (n, 3) float64
        Unit.

    Examples
    --------
    >>> reflect(np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, -1.0]])).tolist()
    [[0.0, 0.0, -1.0]]
    """
    ray = unit(direction)
    mirrored: FloatArray = ray - 2.0 * np.einsum('ni,ni->n', ray, normal)[:, None] * normal
    return mirrored


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors scaled to length 1; a zero vector stays zero.

    Parameters
    ----------
    vectors : (n, 3) array of float64

    Returns
    -------
    (n, 3) float64

    Examples
    --------
    >>> unit(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]])).tolist()
    [[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]]
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def quantise(colours: np.ndarray) -> np.ndarray:
    """Linear intensities as bytes.

    Parameters
    ----------
    colours : array of float64
        0..1; what is beyond is clipped.

    Returns
    -------
    uint8 array of the same shape

    Examples
    --------
    >>> quantise(np.array([-1.0, 0.5, 2.0])).tolist()
    [0, 128, 255]
    """
    pixels: ByteArray = (np.clip(colours, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return pixels
