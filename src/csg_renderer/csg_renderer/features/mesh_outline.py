"""What a camera sees of a mesh, as points along it: creases and occluding contours, evenly spaced in the image.

The round surfaces that facets stand for are smooth again (``mesh.normals``, ``mesh_contours``): whether something is
seen is asked of the facets themselves, and where it is seen of the surface through their vertices.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from msgs_py import FeatureSet, PinholeCamera, Pose
from msgs_py.numeric.compiled import njit
from msgs_py.numeric.steps import CompileStep
from msgs_py.numeric.typed import FloatArray, Int32Array, IntArray

from ..mesh.facets import Facets
from ..mesh.normals import RoundFacets, round_facets
from ..mesh.rays import TriangleTree, blocked, nearest_hits, triangle_tree
from ..mesh.settings import CREASE_ANGLE, EVEN
from ..visibility.outline import OutlinePoints, camera_row
from ..visibility.outline_points import image_step
from .mesh_contours import Wires, cubic, cubic_slope, lengthen, mesh_contours
from .mesh_curves import FittedConic
from .mesh_features import Creases, creases_of, features_of
from .settings import BEFORE_POINT, CLEARANCE, END_ON, WIRE_PIECES


class MeshOutline:
    """The outline of a triangle mesh from any viewpoint.

    Creases are its matching features and what else turns by more than the crease angle. Elsewhere facets stand for a
    smooth surface: rims are bent to their circles, and contours run where its normal is at right angles to the line of
    sight, not along the facets' edges. Of a cylinder of 24 facets that is right to a ten-thousandth of its radius, of
    64 to two millionths, where the facets themselves are off by a hundredth and by a thousandth.

    Parameters
    ----------
    vertices : (n, 3) float64
        Metres.
    triangles : (m, 3) int
        Rows of ``vertices``, anticlockwise as seen from outside; of a closed mesh, all or none.
    crease_angle : float
        Radians. Neighbouring triangles that turn by more meet in a crease.

    Attributes
    ----------
    vertices, triangles
        As they are used: vertices welded, triangles without area left out.
    features : FeatureSet
        The same as of :func:`.mesh_features.mesh_features`.

    Raises
    ------
    ValueError
        It has more creases than an object with edges has.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> outline = MeshOutline(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    >>> pose = Pose(np.eye(3), np.array([-0.2, -0.2, 4.0]))  # the face in z = 0 hides the corner behind it
    >>> seen = outline.visible(pose, PinholeCamera.centred(640, 480, 500.0), 4.0)
    >>> np.unique(seen.curve).size
    3
    """

    def __init__(self, vertices: FloatArray, triangles: IntArray, crease_angle: float = CREASE_ANGLE) -> None:
        facets = Facets.of(vertices, triangles, crease_angle)
        creases = creases_of(facets)
        self.vertices, self.triangles = facets.points, facets.triangles
        self.features: FeatureSet = features_of(facets, creases)
        self._facets, self._creases = facets, creases

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner, each (3,) float64, metres, model frame."""
        used = self.vertices[self.triangles.ravel()]
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def centre(self) -> FloatArray:
        """The middle of the bounding box, (3,) float64, metres, model frame."""
        return 0.5 * (self.box[0] + self.box[1])

    @cached_property
    def size(self) -> float:
        """Diagonal of the bounding box, metres."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))

    @cached_property
    def _tree(self) -> TriangleTree:
        return triangle_tree(self.vertices[self.triangles])

    @cached_property
    def _round(self) -> RoundFacets:
        return round_facets(self._facets)

    @cached_property
    def _wires(self) -> tuple[Wires, Int32Array]:
        """The creases, and the feature that each is."""
        return _crease_wires(self._creases)

    def visible(self, pose: Pose, camera: PinholeCamera, spacing: float) -> OutlinePoints:
        """Points of the creases and contours that a camera sees.

        Parameters
        ----------
        pose : Pose
            camera_T_model.
        camera : PinholeCamera
        spacing : float
            Pixels between neighbouring points.

        Returns
        -------
        OutlinePoints
        """
        wires, feature = self._wires
        row, clearance = camera_row(pose, camera), CLEARANCE * self.size
        spacing = float(spacing)  # a whole number is another type, for which all would be compiled anew
        n, rows, numbers = _seen_points(self._tree, wires, feature, self._round, row, spacing, clearance)
        return OutlinePoints(rows[:n, :3], rows[:n, 3:6], numbers[:n, 0], numbers[:n, 1], rows[:n, 6:9], rows[:n, 9])

    def surface(self, pose: Pose, camera: PinholeCamera, pixels: FloatArray) -> FloatArray:
        """Where the facets are seen.

        Parameters
        ----------
        pose : Pose
            camera_T_model.
        camera : PinholeCamera
        pixels : (n, 2) float64

        Returns
        -------
        (n, 3) float64
            Metres, model frame; not a number where there is none.
        """
        back = pose.inverse()
        ray = back.rotate(camera.rays(pixels))
        seen: FloatArray = back.translation + nearest_hits(self._tree, back.translation, ray)[0][:, None] * ray
        return seen


def compile_steps() -> tuple[CompileStep, ...]:
    """What the outline of a mesh needs compiled, as that of a short rod of sixteen sides."""

    def look() -> None:
        turn = np.arange(16) * np.pi / 8.0
        ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(16)], axis=1)
        k, after = np.arange(16), np.roll(np.arange(16), -1)
        fan = np.stack([np.zeros(14, int), k[1:15], k[2:]], axis=1)
        sides = [np.stack([k, after, after + 16], axis=1), np.stack([k, after + 16, k + 16], axis=1)]
        rod = MeshOutline(
            np.concatenate([ring, ring + [0.0, 0.0, 1.0]]), np.concatenate([*sides, fan[:, ::-1], fan + 16])
        )
        pose, camera = Pose.from_rotation_vector([1.0, 0.5, 0.0], [0.0, 0.0, 5.0]), PinholeCamera.centred(32, 32, 40.0)
        rod.visible(pose, camera, 4.0)
        rod.surface(pose, camera, np.array([[16.0, 16.0]]))

    return (CompileStep('outlines of meshes', look),)


def _crease_wires(creases: Creases) -> tuple[Wires, Int32Array]:
    """Creases as compiled functions take them, and the row of the features (c,) that each is or -1."""
    lines, kinds = list(creases.ends), len(creases.ends) + len(creases.rims)
    points = [*lines, *(rim.points for rim in creases.rims), *creases.others]
    slopes = [np.stack([np.diff(ends, axis=0)] * 2) for ends in lines]
    slopes += [_conic_slopes(rim.points, rim.conic) for rim in creases.rims]
    slopes += [_chain_slopes(points) for points in creases.others]
    begin = np.cumsum([0, *(len(one) for one in points)]).astype(np.int32)
    at = np.concatenate([np.zeros((0, 3)), *points])
    wires = Wires(at, at, np.zeros_like(at), np.zeros_like(at), np.zeros_like(at), np.zeros_like(at), begin)
    for first, (leave, arrive) in zip(begin, slopes):
        rows = slice(first, first + len(leave))
        wires.leave[rows], wires.arrive[rows] = leave, arrive
    feature = np.full(len(points), -1, np.int32)
    feature[:kinds] = np.arange(kinds)
    return wires, feature


def _conic_slopes(points: FloatArray, conic: FittedConic) -> FloatArray:
    """Derivatives at both ends of each piece, (2, k, 3), of a conic through points (k + 1, 3)."""
    minor = np.cross(conic.normal, conic.major_axis)
    x, y = ((points - conic.centre) @ axis / radius for axis, radius in zip((conic.major_axis, minor), conic.radii))
    tangent = conic.radii[1] * x[:, None] * minor - conic.radii[0] * y[:, None] * conic.major_axis
    step = np.diff(points, axis=0)
    tangent *= np.sign((tangent[:-1] * step).sum())
    return _as_long(np.stack([tangent[:-1], tangent[1:]]), step)


def _chain_slopes(points: FloatArray) -> FloatArray:
    """The same of a space curve: at each point it runs as the circle through it and its neighbours does.

    A straight piece that runs smoothly into short ones stays straight.
    """
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    unit = step / length
    tangent = np.empty_like(points)
    tangent[0], tangent[-1] = step[0], step[-1]
    before, after = length[:-1], length[1:]
    inner = unit[:-1] * after + unit[1:] * before
    inner = np.where(before > EVEN * after, unit[:-1], np.where(after > EVEN * before, unit[1:], inner))
    tangent[1:-1] = inner
    if (points[0] == points[-1]).all():
        tangent[0] = tangent[-1] = unit[0] * length[-1] + unit[-1] * length[0]
    return _as_long(np.stack([tangent[:-1], tangent[1:]]), step)


def _as_long(slopes: FloatArray, step: FloatArray) -> FloatArray:
    """Derivatives (2, k, 3) with the lengths of arcs over steps (k, 3)."""
    slopes = np.ascontiguousarray(slopes)
    for k, chord in enumerate(np.linalg.norm(step, axis=1)):
        lengthen(slopes[0, k], slopes[1, k], float(chord))
    return slopes


@njit(nogil=True)
def _seen_points(
    tree: TriangleTree,
    creases: Wires,
    feature: Int32Array,
    surface: RoundFacets,
    camera: FloatArray,
    spacing: float,
    clearance: float,
) -> tuple[int, FloatArray, Int32Array]:
    """Points of the creases and contours that a camera sees.

    Parameters
    ----------
    tree : TriangleTree
    creases : Wires
    feature : (c,) int32
        Row of the features that each crease is.
    surface : RoundFacets
    camera : (18,) float64
        As of :func:`..visibility.outline.camera_row`.
    spacing : float
        Pixels between neighbouring points.
    clearance : float
        Metres above the surface from which a point of it is seen.

    Returns
    -------
    n : int
        How many there are.
    rows : (m, 10) float64
        Of the first n: point (metres), unit tangent, unit normal out of the surface (zero on creases), pixels that it
        stands for; model frame.
    numbers : (m, 2) int32
        Of the first n: curve (creases, then contours) and feature.
    """
    eye = np.empty(3)
    scale = camera[0] * camera[0] + camera[1] * camera[1] + camera[2] * camera[2]
    for i in range(3):
        eye[i] = -(camera[i] * camera[9] + camera[3 + i] * camera[10] + camera[6 + i] * camera[11]) / scale
    contours = mesh_contours(surface, eye, clearance)
    one, two = _lengths(creases, camera), _lengths(contours, camera)
    room = 0
    for c in range(len(creases.begin) - 1):
        room += math.ceil(one[1][one[0][c + 1] - 1] / spacing)
    for c in range(len(contours.begin) - 1):
        room += math.ceil(two[1][two[0][c + 1] - 1] / spacing)
    rows, numbers = np.empty((room, 10)), np.empty((room, 2), np.int32)
    n = _add_points(tree, creases, one, eye, spacing, clearance, 0, rows, numbers, 0)
    for k in range(n):
        numbers[k, 1] = feature[numbers[k, 0]]
    first = n
    n = _add_points(tree, contours, two, eye, spacing, clearance, len(creases.begin) - 1, rows, numbers, n)
    for k in range(first, n):
        numbers[k, 1] = -1
    return n, rows, numbers


@njit(nogil=True)
def _pieces(wires: Wires, c: int) -> int:
    """In how many pieces the image of each step of a curve is measured."""
    pieces: int = 1 + (WIRE_PIECES - 1) // max(wires.begin[c + 1] - wires.begin[c] - 1, 1)
    return pieces


@njit(nogil=True)
def _lengths(wires: Wires, camera: FloatArray) -> tuple[Int32Array, FloatArray]:
    """Knots along the image of each curve; what lies behind the camera or outside the image has no length.

    Returns
    -------
    begin : (c + 1,) int32
        First knot of each curve, and the end of the last.
    along : (k,) float64
        Pixels from the curve's first one.
    """
    curves = len(wires.begin) - 1
    begin = np.zeros(curves + 1, np.int32)
    for c in range(curves):
        begin[c + 1] = begin[c] + (wires.begin[c + 1] - wires.begin[c] - 1) * _pieces(wires, c) + 1
    along = np.empty(begin[curves])
    for c in range(curves):
        pieces = _pieces(wires, c)
        length, u, v = 0.0, math.nan, math.nan
        for k in range(begin[c + 1] - begin[c]):
            j = min(wires.begin[c] + k // pieces, wires.begin[c + 1] - 2)
            s = (k - (j - wires.begin[c]) * pieces) / pieces
            h0, h1, h2, h3 = cubic(s)
            p, q, d, e = wires.point[j], wires.point[j + 1], wires.leave[j], wires.arrive[j]
            x = h0 * p[0] + h1 * d[0] + h2 * q[0] + h3 * e[0]
            y = h0 * p[1] + h1 * d[1] + h2 * q[1] + h3 * e[1]
            z = h0 * p[2] + h1 * d[2] + h2 * q[2] + h3 * e[2]
            step, u, v = image_step(
                camera,
                camera[0] * x + camera[1] * y + camera[2] * z + camera[9],
                camera[3] * x + camera[4] * y + camera[5] * z + camera[10],
                camera[6] * x + camera[7] * y + camera[8] * z + camera[11],
                u,
                v,
            )
            length += step
            along[begin[c] + k] = length
    return begin, along


@njit(nogil=True)
def _add_points(
    tree: TriangleTree,
    wires: Wires,
    knots: tuple[Int32Array, FloatArray],
    eye: FloatArray,
    spacing: float,
    clearance: float,
    first: int,
    rows: FloatArray,
    numbers: Int32Array,
    n: int,
) -> int:
    """Put the points of curves that are seen into rows from n on, the curves counted from ``first``; where they end.

    knots : see :func:`_lengths`; rows, numbers : see :func:`_seen_points`
    """
    begin, along = knots
    target = np.empty(3)
    for c in range(len(wires.begin) - 1):
        pieces = _pieces(wires, c)
        total, j = along[begin[c + 1] - 1], begin[c]
        count = math.ceil(total / spacing)
        for rank in range(count):
            want = (rank + 0.5) * total / count
            while j < begin[c + 1] - 2 and along[j + 1] < want:
                j += 1
            gap = along[j + 1] - along[j]
            knot = j - begin[c] + ((want - along[j]) / gap if gap > 0.0 else 0.0)
            k = wires.begin[c] + min(int(knot / pieces), wires.begin[c + 1] - wires.begin[c] - 2)
            s = knot / pieces - (k - wires.begin[c])
            _place(wires, k, s, eye, rows[n])
            for i in range(3):
                # On the facets, whose edge a crease is; the surface above them it is that a contour runs on.
                target[i] = wires.flat[k, i] + s * (wires.flat[k + 1, i] - wires.flat[k, i])
                target[i] += wires.away[k, i] - eye[i]
            length = math.sqrt(target[0] * target[0] + target[1] * target[1] + target[2] * target[2])
            end = 1.0 - BEFORE_POINT * clearance / length
            if blocked(tree, eye[0], eye[1], eye[2], target[0], target[1], target[2], end):
                continue
            rows[n, 9] = total / count
            numbers[n, 0] = first + c
            n += 1
    return n


@njit(nogil=True)
def _place(wires: Wires, k: int, s: float, eye: FloatArray, row: FloatArray) -> None:
    """Point, tangent and normal at s of the piece from vertex k on, into a row."""
    h0, h1, h2, h3 = cubic(s)
    d0, d1, d2, d3 = cubic_slope(s)
    square = 0.0
    for i in range(3):
        p, q, leave, arrive = wires.point[k, i], wires.point[k + 1, i], wires.leave[k, i], wires.arrive[k, i]
        row[i] = h0 * p + h1 * leave + h2 * q + h3 * arrive
        row[3 + i] = d0 * p + d1 * leave + d2 * q + d3 * arrive
        row[6 + i] = (1.0 - s) * wires.normal[k, i] + s * wires.normal[k + 1, i]
        square += row[3 + i] * row[3 + i]
    length = math.sqrt(square)
    for i in range(3, 6):
        row[i] = row[i] / length if length > 0.0 else 0.0
    if row[6] == 0.0 and row[7] == 0.0 and row[8] == 0.0:
        return
    # Out of the surface is at right angles to the contour and to the line of sight, but where it is seen end on.
    wx, wy, wz = row[0] - eye[0], row[1] - eye[1], row[2] - eye[2]
    far = math.sqrt(wx * wx + wy * wy + wz * wz)
    nx, ny, nz = row[4] * wz - row[5] * wy, row[5] * wx - row[3] * wz, row[3] * wy - row[4] * wx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length > END_ON * far:
        sign = 1.0 if nx * row[6] + ny * row[7] + nz * row[8] > 0.0 else -1.0
        row[6], row[7], row[8] = sign * nx / length, sign * ny / length, sign * nz / length
    else:
        length = math.sqrt(row[6] * row[6] + row[7] * row[7] + row[8] * row[8])
        row[6], row[7], row[8] = row[6] / length, row[7] / length, row[8] / length
