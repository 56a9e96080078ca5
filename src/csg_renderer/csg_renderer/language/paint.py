"""PAINT FACES: every face of a solid gets its own shade of its colour, so that stereo sees every edge (thesis 5.11).

Faces that lie in one plane count as one face and share their shade, so that no edge appears where the solid has none.
Two planar faces can only meet in an edge when they are not parallel, so the shades are first divided among the
directions of the faces, far apart, and then among the parallel faces of one direction, closer together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..solid import FACES, Primitive, Solid
from .leaves import map_leaves

# Shades are factors of the colour between these; the lower is still lighter than a black background.
DARKEST, LIGHTEST = 0.22, 1.0
# How much of the room of one direction its parallel faces use; the rest keeps neighbouring directions apart.
SPREAD = 0.45
# Curved faces have no direction; they take turns in this many groups of their own.
CURVED_GROUPS = 3

# Planes whose directions and offsets differ by less than this (relative to the solid's size) are one plane.
SAME_PLANE = 1e-6

Plane = tuple[tuple[float, float, float], float]

# Outward normal and offset of every planar face in the unit frame; None for a curved face.
_PLANES: dict[str, tuple[Plane | None, ...]] = {
    'BLOCK': (((-1, 0, 0), 0), ((1, 0, 0), 1), ((0, -1, 0), 0), ((0, 1, 0), 1), ((0, 0, -1), 0), ((0, 0, 1), 1)),
    'CYLINDER': (((0, 0, -1), 0), ((0, 0, 1), 1), None),
    'CONE': (((0, 0, 1), 1), None),
    'SPHERE': (None,),
    'PLANE': (((0, 0, 1), 0),),
}


def paint_faces(solid: Solid) -> Solid:
    """The same solid with a shade of its own on every face. Deterministic: the order of faces decides."""
    leaves = solid.primitives
    if not leaves:
        return solid
    size = max(float(np.abs(leaf.matrix[:3]).max()) for leaf in leaves)
    # groups[direction] lists the faces of that direction; a face is its key, and keys of coplanar faces are equal.
    groups: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    members: list[list[tuple[tuple[int, ...], tuple[int, ...]]]] = []
    curved = 0
    for leaf in leaves:
        inverse = np.linalg.inv(leaf.matrix)
        faces = []
        for plane in _PLANES[leaf.kind]:
            if plane is None:
                direction, face = (curved % CURVED_GROUPS,), (curved,)
                curved += 1
            else:
                face = _key(inverse, plane, size)
                direction = face[:3]
            group = groups.setdefault(direction, [])
            if face not in group:
                group.append(face)
            faces.append((direction, face))
        members.append(faces)
    room = (LIGHTEST - DARKEST) / len(groups)
    number = {direction: index for index, direction in enumerate(groups)}
    shades = iter([[LIGHTEST - room * (number[direction] + _within(groups[direction], face)) for direction, face in faces]
                   for faces in members])
    return map_leaves(solid, lambda leaf: _shaded(leaf, np.array(next(shades))))


def _within(group: list[tuple[int, ...]], face: tuple[int, ...]) -> float:
    """Where a face lies in the room of its direction, 0..SPREAD."""
    return SPREAD * group.index(face) / max(1, len(group) - 1)


def _shaded(leaf: Primitive, shades: np.ndarray) -> Primitive:
    if len(shades) != len(FACES[leaf.kind]):
        raise ValueError(f'shades: expected {len(FACES[leaf.kind])}, got {len(shades)}')
    return replace(leaf, face_colours=shades[:, None] * np.asarray(leaf.surface.colour))


def _key(inverse: np.ndarray, plane: Plane, size: float) -> tuple[int, ...]:
    """The plane's equation in the solid's frame, rounded, the same for both of its sides; direction first."""
    normal, offset = plane
    equation = np.append(normal, -offset) @ inverse
    equation = equation / np.linalg.norm(equation[:3])
    equation[3] /= size
    first = next(value for value in equation if abs(value) > SAME_PLANE)
    # The shift keeps round decimal sizes, which are what people write, away from the borders of the rounding.
    return tuple(np.round(equation * (np.sign(first) / SAME_PLANE) + 0.3183).astype(np.int64).tolist())
