"""The round surfaces that facets stand for: normals at their corners, equal where facets run into each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.grouping import linked_groups
from msgs_py.numeric.typed import BoolArray, FloatArray, Int32Array, IntArray

from .facets import Facets
from .settings import EVEN


class RoundFacets(NamedTuple):
    """The facets of round surfaces.

    Attributes
    ----------
    point, normal : (g, 3) float64
        Their corners, metres, and the unit normals of the surfaces there. Where a crease runs through a vertex it is
        one corner for either side.
    sharp : (g,) bool
        Points at which a surface has no normal, as the tip of a cone.
    edge : (e, 2) int32
        Corners at the ends of each edge.
    side : (e, 2) int32
        Facets at each edge, -1 where the surface ends.
    facet : (s, 3) int32
        Corners of each.
    border : (s, 3) int32
        Edges of each.
    bulge : (s,) float64
        How far the surface lies off each at most, metres.
    """

    point: FloatArray
    normal: FloatArray
    sharp: BoolArray
    edge: Int32Array
    side: Int32Array
    facet: Int32Array
    border: Int32Array
    bulge: FloatArray


def round_facets(facets: Facets) -> RoundFacets:
    """The facets of a mesh that stand for round surfaces, with normals; not those of hollows, which show no contour.

    Parameters
    ----------
    facets : Facets

    Returns
    -------
    RoundFacets

    Notes
    -----
    Normals are exact, however uneven the facets, at vertices on a sphere and on the circle of a cylinder. Where more
    than two flat facets meet in a vertex, each counts by sin(a) / (b c), with the angle a and the edges b and c of its
    triangles there (Max 1999). Where two meet, each counts by one over its width. Where a vertex lies on one, at a
    crease, the normal is between those at its edges, by the distances from them, or beyond the one that it has. A flat
    face that runs smoothly into a round one keeps its own normal up to where they meet.

    References
    ----------
    N. Max, Weights for computing vertex normals from facet normals, Journal of Graphics Tools 4 (2), 1999.
    """
    bends = _bends(facets)
    corner = _corners(facets)
    flat = bends.flat[facets.facet]
    count = int(corner.max(initial=-1)) + 1
    point = np.empty((count, 3))
    point[corner.ravel()] = facets.points[facets.triangles.ravel()]
    normal = _normals(facets, bends, corner, point)
    # Where a facet turns from that normal by more than it may at an edge.
    turned = (facets.normal[:, None] * normal[corner]).sum(axis=2) < np.cos(facets.crease_angle)
    sharp = np.zeros(count, bool)
    sharp[corner[turned]] = True
    kept = np.flatnonzero(facets.curved & ~flat & ~_hollow(facets))
    facet = corner[kept]
    sides = np.sort(np.stack([facet, np.roll(facet, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edge, border = np.unique(sides, axis=0, return_inverse=True)
    border = border.reshape(-1, 3)
    owner = np.repeat(np.arange(len(kept)), 3)
    order = np.argsort(border.ravel(), kind='stable')
    start = np.searchsorted(border.ravel()[order], np.arange(len(edge)))
    side = np.full((len(edge), 2), -1)
    side[:, 0] = owner[order[start]]
    more = np.bincount(border.ravel(), minlength=len(edge)) > 1
    side[more, 1] = owner[order[start[more] + 1]]
    along, turn = point[edge[:, 1]] - point[edge[:, 0]], normal[edge[:, 1]] - normal[edge[:, 0]]
    # Only what the normal turns along an edge lifts the surface off it: a generator of a cylinder lies in it.
    bulge = 0.125 * np.abs((along * turn).sum(axis=1))[border].max(axis=1, initial=0.0)
    return RoundFacets(
        point,
        normal,
        sharp,
        edge.astype(np.int32),
        side.astype(np.int32),
        facet.astype(np.int32),
        border.astype(np.int32),
        bulge,
    )


class _Bends(NamedTuple):
    """Where flat faces run smoothly into each other.

    Attributes
    ----------
    face : (b, 2) int
        The two faces, the lower number first; ascending.
    foot, direction, normal : (b, 3) float64
        A point between them, metres, the unit direction of the edge there, and the unit normal of what they stand for.
    width : (b, 2) float64
        How far both reach from there, metres.
    flat : (faces,) bool
        Faces that are flat: what runs smoothly into nothing, or is wider than all that it runs into. Facets that stand
        for one round surface are about as wide as their neighbours.
    """

    face: IntArray
    foot: FloatArray
    direction: FloatArray
    normal: FloatArray
    width: FloatArray
    flat: BoolArray


def _bends(facets: Facets) -> _Bends:
    rows = np.flatnonzero(facets.bent)
    count = int(facets.facet.max(initial=-1)) + 1
    order = np.argsort(facets.facet, kind='stable')
    begin = np.searchsorted(facets.facet[order], np.arange(count + 1))
    face, first = np.unique(np.sort(facets.facet[facets.sides[rows]], axis=1), axis=0, return_index=True)
    rows = rows[first]
    ends = facets.points[facets.edges[rows]]
    foot = np.ascontiguousarray(ends[:, 0])
    direction = ends[:, 1] - ends[:, 0]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    width = _widths(facets.points, facets.triangles, order, begin, face, foot, direction)
    flat = np.ones(count, bool)
    for k in range(2):
        flat[face[width[:, k] <= EVEN * width[:, 1 - k], k]] = False
    of_face = facets.normal[order[begin[:-1]]]
    normal = of_face[face[:, 0]] * width[:, 1:] + of_face[face[:, 1]] * width[:, :1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return _Bends(face, foot, direction, normal, width, flat)


def _corners(facets: Facets) -> IntArray:
    """Number of each corner of triangles, (m, 3): the same of those that meet in a vertex with no crease between."""
    linked = np.flatnonzero(~facets.crease)
    sides = facets.sides[linked]
    pairs = [
        3 * sides + (facets.triangles[sides] == facets.edges[linked, end, None, None]).argmax(axis=2)
        for end in range(2)
    ]
    return linked_groups(3 * len(facets.triangles), np.concatenate(pairs)).reshape(-1, 3)


def _normals(facets: Facets, bends: _Bends, corner: IntArray, point: FloatArray) -> FloatArray:
    """Unit normals at corners (g, 3); see :func:`round_facets`.

    corner : (m, 3); point : (g, 3)
    """
    count, faces = len(point), len(bends.flat)
    # By the angles and edges of triangles, or of those of flat faces where there are any.
    place = facets.points[facets.triangles]
    ahead, back = np.roll(place, -1, axis=1) - place, np.roll(place, 1, axis=1) - place
    weight = np.linalg.norm(np.cross(ahead, back), axis=2)
    weight /= (ahead**2).sum(axis=2) * (back**2).sum(axis=2)
    flat = bends.flat[facets.facet]
    of_flat = np.zeros(count, bool)
    of_flat[corner[flat]] = True
    weight[of_flat[corner] & ~flat[:, None]] = 0.0
    normal = np.zeros((count, 3))
    np.add.at(normal, corner.ravel(), (weight[:, :, None] * facets.normal[:, None]).reshape(-1, 3))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0.0, length, 1.0)
    # Where two meet, and where there is one.
    meeting = np.unique(corner.ravel() * faces + np.repeat(facets.facet, 3))
    at, face = meeting // faces, meeting % faces
    first, many = np.searchsorted(at, np.arange(count)), np.bincount(at, minlength=count)
    two = np.flatnonzero((many == 2) & ~of_flat)
    wanted = face[first[two]] * faces + face[first[two] + 1]
    known = bends.face[:, 0] * faces + bends.face[:, 1]
    row = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
    met = known[row] == wanted if len(known) else np.zeros(len(two), bool)
    normal[two[met]] = bends.normal[row[met]]
    one = np.flatnonzero((many == 1) & ~of_flat)
    owner, bend = np.concatenate([bends.face[:, 0], bends.face[:, 1]]), np.tile(np.arange(len(bends.face)), 2)
    order = np.argsort(owner, kind='stable')
    begin = np.searchsorted(owner[order], np.arange(faces + 1))
    _across(point, one, face[first[one]], bend[order], begin, bends, normal)
    found: FloatArray = normal
    return found


@njit(nogil=True)
def _across(
    point: FloatArray,
    rows: IntArray,
    face: IntArray,
    bend: IntArray,
    begin: IntArray,
    bends: _Bends,
    normal: FloatArray,
) -> None:
    """Normals at some corners, filled in, from those at the edges of the one face on which each lies.

    face : of each of the rows; bend, begin : rows of ``bends`` by their faces, and where those of each begin
    """
    for k in range(len(rows)):
        p, own = point[rows[k]], normal[rows[k]].copy()
        near, near_by, far, far_by, most = -1, np.inf, -1, 0.0, 0.0
        for turn in range(2):
            for at in range(begin[face[k]], begin[face[k] + 1]):
                b = bend[at]
                d, foot = bends.direction[b], bends.foot[b]
                x, y, z = p[0] - foot[0], p[1] - foot[1], p[2] - foot[2]
                cx, cy, cz = y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]
                away = np.sqrt(cx * cx + cy * cy + cz * cz)
                if turn == 0 and away < near_by:
                    near, near_by = b, away
                elif turn == 1:
                    # The edge at which the surface has turned to the other side.
                    both = 0.0
                    for i in range(3):
                        both += (bends.normal[b, i] - own[i]) * (bends.normal[near, i] - own[i])
                    if both < most:
                        far, far_by, most = b, away, both
            if near < 0:
                break
        if near < 0:
            continue
        length = 0.0
        width = bends.width[near, 0 if bends.face[near, 0] == face[k] else 1]
        for i in range(3):
            if far >= 0:
                value = (far_by * bends.normal[near, i] + near_by * bends.normal[far, i]) / (far_by + near_by)
            else:
                value = bends.normal[near, i] + 2.0 * near_by / width * (own[i] - bends.normal[near, i])
            normal[rows[k], i] = value
            length += value * value
        for i in range(3):
            normal[rows[k], i] /= np.sqrt(length)


def _hollow(facets: Facets) -> BoolArray:
    """Triangles of flat faces, (m,) bool, that turn towards all they run into."""
    one, other = facets.sides[facets.bent].T
    middle = facets.points[facets.triangles].mean(axis=1)
    bulges = (facets.normal[one] * (middle[other] - middle[one])).sum(axis=1) < 0.0
    hollow = np.ones(int(facets.facet.max(initial=-1)) + 1, bool)
    for side in (one, other):
        hollow[facets.facet[side[bulges]]] = False
    found: BoolArray = hollow[facets.facet]
    return found


@njit(nogil=True)
def _widths(
    points: FloatArray,
    triangles: IntArray,
    order: IntArray,
    begin: IntArray,
    face: IntArray,
    foot: FloatArray,
    direction: FloatArray,
) -> FloatArray:
    """How far from lines (b, 3) the two faces (b, 2) at each reach, (b, 2), metres.

    order, begin : triangles by their faces, and where those of each begin
    """
    out = np.zeros((len(face), 2))
    for k in range(len(face)):
        a, d = foot[k], direction[k]
        for j in range(2):
            for row in range(begin[face[k, j]], begin[face[k, j] + 1]):
                for corner in range(3):
                    p = points[triangles[order[row], corner]]
                    x, y, z = p[0] - a[0], p[1] - a[1], p[2] - a[2]
                    cx, cy, cz = y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]
                    out[k, j] = max(out[k, j], cx * cx + cy * cy + cz * cz)
            out[k, j] = np.sqrt(out[k, j])
    return out
