"""Ellipses in the image: which runs of segments are arcs, and the ellipse through them (thesis 3.10.3).

A split chain turns a little at every break when it follows a curve. Runs that turn one way are tried as ellipses, the
longest first; a run that one ellipse explains as well as lines would is an arc, and none of its segments is an edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import conic_kernels

# An arc turns by at least this much in all, and by at most this much from segment to segment; radians.
LEAST_TURN = np.radians(20.0)
SHARPEST_BREAK = np.radians(65.0)
# Smallest semi-axis, pixels, and shortest arc, edgels.
LEAST_RADIUS = 1.5
LEAST_EDGELS = 14


@dataclass(frozen=True, eq=False)
class Ellipse:
    """conic : (3, 3) float64 symmetric, x^T C x = 0 for pixels (u, v, 1), negative inside; rms : pixels."""

    conic: np.ndarray
    rms: float

    @property
    def centre(self) -> np.ndarray:
        """(2,) float64, pixels."""
        return -np.linalg.solve(self.conic[:2, :2], self.conic[:2, 2])

    @property
    def radii(self) -> np.ndarray:
        """(2,) float64, pixels, major first."""
        value = -np.linalg.det(self.conic) / np.linalg.det(self.conic[:2, :2])
        return np.sqrt(value / np.linalg.eigvalsh(self.conic[:2, :2]))


def sampson(conic: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) float64, pixels: signed distance of points (n, 2) from a conic, first order (Sampson), positive outside."""
    distance: np.ndarray = conic_kernels.sampson(np.ascontiguousarray(conic), np.ascontiguousarray(points))
    return distance


def fit_ellipse(points: np.ndarray, rounds: int = 4) -> Ellipse | None:
    """Ellipse through points (n, 2), pixels, n >= 6; None when they do not determine one.

    Least squares of the conic's equation, repeated with each equation divided by its gradient, which removes the bias
    towards small ellipses (Sampson 1982; thesis 3.10.1 uses a bias-corrected filter for that).
    """
    if len(points) < 6:
        return None
    numbers, rms = conic_kernels.fit(np.ascontiguousarray(points, dtype=np.float64), rounds)
    if not np.isfinite(rms):
        return None
    conic = _symmetric(numbers)
    # A real ellipse has its centre inside.
    if not np.isfinite(conic).all() or np.linalg.det(conic) >= 0.0:
        return None
    return Ellipse(conic, float(rms))


def _symmetric(numbers: np.ndarray) -> np.ndarray:
    a, b, c, d, e, f = numbers
    return np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, f]])


def find_arcs(
    position: np.ndarray,
    limit: np.ndarray,
    bounds: np.ndarray,
    chain: np.ndarray,
    closed: np.ndarray,
    sagitta: np.ndarray,
    direction: np.ndarray,
) -> tuple[np.ndarray, list[Ellipse]]:
    """Which segments are parts of arcs.

    position : (n, 2) edgels in chain order; limit : (n,) pixels each may stand off; bounds, chain : the segments, in
    order; closed : (chains,) bool; sagitta, direction : of the segments' lines.
    Returns arc (k,) int32, the arc of each segment or -1, and the arcs' ellipses.
    """
    arc = np.full(len(bounds), -1, np.int32)
    ellipses: list[Ellipse] = []
    if len(bounds) < 3:
        return arc, ellipses
    angle = np.arctan2(direction[:, 1], direction[:, 0])
    turn = (np.diff(angle) + np.pi) % (2.0 * np.pi) - np.pi
    same = chain[1:] == chain[:-1]
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    for first, last in zip(starts, np.append(starts[1:], len(bounds))):
        if last - first < 2:
            continue
        segments = np.arange(first, last)
        turns = turn[first : last - 1]
        if closed[chain[first]] and last - first >= 3:
            segments = np.concatenate([segments, segments])
            join = (angle[first] - angle[last - 1] + np.pi) % (2.0 * np.pi) - np.pi
            turns = np.concatenate([turns, [join], turns])
        for run in _runs(turns):
            conics, errors = conic_kernels.claim(
                np.ascontiguousarray(segments[run[0] : run[1] + 1]),
                np.ascontiguousarray(turns[run[0] : run[1]]),
                position,
                limit,
                bounds,
                sagitta,
                arc,
                len(ellipses),
                LEAST_TURN,
                LEAST_EDGELS,
                LEAST_RADIUS,
            )
            ellipses += [Ellipse(_symmetric(q), float(rms)) for q, rms in zip(conics, errors)]
    return arc, ellipses


def _runs(turns: np.ndarray) -> list[tuple[int, int]]:
    """Stretches [first, last] of segments between which the turn keeps its sign and is no sharp corner."""
    sign = np.where(np.abs(turns) < SHARPEST_BREAK, np.sign(turns), 0)
    runs = []
    k = 0
    while k < len(sign):
        if sign[k] == 0:
            k += 1
            continue
        end = k
        while end + 1 < len(sign) and sign[end + 1] == sign[k]:
            end += 1
        runs.append((k, end + 1))
        k = end + 1
    return runs
