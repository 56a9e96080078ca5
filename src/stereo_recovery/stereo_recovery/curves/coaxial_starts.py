"""Where fits of circles on the axis of a known one may start: every segment tells one such circle.

Turned parts and bores have more rims on one axis, and their arcs are often seen in pieces too short for an ellipse. A
circle on a known axis has two unknowns, its height along the axis and its radius. Where the line of sight through the
middle of a segment meets it, its tangent lies in the plane of the segment and the camera; so one segment tells both,
and segments of both images that tell the same ones are a place to start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py.numeric.compiled import njit
from msgs_py.numeric.settings import BOUND_SIGMA
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray

from ..detection.segments import Segments
from . import settings
from .curve import CameraView, Curve, CurveShape
from .fit_kernels import near_curve
from .observations import Seen, StereoEdgels
from .settings import INLIER_DISTANCE, MOST_STARTS


class Told(NamedTuple):
    """What n segments of both images tell of circles on an axis.

    Attributes
    ----------
    place : (n, 2) float64, metres
        Height over the known circle, and radius.
    per_turn : (n, 2) float64, metres
        Sigma of the two by that of the segment's direction, by which they go together.
    right : (n,) bool
        Of the right image.
    """

    place: FloatArray
    per_turn: FloatArray
    right: BoolArray


def coaxial_starts(
    known: Curve, segments: tuple[Segments, Segments], others: tuple[BoolArray, BoolArray], edgels: StereoEdgels
) -> list[tuple[CurveShape, IntArray]]:
    """Circles on the axis of a known one that segments of both images tell.

    Parameters
    ----------
    known : Curve
        A circle, left optical frame, metres.
    segments : (Segments, Segments)
        Of the left and of the right image.
    others : ((n,) bool, (m,) bool)
        Which edgels of either image belong to curves that were found.
    edgels : StereoEdgels

    Returns
    -------
    list of (CurveShape, (k,) int64)
        By falling support, MOST_STARTS at most, and the edgels near each, by their numbers in ``edgels.seen``.
    """
    sides = edgels.sides
    told = [
        _told(known, of.select(~_mostly(taken, of.bounds)), view, bool(side))
        for side, (of, taken, (_, view)) in enumerate(zip(segments, others, sides))
    ]
    both = Told(*(np.concatenate(parts) for parts in zip(*told)))
    pixel = float(known.centre[2]) / float(sides[0][1].intrinsics[0])
    if both.right.all() or not both.right.any():
        return []
    starts = []
    for height, radius in agreed(both.place, both.per_turn, both.right, INLIER_DISTANCE * pixel):
        shape = known.shape._replace(centre=known.centre + height * known.normal, radii=np.full(2, radius))
        starts.append((shape, around(shape, edgels.seen)))
    return starts


def _mostly(taken: BoolArray, bounds: IntArray) -> BoolArray:
    """(n,) bool: segments of edgels [first, last) (n, 2) more of which are taken than a curve may share."""
    before = np.concatenate([[0], np.cumsum(taken)])
    return np.asarray(before[bounds[:, 1]] - before[bounds[:, 0]] > settings.SHARED_EDGELS * np.diff(bounds)[:, 0])


def _told(known: Curve, segments: Segments, view: CameraView, right: bool) -> Told:
    """What segments of an image tell, as far as it is near the known circle."""
    origin, normal = view.centre, known.normal
    rays = view.camera.rays(segments.centre + segments.extent.mean(axis=1)[:, None] * segments.direction)
    fx, fy = view.intrinsics[:2]
    along = np.zeros((2, len(segments), 3))
    along[0, :, :2] = segments.direction / [fx, fy]
    along[1, :, :2] = segments.normal / [fx, fy]
    # A tangent at the point t rays is square to the radius where a - b t = 0, by the plane of segment and camera, and
    # by what a turn of the segment about its middle changes of it.
    square = np.cross(np.cross(rays, along), normal)
    towards = known.centre - origin
    (a, a_turned), (b, b_turned) = square @ towards, (square * rays).sum(axis=2)
    up, level = rays @ normal, float(towards @ normal)
    reach = settings.COAXIAL_REACH * known.radii[0]
    with np.errstate(divide='ignore', invalid='ignore'):
        # A line fitted to a piece of a circle is turned by its own error, and by what of the piece is missing.
        sigma = np.hypot(segments.sigma[:, 1], INLIER_DISTANCE / segments.length)
        sigma *= np.abs(a_turned - b_turned * level / up)
        # Seen along its axis a circle says nothing of its height, and what is known is how far parts reach.
        information = (b / sigma) ** 2 + (up * BOUND_SIGMA / reach) ** 2
        ahead = (a * b / sigma**2 + up * level * (BOUND_SIGMA / reach) ** 2) / information
        run = ahead[:, None] * rays - towards
        height = run @ normal
        across = run - height[:, None] * normal
        radius = np.linalg.norm(across, axis=1)
        per_turn = np.stack([up, (rays * across).sum(axis=1) / radius], axis=1) / np.sqrt(information)[:, None]
        near = (ahead > 0.0) & (radius > 0.0) & (np.linalg.norm(run, axis=1) < reach)
    place = np.stack([height, radius], axis=1)[near]
    return Told(place, per_turn[near], np.full(len(place), right))


@njit(nogil=True)
def agreed(place: FloatArray, per_turn: FloatArray, right: BoolArray, sigma: float) -> FloatArray:
    """Where what is told of both images agrees best; none agrees with a better one.

    Parameters
    ----------
    place, per_turn : (n, 2) float64, metres
    right : (n,) bool
        As of :class:`Told`.
    sigma : float, metres
        Of both numbers, by all but the segments' directions.

    Returns
    -------
    (k, 2) float64, metres
        Height and radius, MOST_STARTS at most.
    """
    count = len(place)
    support = np.zeros((count, 2))
    order = np.argsort(place[:, 0])
    widest = np.abs(per_turn[:, 0]).max()
    for first in range(count):
        i = order[first]
        reach = BOUND_SIGMA * np.sqrt(sigma * sigma + per_turn[i, 0] ** 2 + widest * widest)
        for second in range(first, count):
            j = order[second]
            if place[j, 0] - place[i, 0] > reach:
                break
            density = _density(place[j] - place[i], per_turn[i], per_turn[j], sigma)
            support[i, int(right[j])] += density
            if i != j:
                support[j, int(right[i])] += density
    found = np.empty((MOST_STARTS, 2))
    for k in range(MOST_STARTS):
        best, most = 0, 0.0
        for i in range(count):
            if min(support[i, 0], support[i, 1]) > most:
                best, most = i, min(support[i, 0], support[i, 1])
        if most == 0.0:
            return found[:k]
        # The mean by all that agrees: what one segment leaves open along its line of places, another one tells.
        weights, weighted = np.zeros((2, 2)), np.zeros(2)
        for j in range(count):
            if _density(place[j] - place[best], per_turn[best], per_turn[j], sigma) > 0.0:
                inverse = np.linalg.inv(sigma * sigma * np.eye(2) + np.outer(per_turn[j], per_turn[j]))
                weights += inverse
                weighted += inverse @ place[j]
                support[j] = 0.0
        found[k] = np.linalg.solve(weights, weighted)
    return found


@njit
def _density(apart: FloatArray, one: FloatArray, other: FloatArray, sigma: float) -> float:
    """How likely two segments tell what is so far apart (2,), metres, if they are of one circle; 0 beyond three sigma.

    one, other : (2,) metres, sigma of either by its direction; sigma : of all numbers, metres
    """
    a = sigma * sigma + one[0] * one[0] + other[0] * other[0]
    b = one[0] * one[1] + other[0] * other[1]
    c = sigma * sigma + one[1] * one[1] + other[1] * other[1]
    if apart[0] * apart[0] > BOUND_SIGMA**2 * a or apart[1] * apart[1] > BOUND_SIGMA**2 * c:
        return 0.0
    block = a * c - b * b
    chi = (c * apart[0] * apart[0] - 2.0 * b * apart[0] * apart[1] + a * apart[1] * apart[1]) / block
    return float(np.exp(-0.5 * chi) / np.sqrt(block)) if chi < BOUND_SIGMA**2 else 0.0


@njit(nogil=True)
def around(shape: CurveShape, seen: Seen) -> IntArray:
    """Edgels of both images near a circle that is only about there.

    Parameters
    ----------
    shape : CurveShape
    seen : Seen

    Returns
    -------
    (k,) int64
        By their numbers in ``seen``.
    """
    limit = np.full(len(seen.points), 2.0 * INLIER_DISTANCE)
    return np.concatenate((near_curve(shape, seen, 0, limit), near_curve(shape, seen, 1, limit)))
