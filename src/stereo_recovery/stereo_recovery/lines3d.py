"""Straight edges in space from matched pieces: disparity as a linear function along the left line, and its covariance.

Along a left line with points c + s t, disparity is d(s) = a + b s. The matched right line measures it wherever the
edge leaves the rows; an edge along the rows is hardly measured at all. What both lines know is kept as an information
matrix, so that the two cases need no distinction, and corners add what they know: two edges that meet have the same
disparity at their corner (figural continuity). One linear least squares per connected wire frame solves all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from msgs_py import StereoRig

from .matching import Matches
from .parallels import borrow
from .segmentation import Corners, Pieces

# Disparity, pixels, by which two edges may miss each other at a corner they share (rounded corners, blur).
CORNER_SIGMA = 0.05
# Pieces flatter than this (sine) have no depth of their own. Two of them are one broken line when each misses the
# other's line by less than so many pixels, they differ in direction by less than this sine, and the break is short.
FLAT = 0.15
ONE_LINE = 0.7
ONE_DIRECTION = 0.025
WIDEST_BREAK = 60.0
# Heights of one corner in the two images differ by less than this, pixels.
SAME_HEIGHT = 0.6
# What the match itself says about disparity at a piece's ends, pixels: enough to keep flat edges finite.
MATCH_SIGMA = 4.0
# An edge whose disparity is known better than this at its ends, pixels, need not be told by others.
WELL_MEASURED = 0.3
# Corners whose edges disagree by more than this many sigma are occlusions, not corners.
GATE = 3.5


@dataclass(frozen=True, eq=False)
class Lines3D:
    """n straight edges seen in both images.

    left, right : (n,) int32, the pieces; reach : (n, 2) float64, pixels along the left piece: the part both see
    coefficient : (n, 2) float64: disparity a + b s; covariance : (n, 2, 2) of them
    end_sigma : (n, 2) float64, pixels, of the reach; fixed : (n, 2) bool, the end is a corner
    """

    left: np.ndarray
    right: np.ndarray
    reach: np.ndarray
    coefficient: np.ndarray
    covariance: np.ndarray
    end_sigma: np.ndarray
    fixed: np.ndarray

    def __len__(self) -> int:
        return len(self.left)


def row_error(matches: Matches, left: Pieces, right: Pieces, met: Corners, right_met: Corners) -> tuple[float, float]:
    """How far the right image's rows lie below the left's, and how much that varies, pixels.

    From corners that both images show: they should be at one height. Too few of them say nothing: (0, 0).
    """
    partner = np.full(len(left), -1)
    partner[matches.left[::-1]] = matches.right[::-1]
    i, j = matches.left, matches.right
    # Both images' pieces run the same way, and their neighbours at the corner were matched with each other.
    same_way = (left.direction[i] * right.direction[j]).sum(axis=1) > 0.0
    k, m = met.other[i], right_met.other[j]
    agreed = (k >= 0) & (m >= 0) & (partner[k] == m) & same_way[:, None] & (partner[i] == j)[:, None]
    agreed &= (met.sigma[i] < 0.3) & (right_met.sigma[j] < 0.3)
    heights = [side.centre[index][:, 1:] + corner.place[index] * side.direction[index][:, 1:]
               for side, index, corner in ((left, i, met), (right, j, right_met))]
    difference = (heights[1] - heights[0])[agreed]
    difference = difference[np.abs(difference) < 2.0]
    if len(difference) < 12:
        return 0.0, 0.0
    middle = float(np.median(difference))
    return middle, 1.4826 * float(np.median(np.abs(difference - middle)))


def measure(matches: Matches, left: Pieces, right: Pieces, rectification_sigma: float,
            offset_v: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """What the two fitted lines say: information (n, 2, 2) and information vector (n, 2) of a, b.

    rectification_sigma : pixels by which the two images' rows may disagree; offset_v : by which they do on the whole.
    """
    i, j = matches.left, matches.right
    cl, tl, cr, tr = left.centre[i], left.direction[i], right.centre[j] - [0.0, offset_v], right.direction[j]
    middle = 0.5 * (left.reach[i, 0] + left.reach[i, 1])
    # Signed distance of the left line's points, taken at their own column, from the right line is tr_v d(s).
    offset = tr[:, 1] * (cl[:, 0] - cr[:, 0]) - tr[:, 0] * (cl[:, 1] - cr[:, 1])
    slope = tr[:, 1] * tl[:, 0] - tr[:, 0] * tl[:, 1]
    # The place on the right line that a place on the left one corresponds to: p + q s.
    b = (matches.disparity[:, 2] - matches.disparity[:, 0]) / np.maximum(left.length[i], 1.0)
    a = matches.disparity[:, 1] - b * middle
    p = (cl[:, 0] - a - cr[:, 0]) * tr[:, 0] + (cl[:, 1] - cr[:, 1]) * tr[:, 1]
    q = (tl[:, 0] - b) * tr[:, 0] + tl[:, 1] * tr[:, 1]
    sl, sr = left.sigma[i], right.sigma[j]
    covariance = np.empty((len(i), 2, 2))
    covariance[:, 0, 0] = (sl[:, 0] ** 2 + sr[:, 0] ** 2 + (p * sr[:, 1]) ** 2
                           + (tr[:, 0] * rectification_sigma) ** 2)
    covariance[:, 0, 1] = covariance[:, 1, 0] = p * q * sr[:, 1] ** 2
    # Rows that disagree by different amounts at the two ends turn the line.
    turn = np.sqrt(2.0) * tr[:, 0] * rectification_sigma / np.maximum(left.length[i], 1.0)
    covariance[:, 1, 1] = sl[:, 1] ** 2 + (q * sr[:, 1]) ** 2 + turn ** 2
    inverse = np.linalg.inv(covariance)
    information = inverse * (tr[:, 1] ** 2)[:, None, None]
    vector = np.einsum('nij,nj->ni', inverse, np.stack([offset, slope], axis=1)) * tr[:, 1:2]
    for end, column in ((0, 0), (1, 2)):
        row = np.stack([np.ones(len(i)), left.reach[i, end]], axis=1)
        information += np.einsum('ni,nj->nij', row, row) / MATCH_SIGMA ** 2
        vector += row * (matches.disparity[:, column] / MATCH_SIGMA ** 2)[:, None]
    return information, vector


def meetings(matches: Matches, left: Pieces, met: Corners, right_met: Corners) -> np.ndarray:
    """Corners at which two matched edges share their end: (k, 4) float64: edge, place along it, edge, place along it.

    An end that runs into the middle of another edge is (mostly) hidden by it, and is left out; so is a corner whose
    two edges do not meet in the right image.
    """
    edge_of = np.full(len(left), -1)
    edge_of[matches.left[::-1]] = np.arange(len(matches))[::-1]
    rows = []
    seen = set()
    for e in range(len(matches)):
        i = matches.left[e]
        if edge_of[i] != e:
            continue
        for end in range(2):
            k = met.other[i, end]
            if k < 0 or met.through[i, end]:
                continue
            f = edge_of[k]
            if f < 0 or (f, e) in seen or matches.right[f] == matches.right[e]:
                continue
            x = left.centre[i] + met.place[i, end] * left.direction[i]
            seen.add((e, f))
            rows.append((e, met.place[i, end], f, (x - left.centre[k]) @ left.direction[k]))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def shared_corners(matches: Matches, left: Pieces, right: Pieces, met: Corners, right_met: Corners,
                   rectification_sigma: float) -> np.ndarray:
    """Ends that are corners in both images, at one height: (k, 4) float64: edge, place along it, disparity, sigma.

    They say where an edge along the rows is even when its neighbour there was not matched. If it was, it has to have
    been matched with the neighbour in the other image.
    """
    partner = np.full(len(left), -1)
    partner[matches.left[::-1]] = matches.right[::-1]
    taken = np.zeros(len(right), bool)
    taken[matches.right] = True
    rows = []
    for e, (i, j) in enumerate(zip(matches.left, matches.right)):
        same_way = left.direction[i] @ right.direction[j] > 0.0
        for end in range(2):
            far = end if same_way else 1 - end
            k, m = met.other[i, end], right_met.other[j, far]
            if k < 0 or m < 0 or met.through[i, end] or right_met.through[j, far]:
                continue
            if partner[k] != m and (partner[k] >= 0 or taken[m]):
                continue
            x = left.centre[i] + met.place[i, end] * left.direction[i]
            y = right.centre[j] + right_met.place[j, far] * right.direction[j]
            sigma = np.sqrt(met.sigma[i, end] ** 2 + right_met.sigma[j, far] ** 2 + CORNER_SIGMA ** 2
                            + rectification_sigma ** 2)
            if abs(x[1] - y[1]) < SAME_HEIGHT:
                rows.append((e, met.place[i, end], x[0] - y[0], sigma))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def same_lines(matches: Matches, left: Pieces, right: Pieces) -> np.ndarray:
    """Pairs of flat pieces that lie on one line in both images, as joints like those of :func:`meetings`, two a pair.

    Where print or an occluder has broken a long edge, each piece has one true corner; together they have two.
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
    middle = 0.5 * left.reach.sum(axis=1)
    rows = []
    for at in (a, b):
        x = left.centre[at] + middle[at, None] * left.direction[at]
        place = [((x - left.centre[k]) * left.direction[k]).sum(axis=1) for k in (a, b)]
        rows.append(np.column_stack([first, place[0], second, place[1]]))
    return np.concatenate(rows)


def solve(information: np.ndarray, vector: np.ndarray, joints: np.ndarray, reach: np.ndarray,
          ends_known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (n, 2) and covariance (n, 2, 2) of all edges together.

    joints : (k, 4), see :func:`meetings`; reach : (n, 2), pixels, the part of each edge that counts;
    ends_known : (k, 4), see :func:`shared_corners`.
    Edges that measure their own depth well are solved first, at corners where they agree. The others (those along the
    rows) then take what the first know at shared corners, but tell them nothing: a corner that was none must not bend
    a good edge.
    """
    own_covariance = np.linalg.inv(information)
    own = np.einsum('nij,nj->ni', own_covariance, vector)
    ends = np.stack([np.ones_like(reach), reach], axis=-1)
    worst = np.sqrt(np.einsum('nei,nij,nej->ne', ends, own_covariance, ends)).max(axis=1)
    good = worst < WELL_MEASURED
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    both = joints[good[e] & good[f]]
    both = both[_agree(both, own, own_covariance)]
    coefficient, covariance = _solve(information, vector, both)
    left_over = np.abs(_misses(both, coefficient))
    if (left_over > 3.0 * CORNER_SIGMA).any():
        coefficient, covariance = _solve(information, vector, both[left_over <= 3.0 * CORNER_SIGMA])
    flat = ~good
    if flat.any():
        joints = joints[flat[e] | flat[f]]
        mixed = joints[_agree(joints, coefficient, covariance)]
        information, vector = information.copy(), vector.copy()
        for a, s, b, r in mixed:
            i, j = int(a), int(b)
            if flat[i] and flat[j]:
                continue
            if flat[j]:
                i, s, j, r = j, r, i, s
            row, known = np.array([1.0, s]), np.array([1.0, r])
            weight = 1.0 / (known @ covariance[j] @ known + CORNER_SIGMA ** 2)
            information[i] += weight * np.outer(row, row)
            vector[i] += weight * row * (known @ coefficient[j])
        for a, s, d, sigma in ends_known:
            i = int(a)
            row = np.array([1.0, s])
            variance = row @ own_covariance[i] @ row + sigma ** 2
            if flat[i] and (d - row @ own[i]) ** 2 < GATE ** 2 * variance:
                information[i] += np.outer(row, row) / sigma ** 2
                vector[i] += row * (d / sigma ** 2)
        among = mixed[flat[mixed[:, 0].astype(int)] & flat[mixed[:, 2].astype(int)]]
        solved, spread = _solve(information, vector, among)
        coefficient[flat], covariance[flat] = solved[flat], spread[flat]
    return coefficient, covariance


def _misses(joints: np.ndarray, coefficient: np.ndarray) -> np.ndarray:
    """(k,) float64, pixels: by how much disparity two edges miss each other at their corners."""
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    return (coefficient[e, 0] + coefficient[e, 1] * joints[:, 1]
            - coefficient[f, 0] - coefficient[f, 1] * joints[:, 3])


def _agree(joints: np.ndarray, coefficient: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(k,) bool: corners at which the edges' own measurements allow one disparity."""
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    he = np.stack([np.ones(len(e)), joints[:, 1]], axis=1)
    hf = np.stack([np.ones(len(f)), joints[:, 3]], axis=1)
    variance = (np.einsum('ni,nij,nj->n', he, covariance[e], he) + np.einsum('ni,nij,nj->n', hf, covariance[f], hf)
                + CORNER_SIGMA ** 2)
    return _misses(joints, coefficient) ** 2 < GATE ** 2 * variance


def _solve(information: np.ndarray, vector: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares with these corners, one connected wire frame at a time."""
    n = len(information)
    e, f = joints[:, 0].astype(int), joints[:, 2].astype(int)
    _, label = connected_components(coo_matrix((np.ones(len(e)), (e, f)), shape=(n, n)), directed=False)
    coefficient, covariance = np.empty((n, 2)), np.empty((n, 2, 2))
    counts = np.bincount(label, minlength=1)
    alone = counts[label] == 1
    if alone.any():
        covariance[alone] = np.linalg.inv(information[alone])
        coefficient[alone] = np.einsum('nij,nj->ni', covariance[alone], vector[alone])
    for c in np.flatnonzero(counts > 1):
        members = np.flatnonzero(label == c)
        local = {int(m): k for k, m in enumerate(members)}
        matrix = np.zeros((2 * len(members), 2 * len(members)))
        for k, m in enumerate(members):
            matrix[2 * k:2 * k + 2, 2 * k:2 * k + 2] = information[m]
        for a, s, b, r in joints[label[e] == c]:
            x, y = 2 * local[int(a)], 2 * local[int(b)]
            row = np.zeros(len(matrix))
            row[x:x + 2] = 1.0, s
            row[y:y + 2] = -1.0, -r
            index = [x, x + 1, y, y + 1]
            matrix[np.ix_(index, index)] += np.outer(row[index], row[index]) / CORNER_SIGMA ** 2
        inverse = np.linalg.inv(matrix)
        coefficient[members] = (inverse @ vector[members].ravel()).reshape(-1, 2)
        for k, m in enumerate(members):
            covariance[m] = inverse[2 * k:2 * k + 2, 2 * k:2 * k + 2]
    return coefficient, covariance


def edges(matches: Matches, left: Pieces, right: Pieces, met: Corners, right_met: Corners,
          rectification_sigma: float, offset: float = 0.0) -> Lines3D:
    """All straight edges of a pair of segmented images.

    rectification_sigma : see :func:`measure`; offset : pixels, disparity of infinitely far points.
    """
    offset_v, spread_v = row_error(matches, left, right, met, right_met)
    # A corner's height is known to a few hundredths of a pixel; only what exceeds that is the rig's.
    spread_v = max(rectification_sigma, spread_v - 0.05)
    if abs(offset_v) < spread_v:
        offset_v = 0.0
    information, vector = measure(matches, left, right, spread_v, offset_v)
    i, j = matches.left, matches.right
    joints = np.concatenate([meetings(matches, left, met, right_met), same_lines(matches, left, right)])
    coefficient, covariance = solve(information, vector, joints, left.reach[i],
                                    shared_corners(matches, left, right, met, right_met, spread_v))
    coefficient, covariance = borrow(matches, left, coefficient, covariance, offset)
    cl, tl = left.centre[i], left.direction[i]
    # The right piece's ends as places along the left one, by row or by column, whichever it follows.
    # Contrast may change its sign between the views, and with it the right piece's direction.
    flip = (tl * right.direction[j]).sum(axis=1) < 0.0
    turned = np.where(flip[:, None], [1, 0], [0, 1])
    right_place, right_sigma, right_other = (np.take_along_axis(a[j], turned, axis=1)
                                             for a in (right_met.place, right_met.sigma, right_met.other))
    x = right.centre[j][:, None] + right_place[..., None] * right.direction[j][:, None]
    by_row = np.abs(right.direction[j][:, 1:2]) > 0.3
    tv = np.where(np.abs(tl[:, 1:2]) < 1e-3, 1e-3, tl[:, 1:2])
    run = tl[:, :1] - coefficient[:, 1:2]
    run = np.where(np.abs(run) < 1e-3, 1e-3, run)
    seen = np.where(by_row, (x[..., 1] - cl[:, 1:2]) / tv, (x[..., 0] - cl[:, :1] + coefficient[:, :1]) / run)
    mine, sigma, fixed = met.place[i], met.sigma[i].copy(), (met.other[i] >= 0)
    inner = np.stack([np.maximum(mine[:, 0], seen[:, 0]), np.minimum(mine[:, 1], seen[:, 1])], axis=1)
    # Two corners that agree are one corner; the left image's is where its line is known.
    same = fixed & (np.abs(seen - mine) < 1.5)
    reach = np.where(same, mine, inner)
    cut = ~same & (inner != mine)
    sigma = np.where(cut, np.where(right_other >= 0, right_sigma, 1.5), sigma)
    return Lines3D(i, j, reach, coefficient, covariance, sigma, fixed & ~cut)


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight edges in the left optical frame: end points (n, 2, 3), metres, and their 3 sigma bounds (n,), metres."""

    ends: np.ndarray
    err_par: np.ndarray
    err_per: np.ndarray


def to_space(lines: Lines3D, left: Pieces, rig: StereoRig) -> Segments:
    """End points and 3 sigma bounds along and across (DESIGN section 8). Points beyond infinity give NaN."""
    c, t = left.centre[lines.left][:, None], left.direction[lines.left][:, None]
    s = lines.reach[..., None]
    pixel = c + s * t
    d = lines.coefficient[:, :1] + lines.coefficient[:, 1:] * lines.reach
    true_d = d - (rig.left.cx - rig.right.cx)
    points = rig.triangulate(pixel, pixel[..., 0] - d)
    with np.errstate(divide='ignore', invalid='ignore'):
        scale = points[..., 2] / rig.left.fx
        scale_v = points[..., 2] / rig.left.fy
        by_disparity = -points / true_d[..., None]
        zero = np.zeros_like(scale)
        along = (np.stack([t[..., 0] * scale, t[..., 1] * scale_v, zero], axis=-1)
                 + lines.coefficient[:, 1:, None] * by_disparity)
        across = np.stack([-t[..., 1] * scale, t[..., 0] * scale_v, zero], axis=-1)
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        direction = along / length
        err_par = 3.0 * (lines.end_sigma * length[..., 0]).max(axis=1)
        h = np.stack([np.ones_like(lines.reach), lines.reach], axis=-1)
        sigma_d = np.sqrt(np.einsum('nei,nij,nej->ne', h, lines.covariance, h))
        sigma = left.sigma[lines.left]
        sigma_e = np.sqrt(sigma[:, :1] ** 2 + (sigma[:, 1:] * lines.reach) ** 2)
        spread = np.zeros(points.shape + (3,))
        for vector, size in ((across, sigma_e), (by_disparity, sigma_d)):
            v = (vector - (vector * direction).sum(-1, keepdims=True) * direction) * size[..., None]
            spread += v[..., :, None] * v[..., None, :]
        spread = np.where(np.isfinite(spread), spread, 0.0)
        err_per = 3.0 * np.sqrt(np.linalg.eigvalsh(spread)[..., -1]).max(axis=1)
    return Segments(points, err_par, err_per)
