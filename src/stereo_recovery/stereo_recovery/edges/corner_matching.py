"""What corners in space say of matches: those that miss one are none, and what leaves it in both images is one.

An eye that sees past an object's side sees an edge there that the other eye does not, a few pixels beside one that both
see, and often running into the same corner. A pair of such neighbours looks like one edge, but in one image it ends at
a corner that other edges know in space, and in the other image it misses that corner. A thin or steeply receding face
looks different to each eye, so that grey levels and slopes do not tell which segments belong together; but what leaves
a known corner unmatched in both images, and ends at one height, is one edge (thesis 3.10: figural continuity).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import AnyArray, BoolArray, FloatArray, IntArray

from ..detection.junctions import Junctions
from ..detection.segments import Segments, line_table
from ..estimation.settings import STEEP
from ..matching.matches import Matches
from ..matching.stereo_segments import StereoSegments
from . import corner_kernels
from .junction_edges import Corners, met_corners
from .settings import CORNER_GATE, ENDS_HEIGHT, ONE_CORNER, SAME_HEIGHT, SHORTEST_MATCH


def inconsistent(seen: StereoSegments, known: Corners) -> BoolArray:
    """(n,) bool: edges whose segment ends at a known corner in one image and misses that corner in the other.

    Parameters
    ----------
    seen : StereoSegments
        n edges.
    known : Corners
    """
    wrong = np.zeros(len(seen.matches), bool)
    tables = [line_table(segments) for segments in seen.segments]
    for image, sign in ((0, -1.0), (1, 1.0)):
        own = np.ascontiguousarray(known.own[image])
        found, value = corner_kernels.meetings(tables[image], known.point[image], known.disparity, known.sigma, own)
        wrong |= corner_kernels.missed(
            (seen.index[image], seen.index[1 - image]),
            (found, value),
            (tables[image], tables[1 - image]),
            (known.edge, known.point[image]),
            sign,
        )
    straight = [segments.arc[index] < 0 for segments, index in zip(seen.segments, seen.index)]
    return np.asarray(wrong & straight[0] & straight[1] & seen.paired)


@dataclass(frozen=True, eq=False)
class _FreeEnds:
    """m ends of one image's unmatched segments that are known corners.

    segment, end : (m,); here, away : (m, 2) pixels, the corner and the other end; disparity, sigma : (m,) pixels, of
    the corner; corner : (m,) bool, whether the other end is one, too; behind : (m,) the segment that hides it, or -1;
    steep : (m,) bool
    """

    segment: IntArray
    end: IntArray
    here: FloatArray
    away: FloatArray
    disparity: FloatArray
    sigma: FloatArray
    corner: BoolArray
    behind: IntArray
    steep: BoolArray


def _free_ends(segments: Segments, junctions: Junctions, used: AnyArray, known: Corners, image: int) -> _FreeEnds:
    """Those of an image's segments of which none is ``used``."""
    free = (segments.arc < 0) & (segments.length >= SHORTEST_MATCH)
    free[used] = False
    found, value = met_corners(segments, junctions, known, image)
    segment, end = np.nonzero(found & free[:, None])
    far = segment, 1 - end
    here, away = (
        segments.centre[segment] + place[:, None] * segments.direction[segment]
        for place in (value[segment, end, 0], junctions.abscissa[far])
    )
    through = junctions.t_junction[far]
    return _FreeEnds(
        segment,
        end,
        here,
        away,
        value[segment, end, 1],
        value[segment, end, 2],
        (junctions.neighbour[far] >= 0) & ~through,
        np.where(through, junctions.neighbour[far], -1),
        np.abs(segments.direction[segment, 1]) > 0.5 * STEEP,
    )


def matched_by_corners(seen: StereoSegments, known: Corners) -> Matches | None:
    """The matches and, last, the pairs that known corners add; None when they add none.

    Parameters
    ----------
    seen : StereoSegments
        The segments that do belong to pairs.
    known : Corners
    """
    left, right = (
        _free_ends(segments, junctions, index, known, image)
        for image, (segments, junctions, index) in enumerate(zip(seen.segments, seen.junctions, seen.index))
    )
    if min(len(left.segment), len(right.segment)) == 0:
        return None
    # Only ends in one row; a cluttered picture has thousands.
    order = np.argsort(right.here[:, 1], kind='stable')
    rows = right.here[order, 1]
    first, last = (np.searchsorted(rows, left.here[:, 1] + off) for off in (-SAME_HEIGHT, SAME_HEIGHT))
    a = np.repeat(np.arange(len(first)), last - first)
    b = order[np.arange(len(a)) + np.repeat(first - np.concatenate([[0], np.cumsum(last - first)[:-1]]), last - first)]
    height = np.abs(left.away[a, 1] - right.away[b, 1])
    sure = left.corner[a] & right.corner[b]
    # Or both run into one edge that hides their ends.
    partner = np.full(len(seen.segments[0]), -1)
    partner[seen.index[0][::-1]] = seen.index[1][::-1]
    hidden = (left.behind[a] >= 0) & (right.behind[b] >= 0) & (partner[left.behind[a]] == right.behind[b])
    steep = left.steep[a] & right.steep[b]
    slack = ONE_CORNER + CORNER_GATE * left.sigma[a]
    good = np.abs(left.disparity[a] - right.disparity[b]) < slack
    good &= np.abs(left.here[a, 0] - right.here[b, 0] - left.disparity[a]) < slack
    good &= (sure & (height < SAME_HEIGHT)) | (steep & ((height < ENDS_HEIGHT) | hidden))
    down = (left.away[a, 1] - left.here[a, 1]) * (right.away[b, 1] - right.here[b, 1])
    good &= (down > 0.0) | ~steep
    a, b, height = a[good], b[good], height[good]
    chosen = _best_first(left.segment[a], right.segment[b], height)
    if len(chosen) == 0:
        return None
    a, b = a[chosen], b[chosen]
    ends = np.stack([left.disparity[a], left.away[a, 0] - right.away[b, 0]], axis=1)
    ends = np.where(left.end[a, None] == 0, ends, ends[:, ::-1])
    added = Matches(
        left.segment[a].astype(np.int32),
        right.segment[b].astype(np.int32),
        np.column_stack([ends[:, 0], ends.mean(axis=1), ends[:, 1]]),
        np.sort(np.stack([left.here[a, 1], left.away[a, 1]], axis=1), axis=1),
        np.ones(len(a)),
    )
    return Matches.concatenate([seen.matches, added])


def _best_first(left: IntArray, right: IntArray, cost: FloatArray) -> IntArray:
    """Pairs (k,) of segments, the cheapest first, each segment in one only."""
    chosen: list[int] = []
    taken: tuple[set[int], set[int]] = (set(), set())
    for k in np.argsort(cost, kind='stable').tolist():
        if left[k] not in taken[0] and right[k] not in taken[1]:
            chosen.append(k)
            taken[0].add(int(left[k]))
            taken[1].add(int(right[k]))
    return np.array(chosen, np.int64)
