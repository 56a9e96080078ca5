"""More about a boundary: its faces and vertices, the faces and dihedral angle of every edge, its box and volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from msgs_py.numeric.grouping import cluster
from msgs_py.numeric.typed import FloatArray

from .conics import positions
from .curved_faces import curved_faces
from .faces import FacePart, Outline, planar_faces, quadrature
from .neighbourhood import Branches, classify, faces_through
from .pieces import Pieces, Runs
from .settings import (
    ANGLE_ROUNDING,
    APEX_DISTANCE,
    APEX_POINTS,
    BOX_POINTS,
    QUADRATURE_ERROR,
    SAME_VERTEX,
    SHORTEST_RANGE,
    VOLUME_ROUNDING,
    VOLUME_SAMPLES,
    VOLUME_SIGMAS,
    WHOLE_TURN,
)
from .space_curves import SpaceCurvePieces
from .surfaces import SurfaceTable


@dataclass(frozen=True, eq=False)
class Face:
    """A maximal connected piece of one plane or quadric.

    Parameters
    ----------
    kind : str
        'plane', 'cylinder', 'cone' or 'sphere': the primitive's surface before its affine placement.
    normal : (3,) float64 or None
        Unit vector out of the solid, model frame; None for a curved face.
    area : float, square metres
    """

    kind: str
    normal: np.ndarray | None
    area: float


@dataclass(frozen=True, eq=False)
class Details:
    """Faces, vertices and measures of a solid; model frame, metres.

    Parameters
    ----------
    faces : tuple of Face
    vertices : (v, 3) float64
        Where creases end or a cone has its apex.
    edge_faces : (e, 2) int32
        The two faces of each edge of the boundary, -1 where more than two meet.
    edge_angles : (e,) float64, radians
        Dihedral angle through the material (pi/2 on a block); NaN where more than two faces meet.
    curve_faces, curve_angles : (k, 2) int32 and (k,) float64
        The same for the planar curves, the angle in the middle of the curve.
    low, high : (3,) float64
        Bounding box.
    area, volume : float, square and cubic metres
        Of the whole solid.
    notices : tuple of str
        What could not be measured exactly, in words.
    """

    faces: tuple[Face, ...]
    vertices: np.ndarray
    edge_faces: np.ndarray
    edge_angles: np.ndarray
    curve_faces: np.ndarray
    curve_angles: np.ndarray
    low: np.ndarray
    high: np.ndarray
    area: float
    volume: float
    notices: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Intermediate results of boundary evaluation, normalised frame.

    Parameters
    ----------
    table : SurfaceTable
    point, direction : (n, 3) float64
        Candidate lines.
    conic : (c, 4, 3) float64
        Candidate conics.
    straight, curved : Pieces
        Of the lines and of the conics.
    space_curves : SpaceCurvePieces
    edges, curves : Runs
        Creases, of the lines and of the conics.
    """

    table: SurfaceTable
    point: np.ndarray
    direction: np.ndarray
    conic: np.ndarray
    straight: Pieces
    curved: Pieces
    space_curves: SpaceCurvePieces
    edges: Runs
    curves: Runs


def details(anatomy: Anatomy) -> Details:
    """Faces, vertices, angles, box, area and volume of an evaluated boundary."""
    table = anatomy.table
    outlines, branches, first_curved = _outlines(anatomy)
    flat, flat_owner = planar_faces(table, outlines, branches)
    round_, round_owner = curved_faces(table, outlines, branches)
    owner = np.full(len(branches.group), -1)
    for row, face in flat_owner.items():
        owner[row] = face
    for row, face in round_owner.items():
        owner[row] = len(flat) + face
    parts = flat + round_
    edge_faces, edge_angles = _sides(branches, owner, anatomy.edges.piece)
    curve_faces, curve_angles = _sides(branches, owner, anatomy.curves.piece + first_curved)
    vertices = _vertices(anatomy)
    low, high = _box(anatomy, vertices)
    faces = tuple(_face(table, part) for part in parts)
    volume = table.size**3 * sum(part.flux for part in parts) / 3.0
    estimate, error = _sampled_volume(table, low, high)
    notices: tuple[str, ...] = ()
    if abs(volume - estimate) > VOLUME_SIGMAS * error + VOLUME_ROUNDING * table.size**3:
        volume, notices = (
            estimate,
            (
                'the faces do not close: the volume is estimated by sampling, and faces and areas '
                'are incomplete (surfaces much thinner in one direction than in another)',
            ),
        )
    return Details(
        faces,
        table.metres(vertices),
        edge_faces,
        edge_angles,
        curve_faces,
        curve_angles,
        low,
        high,
        sum(face.area for face in faces),
        volume,
        notices,
    )


def _sampled_volume(table: SurfaceTable, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
    """Volume by sampling the bounding box, cubic metres, and its standard error: a check on the exact value."""
    if not np.isfinite(low).all():
        return 0.0, 0.0
    box = float(np.prod(high - low))
    points = low + np.random.default_rng(0).random((VOLUME_SAMPLES, 3)) * (high - low)
    part = float(table.contains(table.normalised(points)).mean())
    # One sample more on either side, so that the error is not zero where none or all are inside.
    return part * box, box * float(np.sqrt((part * (1.0 - part) + 1.0 / VOLUME_SAMPLES) / VOLUME_SAMPLES))


def _outlines(anatomy: Anatomy) -> tuple[list[Outline], Branches, int]:
    """All boundary pieces with quadratures, their branches in one table, and where the curved pieces start."""
    sets = (anatomy.straight, anatomy.curved, anatomy.space_curves.pieces)
    offset = np.cumsum([0] + [len(s.low) for s in sets])
    branches = Branches(
        np.concatenate([s.branches.point + k for s, k in zip(sets, offset)]),
        *(
            np.concatenate([getattr(s.branches, name) for s in sets])
            for name in ('group', 'direction', 'outward', 'crease', 'signature')
        ),
    )
    rows = [np.nonzero(branches.point == k)[0] for k in range(offset[-1])]
    outlines = []
    for k, (pieces, start) in enumerate(zip(sets, offset)):
        for j in range(len(pieces.low)):
            low, high = pieces.low[j], pieces.high[j]
            if k == 0:
                line = pieces.curve[j]
                t, weight = np.array([0.5 * (low + high)]), np.array([high - low])
                nodes = anatomy.point[line] + t[:, None] * anatomy.direction[line]
                steps = weight[:, None] * anatomy.direction[line]
                ends = anatomy.point[line] + np.array([[low], [high]]) * anatomy.direction[line]
            else:
                curve = partial(anatomy.space_curves.steps, int(pieces.curve[j]))
                if k == 1:
                    curve = partial(_conic_steps, anatomy.conic[pieces.curve[j]])
                ends = curve(np.array([low, high]), np.ones(2))[0]
                nodes, steps = _curve_quadrature(curve, low, high)
            if not (np.isfinite(ends).all() and np.isfinite(nodes).all()):
                continue  # next to infinity, where a nearly flat quadric can put a crossing
            outlines.append(
                Outline(ends[0], ends[1], nodes, steps, pieces.middle[j], pieces.tangent[j], rows[start + j])
            )
    return outlines, branches, int(offset[1])


def _curve_quadrature(
    curve: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]], low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points and differentials (n, 3) of a curve for integrals along it.

    The differentials of a piece must add up to the way between its ends. Where they do not, as on a hyperbola's branch
    that comes from far away, the piece is halved.
    """
    nodes, steps, waiting = [], [], [(low, high)]
    while waiting:
        a, b = waiting.pop()
        points, differentials = curve(*quadrature(a, b))
        ends = curve(np.array([a, b]), np.ones(2))[0]
        missed = np.abs(ends[1] - ends[0] - differentials.sum(axis=0)).max()
        if missed > QUADRATURE_ERROR and b - a > SHORTEST_RANGE:
            waiting += [(0.5 * (a + b), b), (a, 0.5 * (a + b))]
        else:
            nodes.append(points)
            steps.append(differentials)
    return np.concatenate(nodes), np.concatenate(steps)


def _conic_steps(conic: np.ndarray, t: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of a conic (4, 3) at angles t (n,), and its differentials (n, 3) for quadrature weights (n,)."""
    x = np.stack([np.cos(t), np.sin(t), np.ones_like(t)], axis=1) @ conic.T
    dx = np.stack([-np.sin(t), np.cos(t), np.zeros_like(t)], axis=1) @ conic.T
    w, dw = x[:, 3:], dx[:, 3:]
    return x[:, :3] / w, weight[:, None] * (dx[:, :3] * w - x[:, :3] * dw) / w**2


def _sides(branches: Branches, owner: np.ndarray, piece: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two faces (n, 2) int32 and the angle (n,) between them at some pieces."""
    faces, angles = np.full((len(piece), 2), -1, np.int32), np.full(len(piece), np.nan)
    for k, p in enumerate(piece):
        rows = np.nonzero(branches.point == p)[0]
        if len(rows) != 2:
            continue
        faces[k] = owner[rows]
        one, two = branches.direction[rows]
        angle = np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two)
        # An edge is concave where one face lies on the outer side of the other.
        angles[k] = angle if branches.outward[rows[0]] @ two <= 0.0 else 2.0 * np.pi - angle
    return faces, angles


def _vertices(anatomy: Anatomy) -> np.ndarray:
    """(v, 3), normalised: the ends of all creases that have ends, and the apexes that remain."""
    table, edges, curves = anatomy.table, anatomy.edges, anatomy.curves
    point, direction = anatomy.point[edges.curve], anatomy.direction[edges.curve]
    found = [point + edges.low[:, None] * direction, point + edges.high[:, None] * direction]
    open_ = curves.high - curves.low < WHOLE_TURN
    for angle in (curves.low[open_], curves.high[open_]):
        found.append(positions(anatomy.conic[curves.curve[open_]], angle)[0])
    found += [
        samples[[0, -1]]
        for samples in anatomy.space_curves.creases
        if np.linalg.norm(samples[0] - samples[-1]) > SAME_VERTEX
    ]
    apexes = [table.frames[leaf][:3, 3] for leaf in table.quadric_leaf if table.leaves[leaf].kind == 'CONE']
    if apexes:
        at = np.array(apexes)
        found.append(at[_apex_remains(table, at)])
    points = np.concatenate(found)
    distinct: FloatArray = points[cluster(points, SAME_VERTEX)[1]]
    return distinct


def _apex_remains(table: SurfaceTable, at: np.ndarray) -> np.ndarray:
    """(n,) bool: of points round an apex, on a Fibonacci sphere, some are inside the solid and some are not."""
    k = np.arange(APEX_POINTS) + 0.5
    polar, azimuth = np.arccos(1.0 - k / (APEX_POINTS / 2.0)), np.pi * (1.0 + 5.0**0.5) * k
    ball = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    around = (at[:, None] + APEX_DISTANCE * ball).reshape(-1, 3)
    solid = table.contains(around).reshape(len(at), -1)
    return np.asarray(solid.any(axis=1) & ~solid.all(axis=1))


def _box(anatomy: Anatomy, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounding box, metres: ends of creases, extremes of curves and of spheres; ruled faces have theirs on a border."""
    table, curves = anatomy.table, anatomy.curves
    points = [vertices, *anatomy.space_curves.creases]
    for curve, low, high in zip(curves.curve, curves.low, curves.high):
        conic = anatomy.conic[curve]
        # d/dt of a coordinate vanishes: tan t = b / a, and for homogeneous curves a sampling is enough.
        angle = np.arctan2(conic[:3, 1], conic[:3, 0])
        angle = np.concatenate([angle, angle + np.pi, np.linspace(low, high, BOX_POINTS)])
        angle = low + (angle - low) % (2.0 * np.pi)
        points.append(_conic_steps(conic, angle[angle <= high + ANGLE_ROUNDING], np.ones(1))[0])
    for k, leaf in enumerate(table.quadric_leaf):
        if table.leaves[leaf].kind == 'SPHERE':
            linear, centre = table.frames[leaf][:3, :3], table.frames[leaf][:3, 3]
            reach = linear @ linear.T / np.linalg.norm(linear, axis=1)
            extreme = np.concatenate([centre + reach.T, centre - reach.T])
            across = np.tile(np.roll(np.eye(3), 1, axis=1), (2, 1))
            on = faces_through(table, extreme)[:, len(table.planes) + k]
            points.append(extreme[on][np.unique(classify(table, extreme[on], across[on]).point)])
    cloud = np.concatenate(points)
    if not len(cloud):
        return np.full(3, np.nan), np.full(3, np.nan)
    return table.metres(cloud.min(axis=0)), table.metres(cloud.max(axis=0))


def _face(table: SurfaceTable, part: FacePart) -> Face:
    """A face in the model frame, metres."""
    g = len(table.planes)
    area = part.area * table.size**2
    if part.group < g:
        return Face('plane', table.planes[part.group, :3] * (1.0 if part.along else -1.0), area)
    return Face(table.leaves[table.quadric_leaf[part.group - g]].kind.lower(), None, area)
