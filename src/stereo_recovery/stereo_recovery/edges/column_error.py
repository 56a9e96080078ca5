"""How the columns of a further camera disagree with the depths that the main pair has.

A camera that has moved a little since its calibration shows its columns shifted as well as its rows. In a pair that is
an error of the depth which nobody sees; of a third camera the edges tell whose depth both know.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msgs_py import StereoRig

from ..detection.segments import Segments
from ..matching.further_views import FurtherView
from ..matching.row_error import RowWitnesses, fitted_error
from .further_views import ViewLines
from .transfer import seen_by
from .view_votes import Hypotheses, sharp


def with_columns(lines: ViewLines, of_pair: Hypotheses, left: Segments, main: StereoRig) -> FurtherView:
    """A further camera's view with its columns where the main pair has them, and what they differ by beyond that.

    Parameters
    ----------
    lines : ViewLines
        What the camera says.
    of_pair : Hypotheses
        What the main pair says, of its left segments.
    left : Segments
        These.
    main : StereoRig
    """
    view = lines.view
    seen, own = view.seen, lines.hypotheses()
    both = np.flatnonzero(sharp(of_pair, left.extent) & sharp(own, left.extent))
    rows = np.stack([np.ones((len(both), 2)), left.extent[both]], axis=-1)
    variance = np.einsum('nei,nij,nej->ne', rows, of_pair.covariance[both] + own.covariance[both], rows)
    ends, sigma = seen_by(lines, main, both, np.einsum('nei,ni->ne', rows, of_pair.x[both]), np.sqrt(variance))
    shown, _ = seen_by(lines, main, both, np.einsum('nei,ni->ne', rows, own.x[both]), np.sqrt(variance))
    # Of the two ends of a line the mean; they are no two witnesses.
    witnesses = RowWitnesses(shown.mean(axis=1), (shown - ends)[..., 0].mean(axis=1), sigma.max(axis=1))
    error = fitted_error(witnesses, (view.rig.right.width, view.rig.right.height), 0.0, axis=0)
    right = seen.segments[1]
    middle = 0.5 * (right.start + right.end)[seen.matches.right]
    matches = replace(seen.matches, disparity=seen.matches.disparity + error.at(middle)[:, None])
    return replace(view, seen=error.aligned(replace(seen, matches=matches)), column_sigma=error.sigma)
