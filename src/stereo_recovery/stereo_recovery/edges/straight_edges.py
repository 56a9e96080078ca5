"""Straight edges of a pair of images: what their lines say, one estimate, where they end, and what one image shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from ..estimation.estimate import (
    Estimate,
    by_factors,
    end_sigma,
    estimate,
    told_prior,
    without_accidents,
    without_itself,
)
from ..estimation.factors import Factors, collinear_factors, end_factors, junction_factors, rounded_corner_factors
from ..estimation.parallel_groups import parallel_factors
from ..estimation.settings import GROUP_ROUNDS, MOST_CORNER_SIGMA, REDUNDANCY, WELL_MEASURED
from ..estimation.texture import AlignedStrips, texture_factors
from ..estimation.texture_kernels import ALIGNED, DENSE
from ..matching.stereo_segments import StereoSegments
from ..stopwatch import Late, never
from .extents import followed
from .further_views import ViewLines, joint_lines, view_extents
from .junction_edges import corners, junction_edges
from .lines3d import Lines3D, line_covariance
from .settings import ROUNDED


@dataclass(frozen=True, eq=False)
class Beside:
    """What is known of a pair's edges beside their segments.

    Attributes
    ----------
    rig : StereoRig
    greys : (h, w) float32, (h, w) float32
        Both pictures, grey levels.
    row_sigma : float, pixels
        By which single rows of the two images disagree.
    curves : sequence of Curve
        Planar curves of the pair; their normals are directions of edges as well.
    strips : AlignedStrips, optional
        Of the texture beside the left segments.
    views : sequence of ViewLines
        What further cameras say of the edges.
    late : callable
        Whether it is too late for one more estimate.
    """

    rig: StereoRig
    greys: tuple[Float32Array, Float32Array]
    row_sigma: float
    curves: Sequence[Curve] = ()
    strips: AlignedStrips | None = None
    views: Sequence[ViewLines] = ()
    late: Late = never


def _as_they_meet(factors: Factors, found: Estimate) -> Factors:
    """Statements that edges meet, with the sigma that each shows: most corners are sharp, some are rounded.

    The residual of a corner has a heavy tail, Student's with one degree of freedom; this is its weight.
    """
    off, variance = without_itself(found.factors, found.solution, found.used)
    excess = np.clip(off**2 - variance, 0.0, MOST_CORNER_SIGMA**2)[: len(factors)]
    heavy = np.sqrt(0.5 * (factors.sigma**2 + np.maximum(excess, factors.sigma**2)))
    return replace(factors, sigma=np.where(factors.other >= 0, heavy, factors.sigma))


def _texture(
    seen: StereoSegments, known: BoolArray, own: tuple[FloatArray, FloatArray], strips: AlignedStrips | None
) -> list[Factors]:
    """What the texture beside edges says, trusted as far as those (n,) that know their disparity tell.

    own : unknowns (n, 2) and covariance (n, 2, 2) by each edge's own lines
    """
    result = []
    for told_by in (ALIGNED, DENSE):
        texture = texture_factors(seen, np.flatnonzero(seen.straight), strips, told_by)
        prior = told_prior(texture, known, *own)
        result.append(replace(texture, prior=prior).select(~known[texture.edge]))
    return result


def _scatter(found: Estimate, parallel: int) -> float:
    """How much slopes miss what groups say of them beyond the sigmas, whose own word counts as well; px a pixel.

    parallel : the first of the factors that groups make
    """
    off, variance = without_itself(found.factors, found.solution, found.used)
    told = parallel + np.flatnonzero(~np.isnan(found.misfit[parallel:]))
    excess = off[told] ** 2 - (variance[told] + found.factors.sigma[told] ** 2)
    total = float((excess / found.factors.row[told, 1] ** 2).sum())
    return float(np.sqrt(max(total, 0.0) / (len(told) + REDUNDANCY)))


def solved(seen: StereoSegments, beside: Beside) -> Estimate:
    """The disparities of all edges: first without parallel groups, which known edges show, then with them.

    Parameters are those of :func:`edges`.
    """
    disparity = seen.matches.disparity
    lines = joint_lines(seen, beside.row_sigma, beside.views).about(disparity[:, 1])
    known = end_sigma(lines.covariance, lines).max(axis=1) < WELL_MEASURED
    slope = (disparity[:, 2] - disparity[:, 0]) / np.maximum(np.diff(lines.extent)[:, 0], 1.0)
    x = np.stack([disparity[:, 1] - slope * lines.extent.mean(axis=1), slope], axis=1)
    # Only what the right image shows of junctions depends on the unknowns.
    fixed = [make(seen) for make in (rounded_corner_factors, collinear_factors, end_factors)]
    fixed += _texture(seen, known, (lines.x, lines.covariance), beside.strips)
    factors = Factors.concatenate([junction_factors(seen, (x, lines.covariance)), *fixed])
    found = estimate(lines, factors, np.zeros(len(factors), bool))
    for _ in range(GROUP_ROUNDS):
        if beside.late():
            break
        so_far = found.x, found.covariance
        own = _as_they_meet(Factors.concatenate([junction_factors(seen, so_far), *fixed]), found)
        alone = by_factors(lines, own, found.used[: len(own)], found)
        parallel = parallel_factors(seen.segments[0], seen.matches.left, so_far, alone, beside.curves, beside.rig)
        used = np.concatenate([found.used[: len(own)], np.zeros(len(parallel), bool)])
        found = estimate(lines, Factors.concatenate([own, parallel]), used, len(own), found.place)
        # What is called parallel is so nearly: groups tell slopes no better than their edges agree with them.
        more = _scatter(found, len(own))
        if more > 0.0:
            parallel = replace(parallel, sigma=np.hypot(parallel.sigma, more * parallel.row[:, 1]))
            found = estimate(lines, Factors.concatenate([own, parallel]), found.used, len(own), found.place)
    return found


def edges(seen: StereoSegments, beside: Beside) -> tuple[Lines3D, tuple[Segments, Segments]]:
    """All straight edges of a pair of images.

    Parameters
    ----------
    seen : StereoSegments
        Matched segments.
    beside : Beside

    Returns
    -------
    Lines3D
    (Segments, Segments)
        Of both images, that the lines refer to: with those that the other image alone shows.
    """
    found = solved(seen, beside)
    covariance = without_accidents(found)
    own = followed(seen, (found.x, covariance), beside.greys)
    ends = view_extents(beside.views, seen, found.x, own)
    left = seen.matches.left
    lines = Lines3D(
        left,
        seen.matches.right,
        ends.abscissa,
        found.x,
        covariance,
        found.unit_variance * line_covariance(seen.segments[0], left),
        found.lines.covariance_with_line(covariance),
        ends.sigma,
    )
    more = junction_edges(seen, corners(seen, found, ends))
    if more is None:
        return lines, seen.segments
    count = len(more.extent)
    left, right = (len(side) + np.arange(count, dtype=np.int32) for side in seen.segments)
    added = Lines3D(
        left,
        right,
        more.extent,
        more.coefficient,
        more.covariance,
        line_covariance(more.segments[0], left),
        np.zeros((count, 2, 2)),
        np.full((count, 2), ROUNDED),
    )
    return Lines3D.concatenate([lines, added]), more.segments
