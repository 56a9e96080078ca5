"""A camera beyond the main pair: which of its segments is which of the main pair's left camera.

The two are a rectified pair of their own, in which the same labelling decides. Detection sees every picture once: its
segments are taken to the pair's frame by the homography of the camera's turn, with their covariances, so that the left
camera's are the same segments in every pair that it is in. The turned pictures only serve to compare grey levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import Float32Array, FloatArray, IntArray

from ..cameras.pairs import CameraPair
from ..detection.segments import Segments
from ..params import RecoveryParams
from .labelling import match
from .row_error import row_error
from .stereo_segments import StereoSegments
from .turned import TurnedSegments, in_view, turned


@dataclass(frozen=True, eq=False)
class FurtherView:
    """A camera beyond the main pair, matched with the main pair's left one.

    Attributes
    ----------
    seen : StereoSegments
        Matched segments of the two, in the frame of their own pair.
    left : (m,) int64
        Which of the main pair's left segments each of its left segments is.
    turned : TurnedSegments
        Those, as they were turned.
    rig : StereoRig
        The two cameras, turned.
    row_sigma : float, pixels
        By which single rows of the two disagree.
    column_sigma : float, pixels
        By which single columns disagree with the depths that the main pair has.
    """

    seen: StereoSegments
    left: IntArray
    turned: TurnedSegments
    rig: StereoRig
    row_sigma: float
    column_sigma: float = 0.0


def further_view(
    left: Segments,
    right: Segments,
    pair: CameraPair,
    turn: FloatArray,
    greys: tuple[Float32Array, Float32Array],
    window: tuple[float, float],
    params: RecoveryParams,
) -> FurtherView:
    """Match the main pair's left camera with a further one.

    Parameters
    ----------
    left, right : Segments
        Of the main pair's left picture, and of the further camera's own one.
    pair : CameraPair
        The two cameras.
    turn : (3, 3) float64
        Pixels of the pair's left picture from those of the main pair's.
    greys : (h, w) float32 each, grey levels
        The pair's pictures.
    window : (float, float), pixels
        Allowed disparity.
    params : RecoveryParams
    """
    size = pair.rig.left.width, pair.rig.left.height
    shown = [in_view(side, h, size) for side, h in ((left, turn), (right, pair.homographies[1]))]
    own = turned(left.select(shown[0]), turn)
    segments = own.segments, turned(right.select(shown[1]), pair.homographies[1]).segments
    matches, _ = match(greys, segments, window, params.support_radius, params.min_belief)
    seen = StereoSegments.of(matches, segments)
    rows = row_error(seen, size, params.rectification_sigma)
    return FurtherView(rows.aligned(seen), np.flatnonzero(shown[0]), own, pair.rig, rows.sigma)
