"""Which edgels of the two images may show one curve in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msgs_py.numeric.typed import FloatArray, IntArray

from ..detection.conics import Ellipse
from ..detection.segments import Segments
from ..matching.arc_rows import paired_arcs
from ..matching.matches import Matches
from . import settings
from .curve import Curve
from .observations import StereoEdgels


@dataclass(frozen=True, eq=False)
class ArcPair:
    """What may show one curve: arcs of the two images, or an arc and whatever it is matched with.

    Attributes
    ----------
    edgels : ((k,) int64, (m,) int64)
        Of either image, by their numbers there.
    ellipses : list of (Ellipse, bool)
        Of the arcs, and whether it is one of the right image.
    samples : (k, 3) float64, pixels
        u, v of the left image, disparity.
    is_pair : bool
        Arcs of both images.
    """

    edgels: tuple[IntArray, IntArray]
    ellipses: list[tuple[Ellipse, bool]]
    samples: FloatArray
    is_pair: bool

    def index(self, edgels: StereoEdgels) -> IntArray:
        """(k + m,) int64: the edgels by their numbers in ``edgels.seen``."""
        return np.concatenate([self.edgels[0], self.edgels[1] + len(edgels.left)])

    def shares_on(self, curve: Curve) -> tuple[float, float]:
        """Share of the edgels in either image that belong to a curve."""
        left, right = (np.count_nonzero(on[of]) / len(of) for on, of in zip((curve.left, curve.right), self.edgels))
        return left, right


def arc_pairs(
    matches: Matches, segments: tuple[Segments, Segments], ellipses: tuple[list[Ellipse], list[Ellipse]]
) -> list[ArcPair]:
    """What may show one curve, that with arcs in both images first, by falling number of edgels.

    Parameters
    ----------
    matches : Matches
        Pairs of segments.
    segments : (Segments, Segments)
        Of the two images; their field ``arc`` is the number of the ellipse that a segment is part of.
    ellipses : (list of Ellipse, list of Ellipse)
        The arcs of the images.

    Returns
    -------
    list of ArcPair
        Every arc is in one pair of arcs at most, that with the longest matched segments, and by itself with all that it
        is matched with, where that is at least MATCHED_SHARE of its length.
    """
    left, right = segments
    index = matches.left, matches.right
    arcs = left.arc[index[0]], right.arc[index[1]]
    members = [[np.flatnonzero(side.arc == k) for k in range(len(of))] for side, of in zip(segments, ellipses)]
    middle = 0.5 * (left.start + left.end)
    points = np.stack([left.start, middle, left.end], axis=1)[index[0]]
    samples = np.concatenate([points, matches.disparity[..., None]], axis=2)
    pairs = []
    for a, b in paired_arcs(matches, segments):
        of = (arcs[0] == a) & (arcs[1] == b)
        edgels = left.edgels(members[0][a]), right.edgels(members[1][b])
        both = [(ellipses[0][a], False), (ellipses[1][b], True)]
        pairs.append(ArcPair(edgels, both, samples[of].reshape(-1, 3), True))
    pairs.sort(key=lambda pair: -len(pair.edgels[0]))
    for side, is_right in ((0, False), (1, True)):
        for arc, own in enumerate(members[side]):
            of = arcs[side] == arc
            length = segments[side].length
            if length[np.unique(index[side][of])].sum() <= settings.MATCHED_SHARE * length[own].sum():
                continue
            far = segments[not is_right].edgels(np.unique(index[not is_right][of]))
            near = segments[side].edgels(own)
            edgels = (far, near) if is_right else (near, far)
            pairs.append(ArcPair(edgels, [(ellipses[side][arc], is_right)], samples[of].reshape(-1, 3), False))
    return pairs
