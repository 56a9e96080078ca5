"""Edges that one image shows, and whose place in the other the texture beside them tells."""

from __future__ import annotations

import numpy as np

from msgs_py.numeric.typed import BoolArray, Float32Array, FloatArray, IntArray

from ..detection.segments import Segments
from ..estimation.settings import OPEN_SIGMA, STRIP_CORRELATION, STRIP_PRIOR
from ..estimation.texture import Texture, strips_beside
from ..estimation.texture_kernels import align_strips
from ..matching.stereo_segments import StereoSegments
from .all_views import with_stand_ins
from .joining import contrast_across
from .settings import GAP_SHARE, STRIP_SHORTEST


def seen_by_texture(seen: StereoSegments, texture: Texture) -> StereoSegments:
    """The pair with the left image's edges that have no match, but lie on a surface whose texture has one.

    The nearer surface is the one that an edge belongs to. The right image has to have its contrast there.

    Parameters
    ----------
    seen : StereoSegments
    texture : Texture
    """
    left = seen.segments[0]
    free = (left.arc < 0) & (left.length >= STRIP_SHORTEST)
    free[seen.matches.left] = False
    index = np.flatnonzero(free)
    owner, places, starts = strips_beside(left, index, texture.dense)
    good, value, covariance, _ = align_strips(texture.levels, texture.scale, places, starts, 1.0)
    middle = places[:, 4:6].mean(axis=1)
    h = np.stack([np.ones_like(middle), middle], axis=1)
    good &= STRIP_CORRELATION * np.einsum('ki,kij,kj->k', h, covariance, h) < OPEN_SIGMA**2
    disparity = (h * value).sum(axis=1)
    order = np.lexsort((disparity, owner))
    order = order[good[order]]
    if len(order) == 0:
        return seen
    nearest = order[np.concatenate([owner[order][1:] != owner[order][:-1], [True]])]
    nearest = nearest[_has_contrast(left, index[owner[nearest]], value[nearest], texture.levels[-1])]
    if len(nearest) == 0:
        return seen
    return with_stand_ins(seen, index[owner[nearest]], value[nearest], np.full(len(nearest), STRIP_PRIOR))


def _has_contrast(
    left: Segments, index: IntArray, x: FloatArray, images: tuple[Float32Array, Float32Array]
) -> BoolArray:
    """(k,) bool: left segments that the right image shows, too, where disparities a + b s (k, 2) have them."""
    result = np.zeros(len(index), bool)
    for k, (i, (a, b)) in enumerate(zip(index, x)):
        here = np.stack([left.start[i], left.end[i]])
        there = here - np.stack([a + b * left.extent[i], np.zeros(2)], axis=1)
        own, its = contrast_across(images[0], *here), contrast_across(images[1], *there)
        result[k] = own * its > 0.0 and abs(its) > GAP_SHARE * abs(own)
    return result
