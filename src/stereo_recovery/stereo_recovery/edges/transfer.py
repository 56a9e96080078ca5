"""What one pair of cameras says of an edge, looked for in the picture of another camera (trinocular stereo).

Of two matches of one segment that contradict each other, each foretells where the other camera should see the edge. The
right one's prediction lies on a segment there, the wrong one's by accident only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import BoolArray, FloatArray, IntArray
from msgs_py.settings import BOUND_SIGMA

from ..detection.segments import Segments
from ..matching.stereo_segments import StereoSegments
from .further_views import ViewLines
from .settings import PREDICTION_SHARE, PREDICTION_SIGMA
from .view_votes import Hypotheses, agreement, sharp


def on_segments(ends: FloatArray, sigma: FloatArray, segments: Segments) -> BoolArray:
    """(k,) bool: predictions that lie on a segment of a picture.

    Parameters
    ----------
    ends : (k, 2, 2) float64, pixels
        Where an edge's ends should be.
    sigma : (k, 2) float64, pixels
        Of their columns, along which an error of the depth moves them.
    segments : Segments
        Of the picture.
    """
    result = np.zeros(len(ends), bool)
    if len(segments) == 0:
        return result
    (tu, tv), (su, sv) = segments.direction.T, segments.sigma.T
    for k, (end, spread) in enumerate(zip(ends, sigma)):
        du, dv = (end[:, None] - segments.centre).transpose(2, 0, 1)
        along, off = du * tu + dv * tv, dv * tu - du * tv
        variance = (spread[:, None] * tv) ** 2 + su**2 + (along * sv) ** 2 + PREDICTION_SIGMA**2
        low, high = along.min(axis=0), along.max(axis=0)
        common = np.minimum(high, segments.extent[:, 1]) - np.maximum(low, segments.extent[:, 0])
        near = (off**2 < BOUND_SIGMA**2 * variance).all(axis=0)
        result[k] = (near & (common > PREDICTION_SHARE * (high - low))).any()
    return result


def confirmations(
    seen: StereoSegments, rig: StereoRig, views: Sequence[ViewLines], hypotheses: Sequence[Hypotheses]
) -> FloatArray:
    """(v, v, n) float64: 1 where the second camera's picture confirms what the first says, -1 where not, else 0.

    Asked where two contradict each other and both know the depth.

    Parameters
    ----------
    seen : StereoSegments
        The main pair, the first of the cameras.
    rig : StereoRig
        The main pair.
    views : sequence of ViewLines
        The others.
    hypotheses : sequence of Hypotheses
        Of all of them, of the main pair's n left segments.
    """
    left = seen.segments[0]
    clear = [sharp(each, left.extent) for each in hypotheses]
    agree = agreement(hypotheses)
    result = np.zeros(agree.shape)
    for a, says in enumerate(hypotheses):
        for b in range(len(hypotheses)):
            asked = np.flatnonzero(clear[a] & clear[b] & ~agree[a, b])
            if a == b or len(asked) == 0:
                continue
            rows = np.stack([np.ones((len(asked), 2)), left.extent[asked]], axis=-1)
            d = np.einsum('nei,ni->ne', rows, says.x[asked])
            spread = np.sqrt(np.einsum('nei,nij,nej->ne', rows, says.covariance[asked], rows))
            if b == 0:
                ends = np.stack([left.start[asked], left.end[asked]], axis=1)
                ends[..., 0] -= d
                found = on_segments(ends, spread, seen.segments[1])
            else:
                found = on_segments(*seen_by(views[b - 1], rig, asked, d, spread), views[b - 1].view.seen.segments[1])
            result[a, b, asked] = np.where(found, 1.0, -1.0)
    return result


def seen_by(
    lines: ViewLines, main: StereoRig, left: IntArray, d: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where a further camera sees the ends of left segments.

    Parameters
    ----------
    lines : ViewLines
        Of the camera.
    main : StereoRig
    left : (k,) int
        Left segments of the main pair that the camera's own pair shows.
    d, spread : (k, 2) float64, pixels
        Disparity at their ends, and its sigma.

    Returns
    -------
    (k, 2, 2), (k, 2) float64, pixels
        The ends in the camera's turned picture, and the sigma of their columns.
    """
    view = lines.view
    own = np.searchsorted(view.left, left)
    segments, along = view.seen.segments[0], view.turned.along[own]
    ends = np.stack([segments.start[own], segments.end[own]], axis=1)
    # The segment's ends in the main pair are its ends here.
    place = segments.extent[own]
    w, p, q = along[:, :, 0], along[:, :1, 1], along[:, 1:, 1]
    s = (place * w[:, :1] - p) / (q - place * w[:, 1:])
    ratio = view.rig.left.fx * view.rig.baseline / (main.left.fx * main.baseline) / (w[:, :1] + w[:, 1:] * s)
    ends[..., 0] -= ratio * (d - (main.left.cx - main.right.cx)) + view.rig.left.cx - view.rig.right.cx
    return ends, np.abs(ratio) * spread
