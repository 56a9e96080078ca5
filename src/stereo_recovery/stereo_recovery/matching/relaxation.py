"""Which segment of the right image shows the same edge as a segment of the left one (thesis 3.10, after PMF).

Pollard, Mayhew and Frisby let candidate matches of edge points support each other when the gradient of disparity
between them is below 0.5. Here the candidates are pairs of straight segments of chains, so figural continuity is
built in and a picture has hundreds of them, not tens of thousands. Support, likeness of the two sides and uniqueness
are iterated, so that what is unambiguous somewhere (the end of a chessboard) decides its neighbourhood.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.segments import Segments
from . import relaxation_kernels
from .matches import Matches, match_of

# How many neighbours a segment listens to: enough to hear of the end of a repetitive pattern in a few rounds.
NEIGHBOURS = 48
# Grey levels by which a side of an edge may differ before its likeness falls to 1 / e: at first, and at least, when
# the pair's cameras agree so well; that is so many times the median over the first matches, if they are not too few.
SIDE_CONTRAST = 12.0
LEAST_CONTRAST = 4.0
LIKE = 6.0
FEW = 6
# Places along a segment at which the grey levels beside it are looked up, and those that tell of the segment as a
# whole.
SAMPLES = 8
INNER = slice(2, 6)
# What is left over in both images finds each other in the end. A pair less alike than the first is no match when less
# than the second share of what has been matched around it is as far away as it would be.
UNALIKE, ALONE = 0.3, 0.15
# Rounds of relaxation that only serve to learn that.
FIRST_ROUNDS = 5


def sides(grey: AnyArray, segments: Segments, offset: float = 3.0) -> AnyArray:
    """(n, SAMPLES, 2) float64: grey levels on the dark and the bright flank of each segment, from start to end."""
    if len(segments) == 0:
        return np.zeros((0, SAMPLES, 2))
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    places = segments.start[:, None] + share[:, None] * (segments.end - segments.start)[:, None]
    across = offset * np.stack([-segments.direction[:, 1], segments.direction[:, 0]], axis=1)[:, None]
    points = np.stack([places - across, places + across], axis=2)
    u = np.clip(points[..., 0], 0.0, grey.shape[1] - 1.001)
    v = np.clip(points[..., 1], 0.0, grey.shape[0] - 1.001)
    x, y = u.astype(np.intp), v.astype(np.intp)
    u, v = u - x, v - y
    levels: AnyArray = (1.0 - v) * ((1.0 - u) * grey[y, x] + u * grey[y, x + 1]) + v * (
        (1.0 - u) * grey[y + 1, x] + u * grey[y + 1, x + 1]
    )
    return levels


def backdrop(grey: AnyArray, share: float = 0.3) -> float:
    """Grey level that at least this share of a picture has, within a few levels; -1000 when there is none."""
    counts, edges = np.histogram(grey[::4, ::4], bins=64, range=(0.0, 256.0))
    pairs = counts[:-1] + counts[1:]
    k = int(np.argmax(pairs))
    return float(edges[k + 1]) if pairs[k] > share * max(counts.sum(), 1) else -1000.0


def _table(segments: Segments, beside: AnyArray) -> AnyArray:
    """(n, 9) float64: rows of segments as :func:`.relaxation_kernels.candidates` takes them."""
    middle = np.median(beside[:, INNER], axis=1)
    return np.hstack([segments.start, segments.end, segments.direction, middle, segments.magnitude[:, None]])


def match(
    left_grey: AnyArray,
    right_grey: AnyArray,
    left: Segments,
    right: Segments,
    lowest: float,
    highest: float,
    radius: float,
    flat_sine: float = 0.1,
    rounds: int = 15,
    least_belief: float = 0.6,
) -> Matches:
    """Pairs of segments.

    lowest, highest : allowed disparity, pixels; radius : neighbourhood of support, pixels;
    flat_sine : segments flatter than this are paired by their ends, since rows say nothing about them.
    """
    nothing = Matches.empty()
    if len(left) == 0 or len(right) == 0:
        return nothing
    beside, right_beside = sides(left_grey, left), sides(right_grey, right)
    table, right_table = _table(left, beside), _table(right, right_beside)
    near = relaxation_kernels.neighbours(table, radius, NEIGHBOURS)
    ground = backdrop(left_grey)
    contrast = SIDE_CONTRAST
    for turn in range(2):
        node, value = relaxation_kernels.candidates(
            table, right_table, beside, right_beside, lowest, highest, flat_sine, ground, contrast
        )
        if len(node) == 0:
            return nothing
        standing, belief = _relaxed(node, value, left, right, near, flat_sine, rounds if turn else FIRST_ROUNDS)
        chosen = _unique(node, value, standing, np.flatnonzero(belief >= least_belief), table, right_table)
        if turn == 0:
            contrast = _contrast(table, right_table, node[chosen])
    # What lost against a candidate that is now out of the game gets a second hearing.
    kept = relaxation_kernels.compatible(node, value, chosen, table, right_table)
    node, value = node[kept], value[kept]
    standing, belief = _relaxed(node, value, left, right, near, flat_sine, 4)
    chosen = _unique(node, value, standing, np.flatnonzero(belief >= least_belief), table, right_table)
    chosen = chosen[(value[chosen, 5] > UNALIKE) | (_support(node[chosen, 0], value[chosen], near, len(left)) > ALONE)]
    return Matches(node[chosen, 0], node[chosen, 1], value[chosen, :3], value[chosen, 3:5], belief[chosen])


def _contrast(left: AnyArray, right: AnyArray, node: AnyArray) -> float:
    """How much, grey levels, the sides of matched edges typically differ in this pair, with room to spare."""
    if len(node) < FEW:
        return SIDE_CONTRAST
    difference = np.abs(left[node[:, 0], 6:8] - right[node[:, 1], 6:8]).min(axis=1)
    return float(np.clip(LIKE * np.median(difference), LEAST_CONTRAST, SIDE_CONTRAST))


def _support(left: AnyArray, value: AnyArray, near: tuple[AnyArray, ...], count: int) -> AnyArray:
    """(k,) float64: the share of an edge's neighbourhood that has been matched with disparities like its own."""
    other, gap, place, weight = (a[left] for a in near)
    theirs = np.where(other >= 0, match_of(left, count)[other], -1)
    weight = np.where(theirs >= 0, weight, 0.0)
    difference = np.take_along_axis(value[:, :3], place[..., 0].astype(int), axis=1) - value[theirs, place[..., 1]]
    agrees = np.abs(difference) - relaxation_kernels.SLACK < relaxation_kernels.GRADIENT_END * (gap + 1.0)
    total = weight.sum(axis=1)
    return np.where(total > 0.0, (weight * agrees).sum(axis=1) / np.maximum(total, 1e-9), 1.0)


def _relaxed(
    node: AnyArray,
    value: AnyArray,
    left: Segments,
    right: Segments,
    near: tuple[AnyArray, ...],
    flat_sine: float,
    rounds: int,
) -> tuple[AnyArray, AnyArray]:
    """How strong every candidate is when its turn comes, and its belief."""
    first = np.searchsorted(node[:, 0], np.arange(len(left) + 1))
    right_of = np.argsort(node[:, 1], kind='stable')
    right_first = np.searchsorted(node[right_of, 1], np.arange(len(right) + 1))
    sine = np.abs(left.direction[node[:, 0], 1])
    common = (value[:, 4] - value[:, 3]) / np.maximum(sine, flat_sine)
    length = np.minimum(np.where(sine < flat_sine, left.length[node[:, 0]], common), 80.0)
    other, gap, place, weight = near
    strength, belief = relaxation_kernels.relax(
        node, value, first, other, gap, place, weight, length, right_of, right_first, rounds
    )
    return relaxation_kernels.standing(node, value, strength, belief, first, right_of, right_first), belief


def _unique(
    node: AnyArray, value: AnyArray, strength: AnyArray, among: AnyArray, left: AnyArray, right: AnyArray
) -> AnyArray:
    """Strongest first; a row of a segment is matched once."""
    order = among[np.argsort(-strength[among], kind='stable')]
    chosen: AnyArray = relaxation_kernels.greedy(node, value, order, left, right)
    return chosen
