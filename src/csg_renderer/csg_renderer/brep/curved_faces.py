"""Curved faces of a solid: pieces of cylinders, cones and spheres, their areas and the volume they enclose.

On the unit cylinder, cone and sphere a point has an angle t and a height h, in which area and flux are integrals over h
in closed form for a cylinder, cone, and the flux of a sphere; so by Green's theorem they are integrals along the face's
border. Only the area of an ellipsoid needs a second quadrature.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from msgs_py.numeric.grouping import cluster, linked_groups
from msgs_py.numeric.spatial import rotations
from msgs_py.numeric.typed import FloatArray, IntArray

from .axes import connected
from .faces import NODES, WEIGHTS, FacePart, Outline, quadrature
from .neighbourhood import Branches
from .pieces import conic_pieces, line_pieces
from .settings import (
    AT_POLE,
    BESIDE_BORDER,
    GENERIC_PHASE,
    MERIDIANS,
    NO_DIRECTION,
    ON_AXIS,
    POLAR_PLANES,
    POLE_TRIALS,
    SAME_VERTEX,
    SLIVER_AREA,
)
from .surfaces import SurfaceTable


def curved_faces(
    table: SurfaceTable, outlines: Sequence[Outline], branches: Branches
) -> tuple[list[FacePart], dict[int, int]]:
    """All curved faces of a solid, as :func:`planar_faces` gives the planar ones."""
    faces: list[FacePart] = []
    owner: dict[int, int] = {}
    g = len(table.planes)
    for k, leaf in enumerate(table.quadric_leaf):
        rows = [(o, int(row)) for o in outlines for row in o.branches if branches.group[row] == g + k]
        chart = _chart(table.leaves[leaf].kind, table.frames[leaf], [o for o, _ in rows])
        for along in (True, False):
            mine = [(o, row) for o, row in rows if _along(table, g + k, o, branches, row) == along]
            mine = [
                (o, row) for o, row in mine if sum(other is o for other, _ in mine) == 1
            ]  # else the piece lies inside the face
            parts, found = _parts(table, chart, g + k, along, mine, branches)
            for row, label in found.items():
                owner[row] = len(faces) + label
            faces += [FacePart(g + k, along, *part) for part in parts]
    return faces, owner


class _Chart:
    """Angle and height on one placed quadric: X(t, h) in the normalised frame."""

    def __init__(self, kind: str, frame: np.ndarray) -> None:
        self.kind, self.frame, self.inverse = kind, frame, np.linalg.inv(frame)
        linear = frame[:3, :3]
        self.determinant = float(np.linalg.det(linear))
        self.cofactor = self.determinant * np.linalg.inv(linear).T

    def local(self, points: np.ndarray) -> np.ndarray:
        """(n, 3): normalised points in the unit frame."""
        return points @ self.inverse[:3, :3].T + self.inverse[:3, 3]

    def flux(self, t: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Integral from 0 to h of X.N dh, with N dt dh the area vector that points out of the quadric."""
        sign = np.sign(self.determinant)
        origin = self.frame[:3, 3] @ self.cofactor
        c, s = np.cos(t), np.sin(t)
        if self.kind == 'CYLINDER':
            value = (c * origin[0] + s * origin[1] + self.determinant) * h
        elif self.kind == 'CONE':
            value = (c * origin[0] + s * origin[1] - origin[2]) * 0.5 * h * h
        else:
            h = np.clip(h, -1.0, 1.0)
            cap = 0.5 * (h * np.sqrt(1.0 - h * h) + np.arcsin(h))
            value = (c * origin[0] + s * origin[1]) * cap + origin[2] * 0.5 * h * h + self.determinant * h
        flux: FloatArray = sign * value
        return flux

    def area(self, t: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Integral from 0 to h of |N| dh."""
        area: FloatArray
        c, s = np.cos(t), np.sin(t)
        if self.kind == 'CYLINDER':
            area = np.linalg.norm(np.stack([c, s, 0 * c], axis=-1) @ self.cofactor.T, axis=-1) * h
            return area
        if self.kind == 'CONE':
            area = np.linalg.norm(np.stack([c, s, -np.ones_like(c)], axis=-1) @ self.cofactor.T, axis=-1) * 0.5 * h * h
            return area
        # In the angle from the equator the integrand is smooth up to the poles.
        polar = np.arcsin(np.clip(h, -1.0, 1.0))
        at = 0.5 * polar[..., None] * (1.0 + NODES)
        normal = np.stack([np.cos(at) * c[..., None], np.cos(at) * s[..., None], np.sin(at)], axis=-1)
        size = np.linalg.norm(normal @ self.cofactor.T, axis=-1) * np.cos(at)
        area = 0.5 * polar * (size * WEIGHTS).sum(axis=-1)
        return area

    def angle_step(self, nodes: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Step dt along a curve; zero on the axis, where the angle is undefined."""
        p, d = self.local(nodes), steps @ self.inverse[:3, :3].T
        square = p[:, 0] ** 2 + p[:, 1] ** 2
        return np.where(square > ON_AXIS, (p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]) / np.maximum(square, ON_AXIS), 0.0)

    def left(self, point: np.ndarray, tangent: np.ndarray, direction: np.ndarray) -> bool:
        """A tangent direction lies to the left of a curve in the (t, h) plane."""
        p = self.local(point[None])[0]
        a, b = (self.inverse[:3, :3] @ v for v in (tangent, direction))
        outward = np.array([p[0], p[1], {'CYLINDER': 0.0, 'CONE': -p[2], 'SPHERE': p[2]}[self.kind]])
        return bool(np.cross(a, b) @ outward > 0.0)


@lru_cache
def _turns() -> np.ndarray:
    """(24, 4, 4): orientations of a sphere's poles, at which the angle is undefined."""
    turns = np.tile(np.eye(4), (POLE_TRIALS, 1, 1))
    turns[:, :3, :3] = rotations().from_rotvec(2.0 * np.random.default_rng(1).normal(size=(POLE_TRIALS, 3))).as_matrix()
    return turns


def _chart(kind: str, frame: np.ndarray, outlines: Sequence[Outline]) -> _Chart:
    """The chart of one quadric; a sphere's is turned so that its poles are far from all borders."""
    if kind != 'SPHERE':
        return _Chart(kind, frame)
    charts = [_Chart(kind, frame @ turn) for turn in _turns()]
    nodes = np.concatenate([np.zeros((0, 3)), *(o.nodes for o in outlines)])
    return min(charts, key=lambda chart: float(np.abs(chart.local(nodes)[:, 2]).max(initial=0.0)))


def _along(table: SurfaceTable, group: int, outline: Outline, branches: Branches, row: int) -> bool:
    """The face that a branch begins has the group's gradient for its outward normal."""
    gradient = table.gradients(outline.middle[None], np.array([[group]]))[0, 0]
    return bool(branches.outward[row] @ gradient > 0.0)


def _parts(
    table: SurfaceTable, chart: _Chart, group: int, along: bool, borders: list[tuple[Outline, int]], branches: Branches
) -> tuple[list[tuple[float, float]], dict[int, int]]:
    """Area and flux of each connected face of one quadric that looks one way, and the face of each border."""
    left = [chart.left(outline.middle, outline.tangent, branches.direction[row]) for outline, row in borders]
    owner, seeds = _seeds(table, chart, group, borders, left)
    # A face may narrow to a point at a vertex, so there are meridians through all vertices too.
    ends = chart.local(np.array([p for outline, _ in borders for p in (outline.start, outline.end)]).reshape(-1, 3))
    angle = np.concatenate(
        [
            np.arctan2(seeds[:, 1], seeds[:, 0]),
            np.arctan2(ends[:, 1], ends[:, 0]),
            GENERIC_PHASE + 2.0 * np.pi * np.arange(MERIDIANS) / MERIDIANS,
        ]
    )
    row, low, high = _meridians(table, chart, group, along, angle)
    if not len(row):
        return [], {}
    height = seeds[:, 2] if chart.kind != 'SPHERE' else np.arcsin(np.clip(seeds[:, 2], -1.0, 1.0))
    beside = np.full(len(seeds), -1)
    for k in range(len(seeds)):
        on = np.nonzero(row == k)[0]
        if len(on):
            gap = np.maximum(np.maximum(low[on] - height[k], height[k] - high[on]), 0.0)
            beside[k] = on[gap.argmin()]
    label = _linked(connected(angle, row, low, high), owner, beside, _following(borders, left))
    total = np.zeros((int(label.max()) + 1, 2))
    found: dict[int, int] = {}
    sign = 1.0 if along else -1.0
    for k, (outline, branch) in enumerate(borders):
        at = beside[(owner == k) & (beside >= 0)]
        if not len(at):
            continue
        part = found[branch] = int(label[at[0]])
        p = chart.local(outline.nodes)
        t = np.arctan2(p[:, 1], p[:, 0])
        dt = chart.angle_step(outline.nodes, outline.steps)
        turn = -1.0 if left[k] else 1.0
        total[part] += turn * np.array([chart.area(t, p[:, 2]) @ dt, sign * (chart.flux(t, p[:, 2]) @ dt)])
    if chart.kind == 'SPHERE':
        _add_poles(chart, row, low, high, label, sign, total)
    # Only a whole sphere has no border; other parts without one are slivers beside a vertex.
    keep = np.isin(np.arange(len(total)), list(found.values())) | (total[:, 0] > SLIVER_AREA)
    rank = np.cumsum(keep) - 1
    return [(float(a), float(f)) for a, f in total[keep]], {branch: int(rank[part]) for branch, part in found.items()}


def _seeds(
    table: SurfaceTable, chart: _Chart, group: int, borders: list[tuple[Outline, int]], left: list[bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Unit-frame points (n, 3) just inside the face beside each border, some along each, and their border (n,)."""
    owner, points = [], []
    for k, (outline, _) in enumerate(borders):
        pick = np.unique([len(outline.nodes) // 5, len(outline.nodes) // 2, 4 * len(outline.nodes) // 5])
        at, tangent = outline.nodes[pick], outline.steps[pick]
        outward = table.gradients(at, np.full((len(at), 1), group))[:, 0]
        inward = np.cross(outward, tangent) @ chart.inverse[:3, :3].T * (1.0 if left[k] else -1.0)
        inward *= BESIDE_BORDER / np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), NO_DIRECTION)
        points.append(chart.local(at) + inward)
        owner += [k] * len(at)
    return np.array(owner, int), np.concatenate([np.zeros((0, 3)), *points])


def _following(borders: list[tuple[Outline, int]], left: list[bool]) -> list[tuple[int, int]]:
    """Pairs of borders of which the second begins, face to the left, where only the first ends."""
    if not borders:
        return []
    start = np.array([o.start if forward else o.end for (o, _), forward in zip(borders, left)])
    end = np.array([o.end if forward else o.start for (o, _), forward in zip(borders, left)])
    vertex = cluster(np.concatenate([start, end]), SAME_VERTEX)[0]
    begins, stops = vertex[: len(start)], vertex[len(start) :]
    pairs = []
    for k, where in enumerate(stops):
        after = np.nonzero(begins == where)[0]
        if len(after) == 1 and (stops == where).sum() == 1:
            pairs.append((k, int(after[0])))
    return pairs


def _linked(label: np.ndarray, owner: np.ndarray, beside: np.ndarray, following: list[tuple[int, int]]) -> np.ndarray:
    """Labels of intervals, joined where one border, or two that follow each other, run beside several."""
    parts: dict[int, list[int]] = {}
    for border, interval in zip(owner, beside):
        if interval >= 0:
            parts.setdefault(int(border), []).append(int(label[interval]))
    links = [(own[0], other) for own in parts.values() for other in own[1:]]
    links += [(parts[a][0], parts[b][0]) for a, b in following if a in parts and b in parts]
    groups: IntArray = linked_groups(int(label.max()) + 1, links)[label]
    return groups


def _add_poles(
    chart: _Chart, row: np.ndarray, low: np.ndarray, high: np.ndarray, label: np.ndarray, sign: float, total: np.ndarray
) -> None:
    """Add, in place, the side of the (t, h) plane that a pole inside a face is; no border runs along it."""
    t, weight = quadrature(0.0, 2.0 * np.pi)
    for end, pole in ((high, 0.5 * np.pi), (low, -0.5 * np.pi)):
        at = np.nonzero(np.abs(end - pole) < AT_POLE)[0]
        if len(at):
            h = np.full(len(t), np.sign(pole))
            total[label[at[0]]] += np.sign(pole) * np.array(
                [(chart.area(t, h) * weight).sum(), sign * (chart.flux(t, h) * weight).sum()]
            )


def _meridians(
    table: SurfaceTable, chart: _Chart, group: int, along: bool, angle: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intervals of a face on lines of constant angle: which line (n,), and ranges of height (sphere: of latitude)."""
    c, s, frame = np.cos(angle), np.sin(angle), chart.frame
    zero, one = np.zeros_like(c), np.ones_like(c)
    if chart.kind == 'SPHERE':
        unit = np.zeros((len(angle), 4, 3))
        unit[:, :2, 0] = np.stack([c, s], axis=1)
        unit[:, 2, 1] = unit[:, 3, 2] = 1.0
        conic = frame @ unit
        found = conic_pieces(table, conic, _polar_planes(chart), faces=1)
        low, high = found.low, found.high
        low, high = (x - 2.0 * np.pi * np.round(0.5 * (found.low + found.high) / (2.0 * np.pi)) for x in (low, high))
        real = np.abs(0.5 * (low + high)) < 0.5 * np.pi
        points = found.middle
    else:
        direction = np.stack([c, s, one] if chart.kind == 'CONE' else [zero, zero, one], axis=1) @ frame[:3, :3].T
        root = np.stack([zero, zero, zero] if chart.kind == 'CONE' else [c, s, zero], axis=1) @ frame[:3, :3].T
        length = np.linalg.norm(direction, axis=1)
        found = line_pieces(table, root + frame[:3, 3], direction / length[:, None], faces=1)
        low, high = found.low / length[found.curve], found.high / length[found.curve]
        real = high > 0.0 if chart.kind == 'CONE' else np.ones(len(low), bool)
        points = found.middle
    gradient = table.gradients(points, np.full((len(points), 1), group))[:, 0]
    branch = found.branches
    looks = np.einsum('ni,ni->n', branch.outward, gradient[branch.point]) > 0.0
    rows = np.unique(branch.point[(branch.group == group) & (looks == along)])
    rows = rows[real[rows]]
    return found.curve[rows], low[rows], high[rows]


def _polar_planes(chart: _Chart) -> np.ndarray:
    """(2, 4): two planes through the poles; at least one of them cuts a given meridian there."""
    return np.array([[np.cos(a), np.sin(a), 0.0, 0.0] for a in POLAR_PLANES]) @ chart.inverse
