"""Chains of mesh creases back to what they were before facetting: straight edges, circles and ellipses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import FloatArray

from ..mesh.settings import COLLINEAR, EVEN
from .settings import (
    AMBIGUOUS_CONIC,
    FEWEST_ELLIPSE_POINTS,
    FEWEST_POINTS,
    FIT,
    FLAT_ROUNDING,
    LONGEST_SWEEP,
    SHORTEST_SWEEP,
)


@dataclass(frozen=True, eq=False)
class Chain:
    """A polyline of creases: points (n + 1, 3), first equals last when closed; segment (n,) the crease of each step."""

    points: np.ndarray
    segment: np.ndarray

    @property
    def closed(self) -> bool:
        """The polyline ends where it begins."""
        return bool((self.points[0] == self.points[-1]).all())

    @property
    def steps(self) -> np.ndarray:
        """(n, 3): from each point to the next."""
        return np.diff(self.points, axis=0)

    def part(self, low: int, high: int) -> Chain:
        """The segments low to high - 1."""
        return Chain(self.points[low : high + 1], self.segment[low:high])


@dataclass(frozen=True, eq=False)
class FittedConic:
    """A circle or ellipse, or an arc of one.

    Parameters
    ----------
    centre, normal, major_axis : (3,) float64, metres and unit vectors
    radii : (2,) float64
        Metres. Major, minor.
    arc : (2,) float64
        Radians. Start, from the major axis, and sweep.
    """

    centre: np.ndarray
    normal: np.ndarray
    radii: np.ndarray
    major_axis: np.ndarray
    arc: np.ndarray


def chains(edges: np.ndarray, points: np.ndarray) -> list[Chain]:
    """Join creases (n, 2), as vertex indices, into chains; a chain ends where other than two creases meet."""
    at: dict[int, list[int]] = {}
    for k, (a, b) in enumerate(edges.tolist()):
        at.setdefault(a, []).append(k)
        at.setdefault(b, []).append(k)
    used = np.zeros(len(edges), bool)
    out = []

    def follow(start: int, first: int) -> Chain:
        path, segments, k = [start], [], first
        while True:
            used[k] = True
            a, b = edges[k]
            path.append(int(b if a == path[-1] else a))
            segments.append(k)
            here = at[path[-1]]
            ahead = [j for j in here if not used[j]]
            if len(here) != 2 or not ahead:
                return Chain(points[path], np.array(segments))
            k = ahead[0]

    for vertex, here in at.items():
        if len(here) != 2:
            out += [follow(vertex, k) for k in here if not used[k]]
    out += [follow(int(edges[k, 0]), k) for k in range(len(edges)) if not used[k]]
    return out


def turns(chain: Chain) -> np.ndarray:
    """(n,) radians: the turn at the start of each segment; at a closed chain's start from its last segment."""
    d = chain.steps
    before = np.roll(d, 1, axis=0)
    angle: FloatArray = np.arctan2(np.linalg.norm(np.cross(before, d), axis=1), (before * d).sum(axis=1))
    if not chain.closed:
        angle[0] = np.pi
    return angle


def split(chain: Chain, breaks: np.ndarray) -> list[Chain]:
    """Cut a chain at the starts of the segments where breaks (n,) is set; a closed one also goes round its start."""
    if chain.closed and breaks.any():
        first = int(np.argmax(breaks))
        points = np.concatenate([chain.points[first:], chain.points[1 : first + 1]])
        chain, breaks = Chain(points, np.roll(chain.segment, -first)), np.roll(breaks, -first)
    cuts = [0, *(int(k) for k in np.nonzero(breaks)[0] if k > 0), len(chain.segment)]
    return [chain.part(a, b) for a, b in zip(cuts[:-1], cuts[1:])]


def straightened(chain: Chain) -> tuple[Chain, list[np.ndarray]]:
    """The chain with collinear neighbours joined, and the creases that each of its segments is made of."""
    parts = split(chain, turns(chain) > COLLINEAR)
    points = np.array([parts[0].points[0], *(part.points[-1] for part in parts)])
    return Chain(points, np.arange(len(parts))), [part.segment for part in parts]


def even_runs(chain: Chain) -> list[Chain]:
    """Cut where the length of the segments jumps: a straight side runs smoothly into a facetted arc."""
    length = np.linalg.norm(chain.steps, axis=1)
    before = np.roll(length, 1)
    jump = np.maximum(length / before, before / length) > EVEN
    jump[0] &= chain.closed
    return split(chain, jump)


def fit_conic(chain: Chain) -> FittedConic | None:
    """The circle or ellipse through a chain's points, or None when they lie on none."""
    closed = chain.closed
    points = chain.points[:-1] if closed else chain.points
    centre = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - centre)
    # Flatness is relative to the bulge and not to the length: a short piece of any space curve is nearly straight.
    if len(points) < FEWEST_POINTS or spread[2] > FIT * spread[1] + FLAT_ROUNDING * spread[0]:
        return None
    normal = axes[2]
    flat = (points - centre) @ axes[:2].T
    found = _circle(flat) or _ellipse(flat)
    if found is None:
        return None
    middle, radii, angle = found
    major = np.cos(angle) * axes[0] + np.sin(angle) * axes[1]
    normal = np.cross(axes[0], axes[1])
    c, s = np.cos(angle), np.sin(angle)
    local = (flat - middle) @ np.array([[c, -s], [s, c]])
    at = np.unwrap(np.arctan2(local[:, 1] / radii[1], local[:, 0] / radii[0]))
    if at[-1] < at[0]:
        normal, at = -normal, -at
    sweep = at[-1] - at[0]
    if not (np.diff(at) > 0.0).all() or not SHORTEST_SWEEP < sweep <= LONGEST_SWEEP:
        return None
    arc = np.array([0.0, 2.0 * np.pi]) if closed else np.array([at[0] % (2.0 * np.pi), sweep])
    return FittedConic(centre + middle @ axes[:2], normal, radii, major, arc)


def _circle(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Centre, radii, angle of the circle through plane points, or None (least squares, Kasa 1976)."""
    a = np.column_stack([2.0 * p, np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(a, (p**2).sum(axis=1), rcond=None)
    if rank < 3:
        return None
    radius = np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0.0))
    error = np.abs(np.linalg.norm(p - solution[:2], axis=1) - radius).max()
    return (solution[:2], np.array([radius, radius]), 0.0) if error <= FIT * radius else None


def _ellipse(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """The same for an ellipse: the conic of least algebraic error, if it is an ellipse near all points."""
    if len(p) < FEWEST_ELLIPSE_POINTS:
        return None
    scale = np.abs(p).max()
    x, y = (p / scale).T
    _, s, v = np.linalg.svd(np.column_stack([x * x, x * y, y * y, x, y, np.ones_like(x)]))
    if s[-2] < AMBIGUOUS_CONIC * s[0]:
        return None
    a, b, c, d, e, f = v[-1]
    form = np.array([[a, 0.5 * b], [0.5 * b, c]])
    if np.linalg.det(form) <= 0.0:
        return None
    centre = -0.5 * np.linalg.solve(form, [d, e])
    level = centre @ form @ centre - f
    value, vector = np.linalg.eigh(form / level)
    if (value <= 0.0).any():
        return None
    radii = 1.0 / np.sqrt(value)
    local = (np.column_stack([x, y]) - centre) @ vector / radii
    if np.abs(np.linalg.norm(local, axis=1) - 1.0).max() * radii[0] > FIT * radii[0]:
        return None
    return centre * scale, radii * scale, float(np.arctan2(vector[1, 0], vector[0, 0]))
