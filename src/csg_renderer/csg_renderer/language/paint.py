"""PAINT FACES: every face of a solid gets its own shade of its colour, so that stereo sees every edge (thesis 5.11).

Faces that lie in one plane count as one face and share their shade, so that no edge appears where the solid has none.
Evenly spaced shades are dealt to the faces that are left on the finished solid (most faces of a cutting tool cut
nothing) so that faces that meet differ much, and parallel faces, one of which is often seen before the other, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from msgs_py.numeric.spatial import any_within
from msgs_py.numeric.typed import FloatArray

from ..brep.surfaces import SurfaceTable, compile_surfaces
from ..scene.solid import FACES, Primitive, Solid
from .settings import (
    ALIKE,
    DARKEST,
    LIGHTEST,
    MAX_SAMPLES,
    MEETING,
    MOST_DEALT,
    OPPOSITE,
    OTHERS,
    SAME_DIRECTION,
    STARTS,
    STEP,
    WORK,
)


@dataclass
class Face:
    """What is left of a surface on the finished solid, normalised frame: samples, their spacing, outward normals."""

    samples: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    spacing: float = 0.0
    normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def outward(self) -> np.ndarray:
        """(3,): the mean outward normal, a unit vector only where the face is flat and has material on one side."""
        mean: FloatArray = self.normals.mean(axis=0)
        return mean


def paint_faces(solid: Solid) -> Solid:
    """The same solid with a shade of its own on every face. Deterministic."""
    if not solid.primitives:
        return solid
    table = compile_surfaces(solid)
    shade = _shades(table)
    colours = iter(
        [
            np.array([shade[int(group)] for group in table.slots[i][table.slot_real[i]]])[:, None]
            * np.asarray(leaf.surface.colour)
            for i, leaf in enumerate(table.leaves)
        ]
    )
    return solid.map_leaves(lambda leaf: replace(leaf, face_colours=next(colours)))


def paint_work(leaves: int) -> int:
    """What painting a solid costs, in primitives that could be moved in the same time."""
    samples = min(WORK, 6 * leaves * leaves * MAX_SAMPLES**2)
    return 200 + 2 * leaves + 1500 * samples // WORK


def _shades(table: SurfaceTable) -> dict[int, float]:
    """A shade for every surface group."""
    groups = list(dict.fromkeys(int(group) for group in table.slots[table.slot_real]))
    left = _exposed(table)
    if 1 < len(left) <= MOST_DEALT:
        levels = LIGHTEST - (LIGHTEST - DARKEST) * _deal(_importance(left)) / (len(left) - 1)
        return dict.fromkeys(groups, LIGHTEST) | dict(zip(left, levels.tolist()))
    # Steps of the golden ratio keep faces that are written one after the other apart.
    order = sorted(groups, key=lambda group: group not in left)
    return {group: LIGHTEST - (LIGHTEST - DARKEST) * (0.61803398875 * k % 1.0) for k, group in enumerate(order)}


def _deal(importance: np.ndarray) -> np.ndarray:
    """(n,) int: a level 0..n-1 for each face, so that important pairs are far apart: by swaps, from a few starts."""
    n = len(importance)
    generator = np.random.default_rng(0)
    best, best_cost = np.arange(n), np.inf
    for start in range(STARTS):
        level = np.arange(n) if start == 0 else generator.permutation(n)
        cost, last = _cost(importance, level), np.inf
        while cost < last:
            last = cost
            for i in range(n):
                for j in range(i):
                    level[[i, j]] = level[[j, i]]
                    swapped = _cost(importance, level)
                    if swapped < cost:
                        cost = swapped
                    else:
                        level[[i, j]] = level[[j, i]]
        if cost < best_cost:
            best, best_cost = level.copy(), cost
    return best


def _cost(importance: np.ndarray, level: np.ndarray) -> float:
    """Ruled by the worst pair."""
    apart = np.abs(level[:, None] - level).astype(np.float64)
    np.fill_diagonal(apart, np.inf)
    return float(((importance / apart) ** 6).sum())


def _importance(left: dict[int, Face]) -> np.ndarray:
    """(n, n) float64: how much it matters that two faces differ."""
    out = np.full((len(left), len(left)), OTHERS)
    faces = list(left.values())
    for i, one in enumerate(faces):
        for j, other in enumerate(faces[:i]):
            alike = float(one.outward @ other.outward)
            if any_within(one.samples, other.samples, one.spacing + other.spacing):
                out[i, j] = out[j, i] = MEETING
            elif abs(alike) > 1.0 - SAME_DIRECTION:
                out[i, j] = out[j, i] = ALIKE if alike > 0.0 else OPPOSITE
    return out


def _exposed(table: SurfaceTable) -> dict[int, Face]:
    """The surface groups of which some part is left on the finished solid.

    Nothing when there are too many faces to look at, or endless ones.
    """
    faces = int(table.slot_real.sum())
    side = min(MAX_SAMPLES, int(np.sqrt(WORK / (faces * len(table.leaves)))))
    if side < 3 or not table.bounded:
        return {}
    found: dict[int, Face] = {}
    for leaf, frame, slots, real in zip(table.leaves, table.frames, table.slots, table.slot_real):
        around = 1.0 if leaf.kind == 'BLOCK' else 2.0 * np.pi
        spacing = around * float(np.linalg.norm(frame[:3, :3], axis=0).max()) / side
        for group, points in zip(slots[real], _samples(leaf, side)):
            on_face = points @ frame[:3, :3].T + frame[:3, 3]
            across = STEP * table.gradients(on_face, np.full((len(on_face), 1), group))[:, 0]
            ahead, behind = _inside(table, on_face + across), _inside(table, on_face - across)
            crossing = ahead != behind
            if crossing.any():
                face = found.setdefault(int(group), Face())
                face.samples = np.concatenate([face.samples, on_face[crossing]])
                face.spacing = max(face.spacing, spacing)
                signs = np.where(behind[crossing], 1.0, -1.0)[:, None] / STEP
                face.normals = np.concatenate([face.normals, signs * across[crossing]])
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
    height = 2.0 * b - 1.0
    wide = np.sqrt(1.0 - height**2)
    samples = {
        'BLOCK': [(zero, a, b), (one, a, b), (a, zero, b), (a, one, b), (a, b, zero), (a, b, one)],
        'CYLINDER': [(*disc, zero), (*disc, one), (*ring, b)],
        'CONE': [(*disc, one), (b * ring[0], b * ring[1], b)],
        'SPHERE': [(wide * ring[0], wide * ring[1], height)],
    }[leaf.kind]
    assert len(samples) == len(FACES[leaf.kind])
    return [np.stack(face, axis=-1) for face in samples]
