"""Every curve that can be a crease: the lines and conics in which the surfaces of touching leaves meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.grouping import cluster

from .conics import common_planes, identity, section
from .lines import distinct_lines, plane_pairs, touching_leaves
from .settings import ON_SURFACE
from .surfaces import SLOTS, SurfaceTable


@dataclass(frozen=True, eq=False)
class Candidates:
    """Tentative curves, normalised frame, each once.

    Parameters
    ----------
    point, direction : (n, 3) float64
        Lines; the direction is a unit vector.
    conic : (c, 4, 3) float64
    space_pairs : tuple of (int, int)
        Pairs of quadrics whose intersection lies in no plane.
    extra : (k, 4) float64
        The planes in which pairs of quadrics meet; conics are cut there too.
    """

    point: np.ndarray
    direction: np.ndarray
    conic: np.ndarray
    space_pairs: tuple[tuple[int, int], ...]
    extra: np.ndarray


def candidates(table: SurfaceTable) -> Candidates:
    """All tentative curves of a solid."""
    point, direction = plane_pairs(table)
    if not len(table.quadrics):
        return Candidates(point, direction, np.zeros((0, 4, 3)), (), np.zeros((0, 4)))
    conics: list[np.ndarray] = []
    lines: list[tuple[np.ndarray, np.ndarray]] = []
    space_pairs, extra = [], []
    flat, curved = _group_pairs(table)
    for plane, quadric in flat:
        found = section(table, quadric, table.planes[plane])
        conics += found[0]
        lines += found[1]
    for one, two in curved:
        planes, planar = common_planes(table, one, two)
        extra += planes
        for item in planes:
            found = section(table, one, item)
            conics += found[0]
            lines += found[1]
        if not planar:
            space_pairs.append((one, two))
    if lines:
        # Lines of planes come first, and are kept as they are where a quadric has the same one.
        quality = np.concatenate([np.full(len(point), 2.0), np.ones(len(lines))])
        point, direction = distinct_lines(
            np.concatenate([point, [line[0] for line in lines]]),
            np.concatenate([direction, [line[1] for line in lines]]),
            quality,
        )
    conic = np.array(conics).reshape(-1, 4, 3)
    conic = conic[cluster(identity(conic), ON_SURFACE)[1]]
    return Candidates(point, direction, conic, tuple(space_pairs), np.array(extra).reshape(-1, 4))


def _group_pairs(table: SurfaceTable) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Pairs (plane group, quadric) and (quadric, quadric) of leaves that touch; quadrics counted from 0."""
    g = len(table.planes)
    pairs = touching_leaves(table)
    face = np.where(table.slot_real, table.slots, -1)
    one = np.repeat(face[pairs[:, 0]], SLOTS, axis=1).ravel()
    two = np.tile(face[pairs[:, 1]], (1, SLOTS)).ravel()
    low, high = np.minimum(one, two), np.maximum(one, two)
    keep = (low >= 0) & (high >= g) & (low != high)
    unique = np.unique(np.stack([low[keep], high[keep]], axis=1), axis=0)
    return ([(int(a), int(b) - g) for a, b in unique if a < g], [(int(a) - g, int(b) - g) for a, b in unique if a >= g])
