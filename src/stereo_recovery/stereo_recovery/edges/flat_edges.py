"""Where edges along the rows are: they have no disparity of their own, but they meet edges that have.

Joints and corners are gathered from both images, those that the right image contradicts are dropped, and each flat edge
is solved from what is left. Flat edges tell the well measured ones nothing.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments, ends_exchanged, reversed_polarity
from ..matching.matches import Matches
from . import wireframe

# Segments flatter than this (sine) have no depth of their own. Two of them are one broken line when each misses the
# other's line by less than so many pixels, they differ in direction by less than this sine, and the break is short.
FLAT = 0.15
ONE_LINE = 0.7
ONE_DIRECTION = 0.025
WIDEST_BREAK = 60.0
# What the match itself says about disparity at a segment's ends, pixels: enough to keep flat edges finite. Less where
# the chain ends without a corner, and next to nothing where something hides its end.
MATCH_SIGMA, STRAY_SIGMA, HIDDEN_SIGMA = 3.0, 15.0, 60.0
# Heights of one corner in the two images differ by less than this, pixels.
SAME_HEIGHT = 0.6
# A chain may be lost before its corner (a thin face beside it, blur): its line must then hit the end of the same edge
# in both images, at most so many pixels and this share of its length away, and miss that end by less than this.
FAR_GAP, FAR_SHARE = 40.0, 0.5
END_MISS = 4.0
LEAST_SINE = 0.15
# In the right image a corner's chain ends this near to it, pixels beyond and before, and corners found in both images
# agree to this.
BEYOND, BEFORE = 4.0, 18.0
SAME_CORNER = 1.5


def rough_ends(
    matches: Matches, left: Segments, right: Segments, junctions: Junctions, right_junctions: Junctions
) -> tuple[AnyArray, AnyArray]:
    """Disparity at the left segment's ends as the match has it, and its sigma: (n, 2) float64, pixels.

    Chains of flat edges end at different places in the two images; where both run into a corner, the corners count. An
    end that runs into the middle of another edge is hidden there, in each eye at another place.
    """
    i, j = matches.left, matches.right
    flip = reversed_polarity(left, right, i, j)
    place, other, through = (
        ends_exchanged(a[j], flip)
        for a in (right_junctions.abscissa, right_junctions.neighbour, right_junctions.t_junction)
    )
    flat = np.abs(left.direction[i, 1:2]) < FLAT
    both = (junctions.neighbour[i] >= 0) & (other >= 0)
    sigma = np.where(both, MATCH_SIGMA, STRAY_SIGMA)
    sigma = np.where(
        both & ~_same_neighbour(matches, len(left), len(right), junctions.neighbour[i], other), HIDDEN_SIGMA, sigma
    )
    sigma = np.where(junctions.t_junction[i] | through, HIDDEN_SIGMA, sigma)
    x = left.centre[i, :1] + junctions.abscissa[i] * left.direction[i, :1]
    y = right.centre[j, :1] + place * right.direction[j, :1]
    disparity = np.where(flat & both, x - y, matches.disparity[:, [0, 2]])
    return disparity, np.where(flat, sigma, MATCH_SIGMA)


def _same_neighbour(matches: Matches, lefts: int, rights: int, k: AnyArray, m: AnyArray) -> AnyArray:
    """Whether left segments k and right segments m may be one edge: they are matched, or neither is with any other."""
    partner, taken = np.full(lefts, -1), np.zeros(rights, bool)
    partner[matches.left[::-1]] = matches.right[::-1]
    taken[matches.right] = True
    same: AnyArray = (partner[k] == m) | ((partner[k] < 0) & ~taken[m])
    return same


def shared_corners(
    matches: Matches,
    left: Segments,
    right: Segments,
    junctions: Junctions,
    right_junctions: Junctions,
    rectification_sigma: float,
) -> AnyArray:
    """Ends that are corners in both images, at one height: (k, 4) float64: edge, place along it, disparity, sigma.

    They say where an edge along the rows is even when its neighbour there was not matched. If it was, it has to have
    been matched with the neighbour in the other image.
    """
    partner = np.full(len(left), -1)
    partner[matches.left[::-1]] = matches.right[::-1]
    taken = np.zeros(len(right), bool)
    taken[matches.right] = True
    rows = []
    turned = reversed_polarity(left, right, matches.left, matches.right).astype(int)
    for e, (i, j) in enumerate(zip(matches.left, matches.right)):
        for end in range(2):
            far = end ^ turned[e]
            k, m = junctions.neighbour[i, end], right_junctions.neighbour[j, far]
            if k < 0 or m < 0 or junctions.t_junction[i, end] or right_junctions.t_junction[j, far]:
                continue
            if partner[k] != m and (partner[k] >= 0 or taken[m]):
                continue
            x = left.centre[i] + junctions.abscissa[i, end] * left.direction[i]
            y = right.centre[j] + right_junctions.abscissa[j, far] * right.direction[j]
            sigma = np.sqrt(
                junctions.sigma[i, end] ** 2
                + right_junctions.sigma[j, far] ** 2
                + wireframe.CORNER_SIGMA**2
                + rectification_sigma**2
            )
            if abs(x[1] - y[1]) < SAME_HEIGHT:
                rows.append((e, junctions.abscissa[i, end], x[0] - y[0], sigma))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def far_corners(matches: Matches, left: Segments, right: Segments, junctions: Junctions) -> tuple[AnyArray, AnyArray]:
    """Corners that the chains of flat edges do not reach, but their lines do, in both images.

    Returns joints (k, 4), see :func:`.lines3d.meetings`, the flat edge first, and its ends (k,) int.
    """
    sine = np.abs(left.direction[matches.left, 1])
    steep = np.flatnonzero((sine > 2.0 * FLAT) & (left.arc[matches.left] < 0))
    rows, ends = [], []
    if len(steep) == 0:
        return np.zeros((0, 4)), np.zeros(0, int)
    flips = reversed_polarity(left, right, matches.left, matches.right).astype(int)
    lengths = [side.length[index] for side, index in ((left, matches.left), (right, matches.right))]
    for e in np.flatnonzero((sine < FLAT) & (left.arc[matches.left] < 0)):
        for end in (0, 1):
            if junctions.neighbour[matches.left[e], end] >= 0:
                continue
            far = end ^ flips[e]
            hits = [
                _hits(side, index[e], index[steep], at, length[e])
                for side, index, at, length in (
                    (left, matches.left, end, lengths[0]),
                    (right, matches.right, far, lengths[1]),
                )
            ]
            good = np.flatnonzero(hits[0][3] & hits[1][3])
            # Both images must show the same end of the edge that is met.
            good = good[hits[0][2][good] == hits[1][2][good] ^ flips[steep[good]]]
            if len(good):
                k = good[np.argmin(hits[0][4][good])]
                rows.append((e, hits[0][0][k], steep[k], hits[0][1][k]))
                ends.append(end)
    return np.array(rows, dtype=np.float64).reshape(-1, 4), np.array(ends, dtype=int)


def _hits(side: Segments, k: int, others: AnyArray, end: int, length: float) -> tuple[AnyArray, ...]:
    """Where segment k's line meets others: both abscissas, the other's end, whether it is there, how far beyond."""
    t, u = side.direction[k], side.direction[others]
    run = side.centre[others] - side.centre[k]
    sine = t[0] * u[:, 1] - t[1] * u[:, 0]
    safe = np.where(np.abs(sine) < LEAST_SINE, 1.0, sine)
    s = (run[:, 0] * u[:, 1] - run[:, 1] * u[:, 0]) / safe
    r = (run[:, 0] * t[1] - run[:, 1] * t[0]) / safe
    beyond = (s - side.extent[k, end]) * (1.0 if end else -1.0)
    misses = np.abs(r[:, None] - side.extent[others])
    at = misses.argmin(axis=1)
    there = (
        (np.abs(sine) > LEAST_SINE)
        & (misses.min(axis=1) < END_MISS)
        & (beyond > -END_MISS)
        & (beyond < min(FAR_GAP, FAR_SHARE * length))
    )
    return s, r, at, there, beyond


def confirmed(
    joints: AnyArray,
    known: AnyArray,
    coefficient: AnyArray,
    matches: Matches,
    left: Segments,
    right: Segments,
    right_junctions: Junctions,
) -> AnyArray:
    """(k,) bool: joints that the right image allows: the flat edge's segment ends there in it, too.

    joints : (k, 4), see :func:`.lines3d.meetings`; known : (n,) bool, edges whose coefficient (n, 2) is measured.
    """
    kept = np.ones(len(joints), bool)
    turned = reversed_polarity(left, right, matches.left, matches.right).astype(int)
    for row, (a, s, b, r) in enumerate(joints):
        for e, place, f, its in ((int(a), s, int(b), r), (int(b), r, int(a), s)):
            if known[e] or not known[f]:
                continue
            i, j = matches.left[e], matches.right[e]
            x = left.centre[i] + place * left.direction[i] - [coefficient[f] @ [1.0, its], 0.0]
            there = (x - right.centre[j]) @ right.direction[j]
            end = int(abs(place - left.extent[i, 1]) < abs(place - left.extent[i, 0])) ^ turned[e]
            beyond = (there - right.extent[j, end]) * (1.0 if end else -1.0)
            kept[row] &= -BEYOND < beyond < BEFORE
            if right_junctions.neighbour[j, end] >= 0:
                kept[row] &= (
                    abs(there - right_junctions.abscissa[j, end]) < SAME_CORNER + 3.0 * right_junctions.sigma[j, end]
                )
    return kept


def same_lines(matches: Matches, left: Segments, right: Segments) -> AnyArray:
    """Pairs of flat segments that lie on one line in both images, as joints like those of :func:`meetings`, two a pair.

    Where print or an occluder has broken a long edge, each segment has one true corner; together they have two.
    """
    flat = np.flatnonzero((np.abs(left.direction[matches.left, 1]) < FLAT) & (left.arc[matches.left] < 0))
    if len(flat) < 2:
        return np.zeros((0, 4))
    first, second = (index.ravel() for index in np.meshgrid(flat, flat, indexing='ij'))
    good = matches.left[first] < matches.left[second]
    for side, index in ((left, matches.left), (right, matches.right)):
        first, second = first[good], second[good]
        a, b = index[first], index[second]
        run = side.centre[b] - side.centre[a]
        distance = np.hypot(run[:, 0], run[:, 1])
        across = [np.abs(run[:, 0] * side.direction[k, 1] - run[:, 1] * side.direction[k, 0]) for k in (a, b)]
        half = 0.5 * (side.length[a] + side.length[b])
        turn = np.abs(side.direction[a, 0] * side.direction[b, 1] - side.direction[a, 1] * side.direction[b, 0])
        good = (np.maximum(*across) < ONE_LINE) & (turn < ONE_DIRECTION) & (distance > half - 3.0)
        good &= distance - half < np.minimum(half, WIDEST_BREAK)
    first, second = first[good], second[good]
    a, b = matches.left[first], matches.left[second]
    middle = 0.5 * left.extent.sum(axis=1)
    rows = []
    for at in (a, b):
        x = left.centre[at] + middle[at, None] * left.direction[at]
        place = [((x - left.centre[k]) * left.direction[k]).sum(axis=1) for k in (a, b)]
        rows.append(np.column_stack([first, place[0], second, place[1]]))
    return np.concatenate(rows)


def solve(
    information: AnyArray,
    vector: AnyArray,
    known: AnyArray,
    coefficient: AnyArray,
    covariance: AnyArray,
    joints: AnyArray,
    ends_known: AnyArray,
) -> tuple[AnyArray, AnyArray]:
    """Coefficients (n, 2) and covariance (n, 2, 2) of all edges, the flat ones solved from what the known ones say.

    information, vector : what each edge's own lines say; known : (n,) bool, edges whose coefficients stay
    joints : (k, 4), see :func:`.lines3d.meetings`; ends_known : (k, 4), see :func:`shared_corners`.
    """
    coefficient, covariance = coefficient.copy(), covariance.copy()
    flat = ~known
    if not flat.any():
        return coefficient, covariance
    own_covariance = np.linalg.inv(information)
    own = np.einsum('nij,nj->ni', own_covariance, vector)
    mixed = joints[wireframe.agree(joints, coefficient, covariance)]
    information, vector = information.copy(), vector.copy()
    for a, s, b, r in mixed:
        i, j = int(a), int(b)
        if flat[i] and flat[j]:
            continue
        if flat[j]:
            i, s, j, r = j, r, i, s
        row, other = np.array([1.0, s]), np.array([1.0, r])
        weight = 1.0 / (other @ covariance[j] @ other + wireframe.CORNER_SIGMA**2)
        information[i] += weight * np.outer(row, row)
        vector[i] += weight * row * (other @ coefficient[j])
    for a, s, d, sigma in ends_known:
        i = int(a)
        row = np.array([1.0, s])
        variance = row @ own_covariance[i] @ row + sigma**2
        if flat[i] and (d - row @ own[i]) ** 2 < wireframe.GATE**2 * variance:
            information[i] += np.outer(row, row) / sigma**2
            vector[i] += row * (d / sigma**2)
    among = mixed[flat[mixed[:, 0].astype(int)] & flat[mixed[:, 2].astype(int)]]
    solved, spread = wireframe.joined(information, vector, among)
    coefficient[flat], covariance[flat] = solved[flat], spread[flat]
    return coefficient, covariance
