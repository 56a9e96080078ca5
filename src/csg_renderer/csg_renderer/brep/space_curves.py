"""Creases that lie in no plane: where two quadrics meet in a space curve of degree four.

Such a crease is no matching feature, but it is found, reported and drawn, and it hides what is behind it. The curve is
followed along the rulings of a cone or cylinder through it (Levin, A parametric algorithm for drawing pictures of solid
objects composed of quadric surfaces, 1976): a ruling meets the other quadric at most twice, so the curve has a closed
form with one square root.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import FloatArray

from .conics import quadric_angles
from .neighbourhood import classify, faces_through
from .pieces import Pieces, creases
from .settings import (
    COSINE_MARGIN,
    CURVE_SAMPLES,
    DERIVATIVE_STEP,
    FALSE_POSITION_STEPS,
    FARTHEST,
    GENERIC_START,
    INSIDE,
    PARALLEL,
    SAME_BRANCH_POINT,
    SHORTEST_ARC,
    SIMPLE_IMAGINARY,
    TANGENT_QUADRICS,
)
from .surfaces import SurfaceTable


@dataclass(frozen=True, eq=False)
class RuledCurve:
    """One closed branch of the intersection of two quadrics, normalised frame.

    The rulings are vertex s + base (cos t, sin t, 1), homogeneous. The parameter of the curve, 0 to 2 pi, traverses the
    range of t on one root of the ruling's equation with the other quadric and back on the other root.

    Parameters
    ----------
    vertex : (4,) float64
    base : (4, 3) float64
    other : (4, 4) float64
        The quadric that the rulings meet.
    middle, half : float
        Radians. The range of t is middle - half to middle + half.
    sign : float
        0, or the sign of the one root of a branch that goes round once; half is pi then.
    """

    vertex: np.ndarray
    base: np.ndarray
    other: np.ndarray
    middle: float
    half: float
    sign: float

    def turns(self, angle: np.ndarray, sign: np.ndarray) -> np.ndarray:
        """Parameters, 0..2 pi, of rulings at these angles on these roots, without those on another branch."""
        if self.sign:
            return ((angle - self.middle) % (2.0 * np.pi))[sign * self.sign >= 0.0]
        offset = (angle - self.middle + np.pi) % (2.0 * np.pi) - np.pi
        on = np.abs(offset) <= self.half * (1.0 + COSINE_MARGIN)
        turn = np.arccos(np.clip(-offset[on] / self.half, -1.0, 1.0))
        return np.where(sign[on] >= 0.0, turn, 2.0 * np.pi - turn) % (2.0 * np.pi)

    def points(self, turn: np.ndarray) -> np.ndarray:
        """(n, 3) at parameters turn (n,) in 0..2 pi; NaN where the curve is at infinity."""
        if self.sign:
            t, sign = self.middle + turn, np.full(len(turn), self.sign)
        else:
            t, sign = self.middle - self.half * np.cos(turn), np.where(np.sin(turn) >= 0.0, 1.0, -1.0)
        w = np.stack([np.cos(t), np.sin(t), np.ones_like(t)], axis=1) @ self.base.T
        a = self.vertex @ self.other @ self.vertex
        b = w @ self.other @ self.vertex
        c = ((w @ self.other) * w).sum(axis=1)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        # In homogeneous form neither root needs a division: (s : 1) = (-b + root : a) = (-c : b + root).
        stable = np.where(b * sign <= 0.0, True, False)
        s = np.where(stable, -b + sign * root, -c)
        k = np.where(stable, a, b + sign * root)
        x = s[:, None] * self.vertex + k[:, None] * w
        with np.errstate(divide='ignore', invalid='ignore'):
            point = x[:, :3] / x[:, 3:]
        return np.where(np.isfinite(point).all(axis=1, keepdims=True) & (np.abs(point) < FARTHEST), point, np.nan)


@dataclass(frozen=True, eq=False)
class SpaceCurvePieces:
    """The pieces of ruled curves that lie on a boundary, and their creases; normalised frame.

    Parameters
    ----------
    curves : tuple of RuledCurve
    pieces : Pieces
        ``pieces.curve`` is a row of ``curves``.
    creases : tuple of (2 k + 1, 3) float64
        Samples along each crease; every second one ends a chord.
    """

    curves: tuple[RuledCurve, ...]
    pieces: Pieces
    creases: tuple[np.ndarray, ...]

    def points(self, curve: int, turn: np.ndarray) -> np.ndarray:
        """(n, 3) at parameters turn (n,) of one curve."""
        return self.curves[curve].points(turn)

    def steps(self, curve: int, turn: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) and the curve's differentials (n, 3) for quadrature weights (n,)."""
        ahead, behind = self.points(curve, turn + DERIVATIVE_STEP), self.points(curve, turn - DERIVATIVE_STEP)
        return self.points(curve, turn), weight[:, None] * (ahead - behind) / (2.0 * DERIVATIVE_STEP)


def ruled_curves(table: SurfaceTable, one: int, two: int) -> list[RuledCurve]:
    """The branches in which two quadrics meet; one, two : rows of ``table.quadrics``."""
    kinds = [table.leaves[table.quadric_leaf[k]].kind for k in (one, two)]
    if kinds[0] == 'SPHERE' and kinds[1] != 'SPHERE':
        one, two, kinds = two, one, kinds[::-1]
    frame = table.frames[table.quadric_leaf[one]]
    if kinds[0] == 'CYLINDER':
        vertex, base = frame[:, 2], frame @ np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 1]])
    elif kinds[0] == 'CONE':
        vertex, base = frame[:, 3], frame @ np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])
    else:
        found = _cone_through(frame, table.quadrics[one], table.quadrics[two])
        if found is None:
            return []
        vertex, base = found
    other = table.quadrics[two]
    b = base.T @ other @ vertex
    form = np.outer(b, b) - (vertex @ other @ vertex) * (base.T @ other @ base)
    scale = np.linalg.norm(form)
    ends = quadric_angles(form, np.array(scale)) if scale > 0.0 else np.zeros(0)
    ends = np.sort(ends[np.isfinite(ends)] % (2.0 * np.pi))
    ends = ends[np.append(np.diff(ends) > SAME_BRANCH_POINT, True)[: len(ends)]]
    if not len(ends):
        real = np.array([1.0, 0.0, 1.0]) @ form @ np.array([1.0, 0.0, 1.0]) > 0.0
        return [RuledCurve(vertex, base, other, 0.0, np.pi, sign) for sign in (1.0, -1.0)] if real else []
    curves = []
    for low, high in zip(ends, np.append(ends[1:], ends[0] + 2.0 * np.pi)):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        u = np.array([np.cos(middle), np.sin(middle), 1.0])
        if u @ form @ u > 0.0:
            curves.append(RuledCurve(vertex, base, other, middle, half, 0.0))
    return curves


def space_curve_pieces(table: SurfaceTable, pairs: tuple[tuple[int, int], ...]) -> SpaceCurvePieces:
    """Pieces and creases in the intersections of these pairs of quadrics, rows of ``table.quadrics``."""
    curves: list[RuledCurve] = []
    owners, rows, lows, highs = [], [np.zeros(0, int)], [np.zeros(0)], [np.zeros(0)]
    turn = GENERIC_START + np.linspace(0.0, 2.0 * np.pi, CURVE_SAMPLES + 1)
    for pair in pairs:
        for curve in ruled_curves(table, *pair):
            cuts = _cuts(table, curve, turn, {len(table.planes) + k for k in pair})
            low = cuts if len(cuts) else np.zeros(1)
            high = np.append(low[1:], low[0] + 2.0 * np.pi)
            keep = high - low > SHORTEST_ARC
            rows.append(np.full(keep.sum(), len(curves)))
            lows.append(low[keep])
            highs.append(high[keep])
            curves.append(curve)
            owners.append(pair)
    row, low, high = np.concatenate(rows), np.concatenate(lows), np.concatenate(highs)
    middle, tangent = np.full((len(row), 3), np.nan), np.full((len(row), 3), np.nan)
    q = table.quadrics
    for k, pair in enumerate(owners):
        mine = row == k
        at = middle[mine] = curves[k].points(low[mine] + INSIDE * (high[mine] - low[mine]))
        tangent[mine] = np.cross(*(at @ q[j, :3, :3] + q[j, :3, 3] for j in pair))
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    good = np.isfinite(middle).all(axis=1) & (length[:, 0] > TANGENT_QUADRICS)
    tangent = tangent / np.where(length > 0.0, length, 1.0)
    # Tangents point along the curve, so that one side of a surface has one signature all the way.
    for k in range(len(curves)):
        mine = np.nonzero((row == k) & good)[0]
        at = low[mine] + INSIDE * (high[mine] - low[mine])
        ahead = curves[k].points(at + DERIVATIVE_STEP) - curves[k].points(at - DERIVATIVE_STEP)
        tangent[mine] *= np.where(np.einsum('ni,ni->n', ahead, tangent[mine]) < 0.0, -1.0, 1.0)[:, None]
    good[good] = faces_through(table, middle[good]).sum(axis=1) >= 2
    pieces = Pieces(
        row[good],
        low[good],
        high[good],
        middle[good],
        tangent[good],
        SHORTEST_ARC,
        classify(table, middle[good], tangent[good]),
    )
    runs = creases(pieces, 2.0 * np.pi)
    found = (_sampled(curves[k], a, b) for k, a, b in zip(runs.curve, runs.low, runs.high))
    return SpaceCurvePieces(tuple(curves), pieces, tuple(samples for samples in found if len(samples) > 2))


def _sampled(curve: RuledCurve, low: float, high: float) -> np.ndarray:
    """(2 k + 1, 3): points along a crease from low to high."""
    count = max(4, int(np.ceil(0.5 * CURVE_SAMPLES * (high - low) / (2.0 * np.pi))))
    points = curve.points(np.linspace(low, high, 2 * count + 1))
    # A nearly flat quadric can bring a crossing next to infinity; what is finite is kept, an odd number of points.
    finite = points[np.isfinite(points).all(axis=1)]
    odd: FloatArray = finite[: len(finite) - (len(finite) + 1) % 2]
    return odd


def _cuts(table: SurfaceTable, curve: RuledCurve, turn: np.ndarray, own: set[int]) -> np.ndarray:
    """Increasing parameters at which the curve crosses any other surface."""
    g = len(table.planes)
    others = np.array([k for k in range(g, table.groups) if k not in own], int)
    return np.unique(np.concatenate([_plane_cuts(table.planes, curve), _quadric_cuts(table, curve, turn, others)]))


def _plane_cuts(planes: np.ndarray, curve: RuledCurve) -> np.ndarray:
    """Parameters (k,) of crossings with planes (g, 4), exact.

    A plane meets the rulings in a conic, and the conic meets the other quadric in the roots of a quartic.
    """
    along, across = planes @ curve.vertex, planes @ curve.base
    level = np.abs(along) <= PARALLEL * np.linalg.norm(across, axis=1)
    conic = along[:, None, None] * curve.base - curve.vertex[:, None] * across[:, None, :]
    form = np.einsum('gia,ij,gjb->gab', conic, curve.other, conic)
    t = quadric_angles(form, np.linalg.norm(conic, axis=(1, 2)) ** 2)
    t[level] = np.nan
    plane, root = np.nonzero(np.isfinite(t))
    t = t[plane, root]
    u = np.stack([np.cos(t), np.sin(t), np.ones_like(t)], axis=1)
    s = -(u * across[plane]).sum(axis=1) / along[plane]
    # The point lies on the root whose sign a s + b has.
    a = curve.vertex @ curve.other @ curve.vertex
    b = (u @ curve.base.T) @ curve.other @ curve.vertex
    cuts = [curve.turns(t, np.sign(a * s + b))]
    # A plane parallel to the rulings contains whole rulings; both points of each are crossings.
    size = np.hypot(across[level, 0], across[level, 1])
    with np.errstate(divide='ignore', invalid='ignore'):
        half = np.arccos(-across[level, 2] / size)
    phase = np.arctan2(across[level, 1], across[level, 0])
    for angle in (phase + half, phase - half):
        angle = angle[np.isfinite(angle)]
        cuts += [curve.turns(angle, np.full(len(angle), sign)) for sign in (1.0, -1.0)]
    return np.concatenate(cuts)


def _quadric_cuts(table: SurfaceTable, curve: RuledCurve, turn: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Parameters (k,) of crossings with other quadrics, by samples turn (n,) and false position.

    Two crossings between neighbouring samples are missed.
    """
    if not len(others):
        return np.zeros(0)
    points = curve.points(turn)
    finite = np.isfinite(points).all(axis=1)
    values = table.values(np.nan_to_num(points))[:, others]
    side = values >= 0.0
    row, column = np.nonzero((side[:-1] != side[1:]) & (finite[:-1] & finite[1:])[:, None])
    if not len(row):
        return np.zeros(0)
    group = others[column]
    low, high = turn[row], turn[row + 1]
    below, above = (table.value_of(points[k], group) for k in (row, row + 1))
    middle = low
    for _ in range(FALSE_POSITION_STEPS):
        middle = (low * above - high * below) / (above - below)
        value = table.value_of(np.nan_to_num(curve.points(middle)), group)
        before = np.sign(value) == np.sign(below)
        # The value of the end that stays is halved, so that it moves in the end (the Illinois rule).
        low, high = np.where(before, middle, low), np.where(before, high, middle)
        below, above = np.where(before, value, 0.5 * below), np.where(before, 0.5 * above, value)
        above = np.where(above == below, below - 1.0, above)
    return middle % (2.0 * np.pi)


def _cone_through(frame: np.ndarray, one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Vertex (4,) and base (4, 3) of a real cone through the meet of two ellipsoids; None where they do not meet."""
    a, b = frame.T @ one @ frame, frame.T @ two @ frame
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    best = None
    for x in np.linalg.eigvals(np.linalg.solve(a, b)):
        if abs(x.imag) > SIMPLE_IMAGINARY * (1.0 + abs(x)):
            continue
        value, vector = np.linalg.eigh(b - x.real * a)
        order = np.argsort(np.abs(value))
        value, vector = value[order], vector[:, order]
        signs = np.sign(value[1:])
        if abs(signs.sum()) != 1.0:
            continue
        lone = 1 + int(np.argmax(signs == -signs.sum()))
        pair = [k for k in (1, 2, 3) if k != lone]
        if best is None or abs(value[1]) > best[0]:
            columns = [vector[:, k] / np.sqrt(abs(value[k])) for k in (*pair, lone)]
            best = (abs(value[1]), frame @ vector[:, 0], frame @ np.stack(columns, axis=1))
    return None if best is None else (best[1], best[2])
