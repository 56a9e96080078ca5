"""Straight edges of a pair of images: what their lines say, one estimate, where they end, and what one image shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import FloatArray

from ..curves.curve import Curve
from ..detection.segments import Segments
from ..matching.stereo_segments import StereoSegments
from ..stopwatch import Late, never
from .corner_matching import inconsistent, matched_by_corners
from .estimate import Estimate, by_factors, estimate, unit_variance
from .extents import Extents, extents
from .factors import Factors, collinear_factors, end_factors, junction_factors, rounded_corner_factors
from .further_views import ViewLines, joint_lines, seen_further, view_extents
from .junction_edges import Corners, corners, junction_edges
from .lines3d import Lines3D, line_covariance
from .parallel_groups import parallel_factors
from .settings import CORNER_ROUNDS, GROUP_ROUNDS, ROUNDED


def solved(
    seen: StereoSegments,
    row_sigma: float,
    curves: Sequence[Curve],
    rig: StereoRig,
    views: Sequence[ViewLines] = (),
    late: Late = never,
) -> tuple[Estimate, FloatArray]:
    """The disparities of all edges: first without parallel groups, which known edges show, then with them.

    Parameters are those of :func:`edges`. Beside the estimate: (n, 2, 2) covariance of the unknowns with offset and
    direction of the left lines.
    """
    disparity = seen.matches.disparity
    lines = joint_lines(seen, row_sigma, views).about(disparity[:, 1])
    slope = (disparity[:, 2] - disparity[:, 0]) / np.maximum(np.diff(lines.extent)[:, 0], 1.0)
    x = np.stack([disparity[:, 1] - slope * lines.extent.mean(axis=1), slope], axis=1)
    # Only what the right image shows of junctions depends on the unknowns.
    fixed = [make(seen) for make in (rounded_corner_factors, collinear_factors, end_factors)]
    factors = Factors.concatenate([junction_factors(seen, x), *fixed])
    found = estimate(lines, factors, np.zeros(len(factors), bool))
    for _ in range(GROUP_ROUNDS):
        if late():
            break
        own = Factors.concatenate([junction_factors(seen, found.x), *fixed])
        alone = by_factors(lines, own, found.used[: len(own)], found.unit_variance)
        known = found.x, found.covariance
        parallel = parallel_factors(seen.segments[0], seen.matches.left, known, alone, curves, rig)
        used = np.concatenate([found.used[: len(own)], np.zeros(len(parallel), bool)])
        found = estimate(lines, Factors.concatenate([own, parallel]), used, len(own))
        # Groups whose edges miss them by more than their sigmas say are told with larger ones, and no other factor.
        scatter = unit_variance(found.misfit[len(own) :])
        if scatter > 1.0:
            parallel = replace(parallel, sigma=np.sqrt(scatter) * parallel.sigma)
            found = estimate(lines, Factors.concatenate([own, parallel]), found.used, len(own))
    return found, lines.covariance_with_line(found.covariance)


def _with_corners(
    seen: StereoSegments,
    row_sigma: float,
    curves: Sequence[Curve],
    rig: StereoRig,
    views: Sequence[ViewLines],
    late: Late,
) -> tuple[Estimate, FloatArray, Extents, Corners]:
    """The estimate and its covariance with the left lines, where the edges end, and the corners that follow."""
    found, with_line = solved(seen, row_sigma, curves, rig, views, late)
    ends = view_extents(views, seen, found.x, extents(seen, found.x))
    return found, with_line, ends, corners(seen, found, ends)


def edges(
    seen: StereoSegments,
    row_sigma: float,
    curves: Sequence[Curve],
    rig: StereoRig,
    views: Sequence[ViewLines] = (),
    late: Late = never,
) -> tuple[Lines3D, tuple[Segments, Segments]]:
    """All straight edges of a pair of images.

    Parameters
    ----------
    seen : StereoSegments
        Matched segments.
    row_sigma : float, pixels
        By which single rows of the two images disagree.
    curves : sequence of Curve
        Planar curves of the pair; their normals are directions of edges as well.
    rig : StereoRig
    views : sequence of ViewLines
        What further cameras say of the edges.
    late : callable
        Whether it is too late for one more estimate.

    Returns
    -------
    Lines3D
    (Segments, Segments)
        Of both images, that the lines refer to: with those that the other image alone shows.
    """
    given = seen.matches
    found, with_line, ends, known = _with_corners(seen, row_sigma, curves, rig, views, late)
    wrong = inconsistent(seen, known)
    if wrong.any():
        seen = replace(seen, matches=seen.matches.select(~wrong))
        found, with_line, ends, known = _with_corners(seen, row_sigma, curves, rig, views, late)
    for _ in range(CORNER_ROUNDS):
        grown = None if late() else matched_by_corners(seen, known)
        if grown is None:
            break
        seen = replace(seen, matches=grown)
        found, with_line, ends, known = _with_corners(seen, row_sigma, curves, rig, views, late)
    matches = seen.matches
    # What another eye measures may be steep for these two.
    by_corners = (np.arange(len(matches)) >= len(given) - wrong.sum()) | seen_further(views, seen)
    lines = Lines3D(
        matches.left,
        matches.right,
        ends.abscissa,
        found.x,
        found.covariance,
        found.unit_variance * line_covariance(seen.segments[0], matches.left),
        with_line,
        ends.sigma,
        ends.fixed,
        by_corners,
        found.reliability,
    )
    more = junction_edges(seen, known)
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
        np.ones((count, 2), bool),
        np.ones(count, bool),
        np.ones(count),
    )
    return Lines3D.concatenate([lines, added]), more.segments
