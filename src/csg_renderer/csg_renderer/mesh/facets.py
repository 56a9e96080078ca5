"""The triangles of a mesh and how they meet: creases, flat faces, and normals of round ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msgs_py.numeric.grouping import cluster, linked_groups
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from .settings import COLLINEAR, WELD


@dataclass(frozen=True, eq=False)
class Facets:
    """A mesh whose vertices are welded and whose triangles are known to each other.

    Attributes
    ----------
    points : (n, 3) float64
        Vertices, metres.
    triangles : (m, 3) int
        Anticlockwise as seen from outside; those without area are left out.
    normal : (m, 3) float64
        Their unit normals.
    edges : (e, 2) int
        Vertices of each edge.
    sides : (e, 2) int
        The triangles at each, -1 where there is only one.
    angle : (e,) float64
        By which those turn, radians.
    crease : (e,) bool
        Where they turn by more than the crease angle, and where there is only one.
    crease_angle, size : float
        Radians; metres, the diagonal of the bounding box.
    """

    points: FloatArray
    triangles: IntArray
    normal: FloatArray
    edges: IntArray
    sides: IntArray
    angle: FloatArray
    crease: BoolArray
    crease_angle: float
    size: float

    @classmethod
    def of(cls, vertices: FloatArray, triangles: IntArray, crease_angle: float) -> Facets:
        """Those of a mesh (n, 3) metres, (m, 3); a closed one that is inside out is turned.

        crease_angle : radians
        """
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        label, first = cluster(vertices, WELD * size)
        points, triangles = vertices[first], np.ascontiguousarray(label[triangles])
        corner = points[triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        area = np.linalg.norm(normal, axis=1)
        keep = area > (WELD * size) ** 2
        triangles, corner, normal = triangles[keep], corner[keep], normal[keep] / area[keep, None]
        edges, sides = _edges(triangles)
        if (sides >= 0).all() and _volume(corner) < 0.0:
            triangles, normal = np.ascontiguousarray(triangles[:, ::-1]), -normal
        facing = np.where(sides >= 0, sides, 0)
        angle = np.arctan2(
            np.linalg.norm(np.cross(normal[facing[:, 0]], normal[facing[:, 1]]), axis=1),
            (normal[facing[:, 0]] * normal[facing[:, 1]]).sum(axis=1),
        )
        crease = (sides < 0).any(axis=1) | (angle > crease_angle)
        return cls(points, triangles, normal, edges, sides, angle, crease, crease_angle, size)

    @cached_property
    def bent(self) -> BoolArray:
        """Edges at which a round surface turns from one facet to the next, (e,) bool."""
        found: BoolArray = ~self.crease & (self.angle > COLLINEAR)
        return found

    @cached_property
    def facet(self) -> IntArray:
        """Number of the flat face that each triangle is part of, (m,) int."""
        return linked_groups(len(self.triangles), self.sides[~self.crease & (self.angle <= COLLINEAR)])

    @cached_property
    def patch(self) -> IntArray:
        """Number of the face between creases that each triangle is part of, (m,) int."""
        return linked_groups(len(self.triangles), self.sides[~self.crease])

    @cached_property
    def curved(self) -> BoolArray:
        """Triangles whose flat face runs smoothly into another, (m,) bool."""
        curved = np.zeros(self.facet.max(initial=0) + 1, bool)
        curved[self.facet[self.sides[self.bent].ravel()]] = True
        found: BoolArray = curved[self.facet]
        return found


def _volume(corner: FloatArray) -> float:
    """What triangles (m, 3, 3) enclose, negative when they are inside out."""
    about = corner - corner.mean(axis=(0, 1))
    return float((np.cross(about[:, 0], about[:, 1]) * about[:, 2]).sum()) / 6.0


def _edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undirected edges (n, 2), and the two triangles (n, 2) at each, -1 where there is only one.

    Of more than two triangles (parts that only touch there) the first two are taken.
    """
    every = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((owner, every[:, 1], every[:, 0]))
    every, owner = every[order], owner[order]
    edges, start, count = np.unique(every, axis=0, return_index=True, return_counts=True)
    sides = np.full((len(edges), 2), -1)
    sides[:, 0] = owner[start]
    more = count > 1
    sides[more, 1] = owner[start[more] + 1]
    return edges, sides
