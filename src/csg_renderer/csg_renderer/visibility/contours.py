"""Occluding contours: where a viewpoint's rays touch the curved surfaces of a solid.

The rays from a point that touch a quadric do so in one plane, the point's polar plane, so a contour is a conic or a
pair of rulings like any other tentative curve (Semple & Kneebone, Algebraic projective geometry). It depends on the
viewpoint and is no crease: a stereo pair sees two different ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from ..brep.pieces import Pieces, conic_pieces, line_pieces
from ..brep.settings import TOUCHING
from ..brep.surfaces import SurfaceTable
from .image_cuts import Wires

SPHERE, CYLINDER, CONE = range(3)
KINDS = {'SPHERE': SPHERE, 'CYLINDER': CYLINDER, 'CONE': CONE}


class Quadrics(NamedTuple):
    """The q quadrics of a solid, as images of unit spheres, cylinders and cones.

    Attributes
    ----------
    kind : (q,) int32
        SPHERE, CYLINDER or CONE.
    frame : (q, 4, 4) float64
        From the unit frame of each to the solid's normalised frame.
    inverse : (q, 4, 4) float64
        And back.
    height : (q, 2) float64
        Along the axis, unit frame, between which the primitives lie whose surface each is.
    """

    kind: Int32Array
    frame: FloatArray
    inverse: FloatArray
    height: FloatArray

    @classmethod
    def of(cls, table: SurfaceTable) -> Quadrics:
        """Those of a solid."""
        frame = np.ascontiguousarray(table.frames[table.quadric_leaf])
        inverse = np.linalg.inv(frame)
        kinds = [KINDS[table.leaves[leaf].kind] for leaf in table.quadric_leaf]
        height = np.empty((len(frame), 2))
        for k in range(len(frame)):
            owners = table.frames[(table.slots == len(table.planes) + k).any(axis=1)]
            ends = np.concatenate([owners[:, :, 3], owners[:, :, 2] + owners[:, :, 3]]) @ inverse[k, 2]
            height[k] = ends.min(), ends.max()
        return cls(np.array(kinds, np.int32), frame, inverse, height)


def contours(table: SurfaceTable, viewpoint: np.ndarray) -> Wires:
    """The occluding contours of a solid's boundary; hidden parts are not removed.

    Parameters
    ----------
    table : SurfaceTable
    viewpoint : (3,) float64, metres, model frame

    Returns
    -------
    Wires
        Model frame, metres.
    """
    most = 2 * len(table.quadrics)
    matrix, quadric = np.empty((most, 4, 3)), np.empty(most, np.int32)
    count = polar_sections(Quadrics.of(table), np.ascontiguousarray(table.normalised(viewpoint)), matrix, quadric)
    matrix, quadric = matrix[:count], quadric[:count]
    parts = [_on_boundary(table, len(table.planes) + int(k), matrix[quadric == k]) for k in np.unique(quadric)]
    return Wires.concatenate(parts).moved(table.metres_T_normalised)


@njit(nogil=True)
def polar_sections(quadrics: Quadrics, viewpoint: FloatArray, matrix: FloatArray, quadric: Int32Array) -> int:
    """Where rays from a viewpoint touch quadrics: the whole curves, of which parts may bound nothing.

    Parameters
    ----------
    quadrics : Quadrics
    viewpoint : (3,) float64, normalised frame
    matrix : (2 q, 4, 3) float64
        Filled with the curves: a conic's point at angle t is matrix (cos t, sin t, 1), homogeneous; a ruling's, whose
        column 1 is zero, matrix (t, 0, 1), and from t = 0 to 1 it is as high as the primitives are.
    quadric : (2 q,) int32
        Filled with the quadric of each.

    Returns
    -------
    int
        How many curves there are.
    """
    count = 0
    for k in range(len(quadrics.kind)):
        back = quadrics.inverse[k]
        vx, vy, vz = viewpoint[0], viewpoint[1], viewpoint[2]
        x = back[0, 0] * vx + back[0, 1] * vy + back[0, 2] * vz + back[0, 3]
        y = back[1, 0] * vx + back[1, 1] * vy + back[1, 2] * vz + back[1, 3]
        z = back[2, 0] * vx + back[2, 1] * vy + back[2, 2] * vz + back[2, 3]
        if quadrics.kind[k] == SPHERE:
            more = _rim_of_sphere(quadrics.frame[k], x, y, z, matrix, count)
        else:
            cone = quadrics.kind[k] == CONE
            more = _rulings(quadrics, k, x, y, z if cone else 1.0, matrix, count)
        for row in range(count, count + more):
            quadric[row] = k
        count += more
    return count


@njit(nogil=True)
def _rim_of_sphere(frame: FloatArray, x: float, y: float, z: float, matrix: FloatArray, row: int) -> int:
    """The circle in which rays from (x, y, z) touch the unit sphere, placed by a frame; how many there are: 0 or 1."""
    distance = math.sqrt(x * x + y * y + z * z)
    if distance * (1.0 - TOUCHING) <= 1.0:
        return 0
    nx, ny, nz = x / distance, y / distance, z / distance
    # The first half-axis is perpendicular to the axis with which the direction makes the largest angle.
    if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
        ux, uy, uz = 0.0, -nz, ny
    elif abs(ny) <= abs(nz):
        ux, uy, uz = nz, 0.0, -nx
    else:
        ux, uy, uz = -ny, nx, 0.0
    depth = 1.0 / distance
    radius = math.sqrt(1.0 - depth * depth)
    scale = radius / math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = scale * ux, scale * uy, scale * uz
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    for i in range(4):
        a, b, c = frame[i, 0], frame[i, 1], frame[i, 2]
        matrix[row, i, 0] = a * ux + b * uy + c * uz
        matrix[row, i, 1] = a * vx + b * vy + c * vz
        matrix[row, i, 2] = depth * (a * nx + b * ny + c * nz) + frame[i, 3]
    return 1


@njit(nogil=True)
def _rulings(quadrics: Quadrics, which: int, x: float, y: float, level: float, matrix: FloatArray, row: int) -> int:
    """Rulings of a quadric at the angles with x cos t + y sin t = level in its unit frame.

    There are two, one where they touch, or none: that many are filled in, from a row on.
    """
    size = math.sqrt(x * x + y * y)
    if size <= 0.0 or abs(level) > size * (1.0 + TOUCHING):
        return 0
    phase, half, count = math.atan2(y, x), math.acos(min(max(level / size, -1.0), 1.0)), 2
    if abs(level) >= size * (1.0 - TOUCHING):
        half, count = (0.0 if level > 0.0 else math.pi), 1
    cone = quadrics.kind[which] == CONE
    low, high = quadrics.height[which, 0], quadrics.height[which, 1]
    for k in range(row, row + count):
        t = phase + half if k == row else phase - half
        u, v = math.cos(t), math.sin(t)
        for i in range(4):
            up, foot = quadrics.frame[which, i, 2], quadrics.frame[which, i, 3]
            across = quadrics.frame[which, i, 0] * u + quadrics.frame[which, i, 1] * v
            # Cylinders: (u, v, z) at height z; cones: z (u, v, 1).
            if cone:
                up += across
            else:
                foot += across
            matrix[k, i, 0], matrix[k, i, 1], matrix[k, i, 2] = (high - low) * up, 0.0, foot + low * up
    return count


def _on_boundary(table: SurfaceTable, group: int, matrix: np.ndarray) -> Wires:
    """The pieces of a quadric's contour where the quadric is the solid's boundary; normalised frame."""
    straight_ones = (matrix[:, :, 1] == 0.0).all(axis=1)
    point, direction = matrix[straight_ones, :3, 2], matrix[straight_ones, :3, 0]
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    straight = line_pieces(table, point, direction, faces=1)
    rows = _owned(straight, group)
    k = straight.curve[rows]
    segment = np.stack(
        [point[k] + straight.low[rows, None] * direction[k], point[k] + straight.high[rows, None] * direction[k]],
        axis=1,
    )
    conic = matrix[~straight_ones]
    curved = conic_pieces(table, conic, np.zeros((0, 4)), faces=1)
    rows = _owned(curved, group)
    return Wires(segment, conic[curved.curve[rows]], curved.low[rows], curved.high[rows])


def _owned(pieces: Pieces, group: int) -> np.ndarray:
    """(k,) int: pieces where the group is a smooth sheet of the boundary."""
    rows = np.unique(pieces.branches.point[pieces.branches.group == group])
    owned: IntArray = rows[~pieces.branches.crease[rows]]
    return owned
