"""What two matched segments say of their edge by themselves."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import AnyArray

from ..detection.segments import Segments, reversed_polarity
from ..detection.settings import SAGITTA_OFFSET, SAGITTA_SLOPE
from ..matching.matches import Matches
from .estimate import OwnLines
from .settings import LEAST_SHARE, SAME_EXTENT


def own_lines(matches: Matches, segments: tuple[Segments, Segments], row_sigma: float) -> OwnLines:
    """What the two fitted lines of matched segments say of the disparity along the left one.

    The right line crosses the left one's rows, wherever the edge leaves them; an edge along the rows is hardly
    measured, which needs no distinction: the information is that much less.

    Parameters
    ----------
    matches : Matches
        n edges.
    segments : (Segments, Segments)
        Of the left and the right image.
    row_sigma : float, pixels
        By which single rows of the two images disagree.
    """
    left, right = segments
    i, j = matches.left, matches.right
    cl, tl, cr, tr = left.centre[i], left.direction[i], right.centre[j], right.direction[j]
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
    covariance[:, 0, 0] = sl[:, 0] ** 2 + sr[:, 0] ** 2 + (p * sr[:, 1]) ** 2 + (tr[:, 0] * row_sigma) ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = p * q * sr[:, 1] ** 2
    # Rows that disagree by different amounts at the two ends turn the line.
    turn = np.sqrt(2.0) * tr[:, 0] * row_sigma / np.maximum(left.length[i], 1.0)
    covariance[:, 1, 1] = sl[:, 1] ** 2 + (q * sr[:, 1]) ** 2 + turn**2
    inverse = np.linalg.inv(covariance)
    information = inverse * (tr[:, 1] ** 2)[:, None, None]
    vector = np.einsum('nij,nj->ni', inverse, np.stack([offset, slope], axis=1)) * tr[:, 1:2]
    # Moved across by e, the left line's points lie beside the right one by -e times the cosine between the two.
    cosine = (tl * tr).sum(axis=1)
    with_line = -inverse * (tr[:, 1] * cosine)[:, None, None] * (sl**2)[:, None, :]
    return OwnLines(information, vector, left.extent[i], with_line)


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
