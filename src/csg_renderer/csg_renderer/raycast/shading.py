"""What colour a surface point has: ambient, diffuse and specular light, in plain numpy (thesis 4.5).

For every light whose direction L has N . L > 0:
diffuse (N . L) colour light + specular (R . L)^shininess light; plus ambient colour ambient_light.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import ByteArray, FloatArray

from .frame import FACE_SLOTS
from .program import Program


def illuminate(
    program: Program,
    hit: np.ndarray,
    points: np.ndarray,
    normal: np.ndarray,
    direction: np.ndarray,
    transmitted: np.ndarray | None = None,
) -> np.ndarray:
    """(n, 3) float64, linear RGB, not clipped.

    hit : (n,) leaf * FACE_SLOTS + face; points, normal, direction : (n, 3) scene frame; direction is the viewing ray's
    transmitted : (n, lights) how much of each light arrives, all of it by default
    """
    leaf = hit // FACE_SLOTS
    colour = program.colours[leaf, hit % FACE_SLOTS]
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


def reflect(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(n, 3) unit: viewing rays mirrored at the surface."""
    ray = unit(direction)
    mirrored: FloatArray = ray - 2.0 * np.einsum('ni,ni->n', ray, normal)[:, None] * normal
    return mirrored


def unit(vectors: np.ndarray) -> np.ndarray:
    """(n, 3) scaled to length 1; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def quantise(colours: np.ndarray) -> np.ndarray:
    """Linear 0..1 to uint8, clipped and rounded."""
    pixels: ByteArray = (np.clip(colours, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return pixels
