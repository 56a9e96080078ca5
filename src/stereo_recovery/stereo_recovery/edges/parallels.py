"""Edges along the rows with one known end, and short ones, take their direction from an edge that is parallel to them.

In the space of columns, rows and disparity parallel edges meet where disparity is nil: at their vanishing point. An
edge that is well measured gives that point. An edge known less well whose line in the image goes through it, and whose
own evidence (corners, rough ends) allows it, is taken to be parallel. Points where two well measured edges claim
different directions tell nothing. Where several edges say the same and only the evidence of an edge along the rows is
against it, one of its ends hangs on an edge that was matched wrongly, as happens beside faces that just one eye sees:
it is led on from the better end.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.segments import Segments
from ..matching.matches import Matches
from . import parallel_kernels

# Sigma of disparity at an edge's ends, pixels: edges better than the first lend their direction, edges worse than
# the second borrow one.
LENDER, BORROWER = 0.15, 0.1
# Edges that are not quite as good lend to what is much worse, when they are long: worst sigma, share of the borrower's
# sigma, share of its length.
LONG_LENDER, BETTER, LENGTH_SHARE = 1.0, 0.4, 0.4
# Only edges flatter than this (sine) borrow for that; others when they are short: least sigma of their slope in
# disparity, pixels a pixel, and the lender's share of it.
FLAT = 0.15
VAGUE, CLEARER = 0.001, 0.5
# How far, as a sine, parallel edges miss their vanishing point beyond the sigma of their lines, and the share of
# disparity by which their slopes differ over a length of one pixel.
WANDER, SLOPE_WANDER = 0.002, 2e-5
# An end is believed rather than the other when the edge that tells its depth is so many times longer; one to which no
# other is parallel counts for less.
CLEARLY, UNSUPPORTED = 1.5, 0.3
# Gates, in sigma: of the image, of the edge's own evidence, and between two lenders.
GATE = 3.0
# How far, pixels, the ends of the segments may lie from where the parallel edge has them.
ENDS = 3.0
# That is for ends known so well by the match, pixels, and in proportion for others.
SURE = 4.0


def borrow(
    matches: Matches,
    left: Segments,
    coefficient: AnyArray,
    covariance: AnyArray,
    ends_sigma: AnyArray,
    joints: AnyArray,
    offset: float,
) -> tuple[AnyArray, AnyArray]:
    """Coefficients (n, 2) and covariance (n, 2, 2) of all edges, see :class:`.lines3d.Lines3D`: vague ones improved.

    ends_sigma : (n, 2), pixels: how well the match knows the disparity at the left segment's ends
    joints : (k, 4), see :func:`.lines3d.meetings`: where edges along the rows have their depth from
    offset : pixels, disparity of infinitely far points.
    """
    c, t, extent = left.centre[matches.left], left.direction[matches.left], left.extent[matches.left]
    slope_sigma, length = left.sigma[matches.left, 1], left.length[matches.left]
    ends = np.stack([np.ones_like(extent), extent], axis=-1)
    worst = np.sqrt(np.einsum('nei,nij,nej->ne', ends, covariance, ends)).max(axis=1)
    straight = left.arc[matches.left] < 0
    lenders = np.flatnonzero((worst < LONG_LENDER) & straight)
    flat = np.abs(t[:, 1]) < FLAT
    slope = np.sqrt(covariance[:, 1, 1])
    borrowers = np.flatnonzero(straight & (flat | (slope > VAGUE)))
    coefficient, covariance = coefficient.copy(), covariance.copy()
    if len(lenders) == 0:
        return coefficient, covariance
    long = length[lenders] > LENGTH_SHARE * length[borrowers, None]
    able = np.where(
        flat[borrowers, None],
        (worst[lenders] < LENDER) | ((worst[lenders] < BETTER * worst[borrowers, None]) & long),
        slope[lenders] < CLEARER * slope[borrowers, None],
    )
    able &= lenders != borrowers[:, None]
    own = coefficient - [offset, 0.0]
    told = c, t, own, covariance.copy(), slope_sigma, GATE, WANDER, SLOPE_WANDER
    start, ratios, noises = parallel_kernels.parallel(borrowers, able, lenders, *told)
    tellers = np.flatnonzero(straight & ~flat & (worst < LENDER))
    for f, first, last in zip(borrowers.tolist(), start[:-1].tolist(), start[1:].tolist()):
        if first == last:
            continue
        ratio, noise = ratios[first:last], noises[first:last]
        here = coefficient[f, 0] - offset
        rows = np.stack([ratio, np.ones_like(ratio)], axis=1)
        misses = rows @ [here, coefficient[f, 1]]
        allowed = np.einsum('ni,ij,nj->n', rows, covariance[f], rows) + noise
        fits = misses**2 < GATE**2 * allowed
        if flat[f] and not fits.any() and len(ratio) > 1:
            # Through what the better end knows, as parallel edges run.
            k = int(np.argmin(noise))
            place = None
            if (((ratio - ratio[k]) * here) ** 2 < GATE**2 * (noise + noise[k])).all():
                place = _trusted(f, joints, extent[f].mean(), length, tellers, told)
            if place is not None:
                h = np.array([1.0, place])
                both = np.linalg.inv(np.stack([h, rows[k]]))
                coefficient[f] = both @ [h @ own[f], 0.0] + [offset, 0.0]
                covariance[f] = both @ np.diag([h @ covariance[f] @ h, noise[k]]) @ both.T
            continue
        if not fits.any() or (flat[f] and worst[f] <= BORROWER):
            continue
        rows, misses, noise = rows[fits], misses[fits], noise[fits]
        k = int(np.argmin(noise))
        if ((misses - misses[k]) ** 2 > GATE**2 * (noise + noise[k])).any():
            continue
        # What all of them say, no better known than by the best: they may well be parts of one edge.
        row, miss = np.average(rows, axis=0, weights=noise**-2), float(np.average(misses, weights=noise**-2))
        gain = covariance[f] @ row / (row @ covariance[f] @ row + noise[k])
        update = coefficient[f] - gain * miss
        rough = matches.disparity[f][[0, 2]]
        if (np.abs(update[0] + update[1] * extent[f] - rough) > ENDS * np.maximum(1.0, ends_sigma[f] / SURE)).any():
            continue
        coefficient[f] = update
        covariance[f] = covariance[f] - np.outer(gain, row @ covariance[f])
    return coefficient, covariance


def _trusted(
    f: int, joints: AnyArray, middle: float, length: AnyArray, tellers: AnyArray, told: tuple[Any, ...]
) -> float | None:
    """The place along edge f, along the rows, at which its depth is beyond doubt; None when neither end is better.

    A steep edge to which others are parallel in space was matched rightly, and a long one more likely than a short one.
    told : what :func:`.parallel_kernels.parallel` needs, from the centres on
    """
    own, covariance = told[2:4]
    trust, at = [0.0, 0.0], [0.0, 0.0]
    for a, s, b, r in joints:
        for e, place, other in ((int(a), s, int(b)), (int(b), r, int(a))):
            if e != f or other not in tellers:
                continue
            rest = tellers[tellers != other]
            every = np.ones((1, len(rest)), bool)
            _, ratio, noise = parallel_kernels.parallel(np.array([other]), every, rest, *told)
            rows = np.column_stack([ratio, np.ones_like(ratio)])
            allowed = np.einsum('ni,ij,nj->n', rows, covariance[other], rows) + noise
            supported = ((rows @ own[other]) ** 2 < GATE**2 * allowed).any()
            value, end = float(length[other]) * (1.0 if supported else UNSUPPORTED), int(place > middle)
            if value > trust[end]:
                trust[end], at[end] = value, float(place)
    best = int(np.argmax(trust))
    return at[best] if trust[best] > CLEARLY * trust[1 - best] else None
