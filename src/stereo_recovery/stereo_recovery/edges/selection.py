"""Which straight edges in space are reported: those that are well determined, long enough, and not part of a curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py.numeric.typed import BoolArray, FloatArray

from ..curves.curve import Curve
from ..curves.settings import SHARED_EDGELS
from ..detection.segments import Segments
from .lines3d import EdgesInSpace, Lines3D
from .settings import MOST_ERR_PER


def lengths(edges: EdgesInSpace) -> FloatArray:
    """(n,) float64, metres; NaN for edges that reach beyond infinity."""
    length: FloatArray = np.linalg.norm(edges.ends[:, 1] - edges.ends[:, 0], axis=1)
    return length


def has_direction(edges: EdgesInSpace) -> BoolArray:
    """(n,) bool: edges of finite length and error whose direction is known."""
    length = lengths(edges)
    finite: BoolArray = np.isfinite(length) & np.isfinite(edges.err_par)
    return finite & (edges.err_per < MOST_ERR_PER * length)


def is_no_arc(lines: Lines3D, segments: tuple[Segments, Segments]) -> BoolArray:
    """(n,) bool: edges that are part of an arc in neither image."""
    straight: BoolArray = (segments[0].arc[lines.left] < 0) & (segments[1].arc[lines.right] < 0)
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
    lines: Lines3D, edges: EdgesInSpace, segments: tuple[Segments, Segments], curves: Sequence[Curve], min_length: float
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
    curves : sequence of Curve
        Of the pair.
    min_length : float
        Pixels. Of an edge in the left image.

    Returns
    -------
    (n,) bool
    """
    selected: BoolArray = (
        has_direction(edges)
        & (lines.extent[:, 1] - lines.extent[:, 0] >= min_length)
        & is_no_arc(lines, segments)
        & ~on_curves(lines, segments, curves)
    )
    return selected
