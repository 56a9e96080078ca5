"""Parts of one edge made one edge: in both images they lie on one line, at one depth, and the picture goes on between.

Card folds, worn corners and what stands before an edge break its line in the image, and a part says less of an object
than the whole: neither where the edge ends nor how long it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from msgs_py import StereoRig
from msgs_py.numeric.typed import AnyArray, Float32Array, FloatArray, IntArray

from ..matching.settings import PARTS_GAP
from . import joining_kernels
from .settings import JOINED_REACH, JOINED_SIGMA


class _Shown(NamedTuple):
    """Edges as the pair shows them.

    pixel : (n, 2, 2) float64, ends in the left image; disparity, sigma : (n, 2) float64, pixels, at the ends
    """

    pixel: FloatArray
    disparity: FloatArray
    sigma: FloatArray


def join_parts(
    ends: FloatArray, covariance: FloatArray, rig: StereoRig, grey: Float32Array
) -> tuple[FloatArray, FloatArray]:
    """Edges in space, parts of one edge as one.

    Parameters
    ----------
    ends : (n, 2, 3) float64, metres
        With the bright side on one hand.
    covariance : (n, 6, 6) float64, square metres
        Of both ends together.
    rig : StereoRig
    grey : (h, w) float32, grey levels
        The left image.

    Returns
    -------
    (m, 2, 3), (m, 6, 6)
        As given. What parts say of their edge hangs on the same neighbours, so that the edge is known as well as one of
        them, and not better.
    """
    shown = _shown(ends, covariance, rig)
    pairs = _candidates(shown.pixel)
    pairs = pairs[joining_kernels.go_on(grey, shown.pixel, pairs)]
    length = np.hypot(*(shown.pixel[:, 1] - shown.pixel[:, 0]).T)
    pairs = pairs[np.argsort(-length[pairs].min(axis=1), kind='stable')]
    group = joining_kernels.groups(shown.pixel, shown.disparity, np.hypot(shown.sigma, JOINED_SIGMA), pairs)
    heads, count = np.unique(group, return_counts=True)
    if (count == 1).all():
        return ends, covariance
    ends, covariance = ends.copy(), covariance.copy()
    for head in heads[count > 1]:
        members = np.flatnonzero(group == head)
        ends[head], covariance[head] = _whole(ends[members], covariance[members])
    return ends[heads], covariance[heads]


def _shown(ends: FloatArray, covariance: FloatArray, rig: StereoRig) -> _Shown:
    """Edges as the pair shows them."""
    points = ends.reshape(-1, 3)
    left, right = (image.reshape(-1, 2, 2) for image in rig.project(points))
    depth = ends[..., 2]
    variance = np.stack([covariance[:, 2, 2], covariance[:, 5, 5]], axis=1)
    return _Shown(left, (left - right)[..., 0], rig.left.fx * rig.baseline / depth**2 * np.sqrt(variance))


def _candidates(pixel: FloatArray) -> IntArray:
    """(k, 2) pairs of edges, the second of which begins near where the first ends."""
    order = np.argsort(pixel[:, 0, 0], kind='stable')
    column = pixel[order, 0, 0]
    first = np.searchsorted(column, pixel[:, 1, 0] - JOINED_REACH)
    last = np.searchsorted(column, pixel[:, 1, 0] + JOINED_REACH)
    count = last - first
    e = np.repeat(np.arange(len(pixel)), count)
    f = order[np.arange(len(e)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)]
    gap = pixel[f, 0] - pixel[e, 1]
    near = (e != f) & (np.hypot(gap[:, 0], gap[:, 1]) < JOINED_REACH)
    e, f, gap = e[near], f[near], gap[near]
    run = pixel[:, 1] - pixel[:, 0]
    length = np.hypot(run[:, 0], run[:, 1])
    follows = (gap * run[e]).sum(axis=1) / length[e] < PARTS_GAP * (length[e] + length[f])
    follows &= (run[e] * run[f]).sum(axis=1) > 0.9 * length[e] * length[f]
    # The second goes on beyond the first.
    follows &= ((pixel[f, 1] - pixel[e, 1]) * run[e]).sum(axis=1) > 0.5 * length[f] * length[e]
    follows &= ((pixel[f, 0] - pixel[e, 0]) * run[e]).sum(axis=1) > 0.0
    return np.stack([e[follows], f[follows]], axis=1)


def _whole(ends: FloatArray, covariance: FloatArray) -> tuple[AnyArray, AnyArray]:
    """The edge (2, 3) of k parts from the first to the last of their ends, and its covariance (6, 6)."""
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    points = ends.reshape(-1, 3)
    middle = np.average(points, axis=0, weights=np.repeat(length, 2))
    axis = np.average((ends[:, 1] - ends[:, 0]) / length[:, None], axis=0, weights=length)
    axis /= np.linalg.norm(axis)
    place = (ends - middle) @ axis
    outer = np.array([place.min(), place.max()])
    # Each part's line at both ends of the whole: linear in its own ends.
    share = (outer - place[:, :1]) / (place[:, 1:] - place[:, :1])
    blend = np.stack([1.0 - share, share], axis=2)
    carried = np.einsum('nab,nbi->nai', blend, ends).reshape(-1, 6)
    turn = np.einsum('nab,ij->naibj', blend, np.eye(3)).reshape(-1, 6, 6)
    each = turn @ covariance @ turn.swapaxes(1, 2)
    floor = np.trace(each, axis1=1, axis2=2).min() * 1e-9 * np.eye(6)
    information = np.linalg.inv(each + floor)
    total = np.linalg.inv(information.sum(axis=0))
    value = total @ np.einsum('nij,nj->i', information, carried)
    return value.reshape(2, 3), len(ends) * total
