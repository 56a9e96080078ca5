"""Straight edges in space from matched segments: disparity along the left line, linear, and its covariance.

Along a left line with points c + s t, disparity is d(s) = a + b s. The matched right line measures it wherever the
edge leaves the rows; an edge along the rows is hardly measured at all. What both lines know is kept as an information
matrix, so that the two cases need no distinction, and corners add what they know: two edges that meet have the same
disparity at their corner (figural continuity). One linear least squares per connected wire frame solves all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments, ends_exchanged, reversed_polarity
from ..detection.settings import SAGITTA_OFFSET, SAGITTA_SLOPE
from ..matching.matches import Matches
from . import broken_edges, corner_matching, flat_edges, vertices, wireframe
from .parallels import borrow

# An edge whose disparity is known better than this at its ends, pixels, need not be told by others.
WELL_MEASURED = 0.3
# How well a corner's height is known in an image, pixels.
CORNER_HEIGHT = 0.05
# Corners that edges add add edges, so many times.
CORNER_ROUNDS = 2
# What makes corners doubtful, and how much, pixels, one sigma: an edge that goes on behind or before the other; short
# edges; a chain that ends so far from the corner.
HIDDEN = 0.3
SHORT_EDGE, SMALL = 15.0, 0.15
FAR_GAP, FAR = 6.0, 0.3
# How uncertainly a chain stops without a corner, pixels; and how much of an edge may be lost that way in one image,
# pixels and as a share of the rest.
LOST = 4.0
LOST_LEAST, LOST_SHARE = 20.0, 0.5
# Corners of one edge that are farther apart, pixels, are two.
SAME_CORNER = 1.5
# Two segments show the same part of an edge when their lengths agree to this share; of the square of a line's sigma, so
# much at least is not its sagitta's.
SAME_EXTENT = 0.15
LEAST_SHARE = 0.01
# Coefficients (n, 2) and covariances (n, 2, 2) of matched edges, what the match knows of their ends (n, 2), and joints.
Solution = tuple[AnyArray, AnyArray, AnyArray, AnyArray]


@dataclass(frozen=True, eq=False)
class Lines3D:
    """n straight edges seen in both images.

    Attributes
    ----------
    left, right : (n,) int32
        The segments.
    extent : (n, 2) float64
        Pixels along the left segment: the part both see.
    coefficient : (n, 2) float64
        Disparity a + b s.
    covariance : (n, 2, 2)
        Of them.
    end_sigma : (n, 2) float64
        Pixels, of the extent.
    fixed : (n, 2) bool
        The end is a corner.
    strut : (n,) bool
        The edge runs from one known corner to another, whatever its segments say.
    """

    left: AnyArray
    right: AnyArray
    extent: AnyArray
    coefficient: AnyArray
    covariance: AnyArray
    end_sigma: AnyArray
    fixed: AnyArray
    strut: AnyArray

    def __len__(self) -> int:
        return len(self.left)


def row_error(
    matches: Matches, left: Segments, right: Segments, junctions: Junctions, right_junctions: Junctions
) -> tuple[float, float]:
    """How far the right image's rows lie below the left's, and how much that varies, pixels.

    From corners that both images show: they should be at one height. Too few of them say nothing: (0, 0).
    """
    partner = np.full(len(left), -1)
    partner[matches.left[::-1]] = matches.right[::-1]
    i, j = matches.left, matches.right
    # Both images' segments run the same way, and their neighbours at the corner were matched with each other.
    same_way = ~reversed_polarity(left, right, i, j)
    k, m = junctions.neighbour[i], right_junctions.neighbour[j]
    agreed = (k >= 0) & (m >= 0) & (partner[k] == m) & same_way[:, None] & (partner[i] == j)[:, None]
    agreed &= (junctions.sigma[i] < 0.3) & (right_junctions.sigma[j] < 0.3)
    heights = [
        side.centre[index][:, 1:] + corner.abscissa[index] * side.direction[index][:, 1:]
        for side, index, corner in ((left, i, junctions), (right, j, right_junctions))
    ]
    difference = (heights[1] - heights[0])[agreed]
    difference = difference[np.abs(difference) < 2.0]
    if len(difference) < 12:
        return 0.0, 0.0
    middle = float(np.median(difference))
    return middle, 1.4826 * float(np.median(np.abs(difference - middle)))


def measure(
    matches: Matches,
    left: Segments,
    right: Segments,
    rectification_sigma: float,
    offset_v: float = 0.0,
    ends_sigma: AnyArray | None = None,
) -> tuple[AnyArray, AnyArray]:
    """What the two fitted lines say: information (n, 2, 2) and information vector (n, 2) of a, b.

    rectification_sigma : pixels by which the two images' rows may disagree; offset_v : by which they do on the whole;
    ends_sigma : (n, 2), pixels: how well the match knows the disparity at the left segment's ends.
    """
    if ends_sigma is None:
        ends_sigma = np.full((len(matches), 2), flat_edges.MATCH_SIGMA)
    i, j = matches.left, matches.right
    cl, tl, cr, tr = left.centre[i], left.direction[i], right.centre[j] - [0.0, offset_v], right.direction[j]
    middle = 0.5 * (left.extent[i, 0] + left.extent[i, 1])
    # Signed distance of the left line's points, taken at their own column, from the right line is tr_v d(s).
    offset = tr[:, 1] * (cl[:, 0] - cr[:, 0]) - tr[:, 0] * (cl[:, 1] - cr[:, 1])
    slope = tr[:, 1] * tl[:, 0] - tr[:, 0] * tl[:, 1]
    # The place on the right line that a place on the left one corresponds to: p + q s.
    b = (matches.disparity[:, 2] - matches.disparity[:, 0]) / np.maximum(left.length[i], 1.0)
    a = matches.disparity[:, 1] - b * middle
    p = (cl[:, 0] - a - cr[:, 0]) * tr[:, 0] + (cl[:, 1] - cr[:, 1]) * tr[:, 1]
    q = (tl[:, 0] - b) * tr[:, 0] + tl[:, 1] * tr[:, 1]
    sl, sr = _without_common_sagitta(left, right, i, j, b)
    covariance = np.empty((len(i), 2, 2))
    covariance[:, 0, 0] = sl[:, 0] ** 2 + sr[:, 0] ** 2 + (p * sr[:, 1]) ** 2 + (tr[:, 0] * rectification_sigma) ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = p * q * sr[:, 1] ** 2
    # Rows that disagree by different amounts at the two ends turn the line.
    turn = np.sqrt(2.0) * tr[:, 0] * rectification_sigma / np.maximum(left.length[i], 1.0)
    covariance[:, 1, 1] = sl[:, 1] ** 2 + (q * sr[:, 1]) ** 2 + turn**2
    inverse = np.linalg.inv(covariance)
    information = inverse * (tr[:, 1] ** 2)[:, None, None]
    vector = np.einsum('nij,nj->ni', inverse, np.stack([offset, slope], axis=1)) * tr[:, 1:2]
    for end, column in ((0, 0), (1, 2)):
        row = np.stack([np.ones(len(i)), left.extent[i, end]], axis=1)
        weight = 1.0 / ends_sigma[:, end] ** 2
        information += np.einsum('ni,nj->nij', row, row) * weight[:, None, None]
        vector += row * (matches.disparity[:, column] * weight)[:, None]
    return information, vector


def _without_common_sagitta(
    left: Segments, right: Segments, i: AnyArray, j: AnyArray, slope: AnyArray
) -> tuple[AnyArray, AnyArray]:
    """Sigma (n, 2) of segments i and j without the sagitta that both share: such an edge is bent in space.

    slope : (n,) of disparity along the left segment.
    """
    same_way = ~reversed_polarity(left, right, i, j)
    sagittas = left.sagitta[i], np.where(same_way, 1.0, -1.0) * right.sagitta[j]
    shrink = np.hypot(left.direction[i, 0] - slope, left.direction[i, 1])
    seen_alike = np.abs(right.length[j] / np.maximum(left.length[i] * shrink, 1.0) - 1.0) < SAME_EXTENT
    common = np.where(
        seen_alike & (sagittas[0] * sagittas[1] > 0.0), np.minimum(np.abs(sagittas[0]), np.abs(sagittas[1])), 0.0
    )
    result = []
    for side, index, sagitta in ((left, i, sagittas[0]), (right, j, sagittas[1])):
        length = np.maximum(side.length[index], 1.0)
        excess = np.stack([SAGITTA_OFFSET * np.ones(len(index)), SAGITTA_SLOPE / length], axis=1) ** 2
        left_over = (np.abs(sagitta) - common) ** 2 - sagitta**2
        result.append(
            np.sqrt(
                np.maximum(side.sigma[index] ** 2 + excess * left_over[:, None], LEAST_SHARE * side.sigma[index] ** 2)
            )
        )
    return result[0], result[1]


def meetings(
    matches: Matches, left: Segments, right: Segments, junctions: Junctions, right_junctions: Junctions
) -> AnyArray:
    """Corners at which two matched edges share their end: (k, 4) float64: edge, place along it, edge, place along it.

    An end that runs into the middle of another edge is (mostly) hidden by it, in either image, and is left out.
    """
    edge_of = np.full(len(left), -1)
    edge_of[matches.left[::-1]] = np.arange(len(matches))[::-1]
    turned = reversed_polarity(left, right, matches.left, matches.right).astype(int)
    rows = []
    seen = set()
    for e in range(len(matches)):
        i = matches.left[e]
        if edge_of[i] != e:
            continue
        for end in range(2):
            k = junctions.neighbour[i, end]
            if k < 0 or junctions.t_junction[i, end] or right_junctions.t_junction[matches.right[e], end ^ turned[e]]:
                continue
            f = edge_of[k]
            if f < 0 or (f, e) in seen or matches.right[f] == matches.right[e]:
                continue
            x = left.centre[i] + junctions.abscissa[i, end] * left.direction[i]
            place = (x - left.centre[k]) @ left.direction[k]
            # The other has a corner of its own there, and does not reach this one.
            its = int(abs(place - junctions.abscissa[k, 1]) < abs(place - junctions.abscissa[k, 0]))
            beyond = (place - junctions.abscissa[k, its]) * (1.0 if its else -1.0)
            if junctions.neighbour[k, its] >= 0 and beyond > SAME_CORNER + 3.0 * np.hypot(
                junctions.sigma[i, end], junctions.sigma[k, its]
            ):
                continue
            seen.add((e, f))
            rows.append((e, junctions.abscissa[i, end], f, place))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _solved(
    matches: Matches,
    left: Segments,
    right: Segments,
    junctions: Junctions,
    right_junctions: Junctions,
    spread_v: float,
    offset_v: float,
) -> tuple[Matches, Solution]:
    """The matches with the disparities of their ends, and what corners make of them."""
    rough, ends_sigma = flat_edges.rough_ends(matches, left, right, junctions, right_junctions)
    matches = replace(matches, disparity=np.column_stack([rough[:, 0], rough.mean(axis=1), rough[:, 1]]))
    information, vector = measure(matches, left, right, spread_v, offset_v, ends_sigma)
    i = matches.left
    joints = meetings(matches, left, right, junctions, right_junctions)
    coefficient, covariance, known = wireframe.solve_measured(
        information, vector, joints, left.extent[i], WELL_MEASURED
    )
    far, _ = flat_edges.far_corners(matches, left, right, junctions)
    joints, far = (
        rows[flat_edges.confirmed(rows, known, coefficient, matches, left, right, right_junctions)]
        for rows in (joints, far)
    )
    joints = joints[~(known[joints[:, 0].astype(int)] & known[joints[:, 2].astype(int)])]
    mixed = np.concatenate([joints, far, flat_edges.same_lines(matches, left, right)])
    coefficient, covariance = flat_edges.solve(
        information,
        vector,
        known,
        coefficient,
        covariance,
        mixed,
        flat_edges.shared_corners(matches, left, right, junctions, right_junctions, spread_v),
    )
    return matches, (coefficient, covariance, ends_sigma, mixed)


def edges(
    matches: Matches,
    left: Segments,
    right: Segments,
    junctions: Junctions,
    right_junctions: Junctions,
    rectification_sigma: float,
    offset: float = 0.0,
    cluttered: bool = False,
) -> tuple[Lines3D, Segments, Segments]:
    """All straight edges of a pair of images, and the segments of both, with the fragments of an edge made one.

    rectification_sigma : see :func:`measure`; offset : pixels, disparity of infinitely far points; cluttered : so much
    print ends near the edges that its corners cannot speak against them.
    """
    offset_v, spread_v = row_error(matches, left, right, junctions, right_junctions)
    # Only what exceeds the error of corners' heights is the rig's.
    spread_v = max(rectification_sigma, spread_v - CORNER_HEIGHT)
    if abs(offset_v) < max(spread_v, CORNER_HEIGHT):
        offset_v = 0.0
    sides, ends = (left, right), (junctions, right_junctions)

    def solved(of: Matches) -> tuple[Matches, Solution, tuple[AnyArray, AnyArray], vertices.Vertices]:
        of, solution = _solved(of, left, right, junctions, right_junctions, spread_v, offset_v)
        # Parallel edges tell the depth of one along the rows, and so that of its corners.
        told = borrow(of, left, *solution, offset)
        return of, solution, told, vertices.vertices(of, sides, ends, *told, offset_v)

    matches, solution, told, known = solved(matches)
    wrong = vertices.contradicted(matches, sides, known, offset_v) & (not cluttered)
    if wrong.any():
        matches, solution, told, known = solved(matches.select(~wrong))
    first = len(matches)
    for _ in range(CORNER_ROUNDS):
        grown = corner_matching.more_matches(matches, sides, ends, known, offset_v)
        if grown is None:
            break
        matches, solution, told, known = solved(grown)
    coefficient, covariance, ends_sigma, joints = solution
    # What just one image shows between corners needs better ones.
    known = vertices.vertices(matches, sides, ends, coefficient, covariance, offset_v)
    i, j = matches.left, matches.right
    strut = np.arange(len(i)) >= first
    whole = broken_edges.complete(matches, left, right, *told)
    if whole:
        matches, left, coefficient, covariance, ends_sigma = broken_edges.with_whole(
            whole, matches, left, coefficient, covariance, ends_sigma
        )
        joints = wireframe.among(joints, ~np.isin(i, np.concatenate([edge.members for edge in whole])))
        strut = np.isin(matches.left, i[strut])
        i, j = matches.left, matches.right
        told = borrow(matches, left, coefficient, covariance, ends_sigma, joints, offset)
    coefficient, covariance = told
    cl, tl = left.centre[i], left.direction[i]
    # The right segment's ends as places along the left one, by row or by column, whichever it follows.
    # Contrast may change its sign between the views, and with it the right segment's direction.
    flip = reversed_polarity(left, right, i, j)
    right_place, right_sigma, right_other, right_through = (
        ends_exchanged(a[j], flip)
        for a in (
            right_junctions.abscissa,
            right_junctions.sigma,
            right_junctions.neighbour,
            right_junctions.t_junction,
        )
    )
    x = right.centre[j][:, None] + right_place[..., None] * right.direction[j][:, None]
    by_row = np.abs(right.direction[j][:, 1:2]) > 0.3
    tv = np.where(np.abs(tl[:, 1:2]) < 1e-3, 1e-3, tl[:, 1:2])
    run = tl[:, :1] - coefficient[:, 1:2]
    run = np.where(np.abs(run) < 1e-3, 1e-3, run)
    seen = np.where(by_row, (x[..., 1] - cl[:, 1:2]) / tv, (x[..., 0] - cl[:, :1] + coefficient[:, :1]) / run)
    mine, fixed = junctions.abscissa[i], junctions.neighbour[i] >= 0
    sigma = np.hypot(junctions.sigma[i], doubt(left, junctions)[i])
    inner = np.stack([np.maximum(mine[:, 0], seen[:, 0]), np.minimum(mine[:, 1], seen[:, 1])], axis=1)
    # Two corners that agree are one corner; the left image's is where its line is known.
    same = fixed & (np.abs(seen - mine) < 1.5) & ~junctions.t_junction[i] & ~right_through
    extent = np.where(same, mine, inner)
    cut = ~same & (inner != mine)
    sigma = np.where(cut, np.where(right_other >= 0, right_sigma, LOST), np.where(fixed, sigma, LOST))
    fixed &= ~cut
    # A chain that just stops is lost, not hidden: the edge goes on to the corner that the other image shows.
    span = np.maximum(inner[:, 1] - inner[:, 0], 1.0)[:, None]
    lost_right = cut & (junctions.neighbour[i] >= 0) & ~junctions.t_junction[i] & (right_other < 0)
    lost_left = (junctions.neighbour[i] < 0) & (inner == mine) & (right_other >= 0) & ~right_through
    lost = (lost_right | lost_left) & (np.abs(seen - mine) < np.maximum(LOST_LEAST, LOST_SHARE * span))
    extent = np.where(lost, np.where(lost_right, mine, seen), extent)
    sigma = np.where(lost, np.where(lost_right, junctions.sigma[i], right_sigma), sigma)
    fixed |= lost
    for row, edge in enumerate(whole, len(i) - len(whole)):
        extent[row], sigma[row], fixed[row] = edge.extent, edge.end_sigma, edge.fixed
    found = vertices.between(matches, (left, right), ends, known, offset_v)
    if not found:
        return Lines3D(i, j, extent, coefficient, covariance, sigma, fixed, strut), left, right
    more = vertices.struts(found, (left, right), offset_v)
    k = len(found)
    i, j = (np.append(index, len(side) + np.arange(k)).astype(np.int32) for index, side in ((i, left), (j, right)))
    return Lines3D(
        i,
        j,
        np.concatenate([extent, more.extent]),
        np.concatenate([coefficient, more.coefficient]),
        np.concatenate([covariance, more.covariance]),
        np.concatenate([sigma, more.end_sigma]),
        np.concatenate([fixed, np.ones((k, 2), bool)]),
        np.append(strut, np.ones(k, bool)),
    ), *more.segments


def doubt(segments: Segments, junctions: Junctions) -> AnyArray:
    """(n, 2) float64, pixels: sigma of a corner beyond that of its lines: short, hidden or far edges."""
    other = junctions.neighbour
    x = segments.centre[:, None] + junctions.abscissa[..., None] * segments.direction[:, None]
    along = ((x - segments.centre[other]) * segments.direction[other]).sum(axis=2)
    beyond = np.maximum(segments.extent[other, 0] - along, along - segments.extent[other, 1])
    short = np.minimum(segments.length[:, None], segments.length[other]) < SHORT_EDGE
    variance = (HIDDEN * junctions.t_junction) ** 2 + (SMALL * short) ** 2 + (FAR * (beyond > FAR_GAP)) ** 2
    extra: AnyArray = np.sqrt(variance) * (other >= 0)
    return extra


@dataclass(frozen=True, eq=False)
class EdgesInSpace:
    """Straight edges in the left optical frame: end points (n, 2, 3), metres, and their 3 sigma bounds (n,), metres."""

    ends: AnyArray
    err_par: AnyArray
    err_per: AnyArray


def to_space(lines: Lines3D, left: Segments, rig: StereoRig) -> EdgesInSpace:
    """End points and 3 sigma bounds along and across (DESIGN section 8). Points beyond infinity give NaN."""
    c, t = left.centre[lines.left][:, None], left.direction[lines.left][:, None]
    s = lines.extent[..., None]
    pixel = c + s * t
    d = lines.coefficient[:, :1] + lines.coefficient[:, 1:] * lines.extent
    true_d = d - (rig.left.cx - rig.right.cx)
    points = rig.triangulate(pixel, pixel[..., 0] - d)
    with np.errstate(divide='ignore', invalid='ignore'):
        scale = points[..., 2] / rig.left.fx
        scale_v = points[..., 2] / rig.left.fy
        by_disparity = -points / true_d[..., None]
        zero = np.zeros_like(scale)
        along = (
            np.stack([t[..., 0] * scale, t[..., 1] * scale_v, zero], axis=-1)
            + lines.coefficient[:, 1:, None] * by_disparity
        )
        across = np.stack([-t[..., 1] * scale, t[..., 0] * scale_v, zero], axis=-1)
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        direction = along / length
        h = np.stack([np.ones_like(lines.extent), lines.extent], axis=-1)
        sigma_d = np.sqrt(np.einsum('nei,nij,nej->ne', h, lines.covariance, h))
        # Along an edge that recedes its depth counts as much as its place in the picture.
        deep = (by_disparity * direction).sum(-1) * sigma_d
        err_par = 3.0 * np.sqrt(((lines.end_sigma * length[..., 0]) ** 2 + deep**2).mean(axis=1))
        sigma = left.sigma[lines.left]
        sigma_e = np.sqrt(sigma[:, :1] ** 2 + (sigma[:, 1:] * lines.extent) ** 2)
        spread = np.zeros(points.shape + (3,))
        for vector, size in ((across, sigma_e), (by_disparity, sigma_d)):
            v = (vector - (vector * direction).sum(-1, keepdims=True) * direction) * size[..., None]
            spread += v[..., :, None] * v[..., None, :]
        spread = np.where(np.isfinite(spread), spread, 0.0)
        # One bound for both ends: their quadratic mean, as the direction has it.
        err_per = 3.0 * np.sqrt(np.linalg.eigvalsh(spread)[..., -1].mean(axis=1))
    return EdgesInSpace(points, err_par, err_per)
