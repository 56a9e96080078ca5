"""Edges that one image shows, and whose place in the other the texture beside them tells."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, IntArray

from ..detection.segments import Segments
from ..estimation.settings import OPEN_SIGMA, STRIP_PRIOR
from ..estimation.texture import AlignedStrips
from ..matching.stereo_segments import StereoSegments
from .all_views import with_stand_ins
from .joining_kernels import contrast_across, same_contrast
from .settings import SHORTEST


def seen_by_texture(seen: StereoSegments, strips: AlignedStrips) -> StereoSegments:
    """The pair with the left image's edges that have no match, but lie on a surface whose texture has one.

    The nearer surface is the one that an edge belongs to. The right image has to have its contrast there.

    Parameters
    ----------
    seen : StereoSegments
    strips : AlignedStrips
        Of the left segments.
    """
    left = seen.segments[0]
    free = (left.arc < 0) & (left.length >= SHORTEST)
    free[seen.matches.left] = False
    index = np.flatnonzero(free)
    owner, value, covariance = strips.beside(index)
    middle = left.extent[index[owner]].mean(axis=1)
    h = np.stack([np.ones_like(middle), middle], axis=1)
    known = np.einsum('ki,kij,kj->k', h, covariance[:, :2, :2], h) < OPEN_SIGMA**2
    disparity = (h * value[:, :2]).sum(axis=1)
    order = np.lexsort((disparity, owner))
    order = order[known[order]]
    if len(order) == 0:
        return seen
    nearest = order[np.concatenate([owner[order][1:] != owner[order][:-1], [True]])]
    x = value[nearest, :2]
    shown = _has_contrast(left, index[owner[nearest]], x, strips.texture.levels[-1])
    if not shown.any():
        return seen
    return with_stand_ins(seen, index[owner[nearest]][shown], x[shown], np.full(shown.sum(), STRIP_PRIOR))


def _has_contrast(
    left: Segments, index: IntArray, x: FloatArray, images: tuple[Float32Array, Float32Array]
) -> BoolArray:
    """(k,) bool: left segments that the right image shows, too, where disparities a + b s (k, 2) have them."""
    here = np.stack([left.start[index], left.end[index]], axis=1)
    there = here.copy()
    there[..., 0] -= x[:, :1] + x[:, 1:] * left.extent[index]
    shown = [
        same_contrast(*(contrast_across(image, *ends) for image, ends in zip(images, both)))
        for both in zip(here, there)
    ]
    return np.array(shown, bool)
