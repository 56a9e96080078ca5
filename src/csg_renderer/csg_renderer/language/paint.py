"""PAINT FACES: every face of a solid gets its own shade of its colour, so that stereo sees every edge (thesis 5.11).

Faces that lie in one plane count as one face and share their shade, so that no edge appears where the solid has none.
Two planar faces can only meet in an edge when they are not parallel, so the shades are first divided among the
directions of the faces, far apart, and then among the parallel faces of one direction, closer together. Only faces that
are left on the finished solid take part in this division: most faces of a cutting tool cut nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..solid import FACES, Primitive, Solid
from ..surfaces import SurfaceTable, compile_surfaces
from .leaves import map_leaves

# Shades are factors of the colour between these; the lower is still lighter than a black background.
DARKEST, LIGHTEST = 0.22, 1.0
# How much of the room of one direction its parallel faces use; the rest keeps neighbouring directions apart.
SPREAD = 0.35
# Curved faces have no direction; they take turns in this many groups of their own.
CURVED_GROUPS = 3

# Directions closer than this are parallel.
PARALLEL = 1e-6
# A face is on the solid where a step of this size (fraction of the solid's) through it crosses the boundary.
STEP = 1e-5
# Samples of a face along one side at most, and a bound on samples times primitives, which is the time it takes.
MAX_SAMPLES = 40
WORK = 600_000


def paint_faces(solid: Solid) -> Solid:
    """The same solid with a shade of its own on every face. Deterministic: the order of faces decides."""
    if not solid.primitives:
        return solid
    table = compile_surfaces(solid)
    shade = _shades(table, _exposed(table))
    colours = iter([np.array([shade[group] for group in table.slots[i][table.slot_real[i]]])[:, None]
                    * np.asarray(leaf.surface.colour) for i, leaf in enumerate(table.leaves)])
    return map_leaves(solid, lambda leaf: replace(leaf, face_colours=next(colours)))


def paint_work(leaves: int) -> int:
    """What painting a solid costs, in primitives that could be moved in the same time."""
    samples = min(WORK, 6 * leaves * leaves * MAX_SAMPLES**2)
    return 2 * leaves + 1000 * samples // WORK


def _shades(table: SurfaceTable, exposed: set[int]) -> dict[int, float]:
    """A shade for every surface group, those on the solid first."""
    order = list(dict.fromkeys(int(group) for group in table.slots[table.slot_real]))
    order.sort(key=lambda group: group not in exposed)
    directions: list[np.ndarray] = []
    rooms: dict[int, list[int]] = {}
    curved = 0
    for group in order:
        if group >= len(table.planes):
            room, curved = -1 - curved % CURVED_GROUPS, curved + 1
        else:
            normal = table.planes[group, :3]
            room = next((k for k, known in enumerate(directions) if np.abs(known - normal).max() < PARALLEL),
                        len(directions))
            if room == len(directions):
                directions.append(normal)
        rooms.setdefault(room, []).append(group)
    used = sum(any(group in exposed for group in groups) for groups in rooms.values()) or len(rooms)
    width = (LIGHTEST - DARKEST) / used
    return {group: LIGHTEST - width * (index % used + SPREAD * k / max(1, len(groups) - 1))
            for index, groups in enumerate(rooms.values()) for k, group in enumerate(groups)}


def _exposed(table: SurfaceTable) -> set[int]:
    """The surface groups of which some part is left on the finished solid, found by samples on every face."""
    faces = int(table.slot_real.sum())
    side = min(MAX_SAMPLES, int(np.sqrt(WORK / (faces * len(table.leaves)))))
    if side < 3 or not table.bounded:
        return {int(group) for group in table.slots[table.slot_real]}
    found: set[int] = set()
    for leaf, frame, slots, real in zip(table.leaves, table.frames, table.slots, table.slot_real):
        for group, points in zip(slots[real], _samples(leaf, side)):
            if int(group) in found:
                continue
            on_face = points @ frame[:3, :3].T + frame[:3, 3]
            across = STEP * table.gradients(on_face, np.full((len(on_face), 1), group))[:, 0]
            if (_inside(table, on_face + across) != _inside(table, on_face - across)).any():
                found.add(int(group))
    return found


def _inside(table: SurfaceTable, points: np.ndarray) -> np.ndarray:
    return table.combine(np.all(table.leaf_values(table.values(points)) <= 0.0, axis=-1))


def _samples(leaf: Primitive, side: int) -> list[np.ndarray]:
    """Points (side * side, 3) on every face of a bounded primitive, unit frame, in the order of FACES."""
    a, b = (grid.ravel() for grid in np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side))
    zero, one = np.zeros_like(a), np.ones_like(a)
    turn = 2.0 * np.pi * a
    ring = np.cos(turn), np.sin(turn)
    disc = np.sqrt(b) * ring[0], np.sqrt(b) * ring[1]
    samples = {
        'BLOCK': [(zero, a, b), (one, a, b), (a, zero, b), (a, one, b), (a, b, zero), (a, b, one)],
        'CYLINDER': [(*disc, zero), (*disc, one), (*ring, b)],
        'CONE': [(*disc, one), (b * ring[0], b * ring[1], b)],
        'SPHERE': [(np.sqrt(1.0 - (2.0 * b - 1.0) ** 2) * ring[0], np.sqrt(1.0 - (2.0 * b - 1.0) ** 2) * ring[1],
                    2.0 * b - 1.0)],
    }[leaf.kind]
    assert len(samples) == len(FACES[leaf.kind])
    return [np.stack(face, axis=-1) for face in samples]
