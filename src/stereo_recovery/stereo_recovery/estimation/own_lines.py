"""What two matched segments say of their edge by themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import AnyArray, FloatArray

from ..detection.segments import Segments, reversed_polarity
from ..detection.settings import SAGITTA_OFFSET, SAGITTA_SLOPE
from ..matching.matches import Matches
from .estimate import OwnLines
from .settings import LEAST_SHARE, SAME_EXTENT


@dataclass(frozen=True, eq=False)
class LinePairs:
    """What the right lines of n matched segments say: rise (a + b s) is offset + slope s, give or take their errors.

    Attributes
    ----------
    rise : (n,) float64
        Row component of the right line's direction.
    value : (n, 2) float64
        Offset, pixels, and slope.
    left_variance : (n, 2) float64
        Of the value, for the left line's error, whose offset and slope it takes over.
    other_covariance : (n, 2, 2) float64
        Of the value, for the errors of the right line and of the rows.
    cosine : (n,) float64
        Of the angle between the lines: moved across by e, the left one lies beside the right one by so many e.
    """

    rise: FloatArray
    value: FloatArray
    left_variance: FloatArray
    other_covariance: FloatArray
    cosine: FloatArray

    def own_lines(self, extent: FloatArray) -> OwnLines:
        """The same as information of the unknowns, of edges of extents (n, 2)."""
        covariance = self.other_covariance.copy()
        covariance[:, 0, 0] += self.left_variance[:, 0]
        covariance[:, 1, 1] += self.left_variance[:, 1]
        inverse = np.linalg.inv(covariance)
        vector = np.einsum('nij,nj->ni', inverse, self.value) * self.rise[:, None]
        with_line = -inverse * (self.rise * self.cosine)[:, None, None] * self.left_variance[:, None, :]
        return OwnLines(inverse * (self.rise**2)[:, None, None], vector, extent, with_line)


def line_pairs(
    matches: Matches, segments: tuple[Segments, Segments], row_sigma: float, column_sigma: float = 0.0
) -> LinePairs:
    """What the two fitted lines of matched segments say of the disparity along the left one.

    The right line crosses the left one's rows, wherever the edge leaves them; an edge along the rows is hardly
    measured, which needs no distinction: the information is that much less.

    Parameters
    ----------
    matches : Matches
        n edges.
    segments : (Segments, Segments)
        Of the left and the right image.
    row_sigma, column_sigma : float, pixels
        By which single rows of the two images disagree, and columns, of two that a third camera holds against each
        other.
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
    covariance[:, 0, 0] = sr[:, 0] ** 2 + (p * sr[:, 1]) ** 2 + (tr[:, 0] * row_sigma) ** 2
    covariance[:, 0, 0] += (tr[:, 1] * column_sigma) ** 2
    covariance[:, 0, 1] = covariance[:, 1, 0] = p * q * sr[:, 1] ** 2
    # Rows that disagree by different amounts at the two ends turn the line.
    turn = np.sqrt(2.0) * tr[:, 0] * row_sigma / np.maximum(left.length[i], 1.0)
    covariance[:, 1, 1] = (q * sr[:, 1]) ** 2 + turn**2
    return LinePairs(tr[:, 1], np.stack([offset, slope], axis=1), sl**2, covariance, (tl * tr).sum(axis=1))


def own_lines(matches: Matches, segments: tuple[Segments, Segments], row_sigma: float) -> OwnLines:
    """:func:`line_pairs` of the same arguments as information of the edges' unknowns."""
    return line_pairs(matches, segments, row_sigma).own_lines(segments[0].extent[matches.left])


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
