"""What arcs say of the rows of a rectified pair.

A plane through both eyes that touches a curve in space touches its picture in either eye, in rows that should be one:
where an ellipse is highest and where it is lowest (R. Cipolla and P. Giblin, "Visual Motion of Curves and Surfaces",
2000, section 5.2: frontier points). However far apart the two ends of its arcs are, these two places are the same.
"""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import FloatArray

from ..detection.conics import Ellipse
from ..detection.edgels import Edgels
from ..detection.segments import Segments
from ..detection.settings import CORRELATION_LENGTH, ELLIPSE_PARAMETERS
from .matches import Matches
from .row_error import RowWitnesses


def paired_arcs(matches: Matches, segments: tuple[Segments, Segments]) -> list[tuple[int, int]]:
    """Arcs of the left and the right image of which segments are matched, those with the longest ones first.

    Every arc is in one pair at most.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the two images; their field ``arc`` is the number of the ellipse that a segment is part of.
    """
    left, right = segments
    arcs = left.arc[matches.left], right.arc[matches.right]
    weight: dict[tuple[int, int], float] = {}
    for m in np.flatnonzero((arcs[0] >= 0) & (arcs[1] >= 0)):
        key = (int(arcs[0][m]), int(arcs[1][m]))
        weight[key] = weight.get(key, 0.0) + float(left.length[matches.left[m]])
    pairs, used = [], (set[int](), set[int]())
    for a, b in sorted(weight, key=lambda key: -weight[key]):
        if a not in used[0] and b not in used[1]:
            used[0].add(a)
            used[1].add(b)
            pairs.append((a, b))
    return pairs


def arc_rows(
    matches: Matches,
    segments: tuple[Segments, Segments],
    ellipses: tuple[list[Ellipse], list[Ellipse]],
    edgels: tuple[Edgels, Edgels],
) -> RowWitnesses:
    """What matched arcs say of the rows, where both images show the highest or the lowest place of one.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the two images.
    ellipses : (list of Ellipse, list of Ellipse)
        The arcs of the images.
    edgels : (Edgels, Edgels)
        In the order to which the segments refer.
    """
    point, off, sigma = [], [], []
    for pair in paired_arcs(matches, segments):
        places, seen, variance = [], [], 0.0
        for side, of, all_edgels, arc in zip(segments, ellipses, edgels, pair):
            shown = all_edgels.position[side.edgels(np.flatnonzero(side.arc == arc))]
            ends = level_tangents(of[arc].conic)
            away = np.linalg.norm(shown - ends[:, None], axis=2)
            places.append(ends)
            seen.append((away < CORRELATION_LENGTH).any(axis=1))
            # Of a place between edgels, all of which share the parameters.
            variance += of[arc].rms ** 2 * ELLIPSE_PARAMETERS * CORRELATION_LENGTH / max(len(shown), 1)
        for k in np.flatnonzero(seen[0] & seen[1]):
            point.append(places[1][k])
            off.append(places[1][k, 1] - places[0][k, 1])
            sigma.append(np.sqrt(variance))
    return RowWitnesses(np.reshape(point, (-1, 2)), np.array(off, float), np.array(sigma, float))


def level_tangents(conic: FloatArray) -> FloatArray:
    """(2, 2) float64, pixels: where an ellipse is highest and where it is lowest.

    Parameters
    ----------
    conic : (3, 3) float64
        See :class:`..detection.conics.Ellipse`.

    Examples
    --------
    >>> level_tangents(np.array([[1.0, 0.0, -5.0], [0.0, 1.0, -3.0], [-5.0, -3.0, 30.0]])).round(9).tolist()
    [[5.0, 1.0], [5.0, 5.0]]
    """
    # A line touches where it is tangent to the dual conic, at the point that this makes of it.
    dual = np.linalg.inv(conic)
    middle = dual[1, 2] / dual[2, 2]
    half = np.sqrt(max(middle**2 - dual[1, 1] / dual[2, 2], 0.0))
    rows = np.array([middle - half, middle + half])
    touching = np.stack([np.zeros(2), np.ones(2), -rows], axis=1) @ dual
    return np.column_stack([touching[:, 0] / touching[:, 2], rows])
