"""Which straight edges in space are reported: those that are well determined, long enough, and not part of a curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray

from ..curves.curve import Curve
from ..curves.curved_shapes import CurvedShapes
from ..curves.occluding_contours import on_contours
from ..curves.settings import SHARED_EDGELS
from ..detection.segments import Segments
from ..matching.settings import STEEPEST
from .lines3d import EdgesInSpace, Lines3D
from .settings import LEAST_RELIABILITY, MOST_ERR_PER


def lengths(edges: EdgesInSpace) -> FloatArray:
    """(n,) float64, metres; NaN for edges that reach beyond infinity."""
    length: FloatArray = np.linalg.norm(edges.ends[:, 1] - edges.ends[:, 0], axis=1)
    return length


def has_direction(edges: EdgesInSpace) -> BoolArray:
    """(n,) bool: edges of finite length and error whose direction is known."""
    length = lengths(edges)
    finite: BoolArray = np.isfinite(length) & np.isfinite(edges.err_par)
    return finite & (edges.err_per < MOST_ERR_PER * length)


def has_possible_slope(lines: Lines3D, left: Segments) -> BoolArray:
    """(n,) bool: edges whose disparity gradient is below STEEPEST, the limit of matches, or that junctions determine.

    The gradient is |b| over the length of the direction in the cyclopean image, midway between the two.
    """
    run = left.direction[lines.left]
    slope = lines.coefficient[:, 1]
    gradual: BoolArray = np.abs(slope) < STEEPEST * np.hypot(run[:, 0] - 0.5 * slope, run[:, 1])
    gradual |= lines.strut
    return gradual


def is_no_arc(lines: Lines3D, segments: tuple[Segments, Segments], has_curves: bool) -> BoolArray:
    """(n,) bool: edges that are part of an arc in neither image.

    One that is in just one image counts as straight if it runs from junction to junction in a pair without curves.
    """
    arcs = (segments[0].arc[lines.left] >= 0).astype(int) + (segments[1].arc[lines.right] >= 0)
    straight: BoolArray = (arcs == 0) | ((arcs == 1) & lines.fixed.all(axis=1) & (not has_curves))
    return straight


def on_curves(lines: Lines3D, segments: tuple[Segments, Segments], curves: Sequence[Curve]) -> BoolArray:
    """(n,) bool: edges of which most edgels in one of the images belong to a curve."""
    result = np.zeros(len(lines), bool)
    for curve in curves:
        for side, index, mask in zip(segments, (lines.left, lines.right), (curve.left, curve.right)):
            total = np.concatenate([[0], np.cumsum(mask)])
            bounds = side.bounds[index]
            count = total[bounds[:, 1]] - total[bounds[:, 0]]
            result |= count > SHARED_EDGELS * (bounds[:, 1] - bounds[:, 0])
    return result


def is_edge(
    lines: Lines3D,
    edges: EdgesInSpace,
    segments: tuple[Segments, Segments],
    shapes: CurvedShapes,
    min_length: float,
    rig: StereoRig,
) -> BoolArray:
    """Which lines are straight edges of an object.

    Parameters
    ----------
    lines : Lines3D
        n edges by their disparities.
    edges : EdgesInSpace
        The same in space.
    segments : (Segments, Segments)
        Of the two images, that the lines refer to.
    shapes : CurvedShapes
        The curves and curved surfaces of the pair.
    min_length : float
        Pixels. Of the part of an edge that both images show.
    rig : StereoRig
        The cameras.

    Returns
    -------
    (n,) bool
    """
    selected: BoolArray = (
        has_direction(edges)
        & (lines.reliability > LEAST_RELIABILITY)
        & (lines.extent[:, 1] - lines.extent[:, 0] >= min_length)
        & has_possible_slope(lines, segments[0])
        & is_no_arc(lines, segments, len(shapes.curves) > 0)
        & ~on_curves(lines, segments, shapes.curves)
        & ~on_contours((lines.left, lines.right), segments, shapes.surfaces, rig)
    )
    return selected
