"""Edges that one image shows between two corners which both images show (thesis 3.10: figural continuity).

An eye that looks along a face sees its edges together, or one of them not at all; but where its corners are is known
from the other edges that run into them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from msgs_py.numeric.settings import NOT_ZERO
from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments, line_table
from ..estimation.estimate import Estimate
from ..estimation.settings import CORNER_SIGMA, LOOSE_END_SIGMA, OPEN_SIGMA, SAME_PLACE
from ..matching.stereo_segments import StereoSegments
from . import corner_kernels
from .extents import Extents
from .settings import ROUNDED, SHORTEST


@dataclass(frozen=True, eq=False)
class Corners:
    """m ends of edges that are corners in both images.

    Attributes
    ----------
    edge : (m,) int64, ascending
        The edge that shows it.
    own : (2, m) int
        The edge's segments in the left and the right image.
    point : (2, m, 2) float64, pixels
        In the left and the right image.
    disparity, sigma : (m,) float64, pixels
    """

    edge: IntArray
    own: IntArray
    point: FloatArray
    disparity: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class JunctionEdges:
    """k edges from corner to corner.

    Attributes
    ----------
    segments : (Segments, Segments)
        Those of the two images, with the edges as their last k: the line of the image that shows one is its line in
        both.
    extent, disparity, sigma : (k, 2) float64, pixels
        Along the left one of these segments; at the ends.
    """

    segments: tuple[Segments, Segments]
    extent: FloatArray
    disparity: FloatArray
    sigma: FloatArray

    @property
    def coefficient(self) -> FloatArray:
        """(k, 2) disparity a + b s."""
        return np.asarray(np.einsum('kij,kj->ki', self._inverse, self.disparity))

    @property
    def covariance(self) -> FloatArray:
        """(k, 2, 2) of it."""
        return np.asarray(np.einsum('kie,ke,kje->kij', self._inverse, self.sigma**2, self._inverse))

    @property
    def _inverse(self) -> FloatArray:
        """(k, 2, 2) what makes coefficients of the disparities at the ends."""
        return np.asarray(np.linalg.inv(np.stack([np.ones_like(self.extent), self.extent], axis=-1)))


def corners(seen: StereoSegments, found: Estimate, ends: Extents) -> Corners:
    """The corners whose place both images show and whose depth is known."""
    i, j = seen.index
    h = np.stack([np.ones_like(ends.abscissa), ends.abscissa], axis=-1)
    disparity = np.einsum('nei,ni->ne', h, found.x)
    sigma = np.sqrt(np.einsum('nei,nij,nej->ne', h, found.covariance, h))
    known = ends.in_both & (sigma < OPEN_SIGMA)
    e, end = np.nonzero(known & (seen.segments[0].arc[i] < 0)[:, None])
    left = seen.points[0][e, end]
    right = left.copy()
    right[:, 0] -= disparity[e, end]
    return Corners(
        e, np.stack([i[e], j[e]]), np.stack([left, right]), disparity[e, end], np.hypot(sigma[e, end], CORNER_SIGMA)
    )


def junction_edges(seen: StereoSegments, known: Corners) -> JunctionEdges | None:
    """Segments of either image that belong to no pair and run from one corner to another; None when there is none.

    Parameters
    ----------
    seen : StereoSegments
        The segments that do belong to pairs.
    known : Corners
    """
    taken = np.stack([side[seen.index[0]] for side in (seen.segments[0].start, seen.segments[0].end)], axis=1)
    rows: tuple[list[dict[str, AnyArray]], list[dict[str, AnyArray]]] = ([], [])
    disparity, sigma = [], []
    for image, (segments, junctions) in enumerate(zip(seen.segments, seen.junctions)):
        found, value = _between(segments, junctions, known, image)
        found[seen.index[image]] = False
        for k in np.flatnonzero(found):
            place, depth, spread = value[k].T
            if _is_met(segments, junctions, int(k), place):
                continue
            shown = segments.centre[k] + place[:, None] * segments.direction[k]
            shift = np.stack([depth if image else -depth, np.zeros(2)], axis=1)
            left = shown + shift if image else shown
            if _is_taken(left, taken):
                continue
            taken = np.concatenate([taken, left[None]])
            own = {f.name: getattr(segments, f.name)[k] for f in fields(Segments)} | {'extent': place}
            rows[image].append(own)
            rows[1 - image].append(_moved(own, shown + shift))
            disparity.append(depth)
            sigma.append(np.hypot(spread, ROUNDED))
    if not disparity:
        return None
    grown = tuple(
        Segments(
            **{
                f.name: np.concatenate([getattr(segments, f.name), np.stack([row[f.name] for row in more])])
                for f in fields(Segments)
            }
        )
        for segments, more in zip(seen.segments, rows)
    )
    extent = np.stack([row['extent'] for row in rows[0]])
    return JunctionEdges((grown[0], grown[1]), extent, np.array(disparity), np.array(sigma))


def met_corners(segments: Segments, junctions: Junctions, known: Corners, image: int) -> tuple[BoolArray, FloatArray]:
    """The known corners that segments of an image run into, see :func:`.corner_kernels.meetings`.

    Parameters
    ----------
    segments, junctions : of n segments
    known : Corners
    image : int
        0 for the left image, 1 for the right one.
    """
    table = line_table(segments)
    table[:, 4:6] = junctions.abscissa
    own = np.ascontiguousarray(known.own[image])
    found, value = corner_kernels.meetings(table, known.point[image], known.disparity, known.sigma, own)
    return found, value


def _between(segments: Segments, junctions: Junctions, known: Corners, image: int) -> tuple[BoolArray, FloatArray]:
    """Which segments (n,) run from one corner to another, and of both ends place, disparity and sigma (n, 2, 3)."""
    found, value = met_corners(segments, junctions, known, image)
    long = (segments.length >= SHORTEST) & (value[:, 1, 0] - value[:, 0, 0] >= SHORTEST)
    return np.asarray(found.all(axis=1) & (segments.arc < 0) & long), value


def _is_met(segments: Segments, junctions: Junctions, k: int, place: FloatArray) -> bool:
    """Whether something runs into segment k between its ends: two edges may look like one line to one eye."""
    other, end = np.nonzero(junctions.neighbour == k)
    point = segments.centre[other] + junctions.abscissa[other, end, None] * segments.direction[other]
    at = (point - segments.centre[k]) @ segments.direction[k]
    return bool(((at > place[0] + LOOSE_END_SIGMA) & (at < place[1] - LOOSE_END_SIGMA)).any())


def _moved(row: dict[str, AnyArray], ends: FloatArray) -> dict[str, AnyArray]:
    """A segment, by its attributes, that no edgels of the other image show, between two points (2, 2)."""
    run = ends[1] - ends[0]
    length = max(float(np.hypot(*run)), 1e-6)
    return row | {
        'centre': ends.mean(axis=0),
        'direction': run / length,
        'extent': np.array([-0.5, 0.5]) * length,
        'bounds': np.zeros_like(row['bounds']),
    }


def _is_taken(points: FloatArray, others: FloatArray) -> bool:
    """Whether an edge (2, 2) lies on one of the others (n, 2, 2), or one of them on it."""
    here = np.broadcast_to(points, others.shape)
    same = np.zeros(len(others), bool)
    for a, b in ((here, others), (others, here)):
        run = b[:, 1] - b[:, 0]
        length = np.maximum(np.hypot(run[:, 0], run[:, 1]), NOT_ZERO)[:, None]
        away = (a - b[:, :1]) / length[..., None]
        along = (away * run[:, None]).sum(axis=2) / length
        off = np.abs(away[..., 1] * run[:, None, 0] - away[..., 0] * run[:, None, 1])
        common = np.minimum(1.0, along.max(axis=1)) - np.maximum(0.0, along.min(axis=1))
        same |= (off.max(axis=1) < 2.0 * SAME_PLACE) & (common > 0.5 * np.ptp(along, axis=1))
    return bool(same.any())
