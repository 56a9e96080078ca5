"""Faces of a solid from the pieces of curve that bound them: planar faces, with exact areas.

The branches of every piece of boundary curve give the surfaces that go on from it as faces, on which side, and their
outward normals. Oriented so that the face lies to the left, the pieces of one plane chain into loops; a loop that turns
left bounds a face and one that turns right a hole in it. Areas follow from Green's theorem, exactly for lines and
ellipses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.grouping import cluster
from msgs_py.numeric.vectors import perpendicular

from .neighbourhood import Branches
from .settings import CORNER_REACH, NO_LENGTH, QUADRATURE_NODES, QUADRATURE_RANGE, SAME_TURN, SAME_VERTEX
from .surfaces import SurfaceTable

NODES, WEIGHTS = np.polynomial.legendre.leggauss(QUADRATURE_NODES)


@dataclass(frozen=True, eq=False)
class Outline:
    """One piece of boundary curve, sampled for integration; normalised frame.

    Parameters
    ----------
    start, end : (3,) float64
    nodes, steps : (n, 3) float64
        Points of a quadrature, and the curve's differentials there: weights times derivative.
    middle, tangent : (3,) float64
        A point of the piece and the unit tangent there.
    branches : (b,) int
        Rows of ``Branches`` that leave the piece.
    """

    start: np.ndarray
    end: np.ndarray
    nodes: np.ndarray
    steps: np.ndarray
    middle: np.ndarray
    tangent: np.ndarray
    branches: np.ndarray


@dataclass(frozen=True, eq=False)
class FacePart:
    """A face, normalised frame.

    Parameters
    ----------
    group : int
        Its surface group.
    along : bool
        Its outward normal is the group's gradient, not the opposite direction.
    area, flux : float
        Its area, and the integral of x.n dA.
    """

    group: int
    along: bool
    area: float
    flux: float


def quadrature(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on a range; the range is halved until short, for curves of several turns."""
    pieces = max(1, int(np.ceil((high - low) / QUADRATURE_RANGE)))
    borders = np.linspace(low, high, pieces + 1)
    half = 0.5 * np.diff(borders)[:, None]
    return (
        (0.5 * (borders[1:] + borders[:-1])[:, None] + half * NODES).ravel(),
        np.broadcast_to(half * WEIGHTS, (pieces, len(NODES))).ravel(),
    )


def planar_faces(
    table: SurfaceTable, outlines: Sequence[Outline], branches: Branches
) -> tuple[list[FacePart], dict[int, int]]:
    """All planar faces of a solid.

    Parameters
    ----------
    table : SurfaceTable
    outlines : sequence of Outline
        All pieces of boundary curve.
    branches : Branches
        The branches that leave them.

    Returns
    -------
    faces : list of FacePart
    owner : dict of int to int
        Which face each row of branches belongs to.
    """
    borders: dict[tuple[int, bool], list[tuple[int, int, bool]]] = {}
    for k, outline in enumerate(outlines):
        rows = outline.branches[branches.group[outline.branches] < len(table.planes)]
        for row in rows:
            group = int(branches.group[row])
            normal = table.planes[group, :3]
            along = bool(branches.outward[row] @ normal > 0.0)
            same = rows[(branches.group[rows] == group) & ((branches.outward[rows] @ normal > 0.0) == along)]
            if len(same) > 1:
                continue  # the piece lies inside the face
            looks = normal if along else -normal
            left = bool(np.cross(looks, outline.tangent) @ branches.direction[row] > 0.0)
            borders.setdefault((group, along), []).append((k, int(row), left))
    faces: list[FacePart] = []
    owner: dict[int, int] = {}
    for (group, along), items in sorted(borders.items()):
        normal = table.planes[group, :3] * (1.0 if along else -1.0)
        offset = table.planes[group, 3] * (1.0 if along else -1.0)
        loops = _loops([outlines[k] for k, _, _ in items], [left for _, _, left in items], normal)
        outer = [loop for loop in loops if loop.area > 0.0]
        areas = [loop.area for loop in outer]
        index = {id(loop): len(faces) + k for k, loop in enumerate(outer)}
        for loop in loops:
            if loop.area <= 0.0:
                around = [k for k, other in enumerate(outer) if _contains(other.polygon, loop.polygon[0])]
                if not around:
                    continue
                k = min(around, key=lambda k: outer[k].area)
                areas[k] += loop.area
                index[id(loop)] = len(faces) + k
        for loop in loops:
            for member in loop.members:
                if id(loop) in index:
                    owner[items[member][1]] = index[id(loop)]
        faces += [FacePart(group, along, area, -offset * area) for area in areas]
    return faces, owner


@dataclass(eq=False)
class _Loop:
    """A closed chain of pieces: their indices, its signed area, and its points (n, 2) in the plane."""

    members: list[int]
    area: float
    polygon: np.ndarray


def _loops(outlines: list[Outline], left: list[bool], normal: np.ndarray) -> list[_Loop]:
    """Chain oriented pieces of one plane; where several leave a vertex, each face keeps to its own corner."""
    first = perpendicular(normal)
    frame = np.stack([first, np.cross(normal, first)], axis=1)
    start = np.array([o.start if forward else o.end for o, forward in zip(outlines, left)])
    end = np.array([o.end if forward else o.start for o, forward in zip(outlines, left)])
    vertex = cluster(np.concatenate([start, end]), SAME_VERTEX)[0]
    begins, stops = vertex[: len(start)], vertex[len(start) :]
    points = [(o.nodes if forward else o.nodes[::-1]) @ frame for o, forward in zip(outlines, left)]
    flat_start, flat_end = start @ frame, end @ frame
    steps = [(o.steps if forward else -o.steps[::-1]) @ frame for o, forward in zip(outlines, left)]
    leaving = [_Ray.at(s, p[0], d[0]) for s, p, d in zip(flat_start, points, steps)]
    back = [_Ray.at(e, p[-1], -d[-1]) for e, p, d in zip(flat_end, points, steps)]
    successor = []
    for k in range(len(outlines)):
        choices = np.nonzero(begins == stops[k])[0]
        # The face is on the left, so its corner opens clockwise from the direction back along the piece. Curves that
        # touch at the vertex differ in curvature, and so in direction at a distance from it.
        reach = CORNER_REACH * min([back[k].reach, *(leaving[j].reach for j in choices)])
        turn = [(back[k].angle(reach) - leaving[j].angle(reach)) % (2.0 * np.pi) for j in choices]
        turn = [2.0 * np.pi if t < SAME_TURN else t for t in turn]
        successor.append(int(choices[int(np.argmin(turn))]) if len(choices) else -1)
    loops, used = [], [False] * len(outlines)
    for k in range(len(outlines)):
        members: list[int] = []
        while k >= 0 and not used[k]:
            used[k] = True
            members.append(k)
            k = successor[k]
        if members:
            area = sum(
                (1.0 if left[j] else -1.0)
                * 0.5
                * float((np.cross(outlines[j].nodes - outlines[members[0]].start, outlines[j].steps) @ normal).sum())
                for j in members
            )
            loops.append(_Loop(members, area, np.concatenate([np.vstack([flat_start[j], points[j]]) for j in members])))
    return loops


@dataclass(frozen=True)
class _Ray:
    """How a plane curve leaves a vertex.

    Attributes
    ----------
    tangent
        Its direction there, radians.
    bend
        Change of a chord's direction with its length.
    reach
        Length of the chord from which they were computed.
    """

    tangent: float
    bend: float
    reach: float

    @classmethod
    def at(cls, vertex: np.ndarray, near: np.ndarray, step: np.ndarray) -> _Ray:
        """From a point near the vertex and the curve's direction there; between them the curve is taken for an arc."""
        chord = near - vertex
        angle, reach = float(np.arctan2(chord[1], chord[0])), float(np.linalg.norm(chord))
        half = (float(np.arctan2(step[1], step[0])) - angle + np.pi) % (2.0 * np.pi) - np.pi
        return cls(angle - half, half / max(reach, NO_LENGTH), reach)

    def angle(self, distance: float) -> float:
        """Direction, radians, of the chord to the point at this distance."""
        return self.tangent + self.bend * distance


def _contains(polygon: np.ndarray, point: np.ndarray) -> bool:
    """Even-odd rule in the plane."""
    x, y = (polygon - point).T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    crosses = (y > 0.0) != (y2 > 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        at = x - y * (x2 - x) / (y2 - y)
    return bool((crosses & (at > 0.0)).sum() % 2)
